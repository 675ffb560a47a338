"""Lines, fills and words on a sheet of paper, in the coordinates of a building."""

from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from jaxtyping import Float, UInt8
from shapely.geometry.base import BaseGeometry

_FRACTION_BITS = 4
_STEPS = 1 << _FRACTION_BITS
"""OpenCV draws at fractions of a pixel of one in 2 ** bits."""


@dataclass(frozen=True)
class Pen:
    """Draws on `image`, in place."""

    image: UInt8[np.ndarray, "h w"]
    uv_from_building: Float[np.ndarray, "2 3"]
    """Pixels from metres."""

    def to_uv(self, xy: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Pixels of points, m."""
        return xy @ self.uv_from_building[:, :2].T + self.uv_from_building[:, 2]

    @property
    def pixels_per_metre(self) -> float:
        """Scale of the drawing."""
        return float(self.uv_from_building[0, 0])

    def fill(self, shape: BaseGeometry, darkness: float) -> None:
        """Fill polygons with a tone, anti-aliased, holes left as they are."""
        # OpenCV's own anti-aliased polygons grow by half a pixel; drawing larger and shrinking does not.
        zoom = 4
        u0, v0, u1, v1 = self._box(shape)
        mask = np.zeros(((v1 - v0) * zoom, (u1 - u0) * zoom), np.uint8)
        for part in shapely.get_parts(shape):
            rings = [
                # A pixel's centre is at an integer, also in the larger picture.
                ((self.to_uv(np.asarray(ring.coords)[:, :2]) - [u0, v0] + 0.5) * zoom - 0.5)
                for ring in (part.exterior, *part.interiors)
            ]
            for ring, value in zip(rings, [255] + [0] * (len(rings) - 1), strict=True):
                cv2.fillPoly(mask, [np.round(ring).astype(np.int32)], value)
        share = cv2.resize(mask, (u1 - u0, v1 - v0), interpolation=cv2.INTER_AREA) / 255.0
        patch = self.image[v0:v1, u0:u1]
        patch[:] = np.round(patch * (1 - share) + 255 * (1 - darkness) * share).astype(np.uint8)

    def outline(self, shape: BaseGeometry, width_px: float, darkness: float = 1.0) -> None:
        """Stroke every ring, the stroke's middle on the ring."""
        line = shapely.boundary(shape)
        radius = width_px / 2 / self.pixels_per_metre
        self.fill(shapely.buffer(line, radius, join_style="mitre", cap_style="square"), darkness)

    def line(self, xy: Float[np.ndarray, "n 2"], width_px: float, darkness: float = 1.0) -> None:
        """Stroke an open line through points, m."""
        uv = self.to_uv(np.asarray(xy, dtype=float))
        tone = round(255 * (1 - darkness))
        points = np.round(uv * _STEPS).astype(np.int32)
        cv2.polylines(
            self.image,
            [points],
            False,
            tone,
            max(1, round(width_px / 1.5)),
            cv2.LINE_AA,
            _FRACTION_BITS,
        )

    def box(
        self,
        low: Float[np.ndarray, "2"],
        high: Float[np.ndarray, "2"],
        width_px: float,
        darkness: float = 1.0,
    ) -> None:
        """Stroke an upright rectangle."""
        (x0, y0), (x1, y1) = low, high
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        self.line(corners, width_px, darkness)

    def arc(
        self,
        centre: Float[np.ndarray, "2"],
        radius: float,
        start: float,
        stop: float,
        width_px: float,
    ) -> None:
        """Stroke an arc; angles in radians, radius in m."""
        angle = np.linspace(start, stop, 24)
        points = np.asarray(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self.line(points, width_px)

    def hatch(self, shape: BaseGeometry, spacing: float, width_px: float) -> None:
        """Lines at 45 degrees across a shape."""
        x0, y0, x1, y1 = shape.bounds
        reach = (x1 - x0) + (y1 - y0)
        offsets = np.arange(-reach, reach, spacing * np.sqrt(2.0))
        lines = shapely.linestrings([[[x0 + a, y0], [x0 + a + reach, y0 + reach]] for a in offsets])
        for piece in shapely.get_parts(shapely.intersection(lines, shape)):
            if piece.geom_type == "LineString" and piece.length > 0:
                self.line(np.asarray(piece.coords), width_px)

    def text(
        self, xy: Float[np.ndarray, "2"], words: str, height_m: float, width_px: float
    ) -> None:
        """Words, centred."""
        size = height_m * self.pixels_per_metre / 22.0
        thick = max(1, round(width_px))
        (width, height), _ = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, thick)
        u, v = self.to_uv(np.asarray(xy, dtype=float))
        at = (round(u - width / 2), round(v + height / 2))
        cv2.putText(self.image, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, 0, thick, cv2.LINE_AA)

    def _box(self, shape: BaseGeometry) -> tuple[int, int, int, int]:
        """First and last (exclusive) column and row around a shape, within the sheet."""
        x0, y0, x1, y1 = shape.bounds
        uv = self.to_uv(np.array([[x0, y0], [x1, y1]]))
        low = np.maximum(np.floor(uv.min(axis=0)).astype(int) - 2, 0)
        high = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + 3, self.image.shape[::-1])
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])
