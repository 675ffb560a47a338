"""What the engine's terms and problems are given, checked once where it enters."""

from typing import Any

import numpy as np

from planfit.errors import OptionError, require


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
