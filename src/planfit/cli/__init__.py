"""The command line: the only part of planfit that prints."""

import dataclasses
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from planfit import __version__
from planfit.errors import PlanfitError

EXIT_OK, EXIT_NOT_BETTER, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 0, 1, 2, 130

HELP = f"""planfit {__version__}: fit a posed RGB-D scan of a building to its floorplan.

usage: planfit COMMAND ...

commands:
  refine SCAN -o OUT [--plan FILE]   refine the camera poses of a scan; OUT/report.html tells how it went
  align SCAN PLAN -o OUT             find the place of a scan on a plan; a picture of each place that fits
  inspect SCAN [-o FILE.png]         show what is found in a scan: frames, depth, path, up, gaps, jumps
  plan FILE [-o FILE.png|svg|dxf|json]   show what is read of a floorplan
  evaluate OUT [--truth FILE]        how good refined poses are, before and after (also SCAN --poses FILE)
  export OUT --to KIND -o FILE       write poses for other programs: tum, kitti, open3d, g2o, ply, mesh, ...
  demo [-o OUT]                      make a synthetic scan, drift it, refine it, and compare with the truth
  synth OUT                          write a synthetic scan with its plan and its truth
  bench paper|page|compare           measure the paper's tables on synthetic scans; compare two results

'planfit COMMAND --help' lists the options of a command.
exit codes: 0 done; 1 done, but not better than before or not surely placed; 2 bad input; 130 stopped
"""


def main(argv: Sequence[str] | None = None) -> None:
    """Run a command and exit with its code."""
    sys.exit(run(sys.argv[1:] if argv is None else argv))


def run(argv: Sequence[str]) -> int:
    """Run a command; errors of the input become one line and exit code 2."""
    name, rest = (argv[0], list(argv[1:])) if argv else ("--help", [])
    if name in ("-h", "--help", "help"):
        print(HELP, end="")
        return EXIT_OK
    if name in ("-V", "--version"):
        print(__version__)
        return EXIT_OK
    loaders: dict[str, Callable[[], tuple[Any, Callable[[Any], int]]]] = {
        "refine": _load_refine,
        "align": _load_align,
        "inspect": _load_inspect,
        "plan": _load_plan,
        "evaluate": _load_evaluate,
        "export": _load_export,
        "demo": _load_demo,
        "synth": _load_synth,
        "bench": _load_bench,
    }
    if name not in loaders:
        print(f"planfit: unknown command {name!r}; known: {', '.join(loaders)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    try:
        arguments_type, command = loaders[name]()
        arguments = _parse(arguments_type, name, rest)
        return command(arguments)
    except PlanfitError as error:
        print(f"planfit: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except OSError as error:
        print(f"planfit: {error.filename}: {error.strerror}; check the path, the rights and the disk",
              file=sys.stderr)  # fmt: skip
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        kept = "finished stages are kept, the same command goes on from there"
        print(f"planfit: stopped; {kept if name in ('refine', 'bench') else 'nothing of it is kept'}",
              file=sys.stderr)  # fmt: skip
        return EXIT_INTERRUPTED


def _parse(arguments_type: Any, name: str, argv: list[str]) -> Any:
    """Arguments of a command; those of --preset and of the TOML file of --config come before the flags."""
    import tyro

    from planfit.cli.config import read_options
    from planfit.cli.enum_flags import registry

    default = None
    is_plain = dataclasses.is_dataclass(arguments_type)  # else a choice of subcommands
    fields = {f.name: f for f in dataclasses.fields(arguments_type)} if is_plain else {}
    preset_name, config = _value_of(argv, "--preset"), _value_of(argv, "--config")
    if "config" in fields and (preset_name or config):
        from planfit.pipeline.presets import preset

        options = preset(preset_name or "default")
        if config:
            options = read_options(Path(config), options)
        required = {
            key: tyro.MISSING
            for key, field in fields.items()
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        }
        default = arguments_type(**required, options=options)
    prog = f"planfit {name}"
    if default is None:
        default = tyro.MISSING_NONPROP
    return tyro.cli(
        arguments_type,
        prog=prog,
        args=argv,
        default=default,
        use_underscores=False,
        registry=registry(),
    )


def _value_of(argv: list[str], flag: str) -> str | None:
    for i, word in enumerate(argv):
        if word == flag and i + 1 < len(argv):
            return argv[i + 1]
        if word.startswith(f"{flag}="):
            return word.removeprefix(f"{flag}=")
    return None


# Each command is imported when it is asked for, so that --help and errors come at once.


def _load_refine() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.refine import RefineArguments, refine_command

    return RefineArguments, refine_command


def _load_align() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.align import AlignArguments, align_command

    return AlignArguments, align_command


def _load_inspect() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.inspect import InspectArguments, inspect_command

    return InspectArguments, inspect_command


def _load_plan() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.plan import PlanArguments, plan_command

    return PlanArguments, plan_command


def _load_evaluate() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.evaluate import EvaluateArguments, evaluate_command

    return EvaluateArguments, evaluate_command


def _load_export() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.export import ExportArguments, export_command

    return ExportArguments, export_command


def _load_demo() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.demo import DemoArguments, demo_command

    return DemoArguments, demo_command


def _load_synth() -> tuple[type, Callable[[Any], int]]:
    from planfit.cli.synth import SynthArguments, synth_command

    return SynthArguments, synth_command


def _load_bench() -> tuple[Any, Callable[[Any], int]]:
    from planfit.cli.bench import BenchArguments, bench_command

    return BenchArguments, bench_command
