"""How well walls are read out of real pictures, at several sizes, margins and turns.

    python benchmarks/real_plans.py [--save FOLDER] [--only NAME] [--page docs/real-plans.md]

The truth is the outline of what is wall, marked by eye (tests/floorplan/real_plan_marks.json). Recall is the
share of that outline within 5 cm of a face found (1 % of the plan's size where the scale is not known), of
all walls and of those at least 3 px thick in what is shown; precision the share of the length of faces
within as much of it. The pictures are not ours: overlays are written to --save, never into the repository.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from faults.scans import SHARED
from records import Record
from scipy.spatial import cKDTree

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, PlanOptions, nearest_faces
from planfit.floorplan.formats.picture import load_picture
from planfit.floorplan.raster import plan_of_picture
from planfit.geometry import segments

ROOT = Path(__file__).parents[1]
MARKS = ROOT / "tests" / "floorplan" / "real_plan_marks.json"
NEAR_M, NEAR_SHARE = 0.05, 0.01
LEAST_NEAR_PX = 1.5
"""Of shrunk pictures: nearer than this, pixels decide."""
LEAST_WALL_PX, SIZES = 3.0, (0.5, 0.33, 0.25)
"""Walls are asked for down to this thickness in what is shown; thinner ones are counted and told apart."""


@dataclass(frozen=True)
class Truth:
    """A picture, and where its walls end."""

    name: str
    image: np.ndarray
    outline: np.ndarray
    """(n, 2) u, v."""
    either: np.ndarray
    """(h, w) True where walls count neither way."""
    near_px: float
    is_chosen_on: bool
    thickness_px: np.ndarray
    """(n,) of the wall at each point of the outline, up to the thickest that some size asks for."""


@dataclass(frozen=True)
class Score:
    """One reading of one picture."""

    recall: float
    recall_thick: float
    """Of walls of `LEAST_WALL_PX` and more; NaN where there are none."""
    precision: float
    n_storeys: int
    seconds: float
    words: str


def load_truths(only: str = "") -> Iterator[Truth]:
    """Those pictures that are at hand."""
    for mark in json.loads(MARKS.read_text())["pictures"]:
        path = SHARED / mark["file"]
        if only in mark["file"] and path.is_file():
            yield _marked(path, mark)


def _marked(path: Path, mark: dict) -> Truth:
    image, _ = load_picture(path)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    low, high = mark["tones"]
    walls = ((grey >= low) & (grey <= high)).astype(np.uint8)
    size = int(mark["least_px"])
    kernel = np.ones((size, size), np.uint8)
    anchor = (size - 1 - size // 2,) * 2  # an even opening would shift by a pixel
    walls = cv2.dilate(cv2.erode(walls, kernel), kernel, anchor=anchor)
    for u0, v0, u1, v1 in mark["without"]:
        walls[v0:v1, u0:u1] = 0
    either = np.zeros(walls.shape, bool)
    for u0, v0, u1, v1 in mark["either"]:
        either[v0:v1, u0:u1] = True
    contours, _ = cv2.findContours(walls, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outline = np.concatenate([contour[:, 0] for contour in contours]).astype(float)
    near = NEAR_SHARE * float(np.ptp(outline, axis=0).max())
    if "metres_per_px" in mark:
        near = NEAR_M / mark["metres_per_px"]
    thickness = _thickness_px(walls, outline, int(np.ceil(LEAST_WALL_PX / min(SIZES))))
    return Truth(path.name, image, outline, either, near, mark["chosen_on"], thickness)


def _thickness_px(walls: np.ndarray, outline: np.ndarray, most: int) -> np.ndarray:
    """Diameter of the largest disk within the walls that touches them at each point, up to `most`."""
    u, v = outline.astype(int).T
    result = np.ones(len(outline))
    for size in range(2, most + 1):
        disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        kept = cv2.dilate(cv2.erode(walls, disk), disk, anchor=(size - 1 - size // 2,) * 2)
        reach = 2 * int(np.ceil(0.3 * size)) + 1  # corners are rounder than the disk
        result[cv2.dilate(kept, np.ones((reach, reach), np.uint8))[v, u] > 0] = size
    return result


def variants(truth: Truth) -> Iterator[tuple[str, Truth]]:
    """As it is; smaller; with less and more margin; turned."""
    yield "as it is", truth
    h, w = truth.image.shape[:2]
    for size in SIZES:
        matrix = np.array([[size, 0, 0.5 * size - 0.5], [0, size, 0.5 * size - 0.5]])
        small = cv2.resize(truth.image, None, fx=size, fy=size, interpolation=cv2.INTER_AREA)
        yield f"{size:g} of its size", _moved(truth, small, matrix, size)
    (u0, v0), (u1, v1) = truth.outline.min(axis=0), truth.outline.max(axis=0)
    u0, v0 = max(int(u0) - 12, 0), max(int(v0) - 12, 0)
    cropped = truth.image[v0 : int(v1) + 13, u0 : int(u1) + 13]
    yield "margin cropped", _moved(truth, cropped, np.array([[1.0, 0, -u0], [0, 1, -v0]]))
    top, left = h // 4, w // 4
    wide = cv2.copyMakeBorder(
        truth.image, top, top, left, left, cv2.BORDER_CONSTANT, value=(255,) * 3
    )
    yield "margin doubled", _moved(truth, wide, np.array([[1.0, 0, left], [0, 1, top]]))
    yield (
        "turned by 90 deg",
        _moved(
            truth,
            cv2.rotate(truth.image, cv2.ROTATE_90_CLOCKWISE),
            np.array([[0.0, -1, h - 1], [1, 0, 0]]),
        ),
    )
    c, s = np.cos(np.deg2rad(3.0)), np.sin(np.deg2rad(3.0))
    corners = np.array([[0, 0], [w, 0], [0, h], [w, h]]) @ np.array([[c, -s], [s, c]]).T
    low = corners.min(axis=0)
    matrix = np.array([[c, -s, -low[0]], [s, c, -low[1]]])
    size = np.ceil(np.ptp(corners, axis=0)).astype(int)
    turned = cv2.warpAffine(
        truth.image,
        matrix,
        (int(size[0]), int(size[1])),
        flags=cv2.INTER_LINEAR,
        borderValue=(255,) * 3,
    )
    yield "turned by 3 deg", _moved(truth, turned, matrix)


def _moved(truth: Truth, image: np.ndarray, matrix: np.ndarray, size: float = 1.0) -> Truth:
    h, w = image.shape[:2]
    either = cv2.warpAffine(truth.either.astype(np.uint8), matrix, (w, h)) > 0
    outline = truth.outline @ matrix[:, :2].T + matrix[:, 2]
    near = max(size * truth.near_px, LEAST_NEAR_PX)
    return replace(
        truth,
        image=np.ascontiguousarray(image),
        outline=outline,
        either=either,
        near_px=near,
        thickness_px=size * truth.thickness_px,
    )


def score(truth: Truth) -> Score:
    """Read it, and compare."""
    begin = time.perf_counter()
    try:
        plan = plan_of_picture(truth.image, truth.name, "", PlanOptions(), "picture")
    except FloorplanError as error:
        return Score(0.0, 0.0, 0.0, 0, time.perf_counter() - begin, str(error))
    seconds = time.perf_counter() - begin
    ends = np.ascontiguousarray(plan.ends * (1.0, -1.0))
    counts = ~_inside(truth.either, truth.outline)
    outline, is_thick = truth.outline[counts], truth.thickness_px[counts] >= LEAST_WALL_PX
    points, _ = segments.sample(ends, 1.0)
    points = points[~_inside(truth.either, points)]
    missed = nearest_faces.nearest_distance(outline, ends)
    found = cKDTree(truth.outline).query(points)[0]
    is_read = missed < truth.near_px
    return Score(
        float(is_read.mean()),
        float(is_read[is_thick].mean()) if is_thick.any() else float("nan"),
        float((found < truth.near_px).mean()),
        max(len(plan.source.storeys), 1),
        seconds,
        plan.source.kind.removeprefix("picture, walls "),
    )


def _inside(mask: np.ndarray, uv: np.ndarray) -> np.ndarray:
    u, v = np.round(uv).astype(int).T
    kept = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    result = np.zeros(len(uv), bool)
    result[kept] = mask[v[kept], u[kept]]
    return result


def draw_overlay(truth: Truth, plan: Floorplan | None = None) -> np.ndarray:
    """True outline in green, faces in red, over the pale picture."""
    plan = plan or plan_of_picture(truth.image, truth.name, "", PlanOptions(), "picture")
    canvas = (255 - 0.4 * (255.0 - truth.image)).astype(np.uint8)
    u, v = np.round(truth.outline).astype(int).T
    kept = (u >= 0) & (v >= 0) & (u < canvas.shape[1]) & (v < canvas.shape[0])
    canvas[v[kept], u[kept]] = (0, 160, 0)
    lines = list(np.round(plan.ends * (1.0, -1.0) * 16).astype(np.int32))
    cv2.polylines(canvas, lines, False, (0, 0, 220), 1, cv2.LINE_AA, 4)
    return canvas


def table(rows: list[tuple[Truth, str, Score]]) -> str:
    """Markdown: a row a picture, a column a change of it, recall / precision."""
    changes = list(dict.fromkeys(change for _, change, _ in rows))
    lines = ["| picture | read as | plans | " + " | ".join(changes) + " |",
             "| --- | --- | --- |" + " --- |" * len(changes)]  # fmt: skip
    for name in dict.fromkeys(truth.name for truth, _, _ in rows):
        own = {change: (truth, found) for truth, change, found in rows if truth.name == name}
        truth, first = own[changes[0]]
        cells = [_cell(found) for _, found in own.values()]
        mark = "" if truth.is_chosen_on else " *"
        plans = sorted({found.n_storeys for _, found in own.values()})
        counts = ", ".join(str(n) for n in plans)
        lines.append(f"| {name}{mark} | {first.words} | {counts} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def records() -> list[Record]:
    """Recall and precision of each picture as it is, and the worst over all its sizes, margins and turns."""
    result = []
    for truth in load_truths():
        rows = [(change, score(changed)) for change, changed in variants(truth)]
        thick = [found.recall_thick for _, found in rows if not np.isnan(found.recall_thick)]
        where = f"{truth.name}, {'' if truth.is_chosen_on else 'not '}looked at while parameters were chosen"
        name = f"real_plan_{Path(truth.name).stem}"
        result += [
            Record(f"{name}_recall", rows[0][1].recall, "share", where),
            Record(f"{name}_precision", rows[0][1].precision, "share", where),
            Record(
                f"{name}_worst_recall",
                min(thick),
                "share",
                f"{where}; of {len(thick)} sizes, margins and turns, walls of {LEAST_WALL_PX:g} px and more",
            ),
        ]
    return result


def _cell(found: Score) -> str:
    """Recall and precision, and the recall of walls thick enough where it differs."""
    words = f"{found.recall:.3f} / {found.precision:.3f}"
    if np.isnan(found.recall_thick):
        return f"{words} (no wall of {LEAST_WALL_PX:g} px)"
    differs = found.recall_thick - found.recall >= 0.0005
    return f"{words} ({found.recall_thick:.3f})" if differs else words


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, help="folder for overlays, outside the repository")
    parser.add_argument("--only", default="", help="pictures whose path contains this")
    parser.add_argument("--page", type=Path, help="Markdown file whose table is replaced")
    arguments = parser.parse_args()
    results = []
    for truth in load_truths(arguments.only):
        for change, changed in variants(truth):
            results.append((truth, change, score(changed)))
            found = results[-1][2]
            print(f"{truth.name:24} {change:17} recall {found.recall:.3f} ({found.recall_thick:.3f}) "
                  f"precision {found.precision:.3f} plans {found.n_storeys} {found.seconds:5.1f} s  "
                  f"{found.words}", flush=True)  # fmt: skip
            if arguments.save is not None and found.n_storeys:
                arguments.save.mkdir(parents=True, exist_ok=True)
                name = f"{Path(truth.name).stem}_{change.replace(' ', '_')}.png"
                cv2.imwrite(str(arguments.save / name), draw_overlay(changed))
    print(table(results))
    if arguments.page is not None:
        before, _, rest = arguments.page.read_text().partition("<!-- table -->\n")
        after = rest.partition("<!-- end of table -->")[2]
        arguments.page.write_text(
            f"{before}<!-- table -->\n{table(results)}\n<!-- end of table -->{after}"
        )
