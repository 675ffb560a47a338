"""What a user must know about a scan besides its results: what was left out, what to doubt."""

from planfit.cli.console import out
from planfit.scan import Scan, corrupt_frames

NAMED = 3


def tell_scan(scan: Scan) -> None:
    """Warnings, frames that were left out, frames that could not be decoded; nothing where all is well."""
    for warning in scan.warnings:
        out.print(f"[yellow]note:[/] {_plain(warning)}", soft_wrap=True)
    if scan.skipped:
        n = len(scan.skipped)
        _tell_list(f"{n} of {n + len(scan)} frames are left out", scan.skipped)
    reasons = [f"frame {frame_id}: {why}" for frame_id, why in corrupt_frames(scan).items()]
    if reasons:
        _tell_list(
            f"{len(reasons)} of {len(scan)} frames cannot be decoded and take no part", reasons
        )


def _tell_list(begin: str, lines: tuple[str, ...] | list[str]) -> None:
    named = "; ".join(lines[:NAMED])
    more = f"; and {len(lines) - NAMED} more" if len(lines) > NAMED else ""
    out.print(f"[yellow]note:[/] {begin}: {_plain(named)}{more}", soft_wrap=True)


def _plain(text: str) -> str:
    return text.replace("[", "\\[")  # brackets in names are no mark-up
