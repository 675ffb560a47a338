"""A small synthetic scan on disk and a run of it, made once for all processes, and copies to spoil."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

from planfit.cli import run
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


def made_once(
    tmp_path_factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]
) -> Path:
    """A folder that the first process to ask for it makes, and that all others wait for."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent  # of the folders of all workers
    folder, is_made = root / f"shared-{name}", root / f"shared-{name}.made"
    with FileLock(root / f"shared-{name}.lock"):
        if not is_made.exists():
            shutil.rmtree(folder, ignore_errors=True)  # of one that failed
            folder.mkdir()
            make(folder)
            is_made.touch()
    return folder


@pytest.fixture(scope="session")
def small_scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a drifted scan of two rooms, with masks, plan and truth. Do not change it."""
    synthetic = made_once(
        tmp_path_factory,
        "synthetic",
        lambda folder: write_facap(folder / "scan", make_scan(SMALL)),
    )
    return synthetic / "scan"


@pytest.fixture(scope="session")
def brief(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Flags of a run whose report nothing is asked of: a third of the time is its 3D view, and another what
    the images show, which one run of a scan finds for all."""
    cache = made_once(tmp_path_factory, "cache", lambda _: None)
    return ["--cache", str(cache), "--report.no-has-view"]


@pytest.fixture(scope="session")
def fitted(small_scan: Path, brief: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run of the scan with its plan, without a cache of its own. Do not change it."""

    def make(folder: Path) -> None:
        assert run(["refine", str(small_scan), "-o", str(folder / "out"), *brief]) == 0

    return made_once(tmp_path_factory, "fitted", make) / "out"


@pytest.fixture
def spoiled_scan(small_scan: Path, tmp_path: Path) -> Path:
    """A copy of the scan that a test may change; files are links until they are replaced."""
    folder = tmp_path / "scan"
    shutil.copytree(small_scan, folder, copy_function=os.link)
    return folder
