"""Options of earlier versions that are gone: what became of each, for files and flags that name them."""

from collections.abc import Mapping
from typing import Any

from planfit.errors import OptionError

GONE_OPTIONS: dict[str, str] = {
    "adjust.association.end_margin_m": "decided by planfit (0.3 m)",
    "adjust.association.max_angle_deg": "decided by planfit (12 degrees)",
    "adjust.association.min_overlap": "decided by planfit (half of the patch)",
    "adjust.bounded.barrier_share": "decided by planfit (0.01)",
    "adjust.ceiling_heights.max_drift_m": "decided by planfit (1 m)",
    "adjust.ceiling_heights.min_gain": "decided by planfit (10)",
    "adjust.ceiling_heights.min_share": "decided by planfit (a tenth of the frames)",
    "adjust.ceiling_heights.tolerance_m": "decided by planfit (0.1 m)",
    "adjust.control.max_observations": "decided by planfit (5)",
    "adjust.descent.check_every_steps": "the loss is compared at every step",
    "adjust.descent.is_first_frame_fixed": "no frame is held",
    "adjust.descent.late_learning_rate": "decided by planfit (1e-4, as in the paper)",
    "adjust.descent.momentum": "decided by planfit (0.9, as in the paper)",
    "adjust.moved_walls.max_moved_share": "decided by planfit (half of the patches)",
    "adjust.moved_walls.max_offset_m": "decided by planfit (0.7 m)",
    "adjust.moved_walls.min_offset_m": "decided by planfit (0.07 m)",
    "adjust.moved_walls.min_patches": "decided by planfit (3 patches)",
    "adjust.moved_walls.min_share": "decided by planfit (0.6)",
    "adjust.moved_walls.min_sigmas": "decided by planfit (3 standard deviations)",
    "adjust.moved_walls.price": "decided by planfit (5)",
    "adjust.moved_walls.sigma_m": "it is adjust.moved_wall_sigma_m now",
    "adjust.moved_walls.within_m": "decided by planfit (0.05 m)",
    "adjust.reach.max_reach_m": "decided by planfit (0.6 m)",
    "adjust.reach.whole_sigma_deg": "decided by planfit (1 degree)",
    "adjust.reach.whole_sigma_m": "decided by planfit (0.1 m)",
    "adjust.rays.parallel_deg": "decided by planfit (0.3 degrees)",
    "adjust.reprojection.min_depth_m": "decided by planfit (0.1 m)",
    "adjust.solver.initial_damping": "decided by planfit (1e-4)",
    "adjust.solver.steps_per_reweighting": "decided by planfit (2 steps)",
    "adjust.voting.bend_sigma_m": "decided by planfit (0.1 m)",
    "adjust.voting.max_observations_per_face": "decided by planfit (8)",
    "adjust.voting.max_shift_m": "decided by planfit (0.8 m)",
    "adjust.voting.patches_per_stretch": "decided by planfit (16 patches)",
    "adjust.voting.sigma_m": "decided by planfit (0.06 m)",
    "adjust.voting.step_m": "decided by planfit (0.05 m)",
    "align.cell_m": "decided by planfit (0.2 m, more for large scans)",
    "align.distinct_scale": "decided by planfit (3 %)",
    "align.distinct_translation_m": "decided by planfit (1 m)",
    "align.distinct_yaw_deg": "decided by planfit (5 degrees)",
    "align.max_candidates": "decided by planfit (48 hypotheses)",
    "align.max_yaws": "decided by planfit (8 yaws)",
    "align.min_margin": "decided by planfit (5 % of the wall)",
    "align.min_score": "decided by planfit (half of the wall)",
    "align.prior_translation_m": "decided by planfit (5 m)",
    "align.prior_yaw_deg": "decided by planfit (20 degrees)",
    "align.reach_m": "decided by planfit (0.4 m)",
    "calibration.max_prior_sigmas": "decided by planfit (3 standard deviations)",
    "calibration.min_gain_share": "decided by planfit (0.4 % of the cost)",
    "calibration.min_offset_m": "decided by planfit (15 mm)",
    "calibration.min_principal": "decided by planfit (0.5 % of the focal length)",
    "calibration.min_quadratic_per_m": "decided by planfit (2 mm per square metre)",
    "calibration.min_scale": "decided by planfit (1 %)",
    "keyframes.max_more_share": "decided by planfit (half of the keyframes)",
    "keyframes.steadier_share": "decided by planfit (0.4)",
    "segmentation.columns.max_per_frame": "decided by planfit (8 patches)",
    "segmentation.columns.min_length_m": "decided by planfit (0.15 m)",
    "segmentation.columns.min_points": "decided by planfit (30 points)",
    "segmentation.columns.rounds": "decided by planfit (200 rounds)",
    "segmentation.columns.tolerance_m": "decided by planfit (0.04 m)",
    "segmentation.columns.tolerance_per_m": "decided by planfit (4 mm per metre)",
    "segmentation.edge_step": "decided by planfit (5 % of the depth)",
    "segmentation.erode_px": "decided by planfit (3 px)",
    "segmentation.geometry.floor_band_m": "decided by planfit (0.15 m)",
    "segmentation.geometry.free_above_m": "decided by planfit (0.15 m)",
    "segmentation.geometry.grow_px": "decided by planfit (12 px)",
    "segmentation.geometry.max_tilt_deg": "decided by planfit (15 degrees)",
    "segmentation.geometry.min_wall_rise_m": "decided by planfit (0.4 m)",
    "segmentation.geometry.normal_radius_px": "decided by planfit (3 px)",
    "segmentation.geometry.submap_frames": "decided by planfit (32 frames)",
    "segmentation.geometry.tolerance_m": "decided by planfit (0.03 m)",
    "segmentation.geometry.tolerance_per_m2": "decided by planfit (3 mm per square metre)",
    "segmentation.gravity.cluster_deg": "decided by planfit (5 degrees)",
    "segmentation.gravity.max_frames": "decided by planfit (60 frames)",
    "segmentation.gravity.max_tilt_deg": "decided by planfit (40 degrees)",
    "segmentation.patches.max_per_frame": "decided by planfit (8 patches)",
    "segmentation.patches.min_length_m": "decided by planfit (0.5 m)",
    "segmentation.patches.min_points": "decided by planfit (60 points)",
    "segmentation.patches.rounds": "decided by planfit (200 rounds)",
    "segmentation.patches.tolerance_m": "decided by planfit (0.04 m)",
    "segmentation.patches.tolerance_per_m": "decided by planfit (4 mm per metre)",
    "segmentation.storeys.max_drift_m": "decided by planfit (0.7 m)",
    "segmentation.storeys.min_share": "decided by planfit (5 % of the frames)",
    "segmentation.storeys.min_storey_m": "decided by planfit (2 m)",
    "tracking.adapt_sigmas": "sigmas always grow where the tracker errs more",
    "tracking.clock_max_frames": "decided by planfit (2.5 frames)",
    "tracking.clock_min_sigmas": "decided by planfit (3 standard deviations)",
    "tracking.fuse_above": "decided by planfit (twice its sigmas)",
    "tracking.max_sigmas": "decided by planfit (6 standard deviations)",
    "tracking.min_jump_deg": "decided by planfit (8 degrees)",
    "tracking.min_jump_m": "decided by planfit (0.5 m)",
    "tracking.min_matches_alone": "decided by planfit (50 matches)",
    "verdict.alone_factor": "decided by planfit (1.5)",
}
"""By dotted name, as in a file of options."""


def refuse_gone_flag(flag: str) -> None:
    """Raise `OptionError` where a flag is of an earlier version.

    Switches have a form with `no`: `--tracking.no-adapt-sigmas`.
    """
    *groups, last = flag.removeprefix("--").replace("-", "_").split(".")
    _refuse(".".join([*groups, last.removeprefix("no_")]), flag)


def refuse_gone(values: Mapping[str, Any], where: str, group: str = "") -> None:
    """Raise `OptionError` where plain values of options, as in TOML, name one of an earlier version.

    Args:
        values: tables within tables.
        where: begins the message.
        group: names that lead to the values, each with a dot behind it.
    """
    for raw_name, value in values.items():
        name = group + raw_name.replace("-", "_")
        if isinstance(value, Mapping):
            refuse_gone(value, where, f"{name}.")
        _refuse(name, f"{where}{name}")


def _refuse(name: str, written: str) -> None:
    if name in GONE_OPTIONS:
        raise OptionError(
            f"{written}: expected an option of this version of planfit, found one that is gone: "
            f"{GONE_OPTIONS[name]}; leave it out"
        )
