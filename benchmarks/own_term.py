"""A term of one's own, by differences, against the built-in one of the same residuals: time of a round.

    python benchmarks/own_term.py

10^5 relative poses between 1,000 poses, a robust loss. A round is one reweighting and one linearisation
(blocks of the normal equations), which is where terms differ; one thread of BLAS, as in a solve.
"""

import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from planfit.geometry import se3
from planfit.lsq import BetweenTerm, Loss, LossKind, ResidualTerm
from planfit.lsq.term import Term

N_POSES, N_ROWS, REPEATS = 1_000, 100_000, 5
LOSS = Loss(LossKind.CAUCHY, 2.4)


def main() -> None:
    rng = np.random.default_rng(0)
    poses = se3.retract(np.tile(np.eye(4), (N_POSES, 1, 1)), rng.normal(size=(N_POSES, 6)))
    first = rng.integers(N_POSES, size=N_ROWS)
    pairs = np.stack([first, (first + rng.integers(1, 50, N_ROWS)) % N_POSES], axis=1)
    exact = se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]
    measured = se3.retract(exact, 0.05 * rng.normal(size=(N_ROWS, 6)))
    second_from_first = se3.inverse(measured)

    def departure(at: np.ndarray) -> np.ndarray:
        error = second_from_first @ se3.inverse(at[:, 0]) @ at[:, 1]
        return np.concatenate([se3.log_so3(error[:, :3, :3]), error[:, :3, 3]], axis=1)

    built_in = BetweenTerm(pairs, measured, sigma=0.05, loss=LOSS)
    own = ResidualTerm(pairs, departure, sigma=0.05, loss=LOSS)
    analytic = ResidualTerm(pairs, departure, sigma=0.05, loss=LOSS, jacobian=built_in.jacobian)
    ours, theirs = (term.reweight(poses)[0].normal_blocks(poses) for term in (built_in, own))
    apart = np.abs(ours.blocks - theirs.blocks).max() / np.abs(ours.blocks).max()
    seconds = {}
    for name, term in {"built in": built_in, "own": own, "own, analytic": analytic}.items():
        seconds[name] = _median_s(lambda term=term: _round(term, poses))
        ratio = seconds[name] / seconds["built in"]
        print(f"{name:14s} {seconds[name]:.3f} s a round, {ratio:.1f} times the built-in term")
    print(f"blocks agree to {apart:.1e} of the largest")


def _round(term: Term, poses: np.ndarray) -> None:
    term.reweight(poses)[0].normal_blocks(poses)


def _median_s(run: Callable[[], None]) -> float:
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):
        main()
