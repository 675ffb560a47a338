"""What a term of the cost function is to the engine, and what it is given, checked once where it enters."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int

from planfit.errors import OptionError, require
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks


@runtime_checkable
class Quadratic(Protocol):
    """A term with its robust weights frozen: weighted squares of residuals."""

    def cost(self, target_from_cams: Poses, /) -> float:
        """Half the weighted sum of squares."""
        ...

    def normal_blocks(self, target_from_cams: Poses, /) -> NormalBlocks:
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

    def reweight(self, target_from_cams: Poses, /) -> tuple[Quadratic, float]:
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


def robust_cost(terms: Sequence[Term], target_from_cams: Poses) -> float:
    """Sum of the robust costs of terms at these poses."""
    return float(sum(term.reweight(target_from_cams)[1] for term in terms))


def widened(terms: Sequence[Term], factor: float) -> list[Term]:
    """The terms, those that are `Graduated` with their losses widened."""
    return [t.with_wider_loss(factor) if isinstance(t, Graduated) else t for t in terms]


def check_pose_idx(name: str, given: Any, shape: tuple[str, ...]) -> None:
    """Raise unless `given` is an array of whole numbers from 0, of as many dimensions as `shape` names.

    A number in `shape` is a size that must be met.

    Raises:
        OptionError: it is not; `name` is the term's.
    """
    idx = np.asarray(given)
    sizes = f"({', '.join(shape)}{',' if len(shape) == 1 else ''})"
    is_shaped = idx.ndim == len(shape) and all(
        not wanted.isdigit() or found == int(wanted)
        for wanted, found in zip(shape, idx.shape, strict=True)
    )
    require(
        isinstance(given, np.ndarray) and np.issubdtype(idx.dtype, np.integer) and is_shaped,
        f"term {name!r}: expected indices of poses as an array of integers of shape {sizes}, found "
        f"{_found(given)}; give np.array(...) of int, one row for each measurement",
    )
    require(
        idx.size == 0 or int(idx.min()) >= 0,
        f"term {name!r}: expected indices of poses, found one below 0",
    )


def check_weight(name: str, weight: float) -> None:
    """Raise unless a weight is a finite number, 0 or more: a negative cost has no minimum.

    Raises:
        OptionError: it is not; `name` is the term's.
    """
    require(
        np.ndim(weight) == 0 and bool(0 <= weight < np.inf),
        f"term {name!r}: expected a weight of 0 or more, found {weight}; below 0 its cost has no "
        "minimum, and 0 switches it off",
    )


def check_poses(what: str, poses: Any, n: int | None = None) -> None:
    """Raise unless `poses` are finite transforms (n, 4, 4), one or more where `n` is not given.

    Raises:
        OptionError: they are not; the message begins with `what`.
    """
    found = np.asarray(poses)
    wanted = "(n, 4, 4), n one or more" if n is None else f"({n}, 4, 4)"
    is_shaped = found.ndim == 3 and found.shape[1:] == (4, 4)
    if not is_shaped or (len(found) == 0 if n is None else len(found) != n):
        raise OptionError(
            f"{what} of shape {wanted}, found {found.shape}; stack them with np.stack"
        )
    require(bool(np.isfinite(found).all()), f"{what}, found NaN or infinity")


def _found(given: Any) -> str:
    if not isinstance(given, np.ndarray):
        return f"a {type(given).__name__}"
    return f"{given.dtype} of shape {given.shape}"
