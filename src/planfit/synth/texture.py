"""Procedural textures: what colour a material has at a place, as numba kernels.

u, v are metres along the sides of a rectangle of `width` x `height`, and `footprint` is the size of
a pixel there, below which nothing is drawn. Colours are linear, 0 to 1. (numba looks only at this
file to see whether its cache is stale: after an edit of `noise_field.py`, touch it.)
"""

import math

import numpy as np

from planfit.compiled import kernel
from planfit.synth.noise_field import hashed, inside, octaves, spots, value_noise
from planfit.synth.quads import Material

_1, _2, _3, _4, _5 = (np.uint64(k) for k in range(101, 106))

_PLASTER, _CEILING = int(Material.PLASTER), int(Material.CEILING)
_PLANKS, _TILES, _CARPET = int(Material.PLANKS), int(Material.TILES), int(Material.CARPET)
_WOOD, _FABRIC, _BOOKS = int(Material.WOOD), int(Material.FABRIC), int(Material.BOOKS)
_PICTURE, _NOTES, _WINDOW = int(Material.PICTURE), int(Material.NOTES), int(Material.WINDOW)
_EVEN = int(Material.EVEN)
_CABINET, _LAMP, _CARDBOARD = int(Material.CABINET), int(Material.LAMP), int(Material.CARDBOARD)


@kernel
def paint(
    hit: np.ndarray, uv: np.ndarray, footprint: np.ndarray, brightness: np.ndarray,
    material: np.ndarray, size: np.ndarray, base: np.ndarray, seed: np.ndarray,
    color: np.ndarray,
) -> None:  # fmt: skip
    """Fill colour (n, 3) of pixels from the rectangle that each shows, and where on it.

    Args:
        hit: (n,) index of the rectangle, -1 for none: such pixels are left as they are.
        uv: (n, 2) m along the rectangle's sides.
        footprint: (n,) m, size of the pixel there.
        brightness: (n,) factor on the colour.
        material: (m,) of `Material`.
        size: (m, 2) m.
        base: (m, 3) base colour.
        seed: (m,) uint64.
        color: (n, 3), written.
    """
    for i in range(len(hit)):
        q = hit[i]
        if q >= 0:
            r, g, b = _texture(
                int(material[q]), uv[i, 0], uv[i, 1], size[q, 0], size[q, 1],
                np.uint64(seed[q]), base[q, 0], base[q, 1], base[q, 2], footprint[i],
            )  # fmt: skip
            k = brightness[i]
            color[i, 0], color[i, 1], color[i, 2] = r * k, g * k, b * k


