"""The pass over the points in PyTorch: the same as the compiled one, on the CPU and on a GPU."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import make_world, nudged
from planfit.adjust import AdjustOptions, adjust_to_plan
from planfit.adjust.terms.between import PointTerm
from planfit.adjust.terms.levels import floor_term
from planfit.adjust.terms.observation_models import FLOOR, POINTS, WALLS
from planfit.adjust.terms.walls import WallTerm
from planfit.errors import OptionError
from planfit.lsq import torch_moments
from planfit.lsq.moments import pair_moments, plane_moments
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.solver import SolverOptions, solve

LOSSES = [Loss(kind, 1e-3 if kind is LossKind.NORM else 1.5) for kind in LossKind]


@pytest.fixture(params=["cpu", "cuda"])
def device(request):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (planfit[torch])")
    if request.param == "cuda" and not torch.cuda.is_available():
        pytest.skip("no GPU that PyTorch can use")
    return request.param


def groups(rng, sizes):
    start = np.cumsum([0, *sizes])
    return start, rng.normal(size=(start[-1], 3)) * (2, 1, 3)


def assert_same_blocks(one, other):
    assert np.array_equal(one.rows, other.rows)
    assert np.array_equal(one.columns, other.columns)
    for name in ("blocks", "gradient"):
        expected = getattr(one, name)
        assert_allclose(getattr(other, name), expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.kind.name.lower())
def test_planes(loss, device, rng, monkeypatch):
    monkeypatch.setattr(torch_moments, "_PART_POINTS", 100)  # several parts
    start, points = groups(rng, [40, 0, 90, 1, 130, 7])
    poses = nudged(rng, np.tile(np.eye(4), (4, 1, 1)), 40, 1.0)
    normals = rng.normal(size=(6, 3))
    planes = np.column_stack(
        [normals / np.linalg.norm(normals, axis=1)[:, None], rng.normal(size=6)]
    )
    rest = (
        np.array([0, 0, 1, 2, 2, 3]),
        planes,
        np.array([1.0, 2, 0, 1, 0.5, 3]),
        poses,
        0.3,
        loss,
    )
    expected, cost = plane_moments(points, start, *rest)
    on_device = torch_moments.GroupedPoints(device, start, points)
    found, other_cost = torch_moments.plane_moments_on(on_device, *rest)
    assert_allclose(other_cost, cost, rtol=1e-9)
    scale = np.abs(expected.moments).max()
    assert_allclose(found.moments, expected.moments, atol=1e-10 * scale)
    moved = nudged(rng, poses, 2, 0.1)
    assert_allclose(found.cost(moved), expected.cost(moved), rtol=1e-9)
    assert_same_blocks(expected.normal_blocks(moved), found.normal_blocks(moved))


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.kind.name.lower())
def test_pairs(loss, device, rng, monkeypatch):
    monkeypatch.setattr(torch_moments, "_PART_POINTS", 100)
    start, a = groups(rng, [30, 0, 80, 120, 5])
    b = a + 0.3 * rng.normal(size=a.shape)
    sigma = rng.uniform(0.1, 0.5, len(a))
    poses = nudged(rng, np.tile(np.eye(4), (4, 1, 1)), 20, 0.5)
    pairs = np.array([[0, 1], [1, 2], [3, 2], [0, 3], [2, 0]])
    information = np.array([1.0, 1.0, 0.0, 2.0, 0.3])
    expected, cost = pair_moments(a, b, sigma, start, pairs, information, poses, loss)
    on_device = torch_moments.GroupedPoints(device, start, a, b, sigma)
    found, other_cost = torch_moments.pair_moments_on(on_device, pairs, information, poses, loss)
    assert_allclose(other_cost, cost, rtol=1e-9)
    for name in ("aa", "ab", "bb"):
        moments = getattr(expected, name)
        scale = 1e-10 * np.abs(moments).max()
        assert_allclose(getattr(found, name), moments, atol=scale)
    moved = nudged(rng, poses, 2, 0.1)
    assert_allclose(found.cost(moved), expected.cost(moved), rtol=1e-9)
    assert_same_blocks(expected.normal_blocks(moved), found.normal_blocks(moved))


def test_no_points(device):
    none = torch_moments.GroupedPoints(device, np.zeros(1, dtype=int), np.zeros((0, 3)))
    nowhere = (np.zeros(0, dtype=int), np.zeros((0, 4)), np.zeros(0), np.tile(np.eye(4), (2, 1, 1)))
    found, cost = torch_moments.plane_moments_on(none, *nowhere, 0.1, Loss())
    assert cost == 0.0
    assert not found.normal_blocks(nowhere[-1]).blocks.any()


def device_of_terms(device, monkeypatch):
    """Terms take PyTorch for "cuda" alone: on the CPU, let that be its CPU."""
    if device == "cpu":
        real = torch_moments.GroupedPoints.__init__

        def on_torch_cpu(self, _, *rest):
            real(self, "cpu", *rest)

        monkeypatch.setattr(torch_moments.GroupedPoints, "__init__", on_torch_cpu)
    return "cuda"


def test_pairs_that_are_left_out_are_left_out_on_a_device_too(device, rng, monkeypatch):
    world = make_world(rng)
    is_kept = np.arange(len(world.matches.pairs)) % 2 == 0
    where = device_of_terms(device, monkeypatch)
    term = PointTerm(world.matches, POINTS, device=where, is_kept=is_kept)
    moments, _ = term.reweight(world.plan_from_cams)
    assert np.array_equal(moments.pairs, world.matches.pairs[is_kept])


def test_a_solve_ends_at_the_same_poses(device, rng, monkeypatch):
    world = make_world(rng)
    start = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    association = adjust_to_plan(
        world.measurements, world.floorplan, start, AdjustOptions()
    ).association

    def terms(where):
        return [
            PointTerm(world.matches, POINTS, device=where),
            floor_term(world.structure, FLOOR, where),
            WallTerm(world.structure.walls, world.floorplan, association, WALLS, device=where),
        ]

    where = device_of_terms(device, monkeypatch)
    one = solve(terms("cpu"), start, SolverOptions())
    other = solve(terms(where), start, SolverOptions())
    assert_allclose(other.target_from_cams, one.target_from_cams, atol=1e-8)
    for name, cost in one.cost_by_term.items():
        assert_allclose(other.cost_by_term[name].after, cost.after, rtol=1e-6, atol=1e-9)


def test_a_gpu_that_is_not_there_is_refused(rng):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (planfit[torch])")
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    world = make_world(rng)
    options = AdjustOptions(solver=SolverOptions(device="cuda"))
    with pytest.raises(OptionError, match=r"expected a GPU .* --adjust.solver.device cpu"):
        adjust_to_plan(world.measurements, world.floorplan, world.plan_from_cams, options)


@pytest.mark.parametrize(
    "changes",
    [
        {"geometric": "rays"},
        {"wall_strategy": "iterative"},
        {"wall_offset_sigma_m": 0.02},
    ],
)
def test_terms_that_do_not_run_on_a_gpu_are_refused(changes):
    on_gpu = AdjustOptions(solver=SolverOptions(device="cuda"))
    with pytest.raises(OptionError, match="use cpu for other terms"):
        replace(on_gpu, **changes)
