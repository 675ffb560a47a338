"""The battery of faults: injectors do what their names say, numbers stay, what is done is not done again."""

import multiprocessing
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from faults import images, plans, poses
from faults.battery import read_measured, run_battery
from faults.cases import FAULTS, Case, Part, all_cases, choose
from faults.figures import (
    Result,
    fault_rows,
    make_figures,
    match_results,
    reliability_rows,
    require_none_bad,
)
from faults.inputs import Inputs, MovedWall
from faults.layouts import corridor, niches, same_rooms, scan_of_layout
from faults.measure import CRASHED, How, Measured, measure
from faults.page import make_page
from faults.scans import drifted, inputs_of, keep_images
from faults.words import NAMES, moved_walls_found, recognised
from scipy.spatial.transform import Rotation

from builders import look, make_structure, room_plan
from planfit.errors import OutputError, PlanfitError, ScanError
from planfit.geometry import se3, segments
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    NoDepthNoise,
    SynthOptions,
    WalkOptions,
    make_scan,
)

CAMERA = CameraOptions(width_px=64, height_px=48, blur_px=0, exposure_std=0, noise_levels=0)


@pytest.fixture(scope="module")
def flat() -> Inputs:
    """True poses as recorded ones, the true plan."""
    options = SynthOptions(
        seed=3, walk=WalkOptions(n_frames=60), camera=CAMERA, depth_noise=NoDepthNoise()
    )
    return inputs_of(make_scan(options))


def steps(world_from_cams: np.ndarray) -> np.ndarray:
    return se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:]


def broken_steps(before: Inputs, after: Inputs) -> np.ndarray:
    a, b = (steps(inputs.scan.world_from_cams) for inputs in (before, after))
    return np.flatnonzero(np.abs(a - b).max(axis=(1, 2)) > 1e-6)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("size", [0, 1, 2])
def test_jumps_break_as_many_steps_by_as_much(
    flat: Inputs, count: int, size: int, rng: np.random.Generator
) -> None:
    spoilt = poses.jump(flat, count, size, rng)
    broken = broken_steps(flat, spoilt)
    assert len(broken) == count
    assert (np.diff(broken) > 4).all()
    distance_m, angle_deg = poses.JUMPS[size]
    true, found = (steps(inputs.scan.world_from_cams)[broken] for inputs in (flat, spoilt))
    turned = se3.rotation_angle(np.swapaxes(true[:, :3, :3], 1, 2) @ found[:, :3, :3])
    assert np.rad2deg(turned) == pytest.approx(angle_deg)
    # The jump turns about the camera, so only the walk of the step itself adds to the distance.
    moved = np.linalg.norm((found - true)[:, :3, 3], axis=1)
    assert moved == pytest.approx(distance_m, abs=1e-6)
    heights = spoilt.scan.world_from_cams[:, :3, 3] @ flat.up_world
    assert heights == pytest.approx(flat.scan.world_from_cams[:, :3, 3] @ flat.up_world)


def test_more_drift_is_so_many_times_as_strong(flat: Inputs) -> None:
    def spread(inputs: Inputs) -> float:
        errors = (
            steps(inputs.scan.world_from_cams)[:, :3, 3]
            - steps(flat.scan.world_from_cams)[:, :3, 3]
        )
        return float(errors.std())

    usual = np.mean([spread(drifted(flat, seed)) for seed in range(8)])
    for size, factor in enumerate(poses.DRIFT_FACTORS):
        more = np.mean(
            [spread(poses.more_drift(flat, size, np.random.default_rng(s))) for s in range(8)]
        )
        assert more / usual == pytest.approx(factor, rel=0.15)


def test_frozen_poses_repeat_and_come_back(flat: Inputs, rng: np.random.Generator) -> None:
    spoilt = poses.frozen(flat, 1, rng).scan.world_from_cams
    changed = np.flatnonzero(np.abs(spoilt - flat.scan.world_from_cams).max(axis=(1, 2)) > 1e-9)
    assert len(changed) == poses.LOST_FRAMES[1]
    assert (np.diff(changed) == 1).all()
    assert np.ptp(spoilt[changed[0] - 1 : changed[-1] + 1], axis=0).max() < 1e-12


def test_stuck_poses_go_on_from_where_they_froze(flat: Inputs, rng: np.random.Generator) -> None:
    spoilt = poses.stuck(flat, 0, rng).scan.world_from_cams
    is_same = np.abs(np.diff(spoilt, axis=0)).max(axis=(1, 2)) < 1e-9
    # Five frames frozen, and the first after them where they were: six steps without motion.
    assert is_same.sum() == poses.LOST_FRAMES[0] + 1
    later = np.flatnonzero(is_same).max() + 1
    assert steps(spoilt)[later:] == pytest.approx(steps(flat.scan.world_from_cams)[later:])


