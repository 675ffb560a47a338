"""Where a survey lies against a levelled scan: rotation about the vertical, translation; and what is wrong of
it where nothing fits."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import OptionError
from planfit.findings import some_ids
from planfit.floorplan import Floorplan
from planfit.priors import FLOOR_LEVEL_MOST_M
from planfit.survey.read import Survey, SurveyAxes
from planfit.units import FOOT_M, INCH_M

OUTSIDE_SHARE = 0.5
"""A point may lie so far outside of the plan's faces, as a share of their extent: control points stand in
gardens and on pavements."""
MAX_FLOOR_HEIGHT_M = FLOOR_LEVEL_MOST_M.value
"""Heights above the floor are smaller; of a datum of their own, most are larger."""
UNITS = {
    "millimetres": 1e-3,
    "centimetres": 1e-2,
    "feet": FOOT_M,
    "inches": INCH_M,
    "kilometres": 1e3,
}
"""Metres of one unit that points may be in by mistake."""


@dataclass(frozen=True)
class PlacedPoints:
    """Points of a survey in axes near the scan's: the plan frame, or for `site` less an origin."""

    xyz: Float[np.ndarray, "p 3"]
    """x and y in units of the plan, z in metres as given; z is NaN where it is not known."""
    has_own_datum: bool
    """Whether heights count from somewhere else than the floor."""
    origin: Float[np.ndarray, "3"]
    """Subtracted from what was given; zero but for `site`."""


def place_points(survey: Survey, floorplan: Floorplan | None) -> PlacedPoints:
    """All points of a survey on the plan as it was read.

    Raises:
        OptionError: the plan has no such axes, or the points lie elsewhere than the plan.
    """
    given = np.array([point.xyz for point in survey.points], dtype=float)
    _require_axes(survey.axes, floorplan)
    if floorplan is None or survey.axes == "site":
        low = np.nan_to_num(np.nanmin(np.where(np.isnan(given), np.inf, given), axis=0), posinf=0.0)
        origin = np.floor(low)
        return PlacedPoints(given - origin, True, origin)
    xy = plan_from_axes(survey.axes, floorplan)(given[:, :2])
    if not _is_near(xy, floorplan).all():
        raise OptionError(_elsewhere(survey, floorplan, given, xy))
    _require_floor_heights(survey, given[:, 2])
    placed = np.column_stack([xy, given[:, 2]])
    return PlacedPoints(placed, survey.axes != "plan", np.zeros(3))


