"""Plans by storey on the command line: `--plan 0=ground.pdf --plan 1=first.pdf`, and what is said of them."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from planfit.cli.console import out
from planfit.errors import FloorplanError, OptionError, require
from planfit.findings import frame_ranges
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.geometry import se3
from planfit.pipeline.on_plan import Storeys


def read_plans(words: Sequence[str], options: PlanOptions) -> Floorplan | dict[int, Floorplan]:
    """One plan, or plans by the number of their storey.

    A file that is given for several storeys holds them: of each, the storey of its number is read.

    Args:
        words: `FILE`, or `NUMBER=FILE` once or more.
        options: how to read them.

    Raises:
        OptionError: a number is none or comes twice, or there are several plans without numbers.
        FloorplanError: a plan cannot be read, or a file that is given twice holds one storey.
    """
    if len(words) == 1 and ("=" not in words[0] or Path(words[0]).exists()):
        return read_floorplan(words[0], options)
    paths: dict[int, Path] = {}
    for word in words:
        number, path = _numbered(word)
        require(
            number not in paths,
            f"--plan {word}: expected one plan for storey {number}, found two; give the other one its own "
            "number",
        )
        paths[number] = path
    plans = {}
    for number, path in paths.items():
        is_shared = list(paths.values()).count(path) > 1
        chosen = replace(options, storey=str(number)) if is_shared else options
        plans[number] = read_floorplan(path, chosen)
        if is_shared and not plans[number].source.storeys:
            raise FloorplanError(
                f"{path}: expected a file of several storeys, as it is given for more than one, found one "
                "plan; give each storey its own file"
            )
    return plans


def _numbered(word: str) -> tuple[int, Path]:
    number, found, path = word.partition("=")
    if not found or not path or not re.fullmatch(r"[+-]?\d+", number):
        raise OptionError(
            f"--plan {word}: expected NUMBER=FILE with the whole number of a storey, as there are plans by "
            f"storey, found {word!r}; give --plan 0=FILE --plan 1=FILE, from the lowest storey up"
        )
    return int(number), Path(path)


def tell_storeys(storeys: Storeys) -> None:
    """A line a storey: its floor, its frames, and where its plan lies."""
    for storey in reversed(storeys.walked):
        lies = ""
        if storey.own is not None:
            x, y, _ = storey.own.plan_from_own[:3, 3]
            yaw_deg = se3.wrapped_deg(float(se3.yaw_of(storey.own.plan_from_own)))
            lies = f", its plan turned by {yaw_deg:.2f} deg and moved by ({x:.2f}, {y:.2f}) m"
            if storey.own.shares_axes:
                lies = ", its plan as drawn, in shared axes"
        out.print(
            f"{storey.name}: floor at {storey.floor_m:.2f} m, frames {frame_ranges(storey.frames)}{lies}",
            soft_wrap=True,
        )