def test_identity_and_nan_poses(flat: Inputs, rng: np.random.Generator) -> None:
    spoilt = poses.zeros(flat, 0, rng).scan.world_from_cams
    assert (np.abs(spoilt - np.eye(4)).max(axis=(1, 2)) < 1e-12).sum() == poses.LOST_FRAMES[0]
    left = poses.not_numbers(flat, 0, rng)
    assert len(left.scan) == len(left.true_world_from_cams) == len(flat.scan) - poses.LOST_FRAMES[0]
    assert np.isfinite(left.scan.world_from_cams).all()


def test_gap_takes_frames_out_of_scan_and_truth(flat: Inputs, rng: np.random.Generator) -> None:
    spoilt = poses.gap(flat, 1, rng)
    assert len(spoilt.scan) == len(flat.scan) - poses.LOST_FRAMES[1]
    assert len(spoilt.true_world_from_cams) == len(spoilt.scan)
    shown = [int(name) - 1 for name in spoilt.scan.frame_ids]
    assert spoilt.true_world_from_cams == pytest.approx(flat.true_world_from_cams[shown])
    assert spoilt.scan.fingerprint != flat.scan.fingerprint
    # Recorded steps are true but for the one over the gap, which is 0.5 m off at most and at least.
    off = steps(spoilt.scan.world_from_cams) - steps(spoilt.true_world_from_cams)
    wrong = np.flatnonzero(np.abs(off).max(axis=(1, 2)) > 1e-6)
    assert len(wrong) == 1
    assert np.linalg.norm(off[wrong[0], :3, 3]) == pytest.approx(0.5, abs=1e-6)


def test_delay_moves_poses_along_the_frames(flat: Inputs) -> None:
    true = flat.scan.world_from_cams
    late = poses.delayed(flat, 1.0).scan.world_from_cams
    assert late[1:] == pytest.approx(true[:-1])
    early = poses.delayed(flat, -1.0).scan.world_from_cams
    assert early[:-1] == pytest.approx(true[1:])
    half = poses.delayed(flat, 0.5).scan.world_from_cams
    assert half[1:, :3, 3] == pytest.approx((true[:-1, :3, 3] + true[1:, :3, 3]) / 2)
    turned = se3.rotation_angle(np.swapaxes(true[:-1, :3, :3], 1, 2) @ half[1:, :3, :3])
    whole = se3.rotation_angle(np.swapaxes(true[:-1, :3, :3], 1, 2) @ true[1:, :3, :3])
    assert turned == pytest.approx(whole / 2, abs=1e-9)


def test_conventions_are_what_a_program_of_that_convention_reads_as_right(flat: Inputs) -> None:
    true = flat.scan.world_from_cams
    assert se3.inverse(poses.camera_from_world(true)) == pytest.approx(true)
    gl = poses.opengl_axes(true)
    # A point 2 m ahead, 1 m right, 0.5 m up lies at z -2, y +0.5 of an OpenGL camera.
    assert gl @ [1.0, 0.5, -2.0, 1.0] == pytest.approx(true @ [1.0, -0.5, 2.0, 1.0])
    # Of a phone held upright, the sensor's right is the image's down or up: never its right or left.
    arkit = poses.arkit_axes(true)
    sensor_right = np.einsum("nji,nj->ni", true[:, :3, :3], arkit[:, :3, 0])
    assert np.abs(sensor_right[:, 1]) == pytest.approx(1.0)
    wrong = Rotation.from_matrix(poses.quaternion_order(true)[:, :3, :3]).as_quat()
    right = Rotation.from_matrix(true[:, :3, :3]).as_quat()
    rolled = np.roll(right, 1, axis=1)  # w first
    assert np.abs(np.sum(wrong * rolled, axis=1)) == pytest.approx(1.0)
    up = poses.z_up(true)[:, :3, 3] @ [0.0, 0.0, 1.0]
    assert up == pytest.approx(true[:, :3, 3] @ flat.up_world)
    left = poses.left_handed(true)
    assert np.linalg.det(left[:, :3, :3]) == pytest.approx(1.0)
    assert left[:, 2, 3] == pytest.approx(-true[:, 2, 3])