@kernel
def _texture(
    material: int, u: float, v: float, width: float, height: float,
    seed: np.uint64, r: float, g: float, b: float, footprint: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Colour of a material with base colour r g b."""
    if material == _PLASTER:
        return _plaster(u, v, height, seed, r, g, b, footprint)
    if material == _CEILING:
        k = 1.0 + 0.02 * octaves(u, v, seed, 2.0, 5, 0.7, footprint)
        k += 0.05 * spots(u, v, seed + _1, 0.4, 0.25, footprint)
        return r * k, g * k, b * k
    if material == _PLANKS:
        return _planks(u, v, seed, r, g, b, footprint)
    if material == _TILES:
        return _tiles(u, v, seed, r, g, b, footprint)
    if material == _CARPET:
        k = 1.0 + 0.13 * octaves(u, v, seed, 6.0, 6, 0.95, footprint)
        k += 0.25 * spots(u, v, seed + _1, 0.12, 0.4, footprint)
        tint = 0.1 * value_noise(u * 2.0, v * 2.0, seed + _2)
        return r * (k + tint), g * k, b * (k - tint)
    if material == _WOOD:
        k = _grain(u, v, width, height, seed, footprint)
        return r * k, g * k, b * k
    if material == _FABRIC:
        return _fabric(u, v, seed, r, g, b, footprint)
    if material == _BOOKS:
        return _books(u, v, width, height, seed, r, g, b, footprint)
    if material == _PICTURE:
        return _picture(u, v, width, height, seed, r, g, b, footprint)
    if material == _NOTES:
        return _notes(u, v, width, height, seed, footprint)
    if material == _WINDOW:
        return _window(u, v, width, height, seed, footprint)
    if material == _CABINET:
        return _cabinet(u, v, width, height, seed, r, g, b, footprint)
    if material == _CARDBOARD:
        return _cardboard(u, v, width, height, seed, r, g, b, footprint)
    if material == _LAMP:
        return 1.6, 1.58, 1.5
    if material == _EVEN:
        return r, g, b
    k = 1.0 + 0.03 * octaves(u, v, seed, 6.0, 4, 0.7, footprint)
    return r * k, g * k, b * k


@kernel
def _mix(a: float, b: float, share: float) -> float:
    return a + (b - a) * share


@kernel
def _rounded_box(u: float, v: float, half_u: float, half_v: float) -> float:
    """Distance to a rectangle about the origin, negative inside."""
    return max(abs(u) - half_u, abs(v) - half_v)


@kernel
def _plaster(
    u: float,
    v: float,
    height: float,
    seed: np.uint64,
    r: float,
    g: float,
    b: float,
    footprint: float,
) -> tuple[float, float, float]:
    """Painted plaster: roller marks, grit, scuffs; a skirting board where it meets the floor."""
    k = 1.0 + 0.035 * octaves(u, v, seed, 1.0, 8, 0.85, footprint)
    k += 0.17 * spots(u, v, seed + _1, 0.07, 0.55, footprint)
    k += 0.15 * spots(u + 0.01, v, seed + _5, 0.03, 0.5, footprint)
    k += 0.10 * spots(u + 0.11, v + 0.07, seed + _2, 0.31, 0.25, footprint)
    warm = 0.02 * value_noise(u * 0.7, v * 0.7, seed + _3)
    if height > 1.0:
        board = inside(v - 0.09, max(footprint, 0.004))
        lip = inside(abs(v - 0.09) - 0.004, max(footprint, 0.004))
        scuff = 1.0 + 0.08 * octaves(u, v, seed + _4, 3.0, 4, 0.8, footprint)
        k *= 1.0 - 0.35 * lip
        return (
            _mix(r * (k + warm), 0.62 * scuff, board),
            _mix(g * k, 0.60 * scuff, board),
            _mix(b * (k - warm), 0.57 * scuff, board),
        )
    return r * (k + warm), g * k, b * (k - warm)


@kernel
def _grain(
    u: float, v: float, width: float, height: float, seed: np.uint64, footprint: float
) -> float:
    """Brightness of wood, with the grain along the longer side."""
    if height > width:
        u, v = v, u
    bend = 0.03 * value_noise(u * 1.5, v * 3.0, seed + _3)
    k = 1.0 + 0.13 * octaves(u * 0.12, v + bend, seed, 14.0, 4, 0.75, footprint)
    k += 0.07 * octaves(u, v, seed + _1, 1.5, 4, 0.8, footprint)
    return k + 0.3 * min(0.0, spots(u, v, seed + _2, 0.25, 0.35, footprint))


@kernel
def _planks(
    u: float, v: float, seed: np.uint64, r: float, g: float, b: float, footprint: float
) -> tuple[float, float, float]:
    """Boards of 0.14 m x 1.1 m, each of its own shade, with dark joints."""
    row = math.floor(v / 0.14)
    shifted = u + 1.1 * hashed(row, 7, seed)
    board = math.floor(shifted / 1.1)
    own = seed + np.uint64(1000 + row % 1000) * _2 + np.uint64(board % 1000) * _3
    shade = 0.78 + 0.44 * hashed(row, board, seed + _1)
    k = shade * _grain(u, v, 1.0, 0.1, own, footprint)
    fv, fu = v - 0.14 * row, shifted - 1.1 * board
    edge = min(min(fv, 0.14 - fv), min(fu, 1.1 - fu))
    # A joint thinner than a pixel darkens that pixel only by its share of it.
    k *= 1.0 - 0.55 * inside(edge - 0.0015, max(footprint, 0.002)) * min(1.0, 0.006 / footprint)
    k += 0.2 * spots(u, v, seed + _4, 0.13, 0.4, footprint)
    tint = 0.08 * (hashed(row, board, seed + _5) - 0.5)
    return r * (k + tint), g * k, b * (k - tint)


@kernel
def _tiles(
    u: float, v: float, seed: np.uint64, r: float, g: float, b: float, footprint: float
) -> tuple[float, float, float]:
    """Stone tiles of 0.4 m with veins and light joints."""
    i, j = math.floor(u / 0.4), math.floor(v / 0.4)
    shade = 0.88 + 0.24 * hashed(i, j, seed + _1)
    own = seed + np.uint64(1000 + i % 1000) * _2 + np.uint64(1000 + j % 1000) * _3
    bend = 0.25 * octaves(u, v, own, 3.0, 3, 0.5, footprint)
    vein = abs(value_noise(u * 4.0 + bend * 4.0, v * 4.0 - bend * 3.0, own + _1))
    k = shade * (1.0 + 0.08 * octaves(u, v, own + _2, 4.0, 6, 0.9, footprint))
    k -= 0.18 * max(0.0, 1.0 - vein / 0.09)
    k += 0.2 * spots(u, v, seed + _4, 0.1, 0.4, footprint)
    fu, fv = u - 0.4 * i, v - 0.4 * j
    edge = min(min(fu, 0.4 - fu), min(fv, 0.4 - fv))
    joint = inside(edge - 0.0025, max(footprint, 0.002)) * min(1.0, 0.01 / footprint)
    k = _mix(k, 0.55, joint)
    return r * k, g * k, b * k


@kernel
def _fabric(
    u: float, v: float, seed: np.uint64, r: float, g: float, b: float, footprint: float
) -> tuple[float, float, float]:
    """Woven cloth with a scattered print."""
    k = 1.0 + 0.12 * octaves(u, v, seed, 3.0, 6, 0.85, footprint)
    mark = spots(u, v, seed + _1, 0.11, 0.55, footprint)
    other = spots(u + 0.05, v + 0.03, seed + _2, 0.17, 0.5, footprint)
    return (
        r * (k + 0.5 * mark + 0.3 * other),
        g * (k + 0.4 * mark - 0.2 * other),
        b * (k + 0.2 * mark + 0.5 * other),
    )


@kernel
def _books(
    u: float, v: float, width: float, height: float,
    seed: np.uint64, r: float, g: float, b: float, footprint: float,
) -> tuple[float, float, float]:  # fmt: skip
    """An open shelf: boards every 0.32 m, books of all colours, gaps."""
    row = math.floor(v / 0.32)
    fv = v - 0.32 * row
    if fv < 0.025 or u < 0.025 or u > width - 0.025 or v > height - 0.025:
        k = _grain(u, v, width, height, seed, footprint)
        return r * k, g * k, b * k
    slot = math.floor(u / 0.09)
    n_books = 2 + int(3.0 * hashed(slot, row, seed))
    at = (u / 0.09 - slot) * n_books
    book = slot * 8 + math.floor(at)
    tall = 0.16 + 0.12 * hashed(book, row, seed + _1)
    own = seed + _2
    if hashed(slot, row, seed + _3) < 0.12 or fv - 0.025 > tall:
        k = 0.05 + 0.02 * hashed(slot, row, seed + _4)
        return k, k * 0.9, k * 0.8
    tone = 0.12 + 0.65 * hashed(book, row, own)
    hue = 6.2832 * hashed(book, row, own + np.uint64(1))
    side = abs((at - math.floor(at)) - 0.5)
    k = tone * (1.0 - 0.45 * inside(0.42 - side, 0.1))
    label_at = 0.06 + 0.1 * hashed(book, row, own + np.uint64(2))
    is_label = abs(fv - label_at) < 0.012 + 0.02 * hashed(book, row, own + np.uint64(3))
    if is_label and side < 0.34 and footprint < 0.012:
        k = 0.7 if tone < 0.45 else 0.12
        hue = 0.0
    return (
        k * (1.0 + 0.4 * math.cos(hue)),
        k * (0.9 + 0.25 * math.cos(hue - 1.2)),
        k * (0.75 + 0.4 * math.cos(hue + 2.4)),
    )


@kernel
def _picture(
    u: float, v: float, width: float, height: float,
    seed: np.uint64, r: float, g: float, b: float, footprint: float,
) -> tuple[float, float, float]:  # fmt: skip
    """An abstract print: discs and bars in layers over a cloudy ground, in a dark frame."""
    border = min(min(u, width - u), min(v, height - v))
    if border < 0.018:
        k = 0.06 + 0.04 * hashed(0, 0, seed)
        return k, k * 0.9, k * 0.8
    size = min(width, height)
    k = 0.75 + 0.3 * octaves(u / size, v / size, seed, 1.5, 5, 0.7, footprint / size)
    red, green, blue = r * k, g * k, b * k
    soft = max(1.5 * footprint, 0.003)
    for n in range(14):
        cu, cv = width * hashed(n, 1, seed), height * hashed(n, 2, seed)
        du, dv = u - cu, v - cv
        angle = 6.2832 * hashed(n, 3, seed)
        scale = size * (0.05 + 0.2 * hashed(n, 4, seed))
        if n % 2 == 0:
            distance = math.hypot(du, dv) - scale
        else:
            c, s = math.cos(angle), math.sin(angle)
            distance = _rounded_box(c * du + s * dv, c * dv - s * du, 1.6 * scale, 0.35 * scale)
        share = 0.9 * inside(distance, soft)
        if share > 0.0:
            tone = 0.08 + 0.8 * hashed(n, 5, seed)
            red = _mix(red, tone * (0.6 + 0.8 * hashed(n, 6, seed)), share)
            green = _mix(green, tone * (0.6 + 0.6 * hashed(n, 7, seed)), share)
            blue = _mix(blue, tone * (0.5 + 0.8 * hashed(n, 8, seed)), share)
    return red, green, blue


@kernel
def _notes(
    u: float, v: float, width: float, height: float, seed: np.uint64, footprint: float
) -> tuple[float, float, float]:
    """Lines of print in words of random length, with a heading and a coloured block."""
    if min(min(u, width - u), min(v, height - v)) < 0.02:
        return 0.80, 0.79, 0.75
    pitch = 0.028
    row = math.floor(v / pitch)
    fv = v / pitch - row
    word = math.floor(u / 0.016 + 3.0 * hashed(row, 1, seed))
    is_ink = hashed(word, row, seed + _1) < 0.68
    is_short = u > width * (0.55 + 0.45 * hashed(row, 2, seed))
    ink = 0.0
    if is_ink and not is_short and hashed(row, 3, seed) < 0.85:
        ink = inside(abs(fv - 0.5) - 0.28, max(footprint / pitch, 0.1)) * (
            0.5 + 0.4 * hashed(word, row, seed + _2)
        )
    red, green, blue = 0.80 * (1.0 - ink), 0.79 * (1.0 - ink), 0.75 * (1.0 - ink)
    for n in range(3):
        cu, cv = width * hashed(n, 4, seed), height * hashed(n, 5, seed)
        half_u = 0.03 + 0.25 * width * hashed(n, 6, seed)
        half_v = 0.02 + 0.12 * height * hashed(n, 7, seed)
        if _rounded_box(u - cu, v - cv, half_u, half_v) < 0.0:
            tone = 0.25 + 0.4 * hashed(n, 8, seed)
            mark = 1.0 + 0.7 * spots(u, v, seed + _3, 0.05, 0.7, footprint)
            red = tone * mark * (0.5 + hashed(n, 9, seed))
            green = tone * mark * (0.5 + 0.6 * hashed(n, 10, seed))
            blue = tone * mark * (0.5 + hashed(n, 11, seed))
    return red, green, blue


@kernel
def _window(
    u: float, v: float, width: float, height: float, seed: np.uint64, footprint: float
) -> tuple[float, float, float]:
    """A white frame with a bar, and outside sky over blurred trees."""
    border = min(min(u, width - u), min(v, height - v))
    bar = abs(u - width / 2) - 0.03
    if border < 0.06 or bar < 0.0:
        k = 0.86 - 0.25 * inside(abs(min(border - 0.06, bar)) - 0.004, max(footprint, 0.004))
        return k, k * 0.99, k * 0.97
    horizon = height * (0.35 + 0.1 * value_noise(u * 3.0, 0.5, seed))
    horizon += 0.04 * value_noise(u * 14.0, 0.5, seed + _1)
    leaf = 1.0 + 0.35 * octaves(u, v, seed + _2, 8.0, 3, 0.7, footprint)
    cloud = 0.06 * octaves(u, 2.0 * v, seed + _3, 2.0, 3, 0.6, footprint)
    share = inside(v - horizon, 0.03)
    return (
        _mix(1.05 + cloud, 0.30 * leaf, share),
        _mix(1.12 + cloud, 0.42 * leaf, share),
        _mix(1.25 + cloud, 0.24 * leaf, share),
    )


@kernel
def _cabinet(
    u: float, v: float, width: float, height: float,
    seed: np.uint64, r: float, g: float, b: float, footprint: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Doors or drawers with joints, handles and some stickers."""
    n_across = max(1, round(width / 0.5))
    has_drawers = hashed(1, 1, seed) < 0.5 and height < 1.3
    n_up = max(1, round(height / 0.3)) if has_drawers else 1
    du, dv = width / n_across, height / n_up
    i, j = math.floor(u / du), math.floor(v / dv)
    own = seed + np.uint64(10 + i) * _1 + np.uint64(10 + j) * _2
    k = _grain(u, v, du, dv, own, footprint) * (0.94 + 0.12 * hashed(i, j, seed))
    fu, fv = u - i * du, v - j * dv
    edge = min(min(fu, du - fu), min(fv, dv - fv))
    k *= 1.0 - 0.65 * inside(edge - 0.003, max(footprint, 0.003)) * min(1.0, 0.01 / footprint)
    hu = du / 2 if has_drawers else (du - 0.07 if i % 2 == 0 else 0.07)
    half_u, half_v = (0.06, 0.008) if has_drawers else (0.008, 0.06)
    handle = inside(_rounded_box(fu - hu, fv - 0.55 * dv, half_u, half_v), max(footprint, 0.003))
    red, green, blue = r * k, g * k, b * k
    if hashed(i, j, own + _3) < 0.45:
        su, sv = du * (0.25 + 0.4 * hashed(i, 2, own)), dv * (0.25 + 0.5 * hashed(j, 3, own))
        if _rounded_box(fu - su, fv - sv, 0.06, 0.045) < 0.0:
            tone = 0.75 + 0.5 * spots(u, v, own + _4, 0.03, 0.8, footprint)
            red, green, blue = tone, tone * (0.6 + 0.4 * hashed(i, j, own)), tone * 0.6
    return _mix(red, 0.1, handle), _mix(green, 0.1, handle), _mix(blue, 0.11, handle)


@kernel
def _cardboard(
    u: float, v: float, width: float, height: float,
    seed: np.uint64, r: float, g: float, b: float, footprint: float,
) -> tuple[float, float, float]:  # fmt: skip
    """A carton with tape and a printed mark."""
    k = 1.0 + 0.10 * octaves(u, v, seed, 4.0, 5, 0.8, footprint)
    k += 0.25 * spots(u, v, seed + _1, 0.15, 0.4, footprint)
    if abs(v - height / 2) < 0.025:
        k *= 1.25
    cu, cv = width * (0.3 + 0.4 * hashed(1, 1, seed)), height * (0.3 + 0.4 * hashed(1, 2, seed))
    du, dv = u - cu, v - cv
    if _rounded_box(du, dv, 0.07, 0.05) < 0.0:
        i, j = math.floor(du / 0.02), math.floor(dv / 0.017)
        k = 0.35 if hashed(i, j, seed + _2) < 0.5 else 1.35
    return r * k, g * k, b * k
