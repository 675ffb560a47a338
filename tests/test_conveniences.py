"""What those who type want: short reprs, saving and plotting, options by name, wrong kinds refused."""

import dataclasses
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import planfit
from builders import make_world, room_plan
from planfit.alignment import AlignOptions
from planfit.cli import run
from planfit.errors import OptionError
from planfit.export.tables import to_toml
from planfit.lsq import LossKind
from planfit.pipeline.options import PRESETS
from planfit.runtime import short_repr
from planfit.runtime.option_values import option_names, require_kinds
from planfit.synth import CameraOptions, SynthOptions, WalkOptions, make_scan, write_facap

MAX_LINES, MAX_WIDTH = 40, 160


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("conveniences") / "scan"
    write_facap(
        path,
        make_scan(
            SynthOptions(seed=2, walk=WalkOptions(n_frames=16), camera=CameraOptions(160, 120))
        ),
    )
    return path


OPTIONS = planfit.RefineOptions(seed=1)
"""Not the defaults, so that the record of the options is tested too."""


@pytest.fixture(scope="module")
def result(folder: Path) -> planfit.RefineResult:
    scan = planfit.read_scan(folder)
    return planfit.refine(scan, planfit.read_floorplan(folder / "floorplan.npy"), OPTIONS)


def reachable(value: object, depth: int = 4) -> dict[type, object]:
    """Dataclasses that a value holds, by their type."""
    found: dict[type, object] = {}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        found[type(value)] = value
        if depth:
            for field in dataclasses.fields(value):
                found |= reachable(getattr(value, field.name), depth - 1)
    return found


def test_everything_in_a_result_prints_in_readable_lines(result: planfit.RefineResult) -> None:
    everything = reachable(result)
    assert {planfit.Scan, planfit.Floorplan, planfit.Matches, planfit.RefineResult} <= set(
        everything
    )
    for kind, value in everything.items():
        if kind.__name__.endswith("Options"):
            continue  # these can be pasted, and name what a cache was computed with
        lines = repr(value).splitlines()
        assert len(lines) <= MAX_LINES, kind
        assert max(map(len, lines)) <= MAX_WIDTH, (kind, lines)
        assert "array(" not in repr(value), kind


def test_repr_tells_shapes_and_what_is_short(rng: np.random.Generator) -> None:
    assert re.match(r"Floorplan of \d+\(", repr(room_plan()))
    assert "ends=float64[" in repr(room_plan())
    world = make_world(rng)
    assert "float64[" in repr(world.structure.walls)

    @dataclasses.dataclass(frozen=True)
    class Small:
        n: int
        share: float
        xy: np.ndarray
        kind: LossKind

        __repr__ = short_repr

    small = Small(3, 1 / 3, np.array([1.0, 2.0]), LossKind.HUBER)
    assert repr(small) == "Small(n=3, share=0.333333, xy=[1., 2.], kind=huber)"


@pytest.mark.slow
def test_save_writes_what_the_command_line_writes(
    result: planfit.RefineResult, folder: Path, tmp_path: Path
) -> None:
    result.save(tmp_path / "saved")
    assert run(
        ["refine", str(folder), "-o", str(tmp_path / "run"), "--config", config(tmp_path)]
    ) in (0, 1)
    saved, written = (
        {
            p.relative_to(tmp_path / name).as_posix(): p.read_bytes()
            for p in (tmp_path / name).rglob("*")
            if p.is_file() and "cache" not in p.parts and not p.name.startswith(".planfit")
        }
        for name in ("saved", "run")
    )
    assert set(saved) == set(written)
    records = [json.loads(files.pop("run.json")) for files in (saved, written)]
    for record in records:
        del record["seconds_by_stage"], record["made"]["at"], record["made"]["command"]
    assert records[0] == records[1]
    saved.pop("report.html"), written.pop("report.html")  # tells the seconds of the stages
    for name in saved:
        assert saved[name] == written[name] or name.endswith(".npz"), name


def config(tmp_path: Path) -> str:
    (tmp_path / "options.toml").write_text(to_toml(OPTIONS))
    return str(tmp_path / "options.toml")


