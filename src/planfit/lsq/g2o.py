"""Pose graphs in g2o's files: `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`, `FIX`.

An edge holds a relative pose and the upper triangle of the information of (translation, rotation) of
E = measured^-1 (first_from_second). g2o's own rotation there is the vector part of E's quaternion, half the
angle for small ones (`half_angles`); GTSAM reads and writes the same files as if it were the rotation vector.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from planfit.errors import PlanfitError
from planfit.geometry import se3
from planfit.geometry.se3 import Poses

_VERTEX, _EDGE, _FIX = "VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "FIX"
_N_NUMBERS = {_VERTEX: 1 + 7, _EDGE: 2 + 7 + 21}
"""Ids, translation and quaternion xyzw, upper triangle of the information."""


@dataclass(frozen=True)
class PoseGraph:
    """Poses, and relative poses that were measured between them; what `BetweenTerm` takes."""

    target_from_cams: Poses
    pairs: Int[np.ndarray, "e 2"]
    """First and second pose of each edge."""
    first_from_second: Float[np.ndarray, "e 4 4"]
    information: Float[np.ndarray, "e 6 6"]
    """Of (rotation, translation) [1/rad^2, 1/m^2], axes of the second pose as measured."""
    fixed: tuple[int, ...] = (0,)
    """Poses that are held."""


def write_g2o(path: Path, graph: PoseGraph, half_angles: bool = True) -> None:
    """Write a pose graph; see the module's page for `half_angles`."""
    lines = [f"{_VERTEX} {i} {_numbers(pose)}" for i, pose in enumerate(graph.target_from_cams)]
    lines += [f"{_FIX} {i}" for i in graph.fixed]
    information = _swap_halves(graph.information)
    if half_angles:  # a unit of q is two of the angle: information of q is four times that
        information[:, 3:] *= 2.0
        information[:, :, 3:] *= 2.0
    upper = information[:, *np.triu_indices(6)]
    for (i, j), step, values in zip(graph.pairs, graph.first_from_second, upper, strict=True):
        lines.append(f"{_EDGE} {i} {j} {_numbers(step)} {' '.join(f'{v:.9g}' for v in values)}")
    path.write_text("\n".join(lines) + "\n")


def read_g2o(path: Path, half_angles: bool = True) -> PoseGraph:
    """Read a pose graph, poses in the order of their ids; see the module's page for `half_angles`.

    Raises:
        PlanfitError: a line is not one of the three kinds, has too few or wrong numbers, or names a vertex
            that is not there.
    """
    vertices: dict[int, list[float]] = {}
    ends, edges, fixed = [], [], []
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise PlanfitError(f"{path}: expected text in g2o's format, found other bytes") from error
    for number, line in enumerate(text.splitlines(), 1):
        tag, *words = line.split() or [""]
        if tag in ("", "#"):
            continue
        try:
            ids, values = _parse(tag, words)
        except ValueError as error:
            raise PlanfitError(f"{path}:{number}: {error}; see the format of g2o") from None
        if tag == _VERTEX:
            vertices[ids[0]] = values
        elif tag == _EDGE:
            ends.append(ids)
            edges.append(values)
        else:
            fixed += ids
    idx_by_id = {vertex: k for k, vertex in enumerate(sorted(vertices))}
    missing = {i for pair in ends for i in pair}.union(fixed) - idx_by_id.keys()
    if missing:
        raise PlanfitError(f"{path}: expected a vertex for every id, found none for {min(missing)}")
    table = np.array(edges).reshape(-1, 28)
    information = np.zeros((len(table), 6, 6))
    information[:, *np.triu_indices(6)] = table[:, 7:]
    information += np.swapaxes(np.triu(information, 1), 1, 2)
    if half_angles:
        information[:, 3:] *= 0.5
        information[:, :, 3:] *= 0.5
    return PoseGraph(
        _transforms(np.array([vertices[i] for i in idx_by_id]).reshape(-1, 7)),
        np.array([[idx_by_id[i] for i in pair] for pair in ends], dtype=int).reshape(-1, 2),
        _transforms(table[:, :7]),
        _swap_halves(information),
        tuple(idx_by_id[i] for i in fixed),
    )


def _parse(tag: str, words: Sequence[str]) -> tuple[list[int], list[float]]:
    """Ids and numbers of a line."""
    if tag == _FIX:
        return [int(word) for word in words], []
    if tag not in _N_NUMBERS:
        raise ValueError(f"expected {_VERTEX}, {_EDGE} or {_FIX}, found {tag!r}")
    if len(words) != _N_NUMBERS[tag]:
        raise ValueError(f"expected {_N_NUMBERS[tag]} numbers, found {len(words)}")
    n_ids = 1 if tag == _VERTEX else 2
    values = [float(word) for word in words[n_ids:]]
    # Squares of very small numbers are 0, as those of very large ones are infinite.
    if not np.isfinite(values).all() or not 0.0 < sum(v * v for v in values[3:7]) < np.inf:
        raise ValueError("expected finite numbers and a quaternion that is not zero")
    return [int(word) for word in words[:n_ids]], values


def _transforms(xyz_xyzw: np.ndarray) -> np.ndarray:
    """Transforms (n, 4, 4) of translations and quaternions (n, 7)."""
    if len(xyz_xyzw) == 0:
        return np.zeros((0, 4, 4))
    return se3.make_transform(Rotation.from_quat(xyz_xyzw[:, 3:]).as_matrix(), xyz_xyzw[:, :3])


def _swap_halves(information: np.ndarray) -> np.ndarray:
    """Information (e, 6, 6) of (a, b) as that of (b, a), three numbers each."""
    order = [3, 4, 5, 0, 1, 2]
    return information[:, order][:, :, order]


def _numbers(pose: np.ndarray) -> str:
    xyzw = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return " ".join(f"{v:.12g}" for v in (*pose[:3, 3], *xyzw))
