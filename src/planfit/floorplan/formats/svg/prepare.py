"""The text of an SVG made safe and quick to read: bounded, without entities, transforms multiplied."""

import gzip
import math
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.parsers import expat

from svgelements import Matrix

from planfit.errors import FloorplanError
from planfit.floorplan.formats import MAX_UNPACKED_BYTES
from planfit.floorplan.formats.svg.rules import SVG_NAMESPACE

MAX_REPEATED = 300_000
"""Elements that an SVG may have once each `use` is replaced by what it names."""
GROUP_TRANSFORM = "data-planfit-transform"
"""Attribute of a group whose own transform moved into its shapes: from its user space to the root's."""
PARSE_ERRORS = (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError)
"""What svgelements raises of elements that it cannot read."""
_GROUPS = {f"{SVG_NAMESPACE}{name}" for name in ("g", "a", "switch")}
_APART_NAMES = "defs clipPath mask pattern marker metadata title desc style"
_APART = {f"{SVG_NAMESPACE}{name}" for name in _APART_NAMES.split()}
_REUSING = {f"{SVG_NAMESPACE}{name}" for name in ("use", "symbol", "svg", "image")}
_XLINK = "http://www.w3.org/1999/xlink"
_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
_HREFS = ("href", f"{{{_XLINK}}}href")


def load_safely(path: Path) -> tuple[ET.Element, int]:
    """The root of an SVG or SVGZ, known to be harmless, and how many other files it names.

    Raises:
        FloorplanError: it is empty or damaged, no well-formed XML, declares entities, or repeats elements
            without bound.
    """
    data, n_references = _checked(path)
    root = ET.fromstring(data)
    n = elements_when_expanded(root)
    # Elements are repeated without bound as entities can be.
    if n > max(MAX_REPEATED, data.count(b"<")):
        found = "one that repeats itself" if math.isinf(n) else f"{n:.3g} elements by repetition"
        raise FloorplanError(
            f"{path}: expected an SVG of at most {MAX_REPEATED} elements by `use`, found {found}; "
            "save it again as plain SVG, with clones unlinked"
        )
    return root, n_references


def _checked(path: Path) -> tuple[bytes, int]:
    """The text of the file, once it is known to be harmless, and how many outside files it names.

    A first pass with a bare parser: entities can grow without bound or name files and addresses.
    """
    data = path.read_bytes()
    if data[:2] == b"\x1f\x8b":
        data = _unzipped(path)
    if not data.strip():
        raise FloorplanError(f"{path}: expected an SVG, found an empty file; export it again")
    references = 0
    used, declared = {""}, {"xml", "xmlns"}
    root_at: list[int] = []

    def refuse_entity(*_: object) -> None:
        raise FloorplanError(
            f"{path}: expected an SVG without entities, found an ENTITY declaration, which can load "
            "other files or grow without bound; save it again as plain SVG"
        )

    def note_names(tag: str, attributes: dict[str, str]) -> None:
        nonlocal references
        if not root_at:
            begin = f"<{tag}".encode()
            at = parser.CurrentByteIndex
            # Other encodings than UTF-8 are left as they are.
            root_at.append(at + len(begin) if data.startswith(begin, at) else 0)
        used.update(name.split(":")[0] for name in (tag, *attributes) if ":" in name)
        declared.update(name[len("xmlns:") :] for name in attributes if name.startswith("xmlns"))
        for name, value in attributes.items():
            is_link = name in ("href", "xlink:href") or name.endswith(":href")
            if is_link and not value.startswith(("#", "data:")):
                references += 1

    parser = expat.ParserCreate()
    parser.EntityDeclHandler = refuse_entity
    parser.ExternalEntityRefHandler = refuse_entity  # type: ignore[assignment] - it never returns
    parser.StartElementHandler = note_names
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise FloorplanError(
            f"{path}: expected an SVG, found no well-formed XML ({error}); export it again"
        ) from error
    lacking = sorted(used - declared) if root_at[0] else []
    return _with_namespaces(data, root_at[0], lacking), references


