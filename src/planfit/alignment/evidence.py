"""Evidence against a wrong plan that the score does not hold: what the camera walked and saw through."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from planfit.alignment.refine import (
    OBSERVATION_M,
    AlignmentHypothesis,
    rotation_2d,
    scaled_faces,
)
from planfit.alignment.search import CELL_M, free_space
from planfit.alignment.visibility import crosses_face
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.findings import Finding, PlanKind
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import nearest_beside
from planfit.geometry import segments
from planfit.runtime import short_repr

MAX_SEEN_THROUGH, MIN_JUDGED_M = 0.5, 10.0
"""Where more of the plan's wall was seen through than was seen, it stands elsewhere. Measured: right plans 0
to 0.23; another building's, at the place that fits best, 0.05 to 0.8."""
MAX_STEP_M = 2.0
"""Further apart, two views do not say which way the camera took between them."""
WALKED_FREELY = 0.1
"""Share of the way that may cross faces: plans draw doors shut, and drift cuts corners. Measured: 0 to 0.07
at right places."""
MIN_OFFSET_M, OFFSET_SIGMAS, OFFSET_REACH_M = 0.03, 4.0, 0.35
"""Walls that stand in front of their lines by less than the first are on them; the offset must be so many of
its standard deviations; walls further from a line than the last belong to none."""
MAX_OFFSET_M = 0.05
"""Walls this far in front of their lines leave poses a decimetre off: 0.12 to 0.14 m measured at 0.1 m."""
MIN_ON_LINES = 0.5
"""Share of the wall near the plan that must lie on lines of unknown side before these are asked about."""
COVERED_M = 0.3
"""Scanned wall within this of a face that looks the same way is of it."""


@dataclass(frozen=True)
class PlanEvidence:
    """How far what the camera walked and saw agrees with the faces of the plan."""

    walked_through_share: float
    """Of the way between neighbouring views, by length: steps that cross a face."""
    seen_through_share: float
    """Of the face that the scan judged, by length: what stands in space that lines of sight passed. The
    rest was seen as wall."""
    judged_m: float
    """Metres of face that the scan judged."""
    line_offset_m: float = 0.0
    """How far scanned walls stand in front of lines whose free side is not known, on either side: half a
    thickness where walls are drawn by their centre lines. 0 where not surely more than `MIN_OFFSET_M`."""

    __repr__ = short_repr

    @property
    def is_seen_through(self) -> bool:
        """Whether the camera saw through more of the plan's wall than it saw as wall."""
        return self.seen_through_share > MAX_SEEN_THROUGH and self.judged_m >= MIN_JUDGED_M


NOTHING_JUDGED = PlanEvidence(0.0, 0.0, 0.0)
"""Where nothing is known of where walls were seen from."""


def plan_evidence(
    walls: WallSamples, floorplan: Floorplan, hypothesis: AlignmentHypothesis
) -> PlanEvidence:
    """The plan's faces against the camera's way and lines of sight, at one alignment.

    Args:
        walls: samples in the order they were seen, level frame; without `seen_from` nothing is judged.
        floorplan: in its own unit.
    """
    if walls.seen_from is None or len(walls.xy) == 0:
        return replace(NOTHING_JUDGED, line_offset_m=line_offset_m(walls, floorplan, hypothesis))
    walked = walked_through_share(walls, floorplan, hypothesis)
    ends, normals = scaled_faces(floorplan, np.array(hypothesis.scale_xy))
    rotation, translation = rotation_2d(hypothesis.yaw), hypothesis.translation
    walls = thin(walls)
    xy = walls.xy @ rotation.T + translation
    free_xy = free_space(walls, CELL_M) @ rotation.T + translation
    samples, face = segments.sample(ends, CELL_M)
    is_wall = _is_covered(
        samples, normals[face], floorplan.is_oriented[face], xy, walls.normals @ rotation.T
    )
    is_free = np.zeros(len(samples), dtype=bool)
    if len(free_xy):
        # A cell holds the sample, or nearly: half the diagonal of a cell.
        distance, _ = cKDTree(free_xy).query(samples, distance_upper_bound=0.71 * CELL_M)
        is_free = np.isfinite(distance) & ~is_wall
    n_judged = int(is_wall.sum() + is_free.sum())
    return PlanEvidence(
        walked,
        float(is_free.sum() / max(n_judged, 1)),
        n_judged * CELL_M,
        line_offset_m(walls, floorplan, hypothesis),
    )


