"""`planfit align`: what it writes, what it says, and its exit codes."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from finding_records import check_findings
from planfit.cli import run
from planfit.cli.run_record import cache_of
from planfit.findings import SCHEMA_VERSION


@pytest.fixture(scope="module")
def aligned(small_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("align") / "out"
    assert run(["align", str(small_scan), str(small_scan / "floorplan.npy"), "-o", str(out)]) == 0
    return out


def test_the_alignment_is_written_with_a_picture_of_each_candidate(aligned: Path) -> None:
    record = json.loads((aligned / "alignment.json").read_text())
    assert record["is_sure"]
    assert record["is_as_recorded"]
    assert record["metres_per_unit"] == 1.0
    transform = np.array(record["plan_from_level"])
    assert transform.shape == (4, 4)
    np.testing.assert_allclose(transform[:3, :3] @ transform[:3, :3].T, np.eye(3), atol=1e-9)
    assert len(record["candidates"]) >= 1
    for i in range(len(record["candidates"])):
        with Image.open(aligned / f"candidate_{i + 1}.png") as picture:
            assert picture.width > 400
            assert picture.height > 200


def test_its_findings_are_as_their_page_has_them(aligned: Path) -> None:
    record = json.loads((aligned / "alignment.json").read_text())
    assert record["schema_version"] == SCHEMA_VERSION
    assert len(record["findings"]) == len(record["warnings"])
    check_findings(record["findings"])


def test_what_it_says(aligned: Path, small_scan: Path, capsys) -> None:
    plan = str(small_scan / "floorplan.npy")
    assert run(["align", str(small_scan), plan, "-o", str(aligned)]) == 0
    said = capsys.readouterr().out
    assert "1 (taken)" in said
    assert "margin over the next hypothesis" in said
    assert "aligned: look at" in said


def test_another_candidate_or_a_bad_control_point_is_one_line(
    aligned: Path, small_scan: Path, capsys
) -> None:
    plan = str(small_scan / "floorplan.npy")
    arguments = ["align", str(small_scan), plan, "-o", str(aligned)]
    assert run([*arguments, "--candidate", "99"]) == 2
    assert "align.candidate: expected 1 to" in capsys.readouterr().err
    assert run([*arguments, "--pin", "1,2=3"]) == 2
    (line,) = capsys.readouterr().err.splitlines()[-1:]
    assert "align.control-points: expected x,y,z=u,v" in line


def test_a_folder_with_other_files_is_left_alone(small_scan: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    plan = str(small_scan / "floorplan.npy")
    assert run(["align", str(small_scan), plan, "-o", str(tmp_path)]) == 2
    assert "found other files" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.slow
def test_mirror_undoes_a_mirrored_plan(aligned: Path, small_scan: Path, tmp_path: Path) -> None:
    drawn = tmp_path / "plan.npy"
    np.save(drawn, np.load(small_scan / "floorplan.npy") * [-1, 1, -1, 1])
    out = tmp_path / "out"
    assert run(["align", str(small_scan), str(drawn), "-o", str(out), "--mirror"]) == 0
    record, true = (json.loads((f / "alignment.json").read_text()) for f in (out, aligned))
    np.testing.assert_allclose(record["plan_from_level"], true["plan_from_level"], atol=0.02)
    # Poses are in the axes of the plan as it was recorded, not of the swapped one.
    assert not record["is_as_recorded"]
    assert not record["warnings"]


def chunks(cache: Path) -> dict[str, int]:
    """Files of a cache, and when each was written."""
    return {
        str(path.relative_to(cache)): path.stat().st_mtime_ns for path in cache.rglob("*.chunk")
    }


def test_files_of_a_cache_that_were_exchanged_are_made_again(
    aligned: Path, small_scan: Path, tmp_path: Path, capsys
) -> None:
    """Within each stage, and the first ones between stages: whole files, each in the place of another."""
    out, words = tmp_path / "out", [str(small_scan), str(small_scan / "floorplan.npy"), "-o"]
    shutil.copytree(aligned, out)
    first = sorted((out / "cache").glob("*/000000.chunk"))
    whole = {path: path.read_bytes() for path in sorted((out / "cache").rglob("*.chunk"))}
    for path, other in zip(first, [*first[1:], first[0]], strict=True):
        path.write_bytes(whole[other])
        beside = [each for each in whole if each.parent == path.parent][1:]
        for each, next_to in zip(beside, [*beside[1:], path], strict=False):
            each.write_bytes(whole[next_to])
    assert run(["align", *words, str(out)]) == 0
    said = capsys.readouterr().err
    assert said.count("damaged or exchanged; these are redone") == len(first)
    assert {path: path.read_bytes() for path in whole} == whole
    for name in ("alignment.json", "candidate_1.png"):
        assert (out / name).read_bytes() == (aligned / name).read_bytes()
    assert run(["align", *words, str(out)]) == 0
    assert "redone" not in capsys.readouterr().err


@pytest.mark.slow
def test_refine_goes_on_where_align_ended(small_scan: Path, tmp_path: Path, capsys) -> None:
    out, plan = tmp_path / "out", small_scan / "floorplan.npy"
    words = [str(small_scan), "-o", str(out)]
    assert run(["align", words[0], str(plan), *words[1:]]) == 0
    before = chunks(out / "cache")
    assert any(name.startswith("pairs-") for name in before), before
    assert run(["refine", *words, "--report.no-has-view"]) in (0, 1)
    after = chunks(out / "cache")
    assert {name: after[name] for name in before} == before, "computed again"
    assert {"alignment.json", "candidate_1.png", "report.html"} <= {p.name for p in out.iterdir()}
    # And back again, beside the run; a run with another plan takes the alignment away.
    assert run(["align", words[0], str(plan), *words[1:]]) == 0
    assert (out / "report.html").exists()
    other = tmp_path / "other.npy"
    other.write_bytes(plan.read_bytes())
    capsys.readouterr()
    assert run(["align", words[0], str(other), *words[1:]]) == 2
    assert "found the results of another run" in capsys.readouterr().err


@pytest.mark.slow
def test_a_cache_is_shared_between_runs(small_scan: Path, tmp_path: Path) -> None:
    cache, plan = tmp_path / "cache", str(small_scan / "floorplan.npy")
    shared = ["--cache", str(cache)]
    assert run(["align", str(small_scan), plan, "-o", str(tmp_path / "a"), *shared]) == 0
    before = chunks(cache)
    assert before
    assert run(["align", str(small_scan), plan, "-o", str(tmp_path / "b"), *shared]) == 0
    assert chunks(cache) == before
    assert not chunks(tmp_path / "a")


def test_evaluate_finds_the_cache_that_a_run_shared(tmp_path: Path) -> None:
    assert cache_of(tmp_path) is None
    (tmp_path / "run.json").write_text("{}")
    assert cache_of(tmp_path) == tmp_path / "cache"
    (tmp_path / "run.json").write_text('{"cache": "/shared"}')
    assert cache_of(tmp_path) == Path("/shared")
