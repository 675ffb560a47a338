"""Openings as built: how many doors of wrong plans get the right verdict, how right their sides are.

    python benchmarks/openings.py [--seeds 1 3 5 ...] [--shut] [--cache FOLDER] [--json FILE] [--each]

Cases are those of `opening_cases.py`, each building twice: on a plan that is wrong about doors, and on the
right one, where nothing may be told to differ. Even seeds were for choosing rules; odd ones from 21 on are
for reporting. An opening is counted where the cameras saw it, by depth at the true poses. One that is told
where there is none counts as one more verdict, wrong. With `--shut`, every second door is shut, and what
closes an opening is asked for beside its verdict: a shut door, or wall.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from opening_cases import OpeningCase, TrueOpening, make_opening_case

import planfit
from planfit.as_built import AsBuilt, AsBuiltOpening, ClosedBy, OpeningVerdict, compare_as_built
from planfit.runtime import Runtime

SAME_PLACE_M = 0.6
"""Between the middles of an opening that is found and the true one."""


@dataclass(frozen=True)
class JudgedOpening:
    """An opening beside the truth."""

    seed: int
    is_spoilt: bool
    where: str
    true: str
    found: str
    is_seen: bool
    side_errors_m: tuple[float, ...] = ()
    """Of both sides along the wall, inwards; none where they were not seen."""
    side_sigmas_m: tuple[float, ...] = ()
    true_closed_by: str = ""
    closed_by: str = ""
    set_back_m: tuple[float, ...] = ()
    set_back_sigmas_m: tuple[float, ...] = ()
    is_refined: bool = True
    """Whether `planfit refine` says that the poses are to be used."""


def judge_openings(
    seed: int, is_spoilt: bool, case: OpeningCase, found: AsBuilt, is_refined: bool
) -> list[JudgedOpening]:
    """Every true opening beside what was found in its place, and what was found where there is none."""
    rows, left = [], list(found.openings)
    # Of a shut door that the plan lacks nothing can be told: it is wall to whoever looks.
    for true in (one for one in case.openings if one.is_drawn or one.is_open):
        middle = true.ends.mean(axis=0)
        near = [
            one for one in left if np.linalg.norm(one.ends.mean(axis=0) - middle) < SAME_PLACE_M
        ]
        left = [one for one in left if all(one is not other for other in near)]
        verdict = near[0].verdict.value if len(near) == 1 else f"{len(near)} found"
        errors, sigmas = _sides(near[0], true) if len(near) == 1 else ((), ())
        rows.append(
            JudgedOpening(
                seed,
                is_spoilt,
                str(middle.round(1).tolist()),
                _true_verdict(true).value,
                verdict,
                true.is_seen,
                errors,
                sigmas,
                "" if true.is_open else (ClosedBy.DOOR if true.is_door else ClosedBy.WALL).value,
                near[0].closed_by.value if verdict == OpeningVerdict.CLOSED.value else "",
                near[0].set_back_m if len(near) == 1 else (),
                near[0].set_back_sigmas_m if len(near) == 1 else (),
                is_refined,
            )
        )
    rows += [
        JudgedOpening(
            seed,
            is_spoilt,
            str(one.ends.mean(axis=0).round(1).tolist()),
            "no opening",
            one.verdict.value,
            True,
            is_refined=is_refined,
        )
        for one in left
    ]
    return rows


def _true_verdict(true: TrueOpening) -> OpeningVerdict:
    if not true.is_drawn:
        return OpeningVerdict.NEW
    return OpeningVerdict.OPEN if true.is_open else OpeningVerdict.CLOSED


def _sides(found: AsBuiltOpening, true: TrueOpening) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if not true.is_open or not np.isfinite(found.width_m):
        return (), ()
    along = (true.ends[1] - true.ends[0]) / np.linalg.norm(true.ends[1] - true.ends[0])
    at, true_at = found.built_ends @ along, true.ends @ along
    order = np.argsort(at)
    sigmas = np.array(found.edge_sigmas_m)[order]
    low, high = at[order] - true_at
    return (float(low), -float(high)), tuple(sigmas.tolist())


def run(seed: int, is_spoilt: bool, folder: Path, is_shut: bool = False) -> list[JudgedOpening]:
    case = make_opening_case(seed, folder, is_spoilt, is_shut)
    runtime = Runtime(workers=1, cache_dir=folder / "cache")
    result = planfit.refine(case.scan, case.plan, planfit.RefineOptions(), runtime)
    found = compare_as_built(result)
    return judge_openings(seed, is_spoilt, case, found, result.verdict.is_refined)


def tell(rows: Sequence[JudgedOpening]) -> None:
    unrefined = sorted({(row.seed, row.is_spoilt) for row in rows if not row.is_refined})
    print(f"not refined, by planfit's own verdict: {unrefined}")
    for words, is_spoilt in (("plans that are wrong", True), ("plans that are right", False)):
        seen = [row for row in rows if row.is_seen and row.is_spoilt == is_spoilt]
        right = sum(row.true == row.found for row in seen)
        print(
            f"{words}: openings seen {len(seen)}, right {right} ({right / max(len(seen), 1):.1%})"
        )
        for true in dict.fromkeys(row.true for row in seen):
            own = [row.found for row in seen if row.true == true]
            print(f"  {true}: {len(own)}; found: { ({one: own.count(one) for one in own}) }")
    for true in (ClosedBy.DOOR.value, ClosedBy.WALL.value):
        own = [row.closed_by for row in rows if row.true_closed_by == true and row.closed_by]
        print(f"closed by {true}: {len(own)}; told: { ({one: own.count(one) for one in own}) }")
    unseen = [row for row in rows if not row.is_seen]
    claims = [row for row in unseen if row.found not in (row.true, OpeningVerdict.NOT_SEEN.value)]
    print(f"openings not seen {len(unseen)}, of which a verdict is wrong {len(claims)}")
    errors = np.array([error for row in rows for error in row.side_errors_m])
    sigmas = np.array([sigma for row in rows for sigma in row.side_sigmas_m])
    widths = np.array([sum(row.side_errors_m) for row in rows if row.side_errors_m])
    z = errors / sigmas
    print(
        f"sides {len(errors)}: mean {errors.mean():+.3f} m (inwards), RMS "
        f"{np.sqrt(np.mean(errors**2)):.3f} m, worst {np.abs(errors).max():.3f} m, within 3 sigma "
        f"{np.mean(np.abs(z) <= 3):.1%}, RMS of error / sigma {np.sqrt(np.mean(z**2)):.2f}; "
        f"widths RMS {np.sqrt(np.mean(widths**2)):.3f} m"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(21, 41, 2)))
    parser.add_argument("--shut", action="store_true", help="every second door is shut")
    parser.add_argument("--cache", type=Path, help="folder for images and stages, to be kept")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--each", action="store_true", help="list what is wrong, one by one")
    arguments = parser.parse_args()
    rows: list[JudgedOpening] = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in arguments.seeds:
            for is_spoilt in (True, False):
                rows += run(seed, is_spoilt, arguments.cache or Path(scratch), arguments.shut)
            if arguments.json:
                arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    tell(rows)
    if arguments.each:
        for row in rows:
            if row.true != row.found and (row.is_seen or row.found != "not seen"):
                print(row)


if __name__ == "__main__":
    main()
