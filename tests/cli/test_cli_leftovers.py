"""What commands leave on the disk: what was asked for, and nothing where they refuse."""

from pathlib import Path

import pytest

from planfit.cli import run


def contents(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def test_a_cache_elsewhere_leaves_none_in_the_folder_of_results(
    small_scan: Path, tmp_path: Path, brief: list[str]
) -> None:
    plan, out = str(small_scan / "floorplan.npy"), tmp_path / "out"
    assert run(["align", str(small_scan), plan, "-o", str(out), *brief[:2]]) == 0
    left = {name for name in contents(out) if not name.startswith("candidate_")}
    assert left == {"alignment.json", ".planfit.json", ".planfit.lock"}


@pytest.mark.parametrize(
    "words",
    [
        "plan SCAN/floorplan.npy -o OUT/deep/plan.xyz",
        "plan nothing.npy -o OUT/deep/plan.png",
        "inspect nothing -o OUT/deep/scan.png",
        "align SCAN nothing -o OUT/deep",
        "align nothing SCAN/floorplan.npy -o OUT/deep",
        "align SCAN SCAN/floorplan.npy -o OUT/deep --pin 1,2=3",
        "align SCAN SCAN/floorplan.npy -o OUT/deep --candidate 99 --cache CACHE",
        "refine SCAN -o OUT/deep --plan nothing",
        "refine SCAN -o OUT/deep --candidate 99 --cache CACHE",
        "refine SCAN -o OUT/deep --config nothing.toml",
        "refine nothing nothing2 --plan SCAN/floorplan.npy -o OUT/deep",
        "calibrate SCAN -o OUT/deep/c.json --plan nothing",
        "calibrate nothing -o OUT/deep/c.json",
        "evaluate nothing",
        "compare SCAN -o OUT/deep",
        "compare nothing --poses nothing -o OUT/deep",
        "export SCAN --to cloud -o OUT/deep/cloud.las",
        "export SCAN --to open3d -o OUT/deep/poses.txt",
        "export SCAN --to mesh -o OUT/deep/mesh.xyz",
        "export SCAN --to as-built -o OUT/deep/walls.csv",
        "export SCAN --to pdf -o OUT/deep/report.pdf",
        "export SCAN --to tum --frame plan -o OUT/deep/poses.txt",
        "export SCAN --to colmap --frame plan -o OUT/deep/model",
        "batch nothing.csv -o OUT/deep",
        "view nothing",
        "demo -o SCAN",
        "synth OUT/deep --plan nothing",
        "synth OUT/deep --building.n-rooms 0",
    ],
)
def test_refusals_leave_nothing(
    words: str, small_scan: Path, tmp_path: Path, brief: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"SCAN": str(small_scan), "OUT": str(tmp_path / "out"), "CACHE": brief[1]}
    before = contents(small_scan)
    for word, place in places.items():
        words = words.replace(word, place)
    assert run(words.split()) == 2
    assert contents(tmp_path) == set()
    assert contents(small_scan) == before


def test_an_empty_folder_of_the_user_stays(
    small_scan: Path, tmp_path: Path, brief: list[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    plan = str(small_scan / "floorplan.npy")
    words = ["align", str(small_scan), plan, "-o", str(out), "--candidate", "99", *brief[:2]]
    assert run(words) == 2
    assert contents(tmp_path) == {"out"}


def test_what_was_finished_stays_where_the_same_command_goes_on(
    small_scan: Path, tmp_path: Path
) -> None:
    out, plan = tmp_path / "out", str(small_scan / "floorplan.npy")
    assert run(["align", str(small_scan), plan, "-o", str(out), "--candidate", "99"]) == 2
    assert {".planfit.json", "cache"} < contents(out)
    assert run(["align", str(small_scan), plan, "-o", str(out)]) == 0


def test_a_comparison_of_nothing_leaves_nothing(
    small_scan: Path, tmp_path: Path, fitted: Path
) -> None:
    out = tmp_path / "out"
    before = contents(fitted)
    assert "cache" not in before
    for words in (["--poses", "nothing"], [str(small_scan)]):
        assert run(["compare", str(fitted), *words, "-o", str(out)]) == 2
        assert not out.exists()
    assert run(["export", str(fitted), "--to", "cloud", "-o", str(out / "cloud.las")]) == 2
    assert contents(tmp_path) == set()
    assert contents(fitted) == before
