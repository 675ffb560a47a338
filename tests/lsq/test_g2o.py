"""Pose graphs in g2o's files: there and back, bad lines by number, and GTSAM's word for the cost."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from lsq.pose_graphs import random_information, sphere
from planfit.errors import PlanfitError
from planfit.lsq import (
    BetweenTerm,
    PoseGraph,
    PosePriorTerm,
    Problem,
    SolverOptions,
    read_g2o,
    write_g2o,
)


@pytest.mark.parametrize("half_angles", [True, False])
def test_what_is_written_is_read(tmp_path, rng, half_angles):
    graph, _ = sphere(rng)
    information = random_information(rng, len(graph.pairs))
    graph = PoseGraph(
        graph.target_from_cams, graph.pairs, graph.first_from_second, information, (0, 4)
    )
    write_g2o(tmp_path / "graph.g2o", graph, half_angles)
    found = read_g2o(tmp_path / "graph.g2o", half_angles)
    assert_allclose(found.target_from_cams, graph.target_from_cams, atol=1e-9)
    assert_array_equal(found.pairs, graph.pairs)
    assert_allclose(found.first_from_second, graph.first_from_second, atol=1e-9)
    assert_allclose(found.information, information, rtol=1e-7, atol=1e-7)
    assert found.fixed == (0, 4)


def test_information_is_of_translation_then_half_the_angle(tmp_path):
    sigmas = np.array([0.1, 0.2, 0.5, 1.0, 2.0, 4.0])
    graph = PoseGraph(
        np.tile(np.eye(4), (2, 1, 1)),
        np.array([[0, 1]]),
        np.eye(4)[None],
        np.diag(sigmas**-2)[None],
    )
    write_g2o(tmp_path / "graph.g2o", graph)
    edge = (tmp_path / "graph.g2o").read_text().splitlines()[-1].split()
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = [float(word) for word in edge[10:]]
    assert_allclose(np.diagonal(upper), [1.0, 0.25, 0.0625, 400.0, 100.0, 16.0])


def test_ids_need_not_count_up(tmp_path):
    (tmp_path / "graph.g2o").write_text(
        "# a comment\n\n"
        "VERTEX_SE3:QUAT 7 1 0 0 0 0 0 1\n"
        "VERTEX_SE3:QUAT 3 2 0 0 0 0 0 2\n"
        "FIX 7\n"
        "EDGE_SE3:QUAT 7 3 5 0 0 0 0 0 1 " + " ".join(["1"] * 21) + "\n"
    )
    graph = read_g2o(tmp_path / "graph.g2o")
    assert_array_equal(graph.target_from_cams[:, 0, 3], [2.0, 1.0])
    assert_array_equal(graph.pairs, [[1, 0]])
    assert graph.fixed == (1,)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("VERTEX_SE2 0 1 2 3", "expected VERTEX_SE3:QUAT, .* found 'VERTEX_SE2'"),
        ("VERTEX_SE3:QUAT 0 1 2 3", "expected 8 numbers, found 4"),
        ("VERTEX_SE3:QUAT 0 1 2 3 0 0 0 0", "a quaternion that is not zero"),
        ("VERTEX_SE3:QUAT 0 nan 2 3 0 0 0 1", "expected finite numbers"),
        ("VERTEX_SE3:QUAT a 1 2 3 0 0 0 1", "invalid literal"),
    ],
)
def test_a_bad_line_is_named(tmp_path, line, message):
    path = tmp_path / "bad.g2o"
    path.write_text("\n" + line + "\n")
    with pytest.raises(PlanfitError, match=f"bad.g2o:2: .*{message}"):
        read_g2o(path)


def test_an_edge_to_nowhere_is_named(tmp_path):
    path = tmp_path / "bad.g2o"
    path.write_text("EDGE_SE3:QUAT 0 9 5 0 0 0 0 0 1 " + " ".join(["1"] * 21) + "\n")
    with pytest.raises(PlanfitError, match="a vertex for every id, found none for 0"):
        read_g2o(path)


def test_the_cost_is_what_gtsam_finds(tmp_path, rng):
    """GTSAM reads the very file, takes rotation vectors for g2o's quaternions, and the SE(3) logarithm."""
    gtsam = pytest.importorskip("gtsam")
    made, _ = sphere(rng, n_rings=12, per_ring=20, sigma=(0.05, 0.3))
    write_g2o(tmp_path / "sphere.g2o", made)
    graph, initial = gtsam.readG2o(str(tmp_path / "sphere.g2o"), True)
    ours = read_g2o(tmp_path / "sphere.g2o", half_angles=False)
    poses = ours.target_from_cams
    term = BetweenTerm(
        ours.pairs, ours.first_from_second, information=ours.information, chart="se3"
    )
    assert_allclose(term.reweight(poses)[1], graph.error(initial), rtol=1e-9)

    prior = PosePriorTerm(np.array([0]), poses[:1], np.full(6, 0.01))
    solution = Problem([prior, term], poses).solve(SolverOptions(200, cost_tolerance=1e-12))
    held = gtsam.NonlinearFactorGraph(graph)
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 0.01)
    held.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(poses[0]), tight))
    params = gtsam.LevenbergMarquardtParams()
    params.setRelativeErrorTol(1e-12)
    params.setAbsoluteErrorTol(0.0)
    params.setMaxIterations(200)
    theirs = gtsam.LevenbergMarquardtOptimizer(held, initial, params).optimize()
    found = gtsam.Values()
    for k, pose in enumerate(solution.target_from_cams):
        found.insert(k, gtsam.Pose3(pose))
    after = solution.cost_by_term["between"].after
    assert_allclose(after, graph.error(theirs), rtol=1e-6)
    assert_allclose(after, graph.error(found), rtol=1e-6)
    assert after < 0.1 * graph.error(initial)
