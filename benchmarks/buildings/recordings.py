"""Recordings that people have, and that were refused or read wrongly: each beside what is right.

All of them show one walk, made for the purpose (EXPECT.txt beside each): its frames, depth and path are
known, and of those that are refined the true poses.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from faults.measure import brought_to
from faults.scans import SHARED

import planfit
from buildings.reading_cases import (
    ReadingCase,
    case_of,
    fact_between,
    fact_same,
    fact_within,
    names_one_of,
)
from buildings.rows import Fact, Reading
from planfit.errors import ScanError
from planfit.pipeline.result import RefineResult
from planfit.scan import Scan, ScanOptions, read_scan, read_tum
from planfit.scan.statistics import depth_statistics, path_statistics
from planfit.scan.views import select_frames

FOLDER = "field/scans"
GOOD_M = 0.05
"""RMS error after the rigid motion that fits best: 0.01 m where poses and depth are as they should be."""
DEPTH_SHARE = 0.06
"""Of the median depth; some of the pixels and frames are looked at."""
ARE_BODY_AXES = ("x forward", "body axes")
"""One of these names the convention of ROS; frames of its tf stand in the names of the files."""

Judge = Callable[[RefineResult, str], Iterator[Fact]]
"""Of a result, and all that was said."""


def recording_cases() -> tuple[ReadingCase, ...]:
    """All recordings; a recording with several files of poses is several cases."""
    return (*_bags(), *_decimal_commas(), *_clouds(), *_folders(), *_refined())


def _bags() -> tuple[ReadingCase, ...]:
    """Twelve frames of the walk, 2.26 m."""
    folder = "bag-odometry-beside-tf-static"
    walk = (12, 1.92, 2.2, 2.35)
    odometry = f"{folder}/odometry_and_tf_static"
    topic = ScanOptions(pose_topic="/rtabmap/odom")
    return (
        _read(odometry, walk, is_short=True),
        _read(odometry, walk, topic, of="topic named"),
        _read(f"{folder}/zed_pose_and_tf_static", walk),
        _read(f"{folder}/tf_without_tf_static", walk, steps=("/tf_static",)),
        _read(f"{folder}/no_camera_info", walk, steps=("intrinsics",)),
    )


def _decimal_commas() -> tuple[ReadingCase, ...]:
    folder, walk, steps = "decimal-comma-trajectory", (5, 1.547, 0.96, 1.0), ("decimal comma",)
    names = ("poses_space.txt", "poses_tab.txt", "poses_semicolon.csv", "poses_kitti.txt")
    with_poses = tuple(
        _read(folder, walk, _with_poses(folder, name), steps, name, is_short=name == names[0])
        for name in names
    )
    return (_read(folder, walk, of="its own poses"), *with_poses)


def _clouds() -> tuple[ReadingCase, ...]:
    """A laser scan is cut into frames of its own: their number is not given, the path is."""
    folder, walk = "laz-times-in-nanoseconds", (None, 1.74, 9.2, 10.2)
    pairs = (
        ("cloud_s.laz", "traj_s.txt", ()),
        ("cloud_ns.laz", "traj_s.txt", ("nanosecond",)),
        ("cloud_us.laz", "traj_s.txt", ("microsecond",)),
        ("cloud_1e15.laz", "traj_s.txt", ("1e15", "1e+15")),
        ("cloud_ns.laz", "traj_ns.txt", ("nanosecond",)),
        ("cloud_s.laz", "traj.laz", ()),
        ("cloud_s.laz", "traj_s_comma.txt", ("decimal comma",)),
    )
    return tuple(
        _read(f"{folder}/{cloud}", walk, _with_poses(folder, poses), steps, f"with {poses}")
        for cloud, poses, steps in pairs
    )


def _folders() -> tuple[ReadingCase, ...]:
    """Folders that other programs write; forty frames of the walk are 9.96 m, five 0.98 m."""
    orbslam = "orbslam-associations"
    forty, five = (40, 2.122, 9.8, 10.1), (5, 1.547, 0.96, 1.0)
    return (
        _read("nerfstudio-float-tiff", five, is_short=True),
        _read("nerfstudio-npy-mm", forty, steps=("--depth-scale",), is_short=True),
        _read(orbslam, forty, steps=("associations",), is_short=True),
        _read(
            orbslam,
            forty,
            _with_poses(orbslam, "CameraTrajectory.txt"),
            ("associations",),
            "CameraTrajectory.txt",
        ),
        # Its own name stands among the formats that are told; the hint names the folders.
        _read("rtabmap-export-no-prefix", five, steps=("rtabmap_rgb", "extract images")),
        _read("scannet-frames-25k/scene0000_00", forty, is_short=True),
    )


def _refined() -> tuple[ReadingCase, ...]:
    tum, body = "tum-depth-in-mm", "ros-body-axes"
    auto = planfit.RefineOptions(poses_convention="auto")
    poses = ("poses_camera_link.txt", "poses_base_link.txt", "poses_base_link_tilted.txt")
    asks = partial(_near_truth, truth=f"{tum}/truth.tum", or_named=("--depth-scale",))
    knows = partial(_near_truth, truth=f"{tum}/truth.tum")
    named = partial(_near_truth, truth=f"{body}/truth.tum", or_named=ARE_BODY_AXES)
    optical = "poses_camera_optical.txt"
    return (
        _refine(tum, asks, "without a plan", steps=("--depth-scale",)),
        # A plan in metres decides whether poses or depth are in another unit.
        _refine(tum, knows, "with its plan", plan="plan.npy"),
        *(_refine(body, named, name, auto, poses=name, steps=ARE_BODY_AXES) for name in poses),
        _refine(body, named, optical, auto, poses=optical),
        _refine("nerfstudio-npy-mm", _measured, "without a plan", steps=("--depth-scale",)),
        case_of(
            "recording",
            "recordings",
            "nothing-held-exit-0, one frame",
            f"{FOLDER}/nothing-held-exit-0",
            read_one_frame,
            ("nothing",),
            is_short=True,
        ),
    )


def read_recording(
    path: str, options: ScanOptions, walk: tuple[int | None, float, float, float]
) -> Reading:
    """Read a recording as `planfit inspect` does.

    Args:
        path: in the folder of recordings.
        options: of the readers.
        walk: its frames, median depth, and the shortest and longest that its path may be; m.

    Raises:
        ScanError: it is refused.
    """
    scan = read_scan(SHARED / FOLDER / path, options=options)
    n_frames, median_m, low_m, high_m = walk
    depth_m = depth_statistics(scan, planfit.Runtime(workers=1)).median_m
    facts = [] if n_frames is None else [fact_same("frames", n_frames, len(scan))]
    facts += [
        fact_within("median depth, m", median_m, depth_m, DEPTH_SHARE * median_m),
        fact_between("path, m", low_m, high_m, path_statistics(scan).length_m),
    ]
    return Reading(tuple(facts), doubts=scan.warnings)


def refine_recording(
    path: str,
    scan_options: ScanOptions,
    options: planfit.RefineOptions,
    plan: str,
    judge: Judge,
) -> Reading:
    """Refine a recording as `planfit refine` does, by a plan in its folder, or without one.

    Raises:
        PlanfitError: it is refused.
    """
    folder = SHARED / FOLDER / path
    scan = read_scan(folder, options=scan_options)
    floorplan = planfit.read_floorplan(folder / plan) if plan else None
    return judged(scan, floorplan, options, judge)


def read_one_frame() -> Reading:
    """A recording of a single frame, which nothing ties to anything: stands for a database of one node."""
    scan = read_scan(SHARED / FOLDER / "decimal-comma-trajectory")
    first = select_frames(scan, np.array([0]), scan.world_from_cams[:1])
    return judged(first, None, planfit.RefineOptions(), _measured)


def judged(
    scan: Scan,
    floorplan: planfit.Floorplan | None,
    options: planfit.RefineOptions,
    judge: Judge,
) -> Reading:
    """A result beside the truth. Notes are no doubts where exit 0 says that the poses can be used."""
    result = planfit.refine(scan, floorplan, options, planfit.Runtime(workers=1))
    verdict = result.verdict
    exit_code = 0 if verdict.is_refined else 1
    said = " ".join([verdict.headline, verdict.advice, *result.warnings, *scan.warnings])
    doubts = (verdict.headline,) if exit_code else ()
    return Reading(tuple(judge(result, said)), doubts=doubts, exit_code=exit_code)


def _near_truth(
    result: RefineResult, said: str, truth: str, or_named: tuple[str, ...] = ()
) -> Iterator[Fact]:
    """Error of positions after the best rigid motion: scale counts. Where `or_named` is given, exit 1 with
    one of these words is as good."""
    _, true_world_from_cams = read_tum(SHARED / FOLDER / truth)
    true_m = true_world_from_cams[:, :3, 3]
    if len(true_m) != len(result.plan_from_cams):
        raise ScanError(
            f"{truth}: expected {len(true_m)} refined poses, found {len(result.plan_from_cams)}"
        )
    apart_m = brought_to(result.plan_from_cams[:, :3, 3], true_m) - true_m
    error_m = float(np.sqrt(np.mean(np.sum(apart_m**2, axis=1))))
    is_named = not result.verdict.is_refined and names_one_of(said, or_named)
    right = f"{GOOD_M:g} or less" + (f", or exit 1 that names {or_named[0]}" if or_named else "")
    yield Fact("error of positions, m", right, f"{error_m:.3f}", error_m <= GOOD_M or is_named)


def _measured(result: RefineResult, said: str) -> Iterator[Fact]:
    """Exit 0 is for what images hold: nothing else ties the frames of these recordings."""
    is_vouched, n_matches = result.verdict.is_refined, result.matches.n_matches
    found = f"{'exit 0' if is_vouched else 'exit 1'}, {n_matches} matches: {said[:60]}"
    yield Fact("exit 0 only where matched", "exit 1", found, n_matches > 0 or not is_vouched)


def _with_poses(folder: str, name: str) -> ScanOptions:
    return ScanOptions(poses=SHARED / FOLDER / folder / name)


def _read(
    path: str,
    walk: tuple[int | None, float, float, float],
    options: ScanOptions | None = None,
    steps: tuple[str, ...] = (),
    of: str = "",
    is_short: bool = False,
) -> ReadingCase:
    """`of` tells two readings of one recording apart."""
    read = partial(read_recording, path, options or ScanOptions(), walk)
    name = f"{path}, {of}" if of else path
    return case_of("recording", "recordings", name, f"{FOLDER}/{path}", read, steps, is_short)


def _refine(
    path: str,
    judge: Judge,
    of: str,
    options: planfit.RefineOptions | None = None,
    poses: str = "",
    plan: str = "",
    steps: tuple[str, ...] = (),
) -> ReadingCase:
    scan_options = _with_poses(path, poses) if poses else ScanOptions()
    read = partial(
        refine_recording, path, scan_options, options or planfit.RefineOptions(), plan, judge
    )
    name = f"{path}, refined, {of}"
    return case_of("recording", "recordings", name, f"{FOLDER}/{path}", read, steps)
