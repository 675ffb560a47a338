"""The synthetic scan: a `Scan` with drifted poses whose images are rendered when asked for."""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any, Generic, TypeVar, overload

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import OptionError, ScanError
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.scan.formats.facap import PLAN_FROM_WORLD, UP_WORLD
from planfit.scan.poses import write_pose
from planfit.scan.types import Scan
from planfit.synth.building import Building, make_building
from planfit.synth.mesh import make_lights, make_plan_quads, make_quads, no_lights
from planfit.synth.options import CameraOptions, SynthOptions
from planfit.synth.plan_building import PlanBuilding, make_plan_building
from planfit.synth.render import Renderer, View
from planfit.synth.route import DOOR_CLEARANCE_M, find_plan_route, read_path
from planfit.synth.sensor_noise import drift_poses, noisy_color, noisy_depth
from planfit.synth.storeys import (
    make_storeyed_lights,
    make_storeyed_quads,
    make_storeys,
    walk_through_storeys,
)
from planfit.synth.walk import walk_along, walk_through

# Streams of the seed: what one part draws does not depend on what another part draws.
_BUILDING, _SURFACES, _WALK, _DRIFT, _WORLD, _COLOR, _DEPTH, _VISIT = range(8)


StoreyT_co = TypeVar("StoreyT_co", bound=Building | PlanBuilding, covariant=True)


@dataclass(frozen=True)
class SyntheticScan(Generic[StoreyT_co]):
    """A scan together with the truth about it."""

    scan: Scan
    """As a user would have it: drifted poses, noisy images."""
    true_world_from_cams: Float[np.ndarray, "n 4 4"]
    """Poses before drift, in the axes of the world of the scan."""
    true_plan_from_cams: Float[np.ndarray, "n 4 4"]
    """The same in the plan frame."""
    floorplans: tuple[Floorplan, ...]
    """The true plans, without error, one a storey from the lowest; all in one plan frame."""
    floors_z: tuple[float, ...]
    """Height of the floor of each storey in the plan frame, m."""
    frame_storeys: Int[np.ndarray, " n"]
    """Index of the storey that each frame is on; `ON_STAIRS` (-1) between two."""
    storeys: tuple[StoreyT_co, ...]
    """What was built, from the lowest; each in a frame of its own with z = 0 at its floor."""
    renderer: Renderer
    options: SynthOptions

    @property
    def floorplan(self) -> Floorplan:
        """The true plan; of several storeys, that of the lowest."""
        return self.floorplans[0]

    @property
    def building(self) -> StoreyT_co:
        """What was built; of several storeys, the lowest."""
        return self.storeys[0]

    @property
    def true_plan_from_world(self) -> Float[np.ndarray, "4 4"]:
        """The same for all frames."""
        return self.true_plan_from_cams[0] @ se3.inverse(self.true_world_from_cams[0])


