"""Verdicts in words."""

import numpy as np

from planfit.as_built.types import AsBuiltWall, Verdict
from planfit.findings import direction_words


def in_words(wall: AsBuiltWall, verdict: Verdict) -> str:
    """One verdict: "moved by 0.123 m (± 0.012 m) into the room, towards +x"."""
    if verdict is Verdict.MOVED:
        sides = f"{'into the room' if wall.offset_m > 0 else 'into the wall'}, "
        return (
            f"moved by {abs(wall.offset_m):.3f} m (± {wall.sigma_m:.3f} m) "
            f"{sides if wall.is_oriented else ''}{direction_words(wall.normal, wall.offset_m)}"
        )
    if verdict is Verdict.AGREES:
        return f"agrees: off by {wall.offset_m:+.3f} m (± {wall.sigma_m:.3f} m)"
    if verdict is Verdict.MISSING:
        return f"missing: cameras look through {wall.through_share:.0%} of its length"
    if verdict is Verdict.NEW:
        return f"new: {wall.length_m:.2f} m that the plan does not draw"
    if wall.is_glass and wall.through_share > 0:
        return (
            f"not seen: glass, which cameras look through ({wall.through_share:.0%} of its length)"
        )
    return "not seen"


def title(wall: AsBuiltWall, verdict: Verdict) -> str:
    """What happened to a wall, and where: for lists of issues."""
    what = {
        Verdict.MOVED: f"Wall stands {100 * abs(np.nan_to_num(wall.offset_m)):.0f} cm off its drawing",
        Verdict.MISSING: "Wall is missing",
        Verdict.NEW: "Wall that the plan does not draw",
        Verdict.AGREES: "Wall agrees with its drawing",
        Verdict.NOT_SEEN: "Wall was not seen",
    }[verdict]
    (x1, y1), (x2, y2) = wall.ends
    return f"{what}: ({x1:.1f}, {y1:.1f})-({x2:.1f}, {y2:.1f})"
