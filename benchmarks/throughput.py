"""From files to poses against the time a scan took to record: `python benchmarks/throughput.py --help`.

A synthetic office is walked through at 30 frames a second, its images are written once into a folder, and
refined in a process of its own, labels by geometry, nothing cached. Errors are RMS of all frames' positions
in the scan's axes.

Of long walks in laps (`--n-rendered`) the first lap is rendered; later ones go back and forth over its
images, each with recorded drift of its own, but with the sensor noise of the first: two sightings of a place
may be the same image. Work and memory are those of so many frames; errors are less than with own noise.
"""

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from records import Record, machine

import planfit
from planfit.runtime import Runtime
from planfit.scan import read_tum
from planfit.scan.formats.facap import UP_WORLD
from planfit.scan.poses import write_pose, write_tum
from planfit.synth import DriftOptions, drift_poses
from planfit.tracking import KeyframeOptions

FPS = 30.0
DRIFT = DriftOptions(yaw_deg=0.05, translation_m=0.006)
"""A frame: it grows with the way, not with the number of frames."""
FRAMES_A_ROOM = 250
"""As many as a walk through a room takes at a metre every 1.2 s."""
FRONT_END = ("tracking", "level", "floor and walls", "matching", "matching by geometry")
"""Stages that look at keyframes; the adjustment follows."""


@dataclass(frozen=True)
class Arguments:
    """Render a dense scan once, refine it by keyframes and, if asked for, by all of its frames."""

    folder: Annotated[Path, tyro.conf.Positional] = Path("throughput.cache")
    """Where the scan is kept."""
    n_frames: int = 3000
    """At 30 a second."""
    n_rooms: int = 0
    """Of the office; 0: one for every 250 frames that are rendered."""
    n_rendered: int = 0
    """Frames that are rendered, from which laps are made; 0: all."""
    width_px: int = 640
    """Of images; three quarters of it high."""
    all_frames: bool = False
    """Also with all frames as keyframes, for the ratio of errors."""
    one: str = ""
    """Refine the scan at this place and print what came of it; for the benchmark's own processes."""
    min_frames: int = 600
    """Of the keyframes."""


def main(arguments: Arguments) -> None:
    """Print the records as JSON."""
    if arguments.one:
        print(json.dumps(_refined(Path(arguments.one), arguments.min_frames)))
        return
    for record in records(arguments):
        print(json.dumps(vars(record)))


def records(arguments: Arguments) -> list[Record]:
    """Real-time factor, the same of CPU time, which other load on the machine leaves alone, peak memory,
    keyframes a second; with `all_frames` the ratio of errors."""
    scan = _rendered(arguments)
    load = machine()
    found = _measured(scan, arguments.min_frames)
    recorded_s = found["n_frames"] / FPS
    conditions = (
        f"{found['n_frames']} frames of {arguments.width_px} x {arguments.width_px * 3 // 4} px, "
        f"{recorded_s:.0f} s at 30 a second, {found['n_keyframes']} keyframes, labels by geometry, "
        f"position RMS {found['before_m']:.3f} -> {found['after_m']:.4f} m, {found['outcome']}; "
        f"{found['cpu_s']:.0f} s of CPU, {found['cpu_s'] / found['wall_s']:.2f} cores had on average; one "
        f"run, nothing cached; {load}"
    )
    if arguments.n_rendered:
        conditions = (
            f"{arguments.n_rendered} rendered, in laps there and back over them; {conditions}"
        )
    name = f"{arguments.n_frames // 1000}k"
    front = (
        f"read, described, labelled and matched in {found['front_wall_s']:.0f} s of wall time, "
        f"{found['front_cpu_s']:.0f} s of CPU ({found['n_keyframes'] / found['front_cpu_s']:.1f} keyframes a "
        f"second of one core); {conditions}"
    )
    made = [
        Record(f"realtime_factor_{name}", found["wall_s"] / recorded_s, "1", conditions),
        Record(
            f"cpu_factor_{name}",
            found["cpu_s"] / recorded_s,
            "1",
            f"CPU seconds by second; {conditions}",
        ),
        Record(f"{name}_peak_gb", found["peak_gb"], "GB", conditions),
    ]
    if not arguments.n_rendered:
        keyframes_per_s = found["n_keyframes"] / found["front_wall_s"]
        made.append(Record("keyframes_per_s", keyframes_per_s, "1/s", front))
    if arguments.all_frames:
        every = _measured(scan, found["n_frames"] + 1)
        compared = (
            f"{conditions}; with all frames {every['after_m']:.4f} m, {every['cpu_s']:.0f} s of CPU, "
            f"{every['peak_gb']:.2f} GB"
        )
        ratio = found["after_m"] / every["after_m"]
        made.append(Record("keyframe_error_ratio", ratio, "1", compared))
    return made


