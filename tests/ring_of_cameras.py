"""Cameras on a ring in a round room, with errors of walls, patches, matches and steps that are known."""

from dataclasses import replace

import numpy as np

from builders import faces_plan, look, make_matches, make_structure, make_ties, nudged
from planfit.adjust import AdjustOptions, Measurements, build_problem
from planfit.adjust.association import Association
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry

N, N_FACES = 24, 16
PATCH_M, MATCH_M, FLOOR_M = 0.015, 0.01, 0.008
STATED_PATCH_M = 0.05 / 2
"""Standard deviation of a patch's mean by the default options: sigma 5 cm, four effective observations."""


def round_room():
    corner = np.arange(N_FACES) * 2 * np.pi / N_FACES
    return faces_plan(6.0 * np.column_stack([np.cos(corner), np.sin(corner)]))


def noisy_problem(rng, drawn_m, patch_m=PATCH_M, walls=True, moved_m=(), held_by=range(N_FACES)):
    """Truth, and a problem solved: cameras on a ring look outwards, each at three faces and the floor.

    `moved_m`: pairs of a face and how far it stands off where it is drawn; `held_by`: faces that are found.
    """
    plan = round_room()
    angle = np.arange(N) * 360.0 / N
    at = 3.0 * np.column_stack([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    truth = np.stack([look([*p, 1.5], a, 15) for p, a in zip(at, angle, strict=True)])
    offsets_m = drawn_m * rng.normal(size=N_FACES)
    for face, by_m in moved_m:
        offsets_m[face] += by_m
    floor, patches, faces = [], [], []
    for i in range(N):
        below = np.array([*at[i], FLOOR_M * rng.normal()])
        floor.append((i, below + rng.uniform([-2, -2, 0], [2, 2, 0], (60, 3))))
        for face in (round(angle[i] / 22.5 - 0.5) + np.arange(-1, 2)) % N_FACES:
            first, last = plan.ends[face]
            xy = first + (last - first) * rng.uniform(0.1, 0.9, (240, 1))
            xy = xy + (offsets_m[face] + patch_m * rng.normal()) * plan.normals[face]
            on_wall = np.column_stack([xy, rng.uniform(0.3, 2.5, 240)])
            patches.append((i, on_wall, plan.normals[face]))
            faces.append(face if face in held_by else -1)
    pairs = sorted(tuple(sorted((i, (i + k) % N))) for i in range(N) for k in (1, 2))
    matches = make_matches(truth, pairs, rng.uniform([-6, -6, 0], [6, 6, 2.5], (40, 3)))
    off = np.repeat(MATCH_M * rng.normal(size=(len(pairs), 3)), 40, axis=0)
    matches = replace(matches, points_b=matches.points_b + off)
    exact = make_odometry(truth, OdometryOptions())
    steps = exact.cam_from_next.copy()
    for k in range(N - 1):
        sigma = [exact.sigma_rotation[k]] * 3 + [exact.sigma_translation[k]] * 3
        steps[k] = se3.retract(steps[k], sigma * rng.normal(size=6))
    odometry = replace(exact, cam_from_next=steps)
    measured = Measurements(matches, make_structure(truth, floor, patches), odometry)
    ties = make_ties(plan, Association(np.array(faces), np.zeros(len(faces))), N)
    start = nudged(rng, truth, 0.05, 0.005)
    problem = build_problem(measured, AdjustOptions(), start, ties if walls else None)
    return truth, replace(problem, unknowns=problem.solve().target_from_cams)
