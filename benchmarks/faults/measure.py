"""One case: planfit run on it, and what came of it beside the truth."""

import time
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import planfit
from faults.cases import FAULTS, Case
from faults.inputs import Inputs
from faults.optimality import compare_with_truth
from faults.scans import SHARED, all_scans, drifted, keep_images
from faults.words import moved_walls_found, outcome_of, predicted_errors_m, recognised
from planfit.errors import PlanfitError
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.runtime import Runtime

REFUSED, CRASHED = 2, 3


@dataclass(frozen=True)
class Measured:
    """What came of a case."""

    number: int
    name: str
    digest: str
    """Of the code and of the options that it was measured with."""
    exit_code: int
    """As the command line gives it: 0, 1, 2; 3 for a crash."""
    said: str = ""
    """The outcome in words, or the sentence of the error."""
    before_m: float | None = None
    """RMS error of the recorded positions, put on the true plan by the true axes of the world."""
    error_m: float | None = None
    """RMS error of the refined positions on the plan, without alignment to the truth."""
    aligned_m: float | None = None
    """The same after the rigid motion that brings them closest."""
    largest_m: float | None = None
    """Largest error of a frame."""
    scale_error: float | None = None
    """Of the plan in the end: at the scale that was taken, or that was named as fitting better."""
    warnings: tuple[str, ...] = ()
    convention: str = ""
    """The wrong convention that the poses were given in."""
    is_recognised: bool | None = None
    """Whether it was named; None where poses were as they should be and nothing else was claimed."""
    moved_seen: int = 0
    """Moved walls that three pieces or more were seen of."""
    moved_named: int = 0
    """Of those, named as moved with an offset within 3 cm."""
    predicted_m: float | None = None
    """RMS of the errors that the run predicts for its frames."""
    within_predicted: float | None = None
    """Share of frames whose error is within twice what was predicted."""
    cost: float | None = None
    """Full cost, see `optimality.py`; taken where it is asked for."""
    cost_from_truth: float | None = None
    """The same, solved from the true poses."""
    true_error_m: float | None = None
    """Error of that solution."""
    seconds: float = 0.0


@dataclass(frozen=True)
class How:
    """How cases are measured."""

    cache_dir: Path
    """Folder for images that are rendered once, and for keypoints, which no pose changes."""
    digest: str
    options: planfit.RefineOptions = field(default_factory=planfit.RefineOptions)
    is_optimality: bool = False
    """Also solve from the true poses."""


class KeypointsKept(Runtime):
    """Keeps keypoints alone: all else depends on the poses, which differ in every case."""

    def _folder(self, stage: str, key: str) -> Path | None:
        return super()._folder(stage, key) if stage == "keypoints" else None


def measure(case: Case, how: How) -> Measured:
    """Run planfit on a case. What a user should be told is recorded as refused, other errors as crashed."""
    begin = time.perf_counter()
    measured = Measured(case.number, case.name, how.digest, CRASHED, convention=convention_of(case))
    try:
        measured = _measure(case, how, measured)
    except PlanfitError as error:
        claim = recognised(measured.convention, str(error))
        measured = replace(
            measured, exit_code=REFUSED, said=_without_folder(error), is_recognised=claim
        )
    except Exception as error:  # whatever it is: the battery goes on, and says so
        measured = replace(measured, said=f"{type(error).__name__}: {error}")
    return replace(measured, seconds=round(time.perf_counter() - begin, 2))


@lru_cache(maxsize=1)
def base_inputs(scan: str, cache_dir: Path) -> Inputs:
    """A scan with its true poses, images kept."""
    base = all_scans()[scan]
    inputs = base.make()
    if base.is_rendered:
        inputs = replace(inputs, scan=keep_images(inputs.scan, cache_dir / "images"))
    return inputs


def _measure(case: Case, how: How, nothing: Measured) -> Measured:
    inputs = case.spoil(drifted(base_inputs(case.scan, how.cache_dir), case.drift_seed))
    runtime = KeypointsKept(workers=1, cache_dir=how.cache_dir)
    plan = inputs.floorplan if inputs.has_plan else None
    result = planfit.refine(inputs.scan, plan, how.options, runtime)
    measured = judge(inputs, result, nothing)
    is_comparable = inputs.has_plan and inputs.has_place and not measured.convention
    if not (how.is_optimality and is_comparable):
        return measured
    cost, cost_from_truth, true_error_m = compare_with_truth(inputs, result, how.options)
    return replace(measured, cost=cost, cost_from_truth=cost_from_truth, true_error_m=true_error_m)


def judge(inputs: Inputs, result: RefineResult, nothing: Measured) -> Measured:
    """A result beside the truth; without a plan, positions are first brought as close to it as can be."""
    truth, before = inputs.true_positions(), inputs.recorded_in_true_plan()
    found, plan = result.plan_from_cams[:, :3, 3], result.floorplan
    if plan is not None:
        found = inputs.in_true_plan(found, plan)
    else:
        before, found = (brought_to(positions, truth) for positions in (before, found))
    errors = np.linalg.norm(found - truth, axis=1)
    exit_code, said = outcome_of(result)
    heard = " ".join([said, *result.warnings])
    predicted = predicted_errors_m(result)
    seen, named = moved_walls_found(inputs, result)
    claims = recognised(nothing.convention, heard, result)
    return replace(
        nothing,
        exit_code=exit_code,
        said=said,
        before_m=_rms(np.linalg.norm(before - truth, axis=1)),
        error_m=_rms(errors),
        aligned_m=_rms(np.linalg.norm(brought_to(found, truth) - truth, axis=1)),
        largest_m=float(errors.max()),
        scale_error=None if plan is None else scale_error_of(inputs, result, plan),
        warnings=result.warnings,
        is_recognised=claims,
        moved_seen=seen,
        moved_named=named,
        predicted_m=None if predicted is None else _rms(predicted),
        within_predicted=None if predicted is None else float(np.mean(errors <= 2 * predicted)),
    )


def scale_error_of(inputs: Inputs, result: RefineResult, plan: Floorplan) -> float:
    """Error of the plan's scale, as a share: of the one taken, or of the one named as fitting better."""
    other = None if result.alignment is None else result.alignment.other_scale
    factor = 1.0 if other is None else other.metres_per_unit
    return factor * (1.0 + inputs.scale_error(plan)) - 1.0


def convention_of(case: Case) -> str:
    """The wrong convention that a case puts the poses in; empty where they are as they should be."""
    for part in case.parts:
        fault = FAULTS[part.fault]
        if fault.group == "convention":
            return fault.conventions[part.size]
    return ""


def brought_to(positions: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Positions (n, 3) after the rigid motion that brings them closest to the true ones."""
    return se3.transform(se3.fit_rigid(positions, truth), positions)


def _rms(distances: np.ndarray) -> float:
    return float(np.sqrt(np.mean(distances**2)))


def as_json(measured: Measured) -> dict:
    """Plain values, metres to a tenth of a millimetre."""
    values = asdict(measured)
    return {
        name: round(value, 4) if isinstance(value, float) and abs(value) < 1e6 else value
        for name, value in values.items()
    }


def _without_folder(error: Exception) -> str:
    """What is said, without where the real scans lie on this machine."""
    return str(error).replace(f"{SHARED}/", "")
