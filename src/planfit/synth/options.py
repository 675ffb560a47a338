"""Everything that can be chosen about a synthetic scan: sizes, motion, noise, seed."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from planfit.errors import require
from planfit.runtime import Changeable, require_kinds

MAX_ROOMS = 40
OUTER_WALL_M = 0.3
"""Thickness of outer walls, m: that of brick with insulation; no inner wall is thicker."""
WALKWAY_M = 1.0
"""Furniture leaves ways of this width, m, between all doors."""


def require_range(name: str, low_high: tuple[float, float]) -> None:
    """Raise `OptionError` unless `low_high` are two positive numbers in order."""
    low, high = low_high
    require(0 < low <= high, f"{name}: expected 0 < low <= high, found {low_high}")


@dataclass(frozen=True)
class BuildingOptions:
    """Rooms, walls, openings and furniture of a building."""

    n_rooms: int = 4
    """Rooms, a corridor included; 1 to 40. The corridor is as long as half of the rooms side by side."""
    is_open_plan: bool = False
    """One single room of the area that `n_rooms` rooms would take."""
    open_plan_size_m: tuple[float, float] | None = None
    """Sides of the open plan; by default they follow from the area, up to 1.6 times as long as wide."""
    has_corridor: bool = True
    """One of the rooms is a corridor that the others open onto. Takes effect from 4 rooms on."""
    room_size_m: tuple[float, float] = (3.2, 4.8)
    """Shortest and longest side of a room (not of a corridor or an open plan)."""
    corridor_width_m: float = 1.9
    """Clear width of the corridor."""
    wall_thickness_m: tuple[float, float] = (0.12, 0.25)
    """Thinnest and thickest inner wall."""
    height_m: float = 2.6
    """Floor to ceiling."""
    n_storeys: int = 1
    """Storeys over each other, each with `n_rooms` rooms of a layout of its own, and a stairwell."""
    door_width_m: float = 1.0
    """Clear width of door openings."""
    door_height_m: float = 2.05
    """Clear height of door openings; the wall goes on above."""
    furniture_per_room: int = 6
    """Pieces tried in each room of usual size (16 m2), in proportion to its area. Pieces that would
    stand in the way are left out; 0 leaves the rooms bare."""
    refurnished: int = 0
    """How often the rooms were furnished anew since they were built: the walls, what hangs on them and the
    floors stay, all furniture is other furniture in other places."""
    pictures_per_wall: float = 2.2
    """Pictures, notices, sockets and windows tried on a wall of 4 m, on average."""
    n_columns: int = 0
    """Free-standing square columns in the largest room; they are in the plan."""
    yaw_deg: float = 0.0
    """Yaw of the building in the plan frame; not zero gives walls off the plan's axes."""
    same_posters: int = 0
    """Places where the same poster hangs, the very same picture, 5 to 20 m apart."""
    same_doors: bool = False
    """The same door, with the same notice, stands open at every doorway."""
    same_rooms: bool = False
    """All rooms off the corridor are of one size, with the same furniture, pictures and textures in the same
    places; those on one side are turned by half a turn."""
    single_wall_m: float = 0.1
    """In a given plan: thickness of walls that are drawn by one face only, behind that face."""

    def __post_init__(self) -> None:
        require(1 <= self.n_rooms <= MAX_ROOMS,
                f"n_rooms: expected 1 to {MAX_ROOMS}, found {self.n_rooms}")  # fmt: skip
        require(1 <= self.n_storeys <= 4, f"n_storeys: expected 1 to 4, found {self.n_storeys}")
        require(self.n_storeys == 1 or not self.same_rooms,
                "n_storeys: expected 1 together with same_rooms, as the stairwell has a door to one of "
                f"them, found {self.n_storeys}")  # fmt: skip
        require_range("room_size_m", self.room_size_m)
        require_range("wall_thickness_m", self.wall_thickness_m)
        require(self.wall_thickness_m[1] <= OUTER_WALL_M,
                f"wall_thickness_m: expected no more than the {OUTER_WALL_M:g} m of outer walls, "
                f"found {self.wall_thickness_m[1]:g}")  # fmt: skip
        least = self.door_width_m + 1.0
        require(self.room_size_m[0] >= least,
                f"room_size_m: expected at least the door width + 1 m = {least:g}, "
                f"found {self.room_size_m[0]:g}")  # fmt: skip
        require(1.5 < self.door_height_m < self.height_m,
                f"door_height_m: expected 1.5 to height_m = {self.height_m:g}, "
                f"found {self.door_height_m:g}")  # fmt: skip
        require(self.open_plan_size_m is None or (self.is_open_plan and min(self.open_plan_size_m) >= 2),
                "open_plan_size_m: expected 2 m or more, together with is_open_plan, "
                f"found {self.open_plan_size_m}")  # fmt: skip
        require(self.same_posters >= 0,
                f"same_posters: expected none below 0, found {self.same_posters}")  # fmt: skip
        require(not self.same_rooms
                or (self.has_corridor and self.n_rooms >= 4 and not self.is_open_plan),
                "same_rooms: expected rooms off a corridor (has_corridor, n_rooms 4 or more), "
                "found none")  # fmt: skip
        require(self.single_wall_m > 0,
                f"single_wall_m: expected > 0, found {self.single_wall_m:g}")  # fmt: skip
        require(self.corridor_width_m >= WALKWAY_M,
                f"corridor_width_m: expected at least {WALKWAY_M:g}, the way that furniture leaves, "
                f"found {self.corridor_width_m:g}")  # fmt: skip
        counts = (self.furniture_per_room, self.n_columns, self.pictures_per_wall)
        require(min(counts) >= 0,
                f"furniture_per_room, n_columns, pictures_per_wall: expected none below 0, "
                f"found {counts}")  # fmt: skip
        require(self.refurnished >= 0,
                f"refurnished: expected none below 0, found {self.refurnished}")  # fmt: skip


