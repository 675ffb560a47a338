"""Several scans of one building as one: their frames one after the other, in one frame of reference."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import ScanError
from planfit.runtime import short_repr
from planfit.scan.types import RoutedFiles, Scan, ScanFiles


@dataclass(frozen=True)
class FramesOfScan:
    """Which frames of a joined scan are those of one of its scans."""

    name: str
    """Short, and no other's: stands before the ids of its frames, as in `A/000123`."""
    first: int
    last: int
    """Inclusive."""
    placed_by: str = ""
    """How the place of the scan among the others was found, in words."""

    @property
    def frames(self) -> slice:
        """Of arrays over all frames."""
        return slice(self.first, self.last + 1)


@dataclass(frozen=True)
class JoinedFiles(RoutedFiles):
    """The images of several scans, frame after frame; poses are written for each scan apart."""

    files: tuple[ScanFiles, ...]
    scans: tuple[FramesOfScan, ...]

    __repr__ = short_repr

    def write_poses(
        self,
        directory: Path,
        world_from_cams: Float[np.ndarray, "n 4 4"],
        frame_idx: Int[np.ndarray, " n"] | None = None,
    ) -> None:
        """A folder for each scan, in which its own format writes."""
        chosen = np.arange(self.scans[-1].last + 1) if frame_idx is None else frame_idx
        for own, files in zip(self.scans, self.files, strict=True):
            of = (chosen >= own.first) & (chosen <= own.last)
            if of.any():
                folder = directory / own.name
                folder.mkdir()
                files.write_poses(folder, world_from_cams[of], chosen[of] - own.first)

    def route(self, frame_idx: int) -> tuple[ScanFiles, int]:
        """The files that a frame is of, and its number there."""
        k = int(np.searchsorted([own.first for own in self.scans], frame_idx, side="right")) - 1
        return self.files[k], frame_idx - self.scans[k].first


def short_names(scans: Sequence[Scan]) -> tuple[str, ...]:
    """What each scan is called among the others: the last part of its path, more where those are the same.

    Raises:
        ScanError: two scans are one and the same.
    """
    paths = [Path(scan.name).resolve() for scan in scans]
    for k, path in enumerate(paths):
        if path in paths[:k]:
            raise ScanError(
                f"{scans[k].name}: expected scans that differ, found this one twice; give each once, and "
                "scans of arrays a name each"
            )
    n_parts = 1
    while True:  # ends: the whole paths differ
        names = ["_".join(path.parts[1:][-n_parts:]) for path in paths]
        if len(set(names)) == len(names):
            return tuple(names)
        n_parts += 1


def join_scans(
    scans: Sequence[Scan],
    names: Sequence[str],
    joined_from_worlds: Sequence[Float[np.ndarray, "4 4"]],
) -> tuple[Scan, tuple[FramesOfScan, ...]]:
    """One scan of the frames of several, and which of them are whose.

    What its format says of up, and of a plan, is that of the first: its world is the joined one where
    `joined_from_worlds` begins with the identity. Times are as recorded, and may begin again with each scan.

    Args:
        scans: one or more.
        names: `short_names`.
        joined_from_worlds: from the axes of each scan to the joined ones.
    """
    first = np.cumsum([0, *(len(scan) for scan in scans)])
    frames = tuple(
        FramesOfScan(name, int(first[k]), int(first[k + 1]) - 1) for k, name in enumerate(names)
    )
    prints = [scan.fingerprint for scan in scans]
    fingerprint = hashlib.sha256(repr(prints).encode()).hexdigest()[:16] if all(prints) else ""
    moves = zip(scans, joined_from_worlds, strict=True)
    joined = replace(
        scans[0],
        name=" + ".join(names),
        frame_ids=tuple(
            f"{name}/{frame_id}"
            for name, scan in zip(names, scans, strict=True)
            for frame_id in scan.frame_ids
        ),
        timestamps=np.concatenate([scan.timestamps for scan in scans]),
        cameras=tuple(camera for scan in scans for camera in scan.cameras),
        world_from_cams=np.concatenate([move @ scan.world_from_cams for scan, move in moves]),
        files=JoinedFiles(tuple(scan.files for scan in scans), frames),
        has_color=any(scan.has_color for scan in scans),
        lacking=tuple(lacks for scan in scans for lacks in scan.lacking),
        has_labels=all(scan.has_labels for scan in scans),
        fingerprint=fingerprint,
        format=" + ".join(dict.fromkeys(scan.format for scan in scans)),
        skipped=_named(names, [scan.skipped for scan in scans]),
        warnings=_named(names, [scan.warnings for scan in scans]),
    )
    return joined, frames


def _named(names: Sequence[str], lines: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Lines of all scans, each with the name of its scan before it."""
    return tuple(f"{name}: {line}" for name, own in zip(names, lines, strict=True) for line in own)
