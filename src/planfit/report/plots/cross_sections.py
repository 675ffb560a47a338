"""Walls cut across: distance from where they are drawn against height, before and after."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.report.plots import colors
from planfit.report.plots.axes import BOTTOM_PT, LEGEND_PT, RIGHT_PT, Axes, left_pt
from planfit.report.plots.drawing import PANEL_PT, Box, Drawing, Words
from planfit.report.plots.top_view import draw_points
from planfit.report.walls import FEW_PATCHES, SeenFace

_HEIGHT_PT = 260
_LEAST_RANGE_M, _LARGEST_RANGE_M = 0.1, 3.0
_MAX_POINTS = 40_000


@dataclass(frozen=True)
class CrossSection:
    """The scanned points of one drawn wall, seen along it."""

    face: SeenFace
    before: Float[np.ndarray, "m 2"]
    """m: distance from the drawn face along its normal, and height above the floor."""
    after: Float[np.ndarray, "m 2"]


def cut_walls(
    floorplan: Floorplan, result: RefineResult, faces: list[SeenFace], max_count: int = 2
) -> list[CrossSection]:
    """The walls whose scanned points changed most, each by all points of its patches.

    A wall counts by its mean change of distance times the root of its points: a long wall that came
    together says more than a stub.
    """
    association, patches = result.adjustment.association, result.structure.walls
    scored = []
    for face in faces:
        if face.n_patches < FEW_PATCHES:
            continue
        own = np.flatnonzero(association.face_idx == face.face_idx)
        points = np.concatenate([np.arange(*patches.start[k : k + 2]) for k in own])
        points = points[:: max(1, len(points) // _MAX_POINTS)]
        frames = patches.point_frame_idx[points]
        before, after = (
            _across(floorplan, face.face_idx, poses[frames], patches.points_cam[points])
            for poses in (result.initial_plan_from_cams, result.plan_from_cams)
        )
        change = float(np.abs(np.minimum(np.abs(before[:, 0]), 1.0) - np.abs(after[:, 0])).mean())
        scored.append((change * np.sqrt(len(points)), CrossSection(face, before, after)))
    scored.sort(key=lambda s: -s[0])
    return [section for _, section in scored[:max_count]]


def draw_section(section: CrossSection) -> Drawing:
    """Before and after beside each other; the drawn face is the dark upright line."""
    distances = np.concatenate([section.before[:, 0], section.after[:, 0]])
    low_m, high_m = np.clip(
        np.percentile(distances, [1.5, 98.5]), -_LARGEST_RANGE_M, _LARGEST_RANGE_M
    )
    low_m, high_m = (
        1.1 * min(float(low_m), -_LEAST_RANGE_M),
        1.1 * max(float(high_m), _LEAST_RANGE_M),
    )
    top_m = max(1.0, float(np.percentile(section.after[:, 1], 99.5))) + 0.15
    # Distances are stretched: centimetres matter across a wall, metres along it.
    drawing, x, y = Drawing(PANEL_PT, _HEIGHT_PT), (low_m, high_m), (0.0, top_m)
    between_pt = 18
    width_pt = (PANEL_PT - left_pt(y) - RIGHT_PT - between_pt) / 2
    for k, (name, color, points) in enumerate(
        (("before", colors.BEFORE, section.before), ("after", colors.AFTER, section.after))
    ):
        left = left_pt(y) + k * (width_pt + between_pt)
        box = Box(left, LEGEND_PT, left + width_pt, _HEIGHT_PT - BOTTOM_PT)
        axes = Axes(drawing, box, x, y)
        draw_points(axes, points, color)
        axes.upright(np.zeros(1), colors.INK, 1.0)
        at = left + width_pt / 2, LEGEND_PT - 6
        drawing.items.append(Words(name, at, color, "middle", is_bold=True))
        axes.rim("from the drawn wall (m)", "" if k else "height (m)", has_numbers=(True, not k))
    return drawing


def _across(
    floorplan: Floorplan,
    face: int,
    plan_from_cams: Float[np.ndarray, "m 4 4"],
    points_cam: Float[np.ndarray, "m 3"],
) -> Float[np.ndarray, "m 2"]:
    """Distance from a face and height (m) of points, each with its own pose."""
    points = se3.transform_each(plan_from_cams, points_cam)
    distance = points[:, :2] @ floorplan.normals[face] - floorplan.offsets[face]
    return np.column_stack([distance, points[:, 2]])