def plan_from_axes(
    axes: SurveyAxes, floorplan: Floorplan
) -> Callable[[Float[np.ndarray, "p 2"]], Float[np.ndarray, "p 2"]]:
    """The map from x and y of these axes to the plan frame."""
    source = floorplan.source
    file_from_plan = source.file_from_plan if source.file_from_plan is not None else np.eye(3)
    steps = {
        "plan": [source.rim_from_plan],
        "file": [file_from_plan],
        "map": [source.map_from_file, file_from_plan],
    }[axes]

    def to_plan(xy: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 2"]:
        for affine in steps:
            # Subtracted before anything is multiplied: exact where numbers are alike.
            xy = np.linalg.solve(affine[:2, :2], (xy - affine[:2, 2]).T).T
        return xy

    return to_plan


def _require_axes(axes: SurveyAxes, floorplan: Floorplan | None) -> None:
    if floorplan is None:
        if axes != "site":
            raise OptionError(
                f"--survey-axes {axes}: expected a plan, found none; without a plan points are in axes of "
                "their own: give --survey-axes site"
            )
        return
    source = floorplan.source
    advice = "bring the points into the axes of the plan, or refine with --no-plan"
    if axes == "site":
        raise OptionError(
            f"--survey-axes site: expected no plan, found {floorplan.name}: nothing tells where on it the "
            f"site's axes lie; {advice}"
        )
    if axes == "map" and (source.map_from_file is None or source.file_from_plan is None):
        raise OptionError(
            f"--survey-axes map: expected a plan with a map conversion (IFC) or a world file, found none in "
            f"{floorplan.name}; {advice}"
        )
    if axes == "file" and source.file_from_plan is None:
        raise OptionError(
            f"--survey-axes file: expected a plan with coordinates of its own, found {floorplan.name}; use "
            "--survey-axes plan"
        )


def _require_floor_heights(survey: Survey, heights: Float[np.ndarray, " p"]) -> None:
    known = heights[np.isfinite(heights)]
    if survey.axes != "plan" or not len(known) or np.abs(np.median(known)) < MAX_FLOOR_HEIGHT_M:
        return
    raise OptionError(
        f"the survey: expected heights above the floor (m) beside coordinates of the plan, found "
        f"{np.median(known):.4g} in the median; subtract the floor's height, leave z empty, or use "
        "--survey-axes file or map, whose heights may count from anywhere"
    )


def _is_near(xy: Float[np.ndarray, "p 2"], floorplan: Floorplan) -> Bool[np.ndarray, " p"]:
    corners = floorplan.ends.reshape(-1, 2)
    margin = OUTSIDE_SHARE * max(floorplan.size)
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    return ((xy >= low) & (xy <= high)).all(axis=1)


def _elsewhere(
    survey: Survey,
    floorplan: Floorplan,
    given: Float[np.ndarray, "p 3"],
    xy: Float[np.ndarray, "p 2"],
) -> str:
    """Which points lie off the plan, where it lies, and what would bring them onto it."""
    outside = np.flatnonzero(~_is_near(xy, floorplan))
    first = int(outside[0])
    corners = floorplan.ends.reshape(-1, 2)
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    ids = [survey.points[k].id for k in outside]
    return (
        f"the survey: expected points on {floorplan.name}, which spans {x0:.5g} to {x1:.5g} by {y0:.5g} to "
        f"{y1:.5g}, found {some_ids(ids)} outside, the first at ({xy[first, 0]:.7g}, {xy[first, 1]:.7g}) of "
        f"the plan; {_remedy(survey.axes, floorplan, given)}"
    )


def _remedy(axes: SurveyAxes, floorplan: Floorplan, given: Float[np.ndarray, "p 3"]) -> str:
    """What brings all points onto the plan: other axes, another unit, or swapped columns."""

    def fits(tried: SurveyAxes, xy: Float[np.ndarray, "p 2"]) -> bool:
        try:
            _require_axes(tried, floorplan)
        except OptionError:
            return False
        return bool(_is_near(plan_from_axes(tried, floorplan)(xy), floorplan).all())

    tried: tuple[SurveyAxes, ...] = ("plan", "file", "map")
    for other in tried:
        if other != axes and fits(other, given[:, :2]):
            return f"they lie on it in other axes: give --survey-axes {other}"
    if fits(axes, given[:, 1::-1]):
        return "they lie on it with x and y swapped: x is the easting; swap the columns"
    extent = np.ptp(given[:, :2], axis=0).max()
    for name, metres in UNITS.items():
        in_metres = given[:, :2] * metres
        # Any cloud of points shrunk to nothing lies on a plan about the origin.
        is_of_size = len(given) == 1 or extent * metres > 0.05 * max(floorplan.size)
        if is_of_size and fits(axes, in_metres):
            return f"they lie on it as {name}: multiply them by {metres:g}"
    return "check their axes, unit and order of columns"


DISTINCT_M = 0.5
"""Points may be off by so much anyway (marks, depth): nearer together they tell no heading."""
LINE_SHARE = 0.03
"""Points whose spread across their line is a smaller share of that along it stand on a line."""
NEAR_UNIT = 0.06
"""A scale this near to that of a unit, as a share, is that unit: drift changes lengths by less."""
DOUBT_M, DOUBT_SHARE = 0.3, 0.05
"""A misfit (median) beyond both, m and as a share of the extent, asks for a reason."""
BETTER = 1 / 3
"""A reason must bring the misfit, or the worst contradiction, down to this share."""
HOPELESS_SHARE = 0.25
"""Beyond this share of the extent points and scan have nothing to do with each other."""
EXPECTED = "the survey: expected control points that lie to each other as the scan has them"
"""How errors of points that do not begin."""


@dataclass(frozen=True)
class SiteFit:
    """From axes of a survey, whose z is up, to the level frame."""

    level_from_site: Float[np.ndarray, "4 4"]
    """Of points in metres."""
    scale: float
    """Metres of one unit of the survey's x and y."""
    misfit_m: Float[np.ndarray, " p"]
    """How far each point ends from where the scan has it, seen from above."""

    def to_level(self, site: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3"]:
        """Points of the survey, level frame, m; an unknown height stays unknown."""
        rotation, translation = self.level_from_site[:2, :2], self.level_from_site[:, 3]
        xy = self.scale * site[:, :2] @ rotation.T + translation[:2]
        return np.column_stack([xy, site[:, 2] + translation[2]])


def fit_site(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    is_metric: bool = True,
    has_own_datum: bool = True,
    is_robust: bool = True,
) -> SiteFit:
    """Fit by the horizontal positions, heights by their median difference.

    Args:
        level: points as the scan has them, level frame, m; two or more that are apart.
        site: the same as surveyed, z up; z may be NaN.
        is_metric: whether x and y are metres; else their scale is fitted.
        has_own_datum: whether heights count from elsewhere than the floor.
        is_robust: whether of four points or more those decide that the best pair brings together: one that is
            wrong then has no say. Which these are may hang on the last digit where drift has bent all.
    """
    p, q = _complex(level), _complex(site)
    every = np.ones(len(p), dtype=bool)
    best = _similarity(q, p, every, is_metric)
    if len(p) > 3 and is_robust:
        best = _similarity(q, p, _agreed(q, p, is_metric), is_metric)
    factor, shift = best
    misfit_m = np.abs(factor * q + shift - p)
    transform = np.eye(4)
    scale = abs(factor)
    c, s = (factor / scale).real, (factor / scale).imag
    transform[:2, :2] = [[c, -s], [s, c]]
    transform[:2, 3] = shift.real, shift.imag
    transform[2, 3] = height_shift(level, site, has_own_datum)
    return SiteFit(transform, float(scale) if not is_metric else 1.0, misfit_m)


def fit_rigid_2d(
    site: Float[np.ndarray, "p 3"], level: Float[np.ndarray, "p 3"]
) -> tuple[complex, complex]:
    """Rotation and translation seen from above, as complex numbers: level = factor site + shift."""
    return _similarity(_complex(site), _complex(level), np.ones(len(site), dtype=bool), True)


def height_shift(
    level: Float[np.ndarray, "p 3"], site: Float[np.ndarray, "p 3"], has_own_datum: bool
) -> float:
    """What to add to heights of a survey to have them above the floor (m): the median over points."""
    off = (level[:, 2] - site[:, 2])[np.isfinite(site[:, 2])]
    return float(np.median(off)) if has_own_datum and len(off) else 0.0


def are_apart(level: Float[np.ndarray, "p 3"]) -> bool:
    """Whether points tell a heading: two that are `DISTINCT_M` from each other."""
    return len(level) > 1 and bool(np.ptp(level[:, :2], axis=0).max() > DISTINCT_M)


def are_on_a_line(points: Float[np.ndarray, "p 3"]) -> bool:
    """Whether points stand on a line, seen from above; two always do."""
    centred = points[:, :2] - points[:, :2].mean(axis=0)
    spread = np.linalg.svd(centred, compute_uv=False)
    return len(points) < 3 or bool(spread[1] < LINE_SHARE * max(spread[0], 1e-12))


def require_fit(
    fit: SiteFit, level: Float[np.ndarray, "p 3"], site: Float[np.ndarray, "p 3"]
) -> None:
    """Raise where points do not fit the scan and one mistake explains it, or nothing does.

    Raises:
        OptionError: another unit, swapped or left-handed axes, y up, or no relation at all.
    """
    if len(level) < 3:
        return
    extent_m = float(np.ptp(level[:, :2], axis=0).max())
    off_m = float(np.median(fit.misfit_m))
    if off_m < max(DOUBT_M, DOUBT_SHARE * extent_m):
        return
    found = f"found them {off_m:.2f} m off (median) over {extent_m:.1f} m"
    other = fit_site(level, site, False)
    if np.median(other.misfit_m) <= BETTER * off_m:
        for unit, metres in UNITS.items():
            if abs(other.scale / metres - 1) < NEAR_UNIT:
                raise OptionError(
                    f"{EXPECTED}, {found}; they fit as {unit}: multiply x, y and z by {metres:g}"
                )
    for remedy, changed in other_axes(site):
        if np.median(fit_site(level, changed).misfit_m) <= BETTER * off_m:
            raise OptionError(f"{EXPECTED}, {found}; they fit with {remedy}")
    if off_m > HOPELESS_SHARE * extent_m:
        raise OptionError(
            f"{EXPECTED}, {found}; check ids, marks, axes and unit, or leave the points out"
        )


def other_axes(site: Float[np.ndarray, "p 3"]) -> list[tuple[str, Float[np.ndarray, "p 3"]]]:
    """Axes that points may have been written in by mistake: the remedy, and the points with it."""
    x, y, z = site.T
    found = [
        (
            "x and y swapped, or one of them negated: the axes are left-handed; x is the easting, y the "
            "northing, z up",
            np.column_stack([y, x, z]),
        )
    ]
    if np.isfinite(z).all():
        found += [
            ("z for y: y is up in them; write x, -z, y", np.column_stack([x, -z, y])),
            ("z for y, left-handed: y is up in them; write x, z, y", np.column_stack([x, z, y])),
        ]
    return found


def _complex(points: Float[np.ndarray, "p 3"]) -> np.ndarray:
    return points[:, 0] + 1j * points[:, 1]


def _similarity(
    q: np.ndarray, p: np.ndarray, used: Bool[np.ndarray, " p"], is_metric: bool
) -> tuple[complex, complex]:
    """Complex factor and shift with p = factor q + shift, by least squares (Umeyama 1991)."""
    q_middle, p_middle = q[used].mean(), p[used].mean()
    a, b = q[used] - q_middle, p[used] - p_middle
    across = np.sum(np.conj(a) * b)
    spread = max(float(np.sum(np.abs(a) ** 2)), 1e-300)
    factor = across / abs(across) if is_metric and abs(across) > 0 else across / spread
    if abs(factor) == 0:
        factor = 1.0 + 0j
    return complex(factor), complex(p_middle - factor * q_middle)


def _agreed(q: np.ndarray, p: np.ndarray, is_metric: bool) -> Bool[np.ndarray, " p"]:
    """Points that the fit of the best pair brings together: least median of residuals (Rousseeuw 1984)."""
    best, best_off = np.ones(len(p), dtype=bool), np.inf
    idx = np.arange(len(p))
    # Pairs of many points are enough from a few: each with the one that is furthest from it.
    pairs = (
        [(i, j) for i in idx for j in idx[i + 1 :]]
        if len(p) <= 40
        else [(i, int(np.argmax(np.abs(p - p[i])))) for i in idx]
    )
    for i, j in pairs:
        if q[i] == q[j] or abs(p[i] - p[j]) < DISTINCT_M:
            continue
        used = np.isin(idx, [int(i), int(j)])
        factor, shift = _similarity(q, p, used, is_metric)
        off = np.abs(factor * q + shift - p)
        if (median := float(np.median(off))) < best_off:
            best, best_off = off <= max(3 * median, 0.05), median
    return best
