"""Corrections by hand at work: what they come to in the images, and what they leave of the observations."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.corrections import Contradiction, Correction, Corrections
from planfit.errors import OptionError, ScanError
from planfit.findings import Finding, SurveyKind
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching import (
    HandLoop,
    HandMatches,
    HandVerdicts,
    NeighbourMotions,
    PickedPoint,
    SurfaceMotions,
    carried,
    match_by_hand,
    no_hand_matches,
)
from planfit.matching.by_hand import AGREES_M
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime, short_repr
from planfit.scan import Scan
from planfit.scan.statistics import lift_pixel


@dataclass(frozen=True)
class HandSeen:
    """What the images say of corrections, for n frames."""

    corrections: Corrections
    is_excluded: Bool[np.ndarray, " n"]
    matches: HandMatches
    place_points_cam: tuple[Float[np.ndarray, "3"] | None, ...]
    """m, camera frame: the point of each place that was picked in an image."""

    __repr__ = short_repr

    def allows(self, pairs: Int[np.ndarray, "p 2"]) -> Bool[np.ndarray, " p"]:
        """Which pairs of frames may be used."""
        return ~(self.is_excluded[pairs].any(axis=1) | self.corrections.are_deleted(pairs))

    def verdicts(self, frame_idx: Int[np.ndarray, " k"], world_from_cams: Poses) -> HandVerdicts:
        """What matching among some frames is told, given the believed poses of all."""
        certain = carried(self.matches.relative_poses, frame_idx, world_from_cams)
        return HandVerdicts(self.is_excluded, self.corrections.are_deleted, certain, frame_idx)


def look_by_hand(
    scan: Scan, corrections: Corrections, options: RefineOptions, runtime: Runtime
) -> HandSeen | None:
    """Open the frames that corrections name; None where there are no corrections.

    Raises:
        OptionError: a frame is not there, or a pixel shows nothing; the message names the file and the entry.
    """
    if not corrections.entries:
        return None
    corrections.require_frames(len(scan))
    points = tuple(
        None
        if place.frame is None or place.pixel is None
        else _lifted(scan, corrections, place, place.frame, place.pixel)
        for place in corrections.places
    )
    for loop in corrections.added:
        for frame, uv in zip(loop.frames, loop.pixels or (), strict=False):
            _lifted(
                scan, corrections, loop, frame, uv
            )  # refused here, where file and entry are known
    loops = tuple(
        HandLoop(each.frames, None if each.pixels is None else PickedPoint(each.pixels))
        for each in corrections.added
    )
    found = match_by_hand(scan, loops, options.matching, runtime) if loops else no_hand_matches()
    return HandSeen(corrections, corrections.is_excluded(len(scan)), found, points)


def _lifted(
    scan: Scan, corrections: Corrections, entry: Correction, frame: int, uv: tuple[float, float]
) -> Float[np.ndarray, "3"]:
    try:
        return lift_pixel(scan, frame, uv)
    except ScanError as error:
        raise OptionError(f"{corrections.name}: {entry.kind} {entry.number}: {error}") from error


def allowed_neighbours(known: NeighbourMotions, verdicts: HandVerdicts | None) -> NeighbourMotions:
    """Without those that a person ruled out; what was tried stays so, and is not tried again."""
    if verdicts is None:
        return known
    return replace(known, verified=verdicts.kept(known.verified))


def allowed_surfaces(known: SurfaceMotions, verdicts: HandVerdicts | None) -> SurfaceMotions:
    """Without those that a person ruled out."""
    if verdicts is None:
        return known
    return replace(known, neighbours=known.neighbours[verdicts.allows(known.neighbours.pairs)])


def contradictions_among(corrections: Corrections) -> tuple[Contradiction, ...]:
    """Corrections that cannot be right together, whatever the scan says."""
    found: list[Contradiction] = []
    excluded = corrections.is_excluded(1 + corrections.last_frame)
    for loop in corrections.added:
        pair = np.array([loop.frames])
        if corrections.are_deleted(pair)[0]:
            found.append(Contradiction(loop, Finding(SurveyKind.LOOP_DELETED), prevents=True))
        elif excluded[list(loop.frames)].any():
            excluding = Finding(SurveyKind.FRAME_OF_LOOP_EXCLUDED)
            found.append(Contradiction(loop, excluding, prevents=True))
    for place in corrections.places:
        if place.frame is not None and excluded[place.frame]:
            excluding = Finding(SurveyKind.FRAME_EXCLUDED)
            found.append(Contradiction(place, excluding, prevents=True))
    erased = {frozenset(wall.ends) for wall in corrections.walls("erase_wall")}
    for kind in ("exclude_wall", "draw_wall"):
        for wall in corrections.walls(kind):
            if frozenset(wall.ends) in erased:
                found.append(Contradiction(wall, Finding(SurveyKind.WALL_ERASED), prevents=True))
    return tuple(found)


def contradictions_of_images(seen: HandSeen) -> tuple[Contradiction, ...]:
    """Loops of which the images of their frames say otherwise, or nothing."""
    found = []
    rows = zip(seen.corrections.added, seen.matches.gaps_m, seen.matches.has_matches, strict=True)
    for loop, gap_m, has_matches in rows:
        if not has_matches:
            unmatched = Finding(SurveyKind.IMAGES_DO_NOT_MATCH)
            found.append(Contradiction(loop, unmatched, prevents=True))
        elif gap_m is not None and gap_m > AGREES_M:
            apart = Finding(SurveyKind.PICKED_POINTS_APART, {"gap_m": gap_m})
            found.append(Contradiction(loop, apart))
    return tuple(found)


def with_interpolated(
    world_from_cams: Poses, times: Float[np.ndarray, " n"], is_excluded: Bool[np.ndarray, " n"]
) -> Poses:
    """Poses whose excluded ones are read between the nearest others in time; before the first and after the
    last of these, they are as they were."""
    kept = np.flatnonzero(~is_excluded)
    inside = np.flatnonzero(is_excluded)
    inside = inside[(inside > kept[0]) & (inside < kept[-1])]
    after = np.searchsorted(kept, inside)
    a, b = kept[after - 1], kept[after]
    span = times[b] - times[a]
    by_number = (inside - a) / (b - a)
    share = np.where(
        span > 0, (times[inside] - times[a]) / np.where(span > 0, span, 1.0), by_number
    )
    poses = world_from_cams.copy()
    step = se3.difference(world_from_cams[b], world_from_cams[a])
    poses[inside] = se3.retract(world_from_cams[a], share[:, None] * step)
    return poses
