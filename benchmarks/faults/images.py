"""Faults of what the images show: depth and focal length off, look-alike posters, views of another place."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from faults.inputs import Fault, Inputs, Rendered
from planfit.geometry import segments
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.geometry.camera import Camera
from planfit.scan import ScanFiles
from planfit.scan.types import Label
from planfit.scan.views import FilesView, SelectedFiles
from planfit.synth import Renderer, make_lights, make_quads
from planfit.synth.building import Part
from planfit.synth.mesh import Quads
from planfit.synth.quads import FABRIC_COLORS, Material
from planfit.synth.scan import SynthFiles

DEPTH_ERRORS = (0.01, 0.02, 0.05)
FOCAL_ERRORS = (0.01, 0.03, 0.05)
COPIED_FRAMES = (1, 3, 8)
POSTERS = ((1, 0.35), (2, 0.7), (4, 1.0))
"""Kinds of posters, and the share of walls that have them."""


@dataclass(frozen=True)
class SpoiltFiles(SelectedFiles):
    """Images of other frames, or depth as a faulty sensor has it, under each frame's own name."""

    undone_by: SensorCalibration = NOMINAL
    """What makes the depths right again."""

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m, NaN where nothing was measured, or nothing above 0 is left."""
        return measured_depths(super().depth(frame_idx), self.undone_by)

    write_poses = FilesView.write_poses


def _with_files(inputs: Inputs, files: ScanFiles, what: str) -> Inputs:
    fingerprint = f"{inputs.scan.fingerprint} {what}"
    return replace(inputs, scan=replace(inputs.scan, files=files, fingerprint=fingerprint))


def measured_depths(
    depths_m: Float[np.ndarray, "h w"], undone_by: SensorCalibration
) -> Float[np.ndarray, "h w"]:
    """What a faulty sensor measures where the true depths are these; its calibration gives them back.

    The root of offset + scale m + quadratic m^2 = z that is z without fault.
    """
    scale, quadratic = undone_by.depth_scale, undone_by.depth_quadratic_per_m
    beyond = depths_m.astype(float) - undone_by.depth_offset_m
    with np.errstate(invalid="ignore"):
        measured = 2 * beyond / (scale + np.sqrt(scale**2 + 4 * quadratic * beyond))
        return np.where(measured > 0, measured, np.nan).astype(np.float32)


def nominal_camera(true: Camera, undone_by: SensorCalibration) -> Camera:
    """What a camera's file says wrongly; `undone_by.camera` of it is the true camera."""
    fx = true.fx / undone_by.focal_scale
    return replace(
        true,
        fx=fx,
        fy=true.fy / (undone_by.focal_scale * undone_by.focal_aspect),
        cx=true.cx - fx * undone_by.principal_x,
        cy=true.cy - fx * undone_by.principal_y,
    )


def with_faulty_sensor(inputs: Inputs, undone_by: SensorCalibration, what: str) -> Inputs:
    """The same scan, its depth images and cameras wrong; the calibration puts them right."""
    files = SpoiltFiles(inputs.scan.files, np.arange(len(inputs.scan)), undone_by)
    cameras = tuple(nominal_camera(camera, undone_by) for camera in inputs.scan.cameras)
    spoilt = _with_files(inputs, files, what)
    return replace(spoilt, scan=replace(spoilt.scan, cameras=cameras))


def long_depth(inputs: Inputs, size: int, _rng: np.random.Generator) -> Inputs:
    """All depths longer than they are."""
    undone_by = SensorCalibration(depth_scale=1 / (1 + DEPTH_ERRORS[size]))
    return with_faulty_sensor(inputs, undone_by, f"depth {DEPTH_ERRORS[size]}")


def wrong_focal_length(inputs: Inputs, size: int, _rng: np.random.Generator) -> Inputs:
    """A focal length longer than it is."""
    undone_by = SensorCalibration(focal_scale=1 / (1 + FOCAL_ERRORS[size]))
    return with_faulty_sensor(inputs, undone_by, f"focal {FOCAL_ERRORS[size]}")


