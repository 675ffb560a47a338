"""Trajectories in the TUM text form: `time tx ty tz qx qy qz qw`, one pose a line."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.types import MAX_ENTRY


def read_tum(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read timestamps (n,) and poses (n, 4, 4).

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


def parse_tum(content: str, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """As `read_tum`, of the text of a file; `path` is where it came from, for messages.

    Raises:
        ScanError: it is empty, or not eight numbers a line.
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
        ok = len(row) == 8 and np.isfinite(row).all() and np.abs(row[1:]).max() < MAX_ENTRY
        if not ok or np.abs(row[4:]).max() < 1e-6:
            raise ScanError(
                f"{path}, line {number}: expected eight finite numbers "
                f"(time tx ty tz qx qy qz qw), found {line.strip()[:80]!r}"
            )
        rows.append(row)
    if not rows:
        raise ScanError(f"{path}: expected a TUM trajectory, found no pose")
    values = np.array(rows)
    rotations = Rotation.from_quat(values[:, 4:]).as_matrix()
    return values[:, 0], se3.make_transform(rotations, values[:, 1:4])


def write_tum(path: Path, timestamps: np.ndarray, target_from_cams: np.ndarray) -> None:
    """Write timestamps (n,) and poses (n, 4, 4)."""
    quaternions_xyzw = Rotation.from_matrix(target_from_cams[:, :3, :3]).as_quat(canonical=True)
    rows = np.concatenate([target_from_cams[:, :3, 3], quaternions_xyzw], axis=1)
    lines = [
        # As many digits as the time has: seconds since 1970 with microseconds have sixteen.
        np.format_float_positional(time, trim="-") + " " + " ".join(f"{v:.9f}" for v in row)
        for time, row in zip(timestamps, rows, strict=True)
    ]
    path.write_text("\n".join(lines) + "\n")
