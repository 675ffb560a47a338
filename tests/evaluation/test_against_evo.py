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
from planfit.evaluation import position_errors, relative_errors
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
    truth = random_transforms(rng, 200, max_rotation=1.0)
    truth[:, :3, 3] = np.cumsum(rng.normal(0.05, 0.05, (200, 3)), axis=0)
    paths = tmp_path / "truth.tum", tmp_path / "estimate.tum"
    for path, poses in zip(paths, (truth, nudged(rng, truth, 1.0, 0.05)), strict=True):
        write_tum(path, np.arange(200.0), poses)
    return paths


def evo(
    command: str | None,
    trajectories: tuple[Path, Path],
    tmp_path: Path,
    *flags: str,
    statistic: str = "rmse",
) -> float:
    assert command is not None
    result = tmp_path / "result.zip"
    result.unlink(missing_ok=True)
    words = [command, "tum", *map(str, trajectories), *flags, "--save_results", str(result)]
    environment = {**os.environ, "HOME": str(tmp_path), "MPLBACKEND": "Agg"}
    subprocess.run(words, check=True, capture_output=True, env=environment, cwd=tmp_path)
    with zipfile.ZipFile(result) as archive:
        return float(json.loads(archive.read("stats.json"))[statistic])


def test_absolute_errors(trajectories: tuple[Path, Path], tmp_path: Path) -> None:
    truth, estimate = (read_tum(path)[1] for path in trajectories)
    errors = position_errors(estimate, truth)
    assert errors.rms_m == pytest.approx(evo(APE, trajectories, tmp_path), rel=1e-6)
    aligned = evo(APE, trajectories, tmp_path, "--align")
    assert errors.aligned_rms_m == pytest.approx(aligned, rel=1e-6)
    largest = evo(APE, trajectories, tmp_path, statistic="max")
    assert errors.max_m == pytest.approx(largest, rel=1e-6)
    angle_deg = evo(APE, trajectories, tmp_path, "--pose_relation", "angle_deg", statistic="mean")
    assert errors.rotation_mean_deg == pytest.approx(angle_deg, rel=1e-5)


def test_relative_errors_to_the_next_frame(trajectories: tuple[Path, Path], tmp_path: Path) -> None:
    truth, estimate = (read_tum(path)[1] for path in trajectories)
    errors = relative_errors(estimate, truth)
    assert errors is not None
    steps = ("--delta", "1", "--delta_unit", "f", "--all_pairs")
    distance_m = evo(RPE, trajectories, tmp_path, *steps)
    assert errors.translation_rms_m == pytest.approx(distance_m, rel=1e-6)
    angle_deg = evo(RPE, trajectories, tmp_path, *steps, "--pose_relation", "angle_deg")
    assert errors.rotation_rms_deg == pytest.approx(angle_deg, rel=1e-5)


def test_relative_errors_over_a_length(tmp_path: Path, rng: np.random.Generator) -> None:
    """evo pairs a frame with the one nearest to the length, planfit with the first past it: on steps of
    0.1 m both are the 20th. With its usual tolerance evo adds shorter pairs at the end of the path."""
    truth = random_transforms(rng, 200, max_rotation=1.0)
    steps = rng.normal(size=(200, 3))
    steps *= 0.1 / np.linalg.norm(steps, axis=1, keepdims=True)
    truth[:, :3, 3] = np.cumsum(steps, axis=0)
    paths = tmp_path / "truth.tum", tmp_path / "estimate.tum"
    for path, poses in zip(paths, (truth, nudged(rng, truth, 1.0, 0.05)), strict=True):
        write_tum(path, np.arange(200.0), poses)
    errors = relative_errors(read_tum(paths[1])[1], read_tum(paths[0])[1], 1.98)
    assert errors is not None
    assert errors.n_pairs == 180
    pairs = ("--delta", "1.98", "--delta_unit", "m", "--all_pairs", "--pairs_from_reference")
    pairs = (*pairs, "--delta_tol", "0.02")
    distance_m = evo(RPE, paths, tmp_path, *pairs)
    assert errors.translation_rms_m == pytest.approx(distance_m, rel=1e-6)
    angle_deg = evo(RPE, paths, tmp_path, *pairs, "--pose_relation", "angle_deg")
    assert errors.rotation_rms_deg == pytest.approx(angle_deg, rel=1e-5)
