"""Everything from arrays in memory: images, poses, labels, matches, known positions and walls of your own.

No file is read or written. The arrays are made of a synthetic scan here. Takes a few seconds.
"""

import numpy as np

import planfit
from planfit import synth
from planfit.geometry import se3
from planfit.lsq import ResidualTerm

options = synth.SynthOptions(
    building=synth.BuildingOptions(n_rooms=2),
    walk=synth.WalkOptions(n_frames=40),
    camera=synth.CameraOptions(width_px=160, height_px=120),
)
made = synth.make_scan(options)
n, files, true_poses = len(made.scan), made.scan.files, made.true_world_from_cams

scan = planfit.scan_from_arrays(
    colors=[files.color(i) for i in range(n)],  # (h, w, 3) uint8
    depths_m=[files.depth(i) for i in range(n)],  # (h, w) m, NaN where nothing was measured
    cameras=made.scan.cameras,
    world_from_cams=made.scan.world_from_cams,  # (n, 4, 4) of any tracker
    labels=[files.labels(i) for i in range(n)],  # (h, w) of planfit.scan.Label, of any segmenter
)
floorplan = planfit.Floorplan.from_segments(made.floorplan.ends)  # (f, 2, 2) m

# Matches of any matcher: a point in the camera frames of the two frames that see it.
pairs, points_a = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1).repeat(30, axis=0), []
for i in range(n - 1):
    seen = scan.cameras[i].lift_image(files.depth(i)).reshape(-1, 3)
    points_a.append(seen[np.isfinite(seen).all(axis=1)][::97][:30])
pairs, points_a = pairs[: 30 * (n - 1)], np.concatenate(points_a)
second_from_first = se3.inverse(true_poses[pairs[:, 1]]) @ true_poses[pairs[:, 0]]
points_b = se3.transform_each(second_from_first, points_a)
matches = planfit.Matches.from_arrays(pairs, points_a, points_b, sigma=0.02)

# Positions on the plan that were surveyed, of three frames: residuals of the poses they name, in sigmas.
known = np.array([0, 15, 39])
surveyed = made.true_plan_from_cams[known, :3, 3]
positions = ResidualTerm(known[:, None], lambda at: at[:, 0, :3, 3] - surveyed, sigma=0.01)

observations = planfit.extract_observations(scan, matches=matches)
result = planfit.refine(scan, floorplan, observations=observations, extra_terms=[positions])
off = result.plan_from_cams[:, :3, 3] - made.true_plan_from_cams[:, :3, 3]
print(f"position error on the plan: {np.sqrt((off**2).sum(axis=1).mean()):.3f} m RMS")
print(f"of the surveyed frames: {np.abs(off[known]).max():.3f} m at most")
