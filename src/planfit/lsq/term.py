"""What a term of the cost function is to the engine."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from planfit.lsq.blocks import NormalBlocks


@runtime_checkable
class Quadratic(Protocol):
    """A term with its robust weights frozen: weighted squares of residuals."""

    def cost(self, target_from_cams: Float[np.ndarray, "n 4 4"], /) -> float:
        """Half the weighted sum of squares."""
        ...

    def normal_blocks(self, target_from_cams: Float[np.ndarray, "n 4 4"], /) -> NormalBlocks:
        """Gauss-Newton blocks."""
        ...


@runtime_checkable
class Term(Protocol):
    """One sum of robust residuals over poses.

    The frozen squares must lie above the robust cost and touch it where they were frozen; with losses that
    are concave in the squared residual, as those of `planfit.lsq.robust` are, they do.
    """

    @property
    def name(self) -> str:
        """Name in reports and messages."""
        ...

    def reweight(self, target_from_cams: Float[np.ndarray, "n 4 4"], /) -> tuple[Quadratic, float]:
        """Freeze the weights at these poses; also the robust cost there."""
        ...


@runtime_checkable
class NamesPoses(Protocol):
    """A term that says which poses it depends on; `Problem` then checks that they are there."""

    @property
    def pose_idx(self) -> Int[np.ndarray, "..."]:
        """Indices of poses, of any shape."""
        ...


@runtime_checkable
class Graduated(Protocol):
    """A term that takes part in graduated non-convexity: its loss can be made wider."""

    def with_wider_loss(self, factor: float, /) -> Term:
        """The same term with the scale of its loss times `factor`."""
        ...


def robust_cost(terms: Sequence[Term], target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
    """Sum of the robust costs of terms at these poses."""
    return float(sum(term.reweight(target_from_cams)[1] for term in terms))


def widened(terms: Sequence[Term], factor: float) -> list[Term]:
    """The terms, those that are `Graduated` with their losses widened."""
    return [t.with_wider_loss(factor) if isinstance(t, Graduated) else t for t in terms]
