"""Poses as formats have them: axes (docs/conventions.md), text, times, and what makes a matrix a pose."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.priors import COORDINATE_MOST_M
from planfit.scan.source import FileSource
from planfit.scan.tables import number_table, read_matrix

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: OpenGL, Blender and ARKit have x right, y up, z backward; ours are x right, y down, z
forward."""

UP_Y = np.array([0.0, 1.0, 0.0])
UP_Z = np.array([0.0, 0.0, 1.0])

ROUNDING = 1e-6
"""Entries of poses that differ by less from 0 or 1 are those: files keep 6 digits or more."""
MAX_ENTRY = COORDINATE_MOST_M.value

BETWEEN_POSES_S = 0.12
"""Poses so far apart tell those between: of a tracker at 10 Hz whose clock is not steady. Of who slows down
by 2 m/s2, the pose in the middle is 4 mm off."""
MAX_NAMED = 8
"""Runs of frames that a warning names."""

MAX_ROTATION_DEFECT = 0.02
"""Largest entry of R^T R - I that is taken for rounding. Recorded poses with four decimals are off
by 1e-4; a matrix that is off by more than this was not a rotation when it was written."""


def check_pose(pose: Float[np.ndarray, "..."], where: str) -> None:
    """Raise `ScanError`, beginning with `where`, unless `pose` is a rigid 4x4 transform up to rounding."""
    if pose.shape != (4, 4):
        raise ScanError(f"{where}: expected a 4x4 pose matrix, found shape {pose.shape}")
    if not (np.isfinite(pose).all() and np.abs(pose).max() < MAX_ENTRY):
        raise ScanError(
            f"{where}: expected finite numbers in the pose, found NaN, infinity or beyond "
            f"{MAX_ENTRY:g}; "
            "remove the frame or repair the tracker's output"
        )
    rotation = pose[:3, :3]
    defect = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if defect > MAX_ROTATION_DEFECT:
        raise ScanError(
            f"{where}: expected a rotation in the pose, found a matrix off by {defect:.3g} "
            f"(at most {MAX_ROTATION_DEFECT}); check for scaled or transposed poses"
        )
    if np.linalg.det(rotation) < 0:
        raise ScanError(
            f"{where}: expected a right-handed pose, found a mirrored one (determinant -1); "
            "check the axes that the poses were exported with"
        )
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > ROUNDING:
        raise ScanError(f"{where}: expected the last row 0 0 0 1, found {pose[3].tolist()}")


def is_lost(pose: Float[np.ndarray, "*n 4 4"]) -> Bool[np.ndarray, "*n"]:
    """Whether a pose is what trackers write while they are lost: NaN, infinity, or zeros for the rotation."""
    is_finite = np.isfinite(pose).all(axis=(-2, -1))
    return np.asarray(
        ~is_finite | ~np.any(pose[..., :3, :3], axis=(-2, -1))
    )  # one pose is no array


def name_lost_frames(ids: Sequence[str], are_lost: Sequence[bool], where: str) -> list[str]:
    """A warning, beginning with `where`, that names frames by their ids; none where no frame is lost."""
    if not any(are_lost):
        return []
    grouped = [
        list(run) for is_out, run in groupby(range(len(ids)), are_lost.__getitem__) if is_out
    ]
    named = [ids[r[0]] if len(r) == 1 else f"{ids[r[0]]}-{ids[r[-1]]}" for r in grouped]
    more = f" and {len(named) - MAX_NAMED} runs more" if len(named) > MAX_NAMED else ""
    return [
        f"{where}: {sum(are_lost)} of {len(ids)} frames have no pose, as the tracker was lost: frames "
        f"{', '.join(named[:MAX_NAMED])}{more} are left out"
    ]


def check_recorded_pose(pose: Float[np.ndarray, "..."], where: str) -> None:
    """As `check_pose`, but a pose of a tracker that was lost will do: its frame is left out later on."""
    if pose.shape != (4, 4) or not is_lost(pose):
        check_pose(pose, where)


