"""The verified matches of a run, as it found them: what its pose graph and its COLMAP model are made of."""

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from planfit.errors import OutputError
from planfit.matching import Matches

MATCHES = "matches.npz"


def write_matches(path: Path, matches: Matches) -> None:
    """`pairs` (p, 2) frames, `start` (p + 1,), `points_a`, `points_b` (m, 3) [m, cameras of the pair's first
    and second frame], `sigma` (m,) [m]: matches of pair k are start[k]:start[k + 1].
    """
    np.savez_compressed(
        path,
        pairs=matches.pairs.astype(np.int32),
        start=matches.start.astype(np.int64),
        points_a=matches.points_a.astype(np.float32),
        points_b=matches.points_b.astype(np.float32),
        sigma=matches.sigma.astype(np.float32),
    )


def read_matches(folder: Path) -> Matches | None:
    """Those of the run in a folder; None where it wrote none, as runs of older versions.

    Raises:
        OutputError: the file is damaged.
    """
    path = folder / MATCHES
    if not path.is_file():
        return None
    try:
        # numpy leaves a file open that it cannot read.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            pairs, start = stored["pairs"], stored["start"]
            points = [stored[name].astype(float) for name in ("points_a", "points_b", "sigma")]
        if start.shape != (len(pairs) + 1,) or {len(p) for p in points} != {int(start[-1])}:
            raise ValueError("tables of different lengths")
    except (OSError, ValueError, KeyError, EOFError, IndexError, BadZipFile) as error:
        raise OutputError(
            f"{path}: expected the matches of a run, found a damaged file ({error}); run planfit "
            "refine again"
        ) from error
    return Matches(pairs, start, *points, n_tried=len(pairs), n_keypoints=0)
