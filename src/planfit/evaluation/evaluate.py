"""One call for all metrics: poses of a scan before and after, against plan, truth and their own map."""

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from planfit.errors import require, require_plain_numbers, require_positive
from planfit.evaluation.map_quality import MapOptions
from planfit.evaluation.metrics import (
    Metric,
    Truth,
    layer_metrics,
    map_metrics,
    surface_metrics,
    trajectory_metrics,
)
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.runtime import Changeable, Runtime, require_kinds, short_repr
from planfit.scan import Scan, calibrated_scan
from planfit.segmentation import (
    SegmentationOptions,
    Structure,
    find_gravity,
    level_from_world,
    segment_scan,
)


@dataclass(frozen=True)
class EvaluateOptions(Changeable):
    """Which metrics are taken, and how."""

    delta_m: float = 5.0
    """Path length over which relative errors are taken."""
    depth_maps: bool = True
    """Take the metrics that read every depth map: MME, MPV, MOM, NND."""
    map: MapOptions = field(default_factory=MapOptions)
    """The points that MME, MPV, MOM and NND are taken of."""

    def __post_init__(self) -> None:
        require_kinds(self)
        require_positive(self, "delta_m")


@runtime_checkable
class RefinedPoses(Protocol):
    """What is evaluated of a result of `planfit.refine`."""

    @property
    def structure(self) -> Structure: ...  # noqa: D102
    @property
    def floorplan(self) -> Floorplan | None: ...  # noqa: D102
    @property
    def initial_plan_from_cams(self) -> Float[np.ndarray, "n 4 4"]: ...  # noqa: D102
    @property
    def plan_from_cams(self) -> Float[np.ndarray, "n 4 4"]: ...  # noqa: D102
    @property
    def world_from_cams(self) -> Float[np.ndarray, "n 4 4"]: ...  # noqa: D102
    @property
    def sensor(self) -> SensorCalibration: ...  # noqa: D102


@dataclass(frozen=True)
class ComparedPoses:
    """Poses of a scan before and after, in both frames, with what else their metrics take."""

    structure: Structure
    """Floor and walls: the same for both sets of poses."""
    world_from_cams: tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4 4"]]
    """Before and after, in the scan's own axes."""
    plan_from_cams: tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4 4"]]
    """Before and after, in the plan frame; without a plan, in the level frame."""
    floorplan: Floorplan | None = None
    """In metres."""

    __repr__ = short_repr


@dataclass(frozen=True)
class Evaluation:
    """The metrics of a scan, before and after."""

    metrics: dict[str, Metric]
    """By name, in the order of docs/metrics.md. What was not seen or not given is left out."""
    n_true_poses: int
    """Frames that were compared with a true pose."""

    __repr__ = short_repr

    def __getitem__(self, name: str) -> Metric:
        return self.metrics[name]


def evaluate(
    scan: Scan,
    poses: Float[np.ndarray, "n 4 4"] | RefinedPoses | ComparedPoses,
    floorplan: Floorplan | None = None,
    truth: Truth | None = None,
    options: EvaluateOptions | None = None,
    runtime: Runtime | None = None,
) -> Evaluation:
    """Tell how good poses are, before and after: every metric of docs/metrics.md that can be taken.

    Args:
        scan: whose recorded poses are those before, as it was refined: of a result, its sensor is corrected
            here as the result has it; beside poses compared already, it has to be corrected already.
        poses: those after. A result of `planfit.refine`, with its plan; or poses alone: with a floorplan
            in the plan frame, onto which the recorded ones are moved by the rigid motion that fits best,
            and without one in the scan's own axes; or poses compared already.
        floorplan: in metres, for poses alone.
        truth: true poses, a true scan, or both.
        options: defaults to all metrics.
        runtime: threads, cache and progress.

    Raises:
        ScanError: a file of the scan cannot be used.
        OptionError: an option has a value that cannot work, a floorplan is given twice or has no unit, or the
            truth's frame is not known.
    """
    options, runtime = options or EvaluateOptions(), runtime or Runtime()
    if not isinstance(poses, np.ndarray | ComparedPoses):
        scan = calibrated_scan(scan, poses.sensor)
    require_plain_numbers(options)
    compared = _compared(scan, poses, floorplan, truth, runtime)
    in_plan = truth is not None and truth.frame == "plan"
    before, after = compared.plan_from_cams if in_plan else compared.world_from_cams
    metrics: list[Metric] = []
    if truth is not None and len(truth.frame_idx):
        metrics += trajectory_metrics(before, after, truth, options.delta_m)
    runtime.report("walls and floor", 0, 0)
    on_plan = compared.plan_from_cams
    metrics += surface_metrics(compared.structure, compared.floorplan, *on_plan, runtime.workers)
    metrics += layer_metrics(compared.structure.walls, *on_plan)
    runtime.report("walls and floor", 1, 0)
    if options.depth_maps:
        cloud = truth.cloud if truth is not None else None
        metrics += map_metrics(scan, before, after, options.map, runtime, cloud)
    n_true_poses = len(truth.frame_idx) if truth is not None else 0
    return Evaluation({metric.name: metric for metric in metrics}, n_true_poses)


def _compared(
    scan: Scan,
    poses: Float[np.ndarray, "n 4 4"] | RefinedPoses | ComparedPoses,
    floorplan: Floorplan | None,
    truth: Truth | None,
    runtime: Runtime,
) -> ComparedPoses:
    """Poses before and after in both frames."""
    if isinstance(poses, np.ndarray):
        return _compare_with_recorded(scan, poses, floorplan, truth, runtime)
    require(floorplan is None, "floorplan: expected none beside a result, which has its own")
    if isinstance(poses, ComparedPoses):
        return poses
    return ComparedPoses(
        structure=poses.structure,
        world_from_cams=(scan.world_from_cams, poses.world_from_cams),
        plan_from_cams=(poses.initial_plan_from_cams, poses.plan_from_cams),
        floorplan=poses.floorplan,
    )


def _compare_with_recorded(
    scan: Scan,
    poses: Float[np.ndarray, "n 4 4"],
    floorplan: Floorplan | None,
    truth: Truth | None,
    runtime: Runtime,
) -> ComparedPoses:
    """Poses alone, in the plan frame where there is a plan, else in the scan's own axes."""
    recorded = scan.world_from_cams
    level, structure = levelled(scan, runtime)
    if floorplan is None:
        require(
            truth is None or truth.frame == "world",
            "truth: expected the scan's own axes, as poses without a plan are in these, found the plan's",
        )
        return ComparedPoses(structure, (recorded, poses), (level @ recorded, level @ poses))
    require(floorplan.is_metric, f"{floorplan.name}: expected a plan in metres, found no unit")
    plan_from_world = se3.fit_rigid(recorded[:, :3, 3], poses[:, :3, 3])
    in_world = se3.inverse(plan_from_world) @ poses
    on_plan = (plan_from_world @ recorded, poses)
    return ComparedPoses(structure, (recorded, in_world), on_plan, floorplan)


def levelled(
    scan: Scan, runtime: Runtime, options: SegmentationOptions | None = None
) -> tuple[Float[np.ndarray, "4 4"], Structure]:
    """level_from_world of a scan, by its gravity and floor, and its floor and walls."""
    gravity = find_gravity(scan, runtime)
    structure = segment_scan(scan, gravity, options or SegmentationOptions(), runtime)
    return level_from_world(gravity, structure.floor_height_m), structure
