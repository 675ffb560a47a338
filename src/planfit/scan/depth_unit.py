"""What a few depth images say about the whole: nothing at all, or a unit that cannot be right."""

import numpy as np

from planfit.errors import ScanError
from planfit.scan.types import Scan

N_FRAMES = 9
NEAR_M, FAR_M = 0.2, 20.0
"""The middle of what a depth camera sees in a building lies between these."""


def check_depth_unit(scan: Scan) -> list[str]:
    """Warnings about the depth of a scan, from a few frames spread over it.

    Raises:
        ScanError: none of these frames has any reading.
    """
    medians = []
    frames = np.unique(np.linspace(0, len(scan) - 1, N_FRAMES).astype(int))
    n_read = 0
    for i in frames:
        try:
            depth = scan.files.depth(int(i))
        except ScanError:
            continue  # told when a stage asks for the frame
        n_read += 1
        known = depth[np.isfinite(depth)]
        if len(known):
            medians.append(float(np.median(known)))
    if not medians and n_read:
        raise ScanError(
            f"{scan.name}: expected depth, found no reading in any of the {n_read} frames looked at; "
            "export the scan again with depth"
        )
    if not medians:
        return []
    middle = float(np.median(medians))
    if NEAR_M <= middle <= FAR_M:
        return []
    return [
        f"half of the depth is below {middle:.3g} m, where {NEAR_M:g} to {FAR_M:g} m are usual in a "
        "building: is it in another unit? Say which with --depth-scale (metres of one stored unit)"
    ]
