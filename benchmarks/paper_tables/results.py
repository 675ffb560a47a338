"""What was measured, in a JSON file that grows while the benchmark runs."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from planfit.errors import OutputError

METRICS = {
    "mme": "1",
    "mpv": "cm^2",
    "mom": "cm^2",
    "nnd": "cm",
    "nsd": "cm",
    "nsd_oriented": "cm",
    "floor_plane_rms": "cm",
    "double_walls": "%",
    "ate": "m",
    "ate_aligned": "m",
    "solve_s": "s",
    "step_ms": "ms",
}
"""Units; lower is better in all."""


@dataclass(frozen=True)
class Measured:
    """Metrics of one variant on one scan."""

    set_name: str
    scan: str
    variant: str
    """`preset/name`."""
    metrics: dict[str, float]
    """By the names of `METRICS`; those that could not be taken are absent."""
    warnings: tuple[str, ...] = ()
    """What the run itself said of its result."""
    failed: str = ""
    """Why there is no result: the run refused."""


@dataclass(frozen=True)
class Results:
    """Everything that was measured."""

    planfit: str
    """Version."""
    conditions: str
    """The machine, and how it was measured."""
    measured: tuple[Measured, ...]
    setup: str = ""
    """Changes when the options compared or the maps do; results of another are not added to."""

    def metrics_of(self, variant: str, set_name: str | None = None) -> dict[str, dict[str, float]]:
        """Metrics of a variant by scan, for all sets or for one."""
        return {
            m.scan: m.metrics
            for m in self.measured
            if m.variant == variant and set_name in (None, m.set_name) and m.metrics
        }

    def write(self, path: Path) -> None:
        """Write the file as a whole, or leave the old one."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_name(path.name + ".part")
            part.write_text(json.dumps(asdict(self), indent=1, allow_nan=False) + "\n")
            part.replace(path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror})") from error


def read_results(path: Path) -> Results:
    """Read what `Results.write` wrote.

    Raises:
        OutputError: the file is missing, or another.
    """
    try:
        values = json.loads(path.read_text())
        measured = tuple(
            Measured(**{**row, "warnings": tuple(row["warnings"])})
            for row in values.pop("measured")
        )
        return Results(**values, measured=measured)
    except OSError as error:
        raise OutputError(
            f"{path}: expected results of 'benchmarks/paper_tables paper', cannot be read ({error.strerror})"
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise OutputError(
            f"{path}: expected results of 'benchmarks/paper_tables paper', found another file ({error})"
        ) from error
