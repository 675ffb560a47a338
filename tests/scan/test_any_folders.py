"""Folders that no named layout takes, as writers of public data sets and tools lay them out.

Each row says whose form it is and where that is written down. `BUILT_WITH` were there when the reader was
written, `HELD_OUT` were written after it.
"""

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from scan_samples import (
    GL,
    HEIGHT,
    WIDTH,
    N,
    Sample,
    jpg,
    k_of,
    matrix_text,
    png,
    put,
    quaternion,
    write_tum,
)

AIRSIM = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
"""cv_from_ned: camera axes of AirSim are x forward, y right, z down."""


@dataclass(frozen=True)
class Row:
    """A layout: who writes it, and what it must come to."""

    source: str
    """Whose form it is, and where it is written down."""
    write: Callable[[Path, Sample], None]
    advised: str = ""
    """What the message asks for, where it is not read at once."""
    options: dict = field(default_factory=dict)
    """What a user then gives; `intrinsics`: the lens as fx fy cx cy."""
    poses: Callable[[Sample], np.ndarray] = lambda s: s.poses
    """As the files have them."""
    mend: Callable[[Path], object] | None = None
    """What a user changes in the folder, where the message asks for that."""
    refused: str = ""
    """Words of the refusal, where it cannot be read."""
    tolerance_m: float = 6e-4
    """Of depth: half a stored unit, and what half floats have."""
    is_written_back: bool = False
    """As the files that it came in; else as TUM."""


def ids(n, digits=6):
    return [f"{i:0{digits}d}" for i in range(n)]


def line(values):
    return " ".join(f"{v:.9f}" for v in values)


def xyz_quaternion(pose):
    return [*pose[:3, 3], *quaternion(pose)]


def fx_line(s):
    c = s.camera
    return f"{c.fx:.9f} {c.fy:.9f} {c.cx:.9f} {c.cy:.9f}\n"


def npy(folder, name, array):
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    np.save(folder / name, array)


def tartanair(folder, s, sides=("left",)):
    for side in sides:
        for i, name in enumerate(ids(N)):
            put(folder / f"image_{side}" / f"{name}_{side}.png", png(s.color[i]))
            depth = s.depth_mm[i].astype(np.float32) / 1000
            npy(folder, f"depth_{side}/{name}_{side}_depth.npy", depth)
            npy(folder, f"seg_{side}/{name}_{side}_seg.npy", (s.depth_mm[i] % 7).astype(np.uint8))
            npy(
                folder,
                f"flow/{name}_{i + 1:06d}_flow.npy",
                np.zeros((HEIGHT, WIDTH, 2), np.float32),
            )
        rows = [line(xyz_quaternion(pose)) for pose in s.poses @ AIRSIM]
        put(folder / f"pose_{side}.txt", "\n".join(rows) + "\n")


