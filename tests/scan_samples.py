"""Small scans in every format, written as the format's own documentation says, without planfit's writers."""

import io
import json
import struct
import zipfile
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from planfit.geometry.camera import Camera
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
)

N, WIDTH, HEIGHT = 6, 128, 96
GL = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL camera axes: y up, z backward
T0 = 1305031102.175304


@dataclass(frozen=True)
class Sample:
    """What a reader must give back; depth in whole millimetres, 0 without measurement."""

    color: list
    depth_mm: list
    poses: np.ndarray
    camera: Camera
    times: np.ndarray

    @property
    def small_mm(self):
        """Depth of a sensor with half the pixels each way."""
        return [d[::2, ::2] for d in self.depth_mm]


def make_sample():
    synthetic = make_scan(
        SynthOptions(
            seed=5,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=N),
            camera=CameraOptions(width_px=WIDTH, height_px=HEIGHT),
            drift=DriftOptions(yaw_deg=0.0, translation_m=0.0),
        )
    )
    files = synthetic.scan.files
    depths = [np.rint(np.nan_to_num(files.depth(i)) * 1000).astype(np.uint16) for i in range(N)]
    centred = synthetic.scan.cameras[0]
    camera = Camera(
        WIDTH, HEIGHT, centred.fx, centred.fy * 1.01, centred.cx + 1.25, centred.cy - 0.75
    )
    return Sample(
        [files.color(i) for i in range(N)],
        depths,
        synthetic.true_world_from_cams,
        camera,
        T0 + np.arange(N) / 30,
    )


def png(image):
    if image.ndim == 3:
        image = image[..., ::-1]
    return cv2.imencode(".png", image)[1].tobytes()


def jpg(image):
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


def put(path, data):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())


def matrix_text(matrix):
    return "\n".join(" ".join(f"{v:.9f}" for v in row) for row in matrix) + "\n"


def k_of(camera):
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])


def quaternion(pose):
    return Rotation.from_matrix(pose[:3, :3]).as_quat()


def write_tum(folder, s):
    rgb, depth, truth = (
        ["# color images", "# timestamp filename"],
        ["# depth maps"],
        ["# ground truth"],
    )
    for i, time in enumerate(s.times):
        put(folder / "rgb" / f"{time:.6f}.png", png(s.color[i]))
        put(
            folder / "depth" / f"{time + 0.004:.6f}.png", png((s.depth_mm[i] * 5).astype(np.uint16))
        )
        rgb.append(f"{time:.6f} rgb/{time:.6f}.png")
        depth.append(f"{time + 0.004:.6f} depth/{time + 0.004:.6f}.png")
        numbers = " ".join(f"{v:.9f}" for v in (*s.poses[i][:3, 3], *quaternion(s.poses[i])))
        truth.append(f"{time:.6f} {numbers}")
    for name, lines in (("rgb.txt", rgb), ("depth.txt", depth), ("groundtruth.txt", truth)):
        put(folder / name, "\n".join(lines) + "\n")
    c = s.camera
    put(folder / "calibration.txt", f"{c.fx:.9f} {c.fy:.9f} {c.cx:.9f} {c.cy:.9f}\n")


