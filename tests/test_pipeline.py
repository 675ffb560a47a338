"""`planfit.refine` as a whole, on synthetic scans whose truth is known, whole and crippled."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest

import planfit
from builders import keep_images
from planfit.adjust import AdjustOptions
from planfit.adjust.options import TermOptions
from planfit.alignment import AlignOptions
from planfit.evaluation import position_errors
from planfit.findings import PlanKind, PoseKind, ScanKind
from planfit.geometry import se3
from planfit.pipeline.refine import calibrate
from planfit.runtime import Runtime
from planfit.scan import Label, Scan, ScanFiles
from planfit.segmentation import SegmentationOptions
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SyntheticScan,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
    make_scan,
)
from planfit.tracking import KeyframeOptions

BASE = SynthOptions(
    seed=5,
    building=BuildingOptions(n_rooms=3),
    walk=WalkOptions(n_frames=80),
    camera=CameraOptions(width_px=320, height_px=240),
    drift=DriftOptions(yaw_deg=0.5, translation_m=0.03),
)


@dataclass(frozen=True)
class Subset:
    """Some frames of a scan, with some labels hidden."""

    files: ScanFiles
    frames: np.ndarray
    hidden: tuple[Label, ...] = ()

    def color(self, i):
        return self.files.color(int(self.frames[i]))

    def depth(self, i):
        return self.files.depth(int(self.frames[i]))

    def labels(self, i):
        labels = self.files.labels(int(self.frames[i])).copy()
        labels[np.isin(labels, self.hidden)] = Label.NONE
        return labels

    def write_poses(self, directory, world_from_cams):
        raise NotImplementedError


def subset(scan: Scan, frames: np.ndarray, hidden: tuple[Label, ...] = ()) -> Scan:
    return dataclasses.replace(
        scan,
        frame_ids=tuple(scan.frame_ids[i] for i in frames),
        timestamps=scan.timestamps[frames],
        cameras=tuple(scan.cameras[i] for i in frames),
        world_from_cams=scan.world_from_cams[frames],
        files=Subset(scan.files, frames, hidden),
    )


@pytest.fixture(scope="module")
def synthetic() -> SyntheticScan:
    made = make_scan(BASE)
    return dataclasses.replace(made, scan=keep_images(made.scan))


@pytest.fixture(scope="module")
def runtime(tmp_path_factory) -> Runtime:
    return Runtime(cache_dir=tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def refined(synthetic, runtime) -> planfit.RefineResult:
    return planfit.refine(synthetic.scan, synthetic.floorplan, runtime=runtime)


def rms(poses, truth):
    return position_errors(poses, truth).rms_m


def test_error_falls_to_centimetres(synthetic, refined):
    truth = synthetic.true_world_from_cams
    assert rms(synthetic.scan.world_from_cams, truth) > 0.12
    assert rms(refined.world_from_cams, truth) < 0.02
    assert refined.verdict.is_refined
    predicted = np.sqrt(np.mean(refined.verdict.predicted_error_m**2))
    assert 0.3 < predicted / rms(refined.world_from_cams, truth) < 3.0
    assert refined.warnings == ()


@pytest.mark.slow
def test_same_input_same_bits(synthetic, refined):
    again = planfit.refine(synthetic.scan, synthetic.floorplan, runtime=Runtime(workers=1))
    np.testing.assert_array_equal(again.plan_from_cams, refined.plan_from_cams)


@pytest.mark.slow
def test_plan_aligns_the_scan_better_than_loops_alone(synthetic, refined, runtime):
    no_walls = planfit.RefineOptions(adjust=AdjustOptions(walls=TermOptions(0.0)))
    alone = planfit.refine(synthetic.scan, synthetic.floorplan, no_walls, runtime)
    truth = synthetic.true_plan_from_cams
    assert rms(refined.plan_from_cams, truth) < rms(alone.plan_from_cams, truth)
    assert "walls" not in alone.cost_by_term


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "adjust"),
    [
        ("points", AdjustOptions(points=TermOptions(0.0))),
        ("floor", AdjustOptions(floor=TermOptions(0.0))),
        ("odometry", AdjustOptions(odometry=TermOptions(0.0))),
    ],
)
def test_a_term_of_no_weight_is_left_out(name, adjust, synthetic, runtime):
    options = planfit.RefineOptions(adjust=adjust)
    result = planfit.refine(synthetic.scan, synthetic.floorplan, options, runtime)
    assert name not in result.cost_by_term
    truth = synthetic.true_world_from_cams
    assert rms(result.world_from_cams, truth) < 0.06


@pytest.mark.slow
def test_keyframes_alone_are_nearly_as_good(synthetic, runtime):
    keyframes = KeyframeOptions(min_frames=0, max_step_m=1.0, max_rotation_deg=50.0)
    options = planfit.RefineOptions(keyframes=keyframes)
    result = planfit.refine(synthetic.scan, synthetic.floorplan, options, runtime)
    solved = result.adjustment.solution.target_from_cams
    assert len(solved) < 0.8 * len(synthetic.scan)
    assert rms(result.world_from_cams, synthetic.true_world_from_cams) < 0.05


@pytest.mark.slow
def test_scan_in_axes_of_its_own_is_found_on_the_plan():
    moved = make_scan(dataclasses.replace(BASE, world="moved"))
    result = planfit.refine(moved.scan, moved.floorplan)
    assert rms(result.plan_from_cams, moved.true_plan_from_cams) < 0.03
    # Poses stay where they were recorded: only the drift is taken out of them.
    assert rms(result.world_from_cams, moved.scan.world_from_cams) < 0.4


@pytest.mark.slow
def test_phone_depth_and_geometry_labels():
    phone = make_scan(
        dataclasses.replace(
            BASE,
            seed=8,
            walk=WalkOptions(n_frames=50),
            camera=CameraOptions(width_px=200, height_px=150),
            depth_noise=TimeOfFlightNoise(),
            has_labels=False,
        )
    )
    result = planfit.refine(phone.scan, phone.floorplan)
    assert result.structure.back_end == "geometry"
    before = rms(phone.scan.world_from_cams, phone.true_world_from_cams)
    assert rms(result.world_from_cams, phone.true_world_from_cams) < min(0.06, 0.5 * before)


def test_ten_frames_are_refined_with_a_warning(synthetic):
    frames = np.arange(10)
    result = planfit.refine(subset(synthetic.scan, frames), synthetic.floorplan)
    assert any(each.kind is ScanKind.FEW_FRAMES for each in result.findings)
    truth = synthetic.true_world_from_cams[frames]
    before = rms(synthetic.scan.world_from_cams[frames], truth)
    assert rms(result.world_from_cams, truth) < max(before, 0.05)


def test_path_without_a_loop_says_so(synthetic):
    frames = np.arange(0, 40, 8)  # apart in time means apart in space, neighbours are all there is
    result = planfit.refine(subset(synthetic.scan, frames), synthetic.floorplan)
    assert any("no loop" in warning or "no two frames" in warning for warning in result.warnings)


@pytest.mark.slow
def test_no_wall_seen_keeps_the_recorded_poses(synthetic):
    n = np.arange(len(synthetic.scan))
    result = planfit.refine(subset(synthetic.scan, n, (Label.WALL,)), synthetic.floorplan)
    assert result.alignment is None
    assert not result.verdict.is_refined
    assert any(each.kind is ScanKind.NO_WALL for each in result.findings)
    truth = synthetic.true_world_from_cams
    assert rms(result.world_from_cams, truth) < rms(synthetic.scan.world_from_cams, truth)


@pytest.mark.slow
def test_no_floor_seen_is_refined_by_the_rest(synthetic):
    n = np.arange(len(synthetic.scan))
    result = planfit.refine(subset(synthetic.scan, n, (Label.FLOOR,)), synthetic.floorplan)
    assert any(each.kind is ScanKind.NO_FLOOR for each in result.findings)
    truth = synthetic.true_world_from_cams
    assert rms(result.world_from_cams, truth) < 0.5 * rms(synthetic.scan.world_from_cams, truth)


@pytest.mark.slow
@pytest.mark.parametrize("drawn_at", [0.96, 1.02])
def test_a_plan_drawn_at_another_scale_is_taken_as_drawn_and_doubted(drawn_at, synthetic, runtime):
    drawn = synthetic.floorplan.scaled(drawn_at)
    result = planfit.refine(synthetic.scan, drawn, runtime=runtime)
    assert result.alignment.scale_xy == (1.0, 1.0)
    assert result.floorplan.size == pytest.approx(drawn.size)
    other = result.alignment.other_scale
    assert other.metres_per_unit == pytest.approx(1 / drawn_at, rel=3e-3)
    assert not result.verdict.is_refined
    said = result.verdict.headline
    assert "would fit" in said
    assert "--align.metric-scale-tolerance" in said + result.verdict.advice
    # What the sensor measured is not bent to a plan that is off by more than depth is.
    assert result.sensor.depth_scale == 1.0 or drawn_at == 1.02


def test_a_right_plan_in_metres_is_not_doubted(refined):
    assert refined.alignment.other_scale is None


@pytest.mark.slow
def test_a_plan_drawn_too_small_is_scaled_where_that_is_allowed(synthetic, refined, runtime):
    drawn = synthetic.floorplan.scaled(0.96)
    scaled = planfit.RefineOptions(align=AlignOptions(metric_scale_tolerance=0.12))
    result = planfit.refine(synthetic.scan, drawn, scaled, runtime=runtime)
    assert result.alignment.metres_per_unit == pytest.approx(1 / 0.96, rel=3e-3)
    assert result.floorplan.size == pytest.approx(synthetic.floorplan.size, rel=3e-3)
    assert any(each.kind is PlanKind.PLAN_RESCALED for each in result.findings)
    assert result.verdict.is_refined
    truth = synthetic.true_plan_from_cams
    assert rms(result.plan_from_cams, truth) < 1.3 * rms(refined.plan_from_cams, truth) + 0.003


@pytest.mark.slow
@pytest.mark.parametrize("seed", [78, 79, 80])
def test_plan_of_another_building_is_warned_of(seed, synthetic, runtime):
    other = make_scan(dataclasses.replace(BASE, seed=seed)).floorplan
    scan = dataclasses.replace(synthetic.scan, plan_from_world_axes=None)
    result = planfit.refine(scan, other, runtime=runtime)
    assert result.warnings
    assert not result.verdict.is_refined


@pytest.mark.parametrize("calibrates", [True, False])
def test_motion_that_is_too_short_for_the_plan_is_corrected_as_a_whole(
    calibrates, synthetic, runtime
):
    poses = synthetic.true_world_from_cams.copy()
    poses[:, :3, 3] *= 0.97
    short = dataclasses.replace(synthetic.scan, world_from_cams=poses)
    options = planfit.RefineOptions().with_("calibration.is_on", calibrates)
    result = planfit.refine(short, synthetic.floorplan, options, runtime)
    told = [each for each in result.findings if each.kind is PoseKind.MOTION_TO_SCALE]
    if not calibrates:
        assert told == []
        return
    (facts,) = [each.facts for each in told]
    assert facts["departure"] == pytest.approx(1 / 0.97 - 1, abs=3 * facts["sigma"])
    assert facts["sigma"] < 0.01
    assert result.sensor.depth_scale == 1.0
    # What is left of it is within what is told; poses as recorded stay as they are.
    assert rms(result.plan_from_cams, synthetic.true_plan_from_cams) < 0.03
    assert np.allclose(result.tracking.recorded_world_from_cams, poses)


def test_mask_back_end_without_masks_is_an_error(synthetic):
    bare = dataclasses.replace(subset(synthetic.scan, np.arange(10)), has_labels=False)
    options = planfit.RefineOptions(segmentation=SegmentationOptions(back_end="masks"))
    with pytest.raises(planfit.errors.ScanError, match="masks"):
        planfit.refine(bare, synthetic.floorplan, options)


@pytest.mark.slow
def test_moving_world_as_a_whole_moves_only_the_world(synthetic, refined):
    transform = se3.make_transform(
        se3.exp_so3(np.array([0.0, 0.7, 0.0])), np.array([3.0, 0.0, -2.0])
    )
    moved = dataclasses.replace(
        synthetic.scan,
        world_from_cams=transform @ synthetic.scan.world_from_cams,
        plan_from_world_axes=None,
    )
    result = planfit.refine(moved, synthetic.floorplan)
    assert rms(result.plan_from_cams, refined.plan_from_cams) < 0.005


@pytest.mark.slow
def test_nothing_is_calibrated_where_that_is_off():
    synthetic = make_scan(BASE)

    @dataclass(frozen=True)
    class Short:
        """Depth that was measured 5 % too short."""

        files: ScanFiles

        def color(self, i):
            return self.files.color(i)

        def depth(self, i):
            return 0.95 * self.files.depth(i)

        def labels(self, i):
            return self.files.labels(i)

        def write_poses(self, directory, world_from_cams):
            raise NotImplementedError

    short = dataclasses.replace(synthetic.scan, files=Short(synthetic.scan.files))
    on = calibrate(short, synthetic.floorplan)
    off = calibrate(
        short, synthetic.floorplan, planfit.RefineOptions().with_("calibration.is_on", False)
    )
    assert on.sensor.depth_scale == pytest.approx(1 / 0.95, abs=0.01)
    assert off.kept == ()
    assert off.sensor.is_nominal
