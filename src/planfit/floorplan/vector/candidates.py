"""Lines of a drawing that may be faces of walls, and the faces that were found among them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.floorplan.faces import Rows, weighted_median
from planfit.geometry import segments


@dataclass(frozen=True)
class Candidates(Rows):
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

    def cut(self, ends: Float[np.ndarray, "m 2 2"], line: Int[np.ndarray, " m"]) -> "Candidates":
        """Parts of the lines: `ends` of each, and the line that it is of."""
        return replace(self.take(line), ends=ends)


@dataclass(frozen=True)
class LineFaces(Rows):
    """Faces among lines; all in the unit of the drawing."""

    ends: Float[np.ndarray, "m 2 2"]
    normals: Float[np.ndarray, "m 2"]
    is_oriented: Bool[np.ndarray, " m"]
    thickness: Float[np.ndarray, " m"]
    """NaN where unknown."""
    line: Int[np.ndarray, " m"]
    """Index of the line that each lies on, -1 for none."""

    @classmethod
    def oriented(
        cls,
        ends: Float[np.ndarray, "m 2 2"],
        normals: Float[np.ndarray, "m 2"],
        thickness: Float[np.ndarray, " m"] | None = None,
        line: Int[np.ndarray, " m"] | None = None,
    ) -> "LineFaces":
        """Faces whose free side is known; of unknown thickness, and on no line, where these are not given."""
        n = len(ends)
        thickness = np.full(n, np.nan) if thickness is None else thickness
        return cls(
            ends, normals, np.ones(n, bool), thickness, np.full(n, -1) if line is None else line
        )

    @classmethod
    def without_a_side(
        cls, ends: Float[np.ndarray, "m 2 2"], line: Int[np.ndarray, " m"] | None = None
    ) -> "LineFaces":
        """Faces of which neither side is known to be free; on no line where none are given."""
        faces = cls.oriented(ends, segments.left_normals(ends), line=line)
        return replace(faces, is_oriented=np.zeros(len(ends), dtype=bool))

    @staticmethod
    def of_parts(parts: "Sequence[LineFaces]") -> "LineFaces":
        """All of several; none of no parts."""
        none = LineFaces.oriented(np.zeros((0, 2, 2)), np.zeros((0, 2)))
        return LineFaces.together([none, *parts])

    @property
    def usual_thickness(self) -> float | None:
        """Median over the length of the faces of known thickness; None where no thickness is known."""
        known = np.isfinite(self.thickness)
        if not known.any():
            return None
        return weighted_median(self.thickness[known], segments.lengths(self.ends[known]))