@dataclass(frozen=True)
class WalkOptions:
    """The way of the person who holds the camera."""

    n_frames: int = 180
    """Frames, spread evenly over the way by motion: a rotation counts like a step. For 4 rooms of
    usual size, 180 frames are at most 0.33 m and 17 degrees apart, 9 degrees on average."""
    is_loop: bool = True
    """Whether the walk ends where it began, with the same view."""
    clearance_m: float = 0.4
    """The camera comes no nearer to walls and furniture."""
    height_m: float = 1.5
    """Height of the camera over the floor."""
    sway_m: float = 0.03
    """Standard deviation of the unsteady hand, each axis."""
    pitch_deg: float = -14.0
    """Mean pitch; negative looks down."""
    pitch_swing_deg: float = 7.0
    """Standard deviation of slow pitch changes about the mean."""
    look_around_deg: float = 22.0
    """Standard deviation of slow turns of the view away from the way ahead."""
    roll_swing_deg: float = 1.5
    """Standard deviation of roll."""
    area_per_stop_m2: float = 10.0
    """Floor area for each point that the walk calls at; smaller makes it longer."""
    max_length_m: float | None = None
    """In a given plan: a longer walk leaves rooms out; by default it calls at all that can be reached."""
    path: Path | None = None
    """In a given plan: the way itself, a TUM trajectory (`time x y z qx qy qz qw`) of which x and y are used,
    in the plan's axes, m. The camera looks along it; where it passes through walls they are not built."""
    path_offset_m: tuple[float, float] = (0.0, 0.0)
    """Added to x and y of `path`. The origin of a plan that is a picture is its top left pixel, y up: of a
    path from the bottom left, y needs less the picture's height."""

    def __post_init__(self) -> None:
        require(self.n_frames >= 2, f"n_frames: expected at least 2, found {self.n_frames}")
        require(self.clearance_m > 0, f"clearance_m: expected > 0, found {self.clearance_m:g}")
        require(self.max_length_m is None or self.max_length_m > 0,
                f"max_length_m: expected > 0, found {self.max_length_m}")  # fmt: skip
        require(self.area_per_stop_m2 > 0.5,
                f"area_per_stop_m2: expected > 0.5, found {self.area_per_stop_m2:g}")  # fmt: skip
        sigmas = (self.sway_m, self.pitch_swing_deg, self.look_around_deg, self.roll_swing_deg)
        require(min(sigmas) >= 0, "sway_m, *_swing_deg, look_around_deg: expected none below 0")


