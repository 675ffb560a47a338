"""Walks with a laser scanner through a room of known walls, as clouds with times and a trajectory."""

from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
from pye57 import libe57
from scipy.spatial.transform import Rotation

SITE_M = np.array([2_683_412.3, 1_247_889.7, 432.1])
LOW, HIGH = np.array([0.0, 0.0, 0.0]), np.array([9.0, 6.0, 2.7])


@dataclass(frozen=True)
class LaserWalk:
    """Points of the room's sides, in the order of their times."""

    xyz: np.ndarray
    times: np.ndarray
    pose_times: np.ndarray
    poses: np.ndarray
    """(n, 4, 4), of a body whose axes are anyone's."""


def walk_in_a_room(
    seconds: float = 6.0, per_second: int = 30_000, side_deg: float = 360.0, seed: int = 0
) -> LaserWalk:
    """A scanner walks along the room at 1 m/s, turns as it goes, and sees `side_deg` around."""
    rng = np.random.default_rng(seed)
    n = int(seconds * per_second)
    times = np.sort(rng.uniform(0.0, seconds, n))
    centre, yaw = _motion(times)
    azimuth = yaw + np.deg2rad(rng.uniform(-0.5, 0.5, n) * side_deg)
    elevation = np.arcsin(rng.uniform(-0.7, 0.7, n))
    ray = np.stack([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation),
                    np.sin(elevation)], axis=1)  # fmt: skip
    with np.errstate(divide="ignore"):
        reach = np.where(ray > 0, (HIGH - centre) / ray, (LOW - centre) / ray).min(axis=1)
    pose_times = np.arange(-0.25, seconds + 0.25, 0.02)
    poses = np.tile(np.eye(4), (len(pose_times), 1, 1))
    poses[:, :3, 3], body_yaw = _motion(pose_times)
    # The body's axes have nothing to do with up or ahead.
    mount = Rotation.from_euler("xyz", [100.0, -35.0, 10.0], degrees=True)
    poses[:, :3, :3] = (Rotation.from_euler("z", body_yaw[:, None]) * mount).as_matrix()
    return LaserWalk(centre + reach[:, None] * ray, times, pose_times, poses)


