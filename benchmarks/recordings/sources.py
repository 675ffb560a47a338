"""The recordings of the battery: pieces of scans whose poses are known, real, semi-real and synthetic."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from buildings.sites import Building, buildings
from faults.inputs import DRIFT, Inputs
from faults.scans import SYNTHETIC, inputs_of, keep_images
from jaxtyping import Float

import planfit
from planfit.scan import Scan
from planfit.scan.views import select_frames
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    NoDepthNoise,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
    drift_poses,
    make_scan,
)

N_FRAMES = 32
"""Of a piece: the first or the last frames of a scan, so that the battery's halves show other places."""
TRACKED_M = 0.6
"""Step over which trackers err as `DRIFT` says; over a shorter one by the root of its share."""
IMAGE_HZ = 30.0
_SYNTHETIC = ("flat", "flat, phone", "one room", "open plan", "corridor", "hall")
_BUILDINGS = (
    "kitchen",
    "conslam",
    "lounge",
    "lounge, rendered",
    "acapulco",
    "freiburg-101",
    "seattle",
)
_SITUATIONS = ("split", "glass")
AT_RATE = ("one room, 30 Hz", "two rooms, 30 Hz")
"""Walks of twelve seconds whose images are taken at video rate."""
NAMES = (*_SYNTHETIC, *_BUILDINGS, *_SITUATIONS)
"""An odd number, so that cases which go round them have each in both halves."""


@dataclass(frozen=True)
class Recording:
    """A scan with its true poses."""

    scan: Scan
    true_world_from_cams: Float[np.ndarray, "n 4 4"]
    up_world: Float[np.ndarray, "3"]
    floorplan: planfit.Floorplan

    def tracked(self, rng: np.random.Generator, factor: float = 1.0) -> Float[np.ndarray, "n 4 4"]:
        """Poses as a tracker records them that errs so many times as much as usual."""
        true = self.true_world_from_cams
        step_m = np.median(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1))
        share = factor * float(np.sqrt(min(1.0, step_m / TRACKED_M)))
        drift = DriftOptions(
            yaw_deg=share * DRIFT.yaw_deg, translation_m=share * DRIFT.translation_m
        )
        return drift_poses(true, drift, rng, self.up_world)


def absent(name: str) -> str:
    """What of a source is not on this machine, in a line; empty where all is."""
    building = _building(name)
    return "" if building is None else building.absent()


@lru_cache(maxsize=1)
def piece(name: str, is_last: bool, cache_dir: Path, n_frames: int = N_FRAMES) -> Recording:
    """The first or the last frames of a scan, at their true poses.

    Raises:
        PlanfitError: its files are not at hand, or not whole.
    """
    inputs = whole(name, cache_dir)
    n = len(inputs.scan)
    idx = np.arange(n - n_frames, n) if is_last else np.arange(n_frames)
    true = inputs.true_world_from_cams[idx]
    scan = select_frames(inputs.scan, idx, true)
    if name in _SYNTHETIC:
        scan = keep_images(scan, cache_dir / "images")
    return Recording(scan, true, inputs.up_world, inputs.floorplan)


@lru_cache(maxsize=1)
def whole(name: str, cache_dir: Path) -> Inputs:
    """A scan with its true poses.

    Raises:
        PlanfitError: its files are not at hand, or not whole.
    """
    building = _building(name)
    if building is not None:
        return building.inputs(cache_dir)
    return next(scan for scan in SYNTHETIC if scan.name == name).make()


def _building(name: str) -> Building | None:
    return next((building for building in buildings() if building.name == name), None)


def walk_at_rate(name: str) -> Recording:
    """One of `AT_RATE`."""
    k = AT_RATE.index(name)
    options = SynthOptions(
        seed=401 + k,
        building=BuildingOptions(n_rooms=1 + k),
        walk=WalkOptions(n_frames=360, area_per_stop_m2=3.0),
        camera=CameraOptions(width_px=160, height_px=120),
        depth_noise=TimeOfFlightNoise() if k else NoDepthNoise(),
        has_labels=False,
    )
    inputs = inputs_of(make_scan(options))
    scan = replace(inputs.scan, timestamps=np.arange(len(inputs.scan)) / IMAGE_HZ)
    return Recording(scan, inputs.true_world_from_cams, inputs.up_world, inputs.floorplan)
