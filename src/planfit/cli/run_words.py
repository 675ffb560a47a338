"""What is said of a finished run: what changed, the warnings, the verdict, where the rest is."""

from pathlib import Path

from planfit.adjust.observability import frame_ranges
from planfit.cli.console import err, note, out, table, tell_scan
from planfit.cli.survey import tell_survey
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.on_plan import Storeys
from planfit.pipeline.result import RefineResult
from planfit.pipeline.together import TogetherResult
from planfit.pipeline.verdict import Outcome, Verdict
from planfit.scan import Scan


def summarise(
    folder: Path,
    scan: Scan,
    floorplan: Floorplan | dict[int, Floorplan] | None,
    result: RefineResult,
    seconds: float,
) -> None:
    """One screen: what changed, the warnings, where the rest is."""
    rows = []
    for check in result.checks:
        rows.append([check.name, *(_amount(v, check.unit) for v in (check.before, check.after))])
    name = result.floorplan.name if result.floorplan else "none: loops, floor and ceilings alone"
    out.print(f"\nscan {scan.name}\nplan {name}\n", soft_wrap=True)
    out.print(table("", ["", "before", "after"], rows))
    matches, adjustment = result.matches, result.adjustment
    found = "" if floorplan is None else (
        f"{adjustment.association.n_associated} of {len(result.structure.walls)} wall patches on the plan, "
    )  # fmt: skip
    n_keyframes = len(result.solved_frame_idx)
    keys = f" ({n_keyframes} keyframes)" if n_keyframes < len(scan) else ""
    out.print(
        f"\n{len(scan)} frames{keys}, {matches.n_matches} matches in {len(matches.pairs)} pairs, "
        f"{found}labels from {result.structure.back_end}"
    )
    if len(result.surfaces):
        out.print(result.surfaces.sentence)
    _tell_seconds(result, seconds)
    alignment = result.alignment
    if result.storeys is not None:
        _tell_storeys(result.storeys)
    if alignment is not None and isinstance(floorplan, Floorplan) and not floorplan.is_metric:
        out.print(
            f"the plan's unit was found to be {alignment.metres_per_unit:.5g} m, within "
            f"{alignment.scale_sigma:.2%} (one standard deviation)"
        )
    if result.survey is not None:
        tell_survey(result.survey)
    _tell_end(folder, scan, result)


def summarise_together(folder: Path, result: TogetherResult, seconds: float) -> None:
    """One screen: the scans and their places, the warnings, where the rest is."""
    together, rows = result.together, []
    for each in result.scans:
        outcome, error = "", ""
        if each.result is not None:
            outcome = each.result.verdict.outcome.value
            error = f"{each.result.evidence.predicted_rms_m:.2f} m"
        rows.append([each.name, str(len(each.scan)), each.placed_by or "no place", outcome, error])
    name = together.floorplan.name if together.floorplan else "none: the scans alone"
    out.print(f"\nplan {name}\n", soft_wrap=True)
    heads = ["frames", "placed by", "verdict", "expected error"]
    out.print(table("", ["scan", *heads], rows))
    out.print(
        f"\n{len(together.plan_from_cams)} frames with a place, {together.matches.n_matches} matches in "
        f"{len(together.matches.pairs)} pairs, {result.between_pairs} of them between scans"
    )
    _tell_seconds(together, seconds)
    _tell_end(folder, None if together.made_of is None else together.made_of.scan, together)


def _tell_seconds(result: RefineResult, seconds: float) -> None:
    """Seconds in all, and of each stage."""
    stages = ", ".join(f"{name} {s:.1f}" for name, s in result.seconds_by_stage.items() if s > 0.05)
    out.print(f"{seconds:.1f} s: {stages}")


def _tell_end(folder: Path, scan: Scan | None, result: RefineResult) -> None:
    """Warnings, verdict, where the report is."""
    if scan is not None:
        tell_scan(scan)
    if result.by_hand is not None:
        out.print(result.by_hand.sentence)
    for warning in result.warnings:
        note(warning)
    tell_verdict(result.verdict)
    out.print(f"report: {folder / 'report.html'}", soft_wrap=True)


def _tell_storeys(storeys: Storeys) -> None:
    """A line a storey: its floor, its frames, and where its plan lies."""
    for storey in reversed(storeys.walked):
        lies = ""
        if storey.own is not None:
            x, y, _ = storey.own.plan_from_own[:3, 3]
            yaw_deg = se3.wrapped_deg(float(se3.yaw_of(storey.own.plan_from_own)))
            lies = f", its plan turned by {yaw_deg:.2f} deg and moved by ({x:.2f}, {y:.2f}) m"
            if storey.own.shares_axes:
                lies = ", its plan as drawn, in shared axes"
        out.print(
            f"{storey.name}: floor at {storey.floor_m:.2f} m, frames {frame_ranges(storey.frames)}{lies}",
            soft_wrap=True,
        )


def tell_verdict(verdict: Verdict) -> None:
    """The outcome, why, which frames are less sure, and what to do."""
    color = {Outcome.REFINED: "green", Outcome.IMPROVED: "yellow", Outcome.NO_BETTER: "red"}
    out.print(f"\n{verdict.headline}", style=color[verdict.outcome])
    for reason in verdict.reasons:
        if reason not in verdict.headline:
            out.print(f"  {reason}")
    for reservation in verdict.reservations:
        if reservation.words not in verdict.headline:
            out.print(f"  {reservation.words}; {reservation.advice}")
    if not verdict.is_refined:
        err.print(f"planfit: {verdict.outcome.value}: {verdict.advice}", soft_wrap=True)


def _amount(value: float, unit: str) -> str:
    return f"{value:.0%}" if unit == "share" else f"{value:.3g} {unit}"
