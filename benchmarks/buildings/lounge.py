"""The HoloLens lounge with its plan's walls, rendered as depth from the true poses of its recording.

Real are the walk with the headset and the walls as drawn; furniture is not there, and the depth is not the
recorded one. `rendered_in` serves other buildings whose walls and walks are known, too.
"""

import hashlib

import numpy as np
from faults.inputs import Inputs
from faults.scans import SHARED
from jaxtyping import Float

import planfit
from planfit.errors import ScanError
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.scan import Scan, read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD, UP_WORLD
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    Renderer,
    SynthOptions,
    TimeOfFlightNoise,
    make_camera,
)
from planfit.synth.mesh import make_plan_quads, no_lights
from planfit.synth.plan_building import make_plan_building
from planfit.synth.scan import SynthFiles, frame_name

CAMERA = CameraOptions(width_px=160, height_px=120, fov_deg=70.0)
"""Few pixels: depth alone needs no more, and a scan is refined in 10 to 25 s of CPU time."""
EVERY = 3
"""Frames are 8 cm and 4 deg apart (medians): 125 of the 373 are as far apart as those of other scans."""
EYES_M = 1.6
"""Median height of a headset over the floor: the recording's own zero is where it was switched on."""


def lounge_rendered() -> Inputs:
    """Depth rendered along the walk in the lounge, with its true poses as recorded ones.

    Raises:
        PlanfitError: plan or poses are not at hand.
    """
    folder = SHARED / "buildings" / "lounge"
    path = folder / "groundtruth.tum"
    if not path.is_file():
        raise ScanError(f"{path}: expected true poses of the lounge, found no file; see its README")
    plan = planfit.read_floorplan(folder / "floorplan.npy")
    _, world_from_cams = read_tum(path)
    plan_from_cams = PLAN_FROM_WORLD @ world_from_cams[::EVERY]
    plan_from_cams[:, 2, 3] += EYES_M - np.median(plan_from_cams[:, 2, 3])
    options = depth_options(seed=11, noise=TimeOfFlightNoise())
    return rendered_in("lounge, rendered", plan, plan, plan_from_cams, options)


def depth_options(seed: int, noise: TimeOfFlightNoise) -> SynthOptions:
    """Of depth alone, of bare walls; where walls are known from one side, they are thin."""
    return SynthOptions(
        seed=seed,
        building=BuildingOptions(pictures_per_wall=0.0, single_wall_m=0.02),
        camera=CAMERA,
        depth_noise=noise,
        has_color=False,
        has_labels=False,
    )


def rendered_in(
    name: str,
    world: Floorplan,
    plan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    options: SynthOptions,
) -> Inputs:
    """Depth alone of walls, floor and ceiling, seen from given poses.

    Args:
        name: of the scan.
        world: walls that are rendered, m.
        plan: what planfit is given, same axes.
        plan_from_cams: true poses; the floor is at z = 0.
        options: of the camera, its noise and the heights.
    """
    rng = np.random.default_rng([options.seed, 1])
    building = make_plan_building(world, options.building, rng)
    renderer = Renderer(make_plan_quads(building, rng), no_lights())
    world_from_cams = se3.inverse(PLAN_FROM_WORLD) @ plan_from_cams
    world_from_cams[:, :3, :3] = se3.project_to_so3(world_from_cams[:, :3, :3])
    n, camera = len(plan_from_cams), make_camera(options.camera)
    content = (repr(options).encode(), world.ends.tobytes(), plan_from_cams.tobytes())
    scan = Scan(
        name=name,
        frame_ids=tuple(frame_name(i) for i in range(n)),
        timestamps=np.arange(1.0, n + 1.0),
        cameras=(camera,) * n,
        world_from_cams=world_from_cams,
        files=SynthFiles(renderer, camera, plan_from_cams, options),
        has_color=False,
        has_labels=False,
        up_world=UP_WORLD,
        plan_from_world_axes=PLAN_FROM_WORLD,
        fingerprint=hashlib.sha256(b"".join(content)).hexdigest()[:16],
    )
    return Inputs(scan, plan, world_from_cams, PLAN_FROM_WORLD)
