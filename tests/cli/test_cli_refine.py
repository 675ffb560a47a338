"""`planfit refine` and `evaluate` on real files, through the command line's own entry point."""

import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import planfit
from finding_records import check_findings
from planfit.cli import run
from planfit.cli.parser import parse
from planfit.cli.refine import RefineArguments
from planfit.compiled.making import COMPILING
from planfit.evaluation import position_errors
from planfit.export.write import FILES
from planfit.findings import SCHEMA_VERSION
from planfit.scan import read_scan, read_tum, write_tum


@pytest.fixture(scope="module")
def finished(small_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "out"
    assert run(["refine", str(small_scan), str(small_scan / "floorplan.npy"), "-o", str(out)]) == 0
    return out


def test_seconds_of_all_stages_are_those_of_the_run(
    small_scan: Path, tmp_path: Path, brief: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    begin = time.perf_counter()
    assert run(["refine", str(small_scan), "-o", str(tmp_path), *brief]) == 0
    took_s = time.perf_counter() - begin
    seconds = json.loads((tmp_path / "run.json").read_text())["seconds_by_stage"]
    assert min(seconds.values()) >= 0
    assert {"read", "floor and walls", "adjust", "write poses", "write report", "other"} <= set(
        seconds
    )
    # Before the run begins, words are parsed, on a busy machine for more than a second.
    assert -0.1 < took_s - sum(seconds.values()) < 1 + 0.1 * took_s
    said = " ".join(capsys.readouterr().out.split())
    total, stages = re.findall(r"(\d+\.\d) s: ((?:[a-z ]+ \d+\.\d(?:, )?)+)", said)[0]
    named = [float(value) for value in re.findall(r"\d+\.\d", stages)]
    assert abs(sum(named) - float(total)) < 1
    assert abs(float(total) - sum(seconds.values())) < 1


@pytest.mark.parametrize(
    ("words", "scans", "plan"),
    [
        (["march", "plan.png"], ["march"], ["plan.png"]),
        (["plan.PDF", "march", "june.zip"], ["march", "june.zip"], ["plan.PDF"]),
        (["march", "june", "--plan", "plan.png"], ["march", "june"], ["plan.png"]),
        (["walk.las", "walls.dxf"], ["walk.las"], ["walls.dxf"]),
        (["imdf.zip", "march"], ["imdf.zip", "march"], []),
        (["plan.png"], ["plan.png"], []),
    ],
    ids=lambda value: " ".join(value),
)
def test_a_plan_among_the_scans_is_the_plan(
    words: list[str], scans: list[str], plan: list[str]
) -> None:
    told = parse(RefineArguments, "planfit refine", [*words, "-o", "OUT"]).with_plan_among_scans()
    assert [*map(str, told.scan)] == scans
    assert list(told.plan) == plan


@pytest.mark.parametrize("more", [["b.dxf"], ["--plan", "b.dxf"]], ids=lambda value: value[0])
def test_two_plans_are_refused_with_how_storeys_are_written(more: list[str], capsys) -> None:
    assert run(["refine", "march", "a.png", *more, "-o", "OUT"]) == 2
    error = capsys.readouterr().err
    assert "found a.png and b.dxf" in error
    assert "--plan 0=FILE" in error


def test_every_file_of_the_outputs_page_is_written(finished: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "outputs.md"
    of_refine = page.read_text().split("`planfit align")[0]
    names = re.findall(r"^\| `OUT/([^`]+)`(?:, `([^`]+)`)?", of_refine, flags=re.MULTILINE)
    expected = {name.rstrip("/") for pair in names for name in pair if name}
    assert expected == {path.name for path in finished.iterdir()}
    assert set(FILES) <= expected | set(re.findall(r"`OUT/([^`/]+)`", of_refine))


def test_who_stops_the_report_keeps_poses_and_numbers(
    small_scan: Path, tmp_path: Path, brief: list[str], monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    def interrupted(*_: object, **_how: object) -> None:
        raise KeyboardInterrupt

    words = ["refine", str(small_scan), "-o", str(tmp_path), *brief]
    found = []

    def refined_once(*given: Any, **how: Any) -> planfit.RefineResult:
        if not found:
            found.append(planfit.refine(*given, **how))
        return found[0]

    for stopped_in in ("sample_clouds", "make_report"):
        monkeypatch.setattr("planfit.cli.refine.refine", refined_once)
        monkeypatch.setattr(f"planfit.saving.{stopped_in}", interrupted)
        assert run(words) == 130
        assert "write poses" in capsys.readouterr().err
        left = {path.name for path in tmp_path.iterdir() if path.name[0] != "."}
        assert left == {*FILES, "overlay.png"} - {"control_points.csv"}
        monkeypatch.undo()
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["verdict"]["outcome"] == "refined"
    poses = (tmp_path / "trajectory.tum").read_bytes()
    assert run(words) == 0
    assert (tmp_path / "report.html").is_file()
    assert (tmp_path / "trajectory.tum").read_bytes() == poses


@pytest.mark.parametrize("command", ["refine", "align", "calibrate"])
def test_kernels_are_compiled_in_front_of_all_stages(
    command: str, small_scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    def stop(report) -> None:
        report(COMPILING, 0, 0)
        raise KeyboardInterrupt

    monkeypatch.setattr(f"planfit.cli.{command}.compile_what_is_not_ready", stop)
    plan = {"align": [str(small_scan / "floorplan.npy")]}.get(command, [])
    out = tmp_path / ("sensor.json" if command == "calibrate" else "out")
    assert run([command, str(small_scan), *plan, "-o", str(out)]) == 130
    told = [line for line in capsys.readouterr().err.splitlines() if "0:00:0" in line]
    assert [line.startswith(COMPILING) for line in told] == [True]


def test_refined_poses_are_far_nearer_to_the_truth(finished: Path, small_scan: Path) -> None:
    before = read_scan(small_scan).world_from_cams
    _, truth = read_tum(small_scan / "groundtruth.tum")
    after = np.stack([np.loadtxt(p) for p in sorted((finished / "poses").iterdir())])
    first, last = (position_errors(poses, truth).rms_m for poses in (before, after))
    assert last < 0.03
    assert last < 0.25 * first


def test_trajectory_is_in_the_plan_frame_and_poses_in_the_scans(finished: Path) -> None:
    record = json.loads((finished / "run.json").read_text())
    _, plan_from_cams = read_tum(finished / "trajectory.tum")
    poses = np.stack([np.loadtxt(p) for p in sorted((finished / "poses").iterdir())])
    np.testing.assert_allclose(
        np.array(record["world_from_plan"]) @ plan_from_cams, poses, atol=1e-6
    )
    # Cameras are held at eye height above the floor of the plan frame.
    assert np.all((plan_from_cams[:, 2, 3] > 1.0) & (plan_from_cams[:, 2, 3] < 2.0))


def test_record_tells_what_was_done(finished: Path, small_scan: Path) -> None:
    record = json.loads((finished / "run.json").read_text())
    assert record["frames"] == 60
    assert record["inputs"]["scan"] == str(small_scan.resolve())
    assert record["options"]["matching"]["keypoints"]["max_per_frame"] == 1500
    assert record["verdict"]["outcome"] == "refined"
    assert len(record["verdict"]["predicted_error_m"]) == 60
    terms = {"points", "surfaces", "floor", "odometry", "ceiling", "walls"}
    assert set(record["cost_by_term"]) == terms
    assert record["metrics"]["nsd"]["after"] < record["metrics"]["nsd"]["before"]
    assert record["stop"]


def test_how_far_each_pose_may_be_off_is_written_and_said_alike(
    finished: Path, small_scan: Path
) -> None:
    record = json.loads((finished / "run.json").read_text())
    lines = (finished / "trajectory_sigma.csv").read_text().splitlines()
    assert lines[0] == (
        "frame,timestamp,sigma_x_m,sigma_y_m,sigma_z_m,sigma_rotation_deg,radius_95_m,held_by"
    )
    table = np.array([[float(value) for value in line.split(",")[:-1]] for line in lines[1:]])
    times, found = read_tum(finished / "trajectory.tum")
    assert_allclose(table[:, :2], np.column_stack([np.arange(60), times]))
    predicted_m = np.array(record["verdict"]["predicted_error_m"])
    assert_allclose(np.linalg.norm(table[:, 2:5], axis=1), predicted_m, atol=2e-6)
    with np.load(finished / "covariances.npz") as kept:
        variances = np.einsum("nii->ni", kept["covariances"])
    assert_allclose(np.sqrt(variances[:, 3:]), table[:, 2:5], atol=1e-6)
    assert np.all((table[:, 6] > predicted_m) & (table[:, 6] < 2 * predicted_m))
    worst = int(np.argmax(predicted_m))
    assert record["verdict"]["worst_predicted_frame"] == worst
    said = f"worst {predicted_m[worst]:.2f} m at frame {worst}"
    assert any(said in reason for reason in record["verdict"]["reasons"])
    page = (finished / "report.html").read_text()
    assert f'at frame <span data-frame="{worst}">{worst}</span></strong>' in page
    # As large as the true errors are: the synthetic plan is exact, so rather wide.
    _, true = read_tum(small_scan / "groundtruth.tum")
    true_m = np.linalg.norm(
        (np.array(record["world_from_plan"]) @ found)[:, :3, 3] - true[:, :3, 3], axis=1
    )
    assert np.mean(true_m < table[:, 6]) > 0.9
    assert predicted_m.max() < 0.06


def test_findings_of_the_record_are_as_their_page_has_them(finished: Path) -> None:
    record = json.loads((finished / "run.json").read_text())
    assert record["schema_version"] == SCHEMA_VERSION
    assert len(record["findings"]) == len(record["warnings"])
    verdict = record["verdict"]
    assert [each["words"] for each in verdict["findings"]] == verdict["reasons"]
    reservations = [{**each} for each in verdict["reservations"]]
    for each in reservations:
        assert each.pop("walls") == [part["words"] for part in each["parts"]]
    breaks = [each["finding"] for each in record["tracking"]["breaks"]]
    check_findings([*record["findings"], *verdict["findings"], *reservations, *breaks])


def test_the_record_and_the_report_tell_the_command(finished: Path) -> None:
    made = json.loads((finished / "run.json").read_text())["made"]
    assert made["command"].startswith("planfit refine ")
    assert str(finished) in made["command"]
    assert made["versions"]["planfit"] == planfit.__version__
    page = (finished / "report.html").read_text()
    assert f"<footer>Made {made['at']} by <code>planfit refine " in page


def test_evaluate_prints_the_errors_and_json(finished: Path, small_scan: Path, capsys) -> None:
    truth = str(small_scan / "groundtruth.tum")
    words = ["evaluate", str(finished), "--truth", truth, "--map.frame-step", "2"]
    assert run(words) == 0
    shown = capsys.readouterr().out
    assert "position error (ATE), RMS, not aligned" in shown
    for word in ("before", "after", "difference", "(MME)", "(MPV)", "(MOM)", "(NSD)", "cm²", "°"):
        assert word in shown
    assert run([*words, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["compared"] == report["frames"] == 60
    poses = np.stack([np.loadtxt(p) for p in sorted((finished / "poses").iterdir())])
    true_poses = read_tum(Path(truth))[1]
    ate = report["metrics"]["ate_rms"]
    assert ate["after"] == pytest.approx(position_errors(poses, true_poses).rms_m, abs=1e-6)
    recorded = read_scan(small_scan).world_from_cams
    assert ate["before"] == pytest.approx(position_errors(recorded, true_poses).rms_m, abs=1e-9)
    record = json.loads((finished / "run.json").read_text())["metrics"]
    for name, metric in report["metrics"].items():
        assert metric["after"] < metric["before"], name
        assert metric["difference"] == pytest.approx(metric["after"] - metric["before"])
    for name, metric in record.items():
        assert report["metrics"][name]["unit"] == metric["unit"]
        for when in ("before", "after"):  # trajectory.tum keeps micrometres
            assert report["metrics"][name][when] == pytest.approx(metric[when], rel=1e-4, abs=1e-4)


def test_evaluate_suggests_the_other_frame(finished: Path, small_scan: Path, capsys) -> None:
    truth = str(small_scan / "groundtruth.tum")
    words = ["evaluate", str(finished), "--truth", truth, "--no-depth-maps"]
    assert run([*words, "--truth-frame", "plan"]) == 0
    assert "Try --truth-frame world" in " ".join(capsys.readouterr().out.split())


def evaluated(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    assert run(["evaluate", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_evaluate_tells_that_a_whole_scan_lies_elsewhere(
    finished: Path, small_scan: Path, tmp_path: Path, capsys
) -> None:
    times, true_poses = read_tum(small_scan / "groundtruth.tum")
    true_poses[:, 0, 3] += 0.4
    write_tum(tmp_path / "moved.tum", times, true_poses)
    words = finished, "--no-depth-maps", "--truth"
    report = evaluated(capsys, *words, tmp_path / "moved.tum")
    aligned = report["metrics"]["ate_aligned_rms"]["after"]
    assert aligned < 0.05
    assert [f"its shape is {aligned:.3f} m from the truth" in n for n in report["notes"]] == [True]
    assert not evaluated(capsys, *words, small_scan / "groundtruth.tum")["notes"]


@pytest.mark.slow
def test_evaluate_poses_of_a_scan(finished: Path, small_scan: Path, capsys) -> None:
    truth = small_scan / "groundtruth.tum"
    few = ("--map.frame-step", 4)  # a quarter of the depth maps takes a quarter of the time
    of_run = evaluated(capsys, finished, "--truth", truth, *few)["metrics"]
    poses = finished.parent / "world.tum"
    scan = read_scan(small_scan)
    refined = np.stack([np.loadtxt(p) for p in sorted((finished / "poses").iterdir())])
    write_tum(poses, scan.timestamps, refined)
    words = (small_scan, *few, "--poses")
    in_world = evaluated(capsys, *words, poses, "--truth", truth)["metrics"]
    for name, metric in of_run.items():
        # Placed by the walls alone, without what a run knows of them: a little differently.
        relative = 0.1 if name.startswith(("nsd", "off_plan", "double")) else 1e-3
        assert in_world[name]["after"] == pytest.approx(metric["after"], rel=relative, abs=1e-5), (
            name
        )
    on_plan = evaluated(capsys, *words, finished / "trajectory.tum", "--poses-frame", "plan")
    on_plan = on_plan["metrics"]
    assert on_plan["nsd"]["after"] == pytest.approx(of_run["nsd"]["after"], rel=1e-4)
    assert on_plan["mme"]["before"] == pytest.approx(of_run["mme"]["before"], abs=1e-5)
    assert "ate_rms" not in on_plan


def test_evaluate_reads_a_scan_by_the_flags_of_refine(
    finished: Path, small_scan: Path, capsys
) -> None:
    poses = finished / "trajectory.tum"
    words = (small_scan, "--poses", poses, "--poses-frame", "plan", "--map.frame-step", 10)
    usual = evaluated(capsys, *words)["metrics"]
    others = evaluated(capsys, *words, "--format", "facap", "--no-use-masks")["metrics"]
    # Walls are then found by geometry: other points of them, of the same walls.
    assert others["nsd"]["after"] != usual["nsd"]["after"]
    assert others["nsd"]["after"] == pytest.approx(usual["nsd"]["after"], rel=0.5)
    assert others["mpv"] == usual["mpv"]
    assert run(["evaluate", *map(str, words), "--depth-scale", "0.001"]) == 2
    assert "leave out --depth-scale" in capsys.readouterr().err
    assert run(["evaluate", *map(str, words), "--format", "tum"]) == 2
    assert "expected a scan of the format tum: rgb.txt" in capsys.readouterr().err
    assert run(["evaluate", str(finished), "--depth-scale", "0.001"]) == 2
    assert "is read as the run did, found some; leave them out" in capsys.readouterr().err


@pytest.mark.slow
def test_evaluate_against_a_true_scan(finished: Path, small_scan: Path, capsys) -> None:
    cloud = finished / "cloud_after.ply"
    words = (finished, "--true-cloud", cloud, "--map.frame-step", 4)
    report = evaluated(capsys, *words, "--truth-frame", "plan")
    nnd = report["metrics"]["nnd"]
    assert nnd["after"] < 3.0  # the same points, thinned otherwise
    assert nnd["before"] > 1.5 * nnd["after"]
    assert report["notes"] == []
    wrong = evaluated(capsys, *words)
    assert "--truth-frame" in wrong["notes"][0]


def test_evaluate_without_depth_maps(finished: Path, capsys) -> None:
    metrics = evaluated(capsys, finished, "--no-depth-maps")["metrics"]
    assert "mme" not in metrics
    assert "nsd" in metrics


def test_evaluate_says_what_does_not_belong_together(
    finished: Path, small_scan: Path, tmp_path: Path, capsys
) -> None:
    def refused(*words: object) -> str:
        assert run(["evaluate", *map(str, words)]) == 2
        return capsys.readouterr().err

    copy = tmp_path / "run"
    shutil.copytree(finished, copy)
    record = json.loads((copy / "run.json").read_text())
    moved = {**record, "inputs": {**record["inputs"], "scan": "/nowhere"}}
    (copy / "run.json").write_text(json.dumps(moved))
    assert "/nowhere: expected the scan, found nothing; say where it is with --scan" in refused(
        copy
    )
    assert run(["evaluate", str(copy), "--scan", str(small_scan), "--no-depth-maps"]) == 0
    capsys.readouterr()
    (copy / "run.json").write_text(json.dumps({**record, "frames": 59}))
    assert "expected the 59 frames of the run, found 60" in refused(copy)
    (copy / "run.json").write_text(json.dumps({**record, "plan_faces": 3}))
    assert "expected the 3 wall faces that the run read" in refused(copy)
    del record["plan_from_world_before"]
    (copy / "run.json").write_text(json.dumps(record))
    assert "a damaged or an older one; run 'planfit refine' again" in refused(copy)
    assert "expected the record of a run, found nothing" in refused(small_scan)
    poses = finished / "trajectory.tum"
    some = tmp_path / "some.tum"
    some.write_text("\n".join(poses.read_text().splitlines()[:40]) + "\n")
    assert "expected a pose for each of 60 frames, found 40" in refused(small_scan, "--poses", some)
    words = (small_scan, "--poses", poses, "--poses-frame", "plan", "--truth", poses)
    assert "--truth-frame: expected plan" in refused(*words)


@pytest.mark.slow
def test_the_same_run_again_reuses_its_stages(finished: Path, small_scan: Path) -> None:
    before = {p: p.stat().st_mtime_ns for p in (finished / "cache").rglob("*.chunk")}
    poses = (finished / "trajectory.tum").read_bytes()
    assert run(["refine", str(small_scan), "-o", str(finished)]) == 0
    after = {p: p.stat().st_mtime_ns for p in (finished / "cache").rglob("*.chunk")}
    assert after == before
    assert (finished / "trajectory.tum").read_bytes() == poses


@pytest.mark.slow
def test_hidden_masks_give_way_to_geometry(
    small_scan: Path, tmp_path: Path, brief: list[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["refine", str(small_scan), "-o", str(out), "--segmentation.back-end", "geometry"]
    assert run([*arguments, *brief]) == 0
    record = json.loads((out / "run.json").read_text())
    assert record["labels_from"] == "geometry"
    _, truth = read_tum(small_scan / "groundtruth.tum")
    after = np.stack([np.loadtxt(p) for p in sorted((out / "poses").iterdir())])
    assert position_errors(after, truth).rms_m < 0.05


@pytest.mark.slow
def test_options_from_toml_and_flags_are_the_same_options(
    small_scan: Path, tmp_path: Path, brief: list[str], capsys
) -> None:
    config = tmp_path / "options.toml"
    config.write_text("[matching.pairs]\nneighbours = 2\n[adjust.walls]\nweight = 0.7\n")
    out = tmp_path / "out"
    words = ["refine", str(small_scan), "-o", str(out), "--config", str(config)]
    assert run([*words, "--matching.pairs.neighbours", "3", *brief]) == 0
    options = json.loads((out / "run.json").read_text())["options"]
    assert options["matching"]["pairs"]["neighbours"] == 3
    assert options["adjust"]["walls"]["weight"] == 0.7
    config.write_text("[adjust.wall]\nweight = 0.7\n")
    assert run([*words[:-2], "--config", str(config)]) == 2
    assert "unknown option 'wall'" in capsys.readouterr().err


def test_help_and_version_and_unknown_commands(capsys) -> None:
    from planfit import __version__

    assert run(["--help"]) == 0
    assert "refine SCAN [SCAN ...] [PLAN | --no-plan] -o OUT" in capsys.readouterr().out
    assert run(["--version"]) == 0
    assert __version__ in capsys.readouterr().out
    assert run(["refyne"]) == 2
    assert "refyne: expected a command of planfit" in capsys.readouterr().err


def test_installed_command_runs() -> None:
    command = Path(sys.executable).with_name("planfit")
    done = subprocess.run([command, "refine", "/nowhere", "-o", "/nowhere/out"],
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("planfit: /nowhere: expected the folder of a scan")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_preset_and_offsets_reach_the_run(
    small_scan: Path, tmp_path: Path, brief: list[str]
) -> None:
    out = tmp_path / "out"
    words = ["refine", str(small_scan), "-o", str(out), *brief, "--preset", "paper"]
    words += ["--adjust.walls.weight", "0.7", "--align.method", "search"]
    assert run(words) in (0, 1)
    record = json.loads((out / "run.json").read_text())
    adjust = record["options"]["adjust"]
    assert adjust["cost"] == "paper"
    assert adjust["odometry"]["weight"] == 0
    assert adjust["walls"]["weight"] == 0.7  # flags come after the preset
    assert set(record["cost_by_term"]) == {"points", "floor", "walls"}
    words = ["refine", str(small_scan), "-o", str(out), *brief, "--overwrite"]
    assert run([*words, "--adjust.wall-offset-sigma-m", "0.03"]) == 0
    offsets = json.loads((out / "run.json").read_text())["walls"]["offsets"]
    assert offsets
    assert all(0 < row["sigma_m"] < 0.03 for row in offsets)


def test_an_unknown_preset_is_refused(
    small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["refine", str(small_scan), "-o", str(tmp_path / "out"), "--preset", "best"]
    assert run(words) == 2
    assert "preset: expected default or paper, found 'best'" in capsys.readouterr().err
