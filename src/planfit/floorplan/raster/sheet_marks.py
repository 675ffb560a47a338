"""What a sheet shows around its plan, or instead of one: a frame, bars of titles, signs, text, a photograph.

Letters are connected marks of like height, one close behind the other (L. A. Fletcher and R. Kasturi, PAMI
1988). Pieces of wall stand in rows too: they are bars, alike, thin, or together more than any one mark.
"""

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, UInt8

from planfit.floorplan.faces import connected_groups
from planfit.floorplan.plausible import COMPARE
from planfit.floorplan.raster.picture import DARK, Darkness
from planfit.geometry import segments

_WIDE, _ALIKE = 0.08, 1.4
"""The outer line of a building of double lines is as far from the next line on all four sides, up to the
factor; a frame is not, or is further away than this share of the sheet."""
_ALL_ROUND = 0.93
"""Of the sides of what is drawn, those of a frame; of two frames, those of the inner one too."""
_SPECK_PX = 40
"""Marks of fewer pixels lie anywhere."""
_WHOLE_SIDE, _FLAT = 0.9, 0.15
"""A bar runs along so much of a side of what is drawn, and is as high as this share of it at most."""
_LETTERS = 5
"""White on a bar. A long wall may have as many panes of windows, which are longer than letters are."""
_LETTER = (0.1, 0.95)
"""Height of a letter in a bar's; it is up to three times as long."""
SIGN_WORDS = (
    "safety colours were left out, as of signs, ways and panels of an escape plan: walls under them may "
    "be missing"
)
_COLOURFUL = 80
"""Of 255, what the brightest channel is above the darkest in safety colours (ISO 3864-4), also where they are
printed pale; greys and walls tinted a little have less."""
_LEAST_GREEN, _LEAST_RED = 0.1, 0.02
"""Of what is not paper: signs and ways in green, signs of extinguishers in red. Escape plans have both."""
_PAPER = 0.4
"""Of a picture, what is white at least: a photograph is not."""
_EDGE_PX = 5
"""Between a colour and what is beside it, pixels are of both, more in JPEG."""
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
_DESK_SIDE_PX = 400
_DESK = 0.55
"""Of the brightness of the sheet: walls filled in grey are as dark, but slim."""
_THICK, _LEAST_DARK = 0.03, 0.02
"""Thicker than this share of the picture everywhere, and of more than this share of its area; real walls are
0.01 thick."""
_ALONG_RIM = 0.1
"""Share of a side of the picture that is dark where a desk lies along it."""
_SLANTED_DEG = 10.0
"""Walls of an axis are within this of it."""
_LEAN_DEG, _LEAN_SHARE = 1.5, 0.4
"""By how much more walls lean on one side than on the other, and what of their slants that explains, where a
sheet was photographed at a slant: 1.8 to 10 deg and 0.51 to 0.91; of 19 scans and drawings 0.3 deg, 0.02."""


def marks_of(
    darkness: Darkness,
) -> tuple[
    Int[np.ndarray, "h w"], Int[np.ndarray, "n 5"], Int[np.ndarray, "2"], Int[np.ndarray, "2"]
]:
    """What is drawn: labels and boxes (u, v, width, height, pixels) of connected parts, and the lowest and
    highest u and v of all but specks; (0, 0) where there are specks alone."""
    lines = (darkness > DARK).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(lines, connectivity=8)
    marks = stats[1:][stats[1:, 4] > _SPECK_PX]
    marks = marks if len(marks) else np.zeros((1, 5), dtype=int)
    return labels, stats, marks[:, :2].min(axis=0), (marks[:, :2] + marks[:, 2:4]).max(axis=0)


def without_bars(darkness: Darkness) -> Darkness:
    """The picture with bars of titles blanked, dark with white letters along a side of what is drawn; the
    same where there are none."""
    labels, stats, low, high = marks_of(darkness)
    result = darkness
    for label in 1 + np.flatnonzero(stats[1:, 4] > _SPECK_PX):
        box = stats[label]
        part = slice(box[1], box[1] + box[3]), slice(box[0], box[0] + box[2])
        if _lies_along_a_side(box, low, high) and _has_letters(labels[part] == label):
            # With what of letters is dark within, and the bar's own edge.
            rows, columns = (slice(max(side.start - 2, 0), side.stop + 2) for side in part)
            result = result.copy()
            result[rows, columns] = 0.0
    return result