def _motion(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    centre = np.stack(
        [1.5 + times, 2.5 + 0.5 * np.sin(times), 1.4 + 0.02 * np.sin(9 * times)], axis=1
    )
    return centre, 0.3 * times


def at_site(walk: LaserWalk, offset: np.ndarray = SITE_M) -> LaserWalk:
    poses = walk.poses.copy()
    poses[:, :3, 3] += offset
    return replace(walk, xyz=walk.xyz + offset, poses=poses)


def write_las(
    path: Path,
    walk: LaserWalk,
    clock_s: float = 0.0,
    is_gps_standard: bool = False,
    scale: float = 1e-4,
    point_format: int = 7,
    per_second: float = 1.0,
) -> None:
    """With intensity, colour, returns and an extra dimension; `clock_s` is added to times, of which the file
    counts `per_second`."""
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.offsets, header.scales = np.floor(walk.xyz.mean(axis=0)), [scale] * 3
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType(int(is_gps_standard))
    header.add_extra_dim(laspy.ExtraBytesParams("range_m", type=np.float32))
    cloud = laspy.LasData(header)
    rng = np.random.default_rng(5)
    n = len(walk.xyz)
    cloud.x, cloud.y, cloud.z = walk.xyz.T
    cloud.gps_time = (walk.times + clock_s) * per_second
    cloud.intensity = rng.integers(0, 65536, n)
    cloud.return_number, cloud.number_of_returns = np.ones(n, int), np.full(n, 2)
    cloud.point_source_id = rng.integers(0, 9, n)
    cloud.range_m = rng.uniform(0, 9, n)
    if point_format in (3, 7):
        cloud.red, cloud.green, cloud.blue = rng.integers(0, 65536, (3, n))
    cloud.write(str(path))


def tum_lines(walk: LaserWalk, clock_s: float = 0.0, per_second: float = 1.0) -> list[str]:
    quaternions = Rotation.from_matrix(walk.poses[:, :3, :3]).as_quat()
    return [
        " ".join(f"{v:.9f}" for v in ((t + clock_s) * per_second, *pose[:3, 3], *q))
        for t, pose, q in zip(walk.pose_times, walk.poses, quaternions, strict=True)
    ]


def write_walk(
    folder: Path, walk: LaserWalk, suffix: str = ".las", **las: float
) -> tuple[Path, Path]:
    """The cloud and its trajectory."""
    folder.mkdir(parents=True, exist_ok=True)
    cloud, trajectory = folder / f"scan{suffix}", folder / "trajectory.txt"
    write_las(cloud, walk, **las)
    trajectory.write_text("\n".join(tum_lines(walk)) + "\n")
    return cloud, trajectory


def off_the_sides_m(points: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Distance of points (n, 3) from the nearest side of the room."""
    inside = points - offset
    return np.minimum(np.abs(inside - LOW), np.abs(inside - HIGH)).min(axis=1)


def write_e57(
    path: Path,
    walk: LaserWalk,
    starts_s: tuple[float, ...] = (0.0,),
    is_spherical: bool = False,
    is_scaled: bool = False,
) -> None:
    """A scan for each start, with a pose, in the order of times; intensity, colour, a field of an extension,
    an invalid point, an image of the last scan with a pose."""
    file = libe57.ImageFile(str(path), "w")
    file.extensionsAdd("", libe57.E57_V1_0_URI)
    file.extensionsAdd("own", "http://example.org/own")
    root = file.root()
    root.set("formatName", libe57.StringNode(file, "ASTM E57 3D Imaging Data File"))
    root.set("guid", libe57.StringNode(file, "{1}"))
    root.set("versionMajor", libe57.IntegerNode(file, 1))
    root.set("versionMinor", libe57.IntegerNode(file, 0))
    images = libe57.VectorNode(file, True)
    root.set("images2D", images)
    image = libe57.StructureNode(file)
    images.append(image)
    image.set("associatedData3DGuid", libe57.StringNode(file, "{2}"))
    _put_e57_pose(file, image, Rotation.from_euler("x", 30.0, degrees=True), walk.xyz[0])
    blob = libe57.BlobNode(file, 100)
    image.set("jpegImage", blob)
    blob.write(np.arange(100, dtype=np.uint8), 0, 100)
    scans = libe57.VectorNode(file, True)
    root.set("data3D", scans)
    borders = np.linspace(0, len(walk.times), len(starts_s) + 1).astype(int)
    for k, start in enumerate(starts_s):
        part = slice(borders[k], borders[k + 1])
        scan = libe57.StructureNode(file)
        scans.append(scan)
        _put_e57_scan(file, scan, walk.xyz[part], walk.times[part], start, is_spherical, is_scaled)
    file.close()


E57_SCAN_AT = np.array([2_683_400.0, 1_247_880.0, 430.0])


def _put_e57_pose(file, target, turn, at):
    pose = libe57.StructureNode(file)
    target.set("pose", pose)
    for kind, values in (("rotation", dict(zip("xyzw", turn.as_quat(), strict=True))),
                         ("translation", dict(zip("xyz", at, strict=True)))):  # fmt: skip
        node = libe57.StructureNode(file)
        pose.set(kind, node)
        for axis in "wxyz":
            if axis in values:
                node.set(axis, libe57.FloatNode(file, float(values[axis])))


def _put_e57_scan(file, scan, xyz, times, start_s, is_spherical, is_scaled):
    scan.set("guid", libe57.StringNode(file, "{2}"))
    scan.set("name", libe57.StringNode(file, "walk"))
    turn = Rotation.from_euler("z", 20.0, degrees=True)
    at = E57_SCAN_AT if np.abs(xyz).max() > 1e5 else np.zeros(3)
    _put_e57_pose(file, scan, turn, at)
    start = libe57.StructureNode(file)
    scan.set("acquisitionStart", start)
    start.set("dateTimeValue", libe57.FloatNode(file, start_s))
    start.set("isAtomicClockReferenced", libe57.IntegerNode(file, 0))
    own = turn.inv().apply(xyz - at)
    rng = np.random.default_rng(4)
    n = len(own)
    if is_spherical:
        reach = np.linalg.norm(own, axis=1)
        coordinates = {"sphericalRange": reach, "sphericalAzimuth": np.arctan2(own[:, 1], own[:, 0]),
                       "sphericalElevation": np.arcsin(own[:, 2] / reach)}  # fmt: skip
    else:
        coordinates = {f"cartesian{axis}": own[:, i].copy() for i, axis in enumerate("XYZ")}
    invalid = np.zeros(n, dtype=np.int64)
    invalid[::97] = 2
    fields = coordinates | {
        "sphericalInvalidState" if is_spherical else "cartesianInvalidState": invalid,
        "timeStamp": times - start_s,
        "intensity": rng.uniform(0, 1, n),
        "colorRed": rng.integers(0, 256, n),
        "rowIndex": rng.integers(0, 32, n),
        "own:quality": rng.integers(0, 5, n),
    }
    prototype = libe57.StructureNode(file)
    buffers = libe57.VectorSourceDestBuffer()
    for name, values in fields.items():
        if values.dtype == np.int64:
            node = libe57.IntegerNode(file, 0, int(values.min()), int(values.max()))
        elif is_scaled and name in coordinates:
            low, high = (round(v / 1e-4) for v in (values.min() - 1e-3, values.max() + 1e-3))
            node = libe57.ScaledIntegerNode(file, low, low, high, 1e-4, 0.0)
        else:
            node = libe57.FloatNode(file, float(values[0]), libe57.E57_DOUBLE,
                                    float(values.min()), float(values.max()))  # fmt: skip
        prototype.set(name, node)
        buffers.append(libe57.SourceDestBuffer(file, name, values, n, True, True))
    points = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    scan.set("points", points)
    writer = points.writer(buffers)
    writer.write(n)
    writer.close()
