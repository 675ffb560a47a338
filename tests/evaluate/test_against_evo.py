"""ATE and RPE against evo's command line on the same files; evo is called, never imported."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from builders import nudged, random_transforms
from planfit.evaluate import position_errors, step_errors
from planfit.scan import read_tum, write_tum

_FOLDERS = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
APE, RPE = (shutil.which(name, path=_FOLDERS) for name in ("evo_ape", "evo_rpe"))

pytestmark = pytest.mark.skipif(
    APE is None or RPE is None,
    reason="no evo: its commands evo_ape and evo_rpe are not on the path",
)


@pytest.fixture
def trajectories(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, Path]:
    """True poses along a walk, and drifted ones, as files."""
    truth = random_transforms(rng, 200, turn=1.0)
    truth[:, :3, 3] = np.cumsum(rng.normal(0.05, 0.05, (200, 3)), axis=0)
    paths = tmp_path / "truth.tum", tmp_path / "estimate.tum"
    for path, poses in zip(paths, (truth, nudged(rng, truth, 1.0, 0.05)), strict=True):
        write_tum(path, np.arange(200.0), poses)
    return paths


def evo_rms(
    command: str | None, trajectories: tuple[Path, Path], tmp_path: Path, *flags: str
) -> float:
    assert command is not None
    result = tmp_path / "result.zip"
    result.unlink(missing_ok=True)
    words = [command, "tum", *map(str, trajectories), *flags, "--save_results", str(result)]
    environment = {**os.environ, "HOME": str(tmp_path), "MPLBACKEND": "Agg"}
    subprocess.run(words, check=True, capture_output=True, env=environment, cwd=tmp_path)
    with zipfile.ZipFile(result) as archive:
        return float(json.loads(archive.read("stats.json"))["rmse"])


def test_absolute_errors(trajectories: tuple[Path, Path], tmp_path: Path) -> None:
    truth, estimate = (read_tum(path)[1] for path in trajectories)
    errors = position_errors(estimate, truth)
    assert errors.rms_m == pytest.approx(evo_rms(APE, trajectories, tmp_path), rel=1e-6)
    aligned = evo_rms(APE, trajectories, tmp_path, "--align")
    assert errors.aligned_rms_m == pytest.approx(aligned, rel=1e-6)


def test_relative_errors_to_the_next_frame(trajectories: tuple[Path, Path], tmp_path: Path) -> None:
    truth, estimate = (read_tum(path)[1] for path in trajectories)
    errors = step_errors(estimate, truth)
    assert errors is not None
    steps = ("--delta", "1", "--delta_unit", "f", "--all_pairs")
    shift = evo_rms(RPE, trajectories, tmp_path, *steps)
    assert errors.shift_rms_m == pytest.approx(shift, rel=1e-6)
    turn = evo_rms(RPE, trajectories, tmp_path, *steps, "--pose_relation", "angle_deg")
    assert errors.turn_rms_deg == pytest.approx(turn, rel=1e-5)
