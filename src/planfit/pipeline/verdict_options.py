"""What can be chosen about the verdict."""

from dataclasses import dataclass

from planfit.errors import require_positive


@dataclass(frozen=True)
class VerdictOptions:
    """How a result is judged."""

    max_error_m: float = 0.13
    """Predicted error of the whole (RMS) beyond which a result is no more than improved."""

    def __post_init__(self) -> None:
        require_positive(self, "max_error_m")
