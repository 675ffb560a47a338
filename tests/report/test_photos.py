"""Photos beside findings: of frames that they name, and of frames that see the walls that they name."""

import base64
import re
from dataclasses import replace

import pytest

from planfit.findings import Finding, ResultKind, ScanKind
from planfit.findings.finding import FEW_NAMED
from planfit.report.html.sections import frames_to_show, items_with_photos
from report.scenes import room_plan
from test_report import make_result

RESULT = replace(make_result(n_frames=12), floorplan=room_plan())
"""Frame i sees wall i % 4."""


def pictures(*frames):
    return {frame: f"photo {frame}".encode() for frame in frames}


def about(frames=(), faces=()):
    return Finding(ResultKind.WALLS_MOVED, frames=frames, faces=faces)


def test_a_run_of_frames_is_shown_by_the_picture_in_its_middle():
    shown = list(frames_to_show(about(((0, 4), (8, 8))), RESULT, pictures(*range(12))))
    assert shown == [2, 8]
    # Where not every frame has a picture, by one within the run, or by none.
    assert list(frames_to_show(about(((0, 4), (8, 8))), RESULT, pictures(0, 4, 11))) == [4]
    assert list(frames_to_show(about(((0, 4),)), RESULT, {})) == []


@pytest.mark.parametrize("face", range(4))
def test_a_wall_is_shown_by_a_frame_that_sees_it(face):
    (shown,) = frames_to_show(about(faces=(face,)), RESULT, pictures(*range(12)))
    assert shown % 4 == face
    assert list(frames_to_show(about(faces=(face,)), RESULT, pictures((face + 1) % 4))) == []


def test_what_concerns_one_of_several_scans_has_no_photo():
    """Its frames are numbered in that scan."""
    told = about(((0, 4),)).about("first floor")
    assert list(frames_to_show(told, RESULT, pictures(*range(12)))) == []


def test_photos_stand_beside_their_finding_and_are_few():
    found = [(Finding(ScanKind.NO_FLOOR), "no floor")]
    found += [(about(((3 * k, 3 * k),)), f"finding {k}") for k in range(4)]
    found += [(about(tuple((k, k) for k in range(12))), "many"), (about(((1, 1),)), "last")]
    html = items_with_photos(found, RESULT, pictures(*range(12)))
    items = html.split("</li>")[:-1]
    assert len(items) == len(found)
    counts = [item.count("<img") for item in items]
    assert counts == [0, 1, 1, 1, 1, 2, 0]
    assert sum(counts) == 2 * FEW_NAMED
    data = re.search(r"base64,([^\"]*)\"", items[2])
    assert data is not None
    assert base64.b64decode(data[1]) == b"photo 3"
    assert 'data-frame="3"' in items[2]
