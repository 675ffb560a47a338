"""How much the blocks of a DXF expand to, counted before anything is expanded.

Blocks hold blocks, and an insertion repeats its block in rows and columns: forty levels of ten, or 30,000
rows by 30,000 columns, are a few lines in a file and more than any memory once drawn out.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ezdxf.document import Drawing as Document

from planfit.errors import FloorplanError, printable

MAX_ENTITIES = 2_000_000
"""Large buildings have some hundred thousand."""
_BY_NAME = {"INSERT": "name", "DIMENSION": "geometry"}
"""Entities that show a block, and where they name it."""


def check_expansion(path: Path, document: Document) -> None:
    """Raise unless the model space, drawn out, has at most `MAX_ENTITIES` entities.

    Raises:
        FloorplanError: it has more, or a block holds itself.
    """
    counts: dict[str, int] = {}
    drawn: dict[str, int] = {}
    total = _count(path, document, document.modelspace(), (counts, drawn), ())
    if total > MAX_ENTITIES:
        name = max(drawn, key=drawn.__getitem__, default="")
        which = (
            f", {_shown(drawn[name])} by one insertion of the block '{printable(name)}'"
            if name
            else ""
        )
        raise FloorplanError(
            f"{path}: expected at most {MAX_ENTITIES:,} entities, found {_shown(total)} once blocks are "
            f"drawn out{which}; export the floor alone, without that block"
        )


def _shown(count: int) -> str:
    return f"{count:,}" if count < 10**12 else f"more than 10^{len(str(count)) - 1}"


def _count(
    path: Path,
    document: Document,
    space: Iterable[Any],
    found: tuple[dict[str, int], dict[str, int]],
    within: tuple[str, ...],
) -> int:
    """Entities of a space once its blocks are drawn out.

    What is found of each block, by its name: its entities, and the most that an insertion of it draws.
    """
    counts, drawn = found
    total = 0
    for entity in space:
        attribute = _BY_NAME.get(entity.dxftype())
        name = str(entity.dxf.get(attribute, "")).lower() if attribute else ""
        if not name or name not in document.blocks:
            total += 1
            continue
        if name in within:
            raise FloorplanError(
                f"{path}: expected blocks that hold other blocks, found '{printable(name)}' inside itself; "
                "repair the drawing (AUDIT in AutoCAD), or export the floor alone"
            )
        if name not in counts:
            block = document.blocks.get(name)
            counts[name] = _count(path, document, block, found, (*within, name))
        times = 1
        if entity.dxftype() == "INSERT":
            times = max(entity.dxf.row_count, 1) * max(entity.dxf.column_count, 1)
        n = times * max(counts[name], 1)
        drawn[name] = max(drawn.get(name, 0), n)
        total += n
    return total
