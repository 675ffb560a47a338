"""Read one plan in several forms, and look at its faces.

On the command line: `planfit plan FILE -o OUT.png`. Takes a few seconds; writes to a temporary folder.
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np

import planfit
from planfit.export.plan_files import write_plan_dxf
from planfit.floorplan import PlanOptions, write_floorplan_json
from planfit.synth import BuildingOptions, facap_segments, make_building

rng = np.random.default_rng(4)
building = make_building(BuildingOptions(n_rooms=3), rng)

# A picture of the plan: both faces of each wall in black, 70 pixels a metre, y up.
corner = building.floorplan.ends.min(axis=(0, 1)) - 1.0
width_px, height_px = (70 * (building.floorplan.ends.max(axis=(0, 1)) + 1.0 - corner)).astype(int)
picture = np.full((height_px, width_px, 3), 255, dtype=np.uint8)
for from_px, to_px in (70 * (building.floorplan.ends - corner)).astype(int):
    cv2.line(picture, from_px.tolist(), to_px.tolist(), (0, 0, 0), 2, cv2.LINE_AA)

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    np.save(folder / "plan.npy", facap_segments(building.floorplan))
    write_floorplan_json(folder / "plan.json", building.floorplan)
    write_plan_dxf(folder / "plan.dxf", building.floorplan)
    cv2.imwrite(str(folder / "plan.png"), picture[::-1])
    for path in sorted(folder.iterdir()):
        plan = planfit.read_floorplan(path)
        width, depth = plan.size
        unit = "m" if plan.is_metric else "units"
        print(f"{path.name}: {plan.source.kind or 'faces'}, {len(plan)} faces,", end=" ")
        print(f"{plan.is_oriented.mean():.0%} with a known free side,", end=" ")
        print(f"{width:.1f} x {depth:.1f} {unit}")
        for warning in plan.source.warnings:
            print(f"  look at: {warning}")

    # A picture has no unit: say it where it is known, or leave it to the alignment.
    options = PlanOptions(metres_per_unit=1 / 70.0)
    plan = planfit.read_floorplan(folder / "plan.png", options)

longest = int(np.argmax(plan.lengths))
(x1, y1), (x2, y2) = plan.ends[longest]
print(f"longest face of the picture: ({x1:.2f}, {y1:.2f}) to ({x2:.2f}, {y2:.2f}) m,", end=" ")
print(f"looks towards {plan.normals[longest].round(2) + 0.0}")
