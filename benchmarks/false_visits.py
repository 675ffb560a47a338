"""False revisits put into walks with known truth: are they found, and do the walks end as without them?

    python benchmarks/false_visits.py [--first-seed 0] [--seeds 5]

Problems are made without images (`problems.py`): two laps round a ring corridor, 400 frames; a fifth of the
steps has no match, revisits are seen in three of 15 frames. Each false visit claims, in six pairs of frames
that agree with each other, that a stretch of the walk is another, up to 20 m away. Position errors are RMS
after closing loops: without false visits, with them, and with them but without looking for torn steps.
"""

import argparse
from dataclasses import replace

import numpy as np
from problems import Problem, make_problem

from planfit.adjust import AdjustOptions, Measurements, close_loops, close_loops_untorn
from planfit.evaluation import position_errors
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.synth import DriftOptions

N_FRAMES, PER_LAP = 400, 200
N_PAIRS, PER_PAIR = 6, 30
POSTER_EXPLAINS, ROOM_EXPLAINS = 0.05, 0.3


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=5)
    arguments = parser.parse_args()
    print("seed  false  without m  with m  unsought m  false pairs dropped  true  steps torn")
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
        for n_false in (1, 3):
            show(seed, n_false)


def show(seed: int, n_false: int) -> None:
    rng = np.random.default_rng(seed)
    problem = make_walk(seed, rng)
    measurements, is_false = with_false_visits(problem, n_false, rng)
    start, options = problem.initial_plan_from_cams, AdjustOptions()

    def error(poses: np.ndarray) -> float:
        return position_errors(poses, problem.true_plan_from_cams).rms_m

    clean = close_loops(problem.measurements, start, options).target_from_cams
    unsought = close_loops(measurements, start, options).target_from_cams
    closed = close_loops_untorn(measurements, start, options)
    print(
        f"{seed:4d} {n_false:6d} {error(clean):10.3f} {error(closed.solution.target_from_cams):7.3f} "
        f"{error(unsought):11.3f} {(closed.is_dropped & is_false).sum():13d} of {is_false.sum():3d} "
        f"{(closed.is_dropped & ~is_false).sum():5d} {len(closed.torn_steps):11d}",
        flush=True,
    )


def make_walk(seed: int, rng: np.random.Generator) -> Problem:
    drift = DriftOptions(yaw_deg=0.1, translation_m=0.01)
    problem = make_problem(
        N_FRAMES, seed, PER_LAP, 1, matches_per_pair=PER_PAIR, points_per_frame=40, drift=drift
    )
    matches = problem.measurements.matches
    is_step = matches.pairs[:, 1] - matches.pairs[:, 0] == 1
    is_kept = np.where(is_step, rng.random(len(is_step)) > 0.2, matches.pairs[:, 0] % 15 < 3)
    kept = matches.of_pairs(is_kept)
    kept = replace(kept, explained=np.full(len(kept.pairs), ROOM_EXPLAINS))
    return replace(problem, measurements=replace(problem.measurements, matches=kept))


def with_false_visits(
    problem: Problem, n_false: int, rng: np.random.Generator
) -> tuple[Measurements, np.ndarray]:
    """Measurements with false visits among them, and which pairs (p,) are of those."""
    true, matches = problem.true_plan_from_cams, problem.measurements.matches
    pairs, points_a, points_b = [], [], []
    for _ in range(n_false):
        i = rng.integers(0, N_FRAMES - 120)
        j = rng.integers(i + 100, N_FRAMES - N_PAIRS)
        # The later stretch as it would be if its first frame stood beside frame i.
        claimed = true[i].copy()
        claimed[:2, 3] += rng.uniform(-1, 1, 2)
        for k in range(N_PAIRS):
            motion = se3.inverse(true[i + k]) @ claimed @ se3.inverse(true[j]) @ true[j + k]
            seen = rng.uniform([-0.5, -0.5, 2.0], [0.5, 0.5, 3.0], (PER_PAIR, 3))
            pairs.append((i + k, j + k))
            points_b.append(seen)
            points_a.append(se3.transform(motion, seen) + 0.02 * rng.standard_normal((PER_PAIR, 3)))
    false = np.repeat(np.array(pairs), PER_PAIR, axis=0)
    old = np.repeat(matches.pairs, np.diff(matches.start), axis=0)
    both = Matches.from_arrays(
        np.concatenate([old, false]),
        np.concatenate([matches.points_a, *points_a]),
        np.concatenate([matches.points_b, *points_b]),
        float(matches.sigma[0]),
    )
    is_false = np.isin(both.pairs @ (N_FRAMES, 1), false @ (N_FRAMES, 1))
    explained = np.where(is_false, POSTER_EXPLAINS, ROOM_EXPLAINS)
    matches = replace(both, explained=explained)
    return replace(problem.measurements, matches=matches), is_false


if __name__ == "__main__":
    main()