def write_openloris(folder, s):
    """The robot's base, from which the camera is two frames away, one of them the other way round."""
    base_from_mast = np.array([[0, -1, 0, 0.3], [1, 0, 0, 0], [0, 0, 1, 1.0], [0, 0, 0, 1.0]])
    cam_from_mast = np.array([[0, -1, 0, 0.02], [0, 0, -1, 0], [1, 0, 0, 0.1], [0, 0, 0, 1.0]])
    base_from_cam = base_from_mast @ np.linalg.inv(cam_from_mast)
    lists = {"color": [], "aligned_depth": [], "groundtruth": []}
    for i, time in enumerate(s.times):
        for name, image in (("color", s.color[i]), ("aligned_depth", s.depth_mm[i])):
            put(folder / name / f"{time:.6f}.png", png(image))
            lists[name].append(f"{time:.6f} {name}/{time:.6f}.png")
        pose = s.poses[i] @ np.linalg.inv(base_from_cam)
        numbers = " ".join(f"{v:.9f}" for v in (*pose[:3, 3], *quaternion(pose)))
        lists["groundtruth"].append(f"{time:.6f} {numbers}")
    for name, lines in lists.items():
        put(folder / f"{name}.txt", "#Time\n" + "\n".join(lines) + "\n")

    def matrix(rows, cols, values):
        data = ", ".join(map(repr, values))
        lines = (f"rows: {rows}", f"cols: {cols}", "dt: d", f"data: [ {data} ]")
        return "!!opencv-matrix\n" + "".join(f"         {line}\n" for line in lines)

    c = s.camera
    lens, distortion = matrix(1, 4, [c.fx, c.cx, c.fy, c.cy]), matrix(1, 5, [0.0] * 5)
    put(folder / "sensors.yaml",
        f"%YAML:1.0\n---\nd400_color_optical_frame:\n   width: {WIDTH}\n   height: {HEIGHT}\n"
        f"   intrinsics: {lens}   distortion_coefficients: {distortion}")  # fmt: skip
    entries = [
        ("base_link", "mast", base_from_mast),
        ("d400_color_optical_frame", "mast", cam_from_mast),
    ]
    rows = "".join(
        f"   -\n      parent_frame: {p}\n      child_frame: {c}\n"
        f"      matrix: {matrix(4, 4, m.ravel().tolist())}"
        for p, c, m in entries
    )
    put(folder / "trans_matrix.yaml", f"%YAML:1.0\n---\ntrans_matrix:\n{rows}")


def write_redwood(folder, s):
    log = []
    for i, pose in enumerate(s.poses):
        put(folder / "color" / f"{i:05d}.png", png(s.color[i]))
        put(folder / "depth" / f"{i:05d}.png", png(s.depth_mm[i]))
        log.append(f"{i} {i} {i + 1}\n{matrix_text(pose)}")
    put(folder / "trajectory.log", "".join(log))
    matrix = k_of(s.camera).ravel(order="F").tolist()
    put(folder / "camera_intrinsic.json",
        json.dumps({"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": matrix}))  # fmt: skip


def write_seven_scenes(folder, s):
    for i, pose in enumerate(s.poses):
        put(folder / f"frame-{i:06d}.color.png", png(s.color[i]))
        put(folder / f"frame-{i:06d}.depth.png", png(s.depth_mm[i]))
        put(folder / f"frame-{i:06d}.pose.txt", matrix_text(pose))
    put(folder / "camera-intrinsics.txt", matrix_text(k_of(s.camera)))


