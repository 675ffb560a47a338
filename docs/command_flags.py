"""What the dataclasses of the command line are called there: flags, groups of flags, their docstrings."""

import ast
import dataclasses
import inspect
import re
import textwrap
import typing
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import tyro


@dataclass(frozen=True)
class Flag:
    """One value that a command takes."""

    path: tuple[str, ...]
    """Names of the fields that lead to it, as in Python."""
    prefix: str
    """What stands before its own name on the command line: `--adjust.walls.`."""
    type: Any
    default: Any
    """`dataclasses.MISSING` where it must be given."""
    words: str
    """Its docstring."""
    aliases: tuple[str, ...] = ()
    is_positional: bool = False
    is_computed: bool = False
    is_paired: bool = True
    """Whether a switch can be switched off by `--no-NAME`."""
    metavar: str = ""
    """What is written behind it, where its type does not say."""
    is_repeated: bool = False
    """Whether several values take the flag once each, not once for all."""

    @property
    def name(self) -> str:
        """As on the command line."""
        own = self.path[-1].replace("_", "-")
        return own.upper() if self.is_positional else f"--{self.prefix}{own}"

    @property
    def shortest_name(self) -> str:
        """`-o`, where it has such an alias."""
        return self.aliases[0] if self.aliases else self.name

    @property
    def names(self) -> tuple[str, ...]:
        """All of them: aliases, and what switches it off."""
        own = self.path[-1].replace("_", "-")
        off = (f"--{self.prefix}no-{own}",) if self.type is bool and self.is_paired else ()
        return (self.name, *self.aliases, *off)


@dataclass(frozen=True)
class Group:
    """Flags of one dataclass, and what is nested in it."""

    prefix: str
    type: type
    words: str
    flags: tuple[Flag, ...]
    groups: tuple["Group", ...]
    shared: tuple[tuple[str, Any, Any], ...] = ()
    """Groups listed elsewhere: prefix, type, and the instance that is the default."""
    choices: tuple[tuple[str, "Group"], ...] = ()
    """Words that choose one of several kinds, and the flags of each."""
    default_choice: str = ""

    def all_choices(self) -> Iterator[str]:
        """The words that choose a kind, of the groups inside too."""
        yield from (word for word, _ in self.choices)
        for group in self.groups:
            yield from group.all_choices()

    def all_flags(self) -> Iterator[Flag]:
        """Those of the groups and choices inside too."""
        yield from self.flags
        for group in (*self.groups, *(group for _, group in self.choices)):
            yield from group.all_flags()


def shortest_words(flags: Sequence[Flag]) -> list[str]:
    """What a command must be given, and what may stand beside it without a flag: `SCAN`, `-o OUT`."""
    words = []
    for flag in flags:
        is_needed = flag.default is dataclasses.MISSING
        if flag.is_positional:
            words.append(flag.name if is_needed else f"[{flag.name}]")
        elif is_needed:
            choices = typing.get_args(flag.type)
            value = str(choices[0]) if choices else flag.path[-1].upper()
            words.append(f"{flag.shortest_name} {value}")
    return words


@cache
def field_words(cls: type) -> dict[str, str]:
    """Docstring under each field of a class, on one line."""
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(body, ast.ClassDef)
    found = {}
    for node, after in zip(body.body, body.body[1:], strict=False):
        if not (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)):
            continue
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            found[node.target.id] = one_line(str(after.value.value))
    return found


def one_line(text: str) -> str:
    """Without line breaks."""
    return " ".join(text.split())


def group_of(
    cls: type,
    default: Any = None,
    prefix: str = "",
    path: tuple[str, ...] = (),
    words: str = "",
    shared: Collection[type] = (),
) -> Group:
    """All flags of a dataclass as tyro names them.

    Args:
        cls: dataclass.
        default: instance that the defaults are those of; without, the fields' own.
        prefix: what stands before the names.
        path: names that lead to it.
        words: what it is.
        shared: types of nested groups that are listed elsewhere.
    """
    hints = typing.get_type_hints(cls, include_extras=True)
    flags, groups, elsewhere = [], [], []
    for field in dataclasses.fields(cls):
        hint, marks = _unwrapped(hints[field.name])
        value = getattr(default, field.name) if default is not None else _own_default(field)
        said = field_words(cls).get(field.name, "")
        here = (*path, field.name)
        named = [m.name for m in marks if getattr(m, "name", None) is not None]
        if dataclasses.is_dataclass(hint):
            own = named[0] if named else field.name.replace("_", "-")
            inner = f"{prefix}{own}." if own else prefix
            if hint in shared:
                elsewhere.append((inner, hint, value))
            else:
                groups.append(group_of(typing.cast("type", hint), value, inner, here, said, shared))
            continue
        if all(dataclasses.is_dataclass(kind) for kind in typing.get_args(hint) or (hint,)):
            groups.append(_choices(field.name, typing.get_args(hint), value, prefix, here, said))
            continue
        flags.append(
            Flag(
                here,
                prefix,
                hint,
                value,
                said,
                tuple(a for m in marks for a in getattr(m, "aliases", None) or ()),
                _is_marked(marks, tyro.conf.Positional[int])
                or bool(field.metadata.get("is_positional")),
                default is None and field.default_factory is not dataclasses.MISSING,
                not _is_marked(marks, tyro.conf.FlagCreatePairsOff[bool]),
                next((m.metavar for m in marks if getattr(m, "metavar", None)), ""),
                _is_marked(marks, tyro.conf.UseAppendAction[int]),
            )
        )
    return Group(prefix, cls, words, tuple(flags), tuple(groups), tuple(elsewhere))


def _choices(
    name: str, kinds: tuple[type, ...], value: Any, prefix: str, path: tuple[str, ...], words: str
) -> Group:
    """A field that is one of several dataclasses: a word on the command line chooses which."""
    inner = f"{prefix}{name.replace('_', '-')}."
    choices = [
        (f"{inner[:-1]}:{_dashed(kind.__name__)}", group_of(kind, prefix=inner, path=path))
        for kind in kinds
    ]
    chosen = f"{inner[:-1]}:{_dashed(type(value).__name__)}"
    return Group(inner, type(value), words, (), (), (), tuple(choices), chosen)


def _is_marked(marks: tuple[Any, ...], example: Any) -> bool:
    """Whether a field has one of the marks that tyro puts on a type."""
    return any(mark in example.__metadata__ for mark in marks)


def _dashed(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "-", name).lower()


def _unwrapped(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    if typing.get_origin(hint) is typing.Annotated:
        return hint.__origin__, hint.__metadata__
    return hint, ()


def _own_default(field: dataclasses.Field[Any]) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default
