"""Nodes of an E57 file: fields of points, and copies of everything but points.

`libe57` is the binding of libE57Format that pye57 brings; its own reader and writer know neither times nor
other fields than colour and intensity, and write single precision.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from planfit.geometry import se3

COORDINATES = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")


def load_libe57() -> Any:
    """The binding.

    Raises:
        ImportError: pye57 is not installed.
    """
    from pye57 import libe57  # pyright: ignore[reportAttributeAccessIssue]

    return libe57


def names_of(node: Any) -> list[str]:
    """Names of a structure's children."""
    libe57 = load_libe57()
    structure = node if isinstance(node, libe57.StructureNode) else libe57.StructureNode(node)
    return [structure.get(i).elementName() for i in range(structure.childCount())]


def number_in(node: Any, *path: str) -> float | None:
    """A number below a structure; None where it is not."""
    for name in path:
        if not node.isDefined(name):
            return None
        node = node[name]
    return float(node.value())


def text_in(node: Any, name: str) -> str:
    """A text below a structure; empty where it is not."""
    return str(node[name].value()) if node.isDefined(name) else ""


def pose_in(node: Any) -> Float[np.ndarray, "4 4"]:
    """The pose (file_from_scan, m) of a scan or an image; the identity where it has none."""
    rotation = [number_in(node, "pose", "rotation", axis) for axis in "xyzw"]
    translation = [number_in(node, "pose", "translation", axis) or 0.0 for axis in "xyz"]
    quaternion = [0.0, 0.0, 0.0, 1.0] if None in rotation else [float(v or 0.0) for v in rotation]
    return se3.make_transform(Rotation.from_quat(quaternion).as_matrix(), np.array(translation))


def put_pose(node: Any, target_file: Any, pose: Float[np.ndarray, "4 4"]) -> None:
    """Give a pose (file_from_scan, m) to a structure that has none."""
    libe57 = load_libe57()
    made = libe57.StructureNode(target_file)
    node.set("pose", made)
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    told = {
        "rotation": {"w": w, "x": x, "y": y, "z": z},
        "translation": dict(zip("xyz", pose[:3, 3], strict=True)),
    }
    for name, values in told.items():
        part = libe57.StructureNode(target_file)
        made.set(name, part)
        for axis, value in values.items():
            part.set(axis, libe57.FloatNode(target_file, float(value)))


def make_buffers(
    image_file: Any, prototype: Any, names: list[str], capacity: int
) -> tuple[dict[str, np.ndarray], Any]:
    """Arrays for fields of points, and the library's handles on them.

    Whole numbers as such, everything else (scaled whole numbers, too) in double precision.
    """
    libe57 = load_libe57()
    arrays, buffers = {}, libe57.VectorSourceDestBuffer()
    for name in names:
        is_whole = isinstance(prototype[name], libe57.IntegerNode)
        arrays[name] = np.zeros(capacity, dtype=np.int64 if is_whole else np.float64)
        buffers.append(
            libe57.SourceDestBuffer(image_file, name, arrays[name], capacity, True, True)
        )
    return arrays, buffers


def copy_children(source: Any, target: Any, target_file: Any, without: tuple[str, ...]) -> None:
    """Copy all children of a structure but those named; points and groups of points are left out."""
    for name in names_of(source):
        if name not in without:
            _copy(source[name], partial(target.set, name), target_file)


def _copy(node: Any, attach: Callable[[Any], Any], target_file: Any) -> None:
    """Copy a node with all below it; `attach` gives the copy its place."""
    libe57 = load_libe57()
    if isinstance(node, libe57.CompressedVectorNode):
        return
    if isinstance(node, libe57.StructureNode):
        made = libe57.StructureNode(target_file)
        attach(made)
        copy_children(node, made, target_file, ())
    elif isinstance(node, libe57.VectorNode):
        made = libe57.VectorNode(target_file, node.allowHeteroChildren())
        attach(made)
        for i in range(node.childCount()):
            _copy(node[i], made.append, target_file)
    elif isinstance(node, libe57.BlobNode):
        made = libe57.BlobNode(target_file, node.byteCount())
        attach(made)
        data = np.zeros(node.byteCount(), dtype=np.uint8)
        node.read(data, 0, len(data))
        made.write(data, 0, len(data))
    else:
        attach(copy_number(node, target_file))


def copy_number(node: Any, target_file: Any, bounds: tuple[float, float] | None = None) -> Any:
    """A copy of a number or text with its limits, or with other `bounds` of its value."""
    libe57 = load_libe57()
    if isinstance(node, libe57.StringNode):
        return libe57.StringNode(target_file, node.value())
    if isinstance(node, libe57.IntegerNode):
        return libe57.IntegerNode(target_file, node.value(), node.minimum(), node.maximum())
    if isinstance(node, libe57.ScaledIntegerNode):
        scale, offset = node.scale(), node.offset()
        raw, low, high = node.rawValue(), node.minimum(), node.maximum()
        if bounds is not None:
            low, high = (round((bound - offset) / scale) for bound in bounds)
            raw, low, high = low, low - 1, high + 1
        return libe57.ScaledIntegerNode(target_file, raw, low, high, scale, offset)
    value, low, high = node.value(), node.minimum(), node.maximum()
    if bounds is not None:
        value, low, high = bounds[0], *bounds
        if node.precision() == libe57.E57_SINGLE:  # limits are checked in single precision
            low, high = (
                float(np.nextafter(np.float32(b), s)) for b, s in ((low, -np.inf), (high, np.inf))
            )
            value = low
    return libe57.FloatNode(target_file, value, node.precision(), low, high)


def to_cartesian(arrays: Mapping[str, np.ndarray], n: int) -> Float[np.ndarray, "n 3"]:
    """The first n points (m), of whichever coordinates a scan has."""
    if COORDINATES[0] in arrays:
        return np.stack([arrays[name][:n] for name in COORDINATES], axis=1)
    reach, azimuth, elevation = (arrays[name][:n] for name in SPHERICAL)
    across = reach * np.cos(elevation)
    return np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), reach * np.sin(elevation)], axis=1
    )


def from_cartesian(
    points: Float[np.ndarray, "n 3"], is_spherical: bool
) -> dict[str, Float[np.ndarray, " n"]]:
    """Points (m) as the coordinates that a scan has."""
    if not is_spherical:
        return dict(zip(COORDINATES, points.T, strict=True))
    reach = np.linalg.norm(points, axis=1)
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    elevation = np.arcsin(np.clip(points[:, 2] / np.maximum(reach, 1e-12), -1.0, 1.0))
    return dict(zip(SPHERICAL, (reach, azimuth, elevation), strict=True))
