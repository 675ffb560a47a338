"""Images and trajectories with times: clocks in other units, times of none, decimal commas, other rates."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import ScanOptions, read_scan
from planfit.scan.laser.trajectory import read_trajectory
from planfit.scan.poses import poses_at
from scan_samples import N, write_arkit_scenes, write_openloris, write_tum

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
def test_times_of_no_clock_keep_the_order_of_the_lists(recorded, kind, tmp_path):
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
    (recorded / LISTS[2]).rename(recorded / "slam.txt")
    named = read_scan(recorded, options=ScanOptions(poses=recorded / "slam.txt"))
    (recorded / "slam.txt").rename(recorded / LISTS[2])
    over = tmp_path / "over.txt"  # in place of the scan's own
    over.write_text((recorded / LISTS[2]).read_text().replace(" 0 0 0 0 0 1", " 1 0 0 0 0 1"))
    for found in (read_scan(recorded), named, read_scan(recorded, options=ScanOptions(poses=over))):
        assert_allclose(found.timestamps, np.arange(N))
        assert_allclose(found.world_from_cams[:, 0, 3], 0.1 * np.arange(N))
        assert any("order of the lists" in warning for warning in found.warnings)
    assert_allclose(found.world_from_cams[:, 1, 3], 1.0)


def without(folder, name):
    """An image that is gone, from its list too."""
    (folder / name).unlink()
    for path in folder.glob("*.txt"):
        kept = [line for line in path.read_text().splitlines() if name not in line]
        path.write_text("\n".join(kept) + "\n")


@pytest.mark.parametrize("write", [write_tum, write_openloris, write_arkit_scenes])
def test_frames_that_lack_an_image_come_out_with_poses(write, sample, tmp_path):
    write(tmp_path, sample)
    right = read_scan(tmp_path)
    colors = right.files.files.recording.frames
    without(tmp_path, colors[1].depth)
    without(tmp_path, colors[3].color)
    found = read_scan(tmp_path)
    assert found.lacking == ("", "depth", "", "colour", "", "")
    # Depth has a time of its own, and the pose of that.
    expected, _ = poses_at(right.timestamps, right.world_from_cams, found.timestamps, 0.02)
    assert_allclose(found.world_from_cams, expected, atol=1e-5)
    assert np.isnan(found.files.depth(1)).all()
    assert found.files.color(3) is None
    np.testing.assert_array_equal(found.files.depth(3), right.files.depth(3))
    assert found.cameras == right.cameras
    assert sum("are held by the recorded motion" in warning for warning in found.warnings) == 2


def test_poses_at_10_hz_tell_those_of_images_at_30():
    """Of a walk that turns and slows down, within a centimetre; none over a gap."""

    def walked(t):
        turn = se3.exp_so3(np.array([0.0, 0.6, 0.1]) * np.sin(t))
        return se3.make_transform(turn, np.array([np.sin(2 * t), 0.1 * np.cos(5 * t), 0.3 * t]))

    jitter = 0.01 * np.random.default_rng(0).uniform(-1, 1, 60)
    times = np.delete(np.arange(60) / 10 + jitter, slice(30, 35))
    at = np.arange(180) / 30
    poses, known = poses_at(times, np.stack([walked(t) for t in times]), at, 0.02)
    in_gap = (at > times[29] + 0.02) & (at < times[30] - 0.02)
    ends = (at < times[0] - 0.02) | (at > times[-1] + 0.02)
    np.testing.assert_array_equal(known, ~in_gap & ~ends)
    apart = se3.difference(poses[known], np.stack([walked(t) for t in at[known]]))
    assert np.linalg.norm(apart[:, 3:], axis=1).max() < 0.025
    assert np.median(np.linalg.norm(apart[:, 3:], axis=1)) < 0.003


def test_trajectories_of_several_clocks_cannot_tell_places_of_points(tmp_path):
    times = [5.0, 7.0, 9.0, 4.0, 6.0, 8.0]
    path = tmp_path / "t.txt"
    path.write_text("".join(f"{t} {0.1 * i} 0 0 0 0 0 1\n" for i, t in enumerate(times)))
    with pytest.raises(ScanError, match=r"times that go on along the path, found 4.*pose 3"):
        read_trajectory(path)
