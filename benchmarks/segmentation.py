"""Gravity, and floor, wall and ceiling by geometry, against the truth of synthetic scans.

    python benchmarks/segmentation.py gravity [--scans 20]
    python benchmarks/segmentation.py labels [--scans 6] [--seed 100]
    python benchmarks/segmentation.py memory [--frames 200]
    python benchmarks/segmentation.py level --scan FOLDER --out PICTURE.png

`gravity` and `labels` render furnished buildings as a structured-light sensor sees them. Each scan has a
world tilted by up to 30 deg, a camera held up to 15 deg askew with a mean pitch of -30 to 15 deg, and one
of three ceilings: as built, none (an atrium), or as built and much looked at (pitch 5 to 20 deg). A third
of the walls' hangings and all of the furniture are clutter in the truth, which counts a picture 1 cm in
front of a wall as no wall. Labels are judged at every pixel with a depth, of drifted scans, and gravity
also without drift: a drifted scan has no one gravity to the tenth of a degree. Columns, which geometry
cannot tell from walls, are left out.

`memory` prints the peak memory of the stage for a scan and for one of twice the length, with as many
kept points a frame. `level` levels a folder of the 7-Scenes form and draws it from the side.
"""

import argparse
import tempfile
import time
import tracemalloc
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.runtime import Runtime
from planfit.scan import Label, Scan
from planfit.segmentation import (
    SegmentationOptions,
    choose_back_end,
    find_gravity,
    level_from_world,
    segment_scan,
)
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    Renderer,
    StructuredLightNoise,
    WalkOptions,
    drift_poses,
    make_building,
    make_camera,
    make_lights,
    make_quads,
    noisy_depth,
    walk_through,
)
from planfit.synth.options import DriftOptions

CEILINGS = ("built", "none", "looked at")


@dataclass(frozen=True)
class Case:
    """A scan with its truth."""

    scan: Scan
    """Drifted."""
    true_world_from_cams: np.ndarray
    up_world: np.ndarray
    labels: list[np.ndarray]
    """(h, w) of `Label` of each frame"""
    ceiling: str


class Frames:
    """Depth images in memory."""

    def __init__(self, depths: list[np.ndarray]) -> None:
        self._depths = depths

    def depth(self, i: int) -> np.ndarray:
        return self._depths[i].copy()

    def color(self, i: int) -> np.ndarray:
        return np.zeros((*self._depths[i].shape, 3), np.uint8)

    def labels(self, _i: int) -> np.ndarray:
        raise AssertionError("this scan has no labels")

    def write_poses(self, _directory: Path, _world_from_cams: np.ndarray) -> None:
        raise AssertionError("not written")


