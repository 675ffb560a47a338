"""How well walls are read out of pictures: rendered buildings whose faces are known.

    python benchmarks/plan_pictures.py [--seeds 8] [--first 1000] [--save FOLDER] [--size PX]

Face precision is the share of the length of faces found that lies within 3 px of a true face with the same
normal; recall the share of the true length (without jambs and ends of walls) within 3 px of a face found.
"""

import argparse
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from drawn_plans.drawing import STYLES, DrawingOptions, PlanPicture, draw_building
from records import Record, cpu_seconds

from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, nearest_faces
from planfit.floorplan.raster import plan_of_picture
from planfit.geometry import segments
from planfit.synth import BuildingOptions, make_building

NEAR_PX = 3.0
DENSE_SIDE_PX = 1500
FIRST_SEED = 5000
"""Seeds below were used while the reader was written."""

CONDITIONS: dict[str, DrawingOptions] = {
    "clean": DrawingOptions(),
    "cluttered": DrawingOptions(is_cluttered=True),
    "cluttered, skewed, JPEG": DrawingOptions(is_cluttered=True, noise=4.0, jpeg_quality=70),
    "photographed": DrawingOptions(shade=0.35, noise=5.0, perspective=0.015, jpeg_quality=85),
}


@dataclass(frozen=True)
class Score:
    """One picture."""

    precision: float
    recall: float
    offset_px: float
    """Median distance of faces found, where they are within 3 px."""


def make_drawing(condition: str, style: str, seed: int) -> PlanPicture:
    rng = np.random.default_rng([seed, STYLES.index(style)])
    building = make_building(
        BuildingOptions(
            n_rooms=int(rng.integers(3, 10)),
            n_columns=int(rng.integers(0, 3)),
            room_size_m=(3.0, 5.5),
        ),
        rng,
    )
    options = replace(
        CONDITIONS[condition],
        style=style,
        pixels_per_metre=float(rng.uniform(45, 110)),
        line_px=float(rng.uniform(1.2, 2.2)),
        tone=float(rng.uniform(0.4, 0.6)),
        skew_deg=float(rng.uniform(-4, 4)) if "skewed" in condition else 0.0,
    )
    return draw_building(building, options, rng)


def score(drawing: PlanPicture, image: np.ndarray | None = None) -> Score:
    try:
        plan = plan_of_picture(
            drawing.image if image is None else image, "drawing", "", PlanOptions(), "picture"
        )
    except FloorplanError as error:
        print(error)
        return Score(0.0, 0.0, np.inf)
    mirror = np.array([1.0, -1.0])
    ends, normals = plan.ends * mirror, plan.normals * mirror
    found = distances(ends, normals, drawing.ends_uv, drawing.normals_uv)
    wall = drawing.is_wall
    missed = distances(drawing.ends_uv[wall], drawing.normals_uv[wall], ends, normals)
    near = found[found < NEAR_PX]
    return Score(
        float((found < NEAR_PX).mean()),
        float((missed < NEAR_PX).mean()),
        float(np.median(near)) if len(near) else np.inf,
    )


def distances(
    ends: np.ndarray, normals: np.ndarray, to_ends: np.ndarray, to_normals: np.ndarray
) -> np.ndarray:
    """Distance (m,) px from points along faces to the nearest other face that looks the same way."""
    result = []
    for one, normal in zip(ends, normals, strict=True):
        points, _ = segments.sample(one[None], 1.0)
        alike = to_normals @ normal > 0.9
        if alike.any():
            result.append(
                nearest_faces.nearest_distance(points, np.ascontiguousarray(to_ends[alike]))
            )
        else:
            result.append(np.full(len(points), np.inf))
    return np.concatenate(result) if result else np.zeros(0)


def records(
    seeds: range = range(FIRST_SEED, FIRST_SEED + 8), save: Path | None = None
) -> list[Record]:
    """Precision and recall of each style and condition, over all length; times on a large sheet."""
    result = []
    for condition in CONDITIONS:
        for style in STYLES:
            scores = []
            for seed in seeds:
                drawing = make_drawing(condition, style, seed)
                scores.append(score(drawing))
                if save is not None:
                    name = f"{condition} {style} {seed} {scores[-1].precision:.2f} {scores[-1].recall:.2f}"
                    cv2.imwrite(
                        str(save / f"{name.replace(' ', '_').replace(',', '')}.png"), drawing.image
                    )
            precision = float(np.mean([s.precision for s in scores]))
            recall = float(np.mean([s.recall for s in scores]))
            worst = min(min(s.precision, s.recall) for s in scores)
            offset = float(np.median([s.offset_px for s in scores]))
            print(f"{condition:26} {style:14} precision {precision:.3f} recall {recall:.3f} "
                  f"worst {worst:.2f} offset {offset:.2f} px", flush=True)  # fmt: skip
            where = f"{style}, {condition}, {len(scores)} buildings"
            name = f"plan_picture_{style}_{condition}".replace(" ", "_").replace(",", "")
            result += [
                Record(f"{name}_precision", precision, "share", where),
                Record(f"{name}_recall", recall, "share", where),
                Record(f"{name}_offset_px", offset, "px", where),
            ]
    return result


