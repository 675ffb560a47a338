"""The scans of the battery: real ones where they are at hand, synthetic ones made here."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from inspect import signature
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

import planfit
from faults.inputs import DRIFT, Inputs, Rendered
from faults.layouts import corridor, hall, niches, same_rooms, scan_of_layout
from planfit.floorplan import PlanOptions
from planfit.geometry import se3, segments
from planfit.scan import Scan, read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.scan.views import FilesView, select_frames
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    SyntheticScan,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
    drift_poses,
    make_scan,
)

SHARED = Path(os.environ.get("PLANFIT_SHARED", "../shared/data"))
CAMERA = CameraOptions(width_px=320, height_px=240)


@dataclass(frozen=True)
class BaseScan:
    """A scan before it is spoilt."""

    name: str
    make: Callable[[], Inputs]
    """With true poses as recorded ones."""
    is_rendered: bool = True
    """Whether its images are rendered, and better kept."""
    has_up: bool = True
    """Whether the scan says which way is up."""


def drifted(base: Inputs, seed: int) -> Inputs:
    """With drift of its own, as recorded poses have it."""
    rng = np.random.default_rng(seed)
    poses = drift_poses(base.true_world_from_cams, base.drift, rng, base.up_world)
    return base.with_poses(poses)


def conslam() -> Inputs:
    """The real scan, its true poses and its plan.

    Raises:
        ScanError: it is not at hand.
    """
    folder = SHARED / "conslam"
    scan = planfit.read_scan(folder)
    assert scan.floorplan_path is not None
    floorplan = planfit.read_floorplan(scan.floorplan_path)
    _, true_world_from_cams = read_tum(folder / "groundtruth.tum")
    return Inputs(scan, floorplan, true_world_from_cams, PLAN_FROM_WORLD)


def kitchen() -> Inputs:
    """7-Scenes' red kitchen: the given poses (KinectFusion's) stand for the truth, the plan is drawn by hand.

    Raises:
        ScanError: it is not at hand.
    """
    recording = planfit.read_scan(SHARED / "kitchen")
    # Every other frame: labels come from geometry here, which takes most of a case's time.
    frames = np.arange(0, len(recording), 2)
    scan = select_frames(recording, frames, recording.world_from_cams[frames])
    scan = replace(scan, fingerprint=f"{recording.fingerprint} every other frame")
    ends = np.array(KITCHEN_WALLS)
    floorplan = planfit.Floorplan.from_segments(
        ends, segments.left_normals(ends), name="kitchen, drawn by hand"
    )
    plan_from_world = np.array(KITCHEN_PLAN_FROM_WORLD)
    plan_from_world[:3, :3] = se3.project_to_so3(plan_from_world[:3, :3])
    return Inputs(scan, floorplan, scan.world_from_cams, plan_from_world)


KITCHEN_PLAN_FROM_WORLD = (
    (0.99971, 0.02039, -0.01246, 0.0),
    (0.02039, -0.45606, 0.88972, 0.0),
    (0.01246, -0.88972, -0.45634, 1.53863),
    (0.0, 0.0, 0.0, 1.0),
)
"""Gravity and floor as planfit finds them with the given poses."""
KITCHEN_WALLS = (
    ((2.05, 3.43), (-2.74, 3.34)),
    ((-2.74, 3.34), (-2.37, 0.70)),
    ((1.95, 2.20), (2.02, 3.43)),
)
"""m, the three walls that are seen, drawn through the wall patches of the given poses; the left is free."""


def inputs_of(synthetic: SyntheticScan) -> Inputs:
    scan = replace(synthetic.scan, world_from_cams=synthetic.true_world_from_cams)
    return Inputs(
        scan,
        synthetic.floorplan,
        synthetic.true_world_from_cams,
        synthetic.true_plan_from_world,
        rendered=Rendered(
            synthetic.building,
            synthetic.renderer,
            synthetic.true_plan_from_cams,
            synthetic.options,
        ),
    )


def _options(seed: int, n_frames: int, building: BuildingOptions, **others: object) -> SynthOptions:
    # One room has few stops: more of them make a walk of it.
    area_m2 = 2.0 if building.n_rooms == 1 else 10.0
    walk = WalkOptions(n_frames=n_frames, area_per_stop_m2=area_m2)
    options = SynthOptions(seed=seed, building=building, walk=walk, camera=CAMERA)
    return replace(options, **others)


def _synth(seed: int, n_frames: int, building: BuildingOptions, **others: object) -> Inputs:
    return inputs_of(make_scan(_options(seed, n_frames, building, **others)))


def _drawn(make: Callable[..., tuple], seed: int, n_frames: int) -> Inputs:
    options = _options(seed, n_frames, BuildingOptions(furniture_per_room=4))
    layout, options = make(options)
    return scan_of_layout(layout, options, make is same_rooms, make is niches)


SYNTHETIC = (
    BaseScan("flat", partial(_synth, 101, 150, BuildingOptions())),
    BaseScan(
        "flat, moved",
        partial(_synth, 102, 150, BuildingOptions(n_rooms=5, yaw_deg=14.0), world="moved"),
    ),
    BaseScan(
        "flat, phone",
        partial(_synth, 103, 150, BuildingOptions(), depth_noise=TimeOfFlightNoise()),
    ),
    BaseScan(
        "bare flat",
        partial(_synth, 104, 150, BuildingOptions(furniture_per_room=0, pictures_per_wall=0.6)),
    ),
    BaseScan("one room", partial(_synth, 105, 120, BuildingOptions(n_rooms=1))),
    BaseScan(
        "open plan",
        partial(_synth, 106, 150, BuildingOptions(n_rooms=6, is_open_plan=True, n_columns=3)),
    ),
    BaseScan("offices", partial(_synth, 107, 200, BuildingOptions(n_rooms=8))),
    BaseScan("same offices", partial(_drawn, same_rooms, 108, 200)),
    BaseScan("corridor", partial(_drawn, corridor, 109, 180)),
    BaseScan("hall", partial(_drawn, hall, 110, 160)),
)

WALKS = tuple(
    BaseScan(
        f"walk {k:02d}",
        partial(
            _synth,
            200 + k,
            140,
            BuildingOptions(
                n_rooms=8,
                furniture_per_room=1 if k % 3 else 5,
                pictures_per_wall=0.3 if k % 3 else 1.5,
            ),
        ),
    )
    for k in range(40)
)
"""Walks in which the same posters are hung; in two of three, little else is there to see."""

NICHES = tuple(BaseScan(f"niches {k}", partial(_drawn, niches, 120 + k, 140)) for k in range(1, 4))
"""Flats whose walls have layers 10 to 20 cm before the others."""

PHONES = (
    BaseScan(
        "open plan, phone",
        partial(
            _synth,
            131,
            150,
            BuildingOptions(n_rooms=6, is_open_plan=True, n_columns=3),
            depth_noise=TimeOfFlightNoise(),
        ),
    ),
    BaseScan(
        "two rooms, phone",
        partial(_synth, 132, 120, BuildingOptions(n_rooms=2), depth_noise=TimeOfFlightNoise()),
    ),
)
"""More scans of a time-of-flight camera, for `benchmarks/calibration.py`."""

RATE_HZ = 30.0


def _recorded_at_rate(
    seed: int, n_frames: int, building: BuildingOptions, **others: object
) -> Inputs:
    """A walk at a walker's speed, a frame each 1/30 s; as long as the others, so it drifts less a frame."""
    inputs = _synth(seed, n_frames, building, **others)
    scan = replace(inputs.scan, timestamps=np.arange(n_frames) / RATE_HZ)
    per_frame = replace(
        DRIFT, yaw_deg=0.15 * DRIFT.yaw_deg, translation_m=0.15 * DRIFT.translation_m
    )
    return replace(inputs, scan=scan, drift=per_frame)


