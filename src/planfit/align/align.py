"""Where on the plan the scan is: one turn about the vertical and one shift, searched over the whole plan.

Coarse: turns at which wall directions of scan and plan agree, then for each turn all shifts at once.
Fine: the best places are refined against the faces, and the best two distinct ones are compared, so
that a building which fits its plan in two ways is reported and not guessed.
"""

from dataclasses import dataclass

import numpy as np

from planfit.align.fields import FaceFields, ShiftSearch, make_face_fields, wrap_angle
from planfit.align.refine import Fit, refine_fit, rotation_2d
from planfit.errors import require_positive
from planfit.floorplan import Floorplan
from planfit.geometry import segments


@dataclass(frozen=True)
class AlignOptions:
    """How the plan is searched for the scan."""

    cell_m: float = 0.2
    """Cell of the coarse search."""
    reach_m: float = 0.4
    """A wall this far from its face still scores 0.6 in the coarse search; covers leftover drift."""
    max_turns: int = 8
    """Turns that are tried, best agreement of wall directions first."""
    max_candidates: int = 16
    """Places that are refined."""
    distinct_m: float = 1.0
    """Places nearer than this, with turns within `distinct_deg`, are one."""
    distinct_deg: float = 5.0
    """See `distinct_m`."""
    min_score: float = 0.6
    """Below this share of wall that lies on faces, the scan is not believed to be on the plan."""
    min_margin: float = 0.05
    """The best place must beat the next by this share of wall, else the answer is ambiguous."""
    near_recorded_m: float = 5.0
    """Where the scan's format says that poses are in the plan's axes, a place within this of them is
    preferred as long as it explains 0.8 of what the best place does."""
    near_recorded_deg: float = 20.0
    """See `near_recorded_m`. Without it, a building that fits when turned about its middle would count
    as being where the format says."""

    def __post_init__(self) -> None:
        require_positive(self, "cell_m", "reach_m", "max_turns", "max_candidates")


@dataclass(frozen=True)
class WallSamples:
    """Scanned wall, seen from above."""

    xy: np.ndarray  # (m, 2) m, evenly along the pieces of wall
    normals: np.ndarray  # (m, 2) unit, towards where it was seen from


@dataclass(frozen=True)
class Alignment:
    """The best place of the scan on the plan, and how sure it is."""

    plan_from_level: np.ndarray  # (4, 4)
    score: float
    """Share of scanned wall that lies on faces of the plan."""
    runner_up: Fit | None
    """The best place elsewhere."""
    is_as_recorded: bool = False
    """Whether it agrees with the place that the scan's format claims."""
    is_sure: bool = True
    """Whether enough wall lies on the plan, and clearly more than anywhere else."""
    warnings: tuple[str, ...] = ()
    """What a user should know, in words."""

    @property
    def margin(self) -> float:
        """Score of the best place less that of the runner-up."""
        return self.score - (self.runner_up.score if self.runner_up else 0.0)


def sample_walls(normals: np.ndarray, ends: np.ndarray, spacing_m: float = 0.1) -> WallSamples:
    """Points about every `spacing_m` along pieces of wall: normals (k, 2), ends (k, 2, 2) m."""
    xy, piece = segments.sample(ends, spacing_m)
    return WallSamples(xy, normals[piece])


def align(
    walls: WallSamples,
    floorplan: Floorplan,
    options: AlignOptions,
    recorded: np.ndarray | None = None,
) -> Alignment:
    """Find the turn and shift that bring most scanned wall onto faces that look the same way.

    Args:
        walls: at least two samples, level frame.
        floorplan: metric.
        options: see there.
        recorded: plan_from_level (4, 4) that the scan's format claims, if it does.
    """
    extent_m = float(np.linalg.norm(np.ptp(walls.xy, axis=0)))
    fields = make_face_fields(
        floorplan, options.cell_m, options.reach_m, margin_m=2.0, beyond_m=extent_m
    )
    turns = candidate_turns(walls, floorplan, options.max_turns)
    coarse = _coarse_places(walls, fields, turns, options)
    if recorded is not None:
        coarse.append((_yaw(recorded), recorded[:2, 3]))
    fits = [refine_fit(walls.xy, walls.normals, floorplan, yaw, xy) for yaw, xy in coarse]
    fits.sort(key=lambda fit: -fit.score)
    best = fits[0]
    warnings: list[str] = []
    is_as_recorded = False
    if recorded is not None:
        near = next((f for f in fits if _is_near(f, recorded, walls, options)), None)
        if near is not None and near.score >= 0.8 * best.score:
            best, is_as_recorded = near, True
        else:
            warnings.append(
                "the scan's format says its poses are in the plan's axes, but the walls fit "
                f"{_distance_m(best, recorded, walls):.1f} m and "
                f"{abs(np.rad2deg(wrap_angle(best.yaw - _yaw(recorded)))):.0f} deg away from there; "
                "that place was taken"
            )
    runner_up = next((f for f in fits if _is_distinct(f, best, walls, options)), None)
    margin = best.score - (runner_up.score if runner_up else 0.0)
    is_weak = best.score < options.min_score
    is_ambiguous = bool(runner_up and margin < options.min_margin and not is_as_recorded)
    if is_weak:
        warnings.append(
            f"only {best.score:.0%} of the scanned wall lies on the plan's faces (at least "
            f"{options.min_score:.0%} expected); is it the plan of this building, in metres?"
        )
    if runner_up and is_ambiguous:
        warnings.append(
            f"ambiguous: two places on the plan fit almost equally well ({best.score:.0%} and "
            f"{runner_up.score:.0%} of the wall), {_gap_m(best, runner_up, walls):.1f} m and "
            f"{abs(np.rad2deg(wrap_angle(best.yaw - runner_up.yaw))):.0f} deg apart"
        )
    return Alignment(
        best.transform,
        best.score,
        runner_up,
        is_as_recorded,
        is_sure=not (is_weak or is_ambiguous),
        warnings=tuple(warnings),
    )


