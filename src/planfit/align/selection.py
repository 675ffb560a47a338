"""From refined places to an answer: which is taken, how sure it is, and what a user must know."""

from dataclasses import dataclass, replace

import numpy as np

from planfit.align.likelihood_field import wrap_angle
from planfit.align.options import AlignOptions
from planfit.align.refine import AlignmentHypothesis
from planfit.align.wall_samples import WallSamples
from planfit.errors import OptionError
from planfit.floorplan import Floorplan

MAX_PLACES = 4
"""Distinct places that are named."""
OPEN_M = 0.5
"""A shift that the walls leave this unsure (one standard deviation) is not determined by them."""

BEND_DEG, BEND_M, BEND_SCALE = 0.7, 0.3, 0.01
"""Parts of the walk that disagree by more (one standard deviation) leave the place weak."""
BEND_SHARE = 0.005
"""A scan bent by more of its size has no place within a degree: this is a degree over its half."""
MIN_STRETCH = 0.35
"""A fifth of the walk that the plan explains less of leaves the place weak: half of what right places of
scans without bends have."""


@dataclass(frozen=True)
class Verdict:
    """What is taken, and why not more."""

    taken: AlignmentHypothesis
    runner_up: AlignmentHypothesis | None
    candidates: tuple[AlignmentHypothesis, ...]
    is_as_recorded: bool
    is_mirrored: bool
    is_sure: bool
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Stretches:
    """How far parts of the walk agree with the place of the whole."""

    spread: np.ndarray  # (4, 4) as `Fit.covariance`, of leaving out stretches
    scores: np.ndarray  # (k,) of each stretch
    bend_m: float
    """RMS distance of the walls from where they lie when the scan may bend."""
    extent_m: float
    """Size of the scan."""


def judge(
    walls: WallSamples,
    fits: list[AlignmentHypothesis],
    recorded: np.ndarray | None,
    mirrored: AlignmentHypothesis | None,
    floorplan: Floorplan,
    options: AlignOptions,
) -> Verdict:
    """Choose among refined places, best first.

    Args:
        walls: the samples that were placed.
        fits: at least one, best first.
        recorded: plan_from_level (4, 4) that the scan's format claims, if it does.
        mirrored: best place of the scan with left and right swapped, if that was tried.
        floorplan: for what the words say of it.
        options: see there.

    Raises:
        OptionError: there are fewer places than the candidate asked for.
    """
    candidates = distinct_places(fits, walls, options)
    taken, is_as_recorded = candidates[0], False
    warnings: list[str] = []
    if options.candidate > 1:
        if options.candidate > len(candidates):
            raise OptionError(
                f"align.candidate: expected 1 to {len(candidates)}, the places that were found, "
                f"found {options.candidate}"
            )
        taken = candidates[options.candidate - 1]
    elif recorded is not None:
        near = next((f for f in fits if _is_near(f, recorded, walls, options)), None)
        if near is not None and near.score >= 0.8 * taken.score:
            taken, is_as_recorded = near, True
        else:
            warnings.append(
                "the scan's format says its poses are in the plan's axes, but the walls fit "
                f"{distance_m(taken, recorded, walls):.1f} m and {turn_deg(taken.yaw, _yaw(recorded)):.0f} "
                "deg away from there; that place was taken"
            )
    runner_up = next((f for f in fits if is_distinct(f, taken, walls, options)), None)
    is_mirrored = mirrored is not None and mirrored.score > taken.score + max(
        options.min_margin, 0.25 * (1.0 - taken.score)
    )
    is_weak = taken.score < options.min_score
    margin = taken.score - (runner_up.score if runner_up else 0.0)
    is_close = runner_up is not None and margin < options.min_margin
    is_ambiguous = is_close and not is_as_recorded and options.candidate == 1
    if is_mirrored and mirrored is not None:
        again = (
            "run again without --mirror"
            if floorplan.source.is_mirrored
            else "run again with --mirror"
        )
        warnings.append(
            f"the plan is mirrored: {mirrored.score:.0%} of the scanned wall fits it with left and "
            f"right swapped, {taken.score:.0%} as drawn; {again}"
        )
    elif is_weak:
        unit = ", in metres" if floorplan.is_metric else ""
        warnings.append(
            f"only {taken.score:.0%} of the scanned wall lies on the plan's faces (at least "
            f"{options.min_score:.0%} expected); is it the plan of this building{unit}?"
        )
    if runner_up is not None and is_close and not is_mirrored:
        warnings.append(_close_words(taken, runner_up, walls, is_as_recorded, is_ambiguous))
    open_words = _open_words(taken)
    warnings += open_words
    return Verdict(
        taken,
        runner_up,
        candidates,
        is_as_recorded,
        is_mirrored,
        is_sure=not (is_weak or is_ambiguous or is_mirrored or open_words),
        warnings=tuple(warnings),
    )


