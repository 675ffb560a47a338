"""Walls of the plan by their scanned points: cut across, before and after, and from the front, coloured by
how far each spot is from where the wall is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.adjust.association import wall_patches_in_plan
from planfit.adjust.moved_walls import MIN_PATCHES
from planfit.as_built import AsBuilt, AsBuiltWall, Verdict
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.priors import PATCH_TURN_MOST_DEG, WALL_AS_DRAWN_M
from planfit.report.plots import colors
from planfit.report.plots.axes import BOTTOM_PT, LEGEND_PT, RIGHT_PT, Axes, left_pt
from planfit.report.plots.drawing import PANEL_PT, Box, Drawing, Words
from planfit.report.plots.maps import KEY_PT, draw_key, draw_medians
from planfit.report.plots.top_view import draw_points

_HEIGHT_PT, _FRONT_HEIGHT_PT = 260, 130
_LEAST_RANGE_M, _LARGEST_RANGE_M = 0.1, 3.0
_MAX_POINTS = 40_000
_CELL_M = 0.1


@dataclass(frozen=True)
class ScannedWall:
    """A drawn face and the scanned points that show it."""

    number: int
    """As in the table of walls."""
    wall: AsBuiltWall
    verdict: Verdict
    before: Float[np.ndarray, "m 3"]
    """m: along the face, from it along its normal, and above the floor."""
    after: Float[np.ndarray, "m 3"]

    @property
    def change(self) -> float:
        """Mean change of distance times the root of the number of points: a long wall that came together says
        more than a stub."""
        off_m = [np.abs(side[:, 1]) for side in (self.before, self.after)]
        change_m = np.abs(np.minimum(off_m[0], 1.0) - off_m[1]).mean()
        return float(change_m * np.sqrt(len(self.after)))


def scanned_walls(result: RefineResult, as_built: AsBuilt) -> list[ScannedWall]:
    """Faces of the plan that stand and of which enough patches were seen."""
    patches = result.structure.walls
    normals, ends = wall_patches_in_plan(patches, result.plan_from_cams)
    sides = (result.initial_plan_from_cams, result.plan_from_cams)
    found = []
    for number, wall in enumerate(as_built.walls, start=1):
        own = np.flatnonzero(_are_of(wall, normals, ends.mean(axis=1)))
        if wall.face_idx < 0 or len(own) < MIN_PATCHES:
            continue
        points = np.concatenate([np.arange(*patches.start[k : k + 2]) for k in own])
        points = points[:: max(1, len(points) // _MAX_POINTS)]
        frames, points_cam = patches.point_frame_idx[points], patches.points_cam[points]
        before, after = (_on_face(wall, poses[frames], points_cam) for poses in sides)
        found.append(ScannedWall(number, wall, as_built.verdict(wall), before, after))
    return found


def _are_of(
    wall: AsBuiltWall, normals: Float[np.ndarray, "k 2"], middles: Float[np.ndarray, "k 2"]
) -> Bool[np.ndarray, " k"]:
    """Which patches lie along a face, where it stands; none where it was not seen."""
    facing = normals @ wall.normal if wall.is_oriented else np.abs(normals @ wall.normal)
    along, off_m = _from_face(wall, middles)
    near = np.abs(off_m - wall.offset_m) < WALL_AS_DRAWN_M.value
    near &= facing > np.cos(np.deg2rad(PATCH_TURN_MOST_DEG.value))
    return near & (along > 0) & (along < wall.length_m)


def _from_face(
    wall: AsBuiltWall, xy: Float[np.ndarray, "m 2"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """How far points are along a face as drawn, from its left end as who stands before it sees it, and from
    it along its normal, m."""
    right = np.array([-wall.normal[1], wall.normal[0]])
    from_end = xy - wall.ends[np.argmin(wall.ends @ right)]
    return from_end @ right, from_end @ wall.normal


def _on_face(
    wall: AsBuiltWall,
    plan_from_cams: Float[np.ndarray, "m 4 4"],
    points_cam: Float[np.ndarray, "m 3"],
) -> Float[np.ndarray, "m 3"]:
    """Points, each with its own pose, along a face, from it, and in height."""
    points = se3.transform_each(plan_from_cams, points_cam)
    return np.column_stack([*_from_face(wall, points[:, :2]), points[:, 2]])


def most_changed(walls: Sequence[ScannedWall], max_count: int = 2) -> list[ScannedWall]:
    """Those whose scanned points changed most, the most first."""
    return sorted(walls, key=lambda one: -one.change)[:max_count]


def furthest_off(walls: Sequence[ScannedWall], max_count: int = 4) -> list[ScannedWall]:
    """Those that stand elsewhere than drawn, the furthest first; where none does, the longest one."""
    moved = [one for one in walls if one.verdict is Verdict.MOVED]
    if not moved:
        return sorted(walls, key=lambda one: -one.wall.length_m)[:1]
    return sorted(moved, key=lambda one: -abs(one.wall.offset_m))[:max_count]


def draw_section(wall: ScannedWall) -> Drawing:
    """Before and after beside each other; the drawn face is the dark upright line."""
    distances = np.concatenate([wall.before[:, 1], wall.after[:, 1]])
    low_m, high_m = np.clip(
        np.percentile(distances, [1.5, 98.5]), -_LARGEST_RANGE_M, _LARGEST_RANGE_M
    )
    low_m = 1.1 * min(float(low_m), -_LEAST_RANGE_M)
    high_m = 1.1 * max(float(high_m), _LEAST_RANGE_M)
    # Distances are stretched: centimetres matter across a wall, metres along it.
    drawing, x, y = Drawing(PANEL_PT, _HEIGHT_PT), (low_m, high_m), (0.0, _top_m(wall))
    between_pt = 18
    width_pt = (PANEL_PT - left_pt(y) - RIGHT_PT - between_pt) / 2
    for k, (name, color, points) in enumerate(
        (("before", colors.BEFORE, wall.before), ("after", colors.AFTER, wall.after))
    ):
        left = left_pt(y) + k * (width_pt + between_pt)
        box = Box(left, LEGEND_PT, left + width_pt, _HEIGHT_PT - BOTTOM_PT)
        axes = Axes(drawing, box, x, y)
        draw_points(axes, points[:, 1:], color)
        axes.upright(np.zeros(1), colors.INK, 1.0)
        at = left + width_pt / 2, LEGEND_PT - 6
        drawing.items.append(Words(name, at, color, "middle", is_bold=True))
        axes.rim("from the drawn wall (m)", "" if k else "height (m)", has_numbers=(True, not k))
    return drawing


def draw_front(wall: ScannedWall) -> Drawing:
    """A wall as who looks at it sees it: median distance from where it is drawn, cell by cell."""
    drawing, y = Drawing(PANEL_PT, _FRONT_HEIGHT_PT), (0.0, _top_m(wall))
    box = Box(left_pt(y), 8, PANEL_PT - KEY_PT, _FRONT_HEIGHT_PT - BOTTOM_PT)
    axes = Axes(drawing, box, (0.0, wall.wall.length_m), y)
    rows, columns = (max(1, round(size_m / _CELL_M)) for size_m in (y[1], wall.wall.length_m))
    draw_medians(axes, wall.after[:, [0, 2]], wall.after[:, 1], (rows, columns))
    axes.rim("along the wall (m)", "height (m)", n_steps=2)
    draw_key(axes, "from the drawn wall (m)")
    return drawing


def _top_m(wall: ScannedWall) -> float:
    return max(1.0, float(np.percentile(wall.after[:, 2], 99.5))) + 0.15
