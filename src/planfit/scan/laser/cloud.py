"""A cloud as its file has it: points with times, and how these relate to the times of its trajectory.

LAS tells times as seconds of the GPS week, or as GPS seconds less a billion; E57 as seconds since a scan's
start. Trajectories have any of these, GPS seconds in full, Unix time, or a clock of the device, which many
programs write into the cloud too, whatever its header says; and some write milliseconds to nanoseconds where
seconds belong. The relation is found where one alone fits, and refused else.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import ScanError
from planfit.scan.laser.trajectory import CLOCK_UNITS, Trajectory

Move = Callable[[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]], Float[np.ndarray, "n 3"]]
"""Points (m, in the file's axes) and their times (s, as the file has them) to where they belong."""

CHUNK_POINTS = 1_000_000
"""Points in memory at a time: with coordinates, times and what sorts them, 150 MB."""

WEEK_S = 604_800.0
"""7 days of 86,400 s."""
UNIX_OF_GPS_S = 315_964_800.0
"""Unix time of the beginning of GPS time, 6 January 1980."""
LEAP_S = 18.0
"""GPS time is ahead of UTC by this since 2017."""
MIN_INSIDE = 0.9
"""Share of a cloud's times that its trajectory has to cover."""
MIN_SPAN_SHARE = CLOCK_UNITS[1] ** 0.5
"""Of the time of its trajectory: a cloud of less may be of the next unit."""
SAME_OFFSET_S = 1e-3
SAME_SHARE = 0.002
"""Relations that cover shares of the cloud that differ by less fit alike."""


@dataclass(frozen=True)
class TimedPoints:
    """Some points of a cloud."""

    xyz: Float[np.ndarray, "n 3"]
    """m, in the file's axes, double precision: site coordinates are millions of metres."""
    times: Float[np.ndarray, " n"]
    """s, as the file has them."""
    is_valid: Bool[np.ndarray, " n"]
    """Measured surface: neither withheld, nor classified as noise, nor marked as invalid."""


@dataclass(frozen=True)
class CloudClock:
    """What a file says of its times."""

    words: str
    """For messages."""
    gps_offset_s: float | None = None
    """Seconds to add for those since the beginning of GPS time (6 January 1980); None: not told."""
    is_gps_week: bool = False
    """Whether times count from the beginning of a GPS week, of which nothing is told."""


@runtime_checkable
class CloudFile(Protocol):
    """A file of points with times."""

    @property
    def path(self) -> Path:
        """Of the file."""
        ...

    @property
    def n_points(self) -> int:
        """As the file says."""
        ...

    @property
    def clock(self) -> CloudClock:
        """What the file says of its times."""
        ...

    def sample_times(self) -> Float[np.ndarray, " n"]:
        """Some times (s) out of all parts of the file that can be read at once.

        Raises:
            ScanError: the file is damaged.
        """
        ...

    def pieces(self) -> Iterator[TimedPoints]:
        """All points, in the order of the file.

        Raises:
            ScanError: the file is damaged.
        """
        ...

    def write_moved(self, path: Path, move: Move, to_other_axes: bool = False) -> None:
        """A copy of the file, in which points are moved and all else is kept.

        `to_other_axes` leaves out what tells where on Earth the file's own axes are.

        Raises:
            ScanError: the file is damaged, or a point is moved to where the file's form cannot tell it.
        """
        ...


@dataclass(frozen=True)
class ClockRelation:
    """From a cloud's times to those of its trajectory, and why."""

    offset_s: float
    """Seconds to add."""
    words: str
    """Empty where both clocks are the same."""
    seconds_per_unit: float = 1.0
    """Of the cloud's times, before the offset."""

    def of(self, cloud_times: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Times (s) of the trajectory's clock."""
        return cloud_times * self.seconds_per_unit + self.offset_s


def relate_clocks(file: CloudFile, trajectory: Trajectory, offset_s: float | None) -> ClockRelation:
    """The relation that puts the cloud's times inside the trajectory's; the user's own `offset_s` if given.

    Raises:
        ScanError: none does, or several do.
    """
    stored = file.sample_times()
    if len(stored) > 1 and np.ptp(stored) == 0.0:
        raise ScanError(
            f"{file.path}: expected points with times of their own, found {stored[0]:.9g} s for all; export "
            "the cloud with GPS times"
        )
    span_s = np.ptp(trajectory.times)
    for seconds_per_unit in CLOCK_UNITS:
        times = stored * seconds_per_unit
        # In too large a unit all times are one, inside of anything.
        if seconds_per_unit != 1 and len(times) and np.ptp(times) < MIN_SPAN_SHARE * span_s:
            continue
        fitting = _fitting(file, times, trajectory, offset_s)
        if len(fitting) > 1:
            found = " or ".join(
                f"{f.words or 'the same clock'} ({f.offset_s:+.0f} s)" for f in fitting
            )
            raise ScanError(
                f"{file.path}: expected one way to relate its times to those of {trajectory.path.name}, "
                f"found several that fit: {found}; say which with --cloud-time-offset-s"
            )
        if fitting:
            return replace(fitting[0], seconds_per_unit=seconds_per_unit)
    how = "" if offset_s is None else f"with {offset_s:g} s added, "
    span = f"{stored.min():.3f} to {stored.max():.3f}" if len(stored) else "none"
    raise ScanError(
        f"{file.path}: expected points at times of {trajectory.path.name} "
        f"({trajectory.times[0]:.3f} to {trajectory.times[-1]:.3f} s), found {how}{span} s "
        f"({file.clock.words}), and no usual relation between the clocks (GPS week, GPS seconds, Unix time; "
        "seconds to nanoseconds) joins them; are they of one recording? Else say what to add with "
        "--cloud-time-offset-s"
    )


def _fitting(
    file: CloudFile, times: Float[np.ndarray, " n"], trajectory: Trajectory, offset_s: float | None
) -> list[ClockRelation]:
    """Relations that put times, which are seconds, inside those of the trajectory."""
    if offset_s is not None:
        asked = ClockRelation(
            offset_s, f"{offset_s:g} s were added to the cloud's times, as was asked for"
        )
        return [asked] if _share_inside(times + offset_s, trajectory) >= MIN_INSIDE else []
    shares: list[tuple[ClockRelation, float]] = []
    for relation in _candidates(file.clock, times, trajectory):
        if all(abs(relation.offset_s - other.offset_s) > SAME_OFFSET_S for other, _ in shares):
            shares.append((relation, _share_inside(relation.of(times), trajectory)))
    # Leap seconds shift a cloud by little; but a trajectory begins and ends as its cloud does.
    least = max(MIN_INSIDE, max((share for _, share in shares), default=0.0) - SAME_SHARE)
    return [relation for relation, share in shares if share >= least]


def _candidates(
    clock: CloudClock, times: Float[np.ndarray, " n"], trajectory: Trajectory
) -> list[ClockRelation]:
    """Relations that programs are known to leave behind."""
    found = [ClockRelation(0.0, "")]
    if len(times) == 0:
        return found
    unix = UNIX_OF_GPS_S - LEAP_S
    first = float(trajectory.times[0])
    middle = float(np.median(times))
    if clock.gps_offset_s is not None:
        full = clock.gps_offset_s
        week = np.floor((middle + full) / WEEK_S) * WEEK_S
        found += [
            ClockRelation(full + shift, f"{clock.words} against {words}")
            for shift, words in (
                (0.0, "GPS seconds"),
                (unix, "Unix time"),
                (UNIX_OF_GPS_S, "Unix time without leap seconds"),
                (-week, "seconds of the GPS week"),
                (-1e9, "GPS seconds less a billion"),
            )
        ]
    if clock.is_gps_week and times.min() >= 0 and times.max() <= 2 * WEEK_S:
        for shift, words in (
            (0.0, "GPS seconds"),
            (-1e9, "GPS seconds less a billion"),
            (unix, "Unix time"),
            (UNIX_OF_GPS_S, "Unix time without leap seconds"),
        ):
            weeks = np.round((first - shift - middle) / WEEK_S)
            for k in (weeks - 1, weeks, weeks + 1):
                if k * WEEK_S + shift > 0:
                    name = f"{clock.words} against {words}"
                    found.append(ClockRelation(float(k * WEEK_S + shift), name))
    return found


def _share_inside(times: Float[np.ndarray, " n"], trajectory: Trajectory) -> float:
    if len(times) == 0:
        return 0.0
    slack = 0.5
    first, last = trajectory.times[0] - slack, trajectory.times[-1] + slack
    return float(np.mean((times >= first) & (times <= last)))
