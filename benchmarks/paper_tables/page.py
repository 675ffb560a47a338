"""The page of results, made of a file of results: every number in its tables is computed here."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from paper_tables.paired import compare_paired
from paper_tables.published import METRICS as PUBLISHED_METRICS
from paper_tables.published import MS_A_STEP, PUBLISHED
from paper_tables.results import METRICS, Results
from paper_tables.scans import DESCENT_SET
from paper_tables.variants import (
    DESCENT_VARIANTS,
    PAPER_DESCENT,
    PAPER_TO_THE_LETTER,
    TRUE_POSES,
    UNADJUSTED,
)
from planfit.errors import OutputError

_NONE, _LETTER, _TRUTH = UNADJUSTED.key, PAPER_TO_THE_LETTER.key, TRUE_POSES.key
_TITLES = {
    "mme": "MME",
    "mpv": "MPV, cm²",
    "mom": "MOM, cm²",
    "nnd": "NND, cm",
    "nsd": "NSD, cm",
    "nsd_oriented": "oriented NSD, cm",
    "floor_plane_rms": "floor RMS, cm",
    "double_walls": "double walls, %",
    "ate": "ATE, cm",
    "ate_aligned": "aligned ATE, cm",
    "solve_s": "solve, s",
    "step_ms": "ms a step",
}
_FACTORS = {"ate": 100.0, "ate_aligned": 100.0}
_QUALITY = tuple(name for name in METRICS if name not in ("solve_s", "step_ms"))
_T1 = ("geometric", "geometric + floor", "geometric + walls", "all")
_T2 = (
    "nearest point",
    "iterative nearest wall",
    "geometric + walls",
    "fixed nearest wall, faces",
)
_T3 = ("all", "reprojection", "ray distance", "bounded, 3D points", "bounded, reprojection")


@dataclass(frozen=True)
class Claim:
    """A direction that the paper's tables show."""

    words: str
    better: str
    worse: str
    metric: str
    sets: tuple[str, ...] = ("redwood-like", "phone-like")


CLAIMS = (
    Claim("matches alone sharpen the map", "geometric", "none", "mme"),
    Claim("the floor term flattens the map", "geometric + floor", "geometric", "mpv"),
    Claim("the walls term flattens the map", "geometric + walls", "geometric", "mpv"),
    Claim("the walls term brings walls to the plan", "geometric + walls", "geometric", "nsd"),
    Claim("all terms together are the sharpest", "all", "geometric", "mme"),
    Claim(
        "all terms together are the nearest to the true scan",
        "all",
        "geometric",
        "nnd",
        ("redwood-like",),
    ),
    Claim("nearest point is nearest to the plan", "nearest point", "geometric + walls", "nsd"),
    Claim("fixed nearest wall has squarer rooms", "geometric + walls", "nearest point", "mom"),
    Claim("fixed nearest wall takes less time", "geometric + walls", "iterative nearest wall", "step_ms"),
    Claim("3D points are sharper than reprojection", "all", "reprojection", "mme"),
    Claim("3D points are sharper than ray distance", "all", "ray distance", "mme"),
    Claim("3D points are sharper than bounded adjustment", "all", "bounded, 3D points", "mme"),
)  # fmt: skip


