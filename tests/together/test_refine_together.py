"""Visits to one synthetic building, each in its own world: one frame of reference, as exact as alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import planfit
from planfit.cli.main import main
from planfit.errors import OptionError, ScanError
from planfit.findings import SurveyKind
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.scan import read_tum
from planfit.scan.views import select_frames
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    SynthOptions,
    WalkOptions,
    facap_segments,
    make_scan,
)
from scan_samples import write_seven_scenes

N = 70
PLAIN = {"has_labels": True, "world": "moved"}


def visit(number, size=(320, 240), seed=1, **building):
    return make_scan(
        SynthOptions(
            seed=seed,
            visit=number,
            building=BuildingOptions(n_rooms=3, **building),
            walk=WalkOptions(n_frames=N),
            camera=CameraOptions(width_px=size[0], height_px=size[1]),
            **PLAIN,
        )
    )


@pytest.fixture(scope="module")
def runtime(tmp_path_factory):
    return Runtime(cache_dir=tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def first():
    return visit(0)


@pytest.fixture(scope="module")
def second():
    """Months later: all furniture is other furniture, the camera another one."""
    return visit(1, (400, 300), refurnished=1)


def error_m(result, true_plan_from_cams):
    off = result.plan_from_cams[:, :3, 3] - true_plan_from_cams[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def short_visit(synthetic, n=18):
    """The first frames of a walk alone, and where they truly are."""
    idx = np.arange(n)
    scan = select_frames(synthetic.scan, idx, synthetic.scan.world_from_cams[idx])
    return replace(scan, name="short visit"), synthetic.true_plan_from_cams[idx]


@pytest.mark.slow
def test_two_visits_are_as_exact_as_each_alone(first, second, runtime):
    both = planfit.refine_together([first.scan, second.scan], first.floorplan, runtime=runtime)
    assert both.is_refined
    assert both.between_pairs > 20
    for each, truth in zip(both.scans, (first, second), strict=True):
        alone = planfit.refine(truth.scan, first.floorplan, runtime=runtime)
        limit = 1.3 * error_m(alone, truth.true_plan_from_cams) + 0.001
        assert error_m(each.result, truth.true_plan_from_cams) < limit
        # And back in the axes that the scan was recorded in, up to its height.
        off = each.result.world_from_cams[:, :3, 3] - truth.true_world_from_cams[:, :3, 3]
        assert np.abs(off[:, [0, 2]]).max() < 0.2
    assert both.scans[1].placed_by == "places seen in both"
    ids = both.together.made_of.scan.frame_ids
    assert len(set(ids)) == 2 * N


@pytest.mark.slow
def test_a_few_frames_that_fit_many_places_are_placed_by_the_other_visit(first, second, runtime):
    short, true_short = short_visit(second, n=6)
    alone = planfit.refine(short, first.floorplan, runtime=runtime)
    assert error_m(alone, true_short) > 1.0
    found = planfit.refine_together([first.scan, short], first.floorplan, runtime=runtime)
    assert found.scans[1].placed_by == "places seen in both"
    assert error_m(found.scans[1].result, true_short) < 0.02


@pytest.mark.slow
def test_without_a_plan_they_stand_in_one_frame(first, second, runtime, tmp_path):
    short, true_short = short_visit(second)
    stranger = visit(0, seed=8)
    stranger = replace(stranger.scan, name="another building")
    found = planfit.refine_together([first.scan, stranger, short], None, runtime=runtime)
    assert [each.placed_by for each in found.scans] == ["the first", None, "places seen in both"]
    assert not found.is_refined  # one has no place
    assert found.scans[1].result is None
    assert any(each.kind is SurveyKind.SCAN_LEFT_OUT for each in found.together.findings)
    # Both at once: brought to the truth by one motion.
    true = np.concatenate([first.true_plan_from_cams, true_short])[:, :3, 3]
    poses = found.together.plan_from_cams[:, :3, 3]
    off = se3.transform(se3.fit_rigid(poses, true), poses) - true
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.04
    found.save(tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out" / "scans").iterdir()) == sorted(
        each.name for each in found.scans if each.result is not None
    )


@pytest.mark.slow
def test_scans_that_share_no_place_are_placed_by_the_plan(first, runtime):
    """Depth alone: no keypoint of one scan is found in the other."""
    dark = replace(visit(1).scan, has_color=False)
    dark = replace(dark, files=_WithoutColor(dark.files), name="depth alone", fingerprint="")
    found = planfit.refine_together([first.scan, dark], first.floorplan, runtime=runtime)
    assert found.between_pairs == 0
    assert [each.placed_by for each in found.scans] == ["the first", "the plan"]
    truth = visit(1).true_plan_from_cams
    assert error_m(found.scans[1].result, truth) < 0.06


class _WithoutColor:
    """A depth camera."""

    def __init__(self, files):
        self._files = files

    def color(self, frame_idx):
        return None

    def depth(self, frame_idx):
        return self._files.depth(frame_idx)

    def labels(self, frame_idx):
        return self._files.labels(frame_idx)

    def write_poses(self, *args):
        self._files.write_poses(*args)


def test_one_scan_is_none_of_several(first):
    with pytest.raises(OptionError, match="expected two scans or more, found 1"):
        planfit.refine_together([first.scan], None)


def test_the_same_scan_twice_is_refused(first):
    with pytest.raises(ScanError, match="twice"):
        planfit.refine_together([first.scan, first.scan], None)


def write_scan(folder, synthetic):
    files, n = synthetic.scan.files, len(synthetic.scan)
    depths = [np.nan_to_num(files.depth(i) * 1000).astype(np.uint16) for i in range(n)]
    colors = [files.color(i) for i in range(n)]
    camera, poses = synthetic.scan.cameras[0], synthetic.scan.world_from_cams
    sample = SimpleNamespace(poses=poses, color=colors, depth_mm=depths, camera=camera)
    write_seven_scenes(folder, sample)


def exit_code(*words):
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    return left.value.code


@pytest.mark.slow
def test_the_command_line(first, second, tmp_path, capfd):
    write_scan(tmp_path / "march", first)
    write_scan(tmp_path / "june", second)
    plan = tmp_path / "plan.npy"
    np.save(plan, facap_segments(first.floorplan))
    out = tmp_path / "out"
    words = [tmp_path / name for name in ("march", "june")]
    assert exit_code("refine", *words, "--plan", plan, "-o", out) == 0
    told = capfd.readouterr().out
    assert "places seen in both" in told
    report = (out / "report.html").read_text()
    assert "<h1>march + june</h1>" in report
    for name, truth in (("march", first), ("june", second)):
        _, poses = read_tum(out / "scans" / name / "trajectory.tum")
        off = poses[:, :3, 3] - truth.true_plan_from_cams[:, :3, 3]
        assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.03
        assert (out / "scans" / name / "poses").is_dir()
    assert exit_code("evaluate", out / "scans" / "june") == 0
    assert exit_code("evaluate", out) == 2
    assert "expected a run of one scan, found one of several" in capfd.readouterr().err


def test_all_scans_that_cannot_be_read_are_named(tmp_path, capfd):
    words = [tmp_path / name for name in ("nowhere", "elsewhere")]
    assert exit_code("refine", *words, "--no-plan", "-o", tmp_path / "out") == 2
    told = capfd.readouterr().err
    assert "nowhere" in told
    assert "elsewhere" in told
    assert not (tmp_path / "out").exists()
