"""What was measured, as a calibrated sensor would have measured it."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.adjust.measurements import Measurements
from planfit.geometry.calibration import SensorCalibration
from planfit.matching import Matches
from planfit.runtime import changed, row_parts
from planfit.segmentation import LevelPoints, Structure, WallPatches


def corrected_measurements(measurements: Measurements, sensor: SensorCalibration) -> Measurements:
    """Measurements with every lifted point corrected, and cameras."""
    return replace(
        measurements,
        matches=corrected_matches(measurements.matches, sensor),
        by_hand=None
        if measurements.by_hand is None
        else corrected_matches(measurements.by_hand, sensor),
        surfaces=measurements.surfaces.corrected(sensor),
        structure=corrected_structure(measurements.structure, sensor),
        cameras=tuple(sensor.camera(camera) for camera in measurements.cameras),
        control=measurements.control.corrected(sensor),
    )


def corrected_matches(matches: Matches, sensor: SensorCalibration) -> Matches:
    """Matches with both points corrected; their sigmas grow with the points."""
    if sensor.is_nominal or matches.n_matches == 0:
        return matches
    points_a = changed(matches.points_a, sensor.points)
    points_b = changed(matches.points_b, sensor.points)
    before_m, after_m = (
        np.concatenate([part[:, 2] for part in row_parts(a)])
        + np.concatenate([part[:, 2] for part in row_parts(b)])
        for a, b in ((matches.points_a, matches.points_b), (points_a, points_b))
    )
    sigma = (matches.sigma * (after_m / before_m)).astype(matches.sigma.dtype, copy=False)
    return replace(matches, points_a=points_a, points_b=points_b, sigma=sigma)


def corrected_structure(structure: Structure, sensor: SensorCalibration) -> Structure:
    """Floor, walls, ceiling and columns with their points corrected."""
    if sensor.is_nominal:
        return structure
    return replace(
        structure,
        floor=_corrected_level(structure.floor, sensor),
        walls=_corrected_patches(structure.walls, sensor),
        unassigned_points_cam=changed(structure.unassigned_points_cam, sensor.points),
        ceiling=_corrected_level(structure.ceiling, sensor),
        columns=_corrected_patches(structure.columns, sensor),
    )


def _corrected_level(points: LevelPoints, sensor: SensorCalibration) -> LevelPoints:
    return replace(points, points_cam=changed(points.points_cam, sensor.points))


def _corrected_patches(patches: WallPatches, sensor: SensorCalibration) -> WallPatches:
    """Patches with points and ends corrected, normals again across the ends and level."""
    ends = sensor.points(patches.ends_cam)
    normals = patches.normals_cam
    if len(patches):
        along = _unit(patches.ends_cam[:, 1] - patches.ends_cam[:, 0])
        up = np.cross(normals, along)  # the normal is level, and so are the ends
        normals = _unit(np.cross(_unit(ends[:, 1] - ends[:, 0]), up))
    return replace(
        patches,
        points_cam=changed(patches.points_cam, sensor.points),
        ends_cam=ends,
        normals_cam=normals,
    )


def _unit(vectors: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
