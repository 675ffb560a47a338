"""As built against as planned: how many walls of wrong plans get the right verdict, how right offsets are.

    python benchmarks/as_built.py [--seeds 1 3 5 ...] [--drawn-sigma-m 0.01] [--cache FOLDER] [--json FILE]
        [--each]

Cases are those of `as_built_cases.py`. Even seeds up to 26 were for choosing parameters, and odd ones up to
19 were looked at once before the rules for cupboards were made; those from 21 on are for reporting. A wall of
the plan is counted where the cameras saw it, by depth at the true poses; its true verdict is by the
tolerance (3 cm: walls are drawn right, or 5 cm off at least). A wall that the plan lacks is found where new
walls stand for half of it. A new wall that stands where none was built counts as one more verdict, wrong.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from as_built_cases import (
    MIN_SEEN_M,
    MIN_THROUGH_SHARE,
    Case,
    Views,
    make_case,
    seen_m,
    through_m,
    true_views,
)

import planfit
from planfit.as_built import AsBuilt, AsBuiltOptions, AsBuiltWall, Verdict, compare_as_built
from planfit.as_built.wall_offsets import MIN_LENGTH_M
from planfit.geometry import segments
from planfit.runtime import Runtime

TOLERANCE_M = 0.03
SAME_PLACE_M = 0.1
"""A new wall is that of a true face within this, across."""


@dataclass(frozen=True)
class Judged:
    """A wall beside the truth."""

    seed: int
    where: str
    true: str
    found: str
    is_seen: bool
    error_m: float = np.nan
    """Of the offset; NaN where there is none."""
    sigma_m: float = np.nan
    is_sure: bool = True
    """As the verdict says of itself."""
    is_refined: bool = True
    """Whether `planfit refine` says that the poses are to be used."""


def judge(seed: int, case: Case, views: Views, found: AsBuilt) -> list[Judged]:
    return [
        *_of_plan(seed, case, views, found),
        *_undrawn(seed, case, views, found),
        *_false_new(seed, case, found),
    ]


def _of_plan(seed: int, case: Case, views: Views, found: AsBuilt) -> Iterator[Judged]:
    offsets_m = case.true_offsets_m
    for wall in found.walls:
        face = wall.face_idx
        if face < 0:
            continue
        if case.is_built[face]:
            is_off = abs(offsets_m[face]) > TOLERANCE_M
            true = Verdict.MOVED if is_off else Verdict.AGREES
            stands = wall.ends + case.as_built_m[face]
            is_seen = seen_m(views, stands, wall.normal) >= MIN_SEEN_M
        else:
            true = Verdict.MISSING
            is_seen = through_m(views, wall.ends, wall.normal) >= MIN_THROUGH_SHARE * wall.length_m
        error = wall.offset_m - offsets_m[face]
        yield Judged(
            seed,
            _where(wall),
            true.value,
            found.verdict(wall).value,
            is_seen,
            error,
            wall.sigma_m,
            found.is_sure(wall),
        )


def _undrawn(seed: int, case: Case, views: Views, found: AsBuilt) -> Iterator[Judged]:
    new = [wall for wall in found.walls if found.verdict(wall) is Verdict.NEW]
    for face in case.undrawn:
        ends, normal = case.built.ends[face], case.built.normals[face]
        seen = seen_m(views, ends, normal)
        if case.built.lengths[face] < MIN_LENGTH_M:
            continue
        standing = [wall for wall in new if _across_m(wall, ends, normal) < SAME_PLACE_M]
        length = sum(_shared_m(wall.ends, ends) for wall in standing)
        is_found = length >= 0.5 * max(seen, MIN_SEEN_M)
        longest = max(standing, key=lambda wall: _shared_m(wall.ends, ends), default=None)
        error = np.nan
        if longest is not None and is_found:
            error = float((longest.ends.mean(axis=0) - ends[0]) @ normal)
        yield Judged(
            seed,
            str(ends.round(1).tolist()),
            Verdict.NEW.value,
            Verdict.NEW.value if is_found else "not found",
            seen >= MIN_SEEN_M,
            error,
            np.nan if longest is None else longest.sigma_m,
        )


def _false_new(seed: int, case: Case, found: AsBuilt) -> Iterator[Judged]:
    """New walls that no wall stands for which the plan lacks."""
    built = case.built
    for wall in found.walls:
        if wall.face_idx >= 0:
            continue
        standing = [
            _shared_m(wall.ends, built.ends[face])
            for face in case.undrawn
            if _across_m(wall, built.ends[face], built.normals[face]) < SAME_PLACE_M
        ]
        if sum(standing) < 0.5 * wall.length_m:
            yield Judged(seed, _where(wall), "no wall that is new", Verdict.NEW.value, True)


def _across_m(wall: AsBuiltWall, ends: np.ndarray, normal: np.ndarray) -> float:
    """How far a wall stands from the line of a face; infinite where it looks another way."""
    if wall.normal @ normal < 0.98:
        return np.inf
    return abs(float((wall.ends.mean(axis=0) - ends[0]) @ normal))


def _shared_m(first: np.ndarray, second: np.ndarray) -> float:
    """Length over which two segments lie beside each other, m."""
    along = segments.directions(second[None])[0]
    low_1, high_1 = np.sort((first - second[0]) @ along)
    low_2, high_2 = np.sort((second - second[0]) @ along)
    return float(max(0.0, min(high_1, high_2) - max(low_1, low_2)))


def _where(wall: AsBuiltWall) -> str:
    return str(wall.ends.round(1).tolist())


def run(seed: int, folder: Path, drawn_sigma_m: float) -> list[Judged]:
    case = make_case(seed, folder, drawn_sigma_m)
    runtime = Runtime(workers=1, cache_dir=folder / "cache")
    result = planfit.refine(case.scan, case.plan, planfit.RefineOptions(), runtime)
    found = compare_as_built(result, AsBuiltOptions(tolerance_m=TOLERANCE_M))
    rows = judge(seed, case, true_views(case.scan, case.true_plan_from_cams), found)
    return [replace(row, is_refined=result.verdict.is_refined) for row in rows]


def tell(rows: Sequence[Judged]) -> None:
    seen = [row for row in rows if row.is_seen]
    for words, part in (
        ("walls seen", seen),
        ("of which the verdict is sure", [row for row in seen if row.is_sure]),
        ("of scans that were refined", [row for row in seen if row.is_refined]),
    ):
        right = sum(row.true == row.found for row in part)
        print(f"{words} {len(part)}, verdict right {right} ({right / max(len(part), 1):.1%})")
    unrefined = sorted({row.seed for row in rows if not row.is_refined})
    print(f"not refined, by planfit's own verdict: seeds {unrefined}")
    seen = [row for row in seen if row.is_refined]
    rows = [row for row in rows if row.is_refined]
    for true in dict.fromkeys(row.true for row in seen):
        own = [row for row in seen if row.true == true]
        words = {row.found: sum(r.found == row.found for r in own) for row in own}
        print(f"  {true}: {len(own)}; found: {words}")
    unseen = [row for row in rows if not row.is_seen]
    claims = [
        row for row in unseen if row.found not in (row.true, Verdict.NOT_SEEN.value, "not found")
    ]
    print(f"walls not seen {len(unseen)}, of which a verdict is wrong {len(claims)}")
    for name in (Verdict.AGREES.value, Verdict.MOVED.value, Verdict.NEW.value):
        own = [row for row in seen if row.true == name and np.isfinite(row.error_m)]
        if not own:
            continue
        error = np.abs([row.error_m for row in own])
        z = error / np.array([row.sigma_m for row in own])
        print(
            f"  offsets of {name}: {len(own)}, RMS {np.sqrt(np.mean(error**2)):.4f} m, worst "
            f"{error.max():.4f} m, within 2 cm {np.mean(error <= 0.02):.1%}, within 3 sigma "
            f"{np.mean(z <= 3):.1%}, RMS of error / sigma {np.sqrt(np.mean(z**2)):.2f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(21, 41, 2)))
    parser.add_argument(
        "--drawn-sigma-m",
        type=float,
        default=0.0,
        help="how far off every wall is drawn, one sigma",
    )
    parser.add_argument("--cache", type=Path, help="folder for images and stages, to be kept")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--each", action="store_true", help="list what is wrong, wall by wall")
    arguments = parser.parse_args()
    rows: list[Judged] = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in arguments.seeds:
            rows += run(seed, arguments.cache or Path(scratch), arguments.drawn_sigma_m)
            if arguments.json:
                arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    tell(rows)
    if arguments.each:
        for row in rows:
            if row.true != row.found and (row.is_seen or row.found != Verdict.NOT_SEEN.value):
                print(row)


if __name__ == "__main__":
    main()
