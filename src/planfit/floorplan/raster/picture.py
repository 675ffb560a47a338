"""A picture made ready for interpretation: as darkness over its paper, upright."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Shaped, UInt8

from planfit.errors import FloorplanError

Mask = UInt8[np.ndarray, "h w"]
"""1 on what it is of, else 0."""
Darkness = Float[np.ndarray, "h w"]
"""Of a picture: 0 for paper, 1 for black."""
MAX_SIDE_PX, MAX_PIXELS = 65_000, 178_000_000
"""Larger files are refused before they are unpacked; 178 million pixels is Pillow's own limit, and A0 at
300 dpi has 140."""
READ_SIDE_PX, READ_PIXELS = 20_000, 50_000_000
"""Larger pictures are read shrunk: walls of a sheet as large are tens of pixels thick, and a picture of float
numbers takes four bytes a pixel, several times over."""
MIN_SIDE_PX = 60
_PAPER = 0.12
"""Darkness below this is paper."""
MIN_PAPER_SHARE = 0.25
"""Drawings are mostly paper; photographs of other things are not."""
_PEAK = 0.25
"""Walls have at least this share of the line work of the most frequent direction."""
_APART_BINS = 16
"""Peaks are at least so many quarters of a degree apart."""
_SAME_DEG = 3.0
"""Edges belong to a direction up to this angle from it."""
_MAX_WINDOWS = 8
"""Windows of 1.2 deg that the skew is looked for in, each about the end of the one before."""
_LONG_LINE = 1 / 12
"""Walls have lines longer than this share of the drawing; hatching, as long as walls are thick, has none."""
DARK = 0.3
"""Darkness from which a pixel is part of a line; a thin line covers half of each of two pixels."""
_COARSE, _DIFFERS = 8, 10
"""Blocks of so many pixels are looked at; a line of one pixel changes the grey of a block by 30."""
_PAGE_PAD = 0.08
_PAD = 0.02
"""Paper around a drawing, as a share of its size."""


@dataclass(frozen=True)
class Upright:
    """A plan as darkness, turned so that most of its lines run along rows and columns."""

    darkness: Darkness
    """0 for paper, 1 for black."""
    upright_from_picture: Float[np.ndarray, "2 3"]
    """From pixels of the picture to those of `darkness`; a rotation and a translation."""
    skew_deg: float
    """Rotation of the lines in the picture, counter-clockwise as seen."""


def check_size(name: str, width: int, height: int) -> None:
    """Raise `FloorplanError` where a picture is too large to be read in reasonable time, or too small."""
    if max(width, height) > MAX_SIDE_PX or width * height > MAX_PIXELS:
        raise FloorplanError(
            f"{name}: expected a picture of at most {MAX_SIDE_PX} px a side and "
            f"{MAX_PIXELS // 1_000_000} million pixels, found {width} x {height}; "
            "scale it down until walls are 10 to 30 px thick"
        )
    if min(width, height) < MIN_SIDE_PX:
        raise FloorplanError(
            f"{name}: expected a picture of at least {MIN_SIDE_PX} px a side, "
            f"found {width} x {height}; scan the plan at a higher resolution"
        )


def shrink_for_reading(width: int, height: int) -> int:
    """Whole number of times that a picture is shrunk before it is read; 1 for all but huge ones."""
    factor = 1
    while max(width, height) > factor * READ_SIDE_PX or width * height > factor**2 * READ_PIXELS:
        factor += 1
    return factor


def make_darkness(
    image_bgr: UInt8[np.ndarray, "h w 3"], name: str, must_be_drawing: bool = True
) -> Darkness:
    """Darkness, float32, over the paper around each place: even under uneven light.

    `must_be_drawing`: refuse what is no drawing.

    Raises:
        FloorplanError: too large or small, or the picture has no paper (it is a photograph of something
            else) or nothing on it.
    """
    check_size(name, image_bgr.shape[1], image_bgr.shape[0])
    grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
    if np.median(grey) < 100:  # a drawing in white on dark
        grey = 255 - grey
    darkness = _over_paper(grey)
    if not must_be_drawing:
        return darkness
    if float((darkness > 0.25).mean()) < 2e-4:
        raise FloorplanError(
            f"{name}: expected a drawing of walls, found a blank page; is it the right page, file, or region?"
        )
    if float((darkness < _PAPER).mean()) < MIN_PAPER_SHARE:
        raise FloorplanError(
            f"{name}: expected a plan drawn on paper of one tone, found a photograph or a shaded "
            "picture; give a line drawing, or your own picture of its walls with --wall-mask"
        )
    return darkness


def _over_paper(grey: Mask) -> Darkness:
    """1 - brightness / brightness of the paper, which is the brightest around, smoothed."""
    h, w = grey.shape
    shrink = max(1.0, max(h, w) / 320)
    small = cv2.resize(grey, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
    reach = max(small.shape) // 12 * 2 + 1
    # Larger than furniture and thick walls, smaller than the reach of shadows.
    kernel = np.ones((reach, reach), np.uint8)
    paper = cv2.morphologyEx(cv2.medianBlur(small, 3), cv2.MORPH_CLOSE, kernel)
    paper = cv2.GaussianBlur(paper.astype(np.float32), (0, 0), reach / 4)
    paper = cv2.resize(paper, (w, h), interpolation=cv2.INTER_LINEAR)
    # In place: of a large sheet each copy takes a hundred megabytes.
    darkness = np.maximum(paper, 20.0, out=paper)
    np.divide(grey, darkness, out=darkness)
    np.subtract(1.0, darkness, out=darkness)
    return np.clip(darkness, 0.0, 1.0, out=darkness)


def make_upright(darkness: Darkness) -> Upright:
    """Turn the picture so that its main direction runs along rows and columns."""
    skew_deg = find_skew_deg(darkness)
    if abs(skew_deg) < 0.1:
        return Upright(darkness, np.eye(2, 3), 0.0)
    return Upright(*_turned_back(darkness, skew_deg, cv2.INTER_LINEAR), skew_deg)


def _turned_back(
    values: Shaped[np.ndarray, "h w"], skew_deg: float, interpolation: int
) -> tuple[Shaped[np.ndarray, "a b"], Float[np.ndarray, "2 3"]]:
    """A whole picture whose lines that go up to the right by an angle lie along rows, and from its pixels to
    those; `interpolation` of OpenCV."""
    h, w = values.shape
    c, s = np.cos(np.deg2rad(skew_deg)), np.sin(np.deg2rad(skew_deg))
    rotation = np.array([[c, -s], [s, c]])  # v grows downwards
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]]) @ rotation.T
    low = np.floor(corners.min(axis=0))
    size = np.ceil(corners.max(axis=0) - low).astype(int) + 1
    matrix = np.column_stack([rotation, -low])
    return cv2.warpAffine(values, matrix, (int(size[0]), int(size[1])), flags=interpolation), matrix


def rotated(values: Darkness, upright: Upright) -> Float[np.ndarray, "a b"]:
    """A picture rotated as the upright one was."""
    if upright.skew_deg == 0.0:
        return values
    h, w = upright.darkness.shape
    return cv2.warpAffine(values, upright.upright_from_picture, (w, h), flags=cv2.INTER_LINEAR)


def find_skew_deg(darkness: Darkness) -> float:
    """Angle in (-45, 45] that most long lines make with the axes, counter-clockwise as seen."""
    shrink = max(1.0, max(darkness.shape) / 1600)
    small = cv2.resize(darkness, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 0.8)
    gu, gv = cv2.Sobel(small, cv2.CV_32F, 1, 0), cv2.Sobel(small, cv2.CV_32F, 0, 1)
    size = np.hypot(gu, gv)
    strong = size > 0.5
    angle = np.rad2deg(np.arctan2(-gv[strong], gu[strong])) % 90.0
    counts, _ = np.histogram(angle, 360, (0.0, 90.0), weights=size[strong])
    if counts.sum() == 0:
        return 0.0
    coarse = _longest_lines(_peaks(counts), strong, gu, gv)
    # Gradients of thin lines are off by up to 1 deg between the axes and 45 deg: the window follows the top.
    fine, scores, best = _window(small, coarse)
    for _ in range(_MAX_WINDOWS - 1):
        if best in (0, 12):
            fine, scores, best = _window(small, fine[best])
    if 0 < best < 12:  # the top of the parabola through the best and its neighbours
        a, b, c = scores[best - 1 : best + 2]
        bend = a - 2 * b + c
        return float(fine[best] + (0.05 * (a - c) / bend if bend < 0 else 0.0))
    return float(fine[best])


def _window(small: Darkness, coarse: float) -> tuple[list[float], Float[np.ndarray, " k"], int]:
    """Angles about a coarse one, how sharp the line work is at each, and the number of the sharpest."""
    fine = [float(coarse + step) for step in np.arange(-0.6, 0.61, 0.1)]
    fine += [0.0] * (abs(coarse) < 0.7)
    scores = np.array([_sharpness(small, a) for a in fine])
    return fine, scores, int(np.argmax(scores))


def _peaks(counts: Float[np.ndarray, "360"]) -> list[float]:
    """Angles in (-45, 45], deg, that much line work has, most first; `counts` over 0 to 90 deg."""
    kernel = np.exp(-0.5 * (np.arange(-8, 9) / 3.0) ** 2)
    smooth = np.convolve(np.concatenate([counts[-8:], counts, counts[:8]]), kernel, "valid")
    top = smooth.max()
    result = []
    while smooth.max() > _PEAK * top:
        k = int(np.argmax(smooth))
        angle = (k + 0.5) * 0.25
        result.append(angle - 90.0 if angle > 45.0 else angle)
        smooth[np.arange(k - _APART_BINS, k + _APART_BINS + 1) % len(smooth)] = 0.0
    return result


def _longest_lines(
    angles_deg: list[float], strong: Bool[np.ndarray, "h w"], gu: Darkness, gv: Darkness
) -> float:
    """The angle with the greatest length of long lines: hatching may have more length, all in short lines.

    Args:
        angles_deg: at least one; the first is kept where no line is long.
        strong: edges.
        gu: gradient along columns' numbers.
        gv: gradient along rows' numbers.
    """
    if len(angles_deg) == 1:
        return angles_deg[0]
    angle = np.rad2deg(np.arctan2(-gv, gu))
    v, u = np.nonzero(strong)
    long_px = max(int(_LONG_LINE * max(np.ptp(u), np.ptp(v))), 12)
    length = []
    for at in angles_deg:
        off = np.abs((angle - at + 45.0) % 90.0 - 45.0)
        edges = (strong & (off < _SAME_DEG)).astype(np.uint8)
        rotated, _ = _turned_back(edges, at, cv2.INTER_NEAREST)
        length.append(_length_along_rows(rotated, long_px) + _length_along_rows(rotated.T, long_px))
    return angles_deg[int(np.argmax(length))]


def _length_along_rows(edges: Mask, least_px: int) -> float:
    """Pixels on edges along rows at least so long, up to a slant of a pixel or two over that length."""
    thick = cv2.dilate(np.ascontiguousarray(edges), np.ones((3, 3), np.uint8))
    long = cv2.morphologyEx(thick, cv2.MORPH_OPEN, np.ones((1, least_px), np.uint8))
    return float((long & edges).sum())


def _sharpness(small: Darkness, angle_deg: float) -> float:
    """How much line work piles up in rows and columns after a rotation back by an angle."""
    h, w = small.shape
    matrix = cv2.getRotationMatrix2D((w / 2, h / 2), -angle_deg, 1.0)
    rotated = cv2.warpAffine(small, matrix, (w, h), flags=cv2.INTER_LINEAR)
    rows, columns = rotated.sum(axis=1), rotated.sum(axis=0)
    return float((np.diff(rows) ** 2).sum() + (np.diff(columns) ** 2).sum())


def drawn_box(image_bgr: UInt8[np.ndarray, "h w 3"]) -> tuple[slice, slice]:
    """Rows and columns of what differs from the page, with much paper around: quick, for large sheets.

    The page is what most of the rim is like; under uneven light the box is the whole picture.
    """
    h, w = image_bgr.shape[:2]
    shrink = _COARSE if min(h, w) >= 8 * _COARSE else 1
    small = cv2.resize(image_bgr, (w // shrink, h // shrink), interpolation=cv2.INTER_AREA)
    rim = np.concatenate([small[0], small[-1], small[:, 0], small[:, -1]])
    apart = cv2.absdiff(small, np.full_like(small, np.median(rim, axis=0)))
    differs = np.asarray(apart).max(axis=2) > _DIFFERS
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if len(rows) == 0:
        return slice(0, h), slice(0, w)
    pad = _PAGE_PAD * max(np.ptp(rows), np.ptp(columns)) + 2
    (v0, v1), (u0, u1) = (
        (int((k[0] - pad) * shrink), int((k[-1] + pad + 1) * shrink)) for k in (rows, columns)
    )
    return slice(max(v0, 0), min(v1, h)), slice(max(u0, 0), min(u1, w))


def content_box(darkness: Darkness) -> tuple[slice, slice]:
    """Rows and columns of what is drawn, with a little paper around.

    Nothing that follows then depends on how much paper there is around a drawing.
    """
    is_dark = darkness > DARK
    rows, columns = np.flatnonzero(is_dark.sum(axis=1) > 1), np.flatnonzero(is_dark.sum(axis=0) > 1)
    if len(rows) == 0 or len(columns) == 0:
        return slice(0, darkness.shape[0]), slice(0, darkness.shape[1])
    pad = int(_PAD * max(np.ptp(rows), np.ptp(columns))) + 8
    return (
        slice(max(int(rows[0]) - pad, 0), int(rows[-1]) + pad + 1),
        slice(max(int(columns[0]) - pad, 0), int(columns[-1]) + pad + 1),
    )


def moved_from(upright: Upright, box: tuple[slice, slice]) -> Upright:
    """The same for the whole picture, of which `box` was made upright."""
    matrix = upright.upright_from_picture.copy()
    matrix[:, 2] -= matrix[:, :2] @ np.array([box[1].start, box[0].start])
    return replace(upright, upright_from_picture=matrix)