def candidate_turns(walls: WallSamples, floorplan: Floorplan, max_turns: int) -> np.ndarray:
    """Turns (t,) rad, plan from level, at which wall directions agree, best first.

    Circular correlation of the two length-weighted histograms of normals, one-degree bins. A face
    whose free side is unknown counts half for either side.
    """
    of_scan = _direction_histogram(walls.normals, np.ones(len(walls.normals)))
    weight = floorplan.lengths * np.where(floorplan.is_oriented, 1.0, 0.5)
    of_plan = _direction_histogram(floorplan.normals, weight)
    of_plan += _direction_histogram(
        -floorplan.normals, np.where(floorplan.is_oriented, 0.0, weight)
    )
    agreement = np.fft.irfft(np.fft.rfft(of_plan) * np.conj(np.fft.rfft(of_scan)), 360)
    turns: list[int] = []
    for degree in np.argsort(-agreement):
        if all(min((degree - t) % 360, (t - degree) % 360) >= 8 for t in turns):
            turns.append(int(degree))
        if len(turns) == max_turns:
            break
    return np.deg2rad(turns)


def _direction_histogram(normals: np.ndarray, weight: np.ndarray) -> np.ndarray:
    degree = np.rad2deg(np.arctan2(normals[:, 1], normals[:, 0])) % 360
    counts = np.bincount(np.round(degree).astype(int) % 360, weight, minlength=360)
    kernel = np.exp(-0.5 * (np.arange(-180, 180) / 2.0) ** 2)
    return np.fft.irfft(np.fft.rfft(counts) * np.fft.rfft(np.fft.ifftshift(kernel)), 360)


def _coarse_places(
    walls: WallSamples, fields: FaceFields, turns: np.ndarray, options: AlignOptions
) -> list[tuple[float, np.ndarray]]:
    """Best (turn, shift) pairs of the coarse search; several a turn, apart by `distinct_m`."""
    extent_m = float(np.linalg.norm(np.ptp(walls.xy, axis=0)))
    search = ShiftSearch(fields, extent_m)
    places: list[tuple[float, float, np.ndarray]] = []
    for yaw in turns:
        turn = rotation_2d(yaw)
        table, first = search.scores(walls.xy @ turn.T, walls.normals @ turn.T)
        radius = int(np.ceil(options.distinct_m / fields.cell_m))
        for _ in range(4):
            row, column = np.unravel_index(int(np.argmax(table)), table.shape)
            shift = first + fields.cell_m * np.array([column, row])
            places.append((float(table[row, column]), float(yaw), shift))
            table[
                max(row - radius, 0) : row + radius + 1,
                max(column - radius, 0) : column + radius + 1,
            ] = -1.0
    places.sort(key=lambda place: -place[0])
    return [(yaw, shift) for _, yaw, shift in places[: options.max_candidates]]


def _is_near(fit: Fit, recorded: np.ndarray, walls: WallSamples, options: AlignOptions) -> bool:
    turn = abs(np.rad2deg(wrap_angle(fit.yaw - _yaw(recorded))))
    gap_m = _distance_m(fit, recorded, walls)
    return bool(turn < options.near_recorded_deg and gap_m < options.near_recorded_m)


def _is_distinct(a: Fit, b: Fit, walls: WallSamples, options: AlignOptions) -> bool:
    turn = abs(np.rad2deg(wrap_angle(a.yaw - b.yaw)))
    return bool(turn > options.distinct_deg or _gap_m(a, b, walls) > options.distinct_m)


def _gap_m(a: Fit, b: Fit, walls: WallSamples) -> float:
    """How far apart two places put the middle of the scan."""
    return _distance_m(a, b.transform, walls)


def _distance_m(fit: Fit, plan_from_level: np.ndarray, walls: WallSamples) -> float:
    middle = np.array([*walls.xy.mean(axis=0), 0.0, 1.0])
    return float(np.linalg.norm((fit.transform - plan_from_level) @ middle))


def _yaw(transform: np.ndarray) -> float:
    return float(np.arctan2(transform[1, 0], transform[0, 0]))
