"""How much the blocks of a DXF expand to, counted before anything is expanded.

Blocks hold blocks, and an insertion repeats its block in rows and columns: forty levels of ten, or 30,000
rows by 30,000 columns, are a few lines in a file and more than any memory once drawn out.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ezdxf.document import Drawing as Document

from planfit.errors import FloorplanError, printable

MAX_ENTITIES = 2_000_000
"""Large buildings have some hundred thousand."""
MAX_STEPS, MAX_REPEATED = 200_000, 500
"""Drawing blocks out takes about 60 us an entity and 140 us an insertion. A file may ask for this many steps
(15 s at most), or for this many for each entity that it holds, whichever is more."""
_BY_NAME = {"INSERT": "name", "DIMENSION": "geometry"}
"""Entities that show a block, and where they name it."""


@dataclass(frozen=True)
class _Drawn:
    """What a space, or an insertion of a block, comes to once drawn out."""

    entities: int = 0
    steps: int = 0
    """Entities and insertions on the way there: blocks that hold nothing cost their insertions."""

    def __add__(self, other: "_Drawn") -> "_Drawn":
        return _Drawn(self.entities + other.entities, self.steps + other.steps)


def check_expansion(path: Path, document: Document, space: Any) -> frozenset[str]:
    """Raise unless a space of a document can be drawn out: at most `MAX_ENTITIES` entities, in at most
    `MAX_STEPS` steps or `MAX_REPEATED` for each entity of the file.

    Returns:
        Names, in lower case, of blocks that show nothing, however deep: they need not be drawn out.

    Raises:
        FloorplanError: it has more, or a block holds itself.
    """
    counts: dict[str, _Drawn] = {}
    largest: dict[str, _Drawn] = {}
    total = _count(path, document, space, (counts, largest), ())
    name = max(largest, key=lambda each: largest[each].steps, default="")
    by_one = f"by one insertion of the block '{printable(name)}'"
    export = "export the floor alone, without that block"
    if total.entities > MAX_ENTITIES:
        which = f", {_shown(largest[name].entities)} {by_one}" if name else ""
        raise FloorplanError(
            f"{path}: expected at most {MAX_ENTITIES:,} entities, found {_shown(total.entities)} once "
            f"blocks are drawn out{which}; {export}"
        )
    held = sum(len(block) for block in document.blocks)
    most = max(MAX_STEPS, MAX_REPEATED * held)
    if total.steps - len(space) > most:
        raise FloorplanError(
            f"{path}: expected blocks that draw at most {most:,} entities and blocks within them, as the "
            f"file holds {held:,}, found {_shown(total.steps)}, {_shown(largest[name].steps)} {by_one}; "
            f"{export}"
        )
    return frozenset(name for name, drawn in counts.items() if drawn.entities == 0)


def _shown(count: int) -> str:
    return f"{count:,}" if count < 10**12 else f"more than 10^{len(str(count)) - 1}"


def _count(
    path: Path,
    document: Document,
    space: Iterable[Any],
    found: tuple[dict[str, _Drawn], dict[str, _Drawn]],
    within: tuple[str, ...],
) -> _Drawn:
    """What a space comes to once its blocks are drawn out.

    What is found of each block, by its name: what it comes to, and the most that an insertion of it draws.
    """
    counts, largest = found
    total = _Drawn()
    for entity in space:
        attribute = _BY_NAME.get(entity.dxftype())
        name = str(entity.dxf.get(attribute, "")).lower() if attribute else ""
        if not name or name not in document.blocks:
            total += _Drawn(1, 1)
            continue
        if name in within:
            raise FloorplanError(
                f"{path}: expected blocks that hold other blocks, found '{printable(name)}' inside itself; "
                "repair the drawing (AUDIT in AutoCAD), or export the floor alone"
            )
        if name not in counts:
            block = document.blocks.get(name)
            counts[name] = _count(path, document, block, found, (*within, name))
        times, n_texts = 1, 0
        if entity.dxftype() == "INSERT":
            times = max(entity.dxf.row_count, 1) * max(entity.dxf.column_count, 1)
            n_texts = len(entity.attribs)
        once = counts[name] + _Drawn(n_texts, n_texts + 1)
        drawn = _Drawn(times * once.entities, times * once.steps)
        if drawn.entities == 0 and not within:
            continue
        largest[name] = max(largest.get(name, _Drawn()), drawn, key=lambda each: each.steps)
        total += drawn
    return total
