"""Known points on the command line, in the axes that the pictures show."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from planfit.cli import run
from planfit.floorplan import read_floorplan
from planfit.report.plots.drawing import Words
from planfit.report.plots.plan_picture import plan_axes


def true_points(scan: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Recorded places (world, y up, m) of the first and a later camera, and the same points on the plan: the
    axes of the layout are those of the plan, u = x and v = z, and the plan frame has (u, -v)."""
    poses = [np.loadtxt(path) for path in sorted((scan / "arcore").glob("pose-*.txt"))]
    return [(p[:3, 3], np.array([p[0, 3], -p[2, 3]])) for p in (poses[0], poses[len(poses) // 3])]


def words(world: np.ndarray, plan: np.ndarray, prefix: str = "") -> str:
    return ",".join(f"{v:.4f}" for v in world) + "=" + prefix + ",".join(f"{v:.4f}" for v in plan)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["plan", "file", "together"])
def test_points_in_the_axes_of_the_plan_are_taken(
    small_scan: Path, tmp_path: Path, form: str
) -> None:
    points = true_points(small_scan)
    if form == "file":
        pins = [words(world, plan * (1, -1), "file:") for world, plan in points]
    else:
        pins = [words(world, plan) for world, plan in points]
    flags = [f"--pin={pin}" for pin in pins] if form != "together" else ["--pin", *pins]
    plan = str(small_scan / "floorplan.npy")
    out = tmp_path / "out"
    assert run(["align", str(small_scan), plan, "-o", str(out), *flags]) == 0
    record = json.loads((out / "alignment.json").read_text())
    assert record["is_as_recorded"]
    assert record["metres_per_unit"] == 1.0


def test_refine_takes_points_and_a_candidate(
    small_scan: Path, tmp_path: Path, brief: list[str], capsys
) -> None:
    (world, plan), _ = true_points(small_scan)
    out = tmp_path / "out"
    far = words(world, plan + 500.0)
    words_of_run = ["refine", str(small_scan), "-o", str(out), *brief]
    assert run([*words_of_run, "--pin", far]) == 2
    assert "expected points on the plan, which spans" in capsys.readouterr().err
    assert run([*words_of_run, "--candidate", "99"]) == 2
    assert "align.candidate: expected 1 to" in capsys.readouterr().err
    assert run([*words_of_run, "--no-plan", "--candidate", "2"]) == 2
    assert "--no-plan: expected no flags of a plan" in capsys.readouterr().err


def test_numbers_at_the_rim_are_those_of_the_plan(tmp_path: Path) -> None:
    """In a drawing y is up, in a picture v is down."""
    room = np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]], dtype=float)
    np.save(tmp_path / "plan.npy", room)
    axes = plan_axes(read_floorplan(tmp_path / "plan.npy"), tmp_path / "plan.npy")
    # The layout's v is down: the room is below 0.
    (left, top), (right, bottom) = axes.at(np.array([[0.0, 0.0], [6.0, -4.0]]))
    assert right - left == pytest.approx(1.5 * (bottom - top))
    numbers = [words for words in axes.drawing.items if isinstance(words, Words)]
    below = {words.text: words.at[0] for words in numbers if words.anchor == "middle"}
    beside = {words.text: words.at[1] for words in numbers if words.anchor == "end"}
    assert (below["0.0"], below["6.0"]) == pytest.approx((left, right))
    assert beside["\u22124.0"] - beside["0.0"] == pytest.approx(bottom - top)
    assert bottom > top


def test_the_picture_of_a_plan_shows_pixels_of_a_picture(tmp_path: Path) -> None:
    image = np.full((400, 700, 3), 255, np.uint8)
    image[50:350, 50:650] = 0
    image[70:330, 70:630] = 255
    cv2.imwrite(str(tmp_path / "room.png"), image)
    plan = read_floorplan(tmp_path / "room.png")
    assert plan.source.is_picture
    corner = plan.source.rim_from_plan @ [*plan.ends.reshape(-1, 2).min(axis=0), 1.0]
    np.testing.assert_allclose(corner[:2], [49.5, 349.5], atol=1.0)
