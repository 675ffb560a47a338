"""From a picture of a plan to its wall faces."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, UInt8

from planfit.errors import FloorplanError
from planfit.floorplan.gaps import find_openings
from planfit.floorplan.options import PlanOptions, choose_unit
from planfit.floorplan.plans_on_sheet import (
    MOST_STOREYS,
    find_storeys,
    storey_number,
    storey_words,
    storeys_warning,
)
from planfit.floorplan.plausible import COMPARE, find_doubts
from planfit.floorplan.raster.candidates import Candidate, WallStyle, find_candidates, find_extent
from planfit.floorplan.raster.choice import (
    ALL_INK,
    choose,
    find_walls_alone,
    or_lines_alone,
    with_paler_walls,
)
from planfit.floorplan.raster.ink import (
    account_for,
    dropped_words,
    ink_share,
    left_out,
    with_account,
)
from planfit.floorplan.raster.interpretation import STRAIGHT, Interpretation, interpret
from planfit.floorplan.raster.picture import (
    DARK,
    Darkness,
    Upright,
    check_size,
    content_box,
    drawn_box,
    make_darkness,
    make_upright,
    moved_from,
    rotated,
)
from planfit.floorplan.raster.sheet_marks import (
    SIGN_WORDS,
    photograph_words,
    slant_words,
    surroundings_words,
    without_bars,
    without_frame,
    without_signs,
    without_text,
)
from planfit.floorplan.raster.trace import settle_faces, straight_lengths
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.line_work import WallFaces
from planfit.floorplan.vector.regions import faces_of_regions
from planfit.geometry import segments

WORK_SIDE_PX = 2000
"""Walls are found in a picture of about this size and their faces placed in the full one. Pictures up to half
as large again are not shrunk: shrinking by a little blurs thin lines the most."""
TINY_SIDE_PX, MOST_ENLARGED = 600, 3
"""Smaller drawings are enlarged to twice this, or so many times: thicknesses of walls of 3 px and of lines
differ by less than a pixel there, and no least thickness in pixels parts them."""
LINES_ENLARGED = 2
"""Pictures whose walls are lines one pixel wide are enlarged so many times, the least that parts lines."""
FAINT_LINE = 0.5 * DARK
"""Darkness of a line in a picture of half the size it was drawn for. What joins two groups of walls need not
be dark: between two plans is blank paper."""
_UNKNOWN_SCALE = (
    "unknown: a picture does not tell; where a length is written in it, give --scale with its metres divided "
    "by the pixels of its line"
)
_LEAST_STRAIGHT = 0.35
_LEAST_LONG_SHARE = 0.25


def plan_of_picture(
    image_bgr: UInt8[np.ndarray, "h w 3"],
    name: str,
    fingerprint: str,
    options: PlanOptions,
    kind: str,
    wall_mask: Bool[np.ndarray, "h w"] | None = None,
    pixels_per_read: int = 1,
) -> Floorplan:
    """Wall faces of a picture of a plan; x-y are the picture's (u, -v) in pixels, or metres where the options
    tell the scale.

    Args:
        image_bgr: integer pixels are pixel centres.
        options: unit, scale and storey are used.
        wall_mask: where there is wall; None where the picture is to tell.
        pixels_per_read: pixels of the file to one of the image; the plan is in those of the file.

    Raises:
        FloorplanError: too large or too small, blank, a photograph, or without walls.
    """
    check_size(name, image_bgr.shape[1], image_bgr.shape[0])
    has_signs, n_letters = False, 0
    if wall_mask is None:
        image_bgr, has_signs = without_signs(image_bgr)
        upright = _upright(image_bgr, name)
    else:
        upright = make_upright(wall_mask.astype(np.float32))
        darkness = make_darkness(image_bgr, name, must_be_drawing=False)
        upright = replace(upright, darkness=rotated(darkness, upright))
    shrink = shrink_to_read(max(upright.darkness.shape), may_enlarge=wall_mask is None)
    small = shrunk(upright.darkness, shrink)
    if wall_mask is None:
        small, interpretation, n_letters = _interpreted(small, upright)
        is_small = LINES_ENLARGED * max(small.shape) <= 1.5 * WORK_SIDE_PX
        if interpretation is not None and is_small and _are_lines_touching(interpretation):
            shrink /= LINES_ENLARGED
            small = shrunk(upright.darkness, shrink)
            small, interpretation, n_letters = _interpreted(small, upright)
    else:
        share = shrunk(rotated(wall_mask.astype(np.float32), upright), shrink)
        given = Candidate(WallStyle.GIVEN, (share > 0.5).astype(np.uint8), "mask", 0.5, 0.0, 1.0)
        interpretation = interpret(given, float(max(small.shape)), is_given=True)
    interpretation = _checked(name, interpretation, small.shape)
    ink = None if wall_mask is not None else account_for(interpretation, small)
    photograph = "" if ink is None else photograph_words(image_bgr)
    if photograph and ink is not None and ink.is_little_read:
        found = f"{100 * ink.share:.0f} % of what is dark to be like them, in what looks like a photograph"
        raise _no_walls(name, f"{found} (of a sheet, crop it to that)")
    found = _faces(interpretation, upright, shrink)
    plan = _to_floorplan(name, fingerprint, found, interpretation, upright, options, shrink)
    drawn = f"{kind}, walls {interpretation.style}"
    dropped = segments.moved(left_out(interpretation, ink, shrink), _picture_from(upright))
    words = (f"{n_letters} letters of titles, names and notes",) if n_letters else ()
    source = replace(plan.source, dropped=(*words, *plan.source.dropped))
    plan = replace(plan, source=replace(source, kind=drawn, dropped_lines=dropped))
    if ink is not None:
        signs, slant = SIGN_WORDS if has_signs else "", slant_words(found.faces.ends)
        for words in filter(None, (photograph, surroundings_words(image_bgr), signs, slant)):
            plan = plan.with_warning(words)
        plan = with_account(plan, ink, interpretation, shrink)
    if not plan.source.unit_from:
        plan = replace(plan, source=replace(plan.source, unit_from=_UNKNOWN_SCALE))
    plan = _enlarged(plan, pixels_per_read)
    metres = choose_unit(options.unit, options.metres_per_unit).metres
    return plan if metres is None else plan.scaled(metres)


def _interpreted(small: Darkness, upright: Upright) -> tuple[Darkness, Interpretation | None, int]:
    """A picture without frame, bars and text of the sheet, what its dark regions are taken for, and how many
    letters there were."""
    small, n_letters = without_text(without_bars(without_frame(small)))
    ink = (small > DARK).astype(np.uint8)
    alone = find_walls_alone(small, upright.darkness)
    if alone is not None and n_letters == 0:
        return small, with_paler_walls(alone, small), 0
    # Where there were words, other things than walls are drawn, unless no ink is left for them.
    if alone is not None and ink_share(alone, ink) > ALL_INK:
        return small, alone, n_letters
    found = choose(find_candidates(small), find_extent(small), ink)
    return small, or_lines_alone(found, ink, upright.darkness), n_letters


def _are_lines_touching(interpretation: Interpretation) -> bool:
    """Whether walls are drawn as two lines one pixel wide: what is between them is then half on the lines'
    own pixels, and a thin wall one bar hardly wider than a line."""
    candidate = interpretation.candidate
    return candidate.style.family is WallStyle.LINES and candidate.grow_px <= 0.5


def _enlarged(plan: Floorplan, factor: int) -> Floorplan:
    """The plan of a picture that was read shrunk, in pixels of the file."""
    if factor == 1:
        return plan
    # Centres of pixels are integers before and after; y goes up.
    offset = (factor - 1) / 2 * np.array([1.0, -1.0])
    thickness, dropped = plan.thickness, plan.source.dropped_lines
    plan = plan.mapped(
        lambda xy: factor * xy + offset,
        np.eye(3),  # the plan's coordinates stay those of the file
        thickness=None if thickness is None else factor * thickness,
    ).with_warning(
        f"the picture is huge and was read shrunk {factor} times; walls thinner than {3 * factor} px may be "
        "missed"
    )
    lines = None if dropped is None else factor * dropped + np.abs(offset)
    return replace(plan, source=replace(plan.source, dropped_lines=lines))


@dataclass(frozen=True)
class _Found:
    """Faces in pixels of the upright picture."""

    faces: WallFaces
    storey: Int[np.ndarray, " n"]
    """Number of the storey of each face."""
    storeys: tuple[str, ...]
    doubts: tuple[str, ...]


def _upright(image_bgr: UInt8[np.ndarray, "h w 3"], name: str) -> Upright:
    """What is drawn, without the paper around it."""
    page = drawn_box(image_bgr)
    darkness = make_darkness(np.ascontiguousarray(image_bgr[page]), name)
    box = content_box(darkness)
    upright = make_upright(np.ascontiguousarray(darkness[box]))
    return moved_from(moved_from(upright, box), page)


def _checked(
    name: str, interpretation: Interpretation | None, shape: tuple[int, ...]
) -> Interpretation:
    """The interpretation, where it is one of a plan.

    Raises:
        FloorplanError: there are no walls, or what was taken for walls has not their form.
    """
    if interpretation is None or not interpretation.walls:
        raise _no_walls(name, "none")
    if interpretation.candidate.edge != "mask":
        if interpretation.straight_share < _LEAST_STRAIGHT:
            raise _no_walls(name, "shapes without straight sides")
        # Of these straightness is asked before.
        is_alone = interpretation.candidate.style.is_alone
        if not is_alone and _long_share(interpretation) < _LEAST_LONG_SHARE:
            raise _no_walls(name, "short strokes, as of letters or curves")
    length = float(sum(shapely.length(np.array(interpretation.all_walls, dtype=object))))
    if length < 0.5 * max(shape):
        raise _no_walls(name, f"{length:.0f} px of them, too little for a building")
    return interpretation


def _no_walls(name: str, found: str) -> FloorplanError:
    return FloorplanError(
        f"{name}: expected walls (solid, grey, hatched, double or single lines), found {found}; "
        "is it a floorplan? If it is, give your own picture of its walls with --wall-mask"
    )


def _long_share(interpretation: Interpretation) -> float:
    """Share of the outline of the walls in edges several times as long as walls are thick."""
    walls = interpretation.walls
    long = straight_lengths(walls, 5.0 * interpretation.thickness_px)
    return float(long.sum()) / sum(wall.length for wall in walls)


def shrink_to_read(side_px: int, may_enlarge: bool) -> float:
    """Pixels of the picture to one of that in which walls are looked for."""
    if side_px > 1.5 * WORK_SIDE_PX:
        return side_px / WORK_SIDE_PX
    if may_enlarge and side_px <= TINY_SIDE_PX:
        return 1.0 / min(int(np.ceil(2 * TINY_SIDE_PX / side_px)), MOST_ENLARGED)
    return 1.0


def shrunk(values: Darkness, shrink: float) -> Float[np.ndarray, "a b"]:
    """A picture of one number a pixel, so many times smaller."""
    if shrink == 1.0:
        return values
    if shrink > 1.0:
        return cv2.resize(values, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
    large = cv2.resize(values, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_CUBIC)
    return np.clip(large, 0.0, 1.0)


def _faces(interpretation: Interpretation, upright: Upright, shrink: float) -> _Found:
    """Faces of each storey, where the ink of the full picture has them."""
    walls = np.array(interpretation.all_walls, dtype=object)
    parts = [_faces_of_style(part) for part in interpretation.parts]
    faces = WallFaces.together(parts)
    openings = find_openings(faces.ends, faces.normals, faces.thickness)
    small = shrunk(upright.darkness, shrink)
    is_drawn = small > FAINT_LINE
    storey_of = find_storeys(walls, interpretation.thickness_px, openings, is_drawn)
    inside = faces.ends.mean(axis=1) - 0.5 * faces.normals
    storey = storey_of[shapely.STRtree(walls).nearest(shapely.points(inside))]
    size = np.array(upright.darkness.shape[::-1]) / np.array(small.shape[::-1])
    settled = []
    for part, own in zip(interpretation.parts, parts, strict=True):
        found = replace(own, ends=(own.ends + 0.5) * size - 0.5, thickness=own.thickness * shrink)
        found = _settled(found, part.candidate, upright, shrink)
        is_pen = part.candidate.style is WallStyle.SINGLE_LINES
        settled.append(_middles(found) if is_pen else found)
    faces = WallFaces.together(settled)
    words = storey_words(walls, storey_of)
    doubts = find_doubts(faces.ends, openings, interpretation.all_walls, len(words))
    if len(words) > MOST_STOREYS:
        storey, words = np.zeros_like(storey), ("all",)
    is_given = interpretation.candidate.edge == "mask"
    return _Found(faces, storey, words, () if is_given else doubts)


def _faces_of_style(part: Interpretation) -> WallFaces:
    # Of walls of many thicknesses, what is short is known for wall where nothing else is drawn.
    is_alone = part.candidate.style.is_alone
    least_px = 3.0 if is_alone else max(0.5 * part.thickness_px, 5.0)
    return faces_of_regions(shapely.GeometryCollection(list(part.walls)), 0.6, least_px)


def _settled(faces: WallFaces, candidate: Candidate, upright: Upright, shrink: float) -> WallFaces:
    """Faces of one style, px of the upright picture, where its ink has them."""
    if candidate.edge == "mask" or len(faces.ends) == 0:
        return faces
    return settle_faces(
        faces,
        upright.darkness,
        candidate.level,
        candidate.edge == "stroke",
        max(1.5, 1.2 * shrink, 0.75 * abs(candidate.grow_px) * shrink),
    )


def _middles(faces: WallFaces) -> WallFaces:
    """Lines in the middle of strokes, of which nothing tells which side is free, or how thick the wall is."""
    # One of the two sides of each stroke, told by a direction that no wall of an upright sheet runs along.
    is_one = np.isfinite(faces.thickness) & (faces.normals @ np.array([1.0, np.sqrt(0.5)]) > 0)
    inward = faces.normals[is_one] * (faces.thickness[is_one, None] / 2)
    return WallFaces.without_a_side(faces.ends[is_one] - inward[:, None])


def _to_floorplan(
    name: str,
    fingerprint: str,
    found: _Found,
    interpretation: Interpretation,
    upright: Upright,
    options: PlanOptions,
    shrink: float,
) -> Floorplan:
    """The storey that is asked for, or all, in pixels of the picture, y up."""
    kept = np.ones(len(found.faces.ends), dtype=bool)
    if options.storey:
        kept = found.storey == storey_number(name, options.storey, found.storeys)
    faces = found.faces.take(kept)
    openings = find_openings(faces.ends, faces.normals, faces.thickness)
    picture_from_upright = _picture_from(upright)
    unit = choose_unit(options.unit, options.metres_per_unit)
    mirror = np.array([1.0, -1.0])
    storeys = tuple(f"{k}: {w}" for k, w in enumerate(found.storeys))
    return Floorplan(
        name,
        segments.moved(faces.ends, picture_from_upright) * mirror,
        faces.normals @ picture_from_upright[:, :2].T * mirror,
        faces.is_oriented,
        fingerprint,
        faces.thickness,
        segments.moved(openings, picture_from_upright) * mirror,
        is_metric=False,
        source=PlanSource(
            unit="px" if unit.metres is None else f"px of {unit.metres:g} m",
            unit_from=unit.known_from,
            storey=options.storey,
            storeys=storeys if len(storeys) > 1 else (),
            dropped=dropped_words(interpretation, shrink),
            warnings=_warnings(found, interpretation, upright, options, shrink),
            file_from_plan=np.diag([1.0, -1.0, 1.0]),
        ),
    )


def _warnings(
    found: _Found,
    interpretation: Interpretation,
    upright: Upright,
    options: PlanOptions,
    shrink: float,
) -> tuple[str, ...]:
    """What a user should look at before trusting the plan."""
    result = list(found.doubts)
    if len(found.storeys) > 1 and not options.storey:
        result.append(storeys_warning(found.storeys))
    is_given = interpretation.candidate.edge == "mask"
    if not is_given and interpretation.straight_share < STRAIGHT:
        result.append(
            f"much that looks like wall was left out, because its form is none: {COMPARE}"
        )
    unsure = [part.candidate.unsure_px for part in interpretation.parts]
    if any(unsure):
        result.append(
            f"strokes about {shrink * max(unsure):.0f} px thick may be walls, or leaves of doors and "
            f"furniture: {COMPARE}"
        )
    if interpretation.candidate.style is WallStyle.SINGLE_LINES:
        result.append(f"each line is taken for a wall, of unknown side and thickness: {COMPARE}")
    if upright.skew_deg != 0.0:
        result.append(
            f"the sheet is turned by {upright.skew_deg:.1f} deg; faces are where the picture has them"
        )
    return tuple(result)


def _picture_from(upright: Upright) -> Float[np.ndarray, "2 3"]:
    return np.asarray(cv2.invertAffineTransform(upright.upright_from_picture))
