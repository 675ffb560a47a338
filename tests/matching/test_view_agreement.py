"""Dense agreement: view grids of a room and of its look-alikes, whose depth and greys are known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from painted_rooms import CELLS, POSTER, ROOM, grids_of

from builders import CAMERA, look, random_transforms, with_constants
from planfit.geometry import se3
from planfit.matching import view_agreement
from planfit.matching.agreement_kernels import FEW, NOISE, UNKNOWN, compare_views
from planfit.matching.types import RelativePoses
from planfit.matching.view_agreement import MAX_CONTRADICTED, compare, explained_shares
from planfit.matching.view_grids import (
    COLUMNS,
    ROWS,
    depth_grid,
    gather_grids,
    grey_grid,
)
from planfit.runtime.mapped import CAN_LET_GO, is_mapped


def pair(first, second, spread_m=0.3, n=40):
    """The motion between poses, and matched points about the poster in both camera frames."""
    rng = np.random.default_rng(5)
    points = POSTER + rng.uniform(-spread_m, spread_m, (n, 3)) * (0, 1, 1)
    relative_poses = RelativePoses(
        np.array([[0, 1]]), (se3.inverse(first) @ second)[None], np.array([n])
    )
    ends = [se3.transform(se3.inverse(pose), points) for pose in (first, second)]
    return relative_poses, [ends[0]], [ends[1]]


def agreement(found, grids):
    relative_poses, points_a, points_b = found
    result = compare(relative_poses, points_a, points_b, np.array([0.03]), grids)
    return float(result.matched[0]), float(result.contradicted[0]), float(result.likeness[0])


A, B = look([2.0, 2.0, 1.5], 10.0), look([1.5, 1.4, 1.4], -5.0)


def test_two_views_of_one_room_agree():
    matched, contradicted, likeness = agreement(pair(A, B), grids_of((A, *ROOM, 0), (B, *ROOM, 0)))
    assert contradicted == 0.0
    assert likeness > 0.9
    assert 0.01 < matched < 0.1


def test_the_same_poster_in_a_deeper_room_is_contradicted_by_free_space():
    # The second room's wall beside the poster is where it was, but the room is 2 m longer to one side.
    longer = (ROOM[0], ROOM[1] + (0.0, 2.0, 0.0))
    one, other = look([2.0, 2.0, 1.5], 40.0), look([1.5, 1.4, 1.4], 45.0)
    same = grids_of((one, *ROOM, 0), (other, *ROOM, 0))
    grids = grids_of((one, *ROOM, 0), (other, *longer, 0))
    assert agreement(pair(one, other), same)[1] < 0.01
    assert agreement(pair(one, other), grids)[1] > 0.15
    relative_poses, points_a, points_b = pair(one, other)
    sigma_m, is_neighbour = np.array([0.03]), np.array([False])
    explained = explained_shares(
        relative_poses, points_a, points_b, sigma_m, is_neighbour, grids, MAX_CONTRADICTED
    )
    assert explained[0] == 0.0


def test_the_same_poster_on_a_wall_painted_otherwise_is_unlike():
    _, contradicted, likeness = agreement(pair(A, B), grids_of((A, *ROOM, 0), (B, *ROOM, 1)))
    assert contradicted == 0.0
    assert likeness < 0.5


def test_what_a_nearer_surface_hides_says_nothing():
    grids = grids_of((A, *ROOM, 0), (B, *ROOM, 0))
    grids.depth_m[1, :, COLUMNS // 2 :] = 0.5
    motion = se3.inverse(A) @ B
    blocks = np.zeros((1, 6, 8), dtype=bool)
    counts = compare_views(
        np.array([[0, 1]]), motion[None], np.zeros(1), np.zeros((1, 3)), blocks, grids.depth_m,
        grids.grey, grids.cameras, np.array([0.06, 0.03, 0.5]),
    )[0]  # fmt: skip
    assert counts[1] == 0
    assert counts[0] > 500


@pytest.mark.parametrize("seed", range(3))
def test_the_compiled_loop_is_its_plain_twin(seed):
    rng = np.random.default_rng(seed)
    poses = [
        look([2.0, 2.0, 1.5], 10.0),
        look(rng.uniform(1.2, 2.8, 3) * (1, 1, 0.7), rng.uniform(-25, 25)),
    ]
    grids = grids_of(
        (poses[0], *ROOM, 0), (poses[1], ROOM[0], ROOM[1] + rng.uniform(-0.2, 0.2, 3), 0)
    )
    grids.depth_m[rng.random(grids.depth_m.shape) < 0.05] = np.nan
    motion = se3.inverse(poses[0]) @ poses[1]
    middle, sigma_rotation = np.array([0.0, 0.0, 2.5]), 0.05
    blocks = rng.random((6, 8)) < 0.2
    tolerance = np.array([0.06, 0.03, 0.5])
    found = compare_views(
        np.array([[0, 1]]), motion[None], np.array([sigma_rotation]), middle[None], blocks[None],
        grids.depth_m, grids.grey, grids.cameras, tolerance,
    )[0]  # fmt: skip
    expected = _plain(motion, sigma_rotation, middle, blocks, grids, tolerance)
    assert_array_equal(found[:2], expected[:2])
    assert_allclose(found[2], expected[2], atol=1e-9)
    assert found[0] > 100


def _plain(motion, sigma_rotation, middle, blocks, grids, tolerance):
    uv = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).reshape(-1, 2)
    depth = grids.depth_m[0].reshape(-1).astype(float)
    measured = depth > 0
    uv, points = uv[measured], CELLS.lift(uv[measured].astype(float), depth[measured])
    in_b = se3.transform(se3.inverse(motion), points)
    at = np.floor(CELLS.project(np.where(in_b[:, 2:] > 0.2, in_b, np.nan)) + 0.5)
    inside = (at >= 0).all(axis=1) & (at < (COLUMNS, ROWS)).all(axis=1)
    n_agreeing, n_past, greys = 0, 0, []
    for k in np.flatnonzero(inside):
        column, row = at[k].astype(int)
        if not grids.depth_m[1, row, column] > 0:
            continue
        around = grids.depth_m[1, max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        z = in_b[k, 2]
        allowed = tolerance[0] + tolerance[1] * max(points[k, 2], z)
        allowed += tolerance[2] * sigma_rotation * np.linalg.norm(points[k] - middle)
        if z < np.nanmin(around) - allowed:
            n_past += 1
        elif z <= np.nanmax(around) + allowed:
            n_agreeing += 1
            if not blocks[uv[k, 1] // 8, uv[k, 0] // 8]:
                greys.append((grids.grey[0, uv[k, 1], uv[k, 0]], grids.grey[1, row, column]))
    a, b = np.array(greys, dtype=float).T
    alike = np.mean((a - a.mean()) * (b - b.mean()))
    likeness = (alike + UNKNOWN * NOISE) / (a.std() * b.std() + NOISE)
    return n_agreeing, n_past, (len(a) * likeness + FEW * UNKNOWN) / (len(a) + FEW)


def test_options():
    grids = grids_of((A, *ROOM, 0), (B, *ROOM, 0))
    off = grids_of((A, *ROOM, 0), (B, ROOM[0], ROOM[1] + (0.4, 0.0, 0.0), 0))
    found = pair(A, B)
    assert agreement(found, off)[1] > 0.2
    for wider in ({"base_m": 0.5}, {"per_m": 0.15}, {"sigmas_of_rotation": 20.0}):
        # The poster is where the motion is surely known; the wall about it may be off by the rotation.
        with with_constants(view_agreement, **wider):
            wide = agreement(found, off)[1]
        assert wide < agreement(found, off)[1]

    def explained(is_neighbour=False, max_contradicted=MAX_CONTRADICTED):
        pairs = found[0]
        return explained_shares(
            pairs, *found[1:], np.array([0.03]), np.array([is_neighbour]), off,
            max_contradicted,
        )[0]  # fmt: skip

    assert explained() == 0.0
    assert explained(max_contradicted=0.9) > 0.0
    assert explained(is_neighbour=True) > 0.0  # a camera whose neighbours disagree as much
    with with_constants(view_agreement, usual_factor=0.5):
        assert explained(is_neighbour=True) == 0.0
    assert agreement(found, grids)[1] == 0.0


def test_matches_all_over_the_view_explain_more_than_those_on_a_poster():
    grids = grids_of((A, *ROOM, 0), (B, *ROOM, 0))
    small, large = (agreement(pair(A, B, spread_m), grids)[0] for spread_m in (0.2, 1.0))
    # The area in the image grows as the square of the object.
    assert_allclose(large / small, 25.0, rtol=0.2)


def test_no_pairs():
    none = RelativePoses(np.zeros((0, 2), dtype=int), np.zeros((0, 4, 4)), np.zeros(0, dtype=int))
    found = explained_shares(
        none, [], [], np.zeros(0), np.zeros(0, bool), grids_of((A, *ROOM, 0)), MAX_CONTRADICTED
    )
    assert found.shape == (0,)


def test_a_cell_has_the_median_of_its_depth_or_none():
    rng = np.random.default_rng(0)
    depth = rng.uniform(1, 4, (3 * ROWS, 3 * COLUMNS)).astype(np.float32)  # nine pixels a cell
    depth[rng.random(depth.shape) < 0.4] = np.nan
    found = depth_grid(depth)
    for row, column in rng.integers(0, (ROWS, COLUMNS), (200, 2)):
        cell = depth[3 * row : 3 * row + 3, 3 * column : 3 * column + 3].reshape(-1)
        known = np.sort(cell[np.isfinite(cell)])
        expected = known[(len(known) - 1) // 2] if len(known) >= 5 else np.nan
        assert_array_equal(found[row, column], np.float32(expected))


@pytest.mark.parametrize("size", [(386, 516), (48, 64), (20, 30), (480, 640)])
def test_grids_of_images_of_any_size(size):
    row = 1.0 + (np.arange(size[1], dtype=np.float32) + 0.5) / size[1]
    depth = np.tile(row, (size[0], 1))
    found = depth_grid(depth)
    assert_allclose(found[0], 1.0 + (np.arange(COLUMNS) + 0.5) / COLUMNS, atol=0.6 / size[1] + 0.01)
    assert grey_grid(np.full((*size, 3), 90, np.uint8)).shape == (ROWS, COLUMNS)


def test_gathered_grids_have_cameras_in_cells():
    depth_m, grey = np.ones((ROWS, COLUMNS), np.float32), np.zeros((ROWS, COLUMNS), np.uint8)
    grids = gather_grids([depth_m] * 2, [grey] * 2, (CAMERA, replace(CAMERA, fx=260.0)))
    assert len(grids) == 2
    assert_allclose(grids.cameras[:, 0], [130.0 * COLUMNS / 160, 260.0 * COLUMNS / 160])


def test_grids_in_a_file_are_those_in_memory(rng, monkeypatch):
    depths_m = rng.uniform(1, 5, (7, ROWS, COLUMNS)).astype(np.float32)
    greys = [*rng.integers(0, 255, (7, ROWS, COLUMNS)).astype(np.uint8)]
    cameras = [CAMERA] * 7
    in_memory = gather_grids([*depths_m], greys, cameras)
    monkeypatch.setattr("planfit.runtime.mapped.MIN_BYTES", 1)
    mapped = gather_grids(iter(depths_m), greys, cameras)
    idx = np.array([6, 0, 3])
    for one, other in (
        (in_memory, mapped),
        (in_memory[idx], mapped[idx]),
        (in_memory.joined(in_memory[idx]), mapped.joined(mapped[idx])),
    ):
        assert is_mapped(other.depth_m) == CAN_LET_GO
        assert_array_equal(one.depth_m, other.depth_m)
        assert_array_equal(one.grey, other.grey)
    motions = random_transforms(rng, 6, max_rotation=0.2, extent_m=0.3)
    pairs = np.column_stack([np.arange(6), np.arange(1, 7)])
    relative = RelativePoses(pairs, motions, np.full(6, 20))
    points = [CAMERA.lift(rng.uniform(10, 100, (20, 2)), np.full(20, 3.0)) for _ in range(6)]
    found, expected = (
        compare(relative, points, points, np.full(6, 0.03), grids) for grids in (mapped, in_memory)
    )
    assert_array_equal(found.contradicted, expected.contradicted)
    assert_array_equal(found.likeness, expected.likeness)


def test_pairs_are_compared_in_parts_that_change_nothing(monkeypatch):
    views = [look([2.0 - 0.1 * k, 2.0, 1.5], 10.0 - 3 * k) for k in range(4)]
    grids = grids_of(*((view, *ROOM, 0) for view in views))
    found = [pair(views[k], views[k + 1], 0.1 * (k + 1), 20 + k) for k in range(3)]
    relative_poses = RelativePoses(
        np.array([[k, k + 1] for k in range(3)]),
        np.concatenate([each[0].a_from_b for each in found]),
        np.array([20, 21, 22]),
    )
    points = [each[1][0] for each in found], [each[2][0] for each in found]
    args = (relative_poses, *points, np.full(3, 0.03), grids)
    whole = compare(*args)
    monkeypatch.setattr("planfit.matching.view_agreement.PAIRS_AT_A_TIME", 2)
    parts = compare(*args)
    assert whole.shared.min() > 0.3
    for name, values in vars(whole).items():
        assert_array_equal(getattr(parts, name), values)
