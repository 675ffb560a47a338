"""Folders as other programs leave them: frames that are numbered, listed or named in their own ways."""

import json
import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from scan_samples import (
    N,
    jpg,
    k_of,
    matrix_text,
    png,
    put,
    quaternion,
    write_colmap,
    write_nerfstudio,
    write_seven_scenes,
    write_tum,
)


def numbered(folder, s, rows=()):
    """Images by number, and a trajectory whose times count seconds from its begin."""
    for i in range(N):
        put(folder / "rgb" / f"{i:06d}.jpg", jpg(s.color[i]))
        put(folder / "depth" / f"{i:06d}.png", png(s.depth_mm[i]))
    put(folder / "intrinsics.txt", " ".join(map(str, k_of(s.camera)[[0, 1, 0, 1], [0, 1, 2, 2]])))
    lines = [
        " ".join(f"{v:.9f}" for v in (0.3 * i, *pose[:3, 3], *quaternion(pose)))
        for i, pose in enumerate(s.poses)
    ]
    put(folder / "odometry.tum", "\n".join([*lines, *rows]) + "\n")


def test_the_tenth_image_was_not_taken_ten_seconds_after_the_first(sample, tmp_path):
    numbered(tmp_path, sample)
    scan = read_scan(tmp_path)
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    assert [line for line in scan.warnings if "rows are taken in order" in line]
    (tmp_path / "odometry.tum").rename(tmp_path.with_suffix(".tum"))
    given = read_scan(tmp_path, options=ScanOptions(poses=tmp_path.with_suffix(".tum")))
    assert_allclose(given.world_from_cams, sample.poses, atol=2e-6)


def test_times_for_fewer_or_more_images_than_are_numbered_are_refused(sample, tmp_path):
    numbered(tmp_path, sample, ["2.9 0 0 0 0 0 0 1"])
    with pytest.raises(ScanError, match=f"a row for each of {N} images, .* found {N + 1} rows"):
        read_scan(tmp_path)


def test_rows_of_frame_numbers_belong_to_images_by_these(sample, tmp_path):
    numbered(tmp_path, sample)
    lines = (tmp_path / "odometry.tum").read_text().splitlines()
    by_number = [f"{i} {line.partition(' ')[2]}" for i, line in enumerate(lines)]
    put(tmp_path / "odometry.tum", "\n".join(by_number[::-1]) + "\n")
    assert_allclose(read_scan(tmp_path).world_from_cams, sample.poses, atol=2e-6)


def test_frames_that_are_listed_in_any_order_go_by_their_names(sample, tmp_path):
    # As nerfstudio reads them; by list, neighbours in the list would be neighbours on the way.
    write_nerfstudio(tmp_path, sample)
    content = json.loads((tmp_path / "transforms.json").read_text())
    turn = [0, 2, 1, 3, 5, 4]
    content["frames"] = [content["frames"][i] for i in turn]
    put(tmp_path / "transforms.json", json.dumps(content))
    scan = read_scan(tmp_path)
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    assert [line for line in scan.warnings if "order of their names" in line]
    # Names that contradict the path, as those of several cameras, do not count.
    for place, frame in enumerate(content["frames"]):
        old, new = (tmp_path / name for name in (frame["file_path"], f"images/z_{place}.png"))
        shutil.copy(old, new)
        frame["file_path"] = f"images/z_{place}.png"
    listed = sorted(range(N), key=turn.__getitem__)
    content["frames"] = [content["frames"][i] for i in listed]
    put(tmp_path / "transforms.json", json.dumps(content))
    scan = read_scan(tmp_path)
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    assert not [line for line in scan.warnings if "order of their names" in line]


def test_a_dense_workspace_of_colmap_with_a_folder_a_camera(sample, tmp_path):
    write_colmap(tmp_path, sample)
    model = tmp_path / "sparse" / "0" / "images.txt"
    model.write_text(model.read_text().replace("IMG_", "cam0/IMG_"))
    maps = tmp_path / "stereo" / "depth_maps" / "cam0"
    (tmp_path / "images" / "cam0").mkdir()
    for path in (tmp_path / "images").glob("*.png"):
        path.rename(tmp_path / "images" / "cam0" / path.name)
    for i in range(N):
        depth = (sample.depth_mm[i] / 1000).astype("<f4")
        header = f"{depth.shape[1]}&{depth.shape[0]}&1&".encode()
        put(maps / f"IMG_{i:04d}.png.geometric.bin", header + depth.tobytes())
    shutil.rmtree(tmp_path / "depth")
    scan = read_scan(tmp_path)
    assert (scan.format, len(scan)) == ("colmap", N)
    assert_allclose(np.nan_to_num(scan.files.depth(2)), sample.depth_mm[2] / 1000, atol=1e-5)