def dense_squares(side_px: int = DENSE_SIDE_PX) -> np.ndarray:
    """Outlines of squares side by side, white (255) and black (v, u)."""
    picture = np.full((side_px, side_px), 255, np.uint8)
    for v in range(30, side_px - 60, 40):
        for u in range(30, side_px - 60, 40):
            picture[v : v + 28, u : u + 28] = 0
            picture[v + 5 : v + 23, u + 5 : u + 23] = 255
    return picture


def dense_grid(side_px: int = DENSE_SIDE_PX, step_px: int = 24, line_px: int = 5) -> np.ndarray:
    """Lines that cross, as of squared paper, white and black (v, u)."""
    picture = np.full((side_px, side_px), 255, np.uint8)
    for k in range(30, side_px - 30, step_px):
        picture[k : k + line_px, 30 : side_px - 30] = 0
        picture[30 : side_px - 30, k : k + line_px] = 0
    return picture


def dense_dots(side_px: int = DENSE_SIDE_PX, dot_px: int = 3) -> np.ndarray:
    """Squares of `dot_px`, two of five of them black, white and black (v, u)."""
    is_dark = np.random.default_rng(1).random((side_px // dot_px, side_px // dot_px)) < 0.4
    return np.where(np.kron(is_dark, np.ones((dot_px, dot_px))) > 0, 0, 255).astype(np.uint8)


DENSE: dict[str, Callable[[], np.ndarray]] = {
    "squares": dense_squares,
    "grid": dense_grid,
    "dots": dense_dots,
}
"""Pictures of more lines than any plan."""


def dense_ratios() -> list[Record]:
    """CPU time of reading or refusing each dense picture, over that of a cluttered drawing as large."""
    drawing = cv2.resize(
        make_drawing("cluttered", "hatched", FIRST_SEED).image,
        (DENSE_SIDE_PX, DENSE_SIDE_PX),
        interpolation=cv2.INTER_CUBIC,
    )
    plan_s, _ = cpu_seconds(lambda: read_or_refused(drawing))
    result = []
    for name, make in DENSE.items():
        picture = cv2.cvtColor(make(), cv2.COLOR_GRAY2BGR)
        ratio = cpu_seconds(lambda picture=picture: read_or_refused(picture))[0] / plan_s
        print(f"{name}: {ratio:.1f} times the CPU time of a plan as large")
        where = f"{DENSE_SIDE_PX} px square, over a hatched, cluttered drawing ({plan_s:.1f} s)"
        result.append(Record(f"dense_picture_{name}_time_ratio", ratio, "ratio", where))
    return result


def read_or_refused(image: np.ndarray) -> None:
    """Read a picture; one that is refused as no plan has cost its time as well."""
    with contextlib.suppress(FloorplanError):
        plan_of_picture(image, "drawing", "", PlanOptions(), "picture")


def time_large(side_px: int = 4000) -> Record:
    """Seconds to read a cluttered sheet of `side_px` x `side_px`."""
    drawing = make_drawing("cluttered", "hatched", FIRST_SEED)
    image = cv2.resize(drawing.image, (side_px, side_px), interpolation=cv2.INTER_CUBIC)
    begin = time.perf_counter()
    plan_of_picture(image, "drawing", "", PlanOptions(), "picture")
    seconds = time.perf_counter() - begin
    print(f"{side_px} x {side_px} px: {seconds:.2f} s")
    return Record("plan_picture_s", seconds, "s", f"hatched, cluttered, {side_px} x {side_px} px")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--size", type=int, default=4000)
    parser.add_argument("--only", default="", help="conditions that contain this")
    arguments = parser.parse_args()
    if arguments.save is not None:
        arguments.save.mkdir(parents=True, exist_ok=True)
    if arguments.size:
        time_large(arguments.size)
        dense_ratios()
    for condition in list(CONDITIONS):
        if arguments.only not in condition:
            del CONDITIONS[condition]
    records(range(arguments.first, arguments.first + arguments.seeds), arguments.save)
