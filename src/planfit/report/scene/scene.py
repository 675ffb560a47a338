"""What the 3D view shows, as arrays: points by frame, poses before and after, walls, pictures."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

FAR_M = 0.51
"""Distances to the plan end here: what is further is near no wall."""


@dataclass(frozen=True)
class ScenePoints:
    """m points of a scan in the axes of the n cameras that saw them."""

    points_cam: Float[np.ndarray, "m 3"]
    """m"""
    colors: UInt8[np.ndarray, "m 3"]
    """RGB"""
    start: Int[np.ndarray, " starts"]
    """(n + 1,): points of frame i are start[i]:start[i + 1]."""
    plan_distances_m: Float[np.ndarray, "2 m"] | None
    """Before and after, to the nearest face from above, `FAR_M` at most; None without a plan that
    the scan is aligned with."""

    @property
    def frame_idx(self) -> Int[np.ndarray, " m"]:
        """Frame of each point."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))


@dataclass(frozen=True)
class SceneFrame:
    """What is told of a frame that is pressed."""

    name: str
    """As its format calls it."""
    time: str
    """In words; empty where the format has no times."""
    moved: str
    """By the refinement, in words."""
    predicted: str
    """Its predicted error, in words."""
    tangents: tuple[float, float]
    """Of half the angles of view, across and down."""
    floor_m: float
    """Height of the floor that it stands on, plan frame, m."""
    is_after_gap: bool
    """Whether the recording stopped before it, so that no path leads to it."""


@dataclass(frozen=True)
class SceneWall:
    """A face of the plan, or a wall that it lacks, as an upright rectangle."""

    face_idx: int
    """Below 0: less the number of a wall that the plan lacks."""
    ends: Float[np.ndarray, "2 2"]
    """Plan frame, m."""
    normal: Float[np.ndarray, "2"]
    """Unit vector, towards the room where that is known."""
    heights: tuple[float, float]
    """Of its lower and upper edge, m."""
    status: str
    """agrees, displaced, missing, few (too few patches to tell), new (the plan lacks it), unseen."""
    title: str
    """In words."""
    rows: tuple[tuple[str, str], ...]
    """What was measured of it: names and words."""


@dataclass(frozen=True)
class Scene:
    """What the 3D view shows, in the plan frame."""

    origin: Float[np.ndarray, "3"]
    """Plan frame, m: single precision is kept for what is relative to it, so that site coordinates of
    millions of metres lose nothing."""
    bounds: Float[np.ndarray, "2 3"]
    """Lower and upper corner of what is to be seen first, m; stray points lie outside."""
    cut_m: float
    """Height above which nothing is shown at first: ceilings would hide the rooms."""
    before: Float[np.ndarray, "n 4 4"]
    """plan_from_cams"""
    after: Float[np.ndarray, "n 4 4"]
    """plan_from_cams"""
    points: ScenePoints
    frames: tuple[SceneFrame, ...]
    is_placed: Bool[np.ndarray, " n"]
    """Whether anything says where a frame stands."""
    keyframe_idx: Int[np.ndarray, " k"]
    """Frames that are drawn as little cameras."""
    walls: tuple[SceneWall, ...]
    pictures: Mapping[int, bytes]
    """JPEGs of some frames, by frame."""
