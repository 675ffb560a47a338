"""What is looked at in a plan that was read: sizes, openings, layers, and walls beside those drawn."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import ezdxf
import numpy as np
import real_drawings
import real_plans
import shapely
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from buildings.reading_cases import (
    fact_at_least,
    fact_at_most,
    fact_between,
    fact_same,
    fact_within,
)
from buildings.rows import Fact
from planfit.floorplan import Floorplan, nearest_faces
from planfit.geometry import segments

Check = Callable[[Floorplan], Iterator[Fact]]
"""What is held beside the truth of one plan."""

LEAST_MARKED = 0.95
"""Recall and precision of plans whose walls were marked: real-plans.md has 0.99 and more of them all."""
LEAST_ESCAPE, LEAST_INK = 0.9, 0.9
WALL_GREY = 204
"""Of the bodies of walls of the escape plan."""
LEAST_BODY_PX2 = 120
"""Grey specks smaller than any wall."""
NEAR_ESCAPE_PX, NEAR_INK_PX, NEAR_ROOM = 8.0, 5.0, 10.0
"""Distances that EXPECT.txt measured with."""
OFF_INK_SHARE = 0.01
LEAST_DOOR_CM = 30.0
"""Radius of a door's arc; smaller ones are of fittings."""
NEAR_LEAF_CM, NEAR_DOORWAY_CM = 10.0, 5.0
"""Arcs of the club's drawing end up to 9 cm from their leaves."""


def sides(plan: Floorplan, right: tuple[float, ...], tolerance: float, unit: str) -> Iterator[Fact]:
    """Longer side, and shorter one where it is known, of what was read."""
    yield fact_same("is metric", unit == "m", plan.is_metric)
    for name, side, found in zip(
        ("longer", "shorter"), right, sorted(plan.size, reverse=True), strict=False
    ):
        yield fact_within(f"{name} side, {unit}", side, found, tolerance)


def proportion(plan: Floorplan, right: float) -> Iterator[Fact]:
    """Longer side over shorter one, of plans that may be read with or without a unit."""
    yield fact_within("longer side over shorter", right, max(plan.size) / min(plan.size), 0.04)


def length(plan: Floorplan, low: float, high: float) -> Iterator[Fact]:
    """Length of all faces, in the plan's unit."""
    yield fact_between("length of faces", low, high, float(plan.lengths.sum()))


def plans_on_sheet(plan: Floorplan, right: int) -> Iterator[Fact]:
    """Plans, or storeys, that were told apart."""
    yield fact_same("plans or storeys", right, max(len(plan.source.storeys), 1))


def gaps(plan: Floorplan, low: int, high: int) -> Iterator[Fact]:
    """Doors and windows; some readers count both faces of a wall."""
    n_gaps = 0 if plan.openings is None else len(plan.openings)
    yield fact_between("gaps of doors and windows", low, high, n_gaps)


def openings_of(plan: Floorplan, kind: str, low: int, high: int) -> Iterator[Fact]:
    """Openings of one kind, as the summary counts them."""
    counts = [words.split() for words in plan.source.opening_kinds]
    n_found = sum(int(count) for count, name in counts if name.startswith(kind))
    yield fact_between(f"{kind}s", low, high, n_found)


def layers_without(plan: Floorplan, names: tuple[str, ...]) -> Iterator[Fact]:
    """Layers that are no walls, by words of their names in small letters."""
    found = [layer for layer in plan.source.layers if any(name in layer.lower() for name in names)]
    yield fact_same(f"layers of {', '.join(names)} read as walls", "none", _listed(found))


def kind_begins(plan: Floorplan, words: str) -> Iterator[Fact]:
    """What the file was taken for."""
    found = plan.source.kind
    yield Fact("read as", f"{words} ...", found, found.startswith(words))


def along_axes(plan: Floorplan, least: float) -> Iterator[Fact]:
    """Share of the length of faces within 3 degrees of the axes of the drawing: hatches run askew."""
    angle_deg = np.rad2deg(np.arctan2(plan.normals[:, 1], plan.normals[:, 0])) % 90
    is_along = np.minimum(angle_deg, 90 - angle_deg) < 3
    share = float(plan.lengths[is_along].sum() / plan.lengths.sum())
    yield fact_at_least("share along the two directions", least, share)


