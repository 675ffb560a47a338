"""The buildings of the table: what each is, how its scan is had, and what is known to be right about it."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from faults.inputs import Inputs
from faults.scans import (
    REAL_PLANS,
    SHARED,
    RealPlan,
    conslam,
    inputs_of,
    keep_images,
    kitchen,
)

import planfit
from buildings.changes import AS_RECORDED, DRIFTS, Change
from buildings.laser_floors import LASER_FLOORS, laser_floor
from buildings.lounge import lounge_rendered
from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.synth import CameraOptions, SynthOptions, WalkOptions, make_scan

ALL_KINDS = frozenset({"scale", "depth", "focal length", "thickness", "walls", "jumps"})
METRES_PER_PX = 0.01
"""Of the plan of the building site."""
SITUATIONS = ("slope", "split", "mirror", "glass", "corridor")
FRAMES_OF_SITUATIONS = {"slope": 220, "split": 220}
"""Frames that their maker is asked for; 130 of the others."""


@dataclass(frozen=True)
class Building:
    """A scan of a building and its plan."""

    name: str
    kind: str
    """`real`: recorded; `semi-real`: real walls and walk, rendered; `rendered`: rooms that are made up."""
    make: Callable[[Path], Inputs]
    """Given a folder to keep what takes long to make; with true poses as recorded ones, but for scans whose
    drift is their own."""
    is_rendered: bool = True
    """Whether its images take long to make, and are better kept."""
    base: Change = DRIFTS[0]
    """That of which something is left out for steadiness."""
    is_steadied: bool = False
    judged: frozenset[str] = ALL_KINDS
    """Kinds of corrections of which it is known that none is right."""
    chosen_on: str = ""
    """What of planfit was chosen on it; empty where nothing was."""
    path: str = ""
    """Its files, in the folder of test inputs."""
    first_image: str = ""
    """A depth image that must be one, where images are read."""

    def absent(self) -> str:
        """What of it is not on this machine, in a line; empty where all is."""
        path = SHARED / self.path
        if not path.exists():
            return f"{path} is absent (set PLANFIT_SHARED)"
        image = path / self.first_image
        if self.first_image and cv2.imread(str(image), cv2.IMREAD_UNCHANGED) is None:
            return f"{image} is no image: copy the folder with its images, not links to them"
        return ""

    def inputs(self, cache_dir: Path) -> Inputs:
        """Its inputs, images kept in a folder.

        Raises:
            PlanfitError: its files are not at hand, or not whole.
        """
        inputs = self.make(cache_dir)
        if self.is_rendered:
            inputs = replace(inputs, scan=keep_images(inputs.scan, cache_dir / "images"))
        return inputs


def buildings() -> tuple[Building, ...]:
    """All of them, those at hand and those that are not."""
    return (
        Building(
            "conslam",
            "real",
            lambda _: conslam(),
            is_rendered=False,
            base=AS_RECORDED,
            is_steadied=True,
            # Its plan is of the building as designed: walls may well stand 0.1 m elsewhere.
            judged=ALL_KINDS - {"walls"},
            chosen_on="nearly every constant",
            path="conslam",
            first_image="arcore/depth-0001.png",
        ),
        Building(
            "kitchen",
            "real",
            lambda _: kitchen(),
            is_rendered=False,
            is_steadied=True,
            # Its depth is known to disagree with its colour, and its plan was drawn through its own walls.
            judged=frozenset({"scale", "thickness", "jumps"}),
            chosen_on="calibration",
            path="kitchen",
            first_image="frame-000000.depth.png",
        ),
        Building(
            "lounge",
            "real",
            lambda _: lounge(),
            is_rendered=False,
            is_steadied=True,
            path="buildings/lounge",
            first_image="arcore/depth-0001.png",
        ),
        Building(
            "lounge, rendered",
            "semi-real",
            lambda _: lounge_rendered(),
            is_rendered=False,
            is_steadied=True,
            path="buildings/lounge/groundtruth.tum",
        ),
        *(
            Building(
                name,
                "semi-real",
                partial(_laser_floor, name),
                is_rendered=False,
                path=f"buildings/carmen2d/{name}.npz",
            )
            for name in LASER_FLOORS
        ),
        Building("hilti", "semi-real", lambda _: hilti(), chosen_on="plan pictures", path="hilti"),
        *(
            Building(
                name,
                "rendered",
                partial(situation, name),
                is_rendered=False,
                path="situations/cases.py",
            )
            for name in SITUATIONS
        ),
    )


def lounge() -> Inputs:
    """The lounge as a HoloLens recorded it, with its true poses.

    Raises:
        ScanError: it is not at hand.
    """
    folder = SHARED / "buildings" / "lounge"
    scan = planfit.read_scan(folder)
    _, true_world_from_cams = read_tum(folder / "groundtruth.tum")
    plan = planfit.read_floorplan(folder / "floorplan.npy")
    return Inputs(scan, plan, true_world_from_cams, PLAN_FROM_WORLD)


def hilti() -> Inputs:
    """The true walk through a building site, rendered in its plan, the plan given as a picture of no unit.

    Raises:
        PlanfitError: plan or walk are not at hand.
    """
    site = next(plan for plan in REAL_PLANS if plan.walk)
    built = planfit.read_floorplan(SHARED / site.path, site.options)
    inputs = inputs_of(make_scan(_walk_of(site), built))
    picture = planfit.read_floorplan(SHARED / site.path)
    return replace(inputs, floorplan=picture, given_from_true=np.eye(2) / METRES_PER_PX)


def _walk_of(site: RealPlan) -> SynthOptions:
    # The plan's origin is the picture's top left, that of the walk the bottom left.
    offset_m = (0.0, -METRES_PER_PX * site.height_px)
    walk = WalkOptions(n_frames=200, path=SHARED / site.walk, path_offset_m=offset_m)
    camera = CameraOptions(width_px=320, height_px=240)
    return SynthOptions(seed=site.seed, walk=walk, camera=camera)


def situation(name: str, cache_dir: Path) -> Inputs:
    """Rooms that are no boxes, made by a ray caster of their own.

    Raises:
        ScanError: their maker is not at hand, or fails.
    """
    maker = SHARED / "situations" / "cases.py"
    if not maker.is_file():
        raise ScanError(f"{maker}: expected the maker of situations, found no file")
    folder = cache_dir / "situations" / name
    if not (folder / "floorplan.npy").is_file():
        _make_situation(maker, name, folder)
    scan = planfit.read_scan(folder)
    _, true_plan_from_cams = read_tum(folder / "truth_plan_from_cam.tum")
    plan = planfit.read_floorplan(folder / "floorplan.npy")
    true_world_from_cams = se3.inverse(PLAN_FROM_WORLD) @ true_plan_from_cams
    return Inputs(scan, plan, true_world_from_cams, PLAN_FROM_WORLD)


def _make_situation(maker: Path, name: str, folder: Path) -> None:
    """Into a folder of its own first: another process may make the same."""

    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as part:
        made = Path(part) / name
        environment = {**os.environ, "N": str(FRAMES_OF_SITUATIONS.get(name, 130))}
        done = subprocess.run(
            [sys.executable, maker, name, made, "1"],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            last = done.stderr.strip().splitlines()[-1:]
            raise ScanError(f"{maker}: expected the situation {name}, found {' '.join(last)}")
        if not folder.exists():
            shutil.move(made, folder)


def _laser_floor(name: str, _cache_dir: Path) -> Inputs:
    return laser_floor(name)