class SynthFiles:
    """Images of a synthetic scan, rendered one frame at a time.

    A frame's noise depends on the seed and its number alone, so it is the same whenever it is asked
    for. The last view is kept, for callers that ask for colour, then depth, then labels. Safe to
    use from several threads.
    """

    def __init__(
        self,
        renderer: Renderer,
        camera: Camera,
        plan_from_cams: Float[np.ndarray, "n 4 4"],
        options: SynthOptions,
    ) -> None:
        self._renderer = renderer
        self._camera = camera
        self._plan_from_cams = plan_from_cams
        self._options = options
        self._lock = Lock()
        self._last: tuple[int, View] | None = None

    def color(self, frame_idx: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """Colour image, RGB; None where the scan was made without."""
        if not self._options.has_color:
            return None
        rng = _of_visit(self._options, _COLOR, frame_idx)
        return noisy_color(self._view(frame_idx).color, self._options.camera, rng)

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth along the optical axis, float32, m, NaN where there is no measurement."""
        view = self._view(frame_idx)
        rng = _of_visit(self._options, _DEPTH, frame_idx)
        return noisy_depth(view.depth, view.incidence, self._options.depth_noise, rng)

    def labels(self, frame_idx: int) -> UInt8[np.ndarray, "h w"]:
        """Label image, values of `Label`.

        Raises:
            ScanError: the scan was made without labels.
        """
        if not self._options.has_labels:
            raise ScanError("synthetic scan: expected labels, found has_labels off; switch it on")
        return self._view(frame_idx).labels.copy()

    def write_poses(
        self,
        directory: Path,
        world_from_cams: Float[np.ndarray, "n 4 4"],
        frame_idx: Int[np.ndarray, " n"] | None = None,
    ) -> None:
        """Write `pose-NNNN.txt` files, as in the FACaP layout."""
        frames = range(len(world_from_cams)) if frame_idx is None else frame_idx
        for i, pose in zip(frames, world_from_cams, strict=True):
            write_pose(directory / f"pose-{frame_name(i)}.txt", pose)

    def _view(self, frame_idx: int) -> View:
        with self._lock:
            last = self._last
        if last is not None and last[0] == frame_idx:
            return last[1]
        view = self._renderer.render(self._camera, self._plan_from_cams[frame_idx])
        with self._lock:
            self._last = (frame_idx, view)
        return view


@overload
def make_scan(
    options: SynthOptions | None = None, floorplan: None = None
) -> SyntheticScan[Building]: ...
@overload
def make_scan(
    options: SynthOptions | None, floorplan: Floorplan
) -> SyntheticScan[PlanBuilding]: ...
@overload
def make_scan(
    options: SynthOptions | None, floorplan: Floorplan | None
) -> SyntheticScan[Building | PlanBuilding]: ...
def make_scan(
    options: SynthOptions | None = None, floorplan: Floorplan | None = None
) -> SyntheticScan[Any]:
    """Make a synthetic scan; nothing is rendered before it is asked for.

    Args:
        options: of the building, the walk, the camera and the drift.
        floorplan: walls to build, in metres, instead of a building that is made up; options of rooms, doors
            and furniture then have no effect.

    Raises:
        OptionError: the options contradict each other, the plan is not in metres, or has no free space that
            one could walk through.
        ScanError: the file of a given path cannot be read.
    """
    options = SynthOptions() if options is None else options
    built = _make_up(options) if floorplan is None else _build_plan(options, floorplan)
    world_from_plan = _world_from_plan(options, built.storeys[0])
    world_from_cams = world_from_plan @ built.plan_from_cams
    world_from_cams[:, :3, :3] = se3.project_to_so3(world_from_cams[:, :3, :3])
    drifted = drift_poses(world_from_cams, options.drift, _of_visit(options, _DRIFT), UP_WORLD)
    n = len(built.plan_from_cams)
    camera = make_camera(options.camera)
    digest = hashlib.sha256((repr(options) + built.digest).encode()).hexdigest()[:16]
    scan = Scan(
        name=f"synthetic scan, seed {options.seed}"
        + (f", visit {options.visit}" if options.visit else ""),
        frame_ids=tuple(frame_name(i) for i in range(n)),
        timestamps=np.arange(1.0, n + 1.0),
        cameras=(camera,) * n,
        world_from_cams=drifted,
        files=SynthFiles(built.renderer, camera, built.plan_from_cams, options),
        has_color=options.has_color,
        has_labels=options.has_labels,
        up_world=UP_WORLD,
        plan_from_world_axes=PLAN_FROM_WORLD if options.world == "plan" else None,
        fingerprint=digest,
    )
    plans = tuple(storey.floorplan for storey in built.storeys)
    if floorplan is None:
        prints = (digest, *(f"{digest}-{k}" for k in range(1, len(plans))))
        plans = tuple(replace(p, fingerprint=f) for p, f in zip(plans, prints, strict=True))
    return SyntheticScan(
        scan,
        world_from_cams,
        built.plan_from_cams,
        plans,
        built.floors_z,
        built.frame_storeys,
        built.storeys,
        built.renderer,
        options,
    )


@dataclass(frozen=True)
class _Built:
    """What is seen, and from where."""

    storeys: tuple[Building | PlanBuilding, ...]
    renderer: Renderer
    plan_from_cams: Float[np.ndarray, "n 4 4"]
    floors_z: tuple[float, ...]
    frame_storeys: Int[np.ndarray, " n"]
    digest: str = ""
    """Of all that the options do not say."""


def _make_up(options: SynthOptions) -> _Built:
    if options.walk.path is not None:
        raise OptionError(
            f"walk.path: expected a path only together with a plan, found {options.walk.path}; give the plan "
            "that it leads through (--plan), or leave the path out"
        )
    if options.building.n_storeys > 1:
        return _make_up_storeys(options)
    building = make_building(options.building, _rng(options.seed, _BUILDING))
    renderer = Renderer(make_quads(building, _rng(options.seed, _SURFACES)), make_lights(building))
    plan_from_cams = walk_through(building, options.walk, _of_visit(options, _WALK))
    return _on_one_storey(building, renderer, plan_from_cams, "")


def _make_up_storeys(options: SynthOptions) -> _Built:
    building = make_storeys(options.building, _rng(options.seed, _BUILDING))
    quads = make_storeyed_quads(building, _rng(options.seed, _SURFACES))
    renderer = Renderer(quads, make_storeyed_lights(building))
    rng = _of_visit(options, _WALK)
    plan_from_cams, frame_storeys = walk_through_storeys(building, options.walk, rng)
    return _Built(building.storeys, renderer, plan_from_cams, building.floors_z, frame_storeys)


def _on_one_storey(
    building: Building | PlanBuilding,
    renderer: Renderer,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    digest: str,
) -> _Built:
    storeys = np.zeros(len(plan_from_cams), dtype=int)
    return _Built((building,), renderer, plan_from_cams, (0.0,), storeys, digest)


def _build_plan(options: SynthOptions, floorplan: Floorplan) -> _Built:
    if options.building.n_storeys > 1:
        raise OptionError(
            f"n_storeys: expected 1 together with a plan, found {options.building.n_storeys}; "
            "leave one of them out"
        )
    path = None if options.walk.path is None else read_path(options.walk, floorplan)
    rng = _of_visit(options, _WALK)
    building = make_plan_building(
        floorplan,
        options.building,
        _rng(options.seed, _BUILDING),
        path,
        DOOR_CLEARANCE_M,
    )
    renderer = Renderer(make_plan_quads(building, _rng(options.seed, _SURFACES)), no_lights())
    if path is None:
        route = find_plan_route(building, options.walk, rng)
        wraps = options.walk.is_loop
    else:
        route, wraps = path, False  # it begins and ends where it does
    plan_from_cams = walk_along(
        route, building, options.walk, rng, wraps, turns_inwards=path is None
    )
    digest = hashlib.sha256(floorplan.ends.tobytes() + route.tobytes()).hexdigest()
    return _on_one_storey(building, renderer, plan_from_cams, digest)


def make_camera(options: CameraOptions) -> Camera:
    """Square pixels, centred."""
    focal = options.width_px / 2 / np.tan(np.deg2rad(options.fov_deg) / 2)
    return Camera(
        options.width_px,
        options.height_px,
        float(focal),
        float(focal),
        (options.width_px - 1) / 2,
        (options.height_px - 1) / 2,
    )


def frame_name(frame_idx: int) -> str:
    """What a frame is called: four digits, counted from 1."""
    return f"{frame_idx + 1:04d}"


def _rng(seed: int, *stream: int) -> np.random.Generator:
    return np.random.default_rng([seed, *stream])


def _of_visit(options: SynthOptions, *stream: int) -> np.random.Generator:
    """What visits to one building do not share."""
    if options.visit == 0:
        return _rng(options.seed, *stream)
    return _rng(options.seed, *stream, _VISIT, options.visit)


def _world_from_plan(
    options: SynthOptions, building: Building | PlanBuilding
) -> Float[np.ndarray, "4 4"]:
    axes = se3.inverse(PLAN_FROM_WORLD)
    if options.world == "plan":
        return axes
    rng = _of_visit(options, _WORLD)
    size = max(building.floorplan.size)
    translation = np.array([*rng.uniform(-size, size, 2), rng.uniform(-2.0, 2.0)])
    return axes @ se3.yaw_transform(float(rng.uniform(-np.pi, np.pi)), translation)