def make_case(seed: int, n_frames: int, width: int) -> Case:
    """A furnished building of one to three rooms, scanned askew in a tilted world."""
    rng = np.random.default_rng([seed, 77])
    ceiling = CEILINGS[seed % 3]
    building = make_building(
        BuildingOptions(
            n_rooms=1 + seed % 3, furniture_per_room=8, yaw_deg=float(rng.uniform(0, 360))
        ),
        rng,
    )
    quads = make_quads(building, rng)
    if ceiling == "none":
        is_kept = quads.label != Label.CEILING
        quads = replace(quads, **{name: value[is_kept] for name, value in vars(quads).items()})
    renderer = Renderer(quads, make_lights(building))
    pitch = rng.uniform(5, 20) if ceiling == "looked at" else rng.uniform(-30, 15)
    walk = WalkOptions(n_frames=n_frames, pitch_deg=float(pitch))
    plan_from_cams = walk_through(building, walk, rng)
    plan_from_cams = plan_from_cams @ _rotation([0, 0, 1], rng.uniform(-15, 15))
    axis = rng.normal(size=2)
    axis /= np.linalg.norm(axis)
    world_from_plan = _rotation([*axis, 0], rng.uniform(0, 30))
    world_from_plan[:3, 3] = rng.uniform(-5, 5, 3)
    up = world_from_plan[:3, 2]
    true = world_from_plan @ plan_from_cams
    camera = make_camera(CameraOptions(width_px=width, height_px=width * 3 // 4))
    views = [renderer.render(camera, pose) for pose in plan_from_cams]
    noise = StructuredLightNoise()
    depths = [noisy_depth(view.depth, view.incidence, noise, rng) for view in views]
    scan = Scan(
        name=f"case {seed}",
        frame_ids=tuple(str(i) for i in range(n_frames)),
        timestamps=np.arange(float(n_frames)),
        cameras=(camera,) * n_frames,
        world_from_cams=drift_poses(true, DriftOptions(), rng, up),
        files=Frames(depths),
    )
    return Case(scan, true, up, [view.labels for view in views], ceiling)


def _rotation(axis: list[float], angle_deg: float) -> np.ndarray:
    return se3.make_transform(
        se3.exp_so3(np.deg2rad(angle_deg) * np.array(axis, dtype=float)), np.zeros(3)
    )


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def run_gravity(arguments: argparse.Namespace) -> None:
    print("seed  ceiling    error deg  confidence  drifted deg  ms a frame")
    errors, drifted = [], []
    for seed in range(arguments.seed, arguments.seed + arguments.scans):
        case = make_case(seed, arguments.frames, arguments.width)
        still = replace(case.scan, world_from_cams=case.true_world_from_cams)
        begin = time.perf_counter()
        gravity = find_gravity(still, Runtime(1))
        ms = (time.perf_counter() - begin) * 1e3 / len(still)
        errors.append(angle_deg(gravity.up_world, case.up_world))
        on_drift = find_gravity(case.scan, Runtime(1)).up_world
        drifted.append(angle_deg(on_drift, case.up_world))
        print(
            f"{seed:4d}  {case.ceiling:10} {errors[-1]:9.3f} {gravity.confidence:11.2f} "
            f"{drifted[-1]:12.3f} {ms:11.1f}",
            flush=True,
        )
    print(
        f"error deg: median {np.median(errors):.3f}, worst {max(errors):.3f}, "
        f"within 0.3: {np.mean(np.array(errors) < 0.3):.2f}; "
        f"drifted: median {np.median(drifted):.3f}, worst {max(drifted):.3f}"
    )


def run_labels(arguments: argparse.Namespace) -> None:
    options = SegmentationOptions(back_end="geometry")
    judged = (Label.FLOOR, Label.WALL, Label.CEILING)
    total = np.zeros((len(judged), 3))
    print("seed  ceiling    " + "  ".join(f"{x.name.lower():>7} IoU prec rec" for x in judged))
    seconds, n_frames = 0.0, 0
    for seed in range(arguments.seed, arguments.seed + arguments.scans):
        case = make_case(seed, arguments.frames, arguments.width)
        gravity = find_gravity(case.scan, Runtime(1))
        counts = np.zeros((len(judged), 3))
        begin = time.perf_counter()
        found = choose_back_end(case.scan, gravity, options, Runtime(1))
        for i, true in enumerate(case.labels):
            depth = case.scan.files.depth(i)
            labels = found.labels(i, depth)
            seen = np.isfinite(depth) & (true != Label.COLUMN)
            for k, label in enumerate(judged):
                is_it, said = (true == label) & seen, (labels == label) & seen
                counts[k] += (is_it & said).sum(), (said & ~is_it).sum(), (is_it & ~said).sum()
        seconds += time.perf_counter() - begin
        n_frames += len(case.scan)
        total += counts
        print(f"{seed:4d}  {case.ceiling:10} " + _row(counts), flush=True)
    print("all              " + _row(total))
    print(f"{seconds * 1e3 / n_frames:.1f} ms a frame (one thread, {arguments.width} px wide)")


def _row(counts: np.ndarray) -> str:
    both, wrong, missed = counts.T
    with np.errstate(invalid="ignore"):
        return "  ".join(
            f"{i:11.3f} {p:.2f} {r:.2f}"
            for i, p, r in zip(
                both / (both + wrong + missed),
                both / (both + wrong),
                both / (both + missed),
                strict=True,
            )
        )


def run_memory(arguments: argparse.Namespace) -> None:
    case = make_case(1, 20, arguments.width)
    options = SegmentationOptions(back_end="geometry", max_points_per_frame=200)
    for n in (arguments.frames, 2 * arguments.frames, 4 * arguments.frames):
        idx = np.arange(n) % 20
        long = replace(
            case.scan,
            frame_ids=tuple(str(i) for i in range(n)),
            timestamps=np.arange(float(n)),
            cameras=case.scan.cameras[:1] * n,
            world_from_cams=case.true_world_from_cams[idx],
            files=Frames([case.scan.files.depth(i % 20) for i in range(20)] * (n // 20)),
        )
        tracemalloc.start()
        gravity = find_gravity(long, Runtime(2))
        structure = segment_scan(long, gravity, options, Runtime(2))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        kept = sum(
            p.nbytes
            for p in (
                structure.floor.points_cam,
                structure.ceiling.points_cam,
                structure.walls.points_cam,
                structure.unassigned_points_cam,
            )
        )
        print(f"{n:6d} frames: peak {peak / 1e6:7.1f} MB, kept points {kept / 1e6:7.1f} MB")


def run_level(arguments: argparse.Namespace) -> None:
    scan = _read_7_scenes(arguments.scan)
    options = SegmentationOptions(back_end="geometry")
    gravity = find_gravity(scan, Runtime(2))
    structure = segment_scan(scan, gravity, options, Runtime(2))
    print(
        f"up {np.round(gravity.up_world, 4).tolist()}, confidence {gravity.confidence:.2f}, "
        f"{gravity.source}; floor at {structure.floor_height_m:.3f} m"
    )
    panels = []
    level = level_from_world(gravity, structure.floor_height_m)
    found = choose_back_end(scan, gravity, options, Runtime(2))
    for name, rotated, axis in (
        ("as recorded", se3.make_transform(_y_down_to_z_up(), np.zeros(3)), 0),
        ("levelled, from the side", level, 0),
        ("levelled, from the front", level, 1),
    ):
        panels.append(_side_view(scan, rotated, axis, name, found))
    height = max(p.shape[0] for p in panels)
    panels = [
        cv2.copyMakeBorder(p, 0, height - len(p), 0, 20, cv2.BORDER_CONSTANT, value=(255,) * 3)
        for p in panels
    ]
    cv2.imwrite(str(arguments.out), np.concatenate(panels, axis=1))


def _y_down_to_z_up() -> np.ndarray:
    return np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def _side_view(scan, level_from_world, axis, title, found) -> np.ndarray:
    """Points seen along a level axis, coloured by label (floor green, wall blue, ceiling red)."""
    colors = {
        Label.NONE: (170, 170, 170), Label.FLOOR: (60, 160, 60), Label.WALL: (190, 90, 40),
        Label.CEILING: (50, 50, 200),
    }  # fmt: skip
    picture = np.full((520, 760, 3), 255, np.uint8)
    for i in range(0, len(scan), 6):
        points = scan.cameras[i].lift_image(scan.files.depth(i))[::6, ::6].reshape(-1, 3)
        labels = found.labels(i, scan.files.depth(i))[::6, ::6].ravel()
        is_ok = np.isfinite(points[:, 2]) & (points[:, 2] < 4.5)
        at = se3.transform(level_from_world @ scan.world_from_cams[i], points[is_ok])
        u = (380 + 100 * (at[:, axis] - 0.5)).astype(int)
        v = (400 - 100 * at[:, 2]).astype(int)
        inside = (u >= 0) & (u < 760) & (v >= 0) & (v < 520)
        for label, color in colors.items():
            it = inside & (labels[is_ok] == label)
            picture[v[it], u[it]] = color
    for k in range(-1, 4):
        cv2.line(picture, (0, 400 - 100 * k), (760, 400 - 100 * k), (225, 225, 225), 1)
        cv2.putText(picture, f"{k} m", (5, 397 - 100 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0,) * 3)
    cv2.putText(picture, title, (10, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (0,) * 3, 1, cv2.LINE_AA)
    return picture


class SevenScenes:
    """Depth images of a 7-Scenes folder."""

    def __init__(self, paths: list[Path]) -> None:
        self._paths = paths

    def depth(self, i: int) -> np.ndarray:
        raw = cv2.imread(str(self._paths[i]), cv2.IMREAD_UNCHANGED)
        depth = raw.astype(np.float32) / 1000
        depth[(raw == 0) | (raw == 65535)] = np.nan
        return depth


def _read_7_scenes(folder: Path) -> Scan:
    paths = sorted(folder.glob("frame-*.depth.png"))
    poses = [np.loadtxt(str(p).replace(".depth.png", ".pose.txt")) for p in paths]
    k = np.loadtxt(folder / "camera-intrinsics.txt")
    camera = Camera(640, 480, k[0, 0], k[1, 1], k[0, 2], k[1, 2])
    return Scan(
        name=str(folder),
        frame_ids=tuple(p.name.split(".")[0] for p in paths),
        timestamps=np.arange(float(len(paths))),
        cameras=(camera,) * len(paths),
        world_from_cams=np.stack(poses),
        files=SevenScenes(paths),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("gravity", "labels", "memory", "level"))
    parser.add_argument("--scans", type=int)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--width", type=int)
    parser.add_argument("--scan", type=Path)
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "level.png")
    arguments = parser.parse_args()
    run, scans, frames, width = {
        "gravity": (run_gravity, 20, 40, 320),
        "labels": (run_labels, 6, 40, 640),
        "memory": (run_memory, 0, 200, 320),
        "level": (run_level, 0, 0, 0),
    }[arguments.what]
    arguments.scans = scans if arguments.scans is None else arguments.scans
    arguments.frames = frames if arguments.frames is None else arguments.frames
    arguments.width = width if arguments.width is None else arguments.width
    run(arguments)


if __name__ == "__main__":
    main()
