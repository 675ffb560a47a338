"""Which evidence contradicts which: visits and walls that the rest puts elsewhere, and what they strain.

A visit or a wall that the solves without it put far from where it says is suspect (`judge_visits`, folds).
That alone does not tell who is wrong: two loops that contradict each other are each contradicted by the rest.
So the suspects are left out one by one, the scan is solved once more without each, and what then fits better
than in the result is what the suspect stood against.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust import Measurements
from planfit.adjust.association import PlanCorrespondences, wall_patches_in_plan
from planfit.evaluation import median_match_distance
from planfit.findings.finding import FEW_NAMED
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.pipeline.folds import NOT_KEPT_OUT, FoldedSolves, without_fold
from planfit.tracking.types import MIN_WITNESSES
from planfit.units import in_units

SUSPECT_FACTOR = 4.0
"""What the rest puts this many times further off than the typical one of its kind is suspect,"""
SUSPECT_M = {"loop": 0.1, "wall": 0.05}
"""and at least so far off."""
MAX_SUSPECTS = 4
"""Each costs a solve, as long as one of a fold."""
EASED_M = 0.01
"""What fits better by less than this without a suspect is not told."""
MAX_EASED = FEW_NAMED

Poses = Float[np.ndarray, "k 4 4"]
Solve = Callable[[Measurements, PlanCorrespondences | None], Poses]
"""Poses of the keyframes by these, from the result on."""


@dataclass(frozen=True)
class EvidenceItem:
    """A visit or a wall of the plan, as one piece of evidence."""

    kind: str
    """"loop", "wall", "loop by hand" or "recorded motion"."""
    first_frames: tuple[int, int] | None = None
    """Of a loop or recorded motion: first and last frame (of its earlier side), as numbered in the scan."""
    last_frames: tuple[int, int] | None = None
    """Of a loop: of the later one."""
    face_idx: int | None = None
    """Of a wall."""
    ends: tuple[tuple[float, float], ...] = ()
    """Of a wall, m, plan frame."""

    @property
    def words(self) -> str:
        """For a user."""
        if self.first_frames is None:
            (ax, ay), (bx, by) = self.ends
            return f"wall from ({ax:.2f}, {ay:.2f}) to ({bx:.2f}, {by:.2f})"
        first = "{}-{}".format(*self.first_frames)
        if self.last_frames is None:
            return f"recorded motion of frames {first}"
        return f"{self.kind} between frames {first} and {{}}-{{}}".format(*self.last_frames)


@dataclass(frozen=True)
class Eased:
    """What fits better without a suspect."""

    item: EvidenceItem
    by_m: float
    """How much nearer to where it says."""


@dataclass(frozen=True)
class Disagreement:
    """A suspect, and what it stands against."""

    item: EvidenceItem
    after_m: float
    """How far the result is from what it says: median distance of matches, or offset of a wall."""
    kept_out_m: float
    """The same by a solve that did without it alone."""
    eased: tuple[Eased, ...]
    """Most first; none where it bends nothing, as a loss let go of it."""

    @property
    def sentence(self) -> str:
        """For a user, without a full stop."""
        words = (
            f"{self.item.words}: {in_units(self.after_m)} off in the result, {in_units(self.kept_out_m)} "
            "where the rest puts it"
        )
        if not self.eased:
            return f"{words}; nothing else fits better without it"
        better = " and ".join(f"{each.item.words} by {in_units(each.by_m)}" for each in self.eased)
        return f"{words}; without it fit better: {better}"


@dataclass(frozen=True)
class _Items:
    """Pieces of evidence of a result: visits, walls, loops by hand, stretches of the recorded motion."""

    solves: FoldedSolves
    visits: tuple[int, ...]
    """As numbered by the folds."""
    faces: tuple[int, ...]

    @property
    def all(self) -> tuple[EvidenceItem, ...]:
        """In the order of their residuals."""
        folds, pairs = self.solves.folds, self.solves.prepared.measurements.matches.pairs
        found = []
        for visit in self.visits:
            a, b = folds.stretch[pairs[int(np.argmax(folds.visit == visit))]]
            first, last = (self.solves.frames_of(s) for s in (a, b))
            found.append(EvidenceItem("loop", first, last))
        found += [EvidenceItem("wall", face_idx=f, ends=self._ends(f)) for f in self.faces]
        for own in self.hand_groups:
            pairs = self.solves.prepared.keyframes.frame_idx[self.by_hand.pairs[own]]
            first, last = ((int(of.min()), int(of.max())) for of in pairs.T)
            found.append(EvidenceItem("loop by hand", first, last))
        for stretch in range(folds.n_stretches):
            frames = self.solves.frames_of(stretch)
            found.append(EvidenceItem("recorded motion", frames))
        return tuple(found)

    def _ends(self, face: int) -> tuple[tuple[float, float], ...]:
        found = self.solves.adjustment.correspondences
        ends = [] if found is None else found.floorplan.drawn_ends[face].tolist()
        return tuple((float(x), float(y)) for x, y in ends)

    @property
    def by_hand(self) -> Matches:
        """Loops that a person added, between keyframes; none where there are none."""
        measurements = self.solves.prepared.measurements
        if measurements.by_hand is not None:
            return measurements.by_hand
        return measurements.matches.of_pairs(np.zeros(len(measurements.matches.pairs), dtype=bool))

    @property
    def hand_groups(self) -> tuple[Bool[np.ndarray, " h"], ...]:
        """Which loops by hand are one piece of evidence: those between the same two stretches."""
        cells = self.solves.folds.stretch[self.by_hand.pairs].reshape(-1, 2)
        return tuple((cells == cell).all(axis=1) for cell in np.unique(cells, axis=0))

    @property
    def patch_faces(self) -> Int[np.ndarray, " w"]:
        """Face of each wall patch; -1 without one."""
        found = self.solves.adjustment.correspondences
        n_patches = len(self.solves.prepared.measurements.structure.walls)
        return np.full(n_patches, -1) if found is None else found.walls.face_idx

    def visits_m(self, poses: Poses, fold: int | None = None) -> Float[np.ndarray, " v"]:
        """Median distance of the matches of each visit, m; those that a fold does not keep out are NaN."""
        found, matches = (
            np.full(len(self.visits), np.nan),
            self.solves.prepared.measurements.matches,
        )
        for k, visit in enumerate(self.visits):
            pairs = self.solves.folds.pairs_of_visits[visit]
            if fold is None or self.solves.folds.of_pairs[pairs[0]] == fold:
                found[k] = median_match_distance(matches.taken(pairs), poses)
        return found

    def patches_m(self, poses: Poses) -> Float[np.ndarray, " w"]:
        """Offset of each wall patch from its face, m; NaN without one."""
        measurements, found = (
            self.solves.prepared.measurements,
            self.solves.adjustment.correspondences,
        )
        walls, faces = measurements.structure.walls, self.patch_faces
        offsets_m = np.full(len(walls), np.nan)
        has = faces >= 0
        if found is not None and has.any():
            plan, (_, ends) = found.floorplan, wall_patches_in_plan(walls, poses)
            from_face = ends.mean(axis=1)[has] - plan.ends[faces[has], 0]
            offsets_m[has] = np.einsum("pi,pi->p", from_face, plan.normals[faces[has]])
            if found.moved_m is not None:
                offsets_m[has] -= np.nan_to_num(found.moved_m[faces[has]])
        return offsets_m

    def residuals_m(
        self,
        visits_m: Float[np.ndarray, " v"],
        patches_m: Float[np.ndarray, " w"],
        poses: Poses,
    ) -> Float[np.ndarray, " i"]:
        """Median of each item; those of loops by hand are of these poses."""
        found, faces = visits_m.tolist(), self.patch_faces
        found += [abs(float(np.median(patches_m[faces == f]))) for f in self.faces]
        found += [
            median_match_distance(self.by_hand.of_pairs(own), poses) for own in self.hand_groups
        ]
        found += [
            self._strain_m(poses, stretch) for stretch in range(self.solves.folds.n_stretches)
        ]
        return np.array(found)

    def _strain_m(self, poses: Poses, stretch: int) -> float:
        """By how much the steps of a stretch of the walk, the one to the next stretch included, differ from
        those recorded, added up, m."""
        first, last = np.flatnonzero(self.solves.folds.stretch == stretch)[[0, -1]]
        own = slice(first, min(last + 2, len(poses)))
        steps = [se3.inverse(p[own][:-1]) @ p[own][1:] for p in (poses, self.solves.recorded)]
        return float(np.linalg.norm((steps[0] - steps[1])[:, :3, 3], axis=1).sum())

    def without(self, item: int) -> tuple[Measurements, PlanCorrespondences | None]:
        """All evidence but one item."""
        measurements, folds = self.solves.prepared.measurements, self.solves.folds
        pairs, surfaces, patches = (
            np.full(len(of), NOT_KEPT_OUT)
            for of in (folds.of_pairs, folds.of_surfaces, folds.of_patches)
        )
        n_visits, n_faces = len(self.visits), len(self.faces)
        if item < n_visits:
            pairs[folds.visit == self.visits[item]] = 0
            cell = folds.stretch[measurements.matches.pairs[pairs == 0][0]]
            of_surfaces = folds.stretch[measurements.surfaces.pairs].reshape(-1, 2)
            surfaces[(of_surfaces == cell).all(axis=1)] = 0
        elif item < n_visits + n_faces:
            patches[self.patch_faces == self.faces[item - n_visits]] = 0
        else:
            own = self.hand_groups[item - n_visits - n_faces]
            measurements = replace(measurements, by_hand=self.by_hand.of_pairs(~own))
        out = replace(folds, of_pairs=pairs, of_surfaces=surfaces, of_patches=patches)
        return without_fold(measurements, self.solves.adjustment.correspondences, out, 0)


def find_disagreements(solves: FoldedSolves, solve: Solve) -> tuple[Disagreement, ...]:
    """Suspects, the most suspect first, and what each stands against.

    Args:
        solves: the result, and those without what each fold kept out.
        solve: once more, from the result, with less.
    """
    items, folds, solved = _items(solves), solves.folds, solves.solved
    named = items.all
    visits_m, patches_m = items.visits_m(solved), items.patches_m(solved)
    after_m = items.residuals_m(visits_m, patches_m, solved)
    for fold, poses in enumerate(solves.by_fold):
        out_m = items.visits_m(poses, fold)
        visits_m = np.where(np.isfinite(out_m), out_m, visits_m)
        patches_m = np.where(folds.of_patches == fold, items.patches_m(poses), patches_m)
    kept_out_m = items.residuals_m(visits_m, patches_m, solved)
    found = []
    for k in _suspects(named, kept_out_m)[:MAX_SUSPECTS]:
        poses = solve(*items.without(int(k)))
        alone_m = items.residuals_m(items.visits_m(poses), items.patches_m(poses), poses)
        eased_m = after_m - alone_m
        eased_m[k] = 0.0
        most = [i for i in np.argsort(-eased_m)[:MAX_EASED] if eased_m[i] > EASED_M]
        eased = tuple(Eased(named[i], float(eased_m[i])) for i in most)
        found.append(Disagreement(named[k], float(after_m[k]), float(alone_m[k]), eased))
    return tuple(found)


def _items(solves: FoldedSolves) -> _Items:
    folds, matches = solves.folds, solves.prepared.measurements.matches
    has_matches = np.diff(matches.start) > 0
    visits = np.unique(folds.visit[(folds.visit != NOT_KEPT_OUT) & has_matches])
    items = _Items(solves, tuple(visits.tolist()), ())
    faces = items.patch_faces
    seen, counts = np.unique(faces[faces >= 0], return_counts=True)
    return replace(items, faces=tuple(seen[counts >= MIN_WITNESSES].tolist()))


def _suspects(
    items: Sequence[EvidenceItem], kept_out_m: Float[np.ndarray, " i"]
) -> Int[np.ndarray, " s"]:
    """Those far further off than others of their kind, the most suspect first; before them, what a person
    added, which nothing else tested."""
    times = np.zeros(len(items))
    for kind, least_m in SUSPECT_M.items():
        own = np.array([item.kind == kind for item in items])
        if own.any():
            typical_m = float(np.median(kept_out_m[own]))
            times[own] = kept_out_m[own] / max(SUSPECT_FACTOR * typical_m, least_m)
    times[[item.kind == "loop by hand" for item in items]] = np.inf
    order = np.argsort(-times, kind="stable")
    return order[times[order] > 1.0]
