"""What a report is told beside the result: what it holds, and when, how and with what the run was made."""

import platform
import time
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version

from planfit import __version__
from planfit.as_built import AsBuiltOptions


@dataclass(frozen=True)
class ReportOptions:
    """What the report holds beside its words and plots."""

    has_view: bool = True
    """Show the scan in 3D. Without, the page has a tenth of the size and is written some seconds sooner."""
    as_built: AsBuiltOptions = field(default_factory=AsBuiltOptions)
    """Verdicts on the walls of the plan."""


_LIBRARIES = {
    "NumPy": "numpy",
    "SciPy": "scipy",
    "numba": "numba",
    "OpenCV": "opencv-python-headless",
}
"""Those that results may depend on, by how they are called."""


@dataclass(frozen=True)
class Provenance:
    """Of a run."""

    at: str
    """Date, time, and offset from UTC."""
    command: str
    """The command line as it was typed; nothing where a program called planfit."""
    versions: dict[str, str]
    """Of planfit, Python and the libraries that results may depend on."""
    plan_sha256: dict[str, str] = field(default_factory=dict)
    """Of each file of the plan, by its name."""


def provenance_now(command: str = "") -> Provenance:
    """Of a run that begins now."""
    versions = {"planfit": __version__, "Python": platform.python_version()}
    for name, distribution in _LIBRARIES.items():
        try:
            versions[name] = version(distribution)
        except PackageNotFoundError:  # another build of it, as OpenCV has several
            continue
    return Provenance(time.strftime("%Y-%m-%d %H:%M:%S %z"), command, versions)