def neural_rgbd(folder, s):
    blocks = "".join(matrix_text(pose @ GL) for pose in s.poses)
    for i in range(N):
        put(folder / "images" / f"img{i}.png", png(s.color[i]))
        put(folder / "depth" / f"depth{i}.png", png(s.depth_mm[i]))
        put(folder / "depth_filtered" / f"depth{i}.png", png(s.depth_mm[i] // 2))
        put(folder / "depth_with_noise" / f"depth{i}.png", png(s.depth_mm[i] // 3))
    put(folder / "poses.txt", blocks)
    put(folder / "trainval_poses.txt", blocks.replace(blocks.splitlines()[0], "nan nan nan nan"))
    put(folder / "focal.txt", f"{s.camera.fx}\n")


def sun3d(folder, s):
    for i in range(N):
        put(folder / "image" / f"{i + 1:07d}-{i * 33369:012d}.jpg", jpg(s.color[i]))
        rotated = (s.depth_mm[i] << 3) | (s.depth_mm[i] >> 13)  # as the set's own loader undoes
        put(folder / "depth" / f"{i + 1:07d}-{i * 33369 + 8378:012d}.png", png(rotated))
    rows = "".join(matrix_text(pose[:3]) for pose in s.poses)
    put(folder / "extrinsics" / "20140804141259.txt", rows)
    put(folder / "intrinsics.txt", matrix_text(k_of(s.camera)))


def bundle_sdf(folder, s):
    for i in range(N):
        name = str(1581120424100262102 + i * 33_000_000)
        put(folder / "rgb" / f"{name}.png", png(s.color[i]))
        put(folder / "depth" / f"{name}.png", png(s.depth_mm[i]))
        put(folder / "masks" / f"{name}.png", png(np.full((HEIGHT, WIDTH), 255, np.uint8)))
        put(folder / "annotated_poses" / f"{name}.txt", matrix_text(np.linalg.inv(s.poses[i])))
    put(folder / "cam_K.txt", matrix_text(k_of(s.camera)))


def record3d_dataset(folder, s):
    for i in range(N):
        put(folder / "rgb" / f"{i}.png", png(s.color[i]))
        put(folder / "depth" / f"{i}.png", png(s.depth_mm[i]))
        npy(folder, f"conf/{i}.npy", np.full((HEIGHT, WIDTH), 2, np.uint8))
        npy(folder, f"poses/{i}.npy", s.poses[i])
    c = s.camera
    put(folder / "dataconfig.yaml",
        f"dataset_name: record3d\ncamera_params:\n  image_height: {HEIGHT}\n  image_width: {WIDTH}\n"
        f"  fx: {c.fx}\n  fy: {c.fy}\n  cx: {c.cx}\n  cy: {c.cy}\n  png_depth_scale: 1000.0\n")  # fmt: skip


def vlmaps(folder, s):
    for i, name in enumerate(ids(N)):
        put(folder / "rgb" / f"{name}.png", png(s.color[i]))
        npy(folder, f"depth/{name}.npy", s.depth_mm[i].astype(np.float32) / 1000)
        npy(folder, f"semantic/{name}.npy", (s.depth_mm[i] % 40).astype(np.int32))
    rows = ["\t".join(f"{v:.9f}" for v in xyz_quaternion(pose)) for pose in s.poses]
    put(folder / "poses.txt", "\n".join(rows) + "\n")


def co_fusion(folder, s):
    for i in range(N):
        put(folder / "colour" / f"Color{i + 1:04d}.png", png(s.color[i]))
        depth = cv2.imencode(".tiff", s.depth_mm[i].astype(np.float32) / 1000)[1].tobytes()
        put(folder / "depth_noise" / f"Depth{i + 1:04d}.tiff", depth)
        put(folder / "mask_id" / f"Mask{i + 1:04d}.png", png(np.zeros((HEIGHT, WIDTH), np.uint8)))
    for name, shift in (("gt-cam-0", 0.0), ("gt-car-1", 3.0)):
        rows = [
            f"{i + 1} {line([p[0, 3] + shift, *xyz_quaternion(p)[1:]])}"
            for i, p in enumerate(s.poses)
        ]
        put(folder / "trajectories" / f"{name}.txt", "\n".join(rows) + "\n")
    put(folder / "calibration.txt", fx_line(s))


def realsense_in_one_folder(folder, s):
    for i, name in enumerate(ids(N)):
        put(folder / f"color_{name}.png", png(s.color[i]))
        put(folder / f"depth_{name}.png", png(s.depth_mm[i]))
        put(folder / f"pose_{name}.txt", matrix_text(s.poses[i]))
        put(folder / f"._color_{name}.png", b"\x00\x05\x16\x07")
    c = s.camera
    content = {"width": WIDTH, "height": HEIGHT, "ppx": c.cx, "ppy": c.cy, "fx": c.fx, "fy": c.fy,
               "model": "distortion.brown_conrady", "coeffs": [0.0] * 5}  # fmt: skip
    put(folder / "intrinsics.json", json.dumps(content))


def mushroom(folder, s):
    c, frames = s.camera, []
    for i in range(N):
        put(folder / "images" / f"{i:05d}.png", png(s.color[i]))
        put(folder / "depth" / f"{i:05d}.png", png(s.depth_mm[i]))
        frames.append(
            {"file_path": f"images/{i:05d}.png", "transform_matrix": (s.poses[i] @ GL).tolist()}
        )
    content = {"fl_x": c.fx, "fl_y": c.fy, "cx": c.cx + 0.5, "cy": c.cy + 0.5, "w": WIDTH, "h": HEIGHT,
               "k1": 0.0, "frames": frames[::-1]}  # fmt: skip
    put(folder / "transformations.json", json.dumps(content))


def poses_as_json(folder, s):
    for i in range(N):
        put(folder / "color" / f"{i:04d}.jpg", jpg(s.color[i]))
        put(folder / "aligned_depth_to_color" / f"{i:04d}.png", png(s.depth_mm[i]))
    put(
        folder / "camera_poses.json",
        json.dumps({f"{i:04d}": p.tolist() for i, p in enumerate(s.poses)}),
    )
    matrix = k_of(s.camera).ravel(order="F").tolist()
    put(
        folder / "intrinsic.json",
        json.dumps({"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": matrix}),
    )


def zed(folder, s):
    for i, name in enumerate(ids(N)):
        put(folder / f"left{name}.png", png(s.color[i]))
        put(folder / f"depth{name}.png", png(s.depth_mm[i]))
    header = "tx,ty,tz,qx,qy,qz,qw"
    rows = [",".join(f"{v:.9f}" for v in xyz_quaternion(pose)) for pose in s.poses]
    put(folder / "poses.csv", "\n".join([header, *rows]) + "\n")
    lines = [f"Camera.{name}: {getattr(s.camera, name)}" for name in ("fx", "fy", "cx", "cy")]
    put(folder / "calib.yaml", "\n".join(lines) + "\n")


def rgbd_euroc(folder, s):
    c, rows = (
        s.camera,
        [
            "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
        ],
    )
    for i, pose in enumerate(s.poses):
        name = str(round(s.times[i] * 1e9))
        put(folder / "cam0" / "data" / f"{name}.png", png(s.color[i]))
        put(folder / "depth0" / "data" / f"{name}.png", png(s.depth_mm[i]))
        x, y, z, w = quaternion(pose)
        rows.append(",".join([name, *(f"{v:.9f}" for v in (*pose[:3, 3], w, x, y, z))]))
    put(folder / "state_groundtruth_estimate0" / "data.csv", "\n".join(rows) + "\n")
    put(folder / "cam0" / "sensor.yaml",
        f"sensor_type: camera\nrate_hz: 20\nresolution: [{WIDTH}, {HEIGHT}]\ncamera_model: pinhole\n"
        f"intrinsics: [{c.fx}, {c.fy}, {c.cx}, {c.cy}] #fu, fv, cu, cv\n"
        "distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n")  # fmt: skip


def rgbd_scenes(folder, s):
    rows = []
    for i, pose in enumerate(s.poses):
        put(folder / f"{i:05d}-color.png", png(s.color[i]))
        put(folder / f"{i:05d}-depth.png", png(s.depth_mm[i]))
        x, y, z, w = quaternion(pose)
        rows.append(line([w, x, y, z, *pose[:3, 3]]))
    put(folder / "01.pose", "\n".join(rows) + "\n")


def shibuya(folder, s):
    for side in (0, 1):
        for i, name in enumerate(ids(N)):
            put(folder / f"image_{side}" / f"{name}.png", png(s.color[i]))
            npy(folder, f"depth_{side}/{name}.npy", s.depth_mm[i].astype(np.float32) / 1000)
            put(
                folder / f"rcnnseg_image_{side}" / f"{name}.png",
                png(s.depth_mm[i].astype(np.uint8)),
            )
    put(
        folder / "gt_pose.txt",
        "\n".join(line(xyz_quaternion(p)) for p in s.poses @ AIRSIM) + "\n",
    )
    put(folder / "times.txt", "\n".join(f"{0.1 * i:.6f}" for i in range(N)) + "\n")


def bop(folder, s):
    cameras = {}
    for i, name in enumerate(ids(N)):
        put(folder / "rgb" / f"{name}.png", png(s.color[i]))
        put(folder / "depth" / f"{name}.png", png(s.depth_mm[i]))
        put(folder / "mask_visib" / f"{name}_000000.png", png(np.zeros((HEIGHT, WIDTH), np.uint8)))
        inverse = np.linalg.inv(s.poses[i])
        cameras[str(i)] = {"cam_K": k_of(s.camera).ravel().tolist(), "depth_scale": 1.0,
                           "cam_R_w2c": inverse[:3, :3].ravel().tolist(),
                           "cam_t_w2c": (inverse[:3, 3] * 1000).tolist()}  # fmt: skip
    put(folder / "scene_camera.json", json.dumps(cameras))


def open_scene(folder, s):
    for i in range(N):
        put(folder / "color" / f"{20 * i}.jpg", jpg(s.color[i]))
        put(folder / "depth" / f"{20 * i}.png", png(s.depth_mm[i]))
        put(folder / "pose" / f"{20 * i}.txt", matrix_text(s.poses[i]))


def choi(folder, s):
    log = ""
    for i, pose in enumerate(s.poses):
        put(folder / "livingroom1-color" / f"{i:05d}.jpg", jpg(s.color[i]))
        put(folder / "livingroom1-depth-clean" / f"{i:05d}.png", png(s.depth_mm[i]))
        log += f"{i} {i} {i + 1}\n{matrix_text(pose)}"
    put(folder / "livingroom1-traj.txt", log)


def kalibr(folder, s):
    c, rows = s.camera, ["timestamp,tx,ty,tz,qx,qy,qz,qw"]
    for i, pose in enumerate(s.poses):
        put(folder / "rgb" / f"{s.times[i]:.6f}.png", png(s.color[i]))
        put(folder / "depth" / f"{s.times[i] + 0.004:.6f}.png", png(s.depth_mm[i]))
        rows.append(",".join([f"{s.times[i]:.6f}", *(f"{v:.9f}" for v in xyz_quaternion(pose))]))
    put(folder / "trajectory.csv", "\n".join(rows) + "\n")
    put(folder / "camchain.yaml",
        f"cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n"
        f"  distortion_model: radtan\n  intrinsics: [{c.fx}, {c.fy}, {c.cx}, {c.cy}]\n"
        f"  resolution: [{WIDTH}, {HEIGHT}]\n  rostopic: /camera/color/image_raw\n")  # fmt: skip


def deep_voxels(folder, s):
    for i, name in enumerate(ids(N)):
        put(folder / "rgb" / f"{name}.png", png(s.color[i]))
        put(folder / "depth" / f"{name}.png", png(s.depth_mm[i]))
        put(folder / "pose" / f"{name}.txt", line(s.poses[i].ravel()) + "\n")
    c = s.camera
    put(folder / "intrinsics.txt", f"{c.fx} {c.cx} {c.cy} 0.\n0. 0. 0.\n1.\n{HEIGHT} {WIDTH}\n")


def point_odyssey(folder, s):
    for i in range(N):
        put(folder / "rgbs" / f"rgb_{i:05d}.jpg", jpg(s.color[i]))
        put(folder / "depths" / f"depth_{i:05d}.png", png(s.depth_mm[i]))
        put(folder / "masks" / f"mask_{i:05d}.png", png(np.zeros((HEIGHT, WIDTH), np.uint8)))
    np.savez(
        folder / "anno.npz", extrinsics=np.linalg.inv(s.poses), intrinsics=[k_of(s.camera)] * N
    )


def nyu_raw(folder, s):
    for i, time in enumerate(s.times):
        put(
            folder / f"r-{time:.6f}-{3143255701 + i}.ppm",
            cv2.imencode(".ppm", s.color[i])[1].tobytes(),
        )
        put(
            folder / f"d-{time:.6f}-{3143255703 + i}.pgm",
            cv2.imencode(".pgm", s.depth_mm[i])[1].tobytes(),
        )
        put(folder / f"a-{time:.6f}-{3143255705 + i}.dump", bytes(16))


def matterport(folder, s):
    lines = ["dataset matterport", f"n_images {N}", "depth_directory undistorted_depth_images"]
    lines.append("intrinsics_matrix " + line(k_of(s.camera).ravel()))
    for i in range(N):
        name = hashlib.md5(bytes([i])).hexdigest()
        put(folder / "undistorted_color_images" / f"{name}_i0_{i}.jpg", jpg(s.color[i]))
        put(folder / "undistorted_depth_images" / f"{name}_d0_{i}.png", png(s.depth_mm[i] * 4))
        lines.append(f"scan {name}_d0_{i}.png {name}_i0_{i}.jpg {line((s.poses[i] @ GL).ravel())}")
    put(folder / "undistorted_camera_parameters" / "house.conf", "\n".join(lines) + "\n")


def posed_topics(folder, s):
    for i in range(N):
        put(folder / "rgb" / f"{i}.jpg", jpg(s.color[i]))
        put(folder / "depth" / f"{i}.png", png(s.depth_mm[i]))
        put(folder / "camera_pose" / f"{i}.txt", matrix_text(s.poses[i]))
        put(folder / "intrinsics" / f"{i}.txt", matrix_text(k_of(s.camera)))


OPENGL = {"poses": lambda s: s.poses @ GL}
LENS = {"advised": "give it with --intrinsics FILE", "options": {"intrinsics": True}}
BUILT_WITH = {
    "TartanAir": Row(
        "github.com/castacks/tartanair_tools data_type.md",
        tartanair,
        poses=lambda s: s.poses @ AIRSIM,
        **LENS,
    ),
    "TartanAir, both cameras": Row(
        "github.com/castacks/tartanair_tools data_type.md",
        lambda folder, s: tartanair(folder, s, ("left", "right")),
        advised="--color-topic",
        options={"color_topic": "image_left", "depth_topic": "depth_left", "intrinsics": True},
        poses=lambda s: s.poses @ AIRSIM,
    ),
    "Neural RGB-D": Row(
        "github.com/dazinovic/neural-rgbd-surface-reconstruction load_scannet.py",
        neural_rgbd, **OPENGL, **LENS,
    ),
    "SUN3D": Row("SUN3D toolbox, loadSUN3D.m: units of 1/8 mm, which the motion asks for", sun3d,
                 options={"depth_scale": 1.25e-4}),
    "BundleSDF": Row(
        "github.com/NVlabs/BundleSDF readme", bundle_sdf,
        poses=lambda s: np.linalg.inv(s.poses), is_written_back=True,
    ),
    "ConceptGraphs of Record3D": Row(
        "github.com/concept-graphs/concept-graphs preprocess_record3d.py", record3d_dataset
    ),
    "VLMaps": Row("github.com/vlmaps/vlmaps dataset of Habitat", vlmaps, **LENS),
    "Co-Fusion": Row(
        "github.com/martinruenz/co-fusion data set, depth as TIFF", co_fusion,
        tolerance_m=1e-5,
    ),
    "RealSense, one folder": Row("librealsense rs2_intrinsics as pyrealsense2 scripts save it",
                                 realsense_in_one_folder, is_written_back=True),
    "MuSHRoom": Row("github.com/TUTvision/MuSHRoom transformations.json", mushroom, **OPENGL),
    "poses as JSON": Row("realsense-ros aligned_depth_to_color; Open3D's intrinsic.json", poses_as_json),
    "ZED": Row("stereolabs zed-sdk export of image sequences, Pose as csv", zed),
}  # fmt: skip
HELD_OUT = {
    "EuRoC with depth": Row("ASL data set format (EuRoC MAV), depth0 as InteriorNet has it", rgbd_euroc),
    "RGB-D Scenes v2": Row(
        "rgbd-dataset.cs.washington.edu, quaternions with w first, before the place", rgbd_scenes,
        advised="name the columns in a first line, such as qw,qx,qy,qz,x,y,z",
        mend=lambda folder: put(folder / "01.pose", "qw qx qy qz x y z\n" + (folder / "01.pose").read_text()),
        options={"intrinsics": True},
    ),
    "TartanAir-Shibuya": Row(
        "github.com/haleqiu/tartanair-shibuya README", shibuya,
        advised="--color-topic",
        options={"color_topic": "image_0", "depth_topic": "depth_0", "intrinsics": True},
        poses=lambda s: s.poses @ AIRSIM,
    ),
    "BOP": Row("github.com/thodan/bop_toolkit docs/bop_datasets_format.md", bop,
               refused="trajectory.log is missing"),
    "OpenScene of ScanNet": Row("github.com/pengsongyou/openscene scripts/preprocess", open_scene,
                                is_written_back=True, **LENS),
    "Augmented ICL-NUIM": Row("redwood-data.org/indoor", choi, **LENS),
    "Kalibr": Row("github.com/ethz-asl/kalibr wiki yaml-formats", kalibr),
    "DeepVoxels": Row("github.com/vsitzmann/deepvoxels README", deep_voxels, is_written_back=True, **LENS),
    "PointOdyssey": Row("pointodyssey.com, anno.npz", point_odyssey,
                        refused="expected poses of the frames, found none; or give --poses FILE"),
    "NYU raw": Row("NYU Depth V2 raw", nyu_raw, refused="expected a scan, found none"),
    "Matterport3D": Row("github.com/niessner/Matterport data_organization.md", matterport,
                        refused="expected a scan, found none"),
    "poses and lenses by frame": Row("RGBD loader of concept-graphs' kin: a file a frame each", posed_topics,
                                     is_written_back=True),
}  # fmt: skip
ROWS = {**BUILT_WITH, **HELD_OUT}


def opened(row: Row, folder: Path, sample: Sample, tmp_path: Path):
    """The scan, by what the message asks for where it does."""
    options = dict(row.options)
    if row.advised:
        with pytest.raises(ScanError) as caught:
            read_scan(folder)
        assert row.advised in str(caught.value)
    if row.mend:
        row.mend(folder)
    if "intrinsics" in options:
        put(tmp_path / "lens.txt", fx_line(sample))
        options["intrinsics"] = str(tmp_path / "lens.txt")
    return read_scan(folder, options=ScanOptions(**options))


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if not row.refused])
def test_poses_depth_and_lens_are_those_that_were_written(name, sample, tmp_path):
    row, folder = ROWS[name], tmp_path / "scan"
    row.write(folder, sample)
    scan = opened(row, folder, sample, tmp_path)
    assert (scan.format, len(scan), scan.skipped) == ("any-folder", N, ())
    assert_allclose(scan.world_from_cams, row.poses(sample), atol=2e-6)
    c = sample.camera
    for i in range(N):
        k = scan.cameras[i]
        assert_allclose((k.fx, k.fy, k.cx, k.cy), (c.fx, c.fy, c.cx, c.cy), atol=1e-5)
        error = [
            np.abs(scan.files.color(i).astype(int) - one.astype(int)).mean() for one in sample.color
        ]
        assert np.argmin(error) == i
        assert error[i] < 6
        depth, truth = scan.files.depth(i), sample.depth_mm[i] / 1000
        assert_allclose(depth, np.where(truth > 0, truth, np.nan), atol=row.tolerance_m)


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if row.refused])
def test_what_cannot_be_read_is_refused(name, sample, tmp_path):
    ROWS[name].write(tmp_path / "scan", sample)
    with pytest.raises(ScanError) as caught:
        read_scan(tmp_path / "scan")
    message = str(caught.value)
    assert "\n" not in message
    assert ROWS[name].refused in message


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if not row.refused])
def test_refined_poses_go_back(name, sample, tmp_path):
    row, folder, out = ROWS[name], tmp_path / "scan", tmp_path / "out"
    row.write(folder, sample)
    out.mkdir()
    scan = opened(row, folder, sample, tmp_path)
    moved = scan.world_from_cams.copy()
    moved[:, :3, 3] += 0.5
    scan.files.write_poses(out, moved)
    written = {path.name: path for path in out.iterdir()}
    if not row.is_written_back:
        rows = np.loadtxt(written.pop("trajectory.tum"))
        assert_allclose(rows[:, 1:4], moved[:, :3, 3], atol=1e-8)
        assert_allclose(
            np.abs(np.sum(rows[:, 4:] * Rotation.from_matrix(moved[:, :3, :3]).as_quat(), axis=1)),
            1,
        )
        assert not written
        return
    for name, path in written.items():
        next(folder.rglob(name)).write_text(path.read_text())
    assert len(written) == N
    assert_allclose(opened(row, folder, sample, tmp_path).world_from_cams, moved, atol=1e-8)