def write_bundlefusion(folder, s):
    """As 3RScan: depth of half the size as PGM, with intrinsics of its own."""
    small = s.camera.scaled(WIDTH // 2, HEIGHT // 2)
    lines = ["m_versionNumber = 4", "m_depthShift = 1000.000000"]
    for name, camera in (("Color", s.camera), ("Depth", small)):
        matrix = np.eye(4)
        matrix[:3, :3] = k_of(camera)
        numbers, mount = (" ".join(f"{v:.9g}" for v in m.ravel()) for m in (matrix, np.eye(4)))
        lines += [
            f"m_calibration{name}Intrinsic = {numbers} ",
            f"m_calibration{name}Extrinsic = {mount} ",
        ]
    put(folder / "_info.txt", "\n".join(lines) + "\n")
    for i, pose in enumerate(s.poses):
        put(folder / f"frame-{i:06d}.color.jpg", jpg(s.color[i]))
        put(folder / f"frame-{i:06d}.depth.pgm", cv2.imencode(".pgm", s.small_mm[i])[1].tobytes())
        put(folder / f"frame-{i:06d}.pose.txt", matrix_text(pose))


def write_scannet(folder, s):
    """Depth of half the size, with intrinsics of its own."""
    small = s.camera.scaled(WIDTH // 2, HEIGHT // 2)
    for name, camera in (("color", s.camera), ("depth", small)):
        matrix = np.eye(4)
        matrix[:3, :3] = k_of(camera)
        put(folder / "intrinsic" / f"intrinsic_{name}.txt", matrix_text(matrix))
        put(folder / "intrinsic" / f"extrinsic_{name}.txt", matrix_text(np.eye(4)))
    for i, pose in enumerate(s.poses):
        put(folder / "color" / f"{i}.jpg", jpg(s.color[i]))
        put(folder / "depth" / f"{i}.png", png(s.small_mm[i]))
        put(folder / "pose" / f"{i}.txt", matrix_text(pose))


def write_replica(folder, s):
    for i in range(N):
        put(folder / "results" / f"frame{i:06d}.jpg", jpg(s.color[i]))
        units = np.rint(s.depth_mm[i].astype(float) * 6.5535).astype(np.uint16)
        put(folder / "results" / f"depth{i:06d}.png", png(units))
    rows = [" ".join(f"{v:.18e}" for v in pose.ravel()) for pose in s.poses]
    put(folder / "traj.txt", "\n".join(rows) + "\n")
    c = s.camera
    camera = {
        "w": WIDTH,
        "h": HEIGHT,
        "fx": c.fx,
        "fy": c.fy,
        "cx": c.cx,
        "cy": c.cy,
        "scale": 6553.5,
    }
    put(folder.parent / "cam_params.json", json.dumps({"camera": camera}))


def write_nerfstudio(folder, s):
    c = s.camera
    frames = []
    for i, pose in enumerate(s.poses):
        put(folder / "images" / f"frame_{i + 1:05d}.png", png(s.color[i]))
        put(folder / "depth" / f"frame_{i + 1:05d}.png", png(s.depth_mm[i]))
        frames.append(
            {
                "file_path": f"images/frame_{i + 1:05d}.png",
                "depth_file_path": f"depth/frame_{i + 1:05d}.png",
                "transform_matrix": (pose @ GL).tolist(),
            }
        )
    put(
        folder / "transforms.json",
        json.dumps(
            {
                "camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, "fl_x": c.fx, "fl_y": c.fy,
                "cx": c.cx + 0.5, "cy": c.cy + 0.5, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0,
                "frames": frames,
            }
        ),
    )  # fmt: skip


def write_rtabmap_export(folder, s, of_camera=True):
    """As rtabmap-export writes images by node, with poses of the camera or of the robot's base."""
    base_from_cam = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0.2], [0, -1, 0, 0.5], [0, 0, 0, 1.0]])
    poses = s.poses if of_camera else s.poses @ np.linalg.inv(base_from_cam)
    lines = ["#timestamp x y z qx qy qz qw id"]
    for i, pose in enumerate(poses):
        put(folder / "walk_rgb" / f"{3 * i + 1}.jpg", jpg(s.color[i]))
        put(folder / "walk_depth" / f"{3 * i + 1}.png", png(s.depth_mm[i]))
        matrix, mount = (
            ", ".join(map(repr, m.ravel().tolist())) for m in (k_of(s.camera), base_from_cam[:3])
        )
        put(folder / "walk_calib" / f"{3 * i + 1}.yaml",
            f'%YAML:1.0\n---\ncamera_name: "{3 * i + 1}"\nimage_width: {WIDTH}\nimage_height: {HEIGHT}\n'
            f"camera_matrix:\n   rows: 3\n   cols: 3\n   data: [ {matrix} ]\n"
            f"local_transform:\n   rows: 3\n   cols: 4\n   data: [ {mount} ]\n")  # fmt: skip
        numbers = " ".join(f"{v:.9f}" for v in (*pose[:3, 3], *quaternion(pose)))
        lines.append(f"{s.times[i]:.6f} {numbers} {3 * i + 1}")
    name = "walk_camera_poses.txt" if of_camera else "walk_poses.txt"
    put(folder / name, "\n".join(lines) + "\n")


def write_video(path, images, fps=30, gop=3, first=0):
    """Frames at the times first, first + 1, ...; an edit list hides those before 0."""
    import av

    unchanged = {"avoid_negative_ts": "disabled"}
    with av.open(str(path), "w", options=unchanged) as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.width, stream.height, stream.pix_fmt = (
            images[0].shape[1],
            images[0].shape[0],
            "yuv420p",
        )
        stream.options = {"crf": "8", "g": str(gop), "bf": "2" if first == 0 else "0"}
        for i in range(len(images) + 1):
            image = (
                av.VideoFrame.from_ndarray(images[i], format="rgb24") if i < len(images) else None
            )
            for packet in stream.encode(image):
                step = int(first / (fps * packet.time_base))
                packet.pts, packet.dts = packet.pts + step, packet.dts + step
                container.mux(packet)


