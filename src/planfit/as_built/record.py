"""Verdicts as plain values, and back: `as_built.json` of a run."""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from planfit.as_built.openings import AsBuiltOpening
from planfit.as_built.types import AsBuilt, AsBuiltOptions, AsBuiltWall
from planfit.errors import ScanError
from planfit.runtime import options_of

AS_BUILT = "as_built.json"
DAMAGES = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)
"""What comes of values of another kind, size or depth than a run writes."""


def as_built_record(as_built: AsBuilt) -> dict[str, Any]:
    """All of it as plain values; the verdicts, which follow from the rest, for readers."""
    matrix = as_built.file_from_plan
    return {
        "plan": as_built.plan_name,
        "file_from_plan": None if matrix is None else matrix.tolist(),
        "elevation_m": as_built.elevation_m,
        "options": asdict(as_built.options),
        "walls": [
            {
                "verdict": as_built.verdict(wall).value,
                "face": wall.face_idx,
                "element_id": wall.element_id,
                "is_glass": wall.is_glass,
                "ends": wall.ends.tolist(),
                "normal": wall.normal.tolist(),
                "is_oriented": wall.is_oriented,
                "offset_m": wall.offset_m if wall.is_standing else None,
                "sigma_m": wall.sigma_m if wall.is_standing else None,
                "patches": wall.n_patches,
                "frames": wall.n_frames,
                "through_share": wall.through_share,
            }
            for wall in as_built.walls
        ],
        "openings": [
            {
                "verdict": opening.verdict.value,
                "is_drawn": opening.is_drawn,
                "kind": opening.kind,
                "element_id": opening.element_id,
                "ends": opening.ends.tolist(),
                "normal": opening.normal.tolist(),
                "thickness_m": opening.thickness_m,
                "open_share": opening.open_share,
                "closed_share": opening.closed_share,
                "through_frames": opening.n_through_frames,
                "surface_frames": opening.n_surface_frames,
                "edges_m": [_known(value) for value in opening.edges_m],
                "edge_sigmas_m": [_known(value) for value in opening.edge_sigmas_m],
                "closed_by": opening.word_of_closing,
                "set_back_m": [_known(value) for value in opening.set_back_m],
                "set_back_sigmas_m": [_known(value) for value in opening.set_back_sigmas_m],
            }
            for opening in as_built.openings
        ],
    }


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def write_as_built(path: Path, as_built: AsBuilt) -> None:
    """Write the record.

    Raises:
        OSError: it cannot be written.
    """
    text = json.dumps(as_built_record(as_built), indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_as_built(folder: Path) -> AsBuilt:
    """The verdicts of a run.

    Raises:
        ScanError: the folder has none, or a damaged file.
    """
    path = folder / AS_BUILT
    if not path.is_file():
        raise ScanError(
            f"{path}: expected the walls of a run as built, found nothing; give the output folder of "
            "'planfit refine' with a plan that the scan was aligned with, made by this version"
        )
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        matrix = record["file_from_plan"]
        return AsBuilt(
            tuple(_wall(row) for row in record["walls"]),
            _options(record["options"], f"{path}: "),
            str(record["plan"]),
            None if matrix is None else np.array(matrix, dtype=float).reshape(3, 3),
            float(record["elevation_m"]),
            # Runs of versions before these were judged have none.
            tuple(_opening(row) for row in record.get("openings", ())),
        )
    except (*DAMAGES, OSError) as error:
        raise ScanError(
            f"{path}: expected the walls of a run as built, found a damaged file; run 'planfit refine' again"
        ) from error


def _options(values: Mapping[str, Any], where: str) -> AsBuiltOptions:
    # Runs of older versions name options that are none any more; their verdicts stand as they were.
    known = {one.name: values[one.name] for one in fields(AsBuiltOptions) if one.name in values}
    return options_of(known, AsBuiltOptions(), where)


def _wall(row: Mapping[str, Any]) -> AsBuiltWall:
    return AsBuiltWall(
        face_idx=int(row["face"]),
        ends=np.array(row["ends"], dtype=float).reshape(2, 2),
        normal=np.array(row["normal"], dtype=float).reshape(2),
        is_oriented=bool(row["is_oriented"]),
        offset_m=_number(row["offset_m"]),
        sigma_m=_number(row["sigma_m"]),
        n_patches=int(row["patches"]),
        n_frames=int(row["frames"]),
        through_share=float(row["through_share"]),
        element_id=str(row["element_id"]),
        is_glass=bool(row.get("is_glass", False)),
    )


def _opening(row: Mapping[str, Any]) -> AsBuiltOpening:
    return AsBuiltOpening(
        is_drawn=bool(row["is_drawn"]),
        ends=np.array(row["ends"], dtype=float).reshape(2, 2),
        normal=np.array(row["normal"], dtype=float).reshape(2),
        thickness_m=float(row["thickness_m"]),
        open_share=float(row["open_share"]),
        closed_share=float(row["closed_share"]),
        n_through_frames=int(row["through_frames"]),
        n_surface_frames=int(row["surface_frames"]),
        edges_m=_pair(row["edges_m"]),
        edge_sigmas_m=_pair(row["edge_sigmas_m"]),
        # Runs of versions before these were looked at have none.
        set_back_m=_pair(row.get("set_back_m", (None, None))),
        set_back_sigmas_m=_pair(row.get("set_back_sigmas_m", (None, None))),
        kind=str(row["kind"]),
        element_id=str(row["element_id"]),
    )


def _pair(values: Any) -> tuple[float, float]:
    first, second = (_number(value) for value in values)
    return first, second


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)