def refusal(path, **options):
    with pytest.raises(ScanError) as caught:
        read_scan(path, options=ScanOptions(**options))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_names_that_count_from_other_numbers_are_paired_in_order_and_that_is_said(sample, tmp_path):
    posed_topics(tmp_path, sample)
    for folder in ("depth", "camera_pose"):
        for i in reversed(range(N)):
            path = next((tmp_path / folder).glob(f"{i}.*"))
            path.rename(path.with_stem(str(i + 1)))
    scan = read_scan(tmp_path)
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    assert_allclose(np.nan_to_num(scan.files.depth(2)), sample.depth_mm[2] / 1000, atol=6e-4)
    assert len([line for line in scan.warnings if "in order" in line]) == 2


def test_frames_that_lack_an_image_or_a_pose_are_told(sample, tmp_path):
    posed_topics(tmp_path, sample)
    (tmp_path / "depth" / "1.png").unlink()
    (tmp_path / "camera_pose" / "3.txt").unlink()
    scan = read_scan(tmp_path)
    assert scan.frame_ids == ("0", "1", "2", "4", "5")
    assert scan.lacking == ("", "depth", "", "", "")
    assert scan.skipped == ("frame 3: the tracker had no pose",)


def test_a_lens_of_depth_or_of_another_size_is_not_taken(sample, tmp_path):
    poses_as_json(tmp_path, sample)
    lens = json.loads((tmp_path / "intrinsic.json").read_text())
    (tmp_path / "intrinsic.json").rename(tmp_path / "depth_intrinsic.json")
    assert "found none; give it with --intrinsics FILE" in refusal(tmp_path)
    half = {"intrinsic_matrix": [v / 2 for v in lens["intrinsic_matrix"]]}
    put(tmp_path / "intrinsic.json", json.dumps(half))
    assert "as of another size; give it with --intrinsics FILE" in refusal(tmp_path)
    put(tmp_path / "intrinsic.json", json.dumps(lens | {"width": 2 * WIDTH, "height": 2 * HEIGHT}))
    assert "as of another size; give it with --intrinsics FILE" in refusal(tmp_path)


