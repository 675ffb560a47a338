"""What a comparison of two sets of poses comes to, in plain sentences."""

from collections.abc import Callable

from planfit.evaluation import NEAR_FACE_M, Comparison, LocalEvidence, Witness
from planfit.report import formatting

_OTHER = {"a": "b", "b": "a"}


def conclusion(comparison: Comparison) -> str:
    """Which of the two the evidence prefers, by what, and where they differ most."""
    said = {side: [] for side in ("a", "b", "neither")}
    for witness in comparison.witnesses:
        said[witness.prefers].append(witness_in_words(witness))
    preferred = comparison.preferred
    if not comparison.witnesses:
        words = "There is no evidence that could prefer one of them."
    elif preferred != "neither":
        words = f"The evidence prefers {preferred.upper()}: {_joined(said[preferred])}."
        if against := said[_OTHER[preferred]]:
            words += f" But {_joined(against)}."
    elif said["a"]:
        words = f"The evidence is divided: {_joined(said['a'])}; but {_joined(said['b'])}."
    else:
        words = f"The evidence prefers neither: {_joined(said['neither'])}."
    return f"{words} {difference_in_words(comparison)}"


def witness_in_words(witness: Witness) -> str:
    """What one witness says: "B fits the plan better (91 % against 84 % of the wall within 0.10 m)"."""
    metric, side = witness.deciding, witness.prefers
    who = "B" if side == "b" else "A"
    first, second = (metric.after, metric.before) if side == "b" else (metric.before, metric.after)

    def both(text: str, shown: Callable[[float], str], end: str) -> str:
        between = "and" if side == "neither" else "against"
        return f"{text} ({shown(first)} {between} {shown(second)}{end})"

    if witness.name == "matches":
        text = f"{who}'s matches lie closer" if side != "neither" else "matches lie equally close"
        return both(text, lambda v: formatting.length(v / 100), " apart")
    if witness.name == "plan":
        text = f"{who} fits the plan better" if side != "neither" else "both fit the plan alike"
        end = f" of the wall within {NEAR_FACE_M:.2f}{formatting.SPACE}m"
        return both(text, lambda v: formatting.share(1 - v / 100), end)
    if witness.name == "map":
        text = f"{who}'s map is sharper" if side != "neither" else "the maps are equally sharp"
        unit = metric.unit.replace("cm^2", "cm²")
        end = f" of {metric.meaning}"
        return both(text, lambda v: f"{v:.3g}{formatting.SPACE}{unit}", end)
    text = f"in {who} fewer views contradict each other"
    if side == "neither":
        text = "views contradict each other as often"
    end = " of points looked through"
    return both(text, lambda v: f"{v:.1f}{formatting.SPACE}%", end)


def difference_in_words(comparison: Comparison) -> str:
    """Where they differ most."""
    differences = comparison.differences
    if not comparison.stretches:
        return "Their poses are the same within two centimetres."
    first = comparison.stretches[0].stretch
    where = (
        f"at frame {first.first}"
        if first.first == first.last
        else f"at frames {first.first}-{first.last}"
    )
    aligned = ", once brought together as a whole" if differences.is_aligned else ""
    return (
        f"They differ most {where}, by {formatting.length(first.max_distance_m)} and "
        f"{first.max_angle_deg:.1f}{formatting.SPACE}deg{aligned}; over all frames by "
        f"{formatting.length(differences.rms_m)} RMS."
    )


def whole_in_words(comparison: Comparison) -> str:
    """How much of the difference is one motion of the whole."""
    differences = comparison.differences
    distance_m, angle_deg = differences.whole
    was = "was" if differences.is_aligned else "would be"
    return (
        f"As a whole, B {was} moved by {formatting.length(distance_m)} and {angle_deg:.2f}"
        f"{formatting.SPACE}deg to lie on A best; {formatting.length(differences.aligned_rms_m)} RMS "
        "are left then."
    )


def local_in_words(local: LocalEvidence) -> tuple[str, str]:
    """Matches and wall of a stretch, A against B; a dash where there is too little."""
    matches = " / ".join(_or_dash(formatting.length(v)) for v in local.match_m)
    walls = " / ".join(_or_dash(formatting.share(v)) for v in local.near_share)
    return matches, walls


def _or_dash(text: str) -> str:
    return "–" if text == "n/a" else text


def _joined(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
