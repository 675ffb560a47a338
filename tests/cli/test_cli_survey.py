"""Control and check points on the command line: files in, files out, mistakes in one line each."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from planfit.cli import run
from planfit.cli.arguments import SurveyFlags
from planfit.cli.view import ViewArguments, open_session
from planfit.errors import OptionError
from planfit.scan import read_scan, read_tum

FRAMES = (3, 14, 26, 37, 48, 57)


@pytest.fixture(scope="module")
def tables(small_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Marks of the nearest surface ahead in some frames, and where the truth has these: control points of
    every other frame, check points of the rest."""
    folder = tmp_path_factory.mktemp("survey")
    scan = read_scan(small_scan)
    _, true = read_tum(small_scan / "groundtruth.tum")
    rows, marks = {"control": [], "check": []}, []
    for k, frame in enumerate(FRAMES):
        u, v = flat_pixel(scan.files.depth(frame))
        depth = float(np.median(scan.files.depth(frame)[v - 3 : v + 4, u - 3 : u + 4]))
        cam = scan.cameras[frame].lift(np.array([[u, v]], float), np.array([depth]))[0]
        plan = scan.plan_from_world_axes @ true[frame] @ np.append(cam, 1.0)
        rows["check" if k % 2 else "control"].append([f"P{k}", *plan[:3]])
        marks.append([frame, u, v, f"P{k}"])
    for name, points in rows.items():
        write(folder / f"{name}.csv", ["id", "x", "y", "z"], points)
    write(folder / "marks.csv", ["frame", "u", "v", "id"], marks)
    return folder


def flat_pixel(depth):
    """Where the depth about a pixel differs least."""
    best, at = np.inf, (0, 0)
    for v in range(20, depth.shape[0] - 20, 12):
        for u in range(20, depth.shape[1] - 20, 12):
            window = depth[v - 6 : v + 7, u - 6 : u + 7]
            if np.isfinite(window).all() and np.ptp(window) < best:
                best, at = float(np.ptp(window)), (u, v)
    return at


def write(path: Path, header, rows) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)


@pytest.mark.slow
def test_residuals_of_both_are_written(small_scan: Path, tables: Path, tmp_path: Path, capsys):
    out = tmp_path / "out"
    given = [f"--{name}-points={tables / name}.csv" for name in ("control", "check")]
    words = ["refine", str(small_scan), "-o", str(out), *given, f"--marks={tables / 'marks.csv'}"]
    run([*words, "--report.no-has-view"])
    said = " ".join(capsys.readouterr().out.split())
    assert "3 control points: residual 0.0" in said
    assert "3 check points: residual 0.0" in said
    with (out / "control_points.csv").open() as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    assert [rows[f"P{k}"]["role"] for k in range(6)] == ["control", "check"] * 3
    record = json.loads((out / "run.json").read_text())
    for role in ("control", "check"):
        lengths = [float(r["length_m"]) for r in rows.values() if r["role"] == role]
        assert record["survey"][role]["rms_m"] == pytest.approx(
            np.sqrt(np.mean(np.square(lengths))), abs=1e-5
        )
        assert record["survey"][role]["rms_m"] < 0.05
    assert record["inputs"]["control_points"] == str((tables / "control.csv").resolve())
    assert record["registration"]["checked_95_m"] == pytest.approx(
        np.sqrt(chi2.ppf(0.95, 3) / 3) * record["survey"]["check"]["rms_m"]
    )
    assert "check points, RMS" in (out / "registration.csv").read_text()
    page = (out / "report.html").read_text()
    assert ">Control and check points</h2>" in page
    assert ">Registration</h2>" in page


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--control-points", "CONTROL"], "expected to be told where the points are seen, found neither"),
        (["--marks", "MARKS"], "expected points beside them, found none"),
        (["--control-points", "nowhere.csv", "--marks", "MARKS"], "nowhere.csv: expected a table id,x,y,z"),
        (["--control-points", "CONTROL", "--marks", "MARKS"], "found 'P1' in frame 14, which is none of P0"),
        (["--control-points", "CONTROL", "--check-points", "CONTROL", "--marks", "MARKS"], "'P0' twice"),
        (["--control-points", "CONTROL", "--tags", "qr"], "--tags: expected one of apriltag-16h5"),
        (
            ["--control-points", "CONTROL", "--tags", "aruco-4x4-50", "--tag-size-m", "0"],
            "--tag-size-m: expected a length above 0",
        ),
        (
            ["--control-points", "CONTROL", "--check-points", "CHECK", "--marks", "MARKS",
             "--survey-axes", "map"],
            "expected a plan with a map conversion (IFC) or a world file",
        ),
        (
            ["--no-plan", "--control-points", "CONTROL", "--check-points", "CHECK", "--marks", "MARKS",
             "--survey-axes", "plan"],
            "without a plan points are in axes of their own",
        ),
    ],
)  # fmt: skip
def test_mistakes_are_one_line_before_anything_is_computed(
    small_scan: Path, tables: Path, tmp_path: Path, capsys, flags, words
):
    named = {name.upper(): str(tables / f"{name}.csv") for name in ("control", "check", "marks")}
    flags = [named.get(flag, flag) for flag in flags]
    assert run(["refine", str(small_scan), "-o", str(tmp_path / "out"), *flags]) == 2
    told = capsys.readouterr().err
    assert words in " ".join(told.split())
    assert "Traceback" not in told


def test_solved_again_at_the_screen_points_still_hold(
    small_scan: Path, tables: Path, tmp_path: Path, brief: list[str]
) -> None:
    out, own = tmp_path / "out", tmp_path / "control.csv"
    own.write_text((tables / "control.csv").read_text())
    given = [f"--control-points={own}", f"--check-points={tables / 'check.csv'}"]
    run(
        [
            "refine",
            str(small_scan),
            "-o",
            str(out),
            *given,
            f"--marks={tables / 'marks.csv'}",
            *brief,
        ]
    )
    before = json.loads((out / "run.json").read_text())
    session = open_session(ViewArguments(out, workers=1))
    session.add("exclude_frames", {"frames": [[30, 31]]})
    session.start_solve()
    session.wait()
    state, after = session.state(), json.loads((out / "run.json").read_text())
    assert state["failed"] == ""
    assert after["keyframes"] == before["keyframes"] - 2
    assert after["inputs"] == before["inputs"]
    assert after["report_options"]["has_view"] is False
    for role in ("control", "check"):
        assert after["survey"][role]["count"] == before["survey"][role]["count"]
    with (out / "control_points.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(FRAMES)

    # Other points, or none, are not what the run was made with: it says so, and nothing is written.
    own.write_text("id,x,y,z\nP0,0,0,0\n")
    session.start_solve()
    session.wait()
    assert (
        f"{own}: expected the control points of the run, found others" in session.state()["failed"]
    )
    own.unlink()
    session.start_solve()
    session.wait()
    assert "expected the control points of the run, found nothing" in session.state()["failed"]
    assert json.loads((out / "run.json").read_text()) == after


def test_flags_of_a_record_are_those_given(tables: Path) -> None:
    flags = SurveyFlags(
        control_points=(tables / "control.csv").resolve(),
        marks=(tables / "marks.csv").resolve(),
        survey_axes="file",
        tags="apriltag-36h11",
        tag_size_m=0.16,
    )
    assert SurveyFlags.of_record(flags.inputs) == flags
    assert SurveyFlags.of_record({"scan": "x"}) == SurveyFlags()
    with pytest.raises(OptionError, match="expected the marks of the run, found others"):
        SurveyFlags.of_record({**flags.inputs, "marks_fingerprint": "0"})
