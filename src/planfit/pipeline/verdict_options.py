"""What can be chosen about the verdict."""

from dataclasses import dataclass

from planfit.errors import OptionError, require_positive


@dataclass(frozen=True)
class VerdictOptions:
    """How a result is judged."""

    folds: int = 5
    """Solves that each do without one part in so many of the visits and of the walls, which then judge it."""
    max_error_m: float = 0.13
    """Predicted error of the whole (RMS) beyond which a result is no more than improved."""
    max_stretch_error_m: float = 0.27
    """Predicted error of a stretch of the walk beyond which its frames are named."""

    def __post_init__(self) -> None:
        require_positive(self, "max_error_m", "max_stretch_error_m")
        if self.folds < 2:
            raise OptionError(f"verdict.folds: expected 2 or more, found {self.folds}")