def walked_through_share(
    walls: WallSamples, floorplan: Floorplan, hypothesis: AlignmentHypothesis
) -> float:
    """As `PlanEvidence.walked_through_share`."""
    if walls.seen_from is None:
        return 0.0
    ends, _ = scaled_faces(floorplan, np.array(hypothesis.scale_xy))
    eyes = walls.seen_from @ rotation_2d(hypothesis.yaw).T + hypothesis.translation
    first, second = eyes[:-1], eyes[1:]
    length = np.linalg.norm(second - first, axis=1)
    is_step = (length > 1e-6) & (length < MAX_STEP_M)
    if not is_step.any():
        return 0.0
    crossed = crosses_face(first[is_step], second[is_step], ends)
    return float(length[is_step] @ crossed / length[is_step].sum())


def with_way(
    walls: WallSamples, floorplan: Floorplan, hypothesis: AlignmentHypothesis
) -> AlignmentHypothesis:
    """The hypothesis with less of a score where the camera's way runs through the plan's walls."""
    share = walked_through_share(walls, floorplan, hypothesis)
    factor = 1.0 - max(0.0, share - WALKED_FREELY)
    return replace(hypothesis, score=hypothesis.score * factor)


def evidence_findings(evidence: PlanEvidence) -> tuple[list[Finding], list[Finding]]:
    """What speaks against the alignment, and what a user should know besides."""
    against, besides = [], []
    if evidence.is_seen_through:
        facts = {"seen_through_share": evidence.seen_through_share, "judged_m": evidence.judged_m}
        against.append(Finding(PlanKind.PLAN_SEEN_THROUGH, facts))
    facts = {"offset_m": evidence.line_offset_m}
    if evidence.line_offset_m > MAX_OFFSET_M:
        against.append(Finding(PlanKind.CENTRE_LINES_OF_THICK_WALLS, facts))
    elif evidence.line_offset_m > 0:
        besides.append(Finding(PlanKind.CENTRE_LINES, facts))
    return against, besides


def line_offset_m(
    walls: WallSamples, floorplan: Floorplan, hypothesis: AlignmentHypothesis
) -> float:
    """As `PlanEvidence.line_offset_m`."""
    ends, normals = scaled_faces(floorplan, np.array(hypothesis.scale_xy))
    rotation = rotation_2d(hypothesis.yaw)
    xy, towards = walls.xy @ rotation.T + hypothesis.translation, walls.normals @ rotation.T
    distance, face = nearest_beside(
        xy, towards, ends, normals, floorplan.is_oriented, OFFSET_REACH_M
    )
    near = face >= 0
    on_line = near.copy()
    on_line[near] = ~floorplan.is_oriented[face[near]]
    if on_line.sum() < max(MIN_ON_LINES * near.sum(), 1):
        return 0.0
    # In front is towards the camera, whichever way the line's normal was chosen.
    side = np.sign(np.sum(towards[on_line] * normals[face[on_line]], axis=1))
    in_front_m = distance[on_line] * side
    offset_m, sigma_m = median_with_sigma(in_front_m, xy[on_line])
    return offset_m if offset_m > max(MIN_OFFSET_M, OFFSET_SIGMAS * sigma_m) else 0.0


def median_with_sigma(
    offsets_m: Float[np.ndarray, " m"], xy: Float[np.ndarray, "m 2"]
) -> tuple[float, float]:
    """Median of how far samples of wall at `xy` stand off, m, and its standard deviation: samples that are
    nearer to each other than `OBSERVATION_M` are one observation."""
    middle_m = float(np.median(offsets_m))
    n_observations = len(np.unique(np.round(xy / OBSERVATION_M).astype(int), axis=0))
    mad_sigma_m = 1.4826 * float(np.median(np.abs(offsets_m - middle_m)))
    return middle_m, mad_sigma_m / np.sqrt(n_observations)


def _is_covered(
    samples: Float[np.ndarray, "k 2"],
    normals: Float[np.ndarray, "k 2"],
    is_oriented: Bool[np.ndarray, " k"],
    xy: Float[np.ndarray, "m 2"],
    wall_normals: Float[np.ndarray, "m 2"],
) -> Bool[np.ndarray, " k"]:
    """Which samples of faces have scanned wall of their direction nearby."""
    # Eight sectors of directions; a sample looks into its own and both neighbours.
    sector = (
        np.round(np.arctan2(wall_normals[:, 1], wall_normals[:, 0]) / (np.pi / 4)).astype(int) % 8
    )
    wanted = np.round(np.arctan2(normals[:, 1], normals[:, 0]) / (np.pi / 4)).astype(int) % 8
    covered = np.zeros(len(samples), dtype=bool)
    for k in range(8):
        seen = xy[np.isin(sector, [(k - 1) % 8, k, (k + 1) % 8])]
        rows = np.flatnonzero((wanted == k) | (~is_oriented & (wanted == (k + 4) % 8)))
        if len(seen) and len(rows):
            distance, _ = cKDTree(seen).query(samples[rows], distance_upper_bound=COVERED_M)
            covered[rows] |= np.isfinite(distance)
    return covered
