"""The file of corrections: what is read, what is written again, and what is refused in one line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planfit.corrections import (
    AddedLoop,
    Contradiction,
    Corrections,
    DeletedLoop,
    ExcludedFrames,
    Place,
    WallByHand,
    read_corrections,
    to_toml,
    write_corrections,
)
from planfit.errors import OptionError
from planfit.findings import Finding, SurveyKind

ALL_KINDS = """\
planfit_corrections = 1
[[place]]
frame = 12
pixel = [310.5, 205]
plan = [4.2, 1]
note = 'the "north" door'
[[place]]
scan = [1, 2, 3]
plan_file = [500000.25, 4.5]
[[add_loop]]
frames = [80, 12]
pixels = [[1, 2], [3, 4]]
[[delete_loop]]
frames = [90, [10, 20]]
[[exclude_frames]]
frames = [3, [40, 55]]
[[exclude_wall]]
ends = [[0, 0], [5, 0]]
[[erase_wall]]
ends = [[0, 1], [5, 1]]
[[draw_wall]]
ends = [[0, 2], [5, 2]]
"""


def test_every_kind_is_read(tmp_path):
    path = tmp_path / "corrections.toml"
    path.write_text(ALL_KINDS)
    read = read_corrections(path)
    assert read.entries == (
        Place(1, (4.2, 1.0), 12, (310.5, 205.0), note='the "north" door'),
        Place(2, (500000.25, 4.5), scan=(1.0, 2.0, 3.0), is_of_file=True),
        # The earlier frame first, and its pixel with it.
        AddedLoop(1, (12, 80), ((3.0, 4.0), (1.0, 2.0))),
        DeletedLoop(1, (10, 20), (90, 90)),
        ExcludedFrames(1, ((3, 3), (40, 55))),
        WallByHand("exclude_wall", 1, ((0.0, 0.0), (5.0, 0.0))),
        WallByHand("erase_wall", 1, ((0.0, 1.0), (5.0, 1.0))),
        WallByHand("draw_wall", 1, ((0.0, 2.0), (5.0, 2.0))),
    )
    assert read.sentence == (
        "8 corrections by hand: 2 places, 1 loop added, 1 loop deleted, 1 exclusion of frames, "
        "1 wall not used, 1 wall erased, 1 wall drawn"
    )
    assert np.flatnonzero(read.is_excluded(60)).tolist() == [3, *range(40, 56)]
    pairs = np.array([[10, 90], [90, 20], [9, 90], [10, 89], [15, 16]])
    assert read.are_deleted(pairs).tolist() == [True, True, False, False, False]
    assert read.last_frame == 90
    write_corrections(path, read)
    assert read_corrections(path) == read


def test_what_is_left_out_is_told_by_kind_and_number():
    loops = (AddedLoop(1, (0, 5)), AddedLoop(2, (1, 6)), Place(2, (0.0, 0.0), 3, (1.0, 1.0)))
    left = Corrections("c", loops).without(
        (Contradiction(loops[1], Finding(SurveyKind.LOOP_DELETED)),)
    )
    assert left.entries == (loops[0], loops[2])


numbers = st.floats(-1e6, 1e6, allow_nan=False)
frames = st.integers(0, 10**6)
pixels = st.tuples(numbers, numbers)
ranges = st.tuples(frames, frames).map(lambda r: (min(r), max(r)))
notes = st.text(max_size=30)
two_frames = st.tuples(frames, frames).filter(lambda f: f[0] < f[1])
two_ends = st.tuples(pixels, pixels).filter(lambda e: e[0] != e[1])


@given(
    st.lists(st.tuples(pixels, frames, pixels, notes), max_size=3),
    st.lists(st.tuples(two_frames, st.none() | st.tuples(pixels, pixels)), max_size=3),
    st.lists(st.tuples(ranges, ranges).map(lambda r: tuple(sorted(r))), max_size=3),
    st.lists(st.lists(ranges, min_size=1, max_size=3).map(tuple), max_size=3),
    st.lists(two_ends, max_size=3),
)
def test_what_is_written_reads_the_same(places, added, deleted, excluded, walls):
    from planfit.corrections.file import corrections_of
    from planfit.errors import printable

    entries = (
        *(Place(k, p, f, uv, note=printable(n)) for k, (p, f, uv, n) in enumerate(places, 1)),
        *(AddedLoop(k, f, uv) for k, (f, uv) in enumerate(added, 1)),
        *(DeletedLoop(k, *r) for k, r in enumerate(deleted, 1)),
        *(ExcludedFrames(k, r) for k, r in enumerate(excluded, 1)),
        *(WallByHand("draw_wall", k, e) for k, e in enumerate(walls, 1)),
    )
    import tomllib

    text = to_toml(Corrections("c", entries))
    assert corrections_of(tomllib.loads(text), "c").entries == entries


BAD = {
    "no TOML": ("[[place", "expected TOML"),
    "unknown table": ("[[add_lop]]\nframes = [1, 2]", "did you mean 'add_loop'"),
    "no list of tables": ("[add_loop]\nframes = [1, 2]", "begin each with [[add_loop]]"),
    "newer version": ("planfit_corrections = 2", "a newer planfit wrote it"),
    "unknown key": ("[[add_loop]]\nframe = [1, 2]", "add_loop 1: expected keys of add_loop, found"),
    "key missing": ("[[add_loop]]", "add_loop 1: expected frames, two frames"),
    "one frame": ("[[add_loop]]\nframes = [1]", "expected two different frames, found [1]"),
    "same frame": ("[[add_loop]]\nframes = [1, 1]", "expected two different frames"),
    "no number": ('[[add_loop]]\nframes = ["a", 2]', "expected the number of a frame"),
    "true": ("[[add_loop]]\nframes = [true, 2]", "expected the number of a frame"),
    "negative": (
        "[[add_loop]]\nframes = [-1, 2]",
        "expected the number of a frame, from 0, found -1",
    ),
    "one pixel": ("[[add_loop]]\nframes = [1, 2]\npixels = [[1, 2]]", "a pixel of each frame"),
    "pixel of three": ("[[add_loop]]\nframes=[1, 2]\npixels=[[1, 2, 3], [1, 2]]", "a pixel [u, v]"),
    "not finite": ("[[add_loop]]\nframes=[1, 2]\npixels=[[nan, 2], [1, 2]]", "a pixel [u, v]"),
    "turned range": ("[[exclude_frames]]\nframes = [[5, 3]]", "a range of frames [first, last]"),
    "no frames": ("[[exclude_frames]]\nframes = []", "expected frames, found none"),
    "three ranges": (
        "[[delete_loop]]\nframes = [1, 2, 3]",
        "two frames or ranges in frames, found 3",
    ),
    "wall of a point": ("[[draw_wall]]\nends = [[1, 1], [1, 1]]", "expected two different ends"),
    "wall of one end": ("[[draw_wall]]\nends = [[1, 1]]", "expected two ends"),
    "no place": ("[[place]]\nframe = 1\npixel = [1, 1]", "expected plan or plan_file"),
    "two places": ("[[place]]\nscan=[1,1,1]\nplan=[1,1]\nplan_file=[1,1]", "found both or none"),
    "no point": ("[[place]]\nplan = [1, 1]", "expected frame and pixel, or scan"),
    "no pixel": ("[[place]]\nframe = 1\nplan = [1, 1]", "expected frame and pixel, found one"),
    "note of numbers": ("[[place]]\nscan=[1,1,1]\nplan=[1,1]\nnote=3", "expected words for note"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_in_one_line_that_names_it(tmp_path, case):
    text, expected = BAD[case]
    path = tmp_path / "corrections.toml"
    path.write_text(text)
    with pytest.raises(OptionError) as refused:
        read_corrections(path)
    message = str(refused.value)
    assert message.startswith(str(path))
    assert expected in message
    assert "expected" in message
    assert "found" in message


def test_a_missing_file_and_one_of_other_bytes_are_refused(tmp_path):
    with pytest.raises(OptionError, match=r"none\.toml: expected a TOML file of corrections"):
        read_corrections(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(OptionError, match=r"bytes\.toml: expected TOML"):
        read_corrections(tmp_path / "bytes.toml")


def test_frames_that_the_scan_has_not_are_refused():
    corrections = Corrections("c.toml", (AddedLoop(2, (5, 12)),))
    corrections.require_frames(13)
    with pytest.raises(
        OptionError, match=r"c\.toml: add_loop 2: expected frames from 0 to 11, found 12"
    ):
        corrections.require_frames(12)
    with pytest.raises(OptionError, match="expected two frames at least that take part"):
        Corrections("c", (ExcludedFrames(1, ((0, 8),)),)).require_frames(10)
