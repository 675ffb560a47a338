"""`planfit synth`: a synthetic scan, written in the FACaP layout with its plan and its truth."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tyro

from planfit.cli.arguments import Flat, PlanFlags
from planfit.cli.console import StageBars, out
from planfit.errors import OptionError, OutputError
from planfit.floorplan import Floorplan, read_floorplan
from planfit.synth import SyntheticScan, SynthOptions, make_scan, write_facap
from planfit.units import in_units


@dataclass(frozen=True)
class SynthArguments:
    """Write a synthetic scan of a synthetic building, or of the walls of any plan, with drifted poses, its
    plan and its truth."""

    out: tyro.conf.Positional[Path]
    """Folder for the scan; must not exist or be empty."""
    plan: Path | None = None
    """Floorplan whose walls are built, in metres; without, a building is made up."""
    walk_file: Path | None = None
    """TUM trajectory in the plan's axes, m, to walk along through the plan, as `--walk.path` does."""
    plan_flags: Flat[PlanFlags] = field(default_factory=PlanFlags)
    options: Flat[SynthOptions] = field(default_factory=SynthOptions)


def synth_command(arguments: SynthArguments) -> int:
    """Build, render, write."""
    if arguments.out.exists() and (not arguments.out.is_dir() or any(arguments.out.iterdir())):
        raise OutputError(f"{arguments.out}: expected no such folder, found files; choose another")
    floorplan: Floorplan | None = None
    if arguments.plan is not None:
        floorplan = read_floorplan(arguments.plan, arguments.plan_flags.options)
    options = arguments.options
    if arguments.walk_file is not None:
        if options.walk.path is not None:
            raise OptionError(
                "--walk-file: expected one walk, found --walk.path too; leave one out"
            )
        options = replace(options, walk=replace(options.walk, path=arguments.walk_file))
    with StageBars() as bars:
        synthetic = make_scan(options, floorplan)
        write_facap(
            arguments.out, synthetic, lambda done, total: bars.update("render", done, total)
        )
    _tell(arguments.out, synthetic)
    return 0


def _tell(folder: Path, synthetic: SyntheticScan) -> None:
    """How far it went, through which rooms, and what is next."""
    centres = synthetic.true_plan_from_cams[:, :3, 3]
    walked = float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum())
    out.print(f"{len(synthetic.scan)} frames and their plan: {folder}")
    step = walked / (len(centres) - 1)
    out.print(
        f"{in_units(walked, '.0f')} walked, {in_units(step)} from frame to frame; "
        f"{_visited(synthetic)}"
    )
    plan = ""
    if len(synthetic.floorplans) > 1:
        plan = f" --plan {folder / 'plan_0.npy'}"
        counts = [
            int((synthetic.frame_storeys == k).sum()) for k in range(len(synthetic.floorplans))
        ]
        out.print(
            f"frames on each storey: {', '.join(str(n) for n in counts)}; plans: plan_0.npy and so on"
        )
    out.print(f"next: planfit refine {folder} -o {folder}-refined{plan}")


def _visited(synthetic: SyntheticScan) -> str:
    entered, total = 0, 0
    for k, storey in enumerate(synthetic.storeys):
        poses = synthetic.true_plan_from_cams[synthetic.frame_storeys == k]
        xy = poses[:, :2, 3] @ storey.plan_from_building[:2, :2]
        entered += sum(bool(room.contains(xy).any()) for room in storey.rooms)
        total += len(storey.rooms)
    return f"{entered} of {total} rooms entered"
