"""Options as TOML and plain values; tables of a run (CSV), and what its record says of the same: how far each
pose may be off, residuals of the registration, residuals of control and check points."""

import dataclasses
import math
from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.uncertainty import radius_95
from planfit.findings import Finding, finding_record, sentences_of
from planfit.pipeline.registration import Registration
from planfit.pipeline.survey_residuals import contradicted_points
from planfit.scan import Scan, ScanOptions
from planfit.survey import RoleResiduals, SurveyResiduals

FILES_OF_SCAN = ("poses", "calibration")
"""Fields of `ScanOptions` that are paths."""


def to_toml(options: Any) -> str:
    """Options dataclass as TOML text."""
    return "\n".join(_toml_lines(plain(options), ())) + "\n"


def plain(value: Any) -> Any:
    """Dataclasses, enumerations and tuples as dictionaries, names and lists."""
    if isinstance(value, Finding):
        return finding_record(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {field.name: plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return value


def finite(value: float | None) -> float | None:
    """A number for JSON, which has no NaN and no infinity; None in their place."""
    return None if value is None or not math.isfinite(value) else float(value)


def finite_plain(value: Any) -> dict[str, Any]:
    """A dataclass as `plain` has it, of whose own numbers those that are not finite are None."""
    fields = plain(value).items()
    return {name: finite(one) if isinstance(one, float) else one for name, one in fields}


def scan_options_record(options: ScanOptions) -> dict[str, Any]:
    """How a scan was read as plain values; relative paths of files would lead nowhere later."""
    values = dataclasses.asdict(options)
    for name in FILES_OF_SCAN:
        values[name] = str(values[name].resolve()) if values[name] else None
    return values


def _toml_lines(values: dict[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [f"[{'.'.join(path)}]"] if path else []
    lines += [f"{k} = {_toml(v)}" for k, v in values.items() if not isinstance(v, dict)]
    for name, value in values.items():
        if isinstance(value, dict):
            lines += ["", *_toml_lines(value, (*path, name))]
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)


SIGMA_HEADER = (
    "frame,timestamp,sigma_x_m,sigma_y_m,sigma_z_m,sigma_rotation_deg,radius_95_m,held_by"
)
"""Columns of `trajectory_sigma.csv`, as docs/outputs.md has them."""


def write_sigmas(
    path: Path,
    scan: Scan,
    covariances: Float[np.ndarray, "n 6 6"],
    keyframe_idx: Int[np.ndarray, " k"],
) -> None:
    """Write `trajectory_sigma.csv`, of pose covariances [rad^2, rad m, m^2], tangents (rotation,
    translation), axes of the plan. Frames but keyframes follow these by the recorded motion.

    Raises:
        OSError: it cannot be written.
    """
    held_by = np.full(len(scan), "recorded motion", dtype=object)
    for k in keyframe_idx:
        held_by[k] = {"": "images", "colour": "depth"}.get(scan.lacking[k], held_by[k])
    if not scan.has_color:
        held_by[keyframe_idx] = "depth"
    held_by = [
        f"{by} (no {lacks})" if lacks else by
        for by, lacks in zip(held_by, scan.lacking, strict=True)
    ]
    variances = np.einsum("nii->ni", covariances)
    rotation_deg = np.rad2deg(np.sqrt(variances[:, :3].sum(axis=1)))
    table = np.column_stack(
        [np.sqrt(variances[:, 3:]), rotation_deg, radius_95(covariances[:, 3:, 3:])]
    )
    lines = [
        f"{k},{time:.9g}," + ",".join(f"{value:.6f}" for value in row) + f",{by}"
        for k, (time, row, by) in enumerate(zip(scan.timestamps, table, held_by, strict=True))
    ]
    _write_lines(path, [SIGMA_HEADER, *lines])


REGISTRATION_HEADER = "residual,unit,before,fit,held_out,count"
"""Columns of `registration.csv`, as docs/outputs.md has them."""


def write_registration(path: Path, registration: Registration) -> None:
    """Write `registration.csv`.

    Raises:
        OSError: it cannot be written.
    """
    lines = [REGISTRATION_HEADER]
    for row in registration.rows:
        numbers = (row.before, row.fit, row.held_out)
        lines.append(_line(row.name, row.unit, numbers, row.count))
    for loop in registration.loops:
        (a, b), (c, d) = loop.first_frames, loop.last_frames
        name = f"loop of frames {a}-{b} and {c}-{d}"
        amounts = (
            ("median distance", loop.before_m, loop.after_m, loop.kept_out_m),
            ("mean distance", None, loop.mean_m, None),
            ("length of way", None, loop.way_m, None),
        )
        lines += [
            _line(f"{name}, {what}", "m", numbers, loop.n_points) for what, *numbers in amounts
        ]
    for link in registration.links:
        (a, b), (c, d) = link.first_frames, link.last_frames
        name = f"link of frames {a}-{b} and {c}-{d}"
        distances, overlap = (link.before_m, link.after_m, None), (None, link.overlap, None)
        lines.append(_line(f"{name}, mean distance", "m", distances, link.n_points))
        lines.append(_line(f"{name}, overlap", "share", overlap, link.n_pairs))
    for each in registration.strength:
        lines.append(f'"{each.direction}, predicted sigma",{each.unit},,,{each.sigma:.6f},')
        lines += [
            f'"{each.direction}, fixed by {name}",share,,{share:.6f},,'
            for name, share in each.shares
        ]
    accuracy = {
        "accuracy at 95 %, predicted": registration.predicted_95_m,
        "accuracy at 95 %, by check points": registration.checked_95_m,
        f"accuracy at 95 %, stated {registration.loa}".strip(): registration.stated_95_m,
    }
    for name, value in accuracy.items():
        if value is not None and math.isfinite(value):
            lines.append(f'"{name}",m,,,{value:.6f},')
    _write_lines(path, lines)


def _line(name: str, unit: str, numbers: Iterable[float | None], count: int) -> str:
    cells = ["" if v is None or not math.isfinite(v) else f"{v:.6f}" for v in numbers]
    quoted = name.replace('"', '""')
    return ",".join([f'"{quoted}"', unit, *cells, str(count)])


def registration_record(registration: Registration) -> dict[str, Any]:
    """For `run.json`."""
    return {
        "residuals": [finite_plain(row) for row in registration.rows],
        "strength": {
            each.direction: {
                "sigma": finite(each.sigma),
                "unit": each.unit,
                "shares": dict(each.shares),
                "weakest_frames": list(each.weakest_frames),
                "weakest_share": finite(each.weakest_share),
            }
            for each in registration.strength
        },
        "predicted_95_m": finite(registration.predicted_95_m),
        "checked_95_m": finite(registration.checked_95_m),
        "stated_95_m": finite(registration.stated_95_m),
        "usibd_loa": registration.loa or None,
        "basis": registration.basis,
    }


SURVEY_HEADER = (
    "id,role,marks,given_x,given_y,given_z,plan_x_m,plan_y_m,plan_z_m,dx_m,dy_m,dz_m,horizontal_m,length_m,"
    "sigma_m,left_out_dx_m,left_out_dy_m,left_out_dz_m,left_out_m,left_out_sigma_m,left_out_sigmas,contradicted"
)
"""Columns of `control_points.csv`, as docs/outputs.md has them."""


def write_survey(path: Path, survey: SurveyResiduals) -> None:
    """Write `control_points.csv`.

    Raises:
        OSError: it cannot be written.
    """
    lines = [SURVEY_HEADER]
    for point in survey.points:
        role = "check" if point.is_check else "control"
        numbers = [
            *point.given,
            *point.surveyed,
            *point.residual_m,
            point.horizontal_m,
            point.length_m,
            point.sigma_m,
            *(np.full(3, np.nan) if point.left_out_m is None else point.left_out_m),
            point.left_out_length_m,
            point.left_out_sigma_m,
            point.left_out_sigmas,
        ]
        cells = [f"{v:.6f}" if np.isfinite(v) else "" for v in numbers]
        name = (
            point.id if not set(point.id) & set(',"') else '"' + point.id.replace('"', '""') + '"'
        )
        contradicted = "" if point.is_check else "yes" if point.is_contradicted else "no"
        lines.append(",".join([name, role, str(point.n_marks), *cells, contradicted]))
    _write_lines(path, lines)


def survey_record(survey: SurveyResiduals) -> dict[str, Any]:
    """Residuals by role and by point, and where the survey lies, for `run.json`."""
    site = survey.site_from_plan
    return {
        "axes": survey.axes,
        "height_of_floor_m": survey.height_datum_m,
        "site_from_plan": None if site is None else site.tolist(),
        "site_origin_m": None if site is None else survey.site_origin.tolist(),
        "control": _role_record(survey.control),
        "control_left_out": _role_record(survey.left_out),
        "check": _role_record(survey.check),
        "points": [
            {
                "id": point.id,
                "role": "check" if point.is_check else "control",
                "marks": point.n_marks,
                "residual_m": [finite(v) for v in point.residual_m],
                "sigma_m": point.sigma_m,
                "left_out_m": None
                if point.left_out_m is None
                else [finite(v) for v in point.left_out_m],
                "left_out_sigma_m": finite(point.left_out_sigma_m),
                "left_out_sigmas": finite(point.left_out_sigmas),
                "is_contradicted": point.is_contradicted,
                "swapped_with": point.swapped_with or None,
            }
            for point in survey.points
        ],
        "contradicted": list(sentences_of(contradicted_points(survey.points))),
        "unseen": list(survey.unseen),
    }


def _role_record(role: RoleResiduals | None) -> dict[str, Any] | None:
    if role is None:
        return None
    return {
        "count": role.count,
        "rms_m": role.rms_m,
        "rms_horizontal_m": role.rms_horizontal_m,
        "rms_height_m": role.rms_height_m,
        "worst_m": role.worst_m,
        "worst": role.worst_id,
    }


def _write_lines(path: Path, lines: Iterable[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