@pytest.mark.parametrize("fault", poses.CONVENTIONS, ids=lambda fault: fault.name)
def test_conventions_are_known_to_the_scorer(fault, flat: Inputs, rng: np.random.Generator) -> None:
    if fault.name == "millimetres":
        with pytest.raises(ScanError) as refused:
            fault.spoil(flat, 0, rng)
        assert recognised(fault.name, str(refused.value))
        return
    fault.spoil(flat, 0, rng)
    (convention,) = fault.conventions
    name = NAMES[convention][0]
    assert recognised(convention, f"these poses look like {name} (explains 80 %): run again")
    assert not recognised(
        convention, f"these poses look like {name}_too (explains 80 %): run again"
    )
    assert not recognised(convention, "only 20 % of the walls lie near the plan")
    assert recognised("", f"these poses look like {name} (explains 80 %)") is False
    assert recognised("", "only 20 % of the walls lie near the plan") is None


def test_shuffled_poses_are_the_same_poses(flat: Inputs, rng: np.random.Generator) -> None:
    for size in range(3):
        spoilt = poses.shuffled(flat, size, rng).scan.world_from_cams
        assert not np.allclose(spoilt, flat.scan.world_from_cams)
        assert np.sort(spoilt[:, 0, 3]) == pytest.approx(
            np.sort(flat.scan.world_from_cams[:, 0, 3])
        )
    assert np.ptp(poses.constant(flat, 0, rng).scan.world_from_cams, axis=0).max() < 1e-12


def test_both_faces_of_a_wall_are_one_wall() -> None:
    thick = np.array([[[0, 0], [4, 0]], [[4, -0.2], [0, -0.2]]], dtype=float)
    apart = np.array([[[0, 3], [4, 3]], [[4, 2], [0, 2]]], dtype=float)
    jamb = np.array([[[4, 0], [4, -0.2]]], dtype=float)
    ends = np.concatenate([thick, jamb, apart])
    plan = replace(
        room_plan(), ends=ends, normals=segments.left_normals(ends), is_oriented=np.ones(5, bool)
    )
    wall_of = plans.walls_of(plan)
    assert wall_of[0] == wall_of[1] == wall_of[2]
    assert len(set(wall_of[2:])) == 3


@pytest.mark.parametrize("size", [0, 1, 2])
def test_so_much_of_the_plan_is_missing_moved_added(
    flat: Inputs, size: int, rng: np.random.Generator
) -> None:
    plan, share = flat.floorplan, plans.SHARES[size]
    total = plan.lengths.sum()
    # The last wall that is chosen may be one too much.
    one_wall = 2.2 * plan.lengths.max() / total
    left = plans.missing(flat, size, rng).floorplan.lengths.sum() / total
    assert 1 - share - one_wall <= left <= 1 - share + 1e-9
    moved = plans.moved(flat, size, rng)
    off = np.linalg.norm(moved.floorplan.ends - plan.ends, axis=2).max(axis=1)
    is_moved = off > 0
    assert share - 1e-9 <= plan.lengths[is_moved].sum() / total <= share + one_wall
    assert (off[is_moved] >= 0.1).all()
    assert (off[is_moved] <= 0.5).all()
    for wall in moved.moved_walls:
        back = moved.floorplan.ends[wall.face_idx] + wall.as_built_m
        assert back == pytest.approx(plan.ends[wall.face_idx])
    added = plans.added(flat, size, rng).floorplan
    assert (added.ends[: len(plan)] == plan.ends).all()
    assert added.lengths.sum() / total - 1 == pytest.approx(share, abs=5.5 / total)
    new, normals = added.ends[len(plan) :], added.normals[len(plan) :]
    for a, b in zip(range(0, len(new), 2), range(1, len(new), 2), strict=True):
        # The two faces of a partition look away from each other.
        assert (new[a].mean(axis=0) - new[b].mean(axis=0)) @ normals[a] > 0
        assert (new[b].mean(axis=0) - new[a].mean(axis=0)) @ normals[b] > 0


def test_rebuilt_wing_leaves_the_rest_and_its_own_length(
    flat: Inputs, rng: np.random.Generator
) -> None:
    plan = flat.floorplan
    rebuilt = plans.rebuilt(flat, 1, rng).floorplan
    changed = np.abs(rebuilt.ends - plan.ends).max(axis=(1, 2)) > 1e-9
    assert 0.1 < plan.lengths[changed].sum() / plan.lengths.sum() < 0.6
    assert rebuilt.lengths == pytest.approx(plan.lengths)
    assert rebuilt.size == pytest.approx(plan.size, abs=1.0)


