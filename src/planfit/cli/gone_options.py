"""Options of earlier versions that are gone: what became of each, for files and flags that name them."""

from collections.abc import Mapping
from typing import Any

from planfit.errors import OptionError

DECIDED_BY_PLANFIT: dict[str, str] = {
    "": "revisit_frames",
    "adjust": "moved_wall_sigma_m",
    "adjust.association": "end_margin_m max_angle_deg min_overlap",
    "adjust.bounded": "barrier_share error_factor slack",
    "adjust.ceiling": "max_observations points_per_observation sigma_m",
    "adjust.ceiling.loss": "kind scale",
    "adjust.ceiling_heights": "max_drift_m min_gain min_share tolerance_m",
    "adjust.columns": "max_observations points_per_observation sigma_m",
    "adjust.columns.loss": "kind scale",
    "adjust.control": "max_observations",
    "adjust.control.loss": "kind scale",
    "adjust.descent": (
        "drop_after_steps dtype late_learning_rate learning_rate max_steps momentum record_every_steps "
        "tolerance"
    ),
    "adjust.floor": "max_observations points_per_observation sigma_m",
    "adjust.floor.loss": "kind scale",
    "adjust.moved_walls": (
        "max_moved_share max_offset_m min_offset_m min_patches min_share min_sigmas price sigma_m "
        "within_m"
    ),
    "adjust.odometry.loss": "kind scale",
    "adjust.points": "max_observations",
    "adjust.points.loss": "kind scale",
    "adjust.rays": "max_observations parallel_deg",
    "adjust.rays.loss": "kind scale",
    "adjust.reach": "max_reach_m whole_sigma_deg whole_sigma_m",
    "adjust.reprojection": "max_observations min_depth_m sigma_px",
    "adjust.reprojection.loss": "kind scale",
    "adjust.solver": "initial_damping steps_per_reweighting",
    "adjust.surfaces.loss": "kind scale",
    "adjust.voting": "bend_sigma_m max_observations_per_face max_shift_m patches_per_stretch sigma_m step_m",
    "adjust.walls": "max_observations points_per_observation sigma_m",
    "adjust.walls.loss": "kind scale",
    "align": (
        "cell_m distinct_scale distinct_translation_m distinct_yaw_deg max_candidates max_yaws min_margin "
        "min_score prior_translation_m prior_yaw_deg reach_m"
    ),
    "building": "extra_door_share outer_wall_thickness_m slab_m walkway_m",
    "calibration": (
        "depth_offset_sigma_m depth_quadratic_sigma_per_m depth_scale_sigma focal_aspect_sigma "
        "focal_scale_sigma half_thickness_sigma_m max_prior_sigmas max_rounds min_gain_share min_offset_m "
        "min_principal min_quadratic_per_m min_scale min_sigmas odometry_scale_sigma plan_scale_sigma "
        "principal_sigma"
    ),
    "drift": "tilt_share vertical_share",
    "free_space": "max_depth_m max_pairs max_views reach_m tolerance_m tolerance_share width_px",
    "keyframes": "max_more_share steadier_share",
    "layers": "gap_to_sigma max_both_share max_gap_m min_frames min_gap_m min_points window_m",
    "map": "mom_frames stride_px",
    "matching": "seed",
    "matching.agreement": (
        "base_m max_contradicted max_contradicted_between per_m sigmas_of_rotation usual_factor"
    ),
    "matching.cycle_consistency": (
        "certain_m cluster_m max_drifts max_sigmas max_uncertain_sigmas max_weak_drifts min_advantage "
        "rival_share rotation_slack_deg sigma_rotation_deg sigma_translation_m strong_share "
        "translation_slack_m"
    ),
    "matching.keypoints": "edge_step min_reduced",
    "matching.matcher": "max_ratio",
    "matching.pairs": (
        "base_distance_m guided_per_frame max_angle_deg max_distance_m max_drift_sigmas "
        "retrieved_per_frame view_distance_m"
    ),
    "matching.surfaces": (
        "few_matches max_contradicted max_observations max_rival min_observed min_overlap neighbours "
        "sigma_base_m sigma_per_m usual_factor"
    ),
    "matching.verify": (
        "max_reprojection_px max_sigmas min_inlier_ratio min_inliers rounds sigma_base_m sigma_per_m"
    ),
    "report": "max_pictures max_points",
    "report.as_built": (
        "as_drawn_m beyond_m floor_sigma_m heights_m max_cupboard_m max_offset_m min_frames min_length_m "
        "min_moved_patches min_moved_share min_new_length_m min_new_patches min_part_m min_through_share "
        "min_top_m sure_sigmas within_m"
    ),
    "report.as_built.association": "end_margin_m max_angle_deg min_overlap mutual oriented",
    "report.as_built.openings": "depth_m leaf_back_m leaf_m min_closed_share min_new_m min_open_m",
    "segmentation": "edge_step erode_px seed",
    "segmentation.columns": "max_per_frame min_length_m min_points rounds tolerance_m tolerance_per_m",
    "segmentation.geometry": (
        "floor_band_m free_above_m grow_px max_tilt_deg min_wall_rise_m normal_radius_px submap_frames "
        "tolerance_m tolerance_per_m2"
    ),
    "segmentation.gravity": "cluster_deg max_frames max_tilt_deg",
    "segmentation.patches": "max_per_frame min_length_m min_points rounds tolerance_m tolerance_per_m",
    "segmentation.storeys": "max_drift_m min_share min_storey_m",
    "tracking": (
        "clock_max_frames clock_min_sigmas fuse_above max_sigmas min_jump_deg min_jump_m "
        "min_matches_alone"
    ),
    "verdict": "folds",
    "walk": "door_clearance_m",
}
"""By group: names of options whose values are priors now, or follow from the scan."""

GONE_OPTIONS: dict[str, str] = {
    f"{group}.{name}".removeprefix("."): "planfit decides it, by its priors and by the scan"
    for group, names in DECIDED_BY_PLANFIT.items()
    for name in names.split()
} | {
    "adjust.averaging": "it is adjust.cost now, robust or paper",
    "adjust.columns.offset_sigma_m": "columns stand where they are drawn",
    "adjust.descent.check_every_steps": "the loss is compared at every step",
    "adjust.descent.is_first_frame_fixed": "no frame is held",
    "adjust.walls.offset_sigma_m": "it is adjust.wall_offset_sigma_m now",
    "building.is_white": "left out: no building has even colours",
    "info_topic": "it is intrinsics now, a topic or a file",
    "matching.keypoints.device": "it is matching.device now",
    "matching.matcher.device": "it is matching.device now",
    "matching.surfaces.loops_per_frame": "now matching.pairs.loops_per_frame",
    "report.as_built.openings.widths_m": "now report.as_built.opening_widths_m",
    "tracking.adapt_sigmas": "sigmas always grow where the tracker errs more",
    "verdict.alone_factor": "--tolerance-m holds with a plan and without",
    "verdict.max_error_m": "it is tolerance_m now: for how many frames it holds is judged frame by frame",
    "verdict.max_stretch_error_m": "stretches are judged by tolerance_m",
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
