"""A cloud cut into instants of half a second, each kept on disk relative to where the scanner was.

A cloud of hours does not fit into memory, and its points are in any order: tiles, voxels, or times. One pass
sorts each piece by instant and appends it to a file of single precision; an instant is then a few runs of it.
"""

import shutil
import tempfile
import weakref
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int

from planfit.errors import ScanError
from planfit.scan.laser.cloud import ClockRelation, CloudFile
from planfit.scan.laser.trajectory import Trajectory

FAR_M = 40.0
"""Points further from the scanner along an axis take no part: rooms are smaller."""
MIN_POINTS = 300
"""Instants of fewer points show no surface, nor do cameras that see fewer of them."""
MIN_SHARE = 0.1
"""Nor do instants of a smaller share of what most have: those at the ends."""
MAX_INSTANTS = 500_000
"""Three days of half seconds (518,400): whatever asks for more has a wrong clock."""
_BYTES = 12
"""Of a point on disk: three of single precision."""


@dataclass(frozen=True)
class Instants:
    """Points by instant; safe to use from several threads."""

    times: Float[np.ndarray, " k"]
    """s of the trajectory's clock: the mean of the points."""
    centres: Float[np.ndarray, "k 3"]
    """m, where the scanner was then."""
    n_total: int
    """Points of the cloud."""
    n_without_pose: int
    """Of those, points at times that the trajectory does not cover."""
    _store: "_Store"

    def points(self, k: int) -> Float32[np.ndarray, "n 3"]:
        """Points (m) of an instant, relative to its centre, axes of the cloud."""
        return self._store.read(k)


def cut(
    file: CloudFile, trajectory: Trajectory, clock: ClockRelation, duration_s: float
) -> Instants:
    """Read a cloud once, and keep its points by instants.

    Args:
        file: the cloud.
        trajectory: in the axes of the cloud, less `metres_away`.
        clock: from times of the cloud to those of the trajectory.
        duration_s: of an instant.

    Raises:
        ScanError: the file is damaged, or its points are nowhere near the trajectory.
    """
    # Half an instant before the first pose: bursts of points at the times of poses lie amid an instant.
    start_s = float(trajectory.times[0]) - 0.5 * duration_s
    n = int(np.ceil((trajectory.times[-1] - start_s) / duration_s)) + 1
    if n > MAX_INSTANTS:
        raise ScanError(
            f"{trajectory.path}: expected a walk of hours, found times from {trajectory.times[0]:.6g} to "
            f"{trajectory.times[-1]:.6g} s; is their unit seconds?"
        )
    middles = start_s + (np.arange(n) + 0.5) * duration_s
    poses, known = trajectory.at(middles, max(0.2, 0.5 * duration_s))
    store = _Store(poses[:, :3, 3].copy())
    tally = _Tally(n)
    for piece in file.pieces():
        # A damaged file has numbers of any size, and NaN.
        with np.errstate(invalid="ignore", over="ignore"):
            times = clock.of(piece.times)
            of = np.floor((times - start_s) / duration_s)
            has_pose = np.isfinite(of) & (of >= 0) & (of < n)
            of = np.where(has_pose, of, 0).astype(np.int64)
            has_pose &= known[of]
            away = piece.xyz - trajectory.metres_away - store.centres[of]
            is_near = np.abs(away).max(axis=1) < FAR_M
        used = has_pose & is_near & piece.is_valid
        tally.add(of[used], times[used], has_pose, is_near)
        store.append(of[used], away[used].astype(np.float32))
    return _finished(file, trajectory, store, tally)


