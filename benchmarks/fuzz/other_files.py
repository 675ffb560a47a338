"""Files beside scans and plans: poses, options, corrections, calibrations, jobs, records of runs."""

import json
import tomllib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

Make = Callable[[Path], tuple[str, str]]
"""Writes the files into a folder; gives kind and entry."""


def other_files() -> dict[str, Make]:
    """Each file by name."""
    rows = np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], (6, 1))
    tum = "".join(f"{i / 30:.6f} {' '.join(map(str, row))}\n" for i, row in enumerate(rows))
    kitti = "1 0 0 0.1 0 1 0 0.2 0 0 1 0.3\n" * 6
    matrix = "1 0 0 0.1\n0 1 0 0.2\n0 0 1 0.3\n0 0 0 1\n"
    log = "".join(f"{i} {i} {i + 1}\n{matrix}" for i in range(6))
    euroc = "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z\n" + "".join(
        f"14036{i:014d},0.1,0.2,0.3,1,0,0,0\n" for i in range(6)
    )
    toml = 'seed = 3\n[adjust.walls]\nweight = 2.0\n[align]\ncontrol_points = ["1,2,3=4,5"]\n'
    points = "id,easting,northing,height,sigma\nA1,500001.2,4200017.9,3.1,0.01\nA2,500004.2,4200018.1,,\n"
    marks = "frame,u,v,id\n3,310.5,205,A1\n0012,122,190.25,A2\n7,,,A1\n"
    corrections = """planfit_corrections = 1
[[place]]
frame = 12
pixel = [310, 205]
plan = [4.2, 1.0]
[[place]]
scan = [1.02, 0.4, 3.3]
plan_file = [500001.2, 4200017.9]
[[add_loop]]
frames = [12, 880]
pixels = [[310, 205], [122, 190]]
[[delete_loop]]
frames = [[40, 60], [900, 930]]
[[exclude_frames]]
frames = [3, [400, 455]]
[[draw_wall]]
ends = [[0, 6], [5.2, 6]]
note = "glass"
"""

    jobs_csv = """name;scan;plan;memory-gb;adjust.walls.weight;no-plan;control-points
march;scans/march;ground.pdf;2.5;2;;known.csv
june;s3://bucket/june.zip;0=a.png|1=b.png;;1,5;no;
july;scans/july;;;;yes;
"""
    jobs_toml = """[[jobs]]
name = "march"
scan = "scans/march"
plan = ["0=a.png", "1=b.png"]
memory-gb = 2.5
"adjust.walls.weight" = 2
"""
    jobs_json = json.dumps(
        [
            {
                "name": "march",
                "scan": "scans/march",
                "plan": "a.png",
                "memory-gb": 1,
                "no-plan": False,
            },
            {
                "name": "june",
                "scan": "https://x.org/june.zip",
                "adjust": {"walls": {"weight": 2.0}},
            },
        ]
    )

    def text(kind: str, name: str, content: str) -> Make:
        def make(folder: Path) -> tuple[str, str]:
            (folder / name).write_text(content)
            return kind, name

        return make

    def edits(folder: Path) -> tuple[str, str]:
        from planfit.floorplan.edits import PlanEdits, write_edits

        segments = np.array([[[0.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [4.0, 3.0]]])
        region = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]])
        write_edits(folder / "edits.json", PlanEdits(segments, (region,), segments))
        return "edits", "edits.json"

    def g2o(folder: Path) -> tuple[str, str]:
        from planfit.lsq import PoseGraph, write_g2o

        poses = np.tile(np.eye(4), (5, 1, 1))
        pairs = np.array([(i, i + 1) for i in range(4)])
        write_g2o(
            folder / "graph.g2o", PoseGraph(poses, pairs, poses[:4], np.tile(np.eye(6), (4, 1, 1)))
        )
        return "g2o", "graph.g2o"

    def calibration(folder: Path) -> tuple[str, str]:
        from planfit.geometry.calibration import SensorCalibration
        from planfit.geometry.camera import Camera
        from planfit.scan.lens_file import PARAMETERS, write_calibration

        sigmas = dict.fromkeys(PARAMETERS, 0.0)
        camera = Camera(128, 96, 100.0, 100.0, 63.5, 47.5)
        write_calibration(folder / "calibration.json", SensorCalibration(), sigmas, camera)
        return "calibration", "calibration.json"

    return {
        "poses-tum": text("poses", "poses.txt", tum),
        "poses-kitti": text("poses", "poses.txt", kitti),
        "poses-log": text("poses", "poses.log", log),
        "poses-euroc": text("poses", "poses.csv", euroc),
        "options-toml": text("options", "options.toml", toml),
        "edits-json": edits,
        "points-csv": text("points", "control.csv", points),
        "marks-csv": text("marks", "marks.csv", marks),
        "corrections-toml": text("corrections", "corrections.toml", corrections),
        "graph-g2o": g2o,
        "calibration-json": calibration,
        "jobs-csv": text("jobs", "jobs.csv", jobs_csv),
        "jobs-toml": text("jobs", "jobs.toml", jobs_toml),
        "jobs-json": text("jobs", "jobs.json", jobs_json),
        "run-json": _run,
    }


def _run(folder: Path) -> tuple[str, str]:
    """What `evaluate`, `compare`, `view` and `export` read of a run before its scan."""
    from planfit.export.tables import scan_options_record, to_toml
    from planfit.geometry.calibration import SensorCalibration
    from planfit.pipeline.options import RefineOptions
    from planfit.scan import ScanOptions

    identity = np.eye(4).tolist()
    record = {
        "inputs": {"scan": "scan", "scan_fingerprint": "d196", "plan": "plan.npy"},
        "options": tomllib.loads(to_toml(RefineOptions())),
        "scan_options": scan_options_record(ScanOptions()),
        "frames": 6,
        "plan_faces": 4,
        "storeys": [],
        "alignment": {"metres_per_unit_xy": [1.0, 1.0]},
        "tracking": {"convention": "recorded"},
        "world_from_plan": identity,
        "plan_from_world_before": identity,
        "sensor": {"correction": asdict(SensorCalibration())},
        "corrections": {"toml": "planfit_corrections = 1\n"},
        "cache": None,
    }
    (folder / "run.json").write_text(json.dumps(record))
    poses = "".join(f"{i / 30:.6f} 0.1 0.2 0.3 0 0 0 1\n" for i in range(6))
    (folder / "trajectory.tum").write_text(poses)
    return "run", "run.json"