def test_save_leaves_other_files_alone(result: planfit.RefineResult, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(planfit.errors.OutputError, match="found other files"):
        result.save(tmp_path)
    with pytest.raises(OptionError, match=r"expected a result of planfit\.refine"):
        dataclasses.replace(result, made_of=None).save(tmp_path / "new")


def test_notebooks_show_a_small_table_without_markup_of_names(
    result: planfit.RefineResult,
) -> None:
    assert result.made_of is not None
    scan = dataclasses.replace(result.made_of.scan, name="<script>alert(1)</script>")
    for shown, facts in (
        (scan, ["Scan of", "frame_ids", "&lt;script&gt;"]),
        (result.floorplan, ["Floorplan of", "ends"]),
        (result, [result.verdict.headline, "before", result.checks[0].name]),
    ):
        html = shown._repr_html_()
        assert len(html) < 8000
        assert "<script" not in html
        assert all(fact in html for fact in facts)


@pytest.mark.parametrize("form", ["tum", "kitti", "open3d", "g2o"])
def test_poses_are_saved_as_export_writes_them(
    form: str, result: planfit.RefineResult, tmp_path: Path
) -> None:
    result.save(tmp_path / "run")
    suffix = "log" if form == "open3d" else form
    for frame in ("world", "plan"):
        ours, theirs = (tmp_path / f"{who}_{frame}.{suffix}" for who in ("ours", "theirs"))
        words = ["export", str(tmp_path / "run"), "--to", form, "--frame", frame]
        assert run([*words, "-o", str(theirs)]) == 0
        assert planfit.save_poses(result, ours, form, frame) == ours
        told, expected = (path.read_text().split() for path in (ours, theirs))
        assert len(told) == len(expected)
        # Poses of a run are those of its files, which keep nine digits.
        apart = [(a, b) for a, b in zip(told, expected, strict=True) if a != b]
        assert all(abs(float(a) - float(b)) < 1e-4 * max(1.0, abs(float(b))) for a, b in apart)


def test_poses_are_not_saved_over_files_or_in_unknown_forms(
    result: planfit.RefineResult, tmp_path: Path
) -> None:
    (tmp_path / "poses.tum").touch()
    with pytest.raises(planfit.errors.OutputError, match="expected no such file"):
        planfit.save_poses(result, tmp_path / "poses.tum")
    with pytest.raises(OptionError, match="did you mean 'kitti'"):
        planfit.save_poses(result, tmp_path / "new", "kity")
    with pytest.raises(OptionError, match=r"expected a result of planfit\.refine"):
        planfit.save_poses(dataclasses.replace(result, made_of=None), tmp_path / "new")


def test_plot_is_a_picture(result: planfit.RefineResult) -> None:
    picture = result.plot()
    assert picture.width > 500
    assert len(picture.getcolors(1 << 24) or []) > 20


def test_options_by_name() -> None:
    options = planfit.RefineOptions()
    assert options.with_("adjust.walls.weight", 2).adjust.walls.weight == 2
    assert options.adjust.walls.weight == planfit.RefineOptions().adjust.walls.weight
    assert options.with_("odometry.sigma-base-m", 0.03).odometry.sigma_base_m == 0.03
    assert options.with_("align.control_points", ["1,2,3=4,5"]).align.control_points == (
        "1,2,3=4,5",
    )
    assert options.with_("align", AlignOptions(candidate=2)).align.candidate == 2
    assert planfit.ScanOptions().with_("depth_scale", 0.001).depth_scale == 0.001


@pytest.mark.parametrize("name", option_names(planfit.RefineOptions()))
def test_every_option_takes_its_own_value_by_name(name: str) -> None:
    options = planfit.RefineOptions()
    value: object = options
    for step in name.split("."):
        value = getattr(value, step)
    assert options.with_(name, value) == options


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_of_the_right_kinds(preset: str) -> None:
    require_kinds(PRESETS[preset]())


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("adjust.wals.weight", 2, "did you mean 'adjust.walls.weight'?"),
        ("walls.weight", 2, "did you mean 'adjust.walls.weight'?"),
        ("zzzz", 2, "'planfit help options' lists them all"),
        ("adjust.walls.weight", "2", "TermOptions.weight: expected a number, found '2'"),
        ("adjust.walls.weight", True, "expected a number, found True"),
        ("adjust.cost", "papers", "found 'papers'"),
        ("adjust.walls.weight.x", 1, "found an unknown one"),
        ("seed", 1.5, "RefineOptions.seed: expected a whole number, found 1.5"),
        ("adjust", {"walls": {}}, 'options.with_("adjust.NAME", value)'),
    ],
)
def test_wrong_names_and_kinds_are_refused(name: str, value: object, said: str) -> None:
    with pytest.raises(OptionError) as told:
        planfit.RefineOptions().with_(name, value)
    assert said in str(told.value)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: planfit.RefineOptions(adjust={"walls": {}}),
            "RefineOptions.adjust: expected AdjustOptions",
        ),
        (lambda: planfit.ScanOptions(poses="x"), "write Path('x')"),
        (lambda: planfit.PlanOptions(unit="furlong"), "PlanOptions.unit: expected 'auto' or"),
        (lambda: planfit.EvaluateOptions(delta_m="1"), "EvaluateOptions.delta_m: expected"),
        (lambda: planfit.RefineOptions(seed=np.array([1, 2])), "RefineOptions.seed"),
    ],
)
def test_wrong_kinds_are_refused_where_they_are_given(make, said: str) -> None:
    with pytest.raises(OptionError) as told:
        make()
    assert said in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            "Runtime(cache_dir='x')",
            "Runtime.cache_dir: expected Path or None, found 'x'; write Path('x')",
        ),
        ("Runtime(workers='2')", "Runtime.workers: expected a whole number, found '2'"),
    ],
)
def test_a_runtime_of_wrong_kinds_is_refused(call: str, said: str) -> None:
    # In a process of its own: here the tests' own checks of types come first.
    code = f"import planfit\ntry:\n    planfit.{call}\nexcept planfit.errors.OptionError as e:\n    print(e)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == said