def write_stray(folder, s):
    folder.mkdir(parents=True, exist_ok=True)
    write_video(folder / "rgb.mp4", s.color)
    matrix = "\n".join(",".join(f"{v:.9f}" for v in row) for row in k_of(s.camera))
    put(folder / "camera_matrix.csv", matrix + "\n")
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for i, pose in enumerate(s.poses):
        numbers = ", ".join(f"{v:.9f}" for v in (*pose[:3, 3], *quaternion(pose)))
        lines.append(f"{s.times[i]:.6f}, {i:06d}, {numbers}")
        put(folder / "depth" / f"{i:06d}.png", png(s.small_mm[i]))
        put(folder / "confidence" / f"{i:06d}.png", png(confidence_of(s.small_mm[i])))
    put(folder / "odometry.csv", "\n".join(lines) + "\n")


def confidence_of(depth, levels=(0, 1, 2)):
    """Low in the first rows, medium in the next, high below."""
    result = np.full(depth.shape, levels[2], dtype=np.uint8)
    result[:4], result[4:8] = levels[0], levels[1]
    return result


def lzfse_plain(data):
    """An LZFSE stream of one stored block."""
    return b"bvx-" + struct.pack("<I", len(data)) + data + b"bvx$"


def record3d_files(s):
    each = [[s.camera.fx + i, s.camera.fy + i, s.camera.cx, s.camera.cy] for i in range(N)]
    gl = s.poses @ GL
    metadata = {
        "w": WIDTH, "h": HEIGHT, "dw": WIDTH // 2, "dh": HEIGHT // 2, "fps": 30,
        "K": k_of(s.camera).ravel(order="F").tolist(), "perFrameIntrinsicCoeffs": each,
        "poses": [[*quaternion(p), *p[:3, 3]] for p in gl],
        "initPose": [0, 0, 0, 1, 0, 0, 0], "frameTimestamps": (s.times - T0).tolist(),
    }  # fmt: skip
    files = {"metadata": json.dumps(metadata).encode()}
    for i in range(N):
        metres = s.small_mm[i].astype("<f4") / np.float32(1000)
        metres[metres == 0] = np.nan
        files[f"rgbd/{i}.jpg"] = jpg(s.color[i])
        files[f"rgbd/{i}.depth"] = lzfse_plain(metres.astype("<f4").tobytes())
        files[f"rgbd/{i}.conf"] = lzfse_plain(confidence_of(metres).tobytes())
    return files


def write_zip(path, files):
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)


def write_record3d(path, s):
    write_zip(path, record3d_files(s))


def write_scanner_app(folder, s):
    for i, pose in enumerate(s.poses):
        put(folder / f"frame_{i:05d}.jpg", jpg(s.color[i]))
        put(folder / f"depth_{i:05d}.png", png(s.small_mm[i]))
        put(folder / f"conf_{i:05d}.png", png(confidence_of(s.small_mm[i])))
        content = {
            "cameraPoseARFrame": (pose @ GL).ravel().tolist(), "frame_index": i, "time": s.times[i],
            "intrinsics": k_of(s.camera).ravel().tolist(), "averageVelocity": 0.1,
        }  # fmt: skip
        put(folder / f"frame_{i:05d}.json", json.dumps(content))
    put(folder / "info.json", json.dumps({"device": "iPhone", "title": "test"}))


def write_polycam(folder, s):
    c = s.camera
    for i, pose in enumerate(s.poses):
        name = f"{262195552056 + 33333 * i}"
        keyframes = folder / "keyframes"
        put(keyframes / "images" / f"{name}.jpg", jpg(s.color[i]))
        put(keyframes / "depth" / f"{name}.png", png(s.small_mm[i]))
        put(keyframes / "confidence" / f"{name}.png",
            png(confidence_of(s.small_mm[i], (0, 127, 255))))  # fmt: skip
        gl = pose @ GL
        content = {f"t_{r}{k}": gl[r, k] for r in range(3) for k in range(4)}
        content |= {
            "fx": c.fx,
            "fy": c.fy,
            "cx": c.cx,
            "cy": c.cy,
            "width": WIDTH,
            "height": HEIGHT,
        }
        content |= {"timestamp": int(name), "blur_score": 100.0, "neighbors": []}
        put(keyframes / "cameras" / f"{name}.json", json.dumps(content))
    put(folder / "mesh_info.json", "{}")


