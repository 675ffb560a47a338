"""The sensor's parameters, solved for in turns with the poses; only what the evidence asks for is kept."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.adjust.calibration.blocks import ODOMETRY, PLAN, SHARED
from planfit.adjust.calibration.correct import corrected_measurements
from planfit.adjust.calibration.options import CalibrationOptions
from planfit.adjust.calibration.reduced import SharedStep, shared_step
from planfit.adjust.measurements import Measurements
from planfit.adjust.problem import AdjustmentProblem
from planfit.geometry.calibration import NOMINAL, SensorCalibration

SETTLED = 0.1
"""Parameters that move by less than this share of their standard deviations have settled."""


@dataclass(frozen=True)
class Calibration:
    """What a sensor was found to do, and how sure that is."""

    sensor: SensorCalibration = NOMINAL
    """Parameters that are not kept are nominal."""
    is_kept: Bool[np.ndarray, " s"] | None = None
    """Which departures the evidence asks for, in the order of `SHARED`; None where none was looked for."""
    departures: Float[np.ndarray, " s"] | None = None
    """Of the parameters from their nominal values: as corrected where kept, else as they would be if they
    alone were free beside those."""
    sigmas: Float[np.ndarray, " s"] | None = None
    """Standard deviations of the departures; 0 of what was held."""
    gain: float = 0.0
    """By how much the robust cost falls for what is kept."""

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the parameters that depart."""
        if self.is_kept is None:
            return ()
        return tuple(name for name, kept in zip(SHARED, self.is_kept, strict=True) if kept)


NOT_CALIBRATED = Calibration()
"""Nothing was looked for: the sensor is as its files say."""

Solve = Callable[
    [Measurements, Float[np.ndarray, "n 4 4"]],
    tuple[AdjustmentProblem, Float[np.ndarray, "u 4 4"]],
]
"""From corrected measurements and poses to begin with, to the problem and the unknowns that solve it."""


def estimate(
    measurements: Measurements,
    problem: AdjustmentProblem,
    unknowns: Float[np.ndarray, "u 4 4"],
    solve: Solve,
    options: CalibrationOptions,
    start: SensorCalibration = NOMINAL,
) -> Calibration:
    """Find what the sensor does wrong, from poses that were solved as if it did nothing wrong.

    One step of all parameters says which of them the cost asks for. Where it asks for none, that is all;
    else those are solved for in turns with the poses, and the rest is looked at once more.

    Args:
        measurements: as lifted by the nominal sensor.
        problem: built from the measurements as `start` corrects them.
        unknowns: where its solve ended.
        solve: solves again, with other corrections.
        options: priors, and what is asked of evidence.
        start: what is corrected so far.
    """
    if not options.is_on:
        return NOT_CALIBRATED
    nominal, sigmas = NOMINAL.vector, options.sigmas
    departures = np.zeros(len(SHARED))
    departures[:ODOMETRY] = start.vector - nominal
    poses = unknowns[: problem.n_cams]
    is_kept = np.zeros(len(SHARED), dtype=bool)
    gain = 0.0
    for _ in range(options.max_rounds):
        step = shared_step(problem, unknowns, departures, sigmas)
        cost = sum(problem.costs(unknowns[: problem.n_cams]).values())
        wanted, found, spread, gain = asked_for(departures + step.change, step, cost, options)
        settled = np.abs(found - departures)[wanted] <= SETTLED * spread[wanted]
        if np.array_equal(wanted, is_kept) and settled.all():
            break
        is_kept = wanted
        departures = np.where(is_kept, found, 0.0)
        sensor = NOMINAL.with_vector(nominal + departures[:ODOMETRY])
        if not is_kept.any():
            break
        problem, unknowns = solve(corrected_measurements(measurements, sensor), poses)
        poses = unknowns[: problem.n_cams]
    sensor = NOMINAL.with_vector(nominal + departures[:ODOMETRY])
    return Calibration(sensor, is_kept, np.where(is_kept, departures, found), spread, gain)


def asked_for(
    departures: Float[np.ndarray, " s"],
    step: SharedStep,
    cost: float,
    options: CalibrationOptions,
) -> tuple[
    Bool[np.ndarray, " s"], Float[np.ndarray, " s"], Float[np.ndarray, " s"], float
]:
    """Which departures the evidence asks for: the one that lowers the cost least is held, then the next.

    A departure d of sigma s, the others free, lowers the cost by d^2 / (2 s^2) (Wald's test). Matches share
    errors that are no sensor's: of depth between the pixels, of exposure, of the rig. So the gain also has to
    be a share of the whole cost, but for the depth's scale, which recorded steps and walls hold, not matches
    alone. The scales of odometry and plan are nuisances: free within their priors, never kept here.

    Returns:
        which are kept; each one's departure and standard deviation, with those kept (and the nuisances) free;
        and by how much the cost falls for those kept.
    """
    n = len(SHARED)
    covariance, values = step.covariance.copy(), departures.copy()
    is_free = np.diagonal(covariance) > 0
    candidates = is_free.copy()
    candidates[[ODOMETRY, PLAN]] = False
    least = np.full(n, max(0.5 * options.min_sigmas**2, options.min_gain_share * cost))
    least[0] = 0.5 * options.min_sigmas**2
    found, spread = values.copy(), np.sqrt(np.diagonal(covariance).clip(0))
    while candidates.any():
        idx = np.flatnonzero(candidates)
        gains = 0.5 * values[idx] ** 2 / np.diagonal(covariance)[idx]
        weakest = idx[np.argmin(gains / least[idx])]
        is_small = abs(values[weakest]) < options.smallest[weakest]
        if (gains / least[idx]).min() >= 1.0 and not is_small:
            break
        found[weakest], spread[weakest] = values[weakest], np.sqrt(covariance[weakest, weakest])
        # What the others are, given that this one is nominal.
        ratio = covariance[:, weakest] / covariance[weakest, weakest]
        values = values - ratio * values[weakest]
        covariance = covariance - np.outer(ratio, covariance[weakest])
        candidates[weakest] = False
    idx = np.flatnonzero(candidates)
    found[idx], spread[idx] = values[idx], np.sqrt(np.diagonal(covariance)[idx])
    block = covariance[np.ix_(idx, idx)]
    gain = 0.5 * float(values[idx] @ np.linalg.solve(block, values[idx])) if len(idx) else 0.0
    return candidates, found, spread, gain