@pytest.mark.parametrize("per_second", [10**3, 10**6, 10**9])
def test_lists_whose_times_count_parts_of_seconds(per_second, sample, tmp_path):
    write_tum(tmp_path, sample)
    for name in ("rgb.txt", "depth.txt"):
        rows = [line.split() for line in (tmp_path / name).read_text().splitlines()]
        lines = [f"{round(float(t) * per_second)} {file}" for t, file, *_ in rows if t != "#"]
        put(tmp_path / name, "\n".join(lines) + "\n")
    scan = read_scan(tmp_path)
    assert len(scan) == N
    # Between poses a thirtieth of a second and metres apart, half a millisecond is centimetres.
    assert_allclose(scan.world_from_cams, sample.poses, atol=0.05 if per_second == 10**3 else 1e-4)
    assert_allclose(scan.timestamps, sample.times, atol=1e-3)


def test_lists_with_poses_a_row_an_image_and_no_times(sample, tmp_path):
    write_tum(tmp_path / "scan", sample)
    (tmp_path / "scan" / "groundtruth.txt").unlink()
    blocks = [f"{i} {i} {i + 1}\n{matrix_text(pose)}" for i, pose in enumerate(sample.poses)]
    put(tmp_path / "odometry.log", "".join(blocks))
    scan = read_scan(tmp_path / "scan", options=ScanOptions(poses=tmp_path / "odometry.log"))
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)


def test_poses_of_a_lost_tracker_as_windows_prints_them(sample, tmp_path):
    write_seven_scenes(tmp_path, sample)
    put(tmp_path / "frame-000002.pose.txt", "-1.#INF -1.#INF -1.#INF 1.#QNAN00\n" * 4)
    scan = read_scan(tmp_path)
    assert "000002" not in scan.frame_ids
    assert len(scan) == N - 1
    assert scan.skipped


def test_cameras_of_gaussian_splatting_are_poses(sample, tmp_path):
    numbered(tmp_path, sample)
    (tmp_path / "odometry.tum").unlink()
    cameras = [
        {"id": i, "img_name": f"{i:06d}", "position": p[:3, 3].tolist(), "rotation": p[:3, :3].tolist()}
        for i, p in enumerate(sample.poses)
    ]  # fmt: skip
    put(tmp_path / "cameras.json", json.dumps(cameras[::-1]))
    assert_allclose(read_scan(tmp_path).world_from_cams, sample.poses, atol=2e-6)


def test_a_lens_that_is_not_told_says_so(sample, tmp_path):
    numbered(tmp_path, sample)
    put(tmp_path / "intrinsics.txt", "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n")
    with pytest.raises(ScanError, match="found none; give it with --intrinsics FILE"):
        read_scan(tmp_path)


def test_images_whose_names_are_no_series_are_told(sample, tmp_path):
    numbered(tmp_path, sample)
    for i in range(N):
        put(tmp_path / "rgb" / f"extra_{i:06d}_left.jpg", jpg(sample.color[i]))
    told = [line for line in read_scan(tmp_path).warnings if f"{N} images beside" in line]
    assert len(told) == 1


@pytest.mark.parametrize(("name", "text", "words"), [
    ("poses.csv", "frame,x,y,z,roll,pitch,yaw\n0,1,2,3,0,0,90\n", "name"),
    ("poses.json", '{"frames": [{"roll": 1}]}', "matrices of 4x4 or 3x4 in JSON"),
])  # fmt: skip
def test_a_scan_of_another_program_is_told_what_its_poses_lack(name, text, words, sample, tmp_path):
    numbered(tmp_path, sample)
    (tmp_path / "odometry.tum").unlink()
    put(tmp_path / name, text)
    with pytest.raises(ScanError, match="say --format any-folder"):
        read_scan(tmp_path)
    with pytest.raises(ScanError) as caught:
        read_scan(tmp_path, options=ScanOptions(format="any-folder"))
    assert name in str(caught.value)
    assert words in str(caught.value)
    assert "--poses FILE" in str(caught.value)


def test_numbers_of_hundreds_of_digits_are_none(sample, tmp_path):
    numbered(tmp_path, sample)
    put(tmp_path / "poses.json", f'{{"frames": [[{10**400}]]}}')
    assert_allclose(read_scan(tmp_path).world_from_cams, sample.poses, atol=2e-6)
    (tmp_path / "intrinsics.txt").unlink()
    put(tmp_path / "intrinsics.json", f'{{"camera_matrix": [{10**400}, 0, 1]}}')
    with pytest.raises(ScanError, match="expected a file with the lens"):
        read_scan(tmp_path)


def test_a_matrix_with_a_number_of_hundreds_of_digits_is_named(sample, tmp_path):
    write_nerfstudio(tmp_path, sample)
    content = json.loads((tmp_path / "transforms.json").read_text())
    content["frames"][2]["transform_matrix"][0][3] = 10**400
    put(tmp_path / "transforms.json", json.dumps(content))
    with pytest.raises(ScanError, match="frame 2, transform_matrix"):
        read_scan(tmp_path)