def right_of(plan: Floorplan, least_x: float) -> Iterator[Fact]:
    """Nothing of a legend that stands at the left, x of the plan frame."""
    share = float((plan.ends[..., 0] < least_x).any(axis=1).mean())
    yield fact_at_most("share of faces in the legend", 0.0, share)


def thin_walls(plan: Floorplan, most_m: float) -> Iterator[Fact]:
    """No rooms taken for solid walls."""
    known = np.array([]) if plan.thickness is None else plan.thickness
    known = known[np.isfinite(known)]
    found = float(np.median(known)) if len(known) else 0.0
    yield fact_at_most("median thickness of walls, m", most_m, found)


def wide_doors(plan: Floorplan, most_m: float) -> Iterator[Fact]:
    """No fronts taken for doors."""
    widths_m = np.zeros(0) if plan.openings is None else segments.lengths(plan.openings)
    n_wide = int((widths_m > most_m).sum())
    yield fact_same(f"doors wider than {most_m:g} m", 0, n_wide)


def few_bits_askew(plan: Floorplan, shortest: float, most: int) -> Iterator[Fact]:
    """No arcs of doors among walls that have none: bits of curves are short and askew."""
    along = np.abs(segments.directions(plan.ends))
    is_askew = along.min(axis=1) > 0.02
    yield fact_at_most("short faces askew", most, int((is_askew & (plan.lengths < shortest)).sum()))


def marked_picture(plan: Floorplan) -> Iterator[Fact]:
    """A picture whose walls were marked by eye."""
    truth = next(real_plans.load_truths(Path(plan.name).name))
    yield from _outline_facts(plan, truth.outline, truth.near_px, LEAST_MARKED, truth.either)


def drawn_walls(plan: Floorplan, file: str) -> Iterator[Fact]:
    """A drawing over which walls were drawn by hand; gaps of doors and glass count as marked there."""
    drawings = json.loads(real_drawings.WALLS.read_text())["drawings"]
    truth = next(drawing for drawing in drawings if drawing["file"] == file)
    walls = np.array(truth["walls"], dtype=float).reshape(-1, 2, 2)
    either = shapely.union_all([shapely.Polygon(corners) for corners in truth["either"]])
    yield from _wall_facts(plan.ends, walls, real_drawings.NEAR_M, LEAST_MARKED, either)


def lines_of_file(
    plan: Floorplan, lines: tuple[tuple[float, ...], ...], near: float, least_precision: float
) -> Iterator[Fact]:
    """Walls given as chains x, y, x, y, ... in the file's own coordinates."""
    chains = [np.reshape(chain, (-1, 2)) for chain in lines]
    walls = np.concatenate([np.stack([c[:-1], c[1:]], axis=1) for c in chains])
    yield from _wall_facts(faces_in_file(plan), walls, near, least_precision)


def outer_walls(
    plan: Floorplan, lines: tuple[tuple[float, ...], ...], least: float
) -> Iterator[Fact]:
    """Recall alone, of walls in which there are windows and doors."""
    facts = lines_of_file(plan, lines, NEAR_ROOM, 0.0)
    found = next(facts).found
    yield Fact("recall of the outer walls", f"{least:g} or more", found, float(found) >= least)