def test_scale_and_mirror_are_undone_for_errors(flat: Inputs, rng: np.random.Generator) -> None:
    truth = flat.true_positions()
    large = plans.too_large(flat, 2, rng)
    assert large.floorplan.lengths == pytest.approx(1.1 * flat.floorplan.lengths)
    on_large = truth * [1.1, 1.1, 1.0]
    assert large.in_true_plan(on_large, large.floorplan) == pytest.approx(truth)
    assert large.scale_error(large.floorplan) == pytest.approx(0.1)
    mended = large.floorplan.scaled(1 / 1.1)
    assert large.scale_error(mended) == pytest.approx(0.0, abs=1e-9)
    assert large.in_true_plan(truth, mended) == pytest.approx(truth)
    small = plans.too_small(flat, 0, rng)
    assert small.scale_error(small.floorplan) == pytest.approx(-0.01)
    swapped = plans.mirrored(flat, 0, rng)
    assert swapped.in_true_plan(truth * [-1, 1, 1], swapped.floorplan) == pytest.approx(truth)
    assert swapped.in_true_plan(truth, swapped.floorplan.mirrored()) == pytest.approx(truth)


def test_outline_has_outer_walls_alone(flat: Inputs, rng: np.random.Generator) -> None:
    assert flat.rendered is not None
    plan, building = flat.floorplan, flat.rendered.building
    kept = plans.outline_only(flat, 0, rng).floorplan
    assert 0.2 < kept.lengths.sum() / plan.lengths.sum() < 0.8
    middles = {tuple(m) for m in kept.ends.mean(axis=1).round(6)}
    drawn = building.faces.rooms[building.faces.parts != 1]
    outside = plan.ends[drawn == -1].mean(axis=1).round(6)
    assert all(tuple(m) in middles for m in outside)
    rooms = building.layout.rooms
    between = (rooms[0].x1 + rooms[1].x0) / 2, rooms[0].centre[1]  # a wall between two rooms
    nearest = np.linalg.norm(kept.ends.mean(axis=1) - between, axis=1).min()
    assert nearest > 0.3


def test_centre_lines_lie_midway(rng: np.random.Generator, flat: Inputs) -> None:
    ends = np.array([[[0, 0], [4, 0]], [[4, -0.2], [0, -0.2]], [[0, 3], [4, 3]]], dtype=float)
    thick = flat.with_faces(ends, segments.left_normals(ends), np.ones(3, dtype=bool))
    lines = plans.centre_lines(thick, 0, rng).floorplan
    assert not lines.is_oriented.any()
    heights = sorted(lines.ends[:, :, 1].mean(axis=1))
    assert heights == pytest.approx([-0.1, 3.0])


def test_other_building_and_storey_have_other_walls(flat: Inputs, rng: np.random.Generator) -> None:
    plan = flat.floorplan
    other = plans.other_building(flat, 0, rng)
    assert not other.has_place
    ends, walked = other.floorplan.ends, flat.true_positions()[:, :2]
    middle = 0.5 * (ends.min(axis=(0, 1)) + ends.max(axis=(0, 1)))
    assert middle == pytest.approx(0.5 * (walked.min(axis=0) + walked.max(axis=0)))
    assert 0.5 < np.prod(other.floorplan.size) / np.prod(np.ptp(walked, axis=0) + 5.0) < 2.5
    storey = plans.other_storey(flat, 0, rng).floorplan
    same = np.abs(storey.ends - plan.ends).max(axis=(1, 2)) < 1e-9
    assert (same == plans.outer_faces(plan)).all()
    assert 0 < same.sum() < len(plan)


def test_images_change_as_named(flat: Inputs, rng: np.random.Generator) -> None:
    long = images.long_depth(flat, 2, rng)
    assert long.scan.files.depth(4) == pytest.approx(flat.scan.files.depth(4) * 1.05, nan_ok=True)
    focal = images.wrong_focal_length(flat, 1, rng)
    assert focal.scan.cameras[0].fx == pytest.approx(1.03 * flat.scan.cameras[0].fx)
    copied = images.copied_views(flat, 1, rng)
    shown = copied.scan.files.selected
    assert (shown != np.arange(len(shown))).sum() == images.COPIED_FRAMES[1]
    target = int(np.flatnonzero(shown != np.arange(len(shown)))[0])
    assert (copied.scan.files.color(target) == flat.scan.files.color(int(shown[target]))).all()
    prints = {inputs.scan.fingerprint for inputs in (flat, long, focal, copied)}
    assert len(prints) == 4


def test_posters_of_a_kind_look_the_same_and_hang_apart(
    flat: Inputs, rng: np.random.Generator
) -> None:
    assert flat.rendered is not None
    hung = images.hang_posters(flat.rendered, 1, 1.0, rng)
    n_bare = len(flat.rendered.renderer.quads)
    assert len(np.unique(hung.seed[n_bare:])) == 1
    assert len(np.unique(hung.size[n_bare:], axis=0)) == 1
    middle = hung.origin[n_bare:, :2]
    apart = np.linalg.norm(middle[:, None] - middle[None], axis=2)
    assert apart.max() > 5
    spoilt = images.posters(flat, 2, rng)
    changed = [
        (spoilt.scan.files.color(i) != flat.scan.files.color(i)).any(axis=2).mean()
        for i in range(0, 60, 10)
    ]
    assert 0.005 < np.mean(changed) < 0.5
    assert np.nanmedian(spoilt.scan.files.depth(0)) == pytest.approx(
        np.nanmedian(flat.scan.files.depth(0)), abs=0.05
    )


