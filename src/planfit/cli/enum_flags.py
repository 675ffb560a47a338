"""Named choices, such as losses: shown in lower case, as the TOML files write them; any case is taken."""

from enum import Enum

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo


def choices_of(kind: type[Enum]) -> dict[str, Enum]:
    """Members by their names as they are shown."""
    return {member.name.lower(): member for member in kind}


def member_of(kind: type[Enum], word: str) -> Enum:
    """The member that a word names, in any case, `-` and `_` alike.

    Raises:
        ValueError: there is none of this name.
    """
    choices = choices_of(kind)
    name = word.lower().replace("-", "_")
    if name not in choices:
        raise ValueError(f"expected one of {', '.join(choices)}, found {word!r}")
    return choices[name]


def registry() -> ConstructorRegistry:
    """What tyro needs to read flags in this way."""
    rules = ConstructorRegistry()
    rules.primitive_rule(_rule)
    return rules


def _rule(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
    kind = info.type
    if not (isinstance(kind, type) and issubclass(kind, Enum)):
        return None
    # Not as tyro's own choices: those are compared letter by letter.
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="{" + ",".join(choices_of(kind)) + "}",
        instance_from_str=lambda words: member_of(kind, words[0]),
        is_instance=lambda value: isinstance(value, kind),
        str_from_instance=lambda member: [member.name.lower()],
    )
