"""Lines of a drawing that may be faces of walls."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped


@dataclass(frozen=True)
class Candidates:
    """Lines that may be faces of walls, merged: no two lie on one another."""

    ends: Float[np.ndarray, "n 2 2"]
    is_called_wall: Bool[np.ndarray, " n"]
    """Whether the name of the layer, or a room that begins there, makes the line a wall."""
    layer: Int[np.ndarray, " n"]
    """Index of the layer, -1 for edges of rooms."""
    free_side: Int[np.ndarray, " n"]
    """1 where the left side is known to be free, 0 where nothing is."""

    def __len__(self) -> int:
        return len(self.ends)

    def take(self, keep: Shaped[np.ndarray, " k"]) -> "Candidates":
        """Those of a mask or an index."""
        return Candidates(
            self.ends[keep], self.is_called_wall[keep], self.layer[keep], self.free_side[keep]
        )

    def cut(self, ends: Float[np.ndarray, "m 2 2"], line: Int[np.ndarray, " m"]) -> "Candidates":
        """Parts of the lines: `ends` of each, and the line that it is of."""
        return replace(self.take(line), ends=ends)
