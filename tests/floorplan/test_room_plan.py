"""Rooms captured by RoomPlan: surfaces in JSON to faces."""

import copy
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from planfit.cli import run
from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.elements import opening_element
from planfit.floorplan.gaps import find_gaps

REAL = (
    Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
    / "real_files"
    / "roomplan"
)


def surface(start, end, low, high, name="", parent=None, story=0) -> dict:
    """Upright, between two points (x, z) of the world, y up."""
    start, end = np.array(start, float), np.array(end, float)
    width = float(np.linalg.norm(end - start))
    x, z = (end - start) / width
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 2] = (x, 0, z), (-z, 0, x)
    matrix[:3, 3] = [*(start + end) / 2, 0]
    matrix[:3, 3] = [(start[0] + end[0]) / 2, (low + high) / 2, (start[1] + end[1]) / 2]
    return {
        "transform": matrix.T.ravel().tolist(), "dimensions": [width, high - low, 0], "identifier": name,
        "parentIdentifier": parent, "story": story, "curve": None, "confidence": {"high": {}},
    }  # fmt: skip


def a_room() -> dict:
    """4 x 3 m in world x and z, floor at -1.2 m, a door, a window and a high window."""
    corners = [(0, 0), (4, 0), (4, 3), (0, 3)]
    walls = [surface(corners[i], corners[(i + 1) % 4], -1.2, 1.3, f"w{i}") for i in range(4)]
    outline = [[x, z, 0] for x, z in corners]
    # Lies on the ground: its own x and y are the world's x and z.
    lying = np.array([[1, 0, 0, 0], [0, 0, -1, -1.2], [0, 1, 0, 0], [0, 0, 0, 1]], float)
    return {
        "version": 2, "walls": walls,
        "doors": [surface((1, 0), (2, 0), -1.2, 0.9, "d", "w0")],
        "windows": [
            surface((4, 1), (4, 2), -0.3, 0.8, "a"), surface((1, 3), (2, 3), 0.6, 1.2, "b", "w2"),
        ],
        "openings": [],
        "floors": [{"transform": lying.T.ravel().tolist(), "polygonCorners": outline, "story": 0}],
    }  # fmt: skip


def written(path: Path, content: object) -> Path:
    path.write_text(json.dumps(content))
    return path


def test_walls_doors_and_windows_at_the_height_of_the_cut(tmp_path: Path) -> None:
    plan = read_floorplan(written(tmp_path / "Room.json", a_room()))
    assert plan.is_metric
    assert plan.size == pytest.approx((4.0, 3.0))
    assert plan.lengths.sum() == pytest.approx(14.0 - 1.0 - 1.0)
    np.testing.assert_allclose(plan.ends[..., 1].max(), 0.0, atol=1e-9)  # plan y is -z
    assert plan.is_oriented.all()
    inwards = np.einsum("ni,ni->n", (2.0, -1.5) - plan.ends.mean(axis=1), plan.normals)
    assert (inwards > 0).all()
    openings = np.sort(plan.openings.reshape(-1, 4), axis=0)
    expected = np.sort(np.array([[1, 0, 2, 0], [4, -1, 4, -2]], float), axis=0)
    np.testing.assert_allclose(openings, expected, atol=1e-9)
    told = {
        round(g.ends[:, 0].mean(), 2): opening_element(plan, g)[0]
        for g in find_gaps(plan, (0.5, 3))
    }
    assert told == {1.5: "door", 4.0: "window"}
    high = read_floorplan(tmp_path / "Room.json", PlanOptions(cut_height_m=2.2))
    assert high.lengths.sum() == pytest.approx(13.0)


def test_storeys_and_structures(tmp_path: Path) -> None:
    room, upper = a_room(), copy.deepcopy(a_room())
    for kind in ("walls", "doors", "windows", "floors"):
        for item in upper[kind]:
            item["story"] = 1
            item["transform"][13] += 3.0
    path = written(tmp_path / "a.json", {"rooms": [room, upper], "walls": []})
    for storey in ("", "0", "1"):
        plan = read_floorplan(path, PlanOptions(storey=storey))
        assert plan.lengths.sum() == pytest.approx(12.0)
        assert plan.source.storeys == ("0", "1")
    with pytest.raises(FloorplanError, match="expected a storey of 0, 1, found '7'"):
        read_floorplan(path, PlanOptions(storey="7"))


def test_a_wall_between_rooms_is_seen_from_both_sides(tmp_path: Path) -> None:
    room = a_room()
    room["walls"].append(surface((2, 0.5), (2, 2.5), -1.2, 1.3, "w9"))
    plan = read_floorplan(written(tmp_path / "a.json", room))
    assert (~plan.is_oriented).sum() == 1


def refusal(path: Path) -> str | None:
    """What is said of a file that is not read; None where it is."""
    try:
        read_floorplan(path)
    except FloorplanError as error:
        return str(error)
    return None


