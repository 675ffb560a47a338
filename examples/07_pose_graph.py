"""Solve a pose graph with planfit's engine alone: a sphere of 2,500 noisy poses, by way of a g2o file.

Takes a few seconds; leaves nothing behind.
"""

import tempfile
from pathlib import Path

import numpy as np

from planfit.geometry import se3
from planfit.lsq import BetweenTerm, PoseGraph, PosePriorTerm, Problem, read_g2o, write_g2o

N_RINGS, PER_RING, RADIUS_M = 50, 50, 50.0
SIGMA = np.repeat([0.02, 0.1], 3)  # rad, m; of every measured step

# The truth: a spiral on a sphere, from pole to pole.
rng, k = np.random.default_rng(0), np.arange(N_RINGS * PER_RING)
about_z = se3.exp_so3(2 * np.pi / PER_RING * k[:, None] * [0.0, 0.0, 1.0])
about_y = se3.exp_so3(np.pi * (k[:, None] + 0.5) / len(k) * [0.0, 1.0, 0.0])
true_poses = se3.make_transform(about_z @ about_y, RADIUS_M * (about_z @ about_y)[:, :, 2])

# What is measured: the step to the next pose, and that to the pose of the next ring.
pairs = np.concatenate([np.stack([k[:-step], k[step:]], axis=1) for step in (1, PER_RING)])
exact = se3.inverse(true_poses[pairs[:, 0]]) @ true_poses[pairs[:, 1]]
measured = se3.retract(exact, SIGMA * rng.normal(size=(len(pairs), 6)))
poses = true_poses.copy()
for i in k[:-1]:
    poses[i + 1] = poses[i] @ measured[i]
information = np.tile(np.diag(SIGMA**-2), (len(pairs), 1, 1))
with tempfile.TemporaryDirectory() as directory:
    path = Path(directory) / "sphere.g2o"
    write_g2o(path, PoseGraph(poses, pairs, measured, information))
    graph = read_g2o(path)

problem = Problem(
    [
        BetweenTerm(graph.pairs, graph.first_from_second, information=graph.information),
        PosePriorTerm(np.array([0]), graph.target_from_cams[:1], np.full(6, 0.01)),
    ],
    graph.target_from_cams,
)
solution = problem.solve()
cost = solution.cost_by_term["between"]
print(f"{len(graph.target_from_cams)} poses, {len(graph.pairs)} measurements")
print(f"cost {cost.before:.6g} before, {cost.after:.6g} after; {solution.stop.value}")
