"""ScanNet's .sens files: every field and code that sensorData.h saves is read."""

import struct
import zlib

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sens_writer import write_sens

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from planfit.scan.poses import read_pose
from planfit.scan.source import FolderSource
from scan_samples import HEIGHT, WIDTH, N, jpg, k_of, png

SMALL_K = np.diag([0.5, 0.5, 1.0])
"""Of a sensor with half the pixels each way, before the centre is seen to."""


def metres(depth_mm):
    return np.where(depth_mm > 0, depth_mm / 1000, np.nan)


def raw_depth(d):
    return d.astype("<u2").tobytes()


def test_a_file_is_read(sample, tmp_path):
    path = tmp_path / "scene0000_00.sens"
    write_sens(path, sample)
    scan = read_scan(path)
    assert scan.format == "sens"
    assert scan.frame_ids == tuple(str(i) for i in range(N))
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    assert_allclose(scan.timestamps, np.arange(N) * 0.033333)
    assert scan.skipped == scan.warnings == ()
    camera = scan.cameras[3]
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert (camera.fx, camera.cy) == pytest.approx((sample.camera.fx, sample.camera.cy))
    assert_allclose(scan.files.depth(3), metres(sample.depth_mm[3]), atol=1e-6)
    errors = [
        np.abs(np.asarray(scan.files.color(3), dtype=int) - c.astype(int)).mean()
        for c in sample.color
    ]
    assert np.argmin(errors) == 3


@pytest.mark.parametrize(
    ("code", "encode"), [(0, lambda image: image.tobytes()), (1, png), (2, jpg)]
)
def test_every_code_of_colour(code, encode, sample, tmp_path):
    write_sens(tmp_path / "a.sens", sample, color=encode, color_code=code)
    found = read_scan(tmp_path / "a.sens").files.color(2)
    assert np.abs(np.asarray(found, dtype=int) - sample.color[2]).mean() < (
        3 if code == 2 else 1e-9
    )


def test_depth_that_is_not_packed_and_of_other_units(sample, tmp_path):
    write_sens(tmp_path / "a.sens", sample, depth=raw_depth, depth_code=0, units=2000.0)
    assert_allclose(
        read_scan(tmp_path / "a.sens").files.depth(1), metres(sample.depth_mm[1]) / 2, atol=1e-6
    )
    asked = ScanOptions(depth_scale=0.004)
    assert_allclose(
        read_scan(tmp_path / "a.sens", options=asked).files.depth(1),
        4 * metres(sample.depth_mm[1]),
        atol=1e-5,
    )


def test_depth_of_a_camera_of_its_own(sample, tmp_path):
    """Without extrinsics both lenses say which pixels of depth and colour belong together."""
    k = SMALL_K @ k_of(sample.camera)
    k[0, 2] += 4.0
    write_sens(tmp_path / "a.sens", sample, depth_mm=sample.small_mm, depth_k=k)
    write_sens(
        tmp_path / "b.sens", sample, depth_mm=sample.small_mm, depth_k=SMALL_K @ k_of(sample.camera)
    )
    shifted, plain = (read_scan(tmp_path / f"{n}.sens").files.depth(1) for n in "ab")
    both = np.isfinite(shifted[:, :-8]) & np.isfinite(plain[:, 8:])
    assert_allclose(shifted[:, :-8][both], plain[:, 8:][both], atol=1e-6)


def test_a_depth_camera_that_nobody_calibrated_is_refused(sample, tmp_path):
    """sensorData.h writes the identity where none were set: a whole view would fall on one pixel."""
    write_sens(tmp_path / "a.sens", sample, depth_k=np.eye(3))
    with pytest.raises(
        ScanError, match=r"a\.sens, depth: expected usable intrinsics .* found .* 1 1 0 0 px"
    ):
        read_scan(tmp_path / "a.sens")


