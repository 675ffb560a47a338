"""How well walls are read out of real vector drawings, against segments drawn by hand.

    python benchmarks/real_drawings.py [--page docs/real-plans.md]

The truth (tests/floorplan/real_drawing_walls.json) was drawn over the line work by eye. Recall is the share
of its length within 5 cm of a face found (1 % of the plan's size where the unit is not known), precision
that of the faces within as much of it.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from faults.scans import SHARED
from records import Record

from planfit.floorplan import nearest_faces, read_floorplan
from planfit.geometry import segments

WALLS = Path(__file__).parents[1] / "tests" / "floorplan" / "real_drawing_walls.json"
NEAR_M, NEAR_SHARE = 0.05, 0.01
STEPS = 5
"""Points within the distance that counts as near."""


@dataclass(frozen=True)
class Score:
    """One drawing."""

    file: str
    recall: float
    precision: float
    near: float
    """In the plan's unit."""
    is_metric: bool
    is_chosen_on: bool


def scores() -> Iterator[Score]:
    """Of those drawings that are at hand."""
    for truth in json.loads(WALLS.read_text())["drawings"]:
        path = SHARED / truth["file"]
        if path.is_file():
            yield _score(path, truth)


def _score(path: Path, truth: dict) -> Score:
    plan = read_floorplan(path)
    walls = np.array(truth["walls"], dtype=float).reshape(-1, 2, 2)
    near = NEAR_M
    if not plan.is_metric:
        near = NEAR_SHARE * float(np.ptp(walls.reshape(-1, 2), axis=0).max())
    either = shapely.union_all([shapely.Polygon(corners) for corners in truth["either"]])
    missed = nearest_faces.nearest_distance(_points(walls, near, either), plan.ends)
    found = nearest_faces.nearest_distance(_points(plan.ends, near, either), walls)
    return Score(
        truth["file"],
        float((missed < near).mean()),
        float((found < near).mean()),
        near,
        plan.is_metric,
        truth["chosen_on"],
    )


def _points(ends: np.ndarray, near: float, either: shapely.Geometry) -> np.ndarray:
    points, _ = segments.sample(np.ascontiguousarray(ends), near / STEPS)
    return points[~shapely.contains(either, shapely.points(points))]


def records() -> list[Record]:
    """Recall and precision of each."""
    result = []
    for score in scores():
        where = (
            f"{score.file}, {'' if score.is_chosen_on else 'not '}at hand while readers were mended"
        )
        name = f"real_drawing_{Path(score.file).stem}"
        result += [
            Record(f"{name}_recall", score.recall, "share", where),
            Record(f"{name}_precision", score.precision, "share", where),
        ]
    return result


def table() -> str:
    """Markdown: a row a drawing."""
    lines = ["| drawing | recall | precision | within |", "| --- | --- | --- | --- |"]
    for each in scores():
        unit = "m" if each.is_metric else "units (1 % of its size)"
        mark = "" if each.is_chosen_on else " *"
        words = f"{each.recall:.3f} | {each.precision:.3f} | {each.near:.2g} {unit}"
        lines.append(f"| {Path(each.file).name}{mark} | {words} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="Markdown file whose table is replaced")
    arguments = parser.parse_args()
    found = table()
    print(found)
    if arguments.page is not None:
        before, _, rest = arguments.page.read_text().partition("<!-- drawings -->\n")
        after = rest.partition("<!-- end of drawings -->")[2]
        arguments.page.write_text(
            f"{before}<!-- drawings -->\n{found}\n<!-- end of drawings -->{after}"
        )