def _with_namespaces(data: bytes, at: int, prefixes: Sequence[str]) -> bytes:
    """The text with namespaces declared in its root, at a byte: of prefixes that it uses as pages of the web
    do, without a word on them. The one of no prefix is SVG's own."""
    known = {"": SVG_NAMESPACE[1:-1], "xlink": _XLINK, "inkscape": _INKSCAPE}
    lacking = "".join(
        f' xmlns{":" if each else ""}{each}="{known.get(each, f"urn:{each}")}"' for each in prefixes
    )
    return data[:at] + lacking.encode() + data[at:]


def _unzipped(path: Path) -> bytes:
    try:
        with gzip.open(path) as file:
            data = file.read(MAX_UNPACKED_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise FloorplanError(
            f"{path}: expected an SVG, found a damaged compressed file; export it again"
        ) from error
    if len(data) > MAX_UNPACKED_BYTES:
        raise FloorplanError(
            f"{path}: expected an SVG of at most {MAX_UNPACKED_BYTES // 10**6} MB, found more; "
            "save a smaller part of it"
        )
    return data


def elements_when_expanded(root: ET.Element) -> float:
    """Number of elements with each `use` replaced by what it names; infinite where one names itself.

    Each element is counted once and remembered, so that ten levels of ten uses take no time.
    """
    by_id = {e.get("id"): e for e in root.iter() if e.get("id")}
    size: dict[ET.Element, float] = {}
    begun: set[ET.Element] = set()
    stack = [root]
    while stack:
        element = stack[-1]
        parts = list(element)
        if element.tag == f"{SVG_NAMESPACE}use":
            name = next((element.get(key, "") for key in _HREFS if element.get(key)), "")
            target = by_id.get(name.removeprefix("#")) if name.startswith("#") else None
            parts += [] if target is None else [target]
        if element in size:
            stack.pop()
        elif element in begun:
            size[element] = 1.0 + sum(size.get(part, math.inf) for part in parts)
            stack.pop()
        elif any(part in begun and part not in size for part in parts):
            return math.inf  # it names one that it is in
        else:
            begun.add(element)
            stack.extend(part for part in parts if part not in size)
    return size[root]


def set_symbols_apart(root: ET.Element) -> None:
    """Put each symbol into a `defs` of its own: svgelements draws them where they are defined."""
    found = [
        (parent, k, child)
        for parent in root.iter()
        for k, child in enumerate(parent)
        if child.tag == f"{SVG_NAMESPACE}symbol"
    ]
    for parent, k, symbol in found:
        definitions = ET.Element(f"{SVG_NAMESPACE}defs")
        definitions.append(symbol)
        parent[k] = definitions


def drop_broken(root: ET.Element, read: Callable[[ET.Element], object]) -> int:
    """Take out the elements that cannot be read alone, which draw nothing by the standard; their number."""
    n_broken = 0
    for parent in list(root.iter()):
        for child in [child for child in parent if len(child) == 0 and isinstance(child.tag, str)]:
            alone = ET.Element(f"{SVG_NAMESPACE}svg")
            alone.append(child)
            try:
                read(alone)
            except PARSE_ERRORS:
                parent.remove(child)
                n_broken += 1
    return n_broken


def flatten_transforms(root: ET.Element) -> None:
    """Move the transforms of groups into their shapes.

    svgelements parses the transforms of all ancestors again for every shape: drawings converted from PDF
    nest a hundred deep, and took 4.5 s of 7. Files that use an element twice stay as they are.
    """
    is_reusing = any(e.tag in _REUSING for e in root.iter() if e is not root)
    if root.tag != f"{SVG_NAMESPACE}svg" or is_reusing:
        return
    stack = [(child, Matrix()) for child in root]
    while stack:
        element, root_from_parent = stack.pop()
        if element.tag in _APART or not isinstance(element.tag, str):
            continue
        own = element.attrib.pop("transform", "")
        # svgelements: the left factor acts first.
        root_from_own = Matrix(own) * root_from_parent if own else root_from_parent
        text = "" if root_from_own.is_identity() else _written(root_from_own)
        if element.tag in _GROUPS:
            if text:
                element.set(GROUP_TRANSFORM, text)
            stack.extend((child, root_from_own) for child in element)
        elif text:
            element.set("transform", text)


def _written(m: Matrix) -> str:
    return f"matrix({m.a!r},{m.b!r},{m.c!r},{m.d!r},{m.e!r},{m.f!r})"
