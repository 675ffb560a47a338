"""What is kept of each run, and on which machine it was made: one small file in the repository."""

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError
from planfit.runtime import whole_file

KEPT = Path(__file__).with_name("poses.npz")
_MACHINE = "machine"


@dataclass(frozen=True)
class Run:
    """What a run came to."""

    name: str
    plan_from_cams: Float[np.ndarray, "n 4 4"]
    """Refined, to the last bit."""
    outcome: str
    """Of the verdict."""
    metres_per_unit: float
    """Of the alignment; NaN where there was none."""


@dataclass(frozen=True)
class Kept:
    """Runs as they were when they were recorded."""

    runs: Mapping[str, Run]
    """By name."""
    machine: Mapping[str, str]
    """Processor and libraries that they were recorded with."""


def write_kept(path: Path, runs: Sequence[Run], machine: Mapping[str, str]) -> None:
    """Write all runs, in the place of those that are there.

    Raises:
        OutputError: the file cannot be written.
    """
    arrays = {_MACHINE: np.array([f"{name}={value}" for name, value in machine.items()])}
    for run in runs:
        arrays[f"{run.name}/plan_from_cams"] = run.plan_from_cams
        arrays[f"{run.name}/outcome"] = np.array(run.outcome)
        arrays[f"{run.name}/metres_per_unit"] = np.array(run.metres_per_unit)
    with whole_file(path) as part, part.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_kept(path: Path) -> Kept:
    """What `write_kept` wrote.

    Raises:
        OptionError: there is no such file, or it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        machine = dict(str(line).split("=", 1) for line in arrays.pop(_MACHINE))
        names = dict.fromkeys(key.rpartition("/")[0] for key in arrays)
        runs = {
            name: Run(
                name,
                arrays[f"{name}/plan_from_cams"],
                str(arrays[f"{name}/outcome"]),
                float(arrays[f"{name}/metres_per_unit"]),
            )
            for name in names
        }
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise OptionError(
            f"{path}: expected golden runs, found {type(error).__name__}: {error}; take it out of the "
            "repository again, or make it by `python benchmarks/golden record`"
        ) from error
    return Kept(runs, machine)
