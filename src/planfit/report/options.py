"""What can be chosen about the report."""

from dataclasses import dataclass, field

from planfit.as_built import AsBuiltOptions
from planfit.errors import OptionError


@dataclass(frozen=True)
class ReportOptions:
    """What the report holds beside its words and plots."""

    has_view: bool = True
    """Show the scan in 3D. Without, the page has a tenth of the size and is written some seconds sooner."""
    max_points: int = 1_500_000
    """Points of the 3D view at most; each adds about 8 bytes to the page."""
    max_pictures: int = 120
    """Frames whose images the page holds, evenly spread, about 15 kB each; of others the nearest is shown."""
    as_built: AsBuiltOptions = field(default_factory=AsBuiltOptions)
    """Verdicts on the walls of the plan."""

    def __post_init__(self) -> None:
        for name in ("max_points", "max_pictures"):
            least = 1 if name == "max_points" else 0
            if getattr(self, name) < least:
                raise OptionError(f"{name}: expected {least} or more, found {getattr(self, name)}")
