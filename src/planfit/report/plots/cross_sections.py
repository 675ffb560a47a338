"""Walls cut across: distance from where they are drawn against height, before and after."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.report.plots.drawing import (
    AFTER,
    BEFORE,
    FONT_PT,
    GREY,
    INK,
    PANEL_IN,
    Picture,
    add_axes,
    new_figure,
    to_picture,
)
from planfit.report.plots.top_view import Crop, draw_points
from planfit.report.walls import FEW_PATCHES, SeenFace

_HEIGHT_IN = 3.6
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


def draw_section(section: CrossSection) -> Picture:
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
    figure = new_figure(PANEL_IN, _HEIGHT_IN)
    width_in = (PANEL_IN - 0.55 - 0.1 - 0.25) / 2
    height_in = _HEIGHT_IN - 0.42 - 0.28
    for k, (name, color, points) in enumerate(
        (("before", BEFORE, section.before), ("after", AFTER, section.after))
    ):
        left = 0.55 + k * (width_in + 0.25)
        axes = add_axes(figure, left, 0.42, width_in, height_in)
        axes.set_xlim(low_m, high_m)
        axes.set_ylim(0.0, top_m)
        # draw_points needs square cells: both axes are brought to the scale of the distances, and `extent`
        # puts the image back. Distances are stretched: centimetres matter across a wall, metres along it.
        square = np.array([1.0, (high_m - low_m) / width_in * height_in / top_m])
        crop = Crop(np.array([low_m, 0.0]), np.array([high_m, top_m]) * square)
        draw_points(axes, crop, points * square, color, (low_m, high_m, 0.0, top_m))
        axes.axvline(0.0, color=INK, linewidth=1.0, zorder=5)
        axes.set_title(name, fontsize=FONT_PT, color=color, fontweight="bold", pad=4)
        axes.set_xlabel("from the drawn wall (m)", fontsize=FONT_PT, color=GREY, labelpad=2)
        if k == 0:
            axes.set_ylabel("height (m)", fontsize=FONT_PT, color=GREY, labelpad=2)
        else:
            axes.tick_params(labelleft=False)
    return to_picture(figure)


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