def test_distortion_of_a_lens_is_undone(sample, tmp_path):
    realsense_in_one_folder(tmp_path, sample)
    path = tmp_path / "intrinsics.json"
    plain = read_scan(tmp_path).files.color(0)
    path.write_text(path.read_text().replace("[0.0, 0.0", "[0.1, 0.0"))
    assert (read_scan(tmp_path).files.color(0) != plain).any()
    path.write_text(path.read_text().replace("brown_conrady", "inverse_brown_conrady"))
    assert "expected distortion as OpenCV has it" in refusal(tmp_path)


@pytest.mark.parametrize(("stated", "unit"), [("5000.0", 2e-4), ("0.001", 1e-3), ("1.0", None)])
def test_a_unit_of_depth_that_the_file_of_the_lens_states(stated, unit, sample, tmp_path):
    record3d_dataset(tmp_path, sample)
    path = tmp_path / "dataconfig.yaml"
    path.write_text(path.read_text().replace("1000.0", stated))
    scan = read_scan(tmp_path)
    known = sample.depth_mm[0] > 0
    assert_allclose(
        scan.files.depth(0)[known], sample.depth_mm[0][known] * (unit or 1e-3), rtol=1e-5
    )
    assert (scan.depth_read_in_m is None) == (unit is not None)


