"""When frames are matched by their surfaces, and when such a match is believed."""

from dataclasses import dataclass
from typing import Literal

from planfit.errors import require_choice, require_positive, require_share


@dataclass(frozen=True)
class SurfaceOptions:
    """When frames are matched by the surfaces that their depth shows, and when that is believed."""

    use: Literal["without_colour", "few", "always", "never"] = "few"
    """`few`: frames with few matched keypoints, as at white walls, and those of steps that no pair spans;
    `without_colour`: the same, of scans without colour alone; `always`: all frames; `never`: none."""
    few_matches: int = 25
    """A frame has few where the keypoints that match those of its neighbours are fewer."""
    neighbours: int = 3
    """Each such frame is matched with this many that follow it."""
    loops_per_frame: int = 8
    """Pairs that such a frame may take part in as a revisit."""
    max_depth_m: float = 8.0
    """Surfaces further away are left out."""
    sigma_base_m: float = 0.015
    """Standard deviation of a surface about its plane at no distance."""
    sigma_per_m: float = 0.005
    """Growth of that sigma with depth."""
    max_observations: float = 40.0
    """Effective observations that the surfaces of a pair are worth at most: they share errors of depth."""
    min_observed: float = 0.02
    """A direction of motion is observed where the squared cosines of the surfaces' normals to it are this
    large on average; in others, such as along a corridor, a pair says nothing."""
    min_overlap: float = 0.2
    """Share of both views whose surfaces must agree."""
    max_contradicted: float = 0.04
    """Share of what both frames could see at which one looks past a surface of the other, up to which a pair
    is believed where depth is exact."""
    usual_factor: float = 2.0
    """The same as a multiple of what is usual between neighbours, where depth is not exact."""
    max_rival: float = 0.8
    """A revisit is refused where another motion, elsewhere within the drift, explains this share of what its
    own explains: corridors look alike from door to door."""

    def __post_init__(self) -> None:
        require_choice(self, "use", "without_colour", "few", "always", "never")
        require_positive(self, "neighbours", "max_depth_m", "sigma_base_m", "max_observations")
        require_positive(self, "usual_factor")
        require_share(self, "min_observed", "min_overlap", "max_contradicted", "max_rival")
