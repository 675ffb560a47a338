"""Several scans of one building on one screen: each alone, placed against each other, solved as one."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from planfit.errors import OptionError
from planfit.findings import Finding
from planfit.floorplan import Floorplan
from planfit.matching.between_scans import retrieve_between, verify_between
from planfit.matching.pairs import distinct_views
from planfit.pipeline.given import require_given, running
from planfit.pipeline.observations import Observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.refine import refine
from planfit.pipeline.together.joined import (
    JoinedScans,
    ScansTogether,
    join_observed,
    offsets_of,
    see_together,
)
from planfit.pipeline.together.observed import ObservedScan, observe_scan
from planfit.pipeline.together.placing import (
    Placing,
    find_links,
    group_by_links,
    place_groups,
)
from planfit.pipeline.together.result import RefinedScan, TogetherResult, result_of_scan
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.scan.joined import short_names

BETWEEN = "matching between scans"
NEVER = 1e9
"""Sigmas that no departure of a sensor reaches."""


def refine_together(
    scans: Sequence[Scan],
    floorplan: Floorplan | None,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    *,
    cache: str | Path | None = None,
    progress: bool = True,
) -> TogetherResult:
    """Refine the poses of several scans of one storey together, in one frame of reference.

    Scans are placed against each other by places that both show, and where none are, by the plan. One that
    neither places is left out and named. Each may come from another device, day and world, and have another
    format and image size.

    Args:
        scans: two or more; `Scan.name` tells them apart.
        floorplan: of the storey, as `planfit.refine` takes it. None: scans have to show the same places.
        options: those of `planfit.refine`; what they say of where the scan is, is said of the first one.
        runtime, cache, progress: as `planfit.refine` takes them.

    Raises:
        ScanError: a file of a scan cannot be used, a scan is given twice, or walks through several storeys.
        FloorplanError: as `planfit.refine`.
        OptionError: an option cannot work, or there are fewer than two scans.
    """
    if len(scans) < 2:
        raise OptionError(
            f"refine_together: expected two scans or more, found {len(scans)}; for one, use planfit.refine"
        )
    for scan in scans:
        require_given(scan, floorplan, options, runtime)
    with running(runtime, cache, progress) as runs:
        return _refine_together(scans, floorplan, options or RefineOptions(), runs)


def _refine_together(
    scans: Sequence[Scan], floorplan: Floorplan | None, chosen: RefineOptions, runtime: Runtime
) -> TogetherResult:
    timer, names = StageTimer(runtime), short_names(scans)
    observed = [
        observe_scan(name, scan, chosen, runtime, timer)
        for name, scan in zip(names, scans, strict=True)
    ]
    joined, placing = _join(observed, floorplan, chosen, runtime, timer)
    placed = [observed[place.scan] for place in placing.places]
    seen = _with_sensors_settled(joined.observations, placed)
    together = refine(joined.scan, floorplan, chosen, runtime, seen)
    stages = (*timer.seconds, *together.seconds_by_stage)
    seconds = {
        stage: timer.seconds.get(stage, 0.0) + together.seconds_by_stage.get(stage, 0.0)
        for stage in dict.fromkeys(stages)
    }
    frames = tuple(
        replace(own, placed_by=place.by)
        for own, place in zip(joined.frames, placing.places, strict=True)
    )
    together = replace(together, scans=frames, seconds_by_stage=seconds)
    refined = [
        RefinedScan(name, scan, None, placing.reasons.get(k, ()), None)
        for k, (name, scan) in enumerate(zip(names, scans, strict=True))
    ]
    for k, place in enumerate(placing.places):
        result = result_of_scan(observed[place.scan], k, joined, together, chosen)
        refined[place.scan] = replace(refined[place.scan], placed_by=place.by, result=result)
    together = replace(together, findings=_findings(refined, together.findings))
    is_between = np.diff(_number_of_scan(joined)[joined.observations.matches.pairs], axis=1) != 0
    return TogetherResult(together, tuple(refined), int(is_between.sum()))


def _join(
    observed: Sequence[ObservedScan],
    floorplan: Floorplan | None,
    options: RefineOptions,
    runtime: Runtime,
    timer: StageTimer,
) -> tuple[JoinedScans, Placing]:
    """All scans that have a place as one, with the matches between them."""
    with timer.stage(BETWEEN):
        seen = see_together(observed, options)
        pairs = retrieve_between(seen, _views(observed))
        verified = verify_between(seen, pairs, None, options.matching, runtime)
        together = ScansTogether(tuple(observed), seen, verified, options, runtime)
        groups = group_by_links(len(observed), find_links(together))
    placing = place_groups(together, groups, floorplan, timer)
    placed = together.of([place.scan for place in placing.places])
    joined_from_levels = [place.joined_from_level for place in placing.places]
    between = None
    if len(placed.observed) > 1:
        with timer.stage(BETWEEN):
            between = placed.match(joined_from_levels)
    return join_observed(placed.observed, joined_from_levels, between), placing


def _views(observed: Sequence[ObservedScan]) -> np.ndarray:
    """Keyframes (v,) that stand for their like, numbered over all scans, increasing."""
    found = []
    for each, first in zip(observed, offsets_of(observed)[:-1], strict=True):
        prepared = each.prepared
        walked_m = prepared.measurements.odometry.walked_m
        sharpness = np.array([k.sharpness for k in each.keypoints.keypoints], dtype=float)
        views = distinct_views(prepared.level_from_keys, walked_m, sharpness)
        found.append(views.frame_idx + first)
    return np.concatenate(found)


def _with_sensors_settled(seen: Observations, placed: Sequence[ObservedScan]) -> Observations:
    """What the joint solve sees: where sensors were corrected one by one, no common one is sought.

    How unsure sensors are still counts in the predicted error.
    """
    if all(each.calibration.sensor.is_nominal for each in placed):
        return seen
    return replace(seen, priors=replace(seen.priors, min_sigmas=NEVER))


def _findings(refined: Sequence[RefinedScan], of_all: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Scans without a place first, then what is said of single scans, by name, and of all."""
    left_out = [each.finding for each in refined if each.result is None]
    own = [
        found.about(each.name)
        for each in refined
        if each.result is not None
        for found in each.result.findings
    ]
    found: list[Finding] = []
    for each in (*left_out, *own, *of_all):
        if each not in found:  # breaks of the joined walk are those of its scans
            found.append(each)
    return tuple(found)


def _number_of_scan(joined: JoinedScans) -> np.ndarray:
    """Of each frame (n,)."""
    sizes = [own.last - own.first + 1 for own in joined.frames]
    return np.repeat(np.arange(len(sizes)), sizes)
