"""Evidence to judge: everything speaks for the result, until a test changes it."""

import numpy as np

from planfit.alignment import AdjustedAlignment
from planfit.pipeline.evidence import Evidence, Stretch
from planfit.pipeline.links import Visit
from planfit.pipeline.verdict import Verdict, judge


def make_stretch(k, **changes):
    """The k-th stretch of ten frames."""
    given = {
        "frames": (10 * k, 10 * k + 9),
        "predicted_m": 0.03,
        "open_direction": None,
        "n_patches": 20,
        "near_before": 0.3,
        "near_kept_out": 0.9,
        "beside": 0.05,
    }
    return Stretch(**(given | changes))


def make_visit(**changes):
    """A visit of the first stretch in the last one."""
    given = {
        "first_frames": (0, 9),
        "last_frames": (40, 49),
        "before_m": 0.5,
        "kept_out_m": 0.05,
        "after_m": 0.02,
        "mean_m": 0.03,
        "n_points": 60,
        "way_m": 30.0,
    }
    return Visit(**(given | changes))


def make_evidence(n_frames=50, **changes) -> Evidence:
    """Of a walk, stretch by stretch of ten frames, that was moved by half a metre and ended right."""
    n_stretches = -(-n_frames // 10)
    given = {
        "correction_m": np.full(n_frames, 0.5),
        "stretches": tuple(make_stretch(k) for k in range(n_stretches)),
        "visits": (make_visit(),),
        "torn": (),
        "alignment": AdjustedAlignment(0.9, 0.4, 0.0),
        "scan_costs": {"points": (300.0, 310.0), "odometry": (150.0, 180.0)},
    }
    # As long an error in every direction.
    predicted_m = changes.pop("predicted_error_m", np.full(n_frames, 0.03))
    covariances = (predicted_m**2 / 3)[:, None, None] * np.eye(6)
    return Evidence(pose_covariances=covariances, **(given | changes))


def make_verdict(n_frames=50, tolerance_m=0.15, **changes) -> Verdict:
    """What is made of such evidence."""
    return judge(make_evidence(n_frames, **changes), tolerance_m)
