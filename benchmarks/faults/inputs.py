"""What planfit is given, and the truth about it."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.scan import Scan
from planfit.synth import Building, DriftOptions, Renderer, SynthOptions


@dataclass(frozen=True)
class MovedWall:
    """A wall that the plan draws elsewhere than it was built."""

    face_idx: Int[np.ndarray, " k"]
    """Its faces in the plan as given."""
    as_built_m: Float[np.ndarray, "2"]
    """From where the plan draws it to where it stands, true plan frame."""


DRIFT = DriftOptions(yaw_deg=0.15, translation_m=0.02)
"""Of recorded poses before they are spoilt; as measured on ConSLAM."""


@dataclass(frozen=True)
class Rendered:
    """What the images of a synthetic scan are made of."""

    building: Building
    renderer: Renderer
    true_plan_from_cams: Float[np.ndarray, "n 4 4"]
    options: SynthOptions


@dataclass(frozen=True)
class Inputs:
    """A scan and a plan as planfit is given them, spoilt or not, and the truth about both."""

    scan: Scan
    floorplan: Floorplan
    true_world_from_cams: Float[np.ndarray, "n 4 4"]
    """In the axes that the poses were recorded in before anything was spoilt."""
    true_plan_from_world: Float[np.ndarray, "4 4"]
    """To the true plan, m."""
    given_from_true: Float[np.ndarray, "2 2"] = field(default_factory=lambda: np.eye(2))
    """From the true plan to the plan as given: another scale, mirrored."""
    moved_walls: tuple[MovedWall, ...] = ()
    has_place: bool = True
    """Whether the scan has a place on the plan; not on that of another building."""
    has_plan: bool = True
    """Whether planfit is given the plan."""
    rendered: Rendered | None = None
    """Of a synthetic scan."""
    drift: DriftOptions = DRIFT
    """Of recorded poses before they are spoilt; less a frame where there are more frames a second."""

    @cached_property
    def up_world(self) -> Float[np.ndarray, "3"]:
        """Unit vector against gravity, true world."""
        return self.true_plan_from_world[2, :3]

    def with_poses(self, world_from_cams: Float[np.ndarray, "n 4 4"]) -> "Inputs":
        """The same scan with other recorded poses.

        Raises:
            ScanError: no scan can have them.
        """
        return replace(self, scan=replace(self.scan, world_from_cams=world_from_cams))

    def with_faces(
        self,
        ends: Float[np.ndarray, "k 2 2"],
        normals: Float[np.ndarray, "k 2"],
        is_oriented: np.ndarray,
    ) -> "Inputs":
        """The same scan on a plan of other faces."""
        content = b"".join(array.tobytes() for array in (ends, normals, is_oriented))
        plan = replace(
            self.floorplan,
            ends=ends,
            normals=normals,
            is_oriented=is_oriented,
            thickness=None,
            openings=None,
            fingerprint=hashlib.sha256(content).hexdigest()[:16],
        )
        return replace(self, floorplan=plan)

    def recorded_in_true_plan(self) -> Float[np.ndarray, "n 3"]:
        """Positions as recorded, put on the true plan by the true world axes."""
        return se3.transform(self.true_plan_from_world, self.scan.world_from_cams[:, :3, 3])

    def true_positions(self) -> Float[np.ndarray, "n 3"]:
        """On the true plan."""
        return se3.transform(self.true_plan_from_world, self.true_world_from_cams[:, :3, 3])

    def in_true_plan(
        self, positions: Float[np.ndarray, "n 3"], plan: Floorplan
    ) -> Float[np.ndarray, "n 3"]:
        """Positions on a plan that planfit ended with, on the true plan.

        `plan` may have been rescaled or mirrored since it was given: that is undone too.
        """
        undone = self.result_from_given(plan) @ self.given_from_true
        moved = positions.copy()
        moved[:, :2] = positions[:, :2] @ np.linalg.inv(undone).T
        return moved

    def result_from_given(self, plan: Floorplan) -> Float[np.ndarray, "2 2"]:
        """What was done to the plan since it was given: a factor, or left and right swapped."""
        factor = _extent(plan) / _extent(self.floorplan)
        was_swapped = plan.source.is_mirrored != self.floorplan.source.is_mirrored
        return factor * np.diag([-1.0 if was_swapped else 1.0, 1.0])

    def scale_error(self, plan: Floorplan) -> float:
        """Scale of the plan in the end over the true one, less one."""
        total = self.result_from_given(plan) @ self.given_from_true
        return float(np.sqrt(abs(np.linalg.det(total))) - 1.0)


Spoiler = Callable[[Inputs, int, np.random.Generator], Inputs]
"""A fault as a pure function: inputs, which size (0, 1, 2), and a source of what is random."""


@dataclass(frozen=True)
class Fault:
    """A way to spoil a scan or a plan, in one or three sizes."""

    name: str
    group: str
    """`tracking`, `convention`, `order`, `plan`, `images`."""
    sizes: tuple[str, ...]
    """In words, from small to large."""
    spoil: Spoiler
    conventions: tuple[str, ...] = ()
    """The convention that poses are in after it, by size; of the group `convention` alone."""

    def __post_init__(self) -> None:
        if len(self.sizes) not in (1, 3):
            raise ValueError(f"{self.name}: expected one size or three, found {len(self.sizes)}")


def _extent(plan: Floorplan) -> float:
    """Of what is drawn: faces that were made of centre lines stand elsewhere than these."""
    return float(np.linalg.norm(np.ptp(plan.drawn_ends.reshape(-1, 2), axis=0)))
