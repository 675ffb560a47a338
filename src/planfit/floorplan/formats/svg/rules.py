"""Rules of the style sheets in an SVG, parsed by tinycss2: which hold, and which elements they select.

Selectors are matched here and not by cssselect2, which turns those of the file into Python and evaluates it,
in a time that grows with the power of the depth: `x g g g g g` takes 4.6 s for one element in 80 groups.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import tinycss2

SVG_NAMESPACE = "{http://www.w3.org/2000/svg}"
STYLE = f"{SVG_NAMESPACE}style"
_DYNAMIC = re.compile(r":(hover|focus|focus-within|focus-visible|active|visited|target|checked)|::")
"""What no printed page shows."""
_SHOWN = re.compile(r"(only\s+)?(screen|all)|\(\s*prefers-color-scheme\s*:\s*light\s*\)", re.I)
"""Media of the drawing as it is read."""
_MAX_DEPTH, _MAX_NESTED = 8, 4096
"""Levels of rules within rules, and selectors that these have together: each level may multiply them."""


def facts_of(element: ET.Element, is_root: bool) -> frozenset[str]:
    """What selectors can ask of an element by itself, written as they write it."""
    facts = [element.tag.removeprefix(SVG_NAMESPACE), f"#{element.get('id')}"]
    facts += [f".{name}" for name in (element.get("class") or "").split()]
    for name, value in element.attrib.items():
        facts += [f"[{name}]", f"[{name}={value}]"]
    return frozenset([*facts, ":root"] if is_root else facts)


@dataclass(frozen=True)
class Selector:
    """Facts of an element and of those around it."""

    compounds: tuple[frozenset[str], ...]
    """Facts (`facts_of`), from the outermost element to the one that is selected."""
    is_child: tuple[bool, ...]
    """Whether each is of a child of what the one before selects, not of any descendant."""

    @property
    def specificity(self) -> tuple[int, int, int]:
        """Ids; classes and attributes; names of elements."""
        marks = [fact[0] for compound in self.compounds for fact in compound]
        n_ids, n_classes = marks.count("#"), sum(mark in ".[:" for mark in marks)
        return n_ids, n_classes, len(marks) - n_ids - n_classes

    @property
    def key(self) -> str:
        """A fact of every element that it selects, ids and classes first; empty where there is none."""
        return min(self.compounds[-1], default="")

    def matches(self, path: Sequence[frozenset[str]]) -> bool:
        """Whether the last element of a path from the root, given by facts, is one of those selected."""
        # Indices that the compound may lie at; each element is looked at once a compound.
        candidates = {len(path) - 1}
        for compound, is_child in zip(self.compounds[::-1], self.is_child[::-1], strict=True):
            at = {i for i in candidates if compound <= path[i]}
            if not at:
                return False
            candidates = {i - 1 for i in at if i > 0} if is_child else set(range(max(at)))
        return True


@dataclass(frozen=True)
class Declaration:
    """A property that a rule or an element sets."""

    name: str
    """In lower case, but for variables."""
    value: str
    is_important: bool


@dataclass(frozen=True)
class Rule:
    """What one selector sets."""

    words: str
    """The selector as it is written."""
    declarations: tuple[Declaration, ...]

    @property
    def is_dynamic(self) -> bool:
        """Whether it is of what changes under a pointer, or of parts that are no shapes."""
        return _DYNAMIC.search(self.words) is not None


@lru_cache(maxsize=4096)  # the elements of a drawing share few styles
def parse_declarations(text: str) -> tuple[Declaration, ...]:
    """What a `style` attribute sets, in order."""
    return _declarations(tinycss2.parse_blocks_contents(text, skip_comments=True))


def parse_rules(text: str) -> Iterator[Rule]:
    """Rules of a style sheet by single selectors. Those of a screen count; those for print, for dark pages or
    for widths do not. Rules within rules have the selectors of both."""
    return _rules(tinycss2.parse_stylesheet(text, skip_comments=True), [], 0)


def _rules(nodes: Sequence[Any], outer: list[str], depth: int) -> Iterator[Rule]:
    """Those of a sheet, or of what stands between the braces of a rule with the selectors `outer`."""
    declarations = _declarations(nodes)
    if declarations:
        yield from (Rule(selector, declarations) for selector in outer)
    for node in nodes if depth <= _MAX_DEPTH else ():
        if node.type == "qualified-rule":
            inner = _nested(outer, node.prelude)
        elif node.type == "at-rule" and node.content is not None and _holds(node):
            inner = outer
        else:
            continue
        contents = tinycss2.parse_blocks_contents(node.content, skip_comments=True)
        yield from _rules(contents, inner, depth + 1)


def _declarations(nodes: Sequence[Any]) -> tuple[Declaration, ...]:
    found = [node for node in nodes if node.type == "declaration"]
    names = [each.name if each.name.startswith("--") else each.lower_name for each in found]
    return tuple(
        Declaration(name, _text(each.value), each.important)
        for name, each in zip(names, found, strict=True)
    )


def _text(tokens: Sequence[Any]) -> str:
    try:
        return tinycss2.serialize(tokens).strip()
    except RecursionError:  # brackets within brackets: no selector, nor a value of any property
        return ""


def _holds(rule: Any) -> bool:
    """Whether rules within an at-rule are those of a drawing on a light screen."""
    if rule.lower_at_keyword == "media":
        return _SHOWN.fullmatch(_text(rule.prelude)) is not None
    return rule.lower_at_keyword in ("supports", "layer")


def split(tokens: Sequence[Any], marks: str) -> list[tuple[str, list[Any]]]:
    """Lists of tokens, each with the mark before it; before the first it is the first of `marks`."""
    result: list[tuple[str, list[Any]]] = [(marks[0], [])]
    for token in tokens:
        if token.type == "literal" and token.value in marks:
            result.append((token.value, []))
        else:
            result[-1][1].append(token)
    return result


def _nested(outer: list[str], prelude: Sequence[Any]) -> list[str]:
    """Selectors of a rule in a rule with the selectors `outer`; none where there are too many."""
    inner = [_text(part) for _, part in split(prelude, ",")]
    if not outer or len(outer) * len(inner) > _MAX_NESTED:
        return [] if outer else inner
    return [
        one.replace("&", around) if "&" in one else f"{around} {one}"
        for around in outer
        for one in inner
    ]


def parse_selector(text: str) -> Selector | None:
    """None where it is of a kind that is not known (`:not`, siblings)."""
    compounds: list[set[str]] = []
    is_child: list[bool] = []
    is_new, is_next_child = True, False
    left: list[Any] = tinycss2.parse_component_value_list(text, skip_comments=True)[::-1]
    while left:
        token = left.pop()
        if token.type == "whitespace" or token == ">":
            is_new, is_next_child = True, is_next_child or token == ">"
            continue
        if is_new:
            compounds.append(set())
            is_child.append(is_next_child)
            is_new, is_next_child = False, False
        mark = token.value if token.type == "literal" else ""
        if mark in (".", ":") and left and left[-1].type == "ident":
            fact = mark + left.pop().value
        else:
            fact = _fact(token)
        if not fact or (fact[0] == ":" and fact != ":root"):
            return None
        compounds[-1].add(fact)
    selected = tuple(frozenset(facts - {"*"}) for facts in compounds)
    return Selector(selected, tuple(is_child)) if compounds else None


def _fact(token: Any) -> str:
    """What one token asks of an element; empty where that is not known."""
    if token.type == "hash":
        return f"#{token.value}"
    if token.type == "ident" or (token.type == "literal" and token.value == "*"):
        return token.value
    if token.type == "[] block":
        match [each for each in token.content if each.type != "whitespace"]:
            case [name] if name.type == "ident":
                return f"[{name.value}]"
            case [name, "=", value] if name.type == "ident" and value.type in ("ident", "string"):
                return f"[{name.value}={value.value}]"
    return ""
