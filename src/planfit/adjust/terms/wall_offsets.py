"""Wall offsets: each face of the plan may stand off where it is drawn, along its normal.

Not in the paper. A plan that is a few centimetres wrong otherwise bends the scan. A face is given a
place among the unknowns behind those of the cameras: a transform that starts as the identity and whose
shift along the normal is the offset. So the solver, its pattern and its covariances serve offsets
without knowing of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import Association
from planfit.adjust.terms.walls import WallOptions, WallTerm
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.lsq.blocks import NormalBlocks, sum_by_pose
from planfit.lsq.covariance import covariances
from planfit.lsq.moments import PlaneMoments
from planfit.lsq.term import Term
from planfit.lsq.terms.prior import PosePriorTerm
from planfit.segmentation import WallPatches

_FREE_TURN = 1.0  # rad: no wall point says anything of a face's turn; any finite spread holds it


@dataclass(frozen=True)
class OffsetWallTerm:
    """Sum over wall points of rho((dist(T_i p, face) - offset of the face) / sigma)."""

    patches: WallPatches
    floorplan: Floorplan
    association: Association
    options: WallOptions
    n_cams: int
    """Poses before the faces' own among the unknowns."""
    name: str = "walls"

    def reweight(self, unknowns: np.ndarray) -> tuple["OffsetPlaneMoments", float]:
        """One pass over the wall points, against faces where their offsets put them now."""
        shifts = unknowns[self.n_cams :, :3, 3]
        offsets_m = np.einsum("ni,ni->n", self.floorplan.normals, shifts[:, :2])
        term = WallTerm(
            self.patches, self.floorplan, self.association, self.options, offsets_m=offsets_m
        )
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
    """Moments of wall points about faces that shift, with frozen weights."""

    drawn: PlaneMoments
    """About the faces as drawn."""
    face_idx: np.ndarray  # (k,) place of each group's face among the unknowns

    def cost(self, unknowns: np.ndarray) -> float:
        """Half the weighted sum of squares at unknowns (n, 4, 4)."""
        return self._shifted(unknowns).cost(unknowns)

    def normal_blocks(self, unknowns: np.ndarray) -> NormalBlocks:
        """Blocks of cameras, of faces, and between them: d residual / d shift = -normal."""
        shifted = self._shifted(unknowns)
        cams = shifted.normal_blocks(unknowns)
        poses = unknowns[shifted.pose_idx]
        normals = shifted.planes[:, :3]
        ones = shifted.moments[:, :, 3]  # (k, 4) sum of w p~
        residual = np.einsum("ki,ki->k", np.einsum("kji,kj->ki", poses, shifted.planes), ones)
        levers = np.einsum("kij,kj->ki", poses[:, :3, :3], ones[:, :3])
        by_cam = np.concatenate([np.cross(levers, normals), ones[:, 3:] * normals], axis=1)
        across = np.zeros((len(poses), 6, 6))
        across[:, :, 3:] = -by_cam[:, :, None] * normals[:, None, :]
        own = np.zeros((len(poses), 6, 6))
        own[:, 3:, 3:] = (ones[:, 3, None] * normals)[:, :, None] * normals[:, None, :]
        pull = np.concatenate([np.zeros_like(normals), -residual[:, None] * normals], axis=1)
        n = len(unknowns)
        everyone = np.arange(n)
        return NormalBlocks(
            np.concatenate([cams.rows, everyone, shifted.pose_idx]),
            np.concatenate([cams.columns, everyone, self.face_idx]),
            np.concatenate([cams.blocks, sum_by_pose(self.face_idx, own, n), across]),
            cams.gradient + sum_by_pose(self.face_idx, pull, n),
        )

    def _shifted(self, unknowns: np.ndarray) -> PlaneMoments:
        planes = self.drawn.planes.copy()
        shifts = unknowns[self.face_idx, :3, 3]
        planes[:, 3] -= np.einsum("ki,ki->k", planes[:, :3], shifts)
        return PlaneMoments(self.drawn.pose_idx, planes, self.drawn.moments)


def offset_prior(n_cams: int, floorplan: Floorplan, sigma_m: float) -> PosePriorTerm:
    """Faces stand where they are drawn, within a spread."""
    sigma = np.array([_FREE_TURN] * 3 + [sigma_m] * 3)
    faces = n_cams + np.arange(len(floorplan))
    return PosePriorTerm(faces, np.tile(np.eye(4), (len(floorplan), 1, 1)), sigma, "wall offsets")


def with_offsets(plan_from_cams: np.ndarray, floorplan: Floorplan) -> np.ndarray:
    """Unknowns: poses (n, 4, 4) and, behind them, faces as drawn."""
    return np.concatenate([plan_from_cams, np.tile(np.eye(4), (len(floorplan), 1, 1))])


def read_offsets(unknowns: np.ndarray, n_cams: int, floorplan: Floorplan) -> np.ndarray:
    """Offsets (f,) m of the faces along their normals."""
    shifts = se3.transform(unknowns[n_cams:], np.zeros((1, 3)))[:, 0, :2]
    return np.einsum("ni,ni->n", floorplan.normals, shifts)


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
