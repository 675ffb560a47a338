"""What the scan says about its own poses, whatever is made of it."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Int

from planfit.adjust.terms.control import ControlMarks, no_control_marks
from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.matching import Matches, SurfacePairs
from planfit.runtime import row_parts, short_repr
from planfit.scan.odometry import Odometry
from planfit.segmentation import Structure


@dataclass(frozen=True)
class Kept:
    """What of the measurements takes part in a solve: the rest stays where it is, and nothing is copied."""

    pairs: Bool[np.ndarray, " p"]
    """Pairs of frames whose matches do."""
    patches: Bool[np.ndarray, " w"]
    """Wall patches that do."""


@dataclass(frozen=True)
class Measurements:
    """What the scan says about its own poses.

    Raises:
        ScanError: a point or a recorded step is not finite.
    """

    matches: Matches
    structure: Structure
    odometry: Odometry
    cameras: tuple[Camera, ...] = ()
    """Camera of each frame; only the reprojection error asks for them."""
    frame_idx: Int[np.ndarray, " n"] | None = None
    """The scan's number of each frame, where only some are solved for."""
    surfaces: SurfacePairs = field(default_factory=SurfacePairs.none)
    """Pairs of frames matched by their surfaces."""
    control: ControlMarks = field(default_factory=no_control_marks)
    """Control points that frames see."""
    by_hand: Matches | None = None
    """Matches that a person vouches for: no loss lets go of them, and no step of the walk outweighs them."""
    kept: Kept | None = None
    """What of matches and walls takes part; None: all."""

    __repr__ = short_repr

    def without_rest(self) -> "Measurements":
        """What is kept alone, copied."""
        if self.kept is None:
            return self
        walls = self.structure.walls.of(self.kept.patches)
        return replace(
            self,
            matches=self.matches.of_pairs(self.kept.pairs),
            structure=replace(self.structure, walls=walls),
            kept=None,
        )

    def __post_init__(self) -> None:
        named = {
            "matched point": (self.matches.points_a, self.matches.points_b, self.matches.sigma),
            "floor point": (self.structure.floor.points_cam,),
            "wall point": (self.structure.walls.points_cam,),
            "ceiling point": (self.structure.ceiling.points_cam,),
            "point of a column": (self.structure.columns.points_cam,),
            "recorded step": (self.odometry.cam_from_next,),
            "mark of a control point": (self.control.points_cam, self.control.sigma_m),
            "pair of surfaces": (self.surfaces.a_from_b, self.surfaces.information),
        }
        if self.by_hand is not None:
            named["point by hand"] = (self.by_hand.points_a, self.by_hand.points_b)
        for name, arrays in named.items():
            for array in arrays:
                # The sum is not finite where an entry is not, and needs no array of its own.
                total = sum(float(part.sum(dtype=float)) for part in row_parts(array))
                if not np.isfinite(total) and not np.isfinite(array).all():
                    bad = int((~np.isfinite(array)).reshape(len(array), -1).any(axis=1).sum())
                    raise ScanError(
                        f"adjustment: expected finite numbers, found {bad} {name}(s) with NaN or "
                        "infinity; drop them before refining"
                    )
