"""`planfit completion`: scripts that make a shell complete commands, options and their values.

The scripts hold no list: they ask the installed planfit, which answers in some hundredths of a second.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from planfit.cli.commands import COMMANDS_BY_NAME, HELP, topics
from planfit.cli.speech import NAMES
from planfit.errors import OptionError, did_you_mean

Shell = Literal["bash", "zsh", "fish"]

_BASH = """\
_planfit() {
    local IFS=$'\\n'
    COMPREPLY=($(planfit __complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null))
}
complete -o default -o bashdefault -F _planfit planfit
"""
_ZSH = """\
#compdef planfit
_planfit() {
    local -a found
    found=(${(f)"$(planfit __complete "${(@)words[2,CURRENT]}" 2>/dev/null)"})
    if (( ${#found} )); then compadd -- "${found[@]}"; else _files; fi
}
if [[ ${funcstack[1]} = _planfit ]]; then _planfit "$@"; else compdef _planfit planfit; fi
"""
_FISH = """\
function __planfit_words
    set -l before (commandline -opc)
    set -l found (planfit __complete $before[2..] (commandline -ct) 2>/dev/null | string match -v '')
    if set -q found[1]
        printf '%s\\n' $found
    else
        __fish_complete_path (commandline -ct)
    end
end
complete -c planfit -f -a '(__planfit_words)'
"""
SCRIPTS: dict[str, str] = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}


@dataclass(frozen=True)
class CompletionArguments:
    """Print what makes a shell complete planfit's commands, options and values: `eval "$(planfit completion
    bash)"` in ~/.bashrc, the same with zsh in ~/.zshrc, `planfit completion fish | source` in config.fish."""

    shell: Shell = field(metadata={"is_positional": True})
    """The shell."""

    @staticmethod
    def from_words(words: Sequence[str]) -> "CompletionArguments":
        """Arguments of the words of a command line.

        Raises:
            OptionError: they name no shell that is known, or more than one.
        """
        known: tuple[Shell, ...] = get_args(Shell)
        shells: list[Shell] = [shell for shell in known if [*words] == [shell]]
        if not shells:
            step = did_you_mean(" ".join(words), known) or "write it as 'planfit completion bash'"
            raise OptionError(
                f"completion: expected {', '.join(known[:-1])} or {known[-1]}, found "
                f"{' '.join(words) or 'nothing'}; {step}"
            )
        return CompletionArguments(shells[0])


def completion_command(arguments: CompletionArguments) -> int:
    """Print the script."""
    print(SCRIPTS[arguments.shell], end="")
    return 0


def completions(words: Sequence[str]) -> list[str]:
    """What may take the place of the last of the words behind `planfit`; nothing where a file may."""
    *before, last = words or [""]
    found: list[str] = []
    if not before:
        found = [*COMMANDS_BY_NAME, "help", "--help", "--version"]
    elif before == ["help"]:
        found = [*topics(), *COMMANDS_BY_NAME]
    elif before[0] in COMMANDS_BY_NAME:
        known = COMMANDS_BY_NAME[before[0]].known_flags()
        found = [*known[before[-1]].choices] if before[-1] in known else []
        if not found and last:
            found = [*known, *HELP, *NAMES]
    return sorted({word for word in found if word.startswith(last)})