def test_same_offices_look_the_same() -> None:
    options = SynthOptions(
        seed=5, building=BuildingOptions(), walk=WalkOptions(n_frames=8), camera=CAMERA,
        depth_noise=NoDepthNoise(),
    )  # fmt: skip
    layout, options = same_rooms(options)
    synthetic = scan_of_layout(layout, options, has_same_rooms=True)
    assert synthetic.rendered is not None
    camera = synthetic.scan.cameras[0]
    views = []
    for room in layout.rooms[2:4]:
        eye = np.array([room.x0 + 1.2, room.y0 + 1.0, 1.5])
        facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # along y
        views.append(synthetic.rendered.renderer.render(camera, se3.make_transform(facing, eye)))
    assert np.mean(np.abs(views[0].color.astype(int) - views[1].color) > 8) < 0.02
    assert views[0].depth == pytest.approx(views[1].depth, abs=1e-6, nan_ok=True)


def test_corridor_is_long() -> None:
    layout, options = corridor(SynthOptions(walk=WalkOptions(n_frames=30), camera=CAMERA))
    synthetic = scan_of_layout(layout, options)
    assert np.ptp(synthetic.true_positions()[:, 0]) > 55
    # The camera walks on the plan that it is drawn in, between the walls.
    near = np.abs(synthetic.true_positions()[:, 1] - 1.1)
    assert near.max() < 1.8
    assert synthetic.floorplan.size == pytest.approx((68.1, 4.2), abs=0.1)


def test_niches_are_layers_of_wall_before_others() -> None:
    options = SynthOptions(seed=4, walk=WalkOptions(n_frames=20), camera=CAMERA)
    layout, options = niches(options)
    synthetic = scan_of_layout(layout, options, columns_are_walls=True)
    assert len(layout.columns) >= 5
    assert synthetic.rendered is not None
    assert not synthetic.rendered.building.faces.is_column.any()
    plan = synthetic.floorplan
    gaps = []
    for layer in layout.columns:
        room = next(room for room in layout.rooms if room.contains(layer.centre[None])[0])
        x, y = layer.centre
        gap = min(layer.x1 - room.x0, room.x1 - layer.x0, layer.y1 - room.y0, room.y1 - layer.y0)
        gaps.append(gap)
        # The plan has the layer's face, as long as the layer.
        is_its = np.linalg.norm(plan.ends.mean(axis=1) - [x, y], axis=1) < 0.11
        assert plan.lengths[is_its].max() == pytest.approx(max(layer.size), abs=1e-6)
    assert min(gaps) >= 0.1
    assert max(gaps) <= 0.2


# Numbers and choices.


def test_numbers_are_stable_and_enough() -> None:
    cases = all_cases()
    assert len(cases) >= 400
    assert [case.number for case in cases] == list(range(len(cases)))
    assert len({case.name for case in cases}) == len(cases)
    # What papers and pages cite stays: numbers given out once are not given to another case.
    assert cases[5].name == "conslam, drift 5: none"
    assert cases[98].name == "conslam, drift 5: one jump, 3 m, 20 deg"
    assert cases[192].name == "conslam, drift 5: walls moved, 30%"


def test_every_fault_has_all_sizes_in_both_halves_and_a_reference() -> None:
    cases = all_cases()
    references = {case.reference for case in cases if case.is_reference}
    assert {case.reference for case in cases} == references
    for name, fault in FAULTS.items():
        alone = [case for case in cases if [part.fault for part in case.parts] == [name]]
        assert {case.parts[0].size for case in alone} == set(range(len(fault.sizes)))
        assert {case.number % 2 for case in alone} == {0, 1}
        assert len({case.scan for case in alone}) > 1
    assert sum(len(case.parts) == 2 for case in cases) >= 60


def test_a_case_is_the_same_each_time_and_wherever_it_stands(flat: Inputs) -> None:
    parts = (Part("one jump", 1), Part("walls moved", 0))
    spoilt = [Case(n, "flat", 1, parts).spoil(drifted(flat, 1)) for n in (7, 7, 300)]
    for other in spoilt[1:]:
        assert (other.scan.world_from_cams == spoilt[0].scan.world_from_cams).all()
        assert (other.floorplan.ends == spoilt[0].floorplan.ends).all()
    assert len(broken_steps(drifted(flat, 1), spoilt[0])) == 1
    assert spoilt[0].moved_walls