AT_RATE = (
    BaseScan("one room, 30 Hz", partial(_recorded_at_rate, 105, 450, BuildingOptions(n_rooms=1))),
    BaseScan(
        "two rooms, phone, 30 Hz",
        partial(
            _recorded_at_rate,
            132,
            560,
            BuildingOptions(n_rooms=2),
            depth_noise=TimeOfFlightNoise(),
        ),
    ),
)
"""Scans of 15 and 19 s whose clock can be off, for `benchmarks/calibration.py`."""

REAL = (
    BaseScan("conslam", conslam, is_rendered=False),
    BaseScan("kitchen", kitchen, is_rendered=False, has_up=False),
)


def rendered_walks() -> tuple[BaseScan, ...]:
    """Walks rendered in real plans, where planfit can: added at the end of the battery."""
    if "floorplan" not in signature(make_scan).parameters:
        return ()
    return tuple(BaseScan(f"in {plan.name}", partial(_in_plan, plan)) for plan in REAL_PLANS)


@dataclass(frozen=True)
class RealPlan:
    """A plan to walk in, and how it is read."""

    name: str
    path: str
    """In the folder of test inputs."""
    seed: int
    options: PlanOptions = field(default_factory=PlanOptions)
    walk: str = ""
    """File of the true walk, if one is known."""
    height_px: int = 0
    """Of a picture: its origin is the top left, that of the walk the bottom left."""


