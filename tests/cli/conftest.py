"""A small synthetic scan on disk, made once, and copies of it to spoil."""

import os
import shutil
from pathlib import Path

import pytest

from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
    write_facap,
)

SMALL = SynthOptions(
    seed=3,
    building=BuildingOptions(n_rooms=2),
    walk=WalkOptions(n_frames=60),
    camera=CameraOptions(width_px=320, height_px=240),
    drift=DriftOptions(yaw_deg=0.4, translation_m=0.03),
)


@pytest.fixture(scope="session")
def small_scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a drifted scan of two rooms, with masks, plan and truth. Do not change it."""
    folder = tmp_path_factory.mktemp("synthetic") / "scan"
    write_facap(folder, make_scan(SMALL))
    return folder


@pytest.fixture(scope="session")
def brief(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Flags of a run whose report nothing is asked of: a third of the time is its 3D view, and another what
    the images show, which one run of a scan finds for all."""
    return ["--cache", str(tmp_path_factory.mktemp("cache")), "--report.no-has-view"]


@pytest.fixture
def spoiled_scan(small_scan: Path, tmp_path: Path) -> Path:
    """A copy of the scan that a test may change; files are links until they are replaced."""
    folder = tmp_path / "scan"
    shutil.copytree(small_scan, folder, copy_function=os.link)
    return folder
