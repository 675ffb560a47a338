"""Drawings in styles that the readers were not made on, whose walls are known: written here, by nothing of
planfit, as SVG, DXF and PDF, and as pictures of the same pages.

    python benchmarks/foreign_drawings.py -o /tmp/foreign [--seeds 4] [--only FAMILY] [--pictures | --both]

Recall is the share of the length of the drawn faces (walls of one line: of the line) within 6 cm of a face
found, precision that of the faces found within as much of a drawn one; windows and doorways count neither
way. Wrong is what has less than 0.8 of either, and silent what says nothing that speaks against it. With
--both, how many silent wrong readings of drawings would be caught, and how many right ones doubted, if the
same page read as a picture had a say where that is not doubted itself (docs/adr/0037-two-readings.md).
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from buildings.plan_readings import NOTES
from foreign_pages import FAMILIES, Label, Page, make_page
from foreign_writers import write_page

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, nearest_faces, read_floorplan
from planfit.geometry import segments

NEAR_M, STEPS = 0.06, 3
RIGHT = 0.8
"""Of recall and of precision; less is a wrong reading."""
SUFFIXES = (".svg", ".dxf", ".pdf")


@dataclass(frozen=True)
class Score:
    """One drawing that was read."""

    name: str
    recall: float
    precision: float
    doubts: tuple[str, ...]
    """What speaks against the reading; of a refusal, its error."""
    seconds: float

    @property
    def is_right(self) -> bool:
        """Whether both shares are high."""
        return min(self.recall, self.precision) >= RIGHT

    @property
    def is_silent(self) -> bool:
        """Whether nothing is said against it."""
        return not self.doubts


def score(path: Path, page: Page) -> Score:
    """Recall and precision of one file of a page."""
    begin = time.process_time()
    try:
        plan = read_floorplan(path)
    except FloorplanError as error:
        return Score(path.name, 0.0, 0.0, (str(error),), time.process_time() - begin)
    seconds = time.process_time() - begin
    recall, precision = shares(faces_m(plan, path), page)
    doubts = tuple(w for w in plan.source.warnings if not any(note in w for note in NOTES))
    return Score(path.name, recall, precision, doubts, seconds)


def faces_m(plan: Floorplan, path: Path) -> np.ndarray:
    """Faces in metres of the page, whatever the unit that was read."""
    file_from_plan = plan.source.file_from_plan
    assert file_from_plan is not None
    in_file = plan.ends @ file_from_plan[:2, :2].T + file_from_plan[:2, 2]
    page_from_file = np.array(json.loads(path.with_suffix(path.suffix + ".json").read_text()))
    return in_file @ page_from_file[:2, :2].T + page_from_file[:2, 2]


def shares(faces: np.ndarray, page: Page) -> tuple[float, float]:
    """Recall and precision of faces in metres."""
    missed = nearest_faces.nearest_distance(_points(page.faces, page), faces)
    wrong = nearest_faces.nearest_distance(_points(faces, page), page.faces)
    return float((missed < NEAR_M).mean()), float((wrong < NEAR_M).mean())


def _points(ends: np.ndarray, page: Page) -> np.ndarray:
    points, _ = segments.sample(np.ascontiguousarray(ends), NEAR_M / STEPS)
    return points[~shapely.contains(page.either, shapely.points(points))]


def scores(folder: Path, seeds: range, only: str = "", pictures: bool = False) -> Iterator[Score]:
    """Of each family and seed, in the format that the seed draws; written to a folder."""
    for found, _, _ in _read_all(folder, seeds, only, pictures):
        yield found


def _read_all(
    folder: Path, seeds: range, only: str, pictures: bool
) -> Iterator[tuple[Score, Page, Path]]:
    folder.mkdir(parents=True, exist_ok=True)
    for family in FAMILIES:
        for seed in seeds if only in family else ():
            page = make_page(family, seed)
            suffix = (
                ".png" if pictures else SUFFIXES[(seed + FAMILIES.index(family)) % len(SUFFIXES)]
            )
            path = write_page(page, folder / f"{family}_{seed}{suffix}")
            yield score(path, page), page, path


def told_by_pictures(folder: Path, seeds: range, only: str = "") -> str:
    """What readings of pictures say of those of drawings, a line for each share that may differ."""
    rows = []
    for drawn, page, path in _read_all(folder, seeds, only, False):
        picture = write_page(_without_words(page), path.with_suffix(".png"))
        seen = score(picture, page)
        if drawn.is_silent and seen.is_silent:
            one, other = (faces_m(read_floorplan(each), each) for each in (path, picture))
            found, missed = shares(one, replace(page, faces=other))
            rows.append((drawn.is_right, min(found, missed)))
        elif drawn.is_silent:
            rows.append((drawn.is_right, 1.0))
    is_right, alike = (np.array(column) for column in zip(*rows, strict=True))
    return "\n".join(
        f"alike by less than {least}: {(alike[~is_right] < least).sum()} of {(~is_right).sum()} silent wrong "
        f"caught, {(alike[is_right] < least).sum()} of {is_right.sum()} right doubted"
        for least in (0.6, 0.7, 0.8, 0.9)
    )


def _without_words(page: Page) -> Page:
    return replace(page, parts=[part for part in page.parts if not isinstance(part, Label)])


def summary(found: list[Score]) -> str:
    """Counts, in a line."""
    wrong = [one for one in found if not one.is_right]
    silent = [one for one in wrong if one.is_silent]
    right = [one for one in found if one.is_right]
    doubted = [one for one in right if not one.is_silent]
    return (
        f"{len(found)} drawings: {len(right)} right ({len(doubted)} doubted), {len(wrong)} wrong, "
        f"{len(silent)} of them silent; {sum(one.seconds for one in found):.0f} s"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for the drawings")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="", help="families that contain this")
    parser.add_argument("--pictures", action="store_true", help="the pages as pictures")
    parser.add_argument("--both", action="store_true", help="what pictures tell of drawings")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    if arguments.both:
        print(told_by_pictures(arguments.output, seeds, arguments.only))
        raise SystemExit(0)
    rows = []
    for one in scores(arguments.output, seeds, arguments.only, arguments.pictures):
        rows.append(one)
        state = "right" if one.is_right else "SILENT" if one.is_silent else "wrong"
        print(
            f"{one.name:28} recall {one.recall:.3f} precision {one.precision:.3f} {one.seconds:5.1f} s "
            f"{state:6} {'; '.join(words[:70] for words in one.doubts)}",
            flush=True,
        )
    print(summary(rows))