def test_extrinsics_of_depth_register_it(sample, tmp_path):
    apart = np.eye(4)
    apart[2, 3] = 0.5  # the depth camera stands 0.5 m in front of the colour camera
    flat = [np.full((HEIGHT, WIDTH), 2000, np.uint16) for _ in range(N)]
    write_sens(tmp_path / "a.sens", sample, depth_mm=flat, extrinsics=(np.eye(4), apart))
    depth = read_scan(tmp_path / "a.sens").files.depth(0)
    assert_allclose(depth[HEIGHT // 2, WIDTH // 2], 2.5, atol=1e-6)
    write_sens(tmp_path / "a.sens", sample, extrinsics=(apart, np.eye(4)))
    with pytest.raises(ScanError, match=r"a\.sens, extrinsics of colour: expected the identity"):
        read_scan(tmp_path / "a.sens")


def test_lost_frames_are_left_out_and_frames_without_an_image_named(sample, tmp_path):
    poses = sample.poses.copy()
    poses[2] = -np.inf
    encoded = iter([jpg(sample.color[i]) if i != 4 else b"" for i in range(N)])
    write_sens(tmp_path / "a.sens", sample, poses=poses, color=lambda _: next(encoded))
    scan = read_scan(tmp_path / "a.sens")
    assert scan.frame_ids == ("0", "1", "3", "4", "5")
    assert scan.lacking == ("", "", "", "colour", "")
    assert scan.files.color(3) is None


def test_depth_alone_is_read_with_its_own_lens(sample, tmp_path):
    k = SMALL_K @ k_of(sample.camera)
    write_sens(
        tmp_path / "a.sens", sample, color=lambda _: b"", depth_mm=sample.small_mm, depth_k=k
    )
    scan = read_scan(tmp_path / "a.sens")
    assert scan.files.color(0) is None
    assert scan.cameras[0].width == WIDTH // 2
    assert scan.cameras[0].fx == pytest.approx(k[0, 0])


@pytest.mark.parametrize("times", [[0] * N, [10**9 * i for i in range(N)], [3, 2, 1, 4, 5, 6]])
def test_times_that_are_none_number_the_frames(times, sample, tmp_path):
    write_sens(tmp_path / "a.sens", sample, times_us=times)
    assert_array_equal(read_scan(tmp_path / "a.sens").timestamps, np.arange(N))


def test_a_file_that_ends_early_is_read_up_to_there(sample, tmp_path):
    path = tmp_path / "a.sens"
    write_sens(path, sample)
    path.write_bytes(path.read_bytes()[:-2000])
    scan = read_scan(path)
    assert len(scan) == N - 1
    assert scan.warnings == (
        f"the file ends within frame {N - 1} of {N}: the frames before it are read; copy it again for the "
        "others",
    )
    path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(ScanError, match="found none that is whole; copy the file again"):
        read_scan(path)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"version": 3}, "expected version 4 of ScanNet's container, found 3"),
        ({"depth_code": 2}, "found 2, which only the sensor maker's library unpacks"),
        ({"color_code": 7}, "colour of code 7"),
        ({"units": 0.0}, "depth in 0.0 units a metre"),
    ],
)
def test_what_is_not_read_says_why(changed, match, sample, tmp_path):
    write_sens(tmp_path / "a.sens", sample, **changed)
    with pytest.raises(ScanError, match=match):
        read_scan(tmp_path / "a.sens")


def test_depth_that_unpacks_to_more_or_less_is_damaged(sample, tmp_path):
    for spoil in (lambda d: d[:-1], lambda d: np.vstack([d] * 2000)):
        write_sens(
            tmp_path / "a.sens",
            sample,
            depth=lambda d, spoil=spoil: zlib.compress(raw_depth(spoil(d))),
        )
        with pytest.raises(ScanError, match=r"depth/0: expected .* bytes of image, found"):
            read_scan(tmp_path / "a.sens").files.depth(0)


def test_spoilt_bytes_are_told_in_one_line(sample, tmp_path):
    path = tmp_path / "a.sens"
    write_sens(path, sample)
    data = path.read_bytes()
    rng = np.random.default_rng(4)
    for _ in range(150):
        spoiled = bytearray(data)
        for at in rng.integers(0, 600, 4):
            spoiled[at] = rng.integers(256)
        path.write_bytes(bytes(spoiled))
        try:
            scan = read_scan(path)
            assert np.nanmax(scan.files.depth(0)) > 0
        except ScanError as error:
            assert "\n" not in str(error)  # noqa: PT017
    path.write_bytes(struct.pack("<IQ", 4, 2**63))
    with pytest.raises(ScanError, match="a name of 9223372036854775808 bytes"):
        read_scan(path)


def test_refined_poses_are_written_as_sens_reader_does(sample, tmp_path):
    write_sens(tmp_path / "a.sens", sample)
    scan = read_scan(tmp_path / "a.sens")
    (tmp_path / "out").mkdir()
    moved = scan.world_from_cams.copy()
    moved[:, :3, 3] += (1, 2, 3)
    scan.files.write_poses(tmp_path / "out", moved)
    assert_allclose(read_pose(FolderSource(tmp_path / "out"), "4.txt"), moved[4], atol=1e-6)