def test_poses_of_a_tracker_where_there_are_none(sample, tmp_path):
    poses_as_json(tmp_path / "scan", sample)
    (tmp_path / "scan" / "camera_poses.json").rename(tmp_path / "poses.json")
    put(tmp_path / "kitti.txt", "".join(line(p[:3].ravel()) + "\n" for p in sample.poses))
    scan = read_scan(tmp_path / "scan", options=ScanOptions(poses=tmp_path / "kitti.txt"))
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)


def test_an_archive_reads_like_the_folder(sample, tmp_path):
    poses_as_json(tmp_path / "scan", sample)
    shutil.make_archive(str(tmp_path / "scan"), "zip", tmp_path / "scan")
    folder, archive = read_scan(tmp_path / "scan"), read_scan(tmp_path / "scan.zip")
    assert archive.format == folder.format == "any-folder"
    assert_allclose(archive.world_from_cams, folder.world_from_cams)


def test_a_copy_of_a_known_format_that_lacks_a_file_is_refused_by_its_name(sample, tmp_path):
    """Also where all that any folder needs is there."""
    write_tum(tmp_path, sample)
    (tmp_path / "depth.txt").unlink()
    assert "one of the format tum, of which depth.txt is missing" in refusal(tmp_path)
    forced = read_scan(tmp_path, options=ScanOptions(format="any-folder"))
    assert_allclose(forced.world_from_cams, sample.poses, atol=2e-6)