HILTI = PlanOptions(metres_per_unit=0.01)
REAL_PLANS = (
    RealPlan("office", "floorplans/dxf/office_metres.dxf", 301),
    RealPlan("house", "floorplans/ifc/AC20-FZK-Haus.ifc", 302),
    RealPlan("duplex", "floorplans/ifc/duplex.ifc", 303),
    RealPlan("site", "hilti/floor_1.png", 304, HILTI),
    RealPlan("site, real walk", "hilti/floor_1.png", 305, HILTI, "hilti/floor_1_walk.tum", 4206),
)


def _in_plan(plan: RealPlan) -> Inputs:
    """A walk of 200 frames, 80 m at most unless it is given, in a plan.

    Raises:
        PlanfitError: the plan is not at hand, or nobody can walk in it.
    """
    floorplan = planfit.read_floorplan(SHARED / plan.path, plan.options)
    own: dict[str, object] = {"max_length_m": 80.0}
    if plan.walk:
        offset_m = (0.0, -0.01 * plan.height_px)
        own = {"path": SHARED / plan.walk, "path_offset_m": offset_m}
    walk = replace(WalkOptions(n_frames=200), **own)
    options = SynthOptions(seed=plan.seed, walk=walk, camera=CAMERA)
    make: Callable[..., SyntheticScan] = make_scan
    return inputs_of(make(options, floorplan))


def all_scans() -> dict[str, BaseScan]:
    """By name."""
    return {
        scan.name: scan
        for scan in (*REAL, *SYNTHETIC, *PHONES, *AT_RATE, *WALKS, *NICHES, *rendered_walks())
    }


@dataclass(frozen=True)
class KeptFiles(FilesView):
    """Images of a scan, rendered once and kept in arrays on disk."""

    colors: UInt8[np.ndarray, "n h w 3"]
    depths: Float[np.ndarray, "n h w"]
    label_images: UInt8[np.ndarray, "n h w"]

    def color(self, frame_idx: int) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB."""
        return np.array(self.colors[frame_idx])

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m, NaN where nothing was measured."""
        return np.array(self.depths[frame_idx])

    def labels(self, frame_idx: int) -> UInt8[np.ndarray, "h w"]:
        """Label image of `Label`."""
        return np.array(self.label_images[frame_idx])


def keep_images(scan: Scan, folder: Path) -> Scan:
    """The scan with its images in `folder`, rendered now if they are not there yet."""
    n = len(scan)
    folder.mkdir(parents=True, exist_ok=True)
    kinds = {"color": scan.files.color, "depth": scan.files.depth, "labels": scan.files.labels}
    paths = {kind: folder / f"{kind}-{scan.fingerprint}.npy" for kind in kinds}
    if not all(path.exists() for path in paths.values()):
        # Colour, depth and labels of a frame one after the other: it is then rendered once.
        images = [[read(i) for read in kinds.values()] for i in range(n)]
        for k, path in enumerate(paths.values()):
            # Cases of one scan run side by side: each process writes a file of its own.
            part = path.with_suffix(f".{os.getpid()}.part.npy")
            np.save(part, np.stack([image[k] for image in images]))
            part.replace(path)
    arrays = [np.load(path, mmap_mode="r") for path in paths.values()]
    return replace(scan, files=KeptFiles(scan.files, *arrays))
