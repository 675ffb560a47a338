"""What is wrong with words of a command line that the parser refused: what was expected, what was found, the
next step, in one line. The parser's own answer is a box, in its words.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from planfit.cli.flag_values import example, fault_of_value, wanted, word_counts
from planfit.cli.flags import Flag, Group, shortest_words
from planfit.cli.known_flags import looks_like_flag, plain_name
from planfit.errors import OptionError, did_you_mean


def wrong_words(prog: str, group: Group | None, words: Sequence[str], box: str) -> OptionError:
    """The error that says what is wrong.

    Args:
        prog: what stands before the words: `planfit align`.
        group: flags of the command; None for a program of several commands.
        words: that the parser refused; their flags are known.
        box: what the parser said, for what is not known here.
    """
    fault = _Reading(prog, group).fault(words) if group is not None else ""
    begin = prog.removeprefix("planfit ")
    return OptionError(
        fault or f"{begin}: expected other words, found these: {_plain(box)}; see '{prog} --help'"
    )


@dataclass
class _Reading:
    """Words as the parser reads them, up to the first that cannot be."""

    prog: str
    group: Group
    positional: list[str] = field(default_factory=list)
    given: list[Flag] = field(default_factory=list)
    greedy: dict[str, list[str]] = field(default_factory=dict)
    """What flags took that take any number of words."""
    chosen: str = ""
    """The last word that chose a kind, whose flags alone may stand behind it."""
    before: dict[str, str] = field(default_factory=dict)
    """For each word that belongs to no flag, the word before it."""

    def __post_init__(self) -> None:
        self.flags = _by_name(self.group, with_choices=False)
        self.choices = dict(_choices(self.group))

    @property
    def help(self) -> str:
        return f"'{self.prog} --help' tells more"

    @property
    def command(self) -> str:
        return self.prog.removeprefix("planfit ")

    def fault(self, words: Sequence[str]) -> str:
        """The first thing wrong; empty where nothing is found."""
        rest = list(words)
        last = ""
        while rest:
            word = rest.pop(0)
            if looks_like_flag(word):
                fault = self._flag(word, rest)
            elif word in self.choices:
                self.chosen, fault = word, ""
            else:
                fault = self._word(word, last)
            if fault:
                return fault
            last = word
        return self._too_many() or self._missing()

    def _flag(self, word: str, rest: list[str]) -> str:
        """Take a flag and its values off the rest."""
        written, has_value, value = word.partition("=")
        name = plain_name(written)
        of_choice = {c for c, group in self.choices.items() if name in _by_name(group)}
        if of_choice and self.chosen not in of_choice:
            # Kinds may have a flag in common; the one that was chosen is the parser's to know.
            return (
                f"{name}: expected it behind {' or '.join(sorted(of_choice))}, which chooses what it is an "
                f"option of, found it without; see '{self.prog} --help-all'"
            )
        if self.chosen and not of_choice:
            return (
                f"{name}: expected it before {self.chosen}, behind which only that one's own options stand, "
                "found it behind; put it first"
            )
        flag = self.flags.get(name) or _by_name(self.group).get(name)
        if flag is None:
            return ""
        self.given.append(flag)
        if flag.type is bool:
            return (
                f"{name}: expected no value behind it, found {value!r}; give {name} alone"
                if has_value
                else ""
            )
        at_least, at_most = word_counts(flag)
        values = [value] if has_value else []
        while rest and len(values) < at_most and not looks_like_flag(rest[0]):
            values.append(rest.pop(0))
        if len(values) < at_least or values == [""]:
            return self._too_few(flag, name, values, rest, at_least)
        if at_most > at_least:
            self.greedy[name] = values
        faults = (fault_of_value(flag, name, one, self.prog) for one in values)
        return next(filter(None, faults), "")

    def _too_few(
        self, flag: Flag, name: str, values: list[str], rest: list[str], at_least: int
    ) -> str:
        each = wanted(flag)
        expected = (
            f"{each} behind it" if at_least == 1 else f"{at_least} values behind it, {each} each"
        )
        if values != [""] and values:
            found = f"{len(values)}"
        else:
            found = f"the option {rest[0]}" if rest and not values else "nothing"
        step = example(flag, name) or f"'{self.prog} --help-all' tells more"
        return f"{name}: expected {expected}, found {found}; {step}"

    def _word(self, word: str, last: str) -> str:
        """A word that belongs to no flag."""
        kind = word.split(":")[0] + ":"
        if ":" in word and any(choice.startswith(kind) for choice in self.choices):
            meant = did_you_mean(word, self.choices) or f"see '{self.prog} --help-all'"
            return f"{word}: expected one of {', '.join(self.choices)}, found none of them; {meant}"
        self.positional.append(word)
        self.before[word] = last
        return ""

    def _too_many(self) -> str:
        places = [flag for flag in self.group.flags if flag.is_positional]
        limit = sum(word_counts(flag)[1] for flag in places)
        if len(self.positional) <= limit:
            return ""
        extra = self.positional[limit]
        switch = self.flags.get(plain_name(self.before[extra]))
        blanks = _one_path(self.positional)
        if switch is not None and switch.type is bool:
            step = f"{self.before[extra]} takes no value"
        elif blanks:
            step = f"write a path that has blanks in quotes: '{blanks}'"
        elif "--out" in self.flags and self.flags["--out"] not in self.given:
            step = f"did you mean '-o {extra}'?"
        else:
            step = self.help
        return f"{self.command}: expected {self._usage()}, found {extra!r} besides; {step}"

    def _not_given(self) -> list[Flag]:
        """Flags that must be given and are not."""
        return [
            flag
            for flag in self.group.all_flags()
            if flag.default is dataclasses.MISSING
            and not flag.is_positional
            and flag not in self.given
        ]

    def _missing(self) -> str:
        places = [
            flag
            for flag in self.group.flags
            if flag.is_positional and flag.default is dataclasses.MISSING
        ]
        missing = places[len(self.positional) :]
        words = [*shortest_words(missing), *(flag.shortest_name for flag in self._not_given())]
        if not words:
            return ""
        found = " and ".join(f"no {word}" for word in words)
        took = [f"{name} took {' '.join(values)!r}" for name, values in self.greedy.items()]
        step = (
            f"{', '.join(took)}; put {' '.join(shortest_words(missing))} before it"
            if missing and took
            else self.help
        )
        return f"{self.command}: expected {self._usage()}, found {found}; {step}"

    def _usage(self) -> str:
        return " ".join(shortest_words(self.group.flags)) or "options alone"


def _by_name(group: Group, with_choices: bool = True) -> dict[str, Flag]:
    """Flags by all of their names; of kinds that a word chooses only on demand."""
    found: dict[str, Flag] = {}
    for flag in group.flags:
        if not flag.is_positional:
            found |= dict.fromkeys(flag.names, flag)
    for inner in group.groups:
        found |= _by_name(inner, with_choices)
    for _, inner in group.choices if with_choices else ():
        found |= _by_name(inner)
    return found


def _choices(group: Group) -> Iterable[tuple[str, Group]]:
    """Words that choose a kind, and the flags of it."""
    yield from group.choices
    for inner in group.groups:
        yield from _choices(inner)


def _one_path(words: Sequence[str]) -> str:
    """A path that is there, whose blanks have made several words of it."""
    for begin in range(len(words)):
        for end in range(begin + 2, len(words) + 1):
            path = " ".join(words[begin:end])
            if len(path) < 1000 and Path(path).exists():
                return path
    return ""


def _plain(box: str) -> str:
    """What the parser says in a box, on one line: below its title, above the first rule, behind which it
    gives advice."""
    said: list[str] = []
    for line in box.splitlines():
        words = line.strip(" │|╰╯├┤")
        if said and words and not words.strip("-─"):
            break
        if not words.startswith("╭"):
            said.append(words)
    return " ".join(" ".join(said).split()) or "no reason is known"
