"""Likelihood field: closeness of any point to the plan's faces, kept apart by the direction they look in."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import fft
from scipy.ndimage import distance_transform_edt

from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.geometry.se3 import wrap_angle

N_SECTORS = 8
"""Directions of 45 degrees each: opposite faces of one wall never share a field."""

MAX_CELLS = 300_000
"""Bounds time and memory: eight fields and their spectra of this many cells take 30 MB, and all
translations of one yaw 15 ms."""

FREE_WEIGHT = 0.5
"""A face in seen free space costs this much of a wall of its length: more than chance matches gain, and
less than would let one wall too many in the plan decide."""


@dataclass(frozen=True)
class LikelihoodField:
    """One picture a sector: 1 on a face that looks that way, falling off with distance."""

    fields: Float[np.ndarray, "sectors rows columns"]
    """0 to 1."""
    faces: Float[np.ndarray, "rows columns"]
    """1 where there is a face, else 0."""
    origin: Float[np.ndarray, " 2"]
    """Metres, plan frame, of cell (0, 0)."""
    cell_m: float


def make_likelihood_field(
    floorplan: Floorplan, cell_m: float, reach_m: float, margin_m: float, beyond_m: float = 0.0
) -> LikelihoodField:
    """Fields exp(-d^2 / 2 reach^2) of the distance d to the faces of each sector.

    Cells grow where plan and `beyond_m` on each side, which a search pads with, would make more than
    `MAX_CELLS` of them.
    """
    extent = np.array(floorplan.size) + 2 * (margin_m + beyond_m)
    cell_m = max(cell_m, float(np.sqrt(extent.prod() / MAX_CELLS)))
    reach_m = max(reach_m, 1.5 * cell_m)
    xy, face = segments.sample(floorplan.ends, cell_m / 2)
    origin = xy.min(axis=0) - margin_m
    shape = np.ceil((np.ptp(xy, axis=0) + 2 * margin_m) / cell_m).astype(int) + 1
    column, row = np.round((xy - origin) / cell_m).astype(int).T
    angle = np.arctan2(floorplan.normals[:, 1], floorplan.normals[:, 0])[face]
    fields = np.zeros((N_SECTORS, shape[1], shape[0]), dtype=np.float32)
    for sector in range(N_SECTORS):
        off = np.abs(wrap_angle(angle - sector_angle(sector)))
        off = np.where(floorplan.is_oriented[face], off, np.minimum(off, np.pi - off))
        # Sectors overlap by half: a face at a border belongs to both.
        chosen = off < np.pi / N_SECTORS * 1.5
        if chosen.any():
            free = np.ones(fields.shape[1:], dtype=bool)
            free[row[chosen], column[chosen]] = False
            distance = distance_transform_edt(free) * cell_m
            fields[sector] = np.exp(-0.5 * (distance / reach_m) ** 2)
    faces = np.zeros(fields.shape[1:], dtype=np.float32)
    faces[row, column] = 1.0
    return LikelihoodField(fields, faces, origin, cell_m)


class TranslationSearch:
    """Scores every translation of a set of wall samples at once, by FFT."""

    def __init__(self, fields: LikelihoodField, extent_m: float) -> None:
        """Prepare for wall samples that span up to `extent_m`."""
        self._fields = fields
        self._extra = int(np.ceil(extent_m / fields.cell_m)) + 2
        rows, columns = fields.fields.shape[1:]
        self._shape = (
            fft.next_fast_len(rows + self._extra, real=True),
            fft.next_fast_len(columns + self._extra, real=True),
        )
        self._spectra = fft.rfft2(fields.fields, self._shape, axes=(1, 2))
        self._face_spectrum = fft.rfft2(fields.faces, self._shape)

    def scores(
        self,
        xy: Float[np.ndarray, "m 2"],
        normals: Float[np.ndarray, "m 2"],
        free_xy: Float[np.ndarray, "k 2"] | None = None,
    ) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, " 2"]]:
        """Mean closeness for every translation on the grid, less the faces that stand in free space.

        Args:
            xy: metres, wall samples, rotated but not translated. A cell counts once a sector, however
                many samples it holds.
            free_xy: metres, points known to be free, rotated likewise; each cell of them that holds a
                face costs `FREE_WEIGHT` cells of wall.

        Returns scores and the translation (m) that cell (0, 0) stands for; cell (r, c)
        stands for that plus cell_m * (c, r). The table wraps around: translations of the plan's own size.
        """
        free_xy = np.zeros((0, 2)) if free_xy is None else free_xy
        corner = np.concatenate([xy, free_xy]).min(axis=0)
        column, row = np.round((xy - corner) / self._fields.cell_m).astype(int).T
        angle = np.arctan2(normals[:, 1], normals[:, 0])
        sector = np.round(angle / (2 * np.pi) * N_SECTORS).astype(int) % N_SECTORS
        picture = np.zeros((N_SECTORS, *self._shape), dtype=np.float32)
        picture[sector, row, column] = 1.0
        n_cells = picture.sum()
        product = np.zeros(self._spectra.shape[1:], dtype=np.complex64)
        for k in np.unique(sector):
            product += self._spectra[k] * np.conj(fft.rfft2(picture[k]))
        if len(free_xy):
            column, row = np.round((free_xy - corner) / self._fields.cell_m).astype(int).T
            picture[0] = 0.0
            picture[0, row, column] = FREE_WEIGHT
            product -= self._face_spectrum * np.conj(fft.rfft2(picture[0]))
        product /= n_cells
        table = fft.irfft2(product, self._shape)
        # Negative translations (the scan reaches beyond the plan) wrap to the far end: bring them in front.
        table = np.roll(table, (self._extra, self._extra), axis=(0, 1))
        first = self._fields.origin - corner - self._extra * self._fields.cell_m
        return table, first


def sector_angle(sector: int) -> float:
    """Middle of a sector, rad."""
    return sector * 2 * np.pi / N_SECTORS