class _Tally:
    """What one pass counts."""

    def __init__(self, n: int) -> None:
        """Of `n` instants."""
        self.counts, self.sums = np.zeros(n, dtype=np.int64), np.zeros(n)
        self.n_total = self.n_posed = self.n_near = 0

    def add(
        self, of: np.ndarray, times: np.ndarray, has_pose: np.ndarray, near: np.ndarray
    ) -> None:
        """Count a piece: instants and times of the points used, and what holds of all."""
        self.counts += np.bincount(of, minlength=len(self.counts))
        self.sums += np.bincount(of, weights=times, minlength=len(self.sums))
        self.n_total += len(has_pose)
        self.n_posed += int(has_pose.sum())
        self.n_near += int((has_pose & near).sum())


def _finished(file: CloudFile, trajectory: Trajectory, store: "_Store", tally: _Tally) -> Instants:
    if tally.n_posed and tally.n_near < 0.5 * tally.n_posed:
        share = 1 - tally.n_near / tally.n_posed
        raise ScanError(
            f"{file.path}: expected points around {trajectory.path.name}, found {share:.0%} of them more "
            f"than {FAR_M:g} m from where the scanner was at their time; are both in one coordinate system "
            "and of one recording?"
        )
    usual = float(np.median(tally.counts[tally.counts > 0])) if tally.counts.any() else 0.0
    kept = np.flatnonzero(tally.counts >= max(MIN_POINTS, MIN_SHARE * usual))
    if len(kept) == 0:
        raise ScanError(
            f"{file.path}: expected {MIN_POINTS} points or more of some instants with a pose, found "
            f"{int(tally.counts.max(initial=0))} at most of {tally.n_total}; are cloud and trajectory of one "
            "recording?"
        )
    times = tally.sums[kept] / tally.counts[kept]
    centres = trajectory.at(times, 1e9)[0][:, :3, 3]
    return Instants(
        times=times,
        centres=centres,
        n_total=tally.n_total,
        n_without_pose=tally.n_total - tally.n_posed,
        _store=store.finished(kept, centres),
    )


class _Store:
    """Points on disk, in runs of instants."""

    def __init__(self, centres: Float[np.ndarray, "n 3"]) -> None:
        """Points are kept relative to `centres` (m) of their instants."""
        self.centres = centres
        self._folder = Path(tempfile.mkdtemp(prefix="planfit-"))
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._path = self._folder / "points.f32"
        self._n = 0
        self._runs: list[np.ndarray] = []  # instant, first point, count
        self._start = np.zeros(0, dtype=np.int64)
        self._kept = np.zeros(0, dtype=np.int64)
        self._moved = np.zeros((0, 3), dtype=np.float32)

    def append(self, of: Int[np.ndarray, " m"], points: Float32[np.ndarray, "m 3"]) -> None:
        """Add points of instants, in any order."""
        if len(of) == 0:
            return
        order = np.argsort(of, kind="stable")
        of = of[order]
        first = np.flatnonzero(np.concatenate([[True], of[1:] != of[:-1]]))
        counts = np.diff(np.append(first, len(of)))
        self._runs.append(np.stack([of[first], self._n + first, counts], axis=1))
        with self._path.open("ab") as file:
            points[order].tofile(file)
        self._n += len(of)

    def finished(self, kept: Int[np.ndarray, " k"], centres: Float[np.ndarray, "k 3"]) -> "_Store":
        """Itself, ready to be read: instants are those `kept` now, and points relative to other centres."""
        runs = np.concatenate(self._runs)
        self._table = runs[np.argsort(runs[:, 0], kind="stable")]
        self._start = np.searchsorted(self._table[:, 0], kept)
        self._kept = kept
        self._moved = (self.centres[kept] - centres).astype(np.float32)
        self._runs = []
        return self

    def read(self, k: int) -> Float32[np.ndarray, "n 3"]:
        """Points of the k-th instant that was kept."""
        found = []
        with self._path.open("rb") as file:
            for instant, first, count in self._table[self._start[k] :]:
                if instant != self._kept[k]:
                    break
                file.seek(int(first) * _BYTES)
                data = file.read(int(count) * _BYTES)
                found.append(np.frombuffer(data, dtype=np.float32).reshape(-1, 3))
        return np.concatenate(found) + self._moved[k]
