"""What a DXF holds, looked at before it is drawn out: how much its blocks expand to, and what is not read.

Blocks hold blocks, and an insertion repeats its block in rows and columns: forty levels of ten, or 30,000
rows by 30,000 columns, are a few lines in a file and more than any memory once drawn out. Other files, bodies
in space and layouts are no plan.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ezdxf.document import Drawing as Document

from planfit.errors import FloorplanError, printable
from planfit.findings.finding import FEW_NAMED

MAX_ENTITIES = 2_000_000
"""Large buildings have some hundred thousand."""
MAX_STEPS, MAX_REPEATED = 200_000, 500
"""Drawing blocks out takes about 60 us an entity and 140 us an insertion. A file may ask for this many steps
(15 s at most), or for this many for each entity that it holds, whichever is more."""
_BY_NAME = {"INSERT": "name", "DIMENSION": "geometry"}
"""Entities that show a block, and where they name it."""
_BODIES = {"MESH", "3DSOLID", "BODY", "REGION", "SURFACE", "EXTRUDEDSURFACE", "LOFTEDSURFACE"}
_FLAT = 1e-6
"""A face is upright where its area seen from above is less than this share of its box's diagonal squared."""


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


def unread_words(document: Document, space: Any) -> tuple[str, ...]:
    """A sentence for each kind of thing of a space that is not read, with what to do."""
    return tuple(filter(None, (_other_files(document, space), _bodies(space))))


def only_layout(document: Document) -> Any | None:
    """The layout with the most on it of a drawing whose model space is empty; None of others."""
    if len(document.modelspace()) > 0:
        return None
    layouts = (each for each in document.layouts if not each.is_modelspace and len(each) > 0)
    return max(layouts, key=len, default=None)


def _other_files(document: Document, space: Any) -> str:
    names = {insert.dxf.name for insert in space.query("INSERT")}
    blocks: list[Any] = [document.blocks.get(name) for name in sorted(names)]
    heads = [block.block for block in blocks if block is not None]
    paths = [
        head.dxf.get("xref_path", "") or head.dxf.name
        for head in heads
        if head.is_xref or head.is_xref_overlay
    ]
    if not paths:
        return ""
    more = f" and {len(paths) - FEW_NAMED} more" if len(paths) > FEW_NAMED else ""
    listed = ", ".join(paths[:FEW_NAMED]) + more
    count = "another file" if len(paths) == 1 else f"{len(paths)} other files"
    return (
        f"the drawing shows {count}, which is not in it and so not read ({listed}): bind it (XREF, Bind) "
        "and save again, or give that file"
    )


def _bodies(space: Any) -> str:
    count: Counter[str] = Counter()
    for entity in space:
        kind = entity.dxftype()
        is_net = kind == "POLYLINE" and not entity.is_2d_polyline and not entity.is_3d_polyline
        if kind in _BODIES or is_net or (kind == "3DFACE" and _is_upright(entity)):
            count["polyface" if is_net else kind] += 1
    if not count:
        return ""
    listed = ", ".join(f"{n} of {kind}" for kind, n in sorted(count.items()))
    return (
        f"{sum(count.values())} bodies or upright faces in space are not read ({listed}): export the model "
        "as IFC, OBJ or STL, which are cut at --cut-height-m, or its section as lines"
    )


def _is_upright(face: Any) -> bool:
    corners = face.wcs_vertices()
    doubled = sum(
        a.x * b.y - a.y * b.x for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    )
    spans = [max(c[k] for c in corners) - min(c[k] for c in corners) for k in range(3)]
    return abs(doubled) < _FLAT * sum(span**2 for span in spans)