def _lies_along_a_side(
    box: Int[np.ndarray, "5"], low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]
) -> bool:
    """Whether a component, by its box (u, v, width, height, pixels), is a solid bar at one side of what is
    drawn from `low` to `high` (u, v)."""
    size = high - low
    for axis in (0, 1):
        across = 1 - axis
        near = 0.02 * size[across] + 2
        end = box[across] + box[2 + across]
        is_at_side = box[across] < low[across] + near or end > high[across] - near
        is_bar = box[2 + axis] > _WHOLE_SIDE * size[axis] and box[2 + across] < _FLAT * size[across]
        if is_at_side and is_bar and 2 * box[4] > box[2] * box[3]:
            return True  # the rest are letters
    return False


def _has_letters(mask: Bool[np.ndarray, "h w"]) -> bool:
    """Whether a bar has as many holes of the size of letters as a word has."""
    height = min(mask.shape)
    _, _, holes, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    size = np.sort(holes[1:, 2:4], axis=1)
    is_letter = (size[:, 0] > _LETTER[0] * height) & (size[:, 0] < _LETTER[1] * height)
    return int((is_letter & (size[:, 1] < 3 * size[:, 0])).sum()) >= _LETTERS


def without_frame(darkness: Darkness) -> Darkness:
    """The picture with the frame blanked, or two frames of which one is in the other; the same where there is
    none."""
    labels, stats, low, high = marks_of(darkness)
    size = high - low
    if not size.any():
        return darkness
    is_all_round = np.asarray((stats[:, 2:4] > _ALL_ROUND * size).all(axis=1))
    is_all_round[0] = False
    # Specks outside do not matter.
    is_mark = stats[:, 4] > 1e-4 * size[0] * size[1]
    is_mark[0] = False
    # What is further off belongs to no wall of a line, and words are smaller.
    result, far = darkness, 0.3 * size
    from_inside = np.flatnonzero(is_all_round)[np.argsort(stats[is_all_round, 2])]
    for k, label in enumerate(from_inside):
        is_mark[from_inside[k:]] = False
        box, rest = stats[label], stats[is_mark]
        part = slice(box[1], box[1] + box[3]), slice(box[0], box[0] + box[2])
        mask = labels == label
        is_large = is_mark & np.asarray((stats[:, 2:4] > far).all(axis=1))
        # Lines of thin walls have less ink than a frame.
        if box[4] > rest[:, 4].sum() and (
            _has_middle(mask[part]) or not _has_walls(is_large[labels[part]], far.max())
        ):
            continue
        is_around = (rest[:, :2] >= box[:2]).all() and (
            rest[:, :2] + rest[:, 2:4] <= box[:2] + box[2:4]
        ).all()
        is_inner = k + 1 < len(from_inside)
        within = (result[part] > DARK) & ~mask[part]
        is_frame = (
            is_around and _has_four_sides(mask[part]) and not (is_inner and _has_middle(mask[part]))
        )
        if is_frame and not _is_outline(within, far.max()):
            blank = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            result = np.where(blank, np.float32(0.0), result)
        else:
            is_mark[label] = True
    return result


