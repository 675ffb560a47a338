"""Whether a picture is a photograph: of a facade or a room, or of a sheet that lies about."""

import cv2
import numpy as np
from jaxtyping import UInt8

_SIDE_PX, _TILE_PX = 900, 12
_SHEET, _SHEET_TONES = 0.6, 10
"""Of the tiles of a picture, those of one tone, within so much of 255: paper has 0.74 and more, plans of
rooms in colours 0.49 and more, 17 photographs of rooms 0.18 to 0.55."""
_TONES = 100
"""Tones that a hundredth of the tiles have each: 148 and more of these photographs, 118 at most of
drawings."""
_NOISE = 0.5
"""Deviation within the tiles of a picture, of 255, at the quietest quarter: 0 of drawings, 0.7 and more of
photographs and scans."""


def is_photograph(image_bgr: UInt8[np.ndarray, "h w 3"]) -> bool:
    """Whether a picture has no sheet of one tone, many others, and noise everywhere."""
    grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
    shrink = _SIDE_PX / max(grey.shape)
    if shrink < 1.0:
        size = (max(round(grey.shape[1] * shrink), 1), max(round(grey.shape[0] * shrink), 1))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    rows, columns = (side // _TILE_PX for side in grey.shape)
    if rows == 0 or columns == 0:
        return False
    tiles = grey[: rows * _TILE_PX, : columns * _TILE_PX].astype(np.float32)
    tiles = tiles.reshape(rows, _TILE_PX, columns, _TILE_PX).swapaxes(1, 2)
    tiles = tiles.reshape(rows * columns, -1)
    tone = np.median(tiles, axis=1)
    noise = 1.4826 * np.median(np.abs(tiles - tone[:, None]), axis=1)
    counts = np.bincount(tone.astype(int), minlength=256)
    around = np.convolve(counts, np.ones(2 * _SHEET_TONES + 1), "same") / len(tone)
    has_sheet = float(around.max()) > _SHEET
    n_tones = int((around > 0.01).sum())
    return not has_sheet and n_tones > _TONES and float(np.percentile(noise, 25)) > _NOISE


def photograph_words(image_bgr: UInt8[np.ndarray, "h w 3"]) -> str:
    """A doubt where a picture is a photograph, else empty."""
    if not is_photograph(image_bgr):
        return ""
    return (
        "the picture looks like a photograph: of a facade or a room it is no floorplan; of a sheet, crop it "
        "to that, and compare the overlay (-o FILE.png) with the drawing"
    )