class StageClock:
    """Wall and CPU seconds of each stage, by what a runtime reports."""

    def __init__(self) -> None:
        self.seconds: dict[str, tuple[float, float]] = {}
        """Of stages that ended, all their times together."""
        self._began: dict[str, tuple[float, float]] = {}

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Stages begin with 0 of 0 and end with 1 of 0; what they report between is of parts of them."""
        if total > 0:
            return
        now = time.perf_counter(), time.process_time()
        if done == 0:
            self._began[stage] = now
        else:
            wall, cpu = self.seconds.get(stage, (0.0, 0.0))
            began = self._began[stage]
            self.seconds[stage] = wall + now[0] - began[0], cpu + now[1] - began[1]


def _rendered(arguments: Arguments) -> Path:
    """Folder of the scan, made where it is not there."""
    n, width = arguments.n_rendered or arguments.n_frames, arguments.width_px
    n_rooms = arguments.n_rooms or max(n // FRAMES_A_ROOM, 2)
    folder = arguments.folder / f"{n}_{n_rooms}_{width}"
    if not folder.exists():
        command = [
            sys.executable,
            "-m",
            "planfit",
            "synth",
            str(folder),
            "--seed",
            "5",
            "--no-has-labels",
        ]
        command += [
            "--building.n-rooms",
            str(n_rooms),
            "--walk.n-frames",
            str(n),
        ]
        command += ["--camera.width-px", str(width), "--camera.height-px", str(width * 3 // 4)]
        command += ["--drift.yaw-deg", str(DRIFT.yaw_deg)]
        command += ["--drift.translation-m", str(DRIFT.translation_m)]
        subprocess.run(command, check=True)
    if n == arguments.n_frames:
        return folder
    laps = arguments.folder / f"{arguments.n_frames}_of_{folder.name}"
    if not laps.exists():
        write_laps(folder, laps, arguments.n_frames)
    return laps


def write_laps(rendered: Path, folder: Path, n_frames: int) -> None:
    """A walk there and back over the frames of a rendered one, again and again; images are links."""
    _, true = read_tum(rendered / "groundtruth.tum")
    n = len(true)
    there_and_back = np.concatenate([np.arange(n), np.arange(n)[::-1]])
    idx = np.resize(there_and_back, n_frames)
    truth = true[idx]
    drifted = drift_poses(truth, DRIFT, np.random.default_rng(5), np.array(UP_WORLD))
    part = folder.with_name(f"{folder.name}.part")
    (part / "arcore").mkdir(parents=True)
    for i, k in enumerate(idx):
        for kind, ending in (("frame", "jpg"), ("depth", "png"), ("cam_params", "txt")):
            source = rendered / "arcore" / f"{kind}-{k + 1:04d}.{ending}"
            os.link(source, part / "arcore" / f"{kind}-{i + 1:05d}.{ending}")
        write_pose(part / "arcore" / f"pose-{i + 1:05d}.txt", drifted[i])
    os.link(rendered / "floorplan.npy", part / "floorplan.npy")
    write_tum(part / "groundtruth.tum", np.arange(1.0, n_frames + 1), truth)
    part.rename(folder)


def _measured(folder: Path, min_frames: int) -> dict:
    command = [sys.executable, __file__, "--one", str(folder), "--min-frames", str(min_frames)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def _refined(folder: Path, min_frames: int) -> dict:
    begin, cpu = time.perf_counter(), time.process_time()
    scan = planfit.read_scan(folder)
    floorplan = planfit.read_floorplan(scan.floorplan_path)
    options = planfit.RefineOptions(keyframes=KeyframeOptions(min_frames=min_frames))
    clock = StageClock()
    result = planfit.refine(scan, floorplan, options, Runtime(on_progress=clock))
    wall_s, cpu_s = time.perf_counter() - begin, time.process_time() - cpu
    truth = read_tum(folder / "groundtruth.tum")[1][:, :3, 3]

    def rms_m(poses: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.sum((poses[:, :3, 3] - truth) ** 2, axis=1))))

    return {
        "n_frames": len(scan),
        "n_keyframes": len(result.solved_frame_idx),
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
        "before_m": rms_m(scan.world_from_cams),
        "after_m": rms_m(result.world_from_cams),
        "front_wall_s": sum(clock.seconds[stage][0] for stage in FRONT_END),
        "front_cpu_s": sum(clock.seconds[stage][1] for stage in FRONT_END),
        "outcome": str(result.verdict.outcome),
        "seconds_by_stage": result.seconds_by_stage,
    }


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=Arguments.__doc__))
