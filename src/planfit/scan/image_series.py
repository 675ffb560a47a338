"""Files of a folder that no layout names: series whose names differ by a number, and which of them show what.

files -> series by pattern -> colour and depth, by words and pixels -> the plainest pair -> frames
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

import cv2
import numpy as np

from planfit.errors import ScanError
from planfit.scan.images.decode import decode_image
from planfit.scan.poses import join_times
from planfit.scan.source import MAX_NAME, FileSource, in_order

DEEPEST, MAX_FOLDERS = 2, 50
"""Folders in folders that are looked at, and how many: data sets keep images in `cam0/data/`; who has more
keeps several scans."""


def words_of(name: str) -> frozenset[str]:
    """Words and numbers of a name with folders, in lower case; `leftImage` is two."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return frozenset(re.findall(r"[a-z]+|\d+", apart.lower()))


COLORS = words_of(
    "rgb rgbs color colors colour colours image images img imgs frame frames photo photos"
)
CAMERAS = words_of("left cam camera")
"""Words of images that are colour, too, and of one of several cameras perhaps."""
DEPTHS = words_of("depth depths depthmap depthmaps map maps")
NEITHER = re.compile(
    "masks?|conf.*|normals?|sem.*|segm?.*|labels?|inst.*|flows?|vis.*|viz|preview|disp.*|ir|infra.*|uncert.*|"
    "thumb.*|errors?|albedo|objects?"
)
"""Words of images that are neither colour nor depth."""
COLOR_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".webp")
DEPTH_SUFFIXES = (".png", ".pgm", ".tif", ".tiff", ".npy", ".exr")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_CLOCK_DIGITS = 10
"""Seconds since 1970 have so many before the point until 2286; more are of a smaller unit."""


@dataclass(frozen=True)
class Series:
    """Files that differ by what `{}` stands for in their names alone."""

    pattern: str
    names: dict[str, str]
    """By the number in each, without leading zeros, in order."""

    @property
    def suffix(self) -> str:
        """Of all, in lower case."""
        return PurePosixPath(self.pattern).suffix.lower()

    @property
    def first(self) -> str:
        """Name of the first file."""
        return next(iter(self.names.values()))

    @cached_property
    def words(self) -> frozenset[str]:
        """Of the pattern and its folders, with numbers of these, in lower case."""
        return words_of(str(PurePosixPath(self.pattern).with_suffix("")))

    @property
    def place(self) -> str:
        """Its folder, or the pattern where that is the scan's."""
        return f"{PurePosixPath(self.pattern).parent}/" if "/" in self.pattern else self.pattern


@dataclass(frozen=True)
class Paired:
    """Colour and depth of the same moments."""

    color: Series
    depth: Series
    frames: list[tuple[str, str]]
    """Keys of both, in order; empty where one has no partner."""
    told: tuple[str, ...] = ()
    """What to say of how they were paired."""

    @property
    def keys(self) -> list[str]:
        """Of the frames: of their colour, else of their depth."""
        return [color or depth for color, depth in self.frames]


def time_of(key: str) -> float:
    """A number in a name as s, where it is long enough for a time since 1970 in any unit; else the number."""
    n_digits = len(key.partition(".")[0])
    return float(key) / 10.0 ** max(0, n_digits - _CLOCK_DIGITS)


def all_files(source: FileSource) -> list[str]:
    """Names of all files, not deeper than `DEEPEST`; none where there are too many folders."""
    found, folders = [], [""]
    for folder in folders:  # grows
        try:
            names = source.names(folder)
            inside = source.folders(folder) if folder.count("/") < DEEPEST else []
        except OSError:  # a folder that may not be read
            continue
        found += [f"{folder}{name}" for name in names if not name.startswith(".")]
        folders += [f"{folder}{one}/" for one in inside if one[0] not in "._"]
        if len(folders) > MAX_FOLDERS:
            return []
    return found


def series_of(names: Iterable[str]) -> list[Series]:
    """Series of two files or more; where names have several numbers, those that tell frames apart."""
    groups: dict[str, list[tuple[list[str], str]]] = {}
    for name in names:
        if "{" in name or len(name) > MAX_NAME:
            continue  # archives may hold any
        folder, _, last = name.rpartition("/")
        stem, dot, suffix = last.rpartition(".")
        pattern = f"{folder}/{_NUMBER.sub('{}', stem)}{dot}{suffix}".lstrip("/")
        groups.setdefault(pattern, []).append((_NUMBER.findall(stem), name))
    return [one for pattern, files in groups.items() for one in _told_apart(pattern, files)]


def _told_apart(pattern: str, files: list[tuple[list[str], str]]) -> Iterator[Series]:
    """By the first number that no two files share; else apart by the first that has several values."""
    if len(files) < 2:
        return
    columns = list(zip(*(numbers for numbers, _ in files), strict=True))
    at = next((i for i, one in enumerate(columns) if len(set(one)) == len(one)), None)
    if at is not None:
        by_key = {_plain(numbers[at]): name for numbers, name in files}
        shown = iter("{}" if i == at else one[0] for i, one in enumerate(columns))
        whole = re.sub(r"\{\}", lambda _: next(shown), pattern)
        yield Series(whole, dict(sorted(by_key.items(), key=lambda one: in_order(one[0]))))
        return
    at = next((i for i, one in enumerate(columns) if len(set(one)) > 1), 0)
    for value in sorted(set(columns[at]) if columns else ()):
        head = pattern.split("{}")
        same = [([*n[:at], *n[at + 1 :]], name) for n, name in files if n[at] == value]
        yield from _told_apart(
            "{}".join([*head[:at], f"{head[at]}{value}{head[at + 1]}", *head[at + 2 :]]), same
        )