@dataclass(frozen=True)
class CameraOptions:
    """The camera, and the faults of its colour images."""

    width_px: int = 640
    """Width of colour and depth."""
    height_px: int = 480
    """Height of both."""
    fov_deg: float = 66.0
    """Horizontal field of view."""
    blur_px: float = 0.5
    """Standard deviation of the lens blur; 0 for none."""
    exposure_std: float = 0.03
    """Relative standard deviation of brightness between frames."""
    noise_levels: float = 1.5
    """Standard deviation of pixel noise, in levels of 255."""

    def __post_init__(self) -> None:
        require(self.width_px >= 16 and self.height_px >= 16,
                f"width_px, height_px: expected at least 16, "
                f"found {self.width_px} x {self.height_px}")  # fmt: skip
        require(10 <= self.fov_deg <= 140, f"fov_deg: expected 10 to 140, found {self.fov_deg:g}")
        require(min(self.blur_px, self.exposure_std, self.noise_levels) >= 0,
                "blur_px, exposure_std, noise_levels: expected none below 0")  # fmt: skip


@dataclass(frozen=True)
class NoDepthNoise:
    """Depth as it is, up to the rounding of float32."""


@dataclass(frozen=True)
class StructuredLightNoise:
    """A projected-pattern sensor (Kinect v1, RealSense): disparity errors, which grow with z^2.

    The defaults follow Khoshelham and Oude Elberink, Sensors 2012 (sigma_z = 1.4 mm z^2).
    """

    sigma_at_1m_m: float = 1.4e-3
    """Standard deviation at 1 m, before quantisation; z m away it is z^2 times this."""
    disparity_step_px: float = 0.125
    """Disparity is rounded to multiples of this; 0 for no rounding."""
    baseline_m: float = 0.075
    """Projector to camera."""
    focal_px: float = 580.0
    """Focal length of the sensor (not of the rendered image)."""
    correlation_px: float = 0.8
    """Standard deviation of the Gaussian that errors of neighbouring pixels share; 0 for white."""
    min_range_m: float = 0.4
    """Nothing nearer is measured."""
    max_range_m: float = 6.0
    """Nothing further away is measured."""
    edge_px: int = 2
    """Nothing is measured within this distance of a depth edge."""
    max_incidence_deg: float = 82.0
    """Nothing is measured where the surface is seen at a flatter angle than this from its normal."""
    drop_share: float = 0.003
    """Share of other pixels without a measurement."""

    def __post_init__(self) -> None:
        _check_depth_noise(self)
        require(self.disparity_step_px >= 0 and self.baseline_m > 0 and self.focal_px > 0,
                "disparity_step_px, baseline_m, focal_px: expected positive numbers")  # fmt: skip


@dataclass(frozen=True)
class TimeOfFlightNoise:
    """The time-of-flight sensor of a phone: short range, flying pixels, smooth multi-path bias."""

    sigma_m: float = 0.004
    """Standard deviation at no distance, before quantisation."""
    sigma_at_1m_m: float = 0.0015
    """What z^2 times adds to the standard deviation, z m away."""
    step_m: float = 0.005
    """Depth is rounded to multiples of this; 0 for no rounding."""
    bias: float = 0.006
    """Standard deviation of the multi-path error, as a share of depth; smooth over the image."""
    correlation_px: float = 1.0
    """Standard deviation of the Gaussian that errors of neighbouring pixels share; 0 for white."""
    min_range_m: float = 0.2
    """Nothing nearer is measured."""
    max_range_m: float = 5.0
    """Nothing further away is measured."""
    edge_px: int = 2
    """Within this distance of a depth edge, measurements fly between the near and the far surface."""
    edge_hole_share: float = 0.5
    """Share of those that have no measurement instead."""
    max_incidence_deg: float = 84.0
    """Nothing is measured where the surface is seen at a flatter angle than this from its normal."""
    drop_share: float = 0.003
    """Share of other pixels without a measurement."""

    def __post_init__(self) -> None:
        _check_depth_noise(self)
        require(min(self.sigma_m, self.step_m, self.bias) >= 0,
                "sigma_m, step_m, bias: expected none below 0")  # fmt: skip
        require(0 <= self.edge_hole_share <= 1,
                f"edge_hole_share: expected 0 to 1, found {self.edge_hole_share:g}")  # fmt: skip


