"""Scans whose cameras stood at surveyed points: nothing has to be rendered, and truth is exact."""

import numpy as np

from builders import CAMERA, NoFiles
from planfit.pipeline.observations import Observations
from planfit.scan import Scan
from planfit.segmentation import Gravity
from planfit.survey import Mark, Survey, SurveyPoint


def scan_at(world_from_cams):
    """A scan whose images nobody may ask for; z is up in its world."""
    n = len(world_from_cams)
    return Scan(
        name="surveyed",
        frame_ids=tuple(f"frame-{k}" for k in range(n)),
        timestamps=np.arange(n, dtype=float),
        cameras=(CAMERA,) * n,
        world_from_cams=np.asarray(world_from_cams),
        files=NoFiles(),
        up_world=np.array([0.0, 0.0, 1.0]),
    )


def observed(structure, matches):
    up = Gravity(np.array([0.0, 0.0, 1.0]), 1.0, "the test")
    return Observations(up, structure, matches)


def survey_of(centres, control, check=(), sigma_m=0.005, axes="plan", moved=(0.0, 0.0, 0.0)):
    """Cameras that stood at points: `C3` is a control point at that of frame 3, `K5` a check point."""
    points, marks = [], []
    for frames, letter in ((control, "C"), (check, "K")):
        for k in frames:
            name = f"{letter}{k}"
            points.append(
                SurveyPoint(
                    name, np.asarray(centres[k]) + np.asarray(moved), sigma_m, letter == "K"
                )
            )
            marks.append(Mark(int(k), name))
    return Survey(tuple(points), tuple(marks), axes)


def errors_m(result, true_plan_from_cams):
    """Of the camera positions, vectors."""
    return result.plan_from_cams[:, :3, 3] - true_plan_from_cams[:, :3, 3]