def test_what_is_no_scan_plan_or_options_is_refused_where_it_is_given() -> None:
    # In a process of its own: here the tests' own checks of types come first.
    code = """
import numpy as np, planfit
camera = planfit.scan_from_arrays.__globals__["Camera"](32, 24, 30.0, 30.0, 15.5, 11.5)
scan = planfit.scan_from_arrays(None, np.ones((2, 24, 32)), camera, np.tile(np.eye(4), (2, 1, 1)))
plan = planfit.Floorplan.from_segments(np.array([[[0.0, 0.0], [4.0, 0.0]]]))
for call in (
    lambda: planfit.refine("my_scan", plan),
    lambda: planfit.refine(scan, "plan.png"),
    lambda: planfit.refine(scan, {0: "plan.png"}),
    lambda: planfit.align(scan, plan, {"adjust": 1}),
    lambda: planfit.refine(scan, None, runtime=2),
    lambda: planfit.refine_together([scan, np.zeros((100, 4, 4))], plan),
):
    try:
        call()
    except planfit.errors.OptionError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "scan: expected a Scan, found 'my_scan'; read one with planfit.read_scan",
        "floorplan: expected a Floorplan, found 'plan.png'; read one with planfit.read_floorplan",
        "floorplan: expected a Floorplan, found 'plan.png'; read one with planfit.read_floorplan",
        "options: expected a RefineOptions, found {'adjust': 1}; give one, planfit.RefineOptions(...)",
        "runtime: expected a Runtime, found 2; give one, planfit.Runtime(...)",
        "scan: expected a Scan, found ndarray; read one with planfit.read_scan",
    ]


def test_numbers_of_numpy_are_numbers() -> None:
    options = planfit.RefineOptions(seed=np.int64(3)).with_("adjust.walls.weight", np.float32(2))
    assert math.isclose(options.adjust.walls.weight, 2)
