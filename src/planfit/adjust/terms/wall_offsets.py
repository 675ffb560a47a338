"""Wall offsets: each face of the plan may stand off where it is drawn, along its normal.

Not in the paper. A plan that is a few centimetres wrong otherwise deforms the scan. A face is given a
pose among the unknowns behind those of the cameras: a transform that starts as the identity and whose
translation along the normal is the offset. So the solver, its pattern and its covariances serve offsets
without knowing of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import Association
from planfit.adjust.terms.observation_models import ObservationModel
from planfit.adjust.terms.walls import WallTerm
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks, sum_by_pose
from planfit.lsq.covariance import covariances
from planfit.lsq.moments import PlaneMoments
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.term import Term
from planfit.segmentation import WallPatches

_FREE_ROTATION = (
    1.0  # rad: no wall point says anything of a face's rotation; any finite sigma holds it
)


@dataclass(frozen=True)
class OffsetWallTerm:
    """Sum over wall points of rho((dist(T_i p, face) - offset of the face) / sigma)."""

    patches: WallPatches
    floorplan: Floorplan
    association: Association
    model: ObservationModel
    n_cams: int
    """Unknowns before the faces' own, the cameras first among them."""
    name: str = "walls"

    def displaced(self, unknowns: Float[np.ndarray, "u 4 4"]) -> WallTerm:
        """Of the cameras alone, against faces where their offsets put them now."""
        offsets_m = read_offsets(unknowns, self.n_cams, self.floorplan)
        return WallTerm(
            self.patches, self.floorplan, self.association, self.model, offsets_m=offsets_m
        )

    def reweight(self, unknowns: Float[np.ndarray, "u 4 4"]) -> tuple["OffsetPlaneMoments", float]:
        """One pass over the wall points, against faces where their offsets put them now."""
        term = self.displaced(unknowns)
        offsets_m = term.offsets_m
        assert offsets_m is not None
        quadratic, cost = term.reweight(unknowns[: self.n_cams])
        assert isinstance(quadratic, PlaneMoments)  # offsets run on the CPU
        associated = self.association.face_idx >= 0
        drawn = quadratic.planes.copy()
        drawn[:, 3] += offsets_m[self.association.face_idx]
        moments = PlaneMoments(
            quadratic.pose_idx[associated], drawn[associated], quadratic.moments[associated]
        )
        face_idx = self.n_cams + self.association.face_idx[associated]
        return OffsetPlaneMoments(moments, face_idx), cost


@dataclass(frozen=True)
class OffsetPlaneMoments:
    """Moments of wall points about faces with offsets, with frozen weights."""

    drawn: PlaneMoments
    """About the faces as drawn."""
    face_idx: Int[np.ndarray, " k"]
    """Index of each group's face among the unknowns."""

    def cost(self, unknowns: Float[np.ndarray, "u 4 4"]) -> float:
        """Half the weighted sum of squares."""
        return self._displaced(unknowns).cost(unknowns)

    def normal_blocks(self, unknowns: Float[np.ndarray, "u 4 4"]) -> NormalBlocks:
        """Blocks of cameras, of faces, and between them: d residual / d translation = -normal."""
        displaced = self._displaced(unknowns)
        cams = displaced.normal_blocks(unknowns)
        poses = unknowns[displaced.pose_idx]
        normals = displaced.planes[:, :3]
        ones = displaced.moments[:, :, 3]  # (k, 4) sum of w p~
        residual = np.einsum("ki,ki->k", np.einsum("kji,kj->ki", poses, displaced.planes), ones)
        levers = np.einsum("kij,kj->ki", poses[:, :3, :3], ones[:, :3])
        by_cam = np.concatenate([np.cross(levers, normals), ones[:, 3:] * normals], axis=1)
        across = np.zeros((len(poses), 6, 6))
        across[:, :, 3:] = -by_cam[:, :, None] * normals[:, None, :]
        own = np.zeros((len(poses), 6, 6))
        own[:, 3:, 3:] = (ones[:, 3, None] * normals)[:, :, None] * normals[:, None, :]
        by_face = np.concatenate([np.zeros_like(normals), -residual[:, None] * normals], axis=1)
        n = len(unknowns)
        everyone = np.arange(n)
        return NormalBlocks(
            np.concatenate([cams.rows, everyone, displaced.pose_idx]),
            np.concatenate([cams.columns, everyone, self.face_idx]),
            np.concatenate([cams.blocks, sum_by_pose(self.face_idx, own, n), across]),
            cams.gradient + sum_by_pose(self.face_idx, by_face, n),
        )

    def _displaced(self, unknowns: np.ndarray) -> PlaneMoments:
        planes = self.drawn.planes.copy()
        translations = unknowns[self.face_idx, :3, 3]
        planes[:, 3] -= np.einsum("ki,ki->k", planes[:, :3], translations)
        return PlaneMoments(self.drawn.pose_idx, planes, self.drawn.moments)


def offset_prior(
    n_cams: int, floorplan: Floorplan, sigma_m: float, name: str = "wall offsets"
) -> PosePriorTerm:
    """Faces stand where they are drawn, within a sigma."""
    sigma = np.array([_FREE_ROTATION] * 3 + [sigma_m] * 3)
    faces = n_cams + np.arange(len(floorplan))
    return PosePriorTerm(faces, np.tile(np.eye(4), (len(floorplan), 1, 1)), sigma, name)


def with_offsets(plan_from_cams: Poses, floorplan: Floorplan) -> Float[np.ndarray, "u 4 4"]:
    """Unknowns: poses and, behind them, faces as drawn."""
    return np.concatenate([plan_from_cams, np.tile(np.eye(4), (len(floorplan), 1, 1))])


def read_offsets(
    unknowns: Float[np.ndarray, "u 4 4"], n_cams: int, floorplan: Floorplan
) -> Float[np.ndarray, " f"]:
    """Offsets (m) of the faces, which are unknowns behind the first `n_cams`, along their normals."""
    translations = unknowns[n_cams : n_cams + len(floorplan), :2, 3]
    return np.einsum("ni,ni->n", floorplan.normals, translations)


def offset_sigmas(
    terms: Sequence[Term],
    unknowns: Float[np.ndarray, "u 4 4"],
    idx: Int[np.ndarray, " k"],
    normals: Float[np.ndarray, "k 2"],
) -> Float[np.ndarray, " k"]:
    """Standard deviations (m) of the offsets of the faces that are unknowns `idx`, along their normals.

    Raises:
        OptionError: nothing holds one of them.
    """
    translation = covariances(terms, unknowns, idx)[:, 3:5, 3:5]
    return np.sqrt(np.einsum("fi,fij,fj->f", normals, translation, normals))