def with_stretches(verdict: Verdict, taken: AlignmentHypothesis, stretches: Stretches) -> Verdict:
    """The verdict with the place fitted last, weak where stretches of the walk do not agree with it."""
    spread, scores = stretches.spread, stretches.scores
    larger = np.trace(spread) > np.trace(taken.covariance)
    taken = replace(taken, covariance=spread if larger else taken.covariance)
    turn, x, y, scale = np.sqrt(np.maximum(np.diag(spread), 0.0))
    shift_m = float(np.hypot(x, y))
    words = []
    if np.rad2deg(turn) > BEND_DEG or shift_m > BEND_M or scale > BEND_SCALE:
        words.append(
            f"weak: parts of the scan fit the plan at places that differ by {np.rad2deg(turn):.1f} deg, "
            f"{shift_m:.2f} m and {scale:.1%} of scale; the scan is bent, or shows too little wall"
        )
    if len(scores) and scores.min() < MIN_STRETCH and not verdict.is_mirrored:
        k, n = int(np.argmin(scores)), len(scores)
        words.append(
            f"weak: of the walk from {k / n:.0%} to {(k + 1) / n:.0%} only {scores[k]:.0%} of the wall "
            "lies on the plan; the scan is bent there, or the plan shows other walls"
        )
    if stretches.bend_m > BEND_SHARE * stretches.extent_m and not words:
        words.append(
            f"weak: the walls fit the plan only when the scan is bent by {stretches.bend_m:.2f} m over "
            f"{stretches.extent_m:.0f} m; drift is left that no loop has closed"
        )
    candidates = tuple(taken if fit is verdict.taken else fit for fit in verdict.candidates)
    return replace(
        verdict,
        taken=taken,
        candidates=candidates,
        is_sure=verdict.is_sure and not words,
        warnings=(*verdict.warnings, *words),
    )


def distinct_places(
    fits: list[AlignmentHypothesis], walls: WallSamples, options: AlignOptions
) -> tuple[AlignmentHypothesis, ...]:
    """The best fit of each place, best first."""
    kept: list[AlignmentHypothesis] = []
    for fit in fits:
        if all(is_distinct(fit, other, walls, options) for other in kept):
            kept.append(fit)
    return tuple(kept[:MAX_PLACES])


def is_distinct(
    a: AlignmentHypothesis, b: AlignmentHypothesis, walls: WallSamples, options: AlignOptions
) -> bool:
    """Whether two fits are two places."""
    return bool(
        turn_deg(a.yaw, b.yaw) > options.distinct_deg
        or gap_m(a, b, walls) > options.distinct_m
        or abs(np.log(a.metres_per_unit / b.metres_per_unit)) > options.distinct_scale
    )


def gap_m(a: AlignmentHypothesis, b: AlignmentHypothesis, walls: WallSamples) -> float:
    """How far apart on the plan two places put the middle of the scan, in metres of the first."""
    middle = np.array([*walls.xy.mean(axis=0), 0.0, 1.0])
    on_plan = [(fit.plan_from_level @ middle)[:2] / fit.scale_xy for fit in (a, b)]
    return float(np.linalg.norm((on_plan[0] - on_plan[1]) * a.scale_xy))


def distance_m(fit: AlignmentHypothesis, plan_from_level: np.ndarray, walls: WallSamples) -> float:
    """How far a place puts the middle of the scan from where a transform (4, 4) puts it."""
    middle = np.array([*walls.xy.mean(axis=0), 0.0, 1.0])
    return float(np.linalg.norm((fit.plan_from_level - plan_from_level) @ middle))


def turn_deg(yaw_a: float, yaw_b: float) -> float:
    """Size of the turn between two yaws (rad), deg."""
    return float(abs(np.rad2deg(wrap_angle(yaw_a - yaw_b))))


def _close_words(
    taken: AlignmentHypothesis,
    other: AlignmentHypothesis,
    walls: WallSamples,
    is_as_recorded: bool,
    is_ambiguous: bool,
) -> str:
    scale = ""
    if abs(np.log(taken.metres_per_unit / other.metres_per_unit)) > 1e-9:
        scale = f", scales {taken.metres_per_unit:.4g} and {other.metres_per_unit:.4g} m a unit"
    words = (
        f"two places on the plan fit almost equally well ({taken.score:.0%} and {other.score:.0%} "
        f"of the wall), {gap_m(taken, other, walls):.1f} m and "
        f"{turn_deg(taken.yaw, other.yaw):.0f} deg apart{scale}"
    )
    if is_as_recorded:
        return f"{words}; the one that the scan's format records was taken"
    if is_ambiguous:
        return f"ambiguous: {words}; choose the other one with --candidate 2, or pin points"
    return f"{words}; the one asked for was taken"


def _open_words(taken: AlignmentHypothesis) -> list[str]:
    """Where walls leave a direction or the scale open: a bare corridor, walls of one direction."""
    sigma_m = float(np.sqrt(max(np.linalg.eigvalsh(taken.covariance[1:3, 1:3])[-1], 0.0)))
    if sigma_m > OPEN_M:
        return [
            "ambiguous: the walls leave the place open along one direction, as in a corridor whose "
            "ends were not seen; scan an end of it, or pin points"
        ]
    if taken.covariance[3, 3] > 0.05**2:
        return ["ambiguous: the walls leave the scale open; give it, or pin two points"]
    return []


def _is_near(
    fit: AlignmentHypothesis, recorded: np.ndarray, walls: WallSamples, options: AlignOptions
) -> bool:
    return (
        turn_deg(fit.yaw, _yaw(recorded)) < options.near_recorded_deg
        and distance_m(fit, recorded, walls) < options.near_recorded_m
    )


def _yaw(transform: np.ndarray) -> float:
    return float(np.arctan2(transform[1, 0], transform[0, 0]))
