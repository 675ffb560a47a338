"""The FACaP reader: what it reads back, and what it says about each kind of fault."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import Label, ScanOptions, read_scan
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.scan.poses import write_pose

WIDTH, HEIGHT = 32, 20
IDS = ("0003", "0004", "0010")


def write_image(path, image):
    path.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())


def color_of(i):
    image = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    image[: HEIGHT // 2, :, 0] = 200  # RGB: the upper half is red
    image[:, : WIDTH // 2, 2] = 40 * i
    return image


def depth_mm_of(i):
    depth = np.arange(WIDTH * HEIGHT, dtype=np.uint16).reshape(HEIGHT, WIDTH) + 1000 * (i + 1)
    depth[0, 0], depth[0, 1] = 0, 65535
    return depth


def pose_of(i):
    rotation = se3.exp_so3(np.array([0.1 * i, 0.7, -0.2]))
    return se3.make_transform(rotation, np.array([1.0 * i, 1.5, -2.0]))


def mask_as_stored(mask):
    """Masks lie a quarter turn off; `np.rot90(stored)` fits the image."""
    return np.rot90(mask, -1)


@pytest.fixture
def folder(tmp_path):
    """A scan of three frames with floor and wall masks."""
    path = tmp_path / "scan"
    (path / "arcore").mkdir(parents=True)
    (path / "segmentation").mkdir()
    for i, frame in enumerate(IDS):
        bgr = color_of(i)[..., ::-1]
        write_image(path / "arcore" / f"frame-{frame}.png", bgr)
        write_image(path / "arcore" / f"depth-{frame}.png", depth_mm_of(i))
        write_pose(path / "arcore" / f"pose-{frame}.txt", pose_of(i))
        camera = f"{WIDTH} {HEIGHT} 30.5 31 15.5 9.5\n"
        (path / "arcore" / f"cam_params-{frame}.txt").write_text(camera)
        for name, rows in (("floor", slice(15, None)), ("wall", slice(5, 15))):
            mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
            mask[rows] = 255
            write_image(path / "segmentation" / f"frame-{frame}_{name}.png", mask_as_stored(mask))
    return path


def refused(path, *words):
    """The error is a ScanError of one line, which names each of `words`."""
    with pytest.raises(ScanError) as caught:
        read_scan(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
    return message


def test_reads_back_what_was_written(folder):
    scan = read_scan(folder)
    assert scan.frame_ids == IDS
    assert_array_equal(scan.timestamps, [3, 4, 10])
    assert_allclose(scan.world_from_cams, [pose_of(i) for i in range(3)], atol=1e-8)
    camera = scan.cameras[1]
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (30.5, 31.0, 15.5, 9.5)
    for i in range(3):
        assert_array_equal(scan.files.color(i), color_of(i))
        depth = scan.files.depth(i)
        assert depth.dtype == np.float32
        assert np.isnan(depth[0, :2]).all()
        expected = depth_mm_of(i)[1:] / 1000
        assert_allclose(depth[1:], expected, rtol=1e-6)
    assert scan.floorplan_path is None
    assert_array_equal(scan.up_world, [0, 1, 0])


def test_masks_are_turned_upright(folder):
    scan = read_scan(folder)
    assert scan.has_labels
    labels = scan.files.labels(2)
    assert labels.shape == (HEIGHT, WIDTH)
    assert np.all(labels[15:] == Label.FLOOR)
    assert np.all(labels[5:15] == Label.WALL)
    assert np.all(labels[:5] == Label.NONE)


def test_floor_is_not_taken_from_the_wall_mask(folder):
    # The published code did, from the second frame on.
    scan = read_scan(folder)
    for i in range(3):
        assert np.sum(scan.files.labels(i) == Label.FLOOR) == 5 * WIDTH


def test_a_zipped_folder_reads_like_the_folder(folder, tmp_path):
    np.save(folder / "floorplan.npy", np.zeros((1, 4)))
    path = Path(shutil.make_archive(str(tmp_path / "zipped"), "zip", folder.parent, folder.name))
    plain, zipped = read_scan(folder), read_scan(path)
    assert zipped.format == "facap"
    assert zipped.cameras == plain.cameras
    assert_array_equal(zipped.world_from_cams, plain.world_from_cams)
    for i in range(3):
        assert_array_equal(zipped.files.depth(i), plain.files.depth(i))
        assert_array_equal(zipped.files.labels(i), plain.files.labels(i))
    assert zipped.floorplan_path == path / folder.name / "floorplan.npy"


def test_images_can_be_made_smaller_with_their_masks(folder):
    options = ScanOptions(image_size_px=WIDTH)
    assert read_scan(folder, options=options).cameras == read_scan(folder).cameras
    big = np.repeat(np.repeat(color_of(0), 2, axis=0), 2, axis=1)
    for frame in IDS:
        write_image(folder / "arcore" / f"frame-{frame}.png", big[..., ::-1])
        depth = np.full((2 * HEIGHT, 2 * WIDTH), 2500, np.uint16)
        write_image(folder / "arcore" / f"depth-{frame}.png", depth)
        camera = f"{2 * WIDTH} {2 * HEIGHT} 61 62 31.5 19.5\n"
        (folder / "arcore" / f"cam_params-{frame}.txt").write_text(camera)
        for name in ("floor", "wall"):
            path = folder / "segmentation" / f"frame-{frame}_{name}.png"
            mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            write_image(path, np.repeat(np.repeat(mask, 2, axis=0), 2, axis=1))
    scan = read_scan(folder, options=options)
    assert (scan.cameras[0].width, scan.cameras[0].height) == (WIDTH, HEIGHT)
    labels = scan.files.labels(1)
    assert np.all(labels[15:] == Label.FLOOR)
    assert np.all(labels[5:15] == Label.WALL)


def test_masks_can_be_left_unread(folder):
    (folder / "segmentation" / "frame-0003_wall.png").write_bytes(b"garbage")
    assert not read_scan(folder, use_masks=False).has_labels
    refused(folder, "frame-0003_wall.png")


def test_a_scan_without_masks(folder):
    shutil.rmtree(folder / "segmentation")
    assert not read_scan(folder).has_labels


def test_a_column_before_a_wall_is_a_column(folder):
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    mask[:, 10:12] = 255
    write_image(folder / "segmentation" / "frame-0003_columns.png", mask_as_stored(mask))
    labels = read_scan(folder).files.labels(0)
    assert np.all(labels[:, 10:12] == Label.COLUMN)
    assert np.all(labels[5:15, 12:] == Label.WALL)


def test_poses_are_written_in_the_scans_own_way(folder, tmp_path):
    scan = read_scan(folder)
    out = tmp_path / "out"
    out.mkdir()
    scan.files.write_poses(out, scan.world_from_cams)
    assert {p.name for p in out.iterdir()} == {f"pose-{i}.txt" for i in IDS}
    for frame in IDS:
        shutil.copy(out / f"pose-{frame}.txt", folder / "arcore")
    assert_allclose(read_scan(folder).world_from_cams, scan.world_from_cams, atol=2e-9)


def test_plan_axes_are_right_handed_with_up_as_z():
    assert np.linalg.det(PLAN_FROM_WORLD[:3, :3]) == pytest.approx(1.0)
    assert_array_equal(PLAN_FROM_WORLD @ [1, 2, 3, 1], [1, -3, 2, 1])


def test_the_plan_in_the_folder_is_found(folder):
    np.save(folder / "floorplan.npy", np.zeros((1, 4)))
    assert read_scan(folder).floorplan_path == folder / "floorplan.npy"


def test_frames_are_in_the_order_of_their_numbers(folder):
    for kind, end in (("frame", "png"), ("depth", "png"), ("pose", "txt"), ("cam_params", "txt")):
        shutil.copy(folder / f"arcore/{kind}-0003.{end}", folder / f"arcore/{kind}-12345.{end}")
    shutil.rmtree(folder / "segmentation")
    scan = read_scan(folder)
    assert scan.frame_ids == (*IDS, "12345")
    assert np.all(np.diff(scan.timestamps) > 0)


def test_names_in_capitals_are_read_with_their_masks(folder):
    for frame in IDS:
        old = folder / "arcore" / f"frame-{frame}.png"
        old.rename(old.with_name(f"Frame-{frame}.PNG"))
        for kind in ("floor", "wall"):
            mask = folder / "segmentation" / f"frame-{frame}_{kind}.png"
            mask.rename(mask.with_name(f"Frame-{frame}_{kind}.png"))
    scan = read_scan(folder)
    assert scan.has_labels
    assert np.any(scan.files.labels(0) == Label.WALL)


@pytest.mark.parametrize("name", ["frame-0004.jpg", "frame-4.png"])
def test_two_images_of_one_frame(folder, name):
    write_image(folder / "arcore" / name, color_of(0))
    refused(folder, "one colour image a frame", "frame-0004.png")


def test_the_fingerprint_changes_with_the_files(folder):
    before = read_scan(folder).fingerprint
    assert read_scan(folder).fingerprint == before
    write_pose(folder / "arcore" / "pose-0003.txt", pose_of(2))
    assert read_scan(folder).fingerprint != before


def test_four_decimals_of_a_pose_are_made_a_rotation(folder):
    text = "\n".join(" ".join(f"{v:.4f}" for v in row) for row in pose_of(1))
    (folder / "arcore" / "pose-0004.txt").write_text(text)
    rotation = read_scan(folder).world_from_cams[1, :3, :3]
    assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert_allclose(rotation, pose_of(1)[:3, :3], atol=1e-4)


# What is wrong with a scan, and what the message must name.


def test_missing_folder(tmp_path):
    refused(tmp_path / "nowhere", str(tmp_path / "nowhere"))


def test_a_file_instead_of_a_folder(tmp_path):
    (tmp_path / "scan.zip").write_bytes(b"PK")
    refused(tmp_path / "scan.zip", "scan.zip", "file")


def test_a_folder_of_something_else(tmp_path):
    (tmp_path / "holiday.jpg").write_bytes(b"")
    refused(tmp_path, str(tmp_path), "found a picture, and neither depth nor poses")


def test_no_frames(tmp_path):
    (tmp_path / "arcore").mkdir()
    refused(tmp_path, str(tmp_path / "arcore"), "frame-NNNN")


@pytest.mark.parametrize("kind", ["depth-0004.png", "pose-0004.txt", "cam_params-0004.txt"])
def test_a_file_is_missing(folder, kind):
    (folder / "arcore" / kind).unlink()
    refused(folder, kind, "3 colour frames", "found 2")


def test_more_depth_than_colour(folder):
    (folder / "arcore" / "frame-0004.png").unlink()
    refused(folder, str(folder / "arcore"), "depth-0004.png", "2 colour", "3 depth")


@pytest.mark.parametrize("name", ["arcore/frame-0004.png", "arcore/depth-0004.png",
                                  "segmentation/frame-0004_wall.png"])  # fmt: skip
@pytest.mark.parametrize("fault", ["garbage", "truncated header", "empty", "a huge size"])
def test_an_image_that_is_none(folder, name, fault):
    path = folder / name
    data = path.read_bytes()
    size = (200_000).to_bytes(4, "big")
    path.write_bytes(
        {
            "garbage": b"this is no image at all, only text",
            "truncated header": data[:20],
            "empty": b"",
            "a huge size": data[:16] + size + size + data[24:],
        }[fault]
    )
    refused(folder, str(path))


@pytest.mark.parametrize("name", ["depth-0003.png", "frame-0003.png"])
def test_an_image_cut_off_is_told_when_the_scan_is_read(folder, name):
    noise = np.random.default_rng(0).integers(1000, 5000, (HEIGHT, WIDTH)).astype(np.uint16)
    path = folder / "arcore" / name
    write_image(path, noise if "depth" in name else (noise % 256).astype("u1"))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(folder, name, "without an end")


def test_a_jpeg_cut_off_is_told_when_the_scan_is_read(folder):
    (folder / "arcore" / "frame-0003.png").unlink()
    shutil.rmtree(folder / "segmentation")
    path = folder / "arcore" / "frame-0003.jpg"
    write_image(path, np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)).astype("u1"))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * 0.8)])
    refused(folder, "frame-0003.jpg", "without an end")


@pytest.mark.parametrize("kind", ["depth", "frame"])
def test_an_image_spoiled_inside_is_told_when_the_frame_is_read(folder, kind):
    noise = np.random.default_rng(0).integers(1000, 5000, (HEIGHT, WIDTH)).astype(np.uint16)
    path = folder / "arcore" / f"{kind}-0003.png"
    write_image(path, noise if kind == "depth" else (noise % 256).astype("u1"))
    data = path.read_bytes()
    path.write_bytes(data[:60] + bytes(len(data) - 80) + data[-20:])
    scan = read_scan(folder)
    with pytest.raises(ScanError, match=rf"{kind}-0003\.png"):
        scan.files.depth(0) if kind == "depth" else scan.files.color(0)


def test_an_image_that_vanished_is_told_by_name(folder):
    scan = read_scan(folder)
    (folder / "arcore" / "depth-0003.png").unlink()
    with pytest.raises(ScanError, match=r"depth-0003\.png"):
        scan.files.depth(0)


@pytest.mark.parametrize("image", [np.ones((HEIGHT, WIDTH), np.uint8),
                                   np.ones((HEIGHT, WIDTH, 3), np.uint16)])  # fmt: skip
def test_depth_of_the_wrong_kind(folder, image):
    write_image(folder / "arcore" / "depth-0003.png", image)
    scan = read_scan(folder)
    with pytest.raises(ScanError, match=r"depth-0003\.png.*16-bit"):
        scan.files.depth(0)


def good_pose():
    return pose_of(1).tolist()


POSES = {
    "three rows": (good_pose()[:3], "4x4"),
    "five rows": ([*good_pose(), good_pose()[3]], "4x4"),
    "seven numbers": ([[0, 0, 0, 0, 0, 0, 1]], "4x4"),
    "scaled": ((np.diag([2, 2, 2, 1.0]) @ pose_of(1)).tolist(), "rotation"),
    "sheared": ((np.array([[1, 0.1, 0, 0], *np.eye(4)[1:]]) @ pose_of(1)).tolist(), "rotation"),
    "beyond all": (
        [[1e99, *row[1:]] if i == 0 else row for i, row in enumerate(good_pose())],
        "1e",
    ),
    "mirrored": ((pose_of(1) @ np.diag([1, -1, 1, 1.0])).tolist(), "mirrored"),
    "transposed": (pose_of(1).T.tolist(), "last row"),
}


LOST_POSES = {"NaN": np.nan, "infinity": np.inf, "zeros": 0.0}


@pytest.mark.parametrize("kind", LOST_POSES)
def test_frames_of_a_lost_tracker_are_left_out_and_named(folder, kind):
    lost = np.full((4, 4), LOST_POSES[kind])
    (folder / "arcore" / "pose-0004.txt").write_text(
        "\n".join(" ".join(str(v) for v in row) for row in lost)
    )
    n_all = len(list((folder / "arcore").glob("pose-*.txt")))
    scan = read_scan(folder)
    assert len(scan) == n_all - 1
    assert "0004" not in scan.frame_ids
    assert scan.skipped == ("frame 0004: the tracker had no pose",)
    assert scan.warnings[0] == (
        f"{folder}: 1 of {n_all} frames have no pose, as the tracker was lost: frames 0004 are left out"
    )


@pytest.mark.parametrize("kind", POSES)
def test_a_pose_that_is_none(folder, kind):
    rows, word = POSES[kind]
    path = folder / "arcore" / "pose-0004.txt"
    path.write_text("\n".join(" ".join(str(v) for v in row) for row in rows))
    refused(folder, str(path), word)


@pytest.mark.parametrize("text", ["", "1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1", "not a pose",
                                  "1,0,0,0\n0,1,0,0\n0,0,1,0\n0,0,0,1"])  # fmt: skip
def test_a_pose_file_that_is_no_matrix(folder, text):
    path = folder / "arcore" / "pose-0004.txt"
    path.write_text(text)
    refused(folder, str(path), "4x4")


def test_a_pose_file_of_bytes(folder):
    path = folder / "arcore" / "pose-0004.txt"
    path.write_bytes(b"\xff\xfe\x00\x81")
    refused(folder, str(path))


def test_a_pose_file_that_is_a_folder(folder):
    path = folder / "arcore" / "pose-0004.txt"
    path.unlink()
    path.mkdir()
    refused(folder, str(path))


@pytest.mark.parametrize("values", [
    "", "32 20 30 31 15", "32 20 30 31 15.5 9.5 0", "32 20 0 31 15.5 9.5", "32 20 30 -31 15.5 9.5",
    "32 20 nan 31 15.5 9.5", "32 20 30 31 inf 9.5", "nan 20 30 31 15.5 9.5", "inf 20 30 31 15 9",
    "0 20 30 31 15.5 9.5", "32 wide 30 31 15.5 9.5",
])  # fmt: skip
def test_intrinsics_that_cannot_be_used(folder, values):
    path = folder / "arcore" / "cam_params-0004.txt"
    path.write_text(values)
    refused(folder, str(path), "w h fx fy cx cy")


@pytest.mark.parametrize("name", ["frame-0004.png", "depth-0004.png"])
def test_an_image_of_another_size_than_cam_params_says(folder, name):
    write_image(folder / "arcore" / name, np.ones((HEIGHT * 2, WIDTH * 2), np.uint16))
    refused(folder, str(folder / "arcore" / name), "expected 32 x 20", "found 64 x 40")


def test_a_mask_of_the_wrong_size(folder):
    path = folder / "segmentation" / "frame-0004_wall.png"
    write_image(path, np.zeros((WIDTH, HEIGHT + 1), np.uint8))
    refused(folder, str(path), "32 x 20", "32 x 21")


def test_a_mask_stored_upright(folder):
    path = folder / "segmentation" / "frame-0004_wall.png"
    write_image(path, np.zeros((HEIGHT, WIDTH), np.uint8))
    refused(folder, str(path), "quarter")


def test_masks_for_only_some_frames(folder):
    for name in ("floor", "wall"):
        (folder / "segmentation" / f"frame-0004_{name}.png").unlink()
    refused(folder, str(folder / "segmentation"), "0004", "found 2")


def test_one_spoiled_image_in_a_hundred_is_left_out_and_named(folder):
    shutil.rmtree(folder / "segmentation")
    arcore = folder / "arcore"
    for i in range(100, 200):
        for kind, end in (
            ("frame", "png"),
            ("depth", "png"),
            ("pose", "txt"),
            ("cam_params", "txt"),
        ):
            (arcore / f"{kind}-{i:04d}.{end}").hardlink_to(arcore / f"{kind}-0003.{end}")
    broken = arcore / "depth-0150.png"
    broken.unlink()
    broken.write_bytes(b"this is no image")
    scan = read_scan(folder)
    assert len(scan) == 102
    assert "0150" not in scan.frame_ids
    assert len(scan.skipped) == 1
    assert "depth-0150.png" in scan.skipped[0]
