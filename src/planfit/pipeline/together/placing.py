"""Where the scans stand: those that show the same places by these, groups of them by the plan."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from planfit.alignment.selection import MIN_SCORE
from planfit.errors import FloorplanError
from planfit.findings import Finding, SurveyKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.prepare import prepare
from planfit.pipeline.together.joined import ScansTogether, join_observed, offsets_of
from planfit.pipeline.together.votes import Link, link_by_votes
from planfit.runtime import StageTimer

PlacedBy = Literal["the first", "places seen in both", "the plan"]
"""How the place of a scan among the others was found."""
UNLINKED = Finding(SurveyKind.SCAN_UNLINKED)


@dataclass(frozen=True)
class Group:
    """Scans that places seen in both link to each other."""

    members: tuple[int, ...]
    """Numbers of the scans, increasing."""
    root_from_levels: tuple[Float[np.ndarray, "4 4"], ...]
    """From the level frame of each to that of the first of them."""


@dataclass(frozen=True)
class Place:
    """Where a scan stands among those that are placed."""

    scan: int
    joined_from_level: Float[np.ndarray, "4 4"]
    """To the level frame of the first scan that is placed."""
    by: PlacedBy


@dataclass(frozen=True)
class Placing:
    """Which scans are placed, and why the others are not."""

    places: tuple[Place, ...]
    """In the order of the scans."""
    reasons: dict[int, tuple[Finding, ...]]
    """By the number of each scan without a place."""


def find_links(together: ScansTogether) -> list[Link]:
    """How each two scans stand to each other, where they show the same places; the surest first."""
    observed, seen, verified = together.observed, together.seen, together.verified
    offsets, links = offsets_of(observed), []
    pairs = verified.relative_poses.pairs
    of_first, of_second = seen.of_scan[pairs[:, 0]], seen.of_scan[pairs[:, 1]]
    for a in range(len(observed)):
        for b in range(a + 1, len(observed)):
            of = np.flatnonzero((of_first == a) & (of_second == b))
            found = verified.relative_poses[of]
            found = replace(found, pairs=found.pairs - offsets[[a, b]])
            poses = (observed[a].prepared.level_from_keys, observed[b].prepared.level_from_keys)
            has_floors = all(observed[k].observations.structure.has_floor for k in (a, b))
            link = link_by_votes(a, b, poses, found, has_floors)
            if link is not None:
                links.append(link)
    return sorted(links, key=lambda link: -link.weight)


def group_by_links(n_scans: int, links: Sequence[Link]) -> list[Group]:
    """Scans that are linked, over others too; by their first member."""
    group = list(range(n_scans))
    group_from_levels = [np.eye(4)] * n_scans
    for link in links:  # the surest first: a maximum spanning tree
        one, other = group[link.first], group[link.second]
        if one == other:
            continue
        one_from_other = (
            group_from_levels[link.first]
            @ link.first_from_second
            @ se3.inverse(group_from_levels[link.second])
        )
        for k in range(n_scans):
            if group[k] == other:
                group[k], group_from_levels[k] = one, one_from_other @ group_from_levels[k]
    groups = []
    for own in dict.fromkeys(group):
        members = tuple(k for k in range(n_scans) if group[k] == own)
        root = se3.inverse(group_from_levels[members[0]])
        groups.append(Group(members, tuple(root @ group_from_levels[k] for k in members)))
    return groups


def place_groups(
    together: ScansTogether,
    groups: Sequence[Group],
    floorplan: Floorplan | None,
    timer: StageTimer,
) -> Placing:
    """Bring all groups into one frame: without a plan, the largest one is all that has a place.

    Args:
        together: the scans.
        floorplan: as given; of one storey.
    """
    scans = [each.scan for each in together.observed]
    by_size = sorted(groups, key=lambda g: -sum(len(scans[k]) for k in g.members))
    if len(groups) == 1:
        return _placed([(by_size[0], np.eye(4))], {})
    if floorplan is None:
        others = {k: (UNLINKED,) for group in by_size[1:] for k in group.members}
        return _placed([(by_size[0], np.eye(4))], others)
    sure: list[tuple[Group, Float[np.ndarray, "4 4"]]] = []
    unsure: dict[int, tuple[Finding, ...]] = {}
    plan = floorplan
    for group in by_size:
        found = _align_group(together, group, plan, timer)
        doubt = _doubt(found)
        if doubt is not None:
            unsure |= dict.fromkeys(group.members, (UNLINKED, doubt))
            continue
        assert isinstance(found, ScanOnPlan)
        assert found.floorplan is not None
        sure.append((group, found.plan_from_level))
        plan = found.floorplan  # in metres, from the first that tells them
    if not sure:
        for k in by_size[0].members:
            del unsure[k]
        return _placed([(by_size[0], np.eye(4))], unsure)
    return _placed(sure, unsure)


def _placed(
    groups: Sequence[tuple[Group, Float[np.ndarray, "4 4"]]],
    reasons: dict[int, tuple[Finding, ...]],
) -> Placing:
    """All members of groups with a place, given common_from_root of each."""
    common = {
        k: common_from_root @ root_from_level
        for group, common_from_root in groups
        for k, root_from_level in zip(group.members, group.root_from_levels, strict=True)
    }
    first = min(common)
    linked = next(group for group, _ in groups if first in group.members).members
    joined_from_common = se3.inverse(common[first])
    places = [
        Place(
            k,
            joined_from_common @ common[k],
            "the first" if k == first else "places seen in both" if k in linked else "the plan",
        )
        for k in sorted(common)
    ]
    return Placing(tuple(places), reasons)


def _align_group(
    together: ScansTogether, group: Group, plan: Floorplan, timer: StageTimer
) -> ScanOnPlan | FloorplanError:
    """A group aligned as one scan."""
    own, options = together.of(group.members), together.options
    if 0 not in group.members:  # what is said of where the scan is, is said of the first one
        chosen = replace(options.align, control_points=(), start="", candidate=1)
        options = replace(options, align=chosen)
    first = own.observed[0]
    scan, prepared = first.corrected_scan, first.prepared
    if len(own.observed) > 1:
        between = own.match(group.root_from_levels)
        joined = join_observed(own.observed, group.root_from_levels, between)
        scan, prepared = joined.scan, prepare(joined.scan, joined.observations, options, timer)
    try:
        return align_to_plan(scan, prepared, plan, options, timer)
    except FloorplanError as error:  # another group may tell the unit, or it is told when all fail
        return error


def _doubt(found: ScanOnPlan | FloorplanError) -> Finding | None:
    """Why the plan does not say where a group is; None where it does."""
    if isinstance(found, FloorplanError):
        return Finding(SurveyKind.SCAN_OFF_PLAN, {"error": str(found)})
    if found.alignment is None:
        return Finding(SurveyKind.SCAN_WITHOUT_WALLS)
    if found.alignment.score < MIN_SCORE:
        return Finding(SurveyKind.SCAN_ON_OTHER_PLAN, {"wall_share": found.alignment.score})
    if not found.alignment.is_sure:
        return Finding(SurveyKind.SCAN_IN_MANY_PLACES)
    return None
