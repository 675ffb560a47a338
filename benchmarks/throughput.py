"""From files to poses against the time a scan took to record: `python benchmarks/throughput.py --help`.

A synthetic office is walked through at 30 frames a second, its images are written once into a folder, and
refined in a process of its own, labels by geometry, nothing cached. Errors are RMS of all frames' positions
in the scan's axes.
"""

import json
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
from planfit.tracking import KeyframeOptions

FPS = 30.0
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
    """At 30 a second; a room for every 250."""
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
    """Real-time factor, peak memory, keyframes a second; with `all_frames` the ratio of errors."""
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
    name = f"{arguments.n_frames // 1000}k"
    front = (
        f"read, described, labelled and matched in {found['front_wall_s']:.0f} s of wall time, "
        f"{found['front_cpu_s']:.0f} s of CPU ({found['n_keyframes'] / found['front_cpu_s']:.1f} keyframes a "
        f"second of one core); {conditions}"
    )
    made = [
        Record(f"realtime_factor_{name}", found["wall_s"] / recorded_s, "1", conditions),
        Record(f"throughput_{name}_peak_gb", found["peak_gb"], "GB", conditions),
        Record("keyframes_per_s", found["n_keyframes"] / found["front_wall_s"], "1/s", front),
    ]
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
    n, width = arguments.n_frames, arguments.width_px
    folder = arguments.folder / f"{n}_{width}"
    if not folder.exists():
        # Drift that grows with the way, not with the number of frames.
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
            str(max(n // FRAMES_A_ROOM, 2)),
            "--walk.n-frames",
            str(n),
        ]
        command += ["--camera.width-px", str(width), "--camera.height-px", str(width * 3 // 4)]
        command += ["--drift.yaw-deg", "0.05", "--drift.translation-m", "0.006"]
        subprocess.run(command, check=True)
    return folder


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
    truth = np.loadtxt(folder / "groundtruth.tum")[:, 1:4]

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