def _has_middle(mask: Bool[np.ndarray, "h w"]) -> bool:
    """Whether a component has more than its rim and what hangs on it, as the lines of rooms."""
    (v, u), (h, w) = (mask.shape[0] // 4, mask.shape[1] // 4), mask.shape
    return bool(mask[v : h - v, u : w - u].any())


def _from_all_sides(inside: Bool[np.ndarray, "h w"]) -> tuple[Bool[np.ndarray, "r c"], ...]:
    """A picture turned so that each of its sides is the first row once."""
    return inside, inside[::-1], inside.T, inside.T[::-1]


def _has_walls(inside: Bool[np.ndarray, "h w"], far: float) -> bool:
    """Whether what is seen first from a closed line are strokes nearer to one another than to that line, as
    the two of a wall are. Behind the outer line of a wall its inner one follows, and then a room."""
    gaps = []
    for turned in _from_all_sides(inside):
        begins = turned.copy()
        begins[1:] &= ~turned[:-1]
        n_strokes = np.cumsum(begins, axis=0, dtype=np.int32)
        first, second = (np.argmax(n_strokes == n, axis=0) for n in (1, 2))
        is_near = turned.any(axis=0) & (first < far)
        second = np.where(n_strokes[-1] > 1, second, len(turned))
        gaps.append(np.stack([first, second - first])[:, is_near])
    to_line, between = np.concatenate(gaps, axis=1)
    return int((between < to_line).sum()) > len(to_line) / 2


def _is_outline(inside: Bool[np.ndarray, "h w"], far: float) -> bool:
    """Whether what is inside a closed line keeps the distance of a wall to it on all sides."""
    gaps = []
    for turned in _from_all_sides(inside):
        first = np.argmax(turned, axis=0)[turned.any(axis=0)]
        first = first[first < far]
        gaps.append(float(np.median(first)) if len(first) else far)
    return max(gaps) < min(_WIDE * max(inside.shape), _ALIKE * min(gaps) + 3.0)


def _has_four_sides(mask: Bool[np.ndarray, "h w"]) -> bool:
    """Whether lines run along most of every side of a component's box."""
    band = max(3, max(mask.shape) // 60)
    sides = (mask[:band].any(axis=0), mask[-band:].any(axis=0),
             mask[:, :band].any(axis=1), mask[:, -band:].any(axis=1))  # fmt: skip
    return all(side.mean() > 0.9 for side in sides)


def without_signs(image_bgr: UInt8[np.ndarray, "h w 3"]) -> tuple[UInt8[np.ndarray, "h w 3"], bool]:
    """The picture with what is in safety colours as white paper, where it has those of an escape plan; and
    whether it has."""
    colour = image_bgr.max(axis=2) - image_bgr.min(axis=2) > _COLOURFUL
    strongest = image_bgr.argmax(axis=2)
    green, red = (float((colour & (strongest == channel)).mean()) for channel in (1, 2))
    paper = float((image_bgr.min(axis=2) > 255 - _COLOURFUL // 2).mean())
    ink = 1.0 - paper
    if green < _LEAST_GREEN * ink or red < _LEAST_RED * ink or paper < _PAPER:
        return image_bgr, False
    kernel = np.ones((_EDGE_PX, _EDGE_PX), np.uint8)
    cleared = image_bgr.copy()
    cleared[cv2.dilate(colour.astype(np.uint8), kernel) > 0] = 255
    return cleared, True


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
        f"to that, and {COMPARE}"
    )


def dark_sides(image_bgr: UInt8[np.ndarray, "h w 3"]) -> int:
    """How many sides of a picture are dark, by regions much thicker than any wall."""
    h, w = image_bgr.shape[:2]
    shrink = max(1.0, max(h, w) / _DESK_SIDE_PX)
    size = (max(round(w / shrink), 1), max(round(h / shrink), 1))
    small = cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA)
    small = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    sheet = float(np.median(small))
    if sheet < 100:  # a drawing in white on dark
        return 0
    reach = int(_THICK * max(small.shape)) // 2 * 2 + 1  # odd: even ones shift what they open
    dark = (small < _DESK * sheet).astype(np.uint8)
    # Bright around: a wall that the rim cuts is no thicker than what of it is in the picture.
    solid = cv2.morphologyEx(
        cv2.copyMakeBorder(dark, reach, reach, reach, reach, cv2.BORDER_CONSTANT),
        cv2.MORPH_OPEN,
        np.ones((reach, reach), np.uint8),
    )[reach:-reach, reach:-reach]
    if float(solid.mean()) < _LEAST_DARK:
        return 0
    sides = (solid[0], solid[-1], solid[:, 0], solid[:, -1])
    return sum(float(side.mean()) > _ALONG_RIM for side in sides)


def surroundings_words(image_bgr: UInt8[np.ndarray, "h w 3"]) -> str:
    """A doubt where a picture shows a dark desk around its sheet, else empty."""
    n_sides = dark_sides(image_bgr)
    if n_sides < 2:
        return ""
    return (
        f"the picture is dark along {n_sides} of its sides, as the desk around a photographed sheet is, "
        "whose edge may be read as wall: crop the picture to the sheet"
    )


def slant_words(ends: Float[np.ndarray, "n 2 2"]) -> str:
    """A doubt where faces of one axis, px of the upright picture, lean the more the further they are to one
    side, as lines that are parallel on a sheet do in perspective; else empty."""
    along, length = segments.directions(ends), segments.lengths(ends)
    most = 0.0
    for axis in (0, 1):
        across = 1 - axis
        tangent = along[:, across] * np.sign(along[:, axis])
        lean_deg = np.rad2deg(np.arctan2(tangent, np.abs(along[:, axis])))
        is_own = np.abs(lean_deg) < _SLANTED_DEG
        weight = length * is_own / max(float(length[is_own].sum()), 1e-9)
        at = ends.mean(axis=1)[:, across]
        at, lean = at - weight @ at, lean_deg - weight @ lean_deg
        slope = (weight * at) @ lean / max(float((weight * at) @ at), 1e-9)
        explained = 1.0 - weight @ (lean - slope * at) ** 2 / max(float(weight @ lean**2), 1e-9)
        if explained > _LEAN_SHARE and is_own.any():
            most = max(most, abs(float(slope * np.ptp(at[is_own]))))
    if most < _LEAN_DEG:
        return ""
    return (
        f"walls lean by {most:.1f} deg more on one side of the picture than on the other, as on a sheet that "
        "was photographed at a slant: take it from straight above, or straighten it with an app that scans"
    )


_LEAST_LETTERS = 3
"""Letters of a line: fewer may be anything."""
_HIGHEST = 0.15
"""Of what is drawn, height of the letters of a title."""
_LIKE_HEIGHT = 2.2
"""A capital is at most so many times as high as the letter beside it."""
_NEXT = 1.2
"""Of their height, the gap between two letters, that of two words among them."""
_SOLID_BAR = 0.85
"""Of its box, what of a bar is dark; of letters, less."""
_SLIM = 10.0
"""Heights of letters over their thickness: 5 of bold ones, 9 of regular ones. Walls between two rooms are 0.1
to 0.3 m thick, and longer than 3 m."""
_MOST_INK = 3.0
"""Times that of most letters of a line, what one has: two that touch; a piece of wall in line has more."""
_VARIED = 0.05
"""Variation of the letters' widths and inks, of their means: pieces of wall in a row are alike."""


def without_text(darkness: Darkness) -> tuple[Darkness, int]:
    """The picture with lines of text blanked, and how many letters these had."""
    labels, stats, low, high = marks_of(darkness)
    strokes = (labels > 0).astype(np.uint8)
    inner = cv2.erode(strokes, np.ones((3, 3), np.uint8))
    n_edge = np.bincount(labels[strokes > inner], minlength=len(stats))
    thickness = 2 * stats[:, 4] / np.maximum(n_edge, 1)
    is_letter = _are_letters(stats, thickness, float((high - low).max()))
    if not is_letter.any():
        return darkness, 0
    return np.where(is_letter[labels], np.float32(0.0), darkness), int(is_letter.sum())


def _are_letters(
    marks: Int[np.ndarray, "n 5"], thickness: Float[np.ndarray, " n"], extent_px: float
) -> Bool[np.ndarray, " n"]:
    """Which marks, each (u, v, width, height, pixels) of its box, are letters; the first is the paper."""
    result = np.zeros(len(marks), dtype=bool)
    may_be = marks[:, 2:4].max(axis=1) < _HIGHEST * extent_px
    may_be[0] = False
    most_ink = marks[1:, 4].max(initial=0)
    idx = np.flatnonzero(may_be)
    for axes in ((0, 1), (1, 0)):  # lines along rows, and text turned by a quarter
        boxes = marks[idx][:, [*axes, *(2 + axis for axis in axes), 4]]
        slim = boxes[:, 3] / thickness[idx]
        group = _lines(boxes.astype(float))
        lines = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
        for own in filter(len, lines):
            own = own[boxes[own, 4] < _MOST_INK * np.median(boxes[own, 4])]
            # Walls of a building hang together; what has more ink than any mark is one in pieces.
            is_line = len(own) >= _LEAST_LETTERS and boxes[own, 4].sum() < most_ink
            if is_line and np.median(slim[own]) < _SLIM and _is_text(boxes[own]):
                result[idx[own]] = True
    return result


def _lines(boxes: Float[np.ndarray, "n 5"]) -> Int[np.ndarray, " n"]:
    """Line of each box (along, across, length, height, pixels): close behind one another and as high."""
    along, across, length, height = boxes[:, :4].T
    reach = _NEXT * height
    ahead = shapely.box(along, across, along + length + reach, across + height)
    own = shapely.box(along, across, along + length, across + height)
    a, b = shapely.STRtree(own).query(ahead, predicate="intersects")
    common = np.minimum((across + height)[a], (across + height)[b]) - np.maximum(
        across[a], across[b]
    )
    lower = np.minimum(height[a], height[b])
    is_next = (
        (a != b)
        & (common > 0.5 * lower)
        & (np.maximum(height[a], height[b]) < _LIKE_HEIGHT * lower)
    )
    return connected_groups(a[is_next], b[is_next], len(boxes))


def _is_text(boxes: Int[np.ndarray, "k 5"]) -> bool:
    """Whether most marks of a line are no bars, and they differ as letters do."""
    ink = boxes[:, 4] / (boxes[:, 2] * boxes[:, 3])
    varied = np.hypot(np.std(boxes[:, 2]) / np.mean(boxes[:, 2]), np.std(ink) / np.mean(ink))
    return bool(np.median(ink) < _SOLID_BAR and varied > _VARIED)
