"""The scan before and after, storey by storey, where each has a plan of its own."""

from dataclasses import dataclass

from planfit.floorplan import Floorplan
from planfit.pipeline.on_plan import Storey
from planfit.pipeline.result import RefineResult
from planfit.report.measures import BeforeAfter, measure


@dataclass(frozen=True)
class StoreyMeasures:
    """A storey with its plan, and the part of the scan on it."""

    number: int
    storey: Storey
    floorplan: Floorplan
    """Its faces in the plan frame."""
    both: BeforeAfter
    """Of the walls that its frames see; cameras elsewhere have no place."""


def measure_storeys(result: RefineResult) -> tuple[StoreyMeasures, ...]:
    """Storeys with a plan, from the lowest; none where the whole scan is on one plan."""
    if result.storeys is None or result.floorplan is None:
        return ()
    found = []
    for k, own in result.storeys.with_plan.items():
        frames = result.storeys.of_frames == k
        plan = result.floorplan.of_storey(k)
        both = measure(plan, result, frames=frames)
        found.append(StoreyMeasures(own.number, result.storeys.walked[k], plan, both))
    return tuple(found)
