"""A whole run on a plan that draws each wall as one line in its middle."""

from dataclasses import replace

import numpy as np
import pytest

import planfit
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

THICKEST_M, LEAST_M = 0.4, 0.5


def centre_lines(plan: Floorplan) -> Floorplan:
    """A line in the middle of each two faces that look away from each other with a wall between them."""
    lines = []
    along, lengths = segments.directions(plan.ends), plan.lengths
    for i in range(len(plan)):
        for j in range(i):
            back = (plan.ends[j, 0] - plan.ends[i, 0]) @ plan.normals[i]
            if plan.normals[i] @ plan.normals[j] > -0.99 or not -THICKEST_M < back < -0.02:
                continue
            at = np.sort((plan.ends[j] - plan.ends[i, 0]) @ along[i])
            first, last = max(at[0], 0.0), min(at[1], lengths[i])
            if last - first > LEAST_M:
                middle = plan.ends[i, 0] + 0.5 * back * plan.normals[i]
                lines.append(middle + np.array([first, last])[:, None] * along[i])
    ends = np.array(lines)
    return Floorplan.from_segments(ends, np.full((len(ends), 2), np.nan), name="centre lines")


def rms_m(result, synthetic):
    """Of positions, on the true plan."""
    off = result.plan_from_cams[:, :3, 3] - synthetic.true_plan_from_cams[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


@pytest.mark.slow
def test_walls_drawn_by_their_centre_lines_cost_little(tmp_path):
    """Inner walls of 12 to 25 cm, outer ones of 30: with bare lines the error is a decimetre and more."""
    options = SynthOptions(
        seed=5,
        building=BuildingOptions(n_rooms=3, wall_thickness_m=(0.12, 0.25)),
        walk=WalkOptions(n_frames=110),
        camera=CameraOptions(width_px=320, height_px=240),
    )
    synthetic = make_scan(options)
    runtime = planfit.Runtime(cache_dir=tmp_path)
    faces = planfit.refine(synthetic.scan, synthetic.floorplan, runtime=runtime)
    lines = centre_lines(synthetic.floorplan)
    found = planfit.refine(synthetic.scan, lines, runtime=runtime)
    assert rms_m(found, synthetic) < 1.5 * rms_m(faces, synthetic) + 0.01
    assert found.verdict.is_refined
    assert found.alignment is not None
    assert found.alignment.half_thickness is not None
    assert 0.06 < found.alignment.half_thickness.half_m < 0.16
    assert any("single lines" in warning for warning in found.warnings)
    # The plan of the result has both faces, each with the thickness of its wall.
    assert found.floorplan is not None
    assert found.floorplan.is_oriented.all()
    assert np.ptp(found.floorplan.thickness) > 0.05

    unknown = replace(lines.scaled(37.0), is_metric=False)
    free = planfit.refine(synthetic.scan, unknown, runtime=runtime)
    assert free.alignment is not None
    # Thick walls make rooms small, and so does a small scale: three rooms tell little, and it is said.
    assert 0.002 < free.alignment.scale_sigma < 0.01
    assert abs(np.log(free.alignment.metres_per_unit * 37.0)) < 3 * free.alignment.scale_sigma
