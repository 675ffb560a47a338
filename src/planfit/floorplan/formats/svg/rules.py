"""Rules of the style sheets in an SVG: which hold, and which elements they are of.

Not by cssselect2, whose selectors are Python that it makes of the file and evaluates, in a time that grows
with the power of the depth: `x g g g g g` takes 4.6 s for one element in 80 groups.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

SVG_NAMESPACE = "{http://www.w3.org/2000/svg}"
STYLE = f"{SVG_NAMESPACE}style"
_COMPOUND = re.compile(
    r"(?P<tag>[\w-]+|\*)?(?P<rest>(?:[.#][\w-]+|\[[\w:|\\-]+(?:\s*=\s*(?:\"[^\"\]]*\"|'[^'\]]*'|[\w-]+))?\])*)"
    r"(?P<root>:root)?"
)
_PART = re.compile(r"([.#])([\w-]+)|\[([\w-]+)(?:\s*=\s*[\"']?([^\"'\]]*)[\"']?)?\]")
_WORDS = re.compile(r"(?:\[[^\]]*\]|[^\s>\[])+|>")
_DYNAMIC = re.compile(r":(hover|focus|focus-within|focus-visible|active|visited|target|checked)|::")
"""What no printed page shows."""
_ALWAYS = re.compile(
    r"@media\s+((only\s+)?(screen|all)|\(\s*prefers-color-scheme\s*:\s*light\s*\))$|@supports\b|@layer\b"
)
_MOST_NESTED = 4096
"""Selectors that rules within rules have together: each level may multiply them."""


@dataclass(frozen=True)
class Rule:
    """What one selector sets."""

    selector: str
    declarations: tuple[tuple[str, str], ...]
    """Names of properties and values, in order."""


@dataclass(frozen=True)
class Compound:
    """What an element itself has to be."""

    tag: str
    """Empty: any."""
    id: str
    classes: frozenset[str]
    attributes: tuple[tuple[str, str | None], ...]
    is_root: bool

    def matches(self, element: ET.Element, is_root: bool) -> bool:
        """Whether an element is so."""
        if self.is_root and not is_root:
            return False
        if self.tag and element.tag != SVG_NAMESPACE + self.tag:
            return False
        if self.id and element.get("id") != self.id:
            return False
        if self.classes and not self.classes <= set((element.get("class") or "").split()):
            return False
        return all(
            element.get(name) is not None if value is None else element.get(name) == value
            for name, value in self.attributes
        )

    @property
    def specificity(self) -> tuple[int, int, int]:
        """Ids; classes and attributes; names of elements."""
        n_classes = len(self.classes) + len(self.attributes) + self.is_root
        return (int(bool(self.id)), n_classes, int(bool(self.tag)))


@dataclass(frozen=True)
class Selector:
    """Compounds from the outermost to the element's own."""

    compounds: tuple[Compound, ...]
    is_child: tuple[bool, ...]
    """Whether each but the first is of a child of what the one before is of, not of any descendant."""

    @property
    def specificity(self) -> tuple[int, int, int]:
        """Of all compounds together."""
        each = [compound.specificity for compound in self.compounds]
        return (sum(s[0] for s in each), sum(s[1] for s in each), sum(s[2] for s in each))

    def matches(self, path: list[ET.Element]) -> bool:
        """Whether the last element of a path from the root is one of those selected."""
        last = len(path) - 1
        if not self.compounds[-1].matches(path[last], last == 0):
            return False
        # Places where the compounds so far may lie; each element is looked at once a compound.
        at = {last}
        for k in range(len(self.compounds) - 2, -1, -1):
            inner = self.is_child[k]
            above = {i - 1 for i in at if i > 0} if inner else set(range(max(at)))
            at = {i for i in above if self.compounds[k].matches(path[i], i == 0)}
            if not at:
                return False
        return True


def without_comments(text: str) -> str:
    """A style sheet without its comments."""
    return "".join(part.partition("/*")[0] for part in text.split("*/"))


def split_declarations(text: str) -> Iterator[tuple[str, str]]:
    """Names and values of a `style` attribute, or of what stands between the braces of a rule."""
    for part in without_comments(text).split(";"):
        name, colon, value = part.partition(":")
        if colon and name.strip():
            yield name.strip(), value.strip()


def split_rules(text: str) -> Iterator[Rule]:
    """Rules that no condition holds in, by single selectors; those of a screen count, those for print, for
    dark pages or for widths do not.

    Rules within rules have the selectors of both.

    Args:
        text: of a style sheet.
    """
    opened: list[str | None] = []  # selectors; None: does not hold; empty: holds whatever it says
    declared: list[list[tuple[str, str]]] = []
    begun = ""
    for piece in re.split(r"([{};])", without_comments(text)):
        if piece == "{":
            opened.append(_opened(begun))
            declared.append([])
            begun = ""
        elif piece not in (";", "}"):
            begun = piece.strip()
        else:
            if declared:
                declared[-1].extend(split_declarations(begun))
            begun = ""
            if piece == "}" and opened:
                if None not in opened and declared[-1]:
                    for selector in _nested([each for each in opened if each]):
                        yield Rule(selector, tuple(declared[-1]))
                opened.pop()
                declared.pop()


def _opened(words: str) -> str | None:
    if not words.startswith("@"):
        return words
    return "" if _ALWAYS.match(words) else None


def _nested(levels: list[str]) -> list[str]:
    """Selectors of rules in rules, each of a list of them by itself."""
    if not levels or len(levels) > 8:
        return []
    result = [one.strip() for one in levels[0].split(",")]
    for level in levels[1:]:
        inner = [one.strip() for one in level.split(",")]
        if len(result) * len(inner) > _MOST_NESTED:
            return []
        result = [
            one.replace("&", outer) if "&" in one else f"{outer} {one}"
            for outer in result
            for one in inner
        ]
    return result


def parse_selector(text: str) -> Selector | None:
    """None where it is of a kind that is not known (`:not`, siblings)."""
    tokens = _WORDS.findall(text)
    compounds, is_child, is_next_child = [], [], False
    for token in tokens:
        if token == ">":
            is_next_child = True
            continue
        compound = _parse_compound(token)
        if compound is None:
            return None
        if compounds:
            is_child.append(is_next_child)
        compounds.append(compound)
        is_next_child = False
    return Selector(tuple(compounds), tuple(is_child)) if compounds else None


def _parse_compound(token: str) -> Compound | None:
    found = _COMPOUND.fullmatch(token)
    if found is None or not token:
        return None
    ids, classes, attributes = [], [], []
    for mark, name, attribute, value in _PART.findall(found["rest"] or ""):
        if mark == "#":
            ids.append(name)
        elif mark == ".":
            classes.append(name)
        else:
            attributes.append((attribute, value or None))
    tag = found["tag"] or ""
    return Compound(
        "" if tag == "*" else tag,
        ids[0] if ids else "",
        frozenset(classes),
        tuple(attributes),
        bool(found["root"]),
    )


def is_dynamic(selector: str) -> bool:
    """Whether it is of what changes under a pointer, or of parts that are no shapes."""
    return _DYNAMIC.search(selector) is not None
