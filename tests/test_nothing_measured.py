"""A run in which nothing was measured vouches for nothing."""

import json

import numpy as np
import pytest

import planfit
from planfit.adjust.uncertainty import radius_95
from planfit.findings import ResultKind
from planfit.geometry.camera import Camera
from planfit.pipeline.verdict import Outcome
from planfit.synth import BuildingOptions, SynthOptions, WalkOptions, make_scan

CAMERA = Camera(width=64, height=48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)


def scan_of_noise(poses):
    """Images and depth of nothing at all: no two of them match, and no floor or wall is in them."""
    rng = np.random.default_rng(3)
    shape = (len(poses), CAMERA.height, CAMERA.width)
    return planfit.scan_from_arrays(
        rng.integers(0, 255, (*shape, 3)).astype(np.uint8),
        rng.uniform(0.3, 9.0, shape),
        CAMERA,
        poses,
    )


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(building=BuildingOptions(n_rooms=1), walk=WalkOptions(n_frames=24))
    )


@pytest.mark.parametrize("n_frames", [1, 24])
def test_nothing_measured_is_nothing_refined(synthetic, n_frames, tmp_path):
    result = planfit.refine(scan_of_noise(synthetic.scan.world_from_cams[:n_frames]), None)
    assert len(result.matches.pairs) == 0
    verdict = result.verdict
    assert verdict.outcome is Outcome.NO_BETTER
    assert "nothing was refined" in verdict.headline
    assert [each.kind for each in verdict.because] == [ResultKind.NOTHING_REFINED]
    assert not result.evidence.is_measured
    assert np.isinf(verdict.predicted_error_m).all()
    result.save(tmp_path / "run")
    told = json.loads((tmp_path / "run" / "run.json").read_text())["verdict"]
    assert told["predicted_error_rms_m"] is None
    assert told["predicted_error_m"] == [None] * n_frames
    assert "inf" in (tmp_path / "run" / "trajectory_sigma.csv").read_text()
    assert "nothing was refined" in (tmp_path / "run" / "report.html").read_text()


def test_the_radius_of_what_is_not_known_is_infinite():
    known, unknown = 0.01 * np.eye(3), np.diag(np.full(3, np.inf))
    radius = radius_95(np.stack([known, unknown]))
    assert radius[0] == radius_95(known[None])[0]
    assert np.isinf(radius[1])
