"""What a term of the cost function is to the solver."""

from typing import Protocol, runtime_checkable

import numpy as np

from planfit.lsq.linear.normal_equations import NormalBlocks


@runtime_checkable
class Quadratic(Protocol):
    """A term with its robust weights frozen: weighted squares of residuals."""

    def cost(self, target_from_cams: np.ndarray, /) -> float:
        """Half the weighted sum of squares at poses (n, 4, 4)."""
        ...

    def normal_blocks(self, target_from_cams: np.ndarray, /) -> NormalBlocks:
        """Gauss-Newton blocks at poses (n, 4, 4)."""
        ...


@runtime_checkable
class Term(Protocol):
    """One sum of robust residuals over poses."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def reweight(self, target_from_cams: np.ndarray, /) -> tuple[Quadratic, float]:
        """Freeze the weights at poses (n, 4, 4); also the robust cost there."""
        ...