def _plain(number: str) -> str:
    return number if "." in number else str(int(number))


def last_number(name: str) -> str:
    """Of a name, without leading zeros; empty where it has none."""
    found = _NUMBER.findall(name)
    return _plain(found[-1]) if found else ""


def find_pair(
    source: FileSource, series: list[Series], wanted: tuple[str, str], max_gap_s: float
) -> Paired | None:
    """Colour and depth of one camera: those with the fewest words beside those for colour and depth; None
    where there are none.

    Args:
        source: the files.
        series: of the files.
        wanted: folders or patterns of colour and depth that the user named; empty: any.
        max_gap_s: largest difference of times in names.

    Raises:
        ScanError: several would do, or none is of the name that is wanted.
    """
    colors, depths = (
        [one for one in series if is_one(one) and (not name or name.strip("/") in one.pattern)]
        for is_one, name in zip((_may_be_color, _may_be_depth), wanted, strict=True)
    )
    colors = [one for one in colors if _pixels(source, one) == "colour"]
    depths = [one for one in depths if _pixels(source, one) == "depth"]
    found = [
        (*_oddity(color, depth), pair)
        for color in colors
        for depth in depths
        if (pair := _pair(color, depth, max_gap_s)) is not None
    ]
    if not found:
        return None
    best = min(one[:2] for one in found)
    chosen = [one[2] for one in found if one[:2] == best]
    if len(chosen) > 1:
        color, depth = (
            ", ".join(sorted({one.place for one in kind}))
            for kind in ([one.color for one in chosen], [one.depth for one in chosen])
        )
        raise ScanError(
            f"{source.path}: expected images of one camera, found colour in {color} and depth in {depth}; "
            "give the folder of one camera, or name its images with --color-topic and --depth-topic"
        )
    pair = chosen[0]
    others = sorted(
        {one.place for one in (*colors, *depths)} - {pair.color.place, pair.depth.place}
    )
    told = list(pair.told)
    if others:
        told.append(
            f"colour of {pair.color.place} and depth of {pair.depth.place} are read; not {', '.join(others)}"
        )
    beside = [one for one in (*colors, *depths) if one not in (pair.color, pair.depth)]
    if n_left := sum(len(one.names) for one in beside if one.place not in others):
        told.append(
            f"{n_left} images beside {pair.color.pattern} and {pair.depth.pattern} were not read: their "
            "names differ by more than a number"
        )
    return Paired(pair.color, pair.depth, pair.frames, tuple(told))


def _may_be_depth(one: Series) -> bool:
    is_depth = any("depth" in word for word in one.words)
    return is_depth and one.suffix in DEPTH_SUFFIXES and not _is_neither(one)


def _may_be_color(one: Series) -> bool:
    is_depth = any("depth" in word for word in one.words)
    shows = bool(one.words & COLORS) or bool(one.words & CAMERAS)
    return shows and not is_depth and one.suffix in COLOR_SUFFIXES and not _is_neither(one)


def _is_neither(one: Series) -> bool:
    return any(NEITHER.fullmatch(word) for word in one.words)


def _pixels(source: FileSource, one: Series) -> str:
    """What the first image may show: depth has one channel of 16 bits or of floating-point numbers."""
    if one.suffix in (".npy", ".exr"):
        return "depth"
    try:
        image = decode_image(source.read(one.first), Path(one.first), cv2.IMREAD_UNCHANGED)
    except ScanError:
        return ""
    return "colour" if image.dtype == np.uint8 else "depth" if image.ndim == 2 else ""


def _oddity(color: Series, depth: Series) -> tuple[int, int]:
    """How many words only one of both has, and how many both have, beside those for colour and depth."""
    a, b = color.words - COLORS, {w for w in depth.words - DEPTHS - COLORS if w != "depth"}
    return len(a ^ b), len(a & b)


def _pair(color: Series, depth: Series, max_gap_s: float) -> Paired | None:
    """None where nothing tells which images are of one moment."""
    found = partners(list(color.names), list(depth.names), max_gap_s)
    if found is None:
        return None
    told = f"names of {color.place} and {depth.place} count from other numbers: they are paired in order"
    return Paired(color, depth, found[0], (told,) if found[1] else ())


def partners(
    keys: list[str], others: list[str], max_gap_s: float
) -> tuple[list[tuple[str, str]], bool] | None:
    """What belongs together of two series of numbers in names, each once and in order, empty where one has no
    partner, and whether it is their order alone that tells; None where nothing does.

    Equal numbers are partners, else nearest times; of two that count one by one from other numbers the first
    of each is.
    """
    keys, others = (sorted(one, key=in_order) for one in (keys, others))
    least = (
        min(len(keys), len(others)) / 2
    )  # names tell where most of the shorter series have partners
    shared = set(keys) & set(others)
    if len(keys) == len(others) > len(shared) and _is_gapless(keys) and _is_gapless(others):
        return list(zip(keys, others, strict=True)), True
    if len(shared) >= least:
        together = sorted({*keys, *others}, key=in_order)
        ones, twos = set(keys), set(others)
        return [(k if k in ones else "", k if k in twos else "") for k in together], False
    times, other_times = (np.array([time_of(key) for key in one]) for one in (keys, others))
    i, j, _ = join_times(times, other_times, max_gap_s)
    if ((i >= 0) & (j >= 0)).sum() < least:
        return None
    pairs = zip(i, j, strict=True)
    return [(keys[a] if a >= 0 else "", others[b] if b >= 0 else "") for a, b in pairs], False


def _is_gapless(keys: list[str]) -> bool:
    """Whether names count frames one by one."""
    return all(key.isdecimal() for key in keys) and int(keys[-1]) - int(keys[0]) == len(keys) - 1