def write_colmap(folder, s, binary=False):
    c = s.camera
    parameters = (c.fx, c.fy, c.cx + 0.5, c.cy + 0.5)
    model = folder / "sparse" / "0"
    images, blob = ["# Image list"], io.BytesIO()
    blob.write(struct.pack("<Q", N))
    for i, pose in enumerate(s.poses):
        name = f"IMG_{i:04d}.png"
        put(folder / "images" / name, png(s.color[i]))
        put(folder / "depth" / f"IMG_{i:04d}.png", png(s.depth_mm[i]))
        cam_from_world = np.linalg.inv(pose)
        x, y, z, w = quaternion(cam_from_world)
        numbers = (w, x, y, z, *cam_from_world[:3, 3])
        words = " ".join(f"{v:.12f}" for v in numbers)
        images += [f"{i + 1} {words} 1 {name}", "10.5 20.5 -1 30.25 40.0 7"]
        blob.write(struct.pack("<i7di", i + 1, *numbers, 1) + name.encode() + b"\0")
        blob.write(struct.pack("<Q", 2) + struct.pack("<ddqddq", 10.5, 20.5, -1, 30.25, 40.0, 7))
    if binary:
        camera = struct.pack("<QiiQQ4d", 1, 1, 1, WIDTH, HEIGHT, *parameters)
        put(model / "cameras.bin", camera)
        put(model / "images.bin", blob.getvalue())
    else:
        words = " ".join(f"{v:.12f}" for v in parameters)
        put(model / "cameras.txt", f"# Camera list\n1 PINHOLE {WIDTH} {HEIGHT} {words}\n")
        put(model / "images.txt", "\n".join(images) + "\n")


def write_arkit_scenes(folder, s):
    lines = []
    for i, pose in enumerate(s.poses):
        name = f"41048190_{s.times[i]:.3f}"
        put(folder / "lowres_wide" / f"{name}.png", png(s.color[i]))
        put(folder / "lowres_depth" / f"{name}.png", png(s.small_mm[i]))
        put(folder / "confidence" / f"{name}.png", png(confidence_of(s.small_mm[i])))
        c = s.camera
        numbers = f"{WIDTH} {HEIGHT} {c.fx:.9f} {c.fy:.9f} {c.cx:.9f} {c.cy:.9f}"
        # As in the set, a millisecond off by name.
        other = f"41048190_{s.times[i] + 0.001 * (i % 2):.3f}"
        put(folder / "lowres_wide_intrinsics" / f"{other}.pincam", numbers)
        cam_from_world = np.linalg.inv(pose)
        turn = Rotation.from_matrix(cam_from_world[:3, :3]).as_rotvec()
        words = " ".join(f"{v:.9f}" for v in (*turn, *cam_from_world[:3, 3]))
        lines.append(f"{s.times[i]:.3f} {words}")
    put(folder / "lowres_wide.traj", "\n".join(lines) + "\n")


def write_scannetpp(folder, s):
    content = {}
    for i, pose in enumerate(s.poses):
        name = f"frame_{i:06d}"
        put(folder / "iphone" / "rgb" / f"{name}.jpg", jpg(s.color[i]))
        put(folder / "iphone" / "depth" / f"{name}.png", png(s.small_mm[i]))
        content[name] = {
            "timestamp": s.times[i], "pose": (pose @ GL).tolist(), "aligned_pose": pose.tolist(),
            "intrinsic": k_of(s.camera).tolist(), "imu": {"gyro": [0.125, 0.25, 0.375]},
        }  # fmt: skip
    put(folder / "iphone" / "pose_intrinsic_imu.json", json.dumps(content))


WRITERS = {
    "tum": write_tum,
    "redwood": write_redwood,
    "7-scenes": write_seven_scenes,
    "bundlefusion": write_bundlefusion,
    "scannet": write_scannet,
    "replica": write_replica,
    "nerfstudio": write_nerfstudio,
    "rtabmap-export": write_rtabmap_export,
    "openloris": write_openloris,
    "stray": write_stray,
    "record3d": write_record3d,
    "scanner-app": write_scanner_app,
    "polycam": write_polycam,
    "colmap": write_colmap,
    "arkit-scenes": write_arkit_scenes,
    "scannetpp": write_scannetpp,
}
HALF_DEPTH = {
    "bundlefusion",
    "scannet",
    "stray",
    "record3d",
    "scanner-app",
    "polycam",
    "arkit-scenes",
    "scannetpp",
}
LOSSY_COLOR = HALF_DEPTH | {"replica", "rtabmap-export"}
HAS_CONFIDENCE = HALF_DEPTH - {"bundlefusion", "scannet", "scannetpp"}