def copied_views(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """Some frames show what frames a third of the walk before showed: a room of the same kind, to the hair.

    Only the recorded motion, and the plan, say that it is another place.
    """
    n, count = len(inputs.scan), COPIED_FRAMES[size]
    source = int(rng.integers(n // 10, n // 2))
    target = source + n // 3
    shown = np.arange(n)
    shown[target : target + count] = shown[source : source + count]
    what = f"copied {source} {target} {count}"
    return _with_files(inputs, SpoiltFiles(inputs.scan.files, shown), what)


def posters(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """The same posters hang in many places; walk, noise and drift are as without.

    Raises:
        ValueError: the scan is no synthetic one.
    """
    if inputs.rendered is None:
        raise ValueError(f"{inputs.scan.name}: expected a synthetic scan to hang posters in")
    bare = inputs.rendered
    n_kinds, share = POSTERS[size]
    hung = hang_posters(bare, n_kinds, share, rng)
    renderer = Renderer(hung, make_lights(bare.building))
    camera = inputs.scan.cameras[0]
    files = SynthFiles(renderer, camera, bare.true_plan_from_cams, bare.options)
    return _with_files(inputs, files, f"posters {n_kinds} {share} {rng.integers(2**31)}")


def hang_posters(rendered: Rendered, n_kinds: int, share: float, rng: np.random.Generator) -> Quads:
    """The building's surfaces, and posters of a few kinds, each of one size, colour and texture."""
    building = rendered.building
    # The stream that `make_scan` paints surfaces from, so that these stay what they are.
    bare = make_quads(building, np.random.default_rng([rendered.options.seed, 1]))
    faces = building.faces
    is_wall = (faces.parts == Part.FULL) & (faces.rooms >= 0) & ~faces.is_column
    lengths = segments.lengths(faces.ends)
    walls = np.flatnonzero(is_wall & (lengths > 1.4))
    walls = rng.permutation(walls)[: max(2, round(share * len(walls)))]
    kind = rng.integers(n_kinds, size=len(walls))
    size = np.column_stack([rng.uniform(0.6, 1.0, n_kinds), rng.uniform(0.7, 1.0, n_kinds)])[kind]
    seed = rng.integers(2**63, size=n_kinds, dtype=np.uint64)[kind]
    along = segments.directions(faces.ends)[walls]
    normal = segments.left_normals(faces.ends)[walls]
    at = faces.ends[walls].mean(axis=1) - along * size[:, :1] / 2 + 0.03 * normal
    rotation = building.plan_from_building[:3, :3]

    def upright(xy: np.ndarray, z: float) -> np.ndarray:
        return np.column_stack([xy, np.full(len(xy), z)]) @ rotation.T

    colors = np.array(FABRIC_COLORS)[kind % len(FABRIC_COLORS)]
    return Quads(
        origin=np.concatenate([bare.origin, upright(at, 1.1)]),
        u_axis=np.concatenate([bare.u_axis, upright(along, 0.0)]),
        v_axis=np.concatenate([bare.v_axis, np.tile([0.0, 0.0, 1.0], (len(walls), 1))]),
        size=np.concatenate([bare.size, size]),
        normal=np.concatenate([bare.normal, upright(normal, 0.0)]),
        label=np.concatenate([bare.label, np.full(len(walls), Label.OTHER, dtype=np.uint8)]),
        material=np.concatenate([bare.material, np.full(len(walls), int(Material.NOTES))]),
        color=np.concatenate([bare.color, colors]),
        room=np.concatenate([bare.room, faces.rooms[walls]]),
        seed=np.concatenate([bare.seed, seed]),
    )


def _words(errors: tuple[float, ...], how: Callable[[float], str]) -> tuple[str, ...]:
    return tuple(how(error) for error in errors)


IMAGES = (
    Fault("depth long", "images", _words(DEPTH_ERRORS, "{:.0%}".format), long_depth),
    Fault("focal length long", "images", _words(FOCAL_ERRORS, "{:.0%}".format), wrong_focal_length),
    Fault("copied views", "images", tuple(f"{n} frames" for n in COPIED_FRAMES), copied_views),
)

LOOK_ALIKES = (
    Fault(
        "same posters", "images", tuple(f"{k} kinds, {s:.0%} of walls" for k, s in POSTERS), posters
    ),
)