DepthNoise = NoDepthNoise | StructuredLightNoise | TimeOfFlightNoise


def _check_depth_noise(noise: StructuredLightNoise | TimeOfFlightNoise) -> None:
    require(noise.sigma_at_1m_m >= 0 and noise.correlation_px >= 0 and noise.edge_px >= 0,
            "sigma_at_1m_m, correlation_px, edge_px: expected none below 0")  # fmt: skip
    require(0 <= noise.min_range_m < noise.max_range_m,
            f"min_range_m, max_range_m: expected 0 <= min < max, "
            f"found {noise.min_range_m:g}, {noise.max_range_m:g}")  # fmt: skip
    require(0 < noise.max_incidence_deg <= 90,
            f"max_incidence_deg: expected up to 90, found {noise.max_incidence_deg:g}")  # fmt: skip
    require(0 <= noise.drop_share <= 1,
            f"drop_share: expected 0 to 1, found {noise.drop_share:g}")  # fmt: skip


@dataclass(frozen=True)
class DriftOptions:
    """A random walk on the motion from each frame to the next, as odometry drifts.

    The defaults are measured on the real scan of the project at its own frame rate.
    """

    yaw_deg: float = 0.15
    """Standard deviation of the rotation about the vertical, per frame; 0.3 of it about others."""
    translation_m: float = 0.02
    """Standard deviation of the translation along each horizontal axis, per frame; 0.3 of it upwards."""
    jumps_per_100_frames: float = 0.0
    """How often tracking jumps, on average; a jump is a motion's error besides the random walk."""
    jump_m: float = 0.1
    """Standard deviation of a jump along each horizontal axis."""
    jump_yaw_deg: float = 1.0
    """Standard deviation of a jump's rotation about the vertical."""

    def __post_init__(self) -> None:
        values = (self.yaw_deg, self.translation_m, self.jumps_per_100_frames, self.jump_m,
                  self.jump_yaw_deg)  # fmt: skip
        require(all(math.isfinite(v) and v >= 0 for v in values),
                f"drift: expected finite numbers, none below 0, found {values}")  # fmt: skip


@dataclass(frozen=True)
class SynthOptions(Changeable):
    """A synthetic scan. The same options give the same scan, bit for bit."""

    seed: int = 0
    """Everything random follows from it."""
    visit: int = 0
    """Another number is another scan of the same building: another walk, drift, world and noise."""
    building: BuildingOptions = field(default_factory=BuildingOptions)
    walk: WalkOptions = field(default_factory=WalkOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    depth_noise: DepthNoise = field(default_factory=StructuredLightNoise)
    drift: DriftOptions = field(default_factory=DriftOptions)
    has_color: bool = True
    """Whether frames have colour images; without, the scan is depth alone."""
    has_labels: bool = True
    """Whether the scan says what each pixel shows."""
    world: Literal["plan", "moved"] = "plan"
    """`plan`: poses are recorded in the plan's axes, as in the FACaP layout (y up). `moved`: the
    world is rotated about the vertical and moved, and the scan does not say how."""

    def __post_init__(self) -> None:
        require_kinds(self)
        require(self.seed >= 0, f"seed: expected 0 or more, found {self.seed}")
        require(self.visit >= 0, f"visit: expected 0 or more, found {self.visit}")
        require(self.world in ("plan", "moved"),
                f"world: expected 'plan' or 'moved', found {self.world!r}")  # fmt: skip
        slit = self.building.door_width_m - 2 * self.walk.clearance_m
        require(slit >= 0.16,
                "door_width_m: expected at least twice clearance_m + 0.16 = "
                f"{2 * self.walk.clearance_m + 0.16:g} m to walk through, "
                f"found {self.building.door_width_m:g}")  # fmt: skip
        widest = (WALKWAY_M - 0.16) / 2
        require(2 * self.walk.clearance_m + 0.16 <= WALKWAY_M,
                f"clearance_m: expected at most {widest:g} m to walk past furniture, "
                f"found {self.walk.clearance_m:g}")  # fmt: skip
        require(self.walk.height_m < self.building.door_height_m - 0.2,
                f"walk.height_m: expected at least 0.2 m below the top of doors, "
                f"found {self.walk.height_m:g}")  # fmt: skip