def test_cases_that_run_side_by_side_may_render_the_same_scan(
    flat: Inputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two processes save at the same moment: each ends with all images, no file of the other is missed."""
    forked = multiprocessing.get_context("fork")
    together, save = forked.Barrier(2, timeout=30), np.save

    def save_together(path: Path, array: np.ndarray) -> None:
        save(path, array)
        together.wait()

    monkeypatch.setattr(np, "save", save_together)
    both = [forked.Process(target=keep_images, args=(flat.scan, tmp_path)) for _ in range(2)]
    for process in both:
        process.start()
    for process in both:
        process.join(60)
    assert [process.exitcode for process in both] == [0, 0]
    assert len(list(tmp_path.iterdir())) == 3


def test_choice_brings_its_references() -> None:
    cases = all_cases()
    chosen = choose(cases, "one jump, 3 m | walls moved, 30%", ("conslam",))
    assert {case.reference for case in chosen} == {
        case.reference for case in chosen if case.is_reference
    }
    faults = {part.fault for case in chosen for part in case.parts}
    assert {"one jump", "walls moved"} <= faults
    some = [case for case in choose(cases, every=6) if not case.is_reference]
    assert {case.number % 2 for case in some} == {0, 1}
    assert len(cases) / 8 < len(some) < len(cases) / 4


def test_moved_walls_count_where_they_are_seen_and_named(flat: Inputs) -> None:
    drawn = room_plan(6.0, 4.0)  # the first face along x at y = 0, looking to +y
    poses_in = np.array([look((x, 2.0, 1.5), -90.0) for x in (1.0, 3.0, 5.0)])
    built_m = 0.2  # the wall stands 0.2 m further into the room than it is drawn
    points = [np.array([[x - 0.5, built_m, 1.0], [x + 0.5, built_m, 2.0]]) for x in (1.0, 3.0, 5.0)]
    patches = [(k, points[k], (0.0, 1.0)) for k in range(3)]
    moved = MovedWall(np.array([0]), np.array([0.0, built_m]))
    inputs = replace(
        flat,
        floorplan=drawn,
        true_world_from_cams=poses_in,
        true_plan_from_world=np.eye(4),
        moved_walls=(moved,),
    )

    def found(n_patches: int, moved_m: float, offset_m: float) -> tuple[int, int]:
        on_first = np.where(np.arange(4) == 0, 1.0, np.nan)
        correspondences = SimpleNamespace(moved_m=moved_m * on_first)
        adjustment = SimpleNamespace(
            correspondences=correspondences, offsets_m=np.full(4, offset_m)
        )
        structure = make_structure(poses_in, patches=patches[:n_patches])
        return moved_walls_found(
            inputs, SimpleNamespace(structure=structure, adjustment=adjustment)
        )

    assert found(3, 0.2, 0.19) == (1, 1)
    assert found(3, 0.2, 0.25) == (1, 0)  # 5 cm off
    assert found(3, np.nan, 0.2) == (1, 0)  # not named
    assert found(2, 0.2, 0.2) == (0, 0)  # hardly seen


# Figures, of records made by hand.


def record(case: Case, exit_code: int, error_m: float | None, before_m: float = 1.0, **others):
    return Measured(
        case.number, case.name, "abc", exit_code, before_m=before_m, error_m=error_m, **others
    )


def case_of(number: int, *parts: Part, drift: int = 0) -> Case:
    return Case(number, "conslam", drift, parts)


def figure(results: list[Result], name: str):
    return next(figure for figure in make_figures(results) if figure.name == name)


def test_silent_wrong_is_counted_as_it_is_defined() -> None:
    none, jump, other = case_of(0), Part("one jump", 0), Part("other building", 0)
    rows = [
        (case_of(1, jump), 0, 0.09, 1.0, False),  # below 0.10 m
        (case_of(2, jump), 0, 0.14, 1.0, False),  # below three times 0.05 m
        (case_of(3, jump), 0, 0.16, 1.0, True),
        (case_of(4, jump), 1, 0.90, 1.0, False),  # said so
        (case_of(5, jump), 0, 0.06, 0.04, True),  # worse than the input
        (case_of(6, other), 0, 0.01, 1.0, True),  # has no place
    ]
    records = [record(none, 0, 0.05)]
    records += [record(case, code, error, before) for case, code, error, before, _ in rows]
    results = match_results([none, *(row[0] for row in rows)], records)
    assert [r.is_silent_wrong for r in results] == [False, *(row[4] for row in rows)]
    found = figure(results, "silent wrong")
    assert (found.found, found.n) == ("3", 7)


def test_right_results_and_jumps_are_measured_against_their_own_reference() -> None:
    jump = Part("two jumps", 1)
    cases = [case_of(0), case_of(1, drift=1), case_of(2, jump), case_of(3, jump, drift=1)]
    records = [
        record(cases[0], 0, 0.04),
        record(cases[1], 1, 0.20),
        record(cases[2], 0, 0.08),  # twice its own reference: not right; beyond 1.3 times + 2 cm
        record(cases[3], 1, 0.22),  # right, but not vouched for
    ]
    results = match_results(cases, records)
    vouched = figure(results, "vouched for when right")
    assert (vouched.found, vouched.n) == ("33%", 3)
    jumps = figure(results, "jumps within 1.3 times + 2 cm")
    assert (jumps.found, jumps.n) == ("50%", 2)


def test_a_faultless_run_that_went_wrong_is_no_measure_of_others() -> None:
    moved = Part("walls moved", 0)
    cases = [case_of(k, drift=k) for k in range(4)] + [case_of(4, moved, drift=3)]
    records = [
        record(case, 0, error)
        for case, error in zip(cases, (0.02, 0.03, 0.02, 0.9, 0.8), strict=True)
    ]
    results = match_results(cases, records)
    assert [r.faultless_m for r in results] == pytest.approx([0.02, 0.03, 0.02, 0.05, 0.05])
    assert [r.is_silent_wrong for r in results] == [False, False, False, True, True]
    assert [r.is_right for r in results] == [True, True, True, False, False]


def test_worst_of_refused_cases_has_no_result() -> None:
    moved = Part("walls moved", 1)
    cases = [case_of(0), case_of(1, moved), case_of(2, moved)]
    records = [record(cases[0], 0, 0.04), record(cases[1], 0, 0.12), record(cases[2], 2, None)]
    worst = figure(match_results(cases, records), "30 % of the walls moved, ConSLAM")
    assert (worst.found, worst.n) == ("0.120 m, 1 without result", 2)


def test_other_figures() -> None:
    large, shuffled = Part("plan too large", 1), Part("shuffled poses", 0)
    gl, posters, drift = Part("OpenGL axes", 0), Part("same posters", 0), Part("drift", 0)
    cases = [case_of(k, *parts) for k, parts in enumerate(
        ((), (large,), (large,), (shuffled,), (gl,), (gl,), (posters,), (drift,)))]  # fmt: skip
    records = [
        record(cases[0], 0, 0.04, cost=100.0, cost_from_truth=99.5),
        record(cases[1], 1, 0.05, scale_error=0.002),
        record(cases[2], 2, None),
        record(cases[3], 0, 0.5),
        record(cases[4], 1, 9.0, convention="OpenGL axes", is_recognised=True),
        record(cases[5], 1, 9.0, convention="OpenGL axes", is_recognised=False),
        # A wrong match may make a wrong place the cheaper one: no question of finding the best.
        record(cases[6], 3, None, cost=120.0, cost_from_truth=300.0),
        record(cases[7], 1, 0.3, cost=120.0, cost_from_truth=100.0),
    ]
    results = match_results(cases, records)
    assert figure(results, "scale: told within 0.3 %").found == "50%"
    vouched = [records[0], record(cases[1], 0, 0.05, scale_error=0.002), *records[2:]]
    assert figure(match_results(cases, vouched), "scale: told within 0.3 %").found == "0%"
    assert figure(results, "wrong plans, shuffled, constant: exit 0").found == "1"
    assert figure(results, "conventions named").found == "50%"
    assert figure(results, "conventions named wrongly of right poses").found == "0"
    assert figure(results, "look-alikes beyond 1.5 times").found == "1"
    assert figure(results, "optimality: cost within 1 %").found == "50%"
    assert figure(results, "optimality: others with exit 0").found == "0"
    assert figure(results, "crashes").found == "1"


def test_a_strict_run_ends_where_planfit_broke_its_word() -> None:
    jump, shuffled, gl = Part("one jump", 1), Part("shuffled poses", 0), Part("OpenGL axes", 0)
    cases = [case_of(k, *parts) for k, parts in enumerate(
        ((), (jump,), (jump,), (shuffled,), (jump,), (gl,), (jump,)))]  # fmt: skip
    kept = [
        record(cases[0], 0, 0.04),
        record(cases[1], 1, 0.50),  # wrong, and says so
        record(cases[3], 1, 9.0),
        record(cases[5], 2, None, convention="OpenGL axes", is_recognised=True),
    ]
    require_none_bad(match_results(cases, kept))
    for broken, words in (
        (record(cases[0], 1, 0.04), "0 conslam, drift 0: none: exit 1 without a fault"),
        (record(cases[2], 0, 0.50), "0.500 m off with exit 0"),
        (record(cases[3], 0, 0.01), "nothing of it can be right"),
        (record(cases[4], CRASHED, None), "crashed"),
        (record(cases[6], 0, 0.04, is_recognised=False), "a convention is named"),
    ):
        with pytest.raises(PlanfitError, match=re.escape(words)):
            require_none_bad(match_results(cases, [*kept, broken]))


def test_page_has_rows_and_halves() -> None:
    jump = Part("one jump", 1)
    cases = [case_of(0), case_of(1, jump), case_of(2, jump)]
    records = [
        record(cases[0], 0, 0.04, predicted_m=0.03, within_predicted=1.0),
        record(cases[1], 0, 0.50, predicted_m=0.04, within_predicted=0.2, largest_m=2.0),
        record(cases[2], 1, 0.30),
    ]
    row = fault_rows(match_results(cases, records))[1]
    assert (row.faults, row.size, row.n) == ("one jump", "3 m, 20 deg", 2)
    assert (row.median_m, row.worst_m, row.exit_codes) == (0.4, 0.5, (1, 1, 0, 0))
    predicted = reliability_rows(match_results(cases, records))
    assert [(r.n, r.median_error_m, r.within) for r in predicted] == [(2, 0.27, 0.6)]
    page = make_page(cases, records)
    # Even: two cases, none wrong; odd: one case, and that is.
    assert "| silent wrong | 0 | 0 | 2 | 1 | 1 |" in page
    assert (
        "- 1, conslam, drift 0: one jump, 3 m, 20 deg: 1.000 -> 0.500 m (one frame by 2.000 m)"
        in page
    )


# The runner.


def plain(case: Case, how: How) -> Measured:
    """Stands for a measurement: its time tells nothing, its words tell the process's way to end."""
    if case.number == 2:
        raise SystemExit(7)
    return Measured(case.number, case.name, how.digest, 0, "refined", before_m=1.0, error_m=0.1)


def test_done_cases_are_skipped_and_other_code_is_measured_again(tmp_path: Path) -> None:
    cases = [case_of(k, drift=k) for k in range(4)]
    path, told = tmp_path / "faults.jsonl", []

    def tell(measured: Measured, left: int) -> None:
        told.append(measured.number)

    how = How(tmp_path, "one")
    run_battery(cases[:2], path, how, 2, tell, plain)
    assert sorted(told) == [0, 1]
    told.clear()
    run_battery(cases, path, how, 2, tell, plain)
    assert sorted(told) == [2, 3]
    by_number = {m.number: m for m in read_measured(path)}
    assert by_number[2].exit_code == CRASHED
    assert "ended with 7" in by_number[2].said
    assert by_number[3] == plain(cases[3], how)
    told.clear()
    run_battery(cases[:1], path, replace(how, digest="two"), 1, tell, plain)
    assert told == [0]
    # A line cut off by an interruption is measured again; a file of another kind is refused.
    path.write_text(path.read_text() + '{"number": 3, "na')
    assert len(read_measured(path)) == 5
    path.write_text("{}\n{}\n")
    with pytest.raises(OutputError, match="line 1"):
        read_measured(path)


def test_errors_that_users_see_are_refusals_and_others_crashes(
    flat: Inputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("faults.measure.base_inputs", lambda *_: flat)
    how = How(tmp_path, "one")
    refused = measure(case_of(2, Part("millimetres", 0)), how)
    assert (refused.exit_code, refused.error_m) == (2, None)
    assert refused.is_recognised
    monkeypatch.setattr("faults.measure.planfit.refine", lambda *_: 1 / 0)
    crash = measure(case_of(3), how)
    assert crash.exit_code == CRASHED
    assert crash.said.startswith("ZeroDivisionError")


@pytest.mark.slow
def test_a_small_case_from_end_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = SynthOptions(
        seed=1,
        building=BuildingOptions(n_rooms=1),
        walk=WalkOptions(n_frames=30),
        camera=CameraOptions(width_px=200, height_px=150),
    )
    base = inputs_of(make_scan(options))
    monkeypatch.setattr("faults.measure.base_inputs", lambda *_: base)
    measured = measure(case_of(0), How(tmp_path, "one", is_optimality=True))
    assert measured.exit_code in (0, 1), measured.said
    assert measured.error_m is not None
    assert measured.before_m == pytest.approx(
        np.sqrt(
            np.mean(
                np.sum(
                    (drifted(base, 0).scan.world_from_cams - base.true_world_from_cams)[:, :3, 3]
                    ** 2,
                    axis=1,
                )
            )
        )
    )
    assert measured.error_m < 0.1
    assert measured.cost_from_truth is not None
    assert measured.cost == pytest.approx(measured.cost_from_truth, rel=0.2)
    assert measured.scale_error == pytest.approx(0.0, abs=1e-9)