def grey_bodies(plan: Floorplan) -> Iterator[Fact]:
    """Outline of the grey bodies of the escape plan's walls; its overview has other greys."""
    image = cv2.imread(str(plan.name))
    assert image is not None
    mask = np.all(image == WALL_GREY, axis=-1).astype(np.uint8)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(mask)
    kept = np.flatnonzero(statistics[1:, cv2.CC_STAT_AREA] > LEAST_BODY_PX2) + 1
    bodies = np.isin(labels, kept).astype(np.uint8)
    contours, _ = cv2.findContours(bodies, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outline = np.concatenate([contour[:, 0] for contour in contours]).astype(float)
    yield from _outline_facts(plan, outline, NEAR_ESCAPE_PX, LEAST_ESCAPE)


def on_ink(plan: Floorplan) -> Iterator[Fact]:
    """Grey lines of a picture of double lines: read all, and no face where nothing is drawn."""
    image = cv2.imread(str(plan.name))
    assert image is not None
    darkest, brightest = image.min(axis=-1).astype(int), image.max(axis=-1).astype(int)
    # Doors and lifts are red and cyan: their brightest channel is bright.
    v, u = np.nonzero((brightest < 160) & (brightest - darkest < 60))
    ink = np.stack([u, v], axis=-1).astype(float)
    faces = faces_in_file(plan)
    missed = nearest_faces.nearest_distance(ink, faces)
    recall = float(np.mean(missed < NEAR_INK_PX))
    yield fact_at_least("recall of the line work", LEAST_INK, recall)
    points, _ = segments.sample(faces, 1.0)
    drawn = np.stack(np.nonzero(image.min(axis=-1) < 200)[::-1], axis=-1)
    is_off = cKDTree(drawn).query(points)[0] > NEAR_INK_PX
    yield fact_at_most("share of faces off the ink", OFF_INK_SHARE, float(np.mean(is_off)))


def doors_ajar(plan: Floorplan) -> Iterator[Fact]:
    """Leaves from an arc's centre to its end are no walls, and the wall is open to the arc's other end."""
    drawing = ezdxf.readfile(str(plan.name))  # pyright: ignore[reportPrivateImportUsage]
    leaves, doorways = [], []
    for arc in drawing.modelspace().query("ARC"):
        if arc.dxf.layer == "Hatches" or arc.dxf.radius < LEAST_DOOR_CM:
            continue
        angles_deg = np.array([arc.dxf.start_angle, arc.dxf.end_angle])
        # Walls run along the axes; of a quarter circle (ours), the doorway is at the start.
        off_deg = np.abs((angles_deg + 45.0) % 90.0 - 45.0).round()
        wall = int(np.argmin(off_deg))
        towards = np.stack([np.cos(np.deg2rad(angles_deg)), np.sin(np.deg2rad(angles_deg))], 1)
        centre, radius = np.array(arc.dxf.center)[:2], arc.dxf.radius
        # Far out, a leaf that is hardly open is away from the wall.
        leaves.append(centre + 0.9 * radius * towards[1 - wall])
        doorways.append(centre + 0.6 * radius * towards[wall])
    faces = faces_in_file(plan)
    near_leaf = nearest_faces.nearest_distance(np.array(leaves), faces) < NEAR_LEAF_CM
    near_doorway = nearest_faces.nearest_distance(np.array(doorways), faces) < NEAR_DOORWAY_CM
    yield fact_same("leaves read as walls", 0, int(near_leaf.sum()))
    yield fact_at_least("open doorways", len(doorways) - 1, int((~near_doorway).sum()))


def faces_in_file(plan: Floorplan) -> Float[np.ndarray, "n 2 2"]:
    """Faces in the file's own coordinates."""
    file_from_plan = plan.source.file_from_plan
    assert file_from_plan is not None
    return np.ascontiguousarray(plan.ends @ file_from_plan[:2, :2].T + file_from_plan[:2, 2])


def _outline_facts(
    plan: Floorplan,
    outline: Float[np.ndarray, "n 2"],
    near_px: float,
    least: float,
    either: Bool[np.ndarray, "h w"] | None = None,
) -> Iterator[Fact]:
    """Recall of points of the true outline, precision of faces; what lies in `either` counts neither way."""
    faces = faces_in_file(plan)
    points, _ = segments.sample(faces, 1.0)
    if either is not None:
        height, width = either.shape
        outline, points = (
            uv[
                ~either[
                    tuple(np.clip(uv.round().astype(int)[:, ::-1], 0, (height - 1, width - 1)).T)
                ]
            ]
            for uv in (outline, points)
        )
    missed = nearest_faces.nearest_distance(outline, faces)
    found = cKDTree(outline).query(points)[0]
    yield fact_at_least("recall of walls", least, float(np.mean(missed < near_px)))
    yield fact_at_least("precision of faces", least, float(np.mean(found < near_px)))


def _wall_facts(
    faces: Float[np.ndarray, "n 2 2"],
    walls: Float[np.ndarray, "k 2 2"],
    near: float,
    least_precision: float,
    either: shapely.Geometry | None = None,
) -> Iterator[Fact]:
    """Recall and precision of faces against walls as segments, within `near` of their unit."""
    shares = []
    for ends, others in ((walls, faces), (faces, walls)):
        points, _ = segments.sample(np.ascontiguousarray(ends), near / 5)
        if either is not None:
            points = points[~shapely.contains(either, shapely.points(points))]
        apart = nearest_faces.nearest_distance(points, np.ascontiguousarray(others))
        shares.append(float((apart < near).mean()))
    yield fact_at_least("recall of walls", LEAST_MARKED, shares[0])
    yield fact_at_least("precision of faces", least_precision, shares[1])


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"
