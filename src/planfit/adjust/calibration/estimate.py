"""The sensor's parameters, solved for in turns with the poses; only what the evidence asks for is kept."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit

from planfit.adjust.calibration.blocks import NUISANCES, ODOMETRY, SHARED
from planfit.adjust.calibration.correct import corrected_measurements
from planfit.adjust.calibration.reduced import SharedStep, shared_step
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import AdjustmentProblem, build_problem
from planfit.errors import require_positive
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.geometry.se3 import Poses
from planfit.priors import CLEAR_ODDS, SURE_SIGMAS
from planfit.runtime import short_repr

SETTLED = 0.1
"""Parameters that move by less than this share of their standard deviations have settled."""
MIN_GAIN_SHARE = 0.004
"""The cost has to fall by this share of itself for each parameter kept (but for the depth's scale).
Without fault, a parameter alone is worth up to 0.003 on a synthetic flat; 2 % of the focal length 0.005
(ConSLAM) to 0.1, 5 cm of depth 0.1, 0.01 z^2 0.2."""
MAX_PRIOR_SIGMAS = SURE_SIGMAS.value
"""A departure by more of its prior standard deviations is no calibration. Either the files give the lens of
another camera, or colour and depth are not registered to each other: geometry without keypoints tells
(`probability_of_sensor`). In 7-Scenes' kitchen the principal point would be 17 px off in every part of the
walk, by keypoints alone: correcting depth for it, too, takes the error from 0.032 to 0.067 m."""
SMALLEST = np.array([0.01, 0.015, 0.002, 0.01, 0.01, 0.005, 0.005, 0.0, 0.0, 0.0])
"""Departures below these are left alone, in the order of `SHARED`: 1 % of scales of depth and focal lengths
is what calibrations and interpolated depth do anyway; then 15 mm of the depth's offset, 2 mm per m^2 of
its quadratic part, and 0.005 of the principal point."""


@dataclass(frozen=True)
class CalibrationOptions:
    """Whether the sensor is looked at."""

    is_on: bool = True
    """Whether anything is estimated."""


@dataclass(frozen=True)
class CalibrationPriors:
    """Prior standard deviations of what all frames share; 0 holds a parameter at its nominal value.

    Which of depth, odometry and plan is wrong where their scales disagree is a matter of these alone. They
    are what devices and drawings are like, so no user sets them; what poses and plan of a run are known for
    does (`planfit.pipeline.calibrate`).
    """

    depth_scale_sigma: float = 0.03
    """Of the factor on depth: phones and time-of-flight cameras are off by 1 to 2 %, some by 5 %."""
    depth_offset_sigma_m: float = 0.02
    """Of what is added to every depth."""
    depth_quadratic_sigma_per_m: float = 0.004
    """Of the part that grows with the square of the depth: structured light and stereo."""
    focal_scale_sigma: float = 0.03
    """Of the factor on both focal lengths."""
    focal_aspect_sigma: float = 0.0
    """Of the focal length in y by that in x. Held by default: pixels are square, and on ConSLAM, whose are,
    the cost asks for 12 %."""
    principal_sigma: float = 0.008
    """Of the principal point in x and y, as a share of the focal length: 4 px of 500."""
    odometry_scale_sigma: float = 0.01
    """Of the factor on recorded steps: of the 0.5 to 2 % of their way that trackers err by (KITTI odometry
    benchmark), a part is of the metre."""
    plan_scale_sigma: float = 0.006
    """Of the factor on a metric plan that `align` finds a little off."""
    half_thickness_sigma_m: float = 0.02
    """Of half the thickness of walls, as found, where a plan draws them by their centre lines: it looks like
    an offset of depth."""
    min_sigmas: float = 3.0
    """A parameter is kept where it departs by so many of its standard deviations, the others free."""
    max_rounds: int = 4
    """Solves of all poses at most, a step of the parameters after each."""

    def __post_init__(self) -> None:
        require_positive(self, "min_sigmas", "max_rounds")

    @property
    def sigmas(self) -> Float[np.ndarray, " s"]:
        """In the order of `planfit.adjust.calibration.blocks.SHARED`."""
        return np.array(
            [
                self.depth_scale_sigma,
                self.depth_offset_sigma_m,
                self.depth_quadratic_sigma_per_m,
                self.focal_scale_sigma,
                self.focal_aspect_sigma,
                self.principal_sigma,
                self.principal_sigma,
                self.odometry_scale_sigma,
                self.plan_scale_sigma,
                self.half_thickness_sigma_m,
            ]
        )


PRIORS = CalibrationPriors()
"""Of an unknown sensor, a tracker that knows the metre and a plan in metres."""


@dataclass(frozen=True)
class Calibration:
    """What a sensor was found to do, and how sure that is."""

    sensor: SensorCalibration = NOMINAL
    """Parameters that are not kept are nominal."""
    is_kept: Bool[np.ndarray, " s"] = field(
        default_factory=lambda: np.zeros(len(SHARED), dtype=bool)
    )
    """Which departures the evidence asks for, in the order of `SHARED`."""
    departures: Float[np.ndarray, " s"] = field(default_factory=lambda: np.zeros(len(SHARED)))
    """Of the parameters from their nominal values: as corrected where kept, else as they would be if they
    alone were free beside those. Recorded motion is corrected by its own, kept or not."""
    sigmas: Float[np.ndarray, " s"] = field(default_factory=lambda: np.zeros(len(SHARED)))
    """Standard deviations of the departures; 0 of what was held, or not looked for."""
    gain: float = 0.0
    """By how much the robust cost falls for what is kept, or would."""
    implausible: tuple[str, ...] = ()
    """Parameters that the evidence asks for by more than a sensor can be off, and that geometry without
    keypoints does not confirm: then nothing is corrected."""
    p_sensor: float | None = None
    """Probability that these are the sensor's all the same; None of depth, of which that tells nothing."""
    unbelieved: SensorCalibration = NOMINAL
    """What would be corrected if no departure were implausible; nominal where none is."""

    __repr__ = short_repr

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the parameters that depart."""
        return tuple(name for name, kept in zip(SHARED, self.is_kept, strict=True) if kept)

    def sigma(self, name: str) -> float:
        """Standard deviation of a parameter that is kept; 0 of another."""
        return float(self.sigmas[SHARED.index(name)]) if name in self.kept else 0.0


NOT_CALIBRATED = Calibration()
"""Nothing was looked for: the sensor is as its files say."""

Solve = Callable[
    [Measurements, Poses],
    tuple[AdjustmentProblem, Float[np.ndarray, "u 4 4"]],
]
"""From corrected measurements and poses to begin with, to the problem and the unknowns that solve it."""


def estimate(
    measurements: Measurements,
    problem: AdjustmentProblem,
    unknowns: Float[np.ndarray, "u 4 4"],
    solve: Solve,
    priors: CalibrationPriors,
    start: SensorCalibration = NOMINAL,
) -> Calibration:
    """Find what the sensor does wrong, from poses that were solved as if it did nothing wrong.

    One step of all parameters says which of them the cost asks for. Where it asks for none, that is all;
    else those are solved for in turns with the poses, and the rest is looked at once more.

    Args:
        measurements: as lifted by the nominal sensor.
        problem: built from the measurements as `start` corrects them.
        start: what is corrected so far.
    """
    nominal = NOMINAL.vector
    departures = np.zeros(len(SHARED))
    departures[:ODOMETRY] = start.vector - nominal
    is_kept = departures != 0
    is_kept[list(NUISANCES)] = False
    rounds, was_far = 0, False
    most = MAX_PRIOR_SIGMAS * priors.sigmas
    while True:
        step = shared_step(problem, unknowns, departures, priors.sigmas)
        cost = sum(problem.costs(unknowns[: problem.n_cams]).values())
        wanted = asked_for(departures + step.change, step, cost, priors)
        wanted = _confirmed(wanted, problem, unknowns, departures, priors)
        moved = np.abs(wanted.departures - departures)[wanted.is_kept]
        has_settled = np.all(moved <= SETTLED * wanted.sigmas[wanted.is_kept])
        is_same = np.array_equal(wanted.is_kept, is_kept)
        # One step from nominal may overshoot: of 0.01 z^2 where depth reaches 20 m, by a third. What is
        # still too far once as much as is plausible is corrected is no sensor's.
        is_too_far = bool(wanted.implausible) and was_far
        if is_too_far or rounds == priors.max_rounds or (is_same and has_settled):
            break
        is_kept, rounds, was_far = wanted.is_kept, rounds + 1, bool(wanted.implausible)
        asked = np.clip(wanted.departures, -most, most) if was_far else wanted.departures
        departures[:ODOMETRY] = np.where(is_kept, asked, 0.0)[:ODOMETRY]
        sensor = NOMINAL.with_vector(nominal + departures[:ODOMETRY])
        poses = unknowns[: problem.n_cams]
        problem, unknowns = solve(corrected_measurements(measurements, sensor), poses)
    if wanted.implausible:
        unbelieved = _sensor_of(wanted.is_kept, wanted.departures)
        return replace(wanted, is_kept=np.zeros(len(SHARED), dtype=bool), unbelieved=unbelieved)
    found = np.where(is_kept, departures, wanted.departures)
    sensor = _sensor_of(is_kept, departures)
    return replace(wanted, sensor=sensor, is_kept=is_kept, departures=found)


def _sensor_of(
    is_kept: Bool[np.ndarray, " s"], departures: Float[np.ndarray, " s"]
) -> SensorCalibration:
    """The sensor that departs by what is kept."""
    return NOMINAL.with_vector(NOMINAL.vector + np.where(is_kept, departures, 0.0)[:ODOMETRY])


def _confirmed(
    wanted: Calibration,
    problem: AdjustmentProblem,
    unknowns: Float[np.ndarray, "u 4 4"],
    departures: Float[np.ndarray, " s"],
    priors: CalibrationPriors,
) -> Calibration:
    """The same, nothing implausible where geometry alone shows clearly that it is the lens's.

    Depth that is as far off may as well be a tracker's unit, and has no second witness.
    """
    is_of_depth = any(name.startswith("depth") for name in wanted.implausible)
    if is_of_depth or not wanted.implausible:
        return wanted
    of = np.array([SHARED.index(name) for name in wanted.implausible])
    p = probability_of_sensor(wanted.departures[of], of, problem, unknowns, departures, priors)
    if p > 1 - 1 / CLEAR_ODDS.value:
        return replace(wanted, implausible=())
    return replace(wanted, p_sensor=p)


def probability_of_sensor(
    asked: Float[np.ndarray, " k"],
    of: Int[np.ndarray, " k"],
    problem: AdjustmentProblem,
    unknowns: Float[np.ndarray, "u 4 4"],
    departures: Float[np.ndarray, " s"],
    priors: CalibrationPriors,
) -> float:
    """Whether departures that matched keypoints ask for are those of depth as well.

    A lens that is another bends all that depth shows; colour that is not registered to depth shifts keypoints
    alone. So surfaces, floor, walls and recorded motion ask for the same departures, or for none: two
    hypotheses, as likely as each other before, and still so where geometry tells nothing.

    Args:
        asked: departures by all evidence.
        of: their places in `SHARED`, increasing.
        problem: built from points as corrected by the departures as they stand.
        unknowns: where its solve ended.
        departures: as they stand.
        priors: of all parameters.
    """
    geometry = replace(problem, geometric=None, by_hand=None)
    step = shared_step(geometry, unknowns, departures, priors.sigmas)
    idx, information, pull = _told_of_sensor(step, departures + step.change)
    # Geometry alone, without the priors of these: its log likelihood is d pull - d information d / 2, the
    # others marginalised.
    is_asked = np.isin(idx, of)
    information[is_asked, is_asked] -= 1 / priors.sigmas[of] ** 2
    of_others = information[np.ix_(is_asked, ~is_asked)]
    shift = np.linalg.solve(information[np.ix_(~is_asked, ~is_asked)], of_others.T).T
    information = information[np.ix_(is_asked, is_asked)] - shift @ of_others.T
    pull = pull[is_asked] - shift @ pull[~is_asked]
    return float(expit(asked @ pull - 0.5 * asked @ information @ asked))


def _told_of_sensor(
    step: SharedStep, departures: Float[np.ndarray, " s"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k k"], Float[np.ndarray, " k"]]:
    """Places of the sensor's free parameters, their information, and that times their departures; poses and
    nuisances marginalised."""
    is_free = np.diagonal(step.covariance) > 0
    is_free[list(NUISANCES)] = False
    idx = np.flatnonzero(is_free)
    # Nuisances are marginalised by leaving them out of the covariance.
    information = np.linalg.inv(step.covariance[np.ix_(idx, idx)])
    return idx, information, information @ departures[idx]


def estimate_without_plan(
    measurements: Measurements, poses: Poses, adjust: AdjustOptions, priors: CalibrationPriors
) -> Calibration:
    """What matches, floor and recorded motion ask of the sensor; a plan has no say.

    Args:
        measurements: as lifted by the nominal sensor.
    """

    def solve(
        again: Measurements, start: Poses
    ) -> tuple[AdjustmentProblem, Float[np.ndarray, "u 4 4"]]:
        problem = build_problem(again, adjust, start)
        return problem, problem.solve().target_from_cams

    held = replace(priors, plan_scale_sigma=0.0, half_thickness_sigma_m=0.0)
    problem = build_problem(measurements, adjust, poses)
    return estimate(measurements, problem, poses, solve, held)


def asked_for(
    departures: Float[np.ndarray, " s"],
    step: SharedStep,
    cost: float,
    priors: CalibrationPriors,
) -> Calibration:
    """Which departures the evidence asks for: of all sets the one that lowers the cost most, less its price.

    A departure d of sigma s lowers the cost by d^2 / (2 s^2) (Wald's test). Matches share errors that are no
    sensor's: of depth between the pixels, of exposure, of the rig. So a parameter's price is a share of the
    whole cost, but that of the depth's scale, which recorded steps and walls hold, not matches alone. The
    scales of odometry and plan, and the thickness of walls, are nuisances: free within their priors, never
    kept here.

    Returns:
        departures and standard deviations of each parameter, with those kept (and the nuisances) free; which
        are kept, and those of them that no sensor needs. The sensor is left nominal.
    """
    n = len(SHARED)
    idx, information, pull = _told_of_sensor(step, departures)
    price = np.full(n, max(0.5 * priors.min_sigmas**2, MIN_GAIN_SHARE * cost))
    price[0] = 0.5 * priors.min_sigmas**2

    def solved(chosen: list[int]) -> tuple[np.ndarray, np.ndarray, float]:
        covariance = np.linalg.inv(information[np.ix_(chosen, chosen)])
        values = covariance @ pull[chosen]
        return values, np.sqrt(np.diagonal(covariance)), 0.5 * float(values @ pull[chosen])

    best, best_worth = [], 0.0
    for size in range(1, len(idx) + 1):
        for subset in combinations(range(len(idx)), size):
            values, _, gain = solved(list(subset))
            worth = gain - price[idx[list(subset)]].sum()
            is_large = np.abs(values) >= SMALLEST[idx[list(subset)]]
            if worth > best_worth and is_large.all():
                best, best_worth = list(subset), worth
    found, spread, gain = np.zeros(n), np.zeros(n), 0.0
    for k in range(len(idx)):
        chosen = best if k in best else [*best, k]
        values, sigmas, total = solved(chosen)
        found[idx[k]], spread[idx[k]] = values[chosen.index(k)], sigmas[chosen.index(k)]
        gain = total if k in best else gain
    is_kept = np.zeros(n, dtype=bool)
    is_kept[idx[best]] = True
    is_far = is_kept & (np.abs(found) > MAX_PRIOR_SIGMAS * priors.sigmas)
    implausible = tuple(name for name, far in zip(SHARED, is_far, strict=True) if far)
    return Calibration(NOMINAL, is_kept, found, spread, gain, implausible)