def write_page(results: Results, path: Path) -> None:
    """Write the page as Markdown.

    Raises:
        OutputError: it cannot be written.
    """
    try:
        path.write_text(make_page(results), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error


def make_page(results: Results) -> str:
    """The page as Markdown."""
    sets = list(dict.fromkeys(m.set_name for m in results.measured if m.set_name != DESCENT_SET))
    parts = [_head(results, sets)]
    for set_name in sets:
        n = len({m.scan for m in results.measured if m.set_name == set_name})
        scans = f"{n} scans, mean ± standard deviation" if n > 1 else "one scan"
        parts += [
            f"## {set_name[0].upper()}{set_name[1:]}: {scans}",
            "### Default against the paper's cost, scan by scan",
            _against(results, set_name),
            "### T1: terms",
            _table(results, set_name, (_NONE, *_both(_T1), _LETTER, _TRUTH), _QUALITY),
            "### T2: wall strategies (no floor term)",
            _table(
                results,
                set_name,
                _both(_T2),
                ("mme", "mpv", "mom", "nsd", "ate", "step_ms"),
            ),
            "### T3: geometric terms",
            _table(
                results,
                set_name,
                _both(_T3),
                ("mme", "mpv", "mom", "nsd", "ate", "ate_aligned", "solve_s"),
            ),
        ]
    parts += ["## The paper's own descent", _descent(results)]
    parts += ["## Do the directions of the paper hold?", _directions(results), _WHY]
    return "\n\n".join(parts) + "\n"


def _descent(results: Results) -> str:
    """The paper's schedule to its end, beside Levenberg-Marquardt on the same cost."""
    if not results.metrics_of(PAPER_DESCENT.key):
        return (
            "Not measured here; `make tables` does so with PyTorch (`make .venv/installed-bench`)."
        )
    rows = tuple(variant.key for variant in (UNADJUSTED, *DESCENT_VARIANTS[2:], TRUE_POSES))
    words = (
        "One small scan (60 frames, two rooms), as the schedule of 20,000 steps and more is gone through at "
        "each alternation of association and solve. A step of Levenberg-Marquardt is a round of reweighting."
    )
    columns = (*_QUALITY, "solve_s", "step_ms")
    return words + "\n\n" + _table(results, DESCENT_SET, rows, columns)


def _both(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{preset}/{name}" for preset in ("paper", "default") for name in names)


def _head(results: Results, sets: list[str]) -> str:
    scans = {m.scan for m in results.measured if m.set_name != DESCENT_SET}
    refused = [m for m in results.measured if m.failed]
    lines = [
        "# Results: the paper's three tables",
        "",
        "Made by `make tables` out of `benchmarks/results/paper.json`; do not edit.",
        "",
        f"{len(scans)} scans in {len(sets)} sets, planfit {results.planfit}; {results.conditions}. "
        "Two sets are synthetic, as the paper's scans are not to be had: *redwood-like* is a "
        "structured-light camera with mild drift and the true plan, *phone-like* a time-of-flight camera "
        "whose tracking drifts and jumps, with a plan as an architect draws it (walls 2 cm off, 1 cm "
        "thicker on each side). *Real* is the ConSLAM scan: LiDAR depth, recorded poses that drifted. "
        "`paper` is the paper's cost (unsquared norms, its weights, no odometry "
        "term), solved by Levenberg-Marquardt; `default` is what `planfit refine` does. All are aligned "
        "to the plan by the same search, and use the same matches, floor and walls, but for the row "
        "that says otherwise. Lower is better everywhere. Numbers in brackets are those that the paper "
        "printed for its own scans. *True poses* show what the noise of depth leaves of each metric: below "
        "that, poses are fitted to the noise. [Each metric](metrics.md) is defined apart; maps are made of "
        "every second frame, a point a 5 cm voxel, radius 0.2 m.",
    ]
    if refused:
        lines += ["", f"{len(refused)} runs refused: "]
        lines += [f"- {m.variant} on {m.scan}: {m.failed}" for m in refused]
    return "\n".join(lines)


def _values(results: Results, set_name: str, variant: str, metric: str) -> np.ndarray:
    by_scan = results.metrics_of(variant, set_name)
    found = [metrics[metric] for metrics in by_scan.values() if metric in metrics]
    return np.array(found) * _FACTORS.get(metric, 1.0)


def _table(
    results: Results, set_name: str, variants: tuple[str, ...], metrics: tuple[str, ...]
) -> str:
    shown = [f for f in metrics if any(len(_values(results, set_name, v, f)) for v in variants)]
    lines = ["| | " + " | ".join(_TITLES[f] for f in shown) + " |", "|---" * (len(shown) + 1) + "|"]
    for variant in variants:
        cells = []
        for metric in shown:
            values = _values(results, set_name, variant, metric)
            cell = _amount(values)
            cells.append(f"{cell}{_published(set_name, variant, metric)}")
        lines.append(f"| {_name(variant)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _name(variant: str) -> str:
    preset, name = variant.split("/", 1)
    if name == "none":
        return "none: aligned as a whole"
    if variant == _TRUTH:
        return name
    return f"{preset}: {name}"


def _amount(values: np.ndarray) -> str:
    if len(values) == 0:
        return "-"
    mean = float(values.mean())
    digits = 0 if abs(mean) >= 100 else 1 if abs(mean) >= 20 else 2
    if len(values) == 1:
        return f"{mean:.{digits}f}"
    return f"{mean:.{digits}f} ± {float(values.std(ddof=1)):.{digits}f}"


def _published(set_name: str, variant: str, metric: str) -> str:
    preset, name = variant.split("/", 1)
    if preset == "default" and name != "none":
        return ""
    if metric == "step_ms" and set_name == "redwood-like" and name in MS_A_STEP:
        return f" ({MS_A_STEP[name]:.1f})"
    row = PUBLISHED.get(set_name, {}).get(name)
    value = row[PUBLISHED_METRICS.index(metric)] if row and metric in PUBLISHED_METRICS else None
    return "" if value is None else f" ({value:.2f})"


def _against(results: Results, set_name: str) -> str:
    a, b = (results.metrics_of(f"{preset}/all", set_name) for preset in ("paper", "default"))
    both, truth = a.keys() & b.keys(), results.metrics_of(_TRUTH, set_name)
    if not both:
        return "Not measured."
    lines = [
        "| | true poses | paper | default | mean difference | its standard deviation | default better |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in compare_paired(a, b):
        if row.name not in _QUALITY:
            continue
        factor = _FACTORS.get(row.name, 1.0)
        sigma = "-" if np.isnan(row.sigma) else f"{factor * row.sigma:.3f}"
        true = [truth[scan][row.name] for scan in both if row.name in truth.get(scan, {})]
        least = f"{factor * np.mean(true):.3f}" if len(true) == row.n else "-"
        lines.append(
            f"| {_TITLES[row.name]} | {least} | {factor * row.mean_a:.3f} | {factor * row.mean_b:.3f} | "
            f"{factor * row.mean_difference:+.3f} | {sigma} | {row.wins} of {row.n} |"
        )
    return "\n".join(lines)


def _directions(results: Results) -> str:
    lines = [
        "With the `paper` preset, scan by scan. A direction holds where the better one wins on more than "
        "half of the scans and in the mean.",
        "",
        "| the paper finds | set | mean difference | wins | holds |",
        "|---|---|---|---|---|",
    ]
    for claim in CLAIMS:
        for set_name in claim.sets:
            worse = results.metrics_of(_key(claim.worse), set_name)
            better = results.metrics_of(_key(claim.better), set_name)
            if not set(worse) & set(better):
                continue
            rows = [r for r in compare_paired(worse, better) if r.name == claim.metric]
            for row in rows:
                holds = row.mean_difference < 0 and row.wins > row.n / 2
                factor = _FACTORS.get(row.name, 1.0)
                lines.append(
                    f"| {claim.words} ({_TITLES[claim.metric]}) | {set_name} | "
                    f"{factor * row.mean_difference:+.3f} | {row.wins} of {row.n} | "
                    f"{'yes' if holds else 'no'} |"
                )
    return "\n".join(lines)


def _key(name: str) -> str:
    return _NONE if name == "none" else f"paper/{name}"


_WHY = """\
## What to make of it

- The scans are synthetic and their colour images sharp, so the matches are many and exact: they carry more
  of the result here than in the paper, and what floor and walls add to the sharpness of the map is small.
  What only they can add, the pose on the plan, shows in NSD and ATE, which the paper could not measure.
- Reprojection does better here than in the paper. It looks at pixels alone, and pixels are exact here where
  depth is not; keypoints were rounded to whole pixels in the code that the paper's authors published.
- Nearest point leaves wall points that drift has brought nearer to a wrong face where they are, in a minimum
  of its own; it is slow to leave, and so ends further from the plan than the fixed nearest wall does.
- The floor's RMS is lower with the paper's cost, whose weight of the floor is ten times that of the matches:
  it flattens what the depth camera bends, to below what true poses leave. So does `--adjust.floor.weight 40`,
  and it is dearly paid where the floor is not flat or its points are not all floor: ConSLAM then ends as far
  off as it does with the paper's cost.
- Other metrics fall below those of true poses as well, NSD for one: walls are moved to a plan that is drawn
  2 cm off. The nearer to the true poses the better is what ATE alone says.
- Levenberg-Marquardt ends in the minimum of the paper's cost. The paper's gradient descent comes there on a
  small scan, but on 250 frames with a metre of drift it is still above after its whole schedule (see `make
  bench`), so that its differences between terms are also those of how fast each goes down.
- The paper's cost takes unsquared norms of metres: a match is worth the same at 1 m and at 5 m, where depth
  is 25 times less sure. The default weighs each by its sigma.
"""
