"""Compiled loops over rotations: a call on one rotation costs microseconds, thousands are made in a run.

Numba compiles types that nothing can wrap: shapes of compiled loops are in their docstrings.
"""

import numpy as np

from planfit.compiled import kernel

_SMALL_ANGLE = 1e-3
"""In radians: below, the series is exact to the last digit, and nothing is divided by a small sine."""
_MAX_ACROSS, _MAX_LENGTH = 1e-12, 1e-5
"""How far products of rows, and their squared lengths, may be off, as in SciPy's `Rotation`: errors of length
do less harm, as the quaternion is normalised."""


@kernel
def rotation_vectors(rotations: np.ndarray, vectors: np.ndarray, is_rotation: np.ndarray) -> None:
    """Fill in rotation vectors (n, 3) of matrices (n, 3, 3), and whether these are rotations (n,).

    By way of the quaternion, from the largest of its parts (Markley, Unit Quaternion from Rotation Matrix,
    2008), operation by operation as in SciPy's `Rotation`, so that the bits are its.
    """
    q = np.zeros(4)
    for n in range(len(rotations)):
        m = rotations[n]
        is_rotation[n] = _is_rotation(m)
        trace = m[0, 0] + m[1, 1] + m[2, 2]
        i, largest = 0, m[0, 0]
        for each in (1, 2):
            if m[each, each] > largest:
                i, largest = each, m[each, each]
        if trace > largest:
            q[0] = m[2, 1] - m[1, 2]
            q[1] = m[0, 2] - m[2, 0]
            q[2] = m[1, 0] - m[0, 1]
            q[3] = 1.0 + trace
        else:
            j, k = (i + 1) % 3, (i + 2) % 3
            q[i] = 1.0 - trace + 2.0 * m[i, i]
            q[j] = m[j, i] + m[i, j]
            q[k] = m[k, i] + m[i, k]
            q[3] = m[k, j] - m[j, k]
        length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        # Of both quaternions of a rotation that with the angle in [0, pi]; at pi, the first part is positive.
        first = q[3] or q[0] or q[1] or q[2]
        q /= -length if first < 0.0 else length
        angle = 2.0 * np.arctan2(np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]), q[3])
        squared = angle * angle
        if angle <= _SMALL_ANGLE:
            scale = 2.0 + squared / 12.0 + 7.0 * squared * squared / 2880.0
        else:
            scale = angle / np.sin(angle / 2.0)
        vectors[n] = scale * q[:3]


@kernel
def _is_rotation(m: np.ndarray) -> bool:
    """Whether a matrix (3, 3) is orthogonal and right-handed; one of NaN is not."""
    for i in range(3):
        for j in range(i, 3):
            product = m[i, 0] * m[j, 0] + m[i, 1] * m[j, 1] + m[i, 2] * m[j, 2]
            if i == j and not abs(product - 1.0) <= _MAX_LENGTH + _MAX_ACROSS:
                return False
            if i != j and not abs(product) <= _MAX_ACROSS:
                return False
    volume = m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
    volume -= m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
    volume += m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    return volume > 0.0