def test_damaged_rooms_end_in_one_line_or_in_a_plan(tmp_path: Path, capsys) -> None:
    rng = np.random.default_rng(0)
    values = [None, "x", [], {}, -1, 1e308, [[]], True, [1, 2, 3], 10**400]
    path = tmp_path / "Room.json"
    n_refused = 0
    for _ in range(150):
        room = a_room()
        kind = rng.choice(["walls", "doors", "windows", "floors"])
        item = room[kind][rng.integers(len(room[kind]))]
        where = rng.choice(list(item))
        item[where] = values[rng.integers(len(values))]
        if rng.random() < 0.2:
            room[kind] = values[rng.integers(len(values))]
        path.write_text(json.dumps(room))
        words = refusal(path)
        if words is not None:
            assert words.startswith(f"{path}: expected")
            assert "\n" not in words
            n_refused += 1
    assert 20 < n_refused < 140
    written(path, {"walls": []})
    assert run(["plan", str(path)]) == 2
    assert "expected walls captured by RoomPlan, found none" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ({"walls": [{"x1": 0, "y1": 0, "x2": 5, "y2": 0}], "rooms": []}, "rooms and walls"),
        ({"walls": {"a": {"thickness": 300}}}, "walls"),
        ({"layers": {"layer-1": {"vertices": {}, "lines": {}}}}, "layers"),
        ({"floorplan": {"corners": {}, "walls": []}}, "floorplan"),
    ],
)
def test_plans_of_editors_are_to_be_exported(tmp_path: Path, content: dict, found: str) -> None:
    """Not a room captured by RoomPlan, to be exported again."""
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(content))
    words = refusal(path) or ""
    assert f"found the {found} of another program's own form" in words
    assert "RoomPlan, found" in words


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_dir(), reason="no real rooms: set PLANFIT_SHARED to their folder")
@pytest.mark.parametrize(("name", "n_walls", "n_holes"), [("library", 26, 4), ("libroom", 9, 2)])
def test_real_rooms(name: str, n_walls: int, n_holes: int, capsys) -> None:
    path = REAL / name / "Room.json"
    assert run(["plan", str(path)]) == 0
    assert "captured by RoomPlan" in capsys.readouterr().out
    content, plan = json.loads(path.read_text()), read_floorplan(path)
    assert len(content["walls"]) == n_walls
    widths = sum(wall["dimensions"][0] for wall in content["walls"])
    holes = sum(
        hole["dimensions"][0] for kind in ("doors", "windows", "openings") for hole in content[kind]
    )
    assert widths - holes - 0.1 < plan.lengths.sum() <= widths
    assert len(plan.openings) == n_holes
    assert plan.is_oriented.mean() > 0.8


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_dir(), reason="no real rooms: set PLANFIT_SHARED to their folder")
@pytest.mark.parametrize("name", ["library", "libroom"])
def test_usdz_of_a_room_gives_the_plan_of_its_json(name: str) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed (planfit[usd])")
    usdz, plan = (read_floorplan(REAL / name / f"Room{suffix}") for suffix in (".usdz", ".json"))
    np.testing.assert_allclose(usdz.ends, plan.ends, atol=1e-5)
    np.testing.assert_array_equal(usdz.is_oriented, plan.is_oriented)
    np.testing.assert_allclose(usdz.normals, plan.normals, atol=1e-5)
    assert len(usdz.openings) == len(plan.openings)


def test_usdz_without_usd_core_says_what_to_install(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setitem(sys.modules, "pxr", None)
    monkeypatch.setitem(sys.modules, "pxr.Usd", None)
    (tmp_path / "Room.usdz").write_bytes(b"PK")
    assert run(["plan", str(tmp_path / "Room.usdz")]) == 2
    told = capsys.readouterr().err
    assert "pip install 'planfit[usd]'" in told
    assert "give the JSON" in told


@pytest.mark.parametrize("walls", [0, 1])
def test_usd_of_other_things_and_of_other_units(tmp_path: Path, walls: int) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed (planfit[usd])")
    from pxr import Gf, UsdGeom, UsdUtils

    stage = usd.Stage.CreateNew(str(tmp_path / "room.usdc"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    for k in range(3):
        group = UsdGeom.Xform.Define(stage, f"/Room/Wall_{k}_grp")
        group.GetPrim().SetCustomDataByKey("Category", "Wall" if walls else "Sofa")
        cube = UsdGeom.Cube.Define(stage, f"/Room/Wall_{k}_grp/Wall{k}")
        cube.GetSizeAttr().Set(1.0)
        UsdGeom.XformCommonAPI(cube).SetScale(Gf.Vec3f(300.0, 250.0, 1.0))
        UsdGeom.XformCommonAPI(cube).SetTranslate(Gf.Vec3d(0.0, 125.0, -200.0 * k))
    stage.Save()
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "room.usdc"), str(tmp_path / "Room.usdz"))
    if not walls:
        assert "found 0 such walls in 7 prims" in (refusal(tmp_path / "Room.usdz") or "")
        return
    plan = read_floorplan(tmp_path / "Room.usdz")
    np.testing.assert_allclose(plan.lengths, 3.0)
    np.testing.assert_allclose(np.sort(plan.ends[:, 0, 1]), [0.0, 2.0, 4.0], atol=1e-9)


@pytest.mark.parametrize(("width_m", "is_door"), [(1.0, True), (2.4, True), (3.2, False)])
def test_doors_wider_than_any_are_fronts(tmp_path: Path, width_m: float, is_door: bool) -> None:
    content = a_room()
    content["doors"] = [surface((0.4, 0), (0.4 + width_m, 0), -1.2, 0.9, "d", "w0")]
    plan = read_floorplan(written(tmp_path / "Room.json", content))
    assert plan.lengths.sum() == pytest.approx(14.0 - 1.0 - (width_m if is_door else 0.0))
    assert any("kept as wall" in words for words in plan.source.warnings) != is_door
