"""Trajectories of laser scanners: places of the scanner by the cloud's clock.

A frame needs the scanner's place alone, so that neither the axes of the trajectory nor the order of its
angles can be mistaken; rotations are carried along and written back.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import ScanError
from planfit.scan.pose_columns import (
    EXPECTED,
    SEPARATORS,
    Columns,
    columns_of,
    header_words,
    parse_columns,
)
from planfit.scan.poses import MAX_ENTRY, contradicts_path, poses_at

MAX_GAP_S = 0.2
"""A place is known this near to a recorded one, and between two that are six times as far apart."""
CLOCK_UNITS = (1.0, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15)
"""Seconds of what clocks count, and programs that multiply twice."""
_UNIT_NAMES = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
MIN_SPEED_M_S = 0.005
"""A scanner that is carried or driven is faster on average, or its clock counts another unit."""


@dataclass(frozen=True)
class Trajectory:
    """Where the scanner was, in the axes of its cloud."""

    path: Path
    times: Float[np.ndarray, " n"]
    """s, increasing, of its own clock."""
    world_from_scanner: Float[np.ndarray, "n 4 4"]
    """As recorded; without rotations (identity) where it has none."""
    columns: tuple[str, ...]
    """What each column of the file means; empty for what is carried along."""
    header: tuple[str, ...]
    """Lines before the first pose."""
    rows: tuple[tuple[str, ...], ...]
    """Words of each pose; none of a trajectory that is a cloud."""
    separator: str
    metres_away: Float[np.ndarray, "3"]
    """What was taken off positions: they are near the origin then."""
    seconds_per_unit: float = 1.0
    """Of times in the file, which do not say their unit."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What of the file is not used, or taken in another unit."""
        unit = (
            f"{self.path.name}: times are {clock_unit(self.seconds_per_unit)}, not seconds: as seconds, the "
            "scanner would hardly move",
        ) if self.seconds_per_unit != 1 else ()  # fmt: skip
        if "angle" not in self.columns:
            return unit
        named = ", ".join(
            name for name, c in zip(header_words(self.header), self.columns, strict=False)
            if c == "angle"
        )  # fmt: skip
        return (
            *unit,
            f"{self.path.name}: angles ({named}) are not read, as their order differs between programs: only "
            "positions are taken, and angles are left out of the refined trajectory",
        )

    def moved(self, offset: Float[np.ndarray, "3"]) -> "Trajectory":
        """The same with an offset (m) taken off positions."""
        poses = self.world_from_scanner.copy()
        poses[:, :3, 3] -= offset
        return replace(self, world_from_scanner=poses, metres_away=self.metres_away + offset)

    def at(
        self, times: Float[np.ndarray, " k"], max_gap_s: float = MAX_GAP_S
    ) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"]]:
        """Poses at times (s) of its clock, and which of them are known."""
        return poses_at(self.times, self.world_from_scanner, times, max_gap_s)

    def write(self, path: Path, world_from_scanner: Float[np.ndarray, "n 4 4"]) -> None:
        """The file again, with other poses (in the axes of `world_from_scanner`); all else as it was."""
        kept = [i for i, c in enumerate(self.columns) if c != "angle"]
        values = columns_of(world_from_scanner, self.metres_away)
        at = {i: values[c] for i, c in enumerate(self.columns) if c in values}
        lines = [self._kept_header(line, kept) for line in self.header]
        for k, row in enumerate(self.rows):
            words = [f"{at[i][k]:.9f}" if i in at else row[i] for i in kept]
            lines.append(self.separator.join(words))
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def _kept_header(self, line: str, kept: list[int]) -> str:
        words = SEPARATORS.split(line.strip())
        if len(kept) == len(self.columns) or len(words) != len(self.columns):
            return line
        return self.separator.join(words[i] for i in kept)


def read_trajectory(path: Path) -> Trajectory:
    """A trajectory of a text file.

    Raises:
        ScanError: it is missing, of another form, or leaves open what its columns mean.
    """
    return in_order(path, parse_columns(_read_text(path), path))


def in_order(path: Path, table: Columns) -> Trajectory:
    """Poses in the order of their times, as seconds.

    Raises:
        ScanError: times do not go on, or places are nowhere.
    """
    times, poses, rows = table.times, table.poses, table.rows
    if contradicts_path(times, poses[:, :3, 3]):
        back = int(np.argmax(np.diff(times) < 0))
        raise ScanError(
            f"{path}: expected times that go on along the path, found {times[back + 1]:.6f} after "
            f"{times[back]:.6f} (pose {back + 1}), as of several clocks, or durations; points of the cloud "
            "cannot be told their places: export it with times of the cloud's clock, or each part alone"
        )
    seconds_per_unit = seconds_of_unit(times, poses)
    order = np.argsort(times, kind="stable")
    times, poses = times[order] * seconds_per_unit, poses[order]
    if np.abs(poses[:, :3, 3]).max() >= MAX_ENTRY or not times[-1] > times[0]:
        raise ScanError(
            f"{path}: expected places in metres at times that go on, found coordinates up to "
            f"{np.abs(poses[:, :3, 3]).max():.4g} over {np.ptp(times):.4g} s"
        )
    ordered = tuple(rows[i] for i in order) if rows else ()
    return Trajectory(
        path, times, poses, table.columns, table.header, ordered, table.separator, np.zeros(3),
        seconds_per_unit,
    )  # fmt: skip


def seconds_of_unit(times: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n 4 4"]) -> float:
    """Seconds of a unit of times that do not say it: 1, unless the scanner would hardly move at that; then
    that of `CLOCK_UNITS` by which it moves at a metre a second or so."""
    order = np.argsort(times, kind="stable")
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        length_m = np.linalg.norm(np.diff(poses[order, :3, 3], axis=0), axis=1).sum()
        speed_m_s = length_m / np.ptp(times)
    if not 0 < speed_m_s < MIN_SPEED_M_S:
        return 1.0
    return min(CLOCK_UNITS, key=lambda unit: abs(np.log(speed_m_s / unit)))


def clock_unit(seconds_per_unit: float) -> str:
    """What a clock counts, in words."""
    return _UNIT_NAMES.get(seconds_per_unit, f"counts of {seconds_per_unit:g} s")


def _read_text(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ScanError(
            f"{path}: expected {EXPECTED}, found none that can be read ({error.strerror}); check the path"
        ) from error
    if b"\0" in data[:4096]:
        is_sbet = len(data) % 136 == 0
        found = "a binary SBET, which has latitude and longitude" if is_sbet else "a binary file"
        raise ScanError(
            f"{path}: expected {EXPECTED}, found {found}; export it as text in the coordinate system of the "
            "cloud"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScanError(
            f"{path}: expected {EXPECTED}, found other bytes ({error.reason})"
        ) from error
