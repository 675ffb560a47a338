"""Matches of synthetic scans against their truth, and what they cost.

    python benchmarks/matching.py quality [--seeds 3] [--width 320] [--frames 300]
        precision of verified matches, recall of places visited again, look-alike rooms merged
    python benchmarks/matching.py speed [--frames 300] [--width 640] [--rooms 6]
        seconds of each stage on a scan read from files, cold, on two threads, and the peak of memory
    python benchmarks/matching.py pairs [--frames 25000]
        time and memory of choosing pairs where the camera lingers

Scans are rendered once into $PLANFIT_BENCH_CACHE (default: a folder in the temporary folder). Recorded
poses drift by 2 % of the way walked. A place is a square of 1.5 m about what the camera looks at and an
eighth of the compass; it was visited again where two frames more than 30 apart show at least half of
each other's view. `places` is the share of places of which some such pair is verified with mostly right
matches, `near` counts verified pairs up to 3 frames off as well, `visits` the same for each two stretches
of 30 frames. `merged` are verified pairs between a room and its exact copy.
"""

import argparse
import resource
import time

import numpy as np
from matching_scans import TestScan, look_alike_scan, walk_scan
from matching_truth import find_revisits, judge

from planfit.geometry.camera import Camera
from planfit.matching import MatchingOptions, find_matches
from planfit.matching.covisibility import sample_views
from planfit.matching.detect import detect
from planfit.matching.pairs import FrameDescriptors, PairOptions, choose_pairs
from planfit.runtime import Runtime
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.segmentation import SegmentationOptions, find_gravity, segment_scan


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("quality", "speed", "pairs"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--width", type=int)
    parser.add_argument("--rooms", type=int, default=6)
    arguments = parser.parse_args()
    if arguments.what == "quality":
        quality(arguments.seeds, arguments.frames or 300, arguments.width or 320, arguments.rooms)
    elif arguments.what == "speed":
        speed(arguments.frames or 300, arguments.width or 640, arguments.rooms)
    else:
        pairs(arguments.frames or 25_000)


def quality(seeds: int, n_frames: int, width: int, n_rooms: int) -> None:
    print(
        f"{'scan':28} {'precision':>10} {'wrong/pairs':>12} {'places':>8} {'near':>6} {'of':>4} "
        f"{'visits':>7} {'of':>4} {'merged':>7} {'tried':>6}"
    )
    for seed in range(seeds):
        show(walk_scan(seed, n_frames, n_rooms, width))
    for seed in range(seeds):
        for order in ("AB", "ABA", "AABB"):
            show(look_alike_scan(seed, n_frames, width, order))
    # By the end of twice as long a walk, six sigmas of drift are more than the rooms are apart.
    show(look_alike_scan(0, 2 * n_frames + 100, width, "AAABBB"))


def show(test: TestScan) -> None:
    matches = matched(test)
    found = judge(test, matches, find_revisits(test))
    print(
        f"{test.name:28} {found.precision:10.4f} {found.wrong_pairs:5d}/{found.n_pairs:6d} "
        f"{found.place_recall:8.3f} {found.place_recall_near:6.3f} {found.n_places:4d} "
        f"{found.visit_recall:7.3f} {found.n_visits:4d} {found.merged:7d} {matches.n_tried:6d}",
        flush=True,
    )


def matched(test: TestScan):
    scan = test.scan
    odometry = make_odometry(scan.world_from_cams, OdometryOptions())
    return find_matches(scan, odometry, MatchingOptions(), Runtime(2))


def speed(n_frames: int, width: int, n_rooms: int) -> None:
    """Stages as a run has them, then the parts of matching one frame at a time."""
    warm = walk_scan(9, 12, 1, 160)
    run_stages(warm.scan, {})
    test = walk_scan(0, n_frames, n_rooms, width)
    times: dict[str, tuple[float, float]] = {}
    before = peak_mb()
    matches = run_stages(test.scan, times)
    n = len(test.scan)
    print(f"{test.name}: {n} frames, {matches.n_keypoints / n:.0f} keypoints a frame, "
          f"{matches.n_tried / n:.1f} pairs tried and {len(matches.pairs) / n:.1f} verified")  # fmt: skip
    for name, (wall, cpu) in times.items():
        print(f"{name:18} {1e3 * wall / n:8.1f} ms wall {1e3 * cpu / n:8.1f} ms CPU a frame")
    wall, cpu = np.sum(list(times.values()), axis=0)
    print(f"{'together':18} {1e3 * wall / n:8.1f} ms wall {1e3 * cpu / n:8.1f} ms CPU a frame: "
          f"{n / wall:.1f} frames/s wall, {2 * n / cpu:.1f} by CPU time on 2 cores")  # fmt: skip
    print(f"peak memory {peak_mb():.0f} MB, {before:.0f} MB before")


def run_stages(scan, times: dict[str, tuple[float, float]]):
    """Matches; fills wall and CPU seconds by stage."""
    runtime = Runtime(2)
    options = MatchingOptions()

    def timed(name, call):
        wall, cpu = time.perf_counter(), time.process_time()
        result = call()
        times[name] = (time.perf_counter() - wall, time.process_time() - cpu)
        return result

    timed("read", lambda: runtime.map("read", "", len(scan), lambda i: _read(scan, i)))
    timed("read and keypoints", lambda: runtime.map(
        "keypoints", "", len(scan), lambda i: {"n": np.array(len(detect(
            scan.files.color(i), scan.files.depth(i), scan.cameras[i], options.keypoints)))}))  # fmt: skip
    both = times["read and keypoints"]
    odometry = make_odometry(scan.world_from_cams, OdometryOptions())
    matches = timed("matching", lambda: find_matches(scan, odometry, options, runtime))
    everything = times.pop("matching")
    times["read and keypoints"] = both
    times["match"] = (everything[0] - both[0], everything[1] - both[1])
    del times["read"]
    gravity = timed("level", lambda: find_gravity(scan, runtime))
    timed("segmentation", lambda: segment_scan(
        scan, gravity, SegmentationOptions(back_end="geometry"), runtime))  # fmt: skip
    return matches


def _read(scan, i: int):
    scan.files.color(i), scan.files.depth(i)
    return {}


def pairs(n: int) -> None:
    """Choosing pairs for a camera that lingers: a tenth of the frames stands about in one room."""
    for count in (n // 4, n // 2, n):
        rng = np.random.default_rng(0)
        poses = lingering(count, rng)
        odometry = make_odometry(poses, OdometryOptions())
        wall, cpu = time.perf_counter(), time.process_time()
        found = choose_pairs(poses, odometry, PairOptions(), descriptors_of(count, rng))
        print(
            f"{count} frames: {len(found)} pairs, {time.perf_counter() - wall:.2f} s wall, "
            f"{time.process_time() - cpu:.2f} s CPU, peak memory {peak_mb():.0f} MB",
            flush=True,
        )


def descriptors_of(n: int, rng: np.random.Generator) -> FrameDescriptors:
    """Descriptors that tell nothing, so that retrieval has the most to do."""
    vectors = rng.normal(size=(n, 256)).astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    points = [rng.uniform([-2, -1, 2], [2, 1, 4], (24, 3)) for _ in range(n)]
    camera = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
    return FrameDescriptors(vectors, np.zeros(n), sample_views(points, (camera,) * n))


def lingering(n: int, rng: np.random.Generator) -> np.ndarray:
    """Poses that walk round a block of 40 x 20 m; often stopping, once for a tenth of all."""
    speed = np.where((np.arange(n) // 100) % 10 == 0, 0.002, 0.1)
    speed[n // 3 : n // 3 + n // 10] = 0.001
    s = np.cumsum(speed) % 120.0
    corners = np.array([[0, 0], [40, 0], [40, 20], [0, 20], [0, 0]], dtype=float)
    at = np.array([0.0, 40.0, 60.0, 100.0, 120.0])
    xy = np.column_stack([np.interp(s, at, corners[:, k]) for k in range(2)])
    yaw = np.unwrap(np.interp(s, at, [0.0, np.pi / 2, np.pi, 1.5 * np.pi, 2 * np.pi]))
    yaw = yaw + 0.4 * np.sin(np.arange(n) / 40.0)
    forward = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(n)])
    right = np.column_stack([np.sin(yaw), -np.cos(yaw), np.zeros(n)])
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = right, np.cross(forward, right), forward
    poses[:, :2, 3] = xy + rng.normal(0, 0.02, (n, 2))
    return poses


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
