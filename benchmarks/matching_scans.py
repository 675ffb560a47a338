"""Synthetic scans for the matching benchmark, written once to a folder in the FACaP layout, with truth."""

import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import planfit
from planfit.geometry import se3
from planfit.scan import Scan, read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD, UP_WORLD
from planfit.scan.types import Scan as ScanType
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    Renderer,
    SynthOptions,
    WalkOptions,
    drift_poses,
    make_camera,
    make_lights,
    make_quads,
    make_scan,
    walk_through,
    write_facap,
)
from planfit.synth.quads import Lights, Quads
from planfit.synth.scan import SyntheticScan, SynthFiles, frame_name

CACHE = Path(os.environ.get("PLANFIT_BENCH_CACHE", Path(tempfile.gettempdir()) / "planfit-bench"))
DRIFT_SHARE = 0.02
"""Median error of the recorded positions over the second half of a walk, as a share of the way walked."""


@dataclass(frozen=True)
class TestScan:
    """A scan read back from files, and where its cameras truly were."""

    name: str
    scan: Scan
    true_world_from_cams: np.ndarray  # (n, 4, 4)
    wing: np.ndarray  # (n,) which of two look-alike wings a frame is in; zeros elsewhere


def walk_scan(
    seed: int, n_frames: int, n_rooms: int, width_px: int, area_per_stop_m2: float = 4.0
) -> TestScan:
    """A walk that comes back to its rooms again and again."""
    options = SynthOptions(
        seed=seed,
        building=BuildingOptions(n_rooms=n_rooms),
        walk=WalkOptions(n_frames=n_frames, area_per_stop_m2=area_per_stop_m2),
        camera=CameraOptions(width_px=width_px, height_px=width_px * 3 // 4),
        has_labels=False,
    )
    name = f"walk-{seed}-{n_frames}-{n_rooms}-{width_px}-{area_per_stop_m2:g}"
    return _on_disk(name, lambda: _drifted(make_scan(options), seed), np.zeros(n_frames, dtype=int))


def look_alike_scan(seed: int, n_frames: int, width_px: int, order: str = "ABA") -> TestScan:
    """One furnished room and its exact copy beside it, textures included; a lap for each letter.

    Between laps the camera goes straight from one to the other, through the wall.
    """
    options = SynthOptions(
        seed=seed,
        building=BuildingOptions(n_rooms=1, room_size_m=(3.4, 3.8)),
        camera=CameraOptions(width_px=width_px, height_px=width_px * 3 // 4),
        has_labels=False,
    )
    n_between = 10
    n_lap = (n_frames - n_between * (len(order) - 1)) // len(order)
    n = n_lap * len(order) + n_between * (len(order) - 1)

    def make() -> SyntheticScan:
        plain = make_scan(options)
        aside = np.array([float(plain.floorplan.size[0]) + 0.3, 0.0, 0.0])
        quads = make_quads(plain.building, np.random.default_rng([seed, 1]))
        renderer = Renderer(_twice(quads, aside), _lights_twice(make_lights(plain.building), aside))
        laps = []
        for k, wing in enumerate(order):
            walk = WalkOptions(n_frames=n_lap, area_per_stop_m2=1.5)
            lap = walk_through(plain.building, walk, np.random.default_rng([seed, 2, k]))
            lap[:, :3, 3] += aside * "AB".index(wing)
            if laps:
                laps.append(_straight(laps[-1][-1], lap[0], n_between))
            laps.append(lap)
        plan_from_cams = np.concatenate(laps)
        files = SynthFiles(renderer, make_camera(options.camera), plan_from_cams, options)
        true = se3.inverse(PLAN_FROM_WORLD) @ plan_from_cams
        scan = replace(
            plain.scan,
            frame_ids=tuple(frame_name(i) for i in range(n)),
            timestamps=np.arange(1.0, n + 1.0),
            cameras=(plain.scan.cameras[0],) * n,
            world_from_cams=true,
            files=files,
        )
        doubled = replace(
            plain, scan=scan, true_world_from_cams=true, true_plan_from_cams=plan_from_cams
        )
        return _drifted(doubled, seed)

    wing = np.full(n, -1)
    for k, letter in enumerate(order):
        first = k * (n_lap + n_between)
        wing[first : first + n_lap] = "AB".index(letter)
    return _on_disk(f"alike-{seed}-{n}-{width_px}-{order}", make, wing)


def _on_disk(name: str, make, wing: np.ndarray) -> TestScan:
    folder = CACHE / "matching-scans" / name
    if not folder.exists():
        part = folder.with_name(f"{name}.part{os.getpid()}")
        write_facap(part, make())
        part.rename(folder)
    scan: ScanType = planfit.read_scan(folder)
    _, true = read_tum(folder / "groundtruth.tum")
    return TestScan(name, scan, true, wing)


def _drifted(synthetic: SyntheticScan, seed: int) -> SyntheticScan:
    """Recorded poses that are off by 2 % of the way walked."""
    true = synthetic.true_world_from_cams
    walked = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1))]
    )
    late = np.arange(len(true)) > len(true) // 2
    unit = DriftOptions()
    low, high = 0.0, 20.0
    drifted = true
    for _ in range(30):
        scale = (low + high) / 2
        options = replace(
            unit, yaw_deg=unit.yaw_deg * scale, translation_m=unit.translation_m * scale
        )
        drifted = drift_poses(true, options, np.random.default_rng([seed, 77]), UP_WORLD)
        off = np.linalg.norm(drifted[:, :3, 3] - true[:, :3, 3], axis=1)
        too_far = np.median(off[late] / walked[late]) > DRIFT_SHARE
        low, high = (low, scale) if too_far else (scale, high)
    return replace(synthetic, scan=replace(synthetic.scan, world_from_cams=drifted))


def _straight(start: np.ndarray, end: np.ndarray, n: int) -> np.ndarray:
    """Poses (n, 4, 4) between two, evenly spaced, without the two."""
    share = np.linspace(0, 1, n + 2)[1:-1]
    return se3.retract(
        np.repeat(start[None], n, axis=0), share[:, None] * se3.difference(end[None], start[None])
    )


def _twice(quads: Quads, aside: np.ndarray) -> Quads:
    fields = {name: np.concatenate([value, value]) for name, value in vars(quads).items()}
    fields["origin"] = np.concatenate([quads.origin, quads.origin + aside])
    room = quads.room
    fields["room"] = np.concatenate([room, np.where(room >= 0, room + 1, room)])
    return Quads(**fields)


def _lights_twice(lights: Lights, aside: np.ndarray) -> Lights:
    feet = lights.footprints.copy()
    feet[:, :2] += aside[:2]
    return Lights(
        np.concatenate([lights.lamps, lights.lamps + aside]),
        np.concatenate([lights.lamp_room, lights.lamp_room + 1]),
        np.concatenate([lights.footprints, feet]),
        np.concatenate([lights.footprint_room, lights.footprint_room + 1]),
    )
