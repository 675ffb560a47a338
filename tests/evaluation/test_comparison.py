"""Two sets of poses compared: where they differ, what each witness prefers, and what is not judged."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import planfit
from builders import random_transforms
from planfit.errors import ScanError
from planfit.evaluation import (
    Metric,
    PoseDifferences,
    Witness,
    largest_stretches,
    pose_differences,
)
from planfit.evaluation.agreement import looked_through_share, near_pairs, read_thumbnails
from planfit.evaluation.comparison import _match_metrics
from planfit.evaluation.evaluate import RefinedPoses
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.report.html.comparison_page import conclusion
from planfit.runtime import Runtime
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan


def differences_of(distance_m):
    distance_m = np.asarray(distance_m, dtype=float)
    return PoseDifferences(distance_m, 10 * distance_m, False, (0.0, 0.0), 0.0)


def test_a_moved_stretch_is_found_with_its_size(rng):
    a = random_transforms(rng, 100)
    b = a.copy()
    b[40:60, 0, 3] += 0.5
    b[80:83] = se3.retract(b[80:83], np.tile([0.0, 0.0, 0.2, 0.0, 0.3, 0.0], (3, 1)))
    found = pose_differences(a, b)
    assert_allclose(np.flatnonzero(found.distance_m > 1e-9), [*range(40, 60), *range(80, 83)])
    first, second = largest_stretches(found)
    assert (first.first, first.last, second.first, second.last) == (40, 59, 80, 82)
    assert first.max_distance_m == pytest.approx(0.5)
    assert first.max_angle_deg == pytest.approx(0.0, abs=1e-5)
    assert second.max_angle_deg == pytest.approx(np.rad2deg(0.2))


def test_one_motion_of_the_whole_is_told_and_taken_out_when_asked(rng):
    a = random_transforms(rng, 50)
    motion = se3.make_transform(se3.exp_so3(np.array([0.0, 0.0, 0.1])), np.array([1.0, 0.0, 0.0]))
    as_they_are, aligned = (pose_differences(a, motion @ a, align) for align in (False, True))
    assert as_they_are.distance_m.max() > 0.5
    assert as_they_are.whole[1] == pytest.approx(np.rad2deg(0.1))
    assert as_they_are.aligned_rms_m == pytest.approx(0.0, abs=1e-9)
    assert aligned.distance_m.max() == pytest.approx(0.0, abs=1e-9)
    assert aligned.angle_deg.max() == pytest.approx(0.0, abs=1e-5)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60))
def test_stretches_do_not_overlap_and_hold_the_largest(distances):
    found = largest_stretches(differences_of(distances))
    covered = [i for s in found for i in range(s.first, s.last + 1)]
    assert len(covered) == len(set(covered))
    if max(distances) >= 0.02:
        assert found[0].max_distance_m == max(distances)
    else:
        assert not found


def test_the_flank_of_a_peak_is_no_stretch_of_its_own():
    bump = np.exp(-(((np.arange(100) - 50) / 12.0) ** 2))
    (only,) = largest_stretches(differences_of(bump))
    assert 38 <= only.first <= 42
    assert 58 <= only.last <= 62


@pytest.mark.parametrize(
    ("a", "b", "prefers"),
    [(3.0, 2.0, "b"), (2.0, 3.0, "a"), (2.0, 2.05, "neither"), (0.3, 0.0, "neither")],
)
def test_a_witness_prefers_what_is_lower_by_enough(a, b, prefers):
    witness = Witness("matches", Metric("matches", "", "cm", a, b), (0.05, 0.5))
    assert witness.prefers == prefers


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=6,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=40),
            camera=CameraOptions(width_px=160, height_px=120),
        )
    )


@dataclasses.dataclass(frozen=True)
class OnPlan:
    """True poses, or others, as a result would have them."""

    structure: object
    floorplan: object
    initial_plan_from_cams: np.ndarray
    plan_from_cams: np.ndarray
    world_from_cams: np.ndarray
    sensor: SensorCalibration = NOMINAL


@pytest.fixture(scope="module")
def observations(synthetic):
    return planfit.extract_observations(synthetic.scan)


def moved(poses, frames, metres):
    poses = poses.copy()
    poses[frames, 0, 3] += metres
    return poses


@pytest.fixture(scope="module")
def torn_at(observations):
    """A step that many matches span, though fewer than half: half would move their median."""
    pairs, sizes = observations.matches.pairs, np.diff(observations.matches.start)
    share = {
        k: sizes[(pairs[:, 0] < k) & (pairs[:, 1] >= k)].sum() / sizes.sum() for k in range(20, 32)
    }
    return max((k for k in share if share[k] < 0.45), key=lambda k: share[k])


@pytest.fixture(scope="module")
def results(synthetic, observations, torn_at):
    """The truth, and the same with the frames from some step on 0.4 m off."""
    true, world = synthetic.true_plan_from_cams, synthetic.true_world_from_cams
    tail = slice(torn_at, 40)
    plan = synthetic.floorplan
    right = OnPlan(observations.structure, plan, true, true, world)
    wrong = OnPlan(
        observations.structure, plan, true, moved(true, tail, 0.4), moved(world, tail, 0.4)
    )
    assert isinstance(right, RefinedPoses)
    return right, wrong


FEW = planfit.CompareOptions(map=planfit.evaluation.MapOptions(frame_step=2))


@pytest.mark.slow
def test_every_witness_prefers_the_truth_and_the_stretch_is_named(
    synthetic, observations, results, torn_at
):
    right, wrong = results
    found = planfit.compare(synthetic.scan, wrong, right, observations.matches, FEW)
    assert found.axes == "plan"
    assert {w.name: w.prefers for w in found.witnesses} == {
        "matches": "b", "plan": "b", "map": "neither", "free space": "b"
    }  # fmt: skip
    assert found.preferred == "b"
    (local,) = found.stretches
    assert (local.stretch.first, local.stretch.last) == (torn_at, 39)
    assert local.near_share[1] > local.near_share[0] + 0.1
    words = conclusion(found)
    for part in ("The evidence prefers B: B's matches lie closer", "B fits the plan better",
                 f"They differ most at frames {torn_at}-39"):  # fmt: skip
        assert part in words
    medians = found.metrics["matches"]  # nearly blind to a tear that few matches span
    pairs = found.metrics["match_pairs"]
    assert medians.before / medians.after < pairs.before / pairs.after
    swapped = planfit.compare(synthetic.scan, right, wrong, observations.matches, FEW)
    assert swapped.preferred == "a"
    assert "prefers A: A's matches" in conclusion(swapped)


def test_the_same_poses_prefer_neither(synthetic, observations, results):
    found = planfit.compare(synthetic.scan, results[0], results[0], observations.matches, FEW)
    assert found.preferred == "neither"
    assert not found.stretches
    assert "prefers neither" in conclusion(found)
    assert "the same within two centimetres" in conclusion(found)
    assert "no evidence" in conclusion(dataclasses.replace(found, witnesses=()))


def test_poses_in_the_scans_axes_go_onto_the_plan_beside_a_result(synthetic, results):
    right, wrong = results
    quick = planfit.CompareOptions(depth_maps=False)
    found = planfit.compare(synthetic.scan, right, wrong.world_from_cams, options=quick)
    assert found.axes == "world"
    assert [w.name for w in found.witnesses] == ["plan", "map"]
    assert found.preferred == "a"
    # By its own walls, of which two thirds are right: a compromise, near those that were not moved.
    apart = found.poses.plan_from_cams[1] - right.plan_from_cams
    apart_m = np.linalg.norm(apart[:, :3, 3], axis=1)
    assert apart_m[:20].mean() < 0.2 < apart_m[-5:].mean()


def test_two_plans_are_not_held_against_each_other(synthetic, results):
    right, wrong = results
    other = dataclasses.replace(wrong, floorplan=synthetic.floorplan.scaled(1.5))
    quick = planfit.CompareOptions(depth_maps=False)
    found = planfit.compare(synthetic.scan, right, other, options=quick)
    assert found.axes == "world"
    assert "off_plan" not in found.metrics
    assert "different plans" in found.notes[0]


def test_poses_of_other_frames_are_refused(synthetic, results):
    with pytest.raises(ScanError, match="expected poses of all 40 frames, found 30 in B"):
        planfit.compare(synthetic.scan, results[0], results[0].world_from_cams[:30])


def test_views_do_not_look_through_each_other_at_true_poses(synthetic):
    thumbnails = read_thumbnails(synthetic.scan, Runtime())
    true = synthetic.true_plan_from_cams[thumbnails.frame_idx]
    pairs = near_pairs((true, true))
    assert looked_through_share(thumbnails, true, pairs) < 0.01
    folded = moved(true, slice(10, 20), 1.0)
    assert looked_through_share(thumbnails, folded, pairs) > 0.05


def test_neighbours_among_keyframes_are_no_revisits(synthetic, observations):
    poses = synthetic.true_world_from_cams
    every_twelfth = observations.matches.numbered(12 * np.arange(len(poses)))
    dense = np.repeat(poses, 12, axis=0)
    found = _match_metrics(every_twelfth, (dense, dense))
    assert found == _match_metrics(observations.matches, (poses, poses))
    assert len(found) > 1
