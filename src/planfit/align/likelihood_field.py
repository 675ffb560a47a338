"""Closeness of any place to the plan's faces, kept apart by the direction they look in."""

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import distance_transform_edt

from planfit.floorplan import Floorplan
from planfit.geometry import segments

N_SECTORS = 8
"""Directions of 45 degrees each: opposite faces of one wall never share a field."""

MAX_CELLS = 300_000
"""Bounds time and memory: eight fields and their spectra of this many cells take 30 MB, and all
shifts of one turn 15 ms."""

FREE_WEIGHT = 0.5
"""A face in seen free space costs this much of a wall of its length: more than chance matches gain, and
less than would let one wall too many in the plan decide."""


@dataclass(frozen=True)
class LikelihoodField:
    """One picture a sector: 1 on a face that looks that way, falling off with distance."""

    fields: np.ndarray  # (N_SECTORS, rows, columns) 0 to 1
    faces: np.ndarray  # (rows, columns) 1 where there is a face, else 0
    origin: np.ndarray  # (2,) m, plan frame, of cell (0, 0)
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


class ShiftSearch:
    """Scores every shift of a set of wall samples at once, by FFT."""

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
        self, xy: np.ndarray, normals: np.ndarray, free_xy: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean closeness for every shift on the grid, less the faces that stand in free space.

        Args:
            xy: (m, 2) m, wall samples, turned but not shifted. A cell counts once a sector, however
                many samples it holds.
            normals: (m, 2) their unit normals.
            free_xy: (k, 2) m, places known to be free, turned likewise; each cell of them that holds a
                face costs `FREE_WEIGHT` cells of wall.

        Returns scores (rows, columns) and the shift (2,) m that cell (0, 0) stands for; cell (r, c)
        stands for that plus cell_m * (c, r). The table wraps around: shifts of the plan's own size.
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
        # Negative shifts (the scan reaches beyond the plan) wrap to the far end: bring them in front.
        table = np.roll(table, (self._extra, self._extra), axis=(0, 1))
        first = self._fields.origin - corner - self._extra * self._fields.cell_m
        return table, first


def sector_angle(sector: int) -> float:
    """Middle of a sector, rad."""
    return sector * 2 * np.pi / N_SECTORS


def wrap_angle(angle: np.ndarray | float) -> np.ndarray | np.float64:
    """Angles (...,) rad, wrapped to [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi
