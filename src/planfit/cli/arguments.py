"""From words to arguments: how the parser reads flags, presets and files of options."""

import contextlib
import dataclasses
import io
import math
import re
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from planfit.cli.config import read_options
from planfit.cli.flags import group_of
from planfit.cli.usage import wrong_words
from planfit.errors import OptionError
from planfit.floorplan import PlanOptions
from planfit.floorplan.units import Unit
from planfit.runtime import choices_of, member_of

if TYPE_CHECKING:
    from planfit.pipeline.options import RefineOptions


@dataclass(frozen=True)
class PlanFlags:
    """How to read the plan."""

    unit: Unit = "auto"
    """Unit of the plan's coordinates; `auto` takes what the file says, `unknown` leaves the scale to the
    alignment."""
    scale: Annotated[str | None, tyro.conf.arg(metavar="METRES|1:N")] = None
    """Metres of one unit of the file (a pixel, a point), or the scale on paper as 1:100 (PDF, SVG, pictures
    with dpi); overrules --unit."""
    storey: str = ""
    """Name or number (from 0) of the storey to read where a file holds several."""
    layer: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]], tyro.conf.arg(metavar="NAME ...")
    ] = ()
    """Layers that hold the walls (`*` stands for anything), `--layer A B` or `--layer A --layer B`; without,
    a guess from names and line work."""
    page: int = 1
    """Page of a PDF."""
    cut_height_m: float = 1.2
    """Height above the storey's floor at which models (IFC, meshes) are cut."""
    wall_mask: Path | None = None
    """Picture of the size of the plan, white where there is wall; takes the place of planfit's
    interpretation of the picture."""
    plan_edits: Path | None = None
    """JSON file of corrections of the plan as read, written by `planfit plan` (its flag write-edits)."""
    mirror: bool = False
    """Swap left and right of the plan: for one that was drawn or exported mirrored."""

    @property
    def options(self) -> PlanOptions:
        """The same as options of the readers.

        Raises:
            OptionError: a value cannot work.
        """
        metres, paper = parse_scale(self.scale)
        return PlanOptions(
            unit=self.unit,
            metres_per_unit=metres,
            paper_scale=paper,
            storey=self.storey,
            layers=tuple(name for names in self.layer for name in names),
            page=self.page,
            cut_height_m=self.cut_height_m,
            wall_mask=self.wall_mask,
            edits=self.plan_edits,
            mirror=self.mirror,
        )


def parse_scale(text: str | None) -> tuple[float | None, float | None]:
    """Metres of one unit, or N of a scale on paper 1:N.

    Raises:
        OptionError: it is neither.
    """
    if text is None:
        return None, None
    ratio = re.fullmatch(r"\s*1\s*[:/]\s*(\d+(?:\.\d+)?)\s*", text)
    try:
        number = float(ratio[1] if ratio else text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise OptionError(
            f"--scale: expected metres of one unit of the file, as 0.02, or a scale as 1:100, found {text!r}"
        )
    return (None, number) if ratio else (number, None)


@dataclass(frozen=True)
class AlignmentFlags:
    """What is known of the alignment."""

    candidate: int = 1
    """Which of the alignment hypotheses is taken, 1 the best, as numbered by `planfit align`."""
    pin: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
        tyro.conf.arg(metavar="X,Y,Z=X,Y ..."),
    ] = ()
    """Known pairs "x,y,z=X,Y": a point of the scan in its own axes (m) and the same point on the plan, in the
    coordinates at the rim of `planfit plan PLAN -o plan.png`; "x,y,z=file:X,Y" in the file's own."""

    def added_to(self, options: "RefineOptions") -> "RefineOptions":
        """Options with these in place of `align.candidate`, and beside `align.control_points`."""
        points = tuple(point for points in self.pin for point in points)
        chosen = replace(
            options.align,
            candidate=self.candidate if self.candidate != 1 else options.align.candidate,
            control_points=options.align.control_points + points,
        )
        return replace(options, align=chosen)


def parse(arguments_type: Any, prog: str, argv: list[str]) -> Any:
    """Arguments of a command; those of --preset and of the TOML file of --config come before the flags.

    Args:
        arguments_type: dataclass, or a union of dataclasses: commands of a command.
        prog: what stands before the arguments, for messages.
        argv: words of the command line.

    Raises:
        SystemExit: help was asked for, and printed.
        OptionError: the words are not what the command takes; or the file of options is missing, or has an
            option that is unknown or cannot work.
    """
    default = None
    is_plain = dataclasses.is_dataclass(arguments_type)  # else a choice of subcommands
    fields = {f.name: f for f in dataclasses.fields(arguments_type)} if is_plain else {}
    preset_name, config = _value_of(argv, "--preset"), _value_of(argv, "--config")
    if "config" in fields and (preset_name or config):
        from planfit.pipeline.presets import preset  # commands without presets need no pipeline

        options = preset(preset_name or "default")
        if config:
            options = read_options(Path(config), options)
        required = {
            key: tyro.MISSING
            for key, field in fields.items()
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        }
        default = arguments_type(**required, options=options)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                arguments_type,
                prog=prog,
                args=argv,
                default=tyro.MISSING_NONPROP if default is None else default,
                use_underscores=False,
                registry=_registry(),
            )
    except SystemExit as stop:
        if not stop.code:  # help was printed
            raise
    group = group_of(cast("type", arguments_type)) if is_plain else None
    raise wrong_words(prog, group, argv, said.getvalue())


def _registry() -> ConstructorRegistry:
    """Named choices, such as losses: shown in lower case, as the TOML files write them; any case is taken."""
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


def _value_of(argv: list[str], flag: str) -> str | None:
    for i, word in enumerate(argv):
        if word == flag and i + 1 < len(argv):
            return argv[i + 1]
        if word.startswith(f"{flag}="):
            return word.removeprefix(f"{flag}=")
    return None
