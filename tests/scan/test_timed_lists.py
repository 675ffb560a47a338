"""Lists of images with times, and trajectories: units of clocks, decimal commas, times that are none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from planfit.scan.laser.trajectory import read_trajectory
from scan_samples import N, write_tum

LISTS = ("rgb.txt", "depth.txt", "groundtruth.txt")


def rewrite(folder, change, names=LISTS):
    """Each line of lists, without comments, by its number and words."""
    for name in names:
        lines = [
            words
            for words in (line.split() for line in (folder / name).read_text().splitlines())
            if not words[0].startswith("#")
        ]
        changed = [" ".join(change(i, words)) for i, words in enumerate(lines)]
        (folder / name).write_text("\n".join(changed) + "\n")


@pytest.fixture
def recorded(sample, tmp_path):
    write_tum(tmp_path, sample)
    return tmp_path


def test_decimal_commas_in_lists_of_images(recorded):
    right = read_scan(recorded)
    rewrite(recorded, lambda _, w: [w[0].replace(".", ","), *w[1:]], LISTS[:2])
    found = read_scan(recorded)
    assert (found.frame_ids, found.warnings) == (right.frame_ids, right.warnings)
    assert_allclose(found.timestamps, right.timestamps)
    assert_allclose(found.world_from_cams, right.world_from_cams)


@pytest.mark.parametrize(
    ("per_s", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
@pytest.mark.parametrize("is_other", [False, True])
def test_clocks_of_trajectories_in_other_units(recorded, is_other, per_s, unit):
    right = read_scan(recorded)
    options = ScanOptions()
    rewrite(recorded, lambda _, w: [f"{float(w[0]) * per_s:.3f}", *w[1:]], LISTS[2:])
    if is_other:
        text = (recorded / LISTS[2]).read_text()
        (recorded / "slam.txt").write_text("time x y z qx qy qz qw\n" + text)
        (recorded / LISTS[2]).unlink()
        options = ScanOptions(poses=recorded / "slam.txt")
    found = read_scan(recorded, options=options)
    assert [unit in warning for warning in found.warnings].count(True) == 1
    assert found.frame_ids == right.frame_ids
    assert_allclose(found.world_from_cams, right.world_from_cams, atol=1e-2)


def test_a_slow_walk_keeps_its_seconds(recorded):
    (recorded / "slow.csv").write_text(
        "time,x,y,z,qx,qy,qz,qw\n"
        + "".join(
            f"{line.split()[0]},{1e-6 * i},0,0,0,0,0,1\n"
            for i, line in enumerate((recorded / LISTS[2]).read_text().splitlines())
            if line[0] != "#"
        )
    )
    (recorded / LISTS[2]).unlink()
    found = read_scan(recorded, options=ScanOptions(poses=recorded / "slow.csv"))
    assert not any("seconds" in warning for warning in found.warnings)


@pytest.mark.parametrize("kind", ["durations", "several clocks", "repeats"])
def test_times_of_no_clock_keep_the_order_of_the_lists(recorded, kind):
    times = {
        "durations": [0.033, 0.034, 0.033, 0.035, 0.032, 0.034],
        "several clocks": [5.0, 7.0, 9.0, 4.0, 6.0, 8.0],
        "repeats": [1.0, 1.0, 1.0, 2.0, 2.0, 2.0],
    }[kind]
    for name in LISTS:
        lines = [
            line.split() for line in (recorded / name).read_text().splitlines() if line[0] != "#"
        ]
        if name == LISTS[2]:
            lines = [["0", str(0.1 * i), "0", "0", "0", "0", "0", "1"] for i in range(N)]
        text = "".join(f"{t} {' '.join(w[1:])}\n" for t, w in zip(times, lines, strict=False))
        (recorded / name).write_text(text)
    found = read_scan(recorded)
    assert_allclose(found.timestamps, np.arange(len(found)))
    assert_allclose(found.world_from_cams[:, 0, 3], 0.1 * np.arange(len(found)))
    assert sum("order of the lists" in warning for warning in found.warnings) == 1


def test_colour_without_depth_is_a_frame(recorded):
    right = read_scan(recorded)
    lines = (recorded / "depth.txt").read_text().splitlines()
    kept = [line for line in lines if line[0] != "#"]
    (recorded / "depth.txt").write_text("\n".join(kept[:2] + kept[3:]) + "\n")
    found = read_scan(recorded)
    assert set(right.frame_ids) <= set(found.frame_ids)
    assert "depth" in found.lacking
    assert any("have no depth" in warning for warning in found.warnings)


def test_trajectories_of_several_clocks_cannot_tell_places_of_points(tmp_path):
    times = [5.0, 7.0, 9.0, 4.0, 6.0, 8.0]
    path = tmp_path / "t.txt"
    path.write_text("".join(f"{t} {0.1 * i} 0 0 0 0 0 1\n" for i, t in enumerate(times)))
    with pytest.raises(ScanError, match=r"times that go on along the path, found 4.*pose 3"):
        read_trajectory(path)