def check_recorded_poses(poses: Float[np.ndarray, "n 4 4"], what: str) -> None:
    """As `check_recorded_pose`, of many at once; `what` and its number names the first that is none."""
    rotations = poses[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        defect = np.abs(np.swapaxes(rotations, 1, 2) @ rotations - np.eye(3)).max(axis=(1, 2))
        is_right = np.isfinite(poses).all(axis=(1, 2)) & (
            np.abs(poses).max(axis=(1, 2)) < MAX_ENTRY
        )
        is_right &= (defect <= MAX_ROTATION_DEFECT) & (np.linalg.det(rotations) >= 0)
        is_right &= np.abs(poses[:, 3] - (0, 0, 0, 1)).max(axis=1) <= ROUNDING
    for i in np.flatnonzero(~(is_right | is_lost(poses))):
        check_recorded_pose(poses[i], f"{what} {i}")


def from_opengl(world_from_gl_cams: Float[np.ndarray, "*n 4 4"]) -> Float[np.ndarray, "*n 4 4"]:
    """Poses of cameras with OpenGL axes, as poses of cameras with ours; also the way back."""
    # T diag(s) scales column j by s[j]: as a broadcast product, since in a matrix product infinity (a
    # lost tracker's entry) times 0 would be NaN with a numerical warning.
    return world_from_gl_cams * np.diag(OPENGL_FROM_OPENCV)


def read_pose(source: FileSource, name: str) -> Float[np.ndarray, "4 4"]:
    """A text file of one 4x4 pose; NaN throughout where the tracker was lost (NaN, infinity or zeros in it).

    Raises:
        ScanError: the file is no 4x4 pose.
    """
    pose = read_matrix(source, name, "a 4x4 matrix of numbers")
    if pose.shape == (4, 4) and is_lost(pose):
        return np.full((4, 4), np.nan)
    check_pose(pose, str(source.path / name))
    return pose


def write_pose(path: Path, world_from_cam: Float[np.ndarray, "4 4"]) -> None:
    """Write one 4x4 pose as text."""
    path.write_text("\n".join(" ".join(f"{v:.9f}" for v in row) for row in world_from_cam) + "\n")


def read_tum(path: Path) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 4 4"]]:
    """Timestamps and poses of a trajectory in the TUM form: `time tx ty tz qx qy qz qw`, one pose a line.

    Raises:
        ScanError: the file is missing, empty, or not eight numbers a line.
    """
    if not path.exists():
        raise ScanError(f"{path}: expected a TUM trajectory, found nothing; check the path")
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise ScanError(f"{path}: expected a TUM trajectory as text, found {error}") from error
    return parse_tum(text, path)


def parse_tum(
    content: str, path: Path
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 4 4"]]:
    """As `read_tum`, of the text of a file; `path` is where it came from, for messages.

    Lines of a tracker that was lost (NaN, infinity, or a quaternion of zeros) are left out.

    Raises:
        ScanError: it is empty, or not eight numbers a line.
    """
    return tum_poses(number_table(content), content, path)


def tum_poses(
    values: Float[np.ndarray, "rows columns"] | None, content: str, path: Path
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 4 4"]]:
    """As `parse_tum`, of the numbers in a file; where they are none, its text says which line is not."""
    if values is None or not _is_tum(values):
        values = _tum_line_by_line(content, path)
    # Lines of a tracker that was lost: as if it had written nothing.
    is_kept = np.isfinite(values).all(axis=1) & (np.abs(values[:, 4:]).max(axis=1) >= ROUNDING)
    values = values[is_kept]
    if len(values) == 0:
        raise ScanError(f"{path}: expected a TUM trajectory, found no pose")
    rotations = Rotation.from_quat(values[:, 4:]).as_matrix()
    return values[:, 0], se3.make_transform(rotations, values[:, 1:4])


def _is_tum(values: Float[np.ndarray, "rows columns"]) -> bool:
    """Whether all rows are what a TUM trajectory may hold, a lost tracker's among them."""
    if values.shape[1] != 8 or not np.isfinite(values[:, 0]).all():
        return False
    is_lost_row = ~np.isfinite(values).all(axis=1)
    return bool(np.all(is_lost_row | (np.abs(values[:, 1:]).max(axis=1) < MAX_ENTRY)))


def _tum_line_by_line(content: str, path: Path) -> Float[np.ndarray, "n 8"]:
    """As slow as it is, to name the line that is none.

    Raises:
        ScanError: a line is not eight numbers.
    """
    rows = []
    for number, line in enumerate(content.splitlines(), start=1):
        text = line.split("#")[0].split()
        if not text:
            continue
        try:
            row = [float(v) for v in text]
        except ValueError:
            row = []
        ok = len(row) == 8 and np.isfinite(row[0])
        is_lost_row = ok and not np.isfinite(row).all()
        if not ok or (not is_lost_row and np.abs(row[1:]).max() >= MAX_ENTRY):
            raise ScanError(
                f"{path}, line {number}: expected eight finite numbers "
                f"(time tx ty tz qx qy qz qw), found {line.strip()[:80]!r}"
            )
        rows.append(row)
    return np.array(rows).reshape(-1, 8)


def write_tum(
    path: Path, timestamps: Float[np.ndarray, " n"], target_from_cams: Float[np.ndarray, "n 4 4"]
) -> None:
    """Write a trajectory in the TUM form."""
    quaternions_xyzw = Rotation.from_matrix(target_from_cams[:, :3, :3]).as_quat(canonical=True)
    rows = np.concatenate([target_from_cams[:, :3, 3], quaternions_xyzw], axis=1)
    lines = [
        # As many digits as the time has: seconds since 1970 with microseconds have sixteen.
        np.format_float_positional(time, trim="-") + " " + " ".join(f"{v:.9f}" for v in row)
        for time, row in zip(timestamps, rows, strict=True)
    ]
    path.write_text("\n".join(lines) + "\n")


def contradicts_path(times: Float[np.ndarray, " n"], positions: Float[np.ndarray, "n 3"]) -> bool:
    """Whether the path is longer in the order of times than as listed: they are of several clocks, or are
    durations."""
    by_time = positions[np.argsort(times, kind="stable")]
    as_listed_m, by_time_m = (
        np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (positions, by_time)
    )
    return bool(by_time_m > as_listed_m)


def are_of_a_clock(times: Float[np.ndarray, " n"], positions: Float[np.ndarray, "n 3"]) -> bool:
    """Whether times tell the order of positions: they do not repeat, nor contradict the path."""
    return len(np.unique(times)) == len(times) and not contradicts_path(times, positions)


def pair_times(
    times: Float[np.ndarray, " n"], other_times: Float[np.ndarray, " m"], max_gap_s: float
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Indices into both sequences of what belongs together, each at most once, in order of `times`.

    Nearest pairs are taken first, as the tool of the TUM benchmark does. Times in s, in any order.
    """
    order = np.argsort(other_times, kind="stable")
    other = other_times[order]
    # searchsorted gives the first that is not earlier: at -1 and 0 are its neighbours in time, and at -2
    # and 1 one more on each side, since the nearest may be taken by a nearer partner.
    at = np.searchsorted(other, times)[:, None] + np.arange(-2, 2)
    valid = (at >= 0) & (at < len(other))
    gap = np.abs(other[np.clip(at, 0, len(other) - 1)] - times[:, None])
    rows, columns = np.nonzero(valid & (gap <= max_gap_s))
    nearest_first = np.argsort(gap[rows, columns], kind="stable")
    taken, taken_other = set(), set()
    pairs = []
    for k in nearest_first:
        i, j = int(rows[k]), int(order[at[rows[k], columns[k]]])
        if i not in taken and j not in taken_other:
            taken.add(i)
            taken_other.add(j)
            pairs.append((i, j))
    found = np.array(sorted(pairs), dtype=int).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def join_times(
    times: Float[np.ndarray, " n"], other_times: Float[np.ndarray, " m"], max_gap_s: float
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Indices into both sequences, by time: what belongs together once, and all that stands alone, with -1 in
    place of the other; with them the times, of the first where it is there. See `pair_times`."""
    paired, other = pair_times(times, other_times, max_gap_s)
    alone, other_alone = (
        np.setdiff1d(np.arange(len(t)), of) for t, of in ((times, paired), (other_times, other))
    )
    i = np.concatenate([paired, alone, np.full(len(other_alone), -1)])
    j = np.concatenate([other, np.full(len(alone), -1), other_alone])
    of = np.concatenate([times[paired], times[alone], other_times[other_alone]])
    order = np.argsort(of, kind="stable")
    return i[order], j[order], of[order]


def poses_at(
    times: Float[np.ndarray, " n"],
    poses: Float[np.ndarray, "n 4 4"],
    at: Float[np.ndarray, " k"],
    max_gap_s: float,
) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"]]:
    """Poses at the times `at`, and which of them are known.

    A pose is known where one was recorded within `max_gap_s`, or one before and one after within six times
    that and `BETWEEN_POSES_S` of each other. It is interpolated unless its neighbours are more than six times
    `max_gap_s` apart: a tracker that runs at 100 Hz is off by up to 5 ms otherwise, millimetres at a walk.
    Where none is known the pose is the identity.
    """
    order = np.argsort(times, kind="stable")
    times, poses = times[order], poses[order]
    after = np.clip(np.searchsorted(times, at), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    gap_before, gap_after = np.abs(at - times[before]), np.abs(times[after] - at)
    gap = np.minimum(gap_before, gap_after)
    is_between = (times[before] <= at) & (at <= times[after]) & (times[before] < times[after])
    interval = times[after] - times[before]
    is_between &= interval <= 6 * max_gap_s
    known = (gap <= max_gap_s) | (is_between & (interval <= min(6 * max_gap_s, BETWEEN_POSES_S)))
    total = np.where(is_between, interval, 1.0)
    # How far on the way from the pose before (0) to that after (1); the nearer of both where that is too far.
    share = np.where(is_between, gap_before / total, np.where(gap_before < gap_after, 0.0, 1.0))
    result = se3.interpolate(poses[before], poses[after], share)
    result[~known] = np.eye(4)
    return result, known


def followed(
    old: dict[int, Float[np.ndarray, "4 4"]], new: dict[int, Float[np.ndarray, "4 4"]]
) -> dict[int, Float[np.ndarray, "4 4"]]:
    """All poses after some of them got new ones: each of the others keeps its place beside the last (else the
    next) of those in the order of their numbers. Nothing where none is new."""
    anchors = np.array(sorted(n for n in new if n in old and not is_lost(old[n])), dtype=int)
    if not len(anchors):
        return {}
    result = {}
    for number, pose in old.items():
        anchor = int(anchors[max(0, np.searchsorted(anchors, number, side="right") - 1)])
        moved = new[anchor] @ se3.inverse(old[anchor]) @ pose
        result[number] = new.get(number, moved)
    return result
