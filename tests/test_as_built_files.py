"""Walls as built in the forms of other programs: what is written, read back by readers of the forms."""

import csv
import json
import re
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest

from planfit.as_built import (
    AsBuilt,
    AsBuiltOpening,
    AsBuiltOptions,
    AsBuiltWall,
    OpeningVerdict,
    Verdict,
    write_as_built,
)
from planfit.cli import run
from planfit.export.bcf import write_bcf
from planfit.export.plan_files import (
    AS_BUILT_HEADER,
    write_as_built_csv,
    write_as_built_dxf,
    write_as_built_geojson,
)

NAN = float("nan")
GLOBAL_ID = "2O2Fr$t4X7Zf8NOew3FLOH"


def wall(face, ends, normal, offset_m=NAN, sigma_m=NAN, through=0.0, element_id="", oriented=True):
    n = 0 if np.isnan(offset_m) else 5
    return AsBuiltWall(
        face,
        np.array(ends, dtype=float),
        np.array(normal, dtype=float),
        oriented,
        offset_m,
        sigma_m,
        n,
        n,
        through,
        element_id,
    )


@pytest.fixture
def as_built() -> AsBuilt:
    """Of each verdict one wall; the one that was moved by both of its faces, towards +y."""
    walls = (
        wall(0, [[0, 0], [4, 0]], [0, 1], 0.01, 0.004),
        wall(1, [[0, 3], [4, 3]], [0, -1], -0.2, 0.01, element_id=GLOBAL_ID),
        wall(2, [[4, 3.2], [0, 3.2]], [0, 1], 0.21, 0.012, element_id=GLOBAL_ID),
        wall(3, [[2, 0], [2, 3]], [1, 0], through=0.9, element_id="not of IFC"),
        wall(5, [[9, 0], [9, 3]], [1, 0]),
        wall(-1, [[1, 1], [1, 2.5]], [-1, 0], 0.0, 0.02),
    )
    return AsBuilt(walls, AsBuiltOptions(tolerance_m=0.05), "/plans/tower & <co>.ifc")


WORDS = ["agrees", "moved", "moved", "missing", "not seen", "new"]


def test_the_table_has_a_line_a_wall(as_built, tmp_path):
    write_as_built_csv(tmp_path / "walls.csv", as_built)
    with (tmp_path / "walls.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == AS_BUILT_HEADER.split(",")
    assert [row["verdict"] for row in rows] == WORDS
    assert float(rows[1]["offset_m"]) == -0.2
    assert float(rows[1]["sigma_m"]) == 0.01
    assert [float(rows[1][name]) for name in ("x1_m", "y1_m", "x2_m", "y2_m")] == [0, 3, 4, 3]
    assert rows[1]["element_id"] == GLOBAL_ID
    assert rows[1]["words"] == "moved by 0.200 m (± 0.010 m) into the wall, towards +y"
    assert rows[2]["words"] == "moved by 0.210 m (± 0.012 m) into the room, towards +y"
    assert rows[3]["offset_m"] == rows[3]["sigma_m"] == rows[5]["face"] == ""
    assert [row["is_sure"] for row in rows] == ["yes"] * 6


def test_the_tolerance_is_chosen_when_files_are_written(as_built, tmp_path):
    write_as_built_csv(tmp_path / "walls.csv", as_built, 0.205)
    with (tmp_path / "walls.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == ["agrees", "agrees", "moved", *WORDS[3:]]
    assert rows[1]["is_sure"] == "no"


def test_geojson_has_where_a_wall_is_drawn_and_where_it_stands(as_built, tmp_path):
    write_as_built_geojson(tmp_path / "walls.geojson", as_built)
    content = json.loads((tmp_path / "walls.geojson").read_text())
    lines = [
        (f["properties"]["verdict"], f["properties"]["line"], f["geometry"]["coordinates"])
        for f in content["features"]
    ]
    assert [one[:2] for one in lines] == [
        ("agrees", "as drawn"),
        ("moved", "as drawn"),
        ("moved", "as built"),
        ("moved", "as drawn"),
        ("moved", "as built"),
        ("missing", "as drawn"),
        ("not seen", "as drawn"),
        ("new", "as built"),
    ]
    assert lines[1][2] == [[0, 3], [4, 3]]
    assert lines[2][2] == [[0, 3.2], [4, 3.2]]
    assert content["features"][1]["properties"]["offset_m"] == -0.2
    assert content["features"][6]["properties"]["offset_m"] is None


def test_drawings_lie_in_the_coordinates_of_the_plans_file(as_built, tmp_path):
    """A drawing in millimetres, y down, its origin elsewhere."""
    file_from_plan = np.array([[1000.0, 0.0, 5e6], [0.0, -1000.0, 7e5], [0.0, 0.0, 1.0]])
    inside = replace(as_built, file_from_plan=file_from_plan)
    write_as_built_geojson(tmp_path / "walls.geojson", inside)
    content = json.loads((tmp_path / "walls.geojson").read_text())
    assert content["features"][1]["geometry"]["coordinates"] == [[5e6, 697000], [5004000, 697000]]
    write_as_built_dxf(tmp_path / "walls.dxf", inside)
    document = ezdxf.readfile(tmp_path / "walls.dxf")
    (line,) = document.modelspace().query('LINE[layer=="AS_BUILT_AGREES"]')
    assert tuple(line.dxf.start)[:2] == (5e6, 7e5)
    assert document.units == 0
    text = document.modelspace().query("TEXT")[0]
    assert text.dxf.height == pytest.approx(120.0)


def test_dxf_has_a_layer_a_verdict(as_built, tmp_path):
    write_as_built_dxf(tmp_path / "walls.dxf", as_built)
    document = ezdxf.readfile(tmp_path / "walls.dxf")
    assert document.units == 6
    space = document.modelspace()
    counts = {
        verdict: len(space.query(f'LINE[layer=="AS_BUILT_{verdict.name}"]')) for verdict in Verdict
    }
    assert list(counts.values()) == [1, 2, 1, 1, 1]
    (first, _) = space.query('LINE[layer=="AS_BUILT_MOVED"]')
    assert tuple(first.dxf.start)[:2] == (0.0, 3.2)  # where it stands
    (first, _) = space.query('LINE[layer=="AS_BUILT_MOVED_AS_DRAWN"]')
    assert tuple(first.dxf.start)[:2] == (0.0, 3.0)
    texts = [text.dxf.text for text in space.query('TEXT[layer=="AS_BUILT_MOVED"]')]
    assert texts == ["-20.0 cm +- 1.0", "+21.0 cm +- 1.2"]
    assert not document.audit().has_errors


# Elements and their order, of markup.xsd and visinfo.xsd of BCF 2.1.
TOPIC = ["Title", "Index", "Labels", "CreationDate", "CreationAuthor", "Description"]
UUID = re.compile(r"[a-f0-9]{8}-[a-f0-9]{4}-[a-f0-9]{4}-[a-f0-9]{4}-[a-f0-9]{12}")


def topics_of(path):
    """Markup and viewpoint of each topic, by its folder."""
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        version = ElementTree.fromstring(archive.read("bcf.version"))
        assert (version.tag, version.get("VersionId")) == ("Version", "2.1")
        folders = {name.split("/")[0] for name in archive.namelist()} - {"bcf.version"}
        return {
            folder: tuple(
                ElementTree.fromstring(archive.read(f"{folder}/{name}"))
                for name in ("markup.bcf", "viewpoint.bcfv")
            )
            for folder in folders
        }


def test_bcf_has_a_topic_a_wall_that_is_not_as_planned(as_built, tmp_path):
    write_bcf(tmp_path / "walls.bcf", as_built, now=datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC))
    topics = topics_of(tmp_path / "walls.bcf")
    by_label = {}
    for folder, (markup, view) in topics.items():
        assert UUID.fullmatch(folder)
        assert [child.tag for child in markup] == ["Header", "Topic", "Viewpoints"]
        topic = markup.find("Topic")
        assert topic.get("Guid") == folder
        assert [child.tag for child in topic] == TOPIC
        assert topic.findtext("CreationDate") == "2026-01-02T03:04:05Z"
        assert markup.findtext("Header/File/Filename") == "tower & <co>.ifc"
        assert markup.find("Viewpoints").get("Guid") == view.get("Guid")
        assert UUID.fullmatch(view.get("Guid"))
        assert [child.tag for child in view] == ["Components", "PerspectiveCamera", "Lines"]
        assert 45 <= float(view.findtext("PerspectiveCamera/FieldOfView")) <= 60
        by_label[topic.findtext("Labels")] = markup, view
    # Both faces of the wall that was moved are one topic.
    assert sorted(by_label) == ["as built: missing", "as built: moved", "as built: new"]
    markup, view = by_label["as built: moved"]
    assert markup.findtext("Topic/Title").startswith("Wall stands 2")
    assert "moved by 0.200 m" in markup.findtext("Topic/Description")
    assert "moved by 0.210 m" in markup.findtext("Topic/Description")
    selected = [c.get("IfcGuid") for c in view.findall("Components/Selection/Component")]
    assert selected == [GLOBAL_ID]
    _, view = by_label["as built: missing"]
    assert [child.tag for child in view.find("Components")] == ["Visibility"]  # no GlobalId
    # Looked at from its free side, which is +x.
    assert float(view.findtext("PerspectiveCamera/CameraViewPoint/X")) >= 4.0
    assert float(view.findtext("PerspectiveCamera/CameraDirection/X")) == -1.0


def test_topics_keep_their_guids(as_built, tmp_path):
    for name in ("first.bcf", "second.bcf"):
        write_bcf(tmp_path / name, as_built)
    assert set(topics_of(tmp_path / "first.bcf")) == set(topics_of(tmp_path / "second.bcf"))


def test_bcf_stands_on_the_floor_of_its_storey(as_built, tmp_path):
    write_bcf(tmp_path / "walls.bcf", replace(as_built, elevation_m=3.1))
    for _, view in topics_of(tmp_path / "walls.bcf").values():
        assert float(view.findtext("PerspectiveCamera/CameraViewPoint/Z")) == pytest.approx(4.7)
        heights = {float(z.text) for z in view.findall("Lines/Line/StartPoint/Z")}
        assert heights == {3.1, 5.6}


@pytest.mark.parametrize("suffix", [".csv", ".geojson", ".dxf", ".bcf", ".bcfzip"])
def test_the_command_writes_each_form(suffix, as_built, tmp_path, capsys):
    write_as_built(tmp_path / "as_built.json", as_built)
    target = tmp_path / f"walls{suffix}"
    assert run(["export", str(tmp_path), "--to", "as-built", "-o", str(target)]) == 0
    assert target.stat().st_size > 0
    assert "1 agrees, 2 moved, 1 missing, 1 not seen, 1 new" in capsys.readouterr().out


def test_the_command_takes_a_tolerance(as_built, tmp_path, capsys):
    write_as_built(tmp_path / "as_built.json", as_built)
    words = ["export", str(tmp_path), "--to", "as-built", "-o", str(tmp_path / "walls.csv")]
    assert run([*words, "--tolerance-m", "0.3"]) == 0
    assert "3 agrees, 1 missing" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "more", "words"),
    [
        ("walls.pdf", [], r"expected a file of \.csv, .*found \.pdf"),
        ("walls", [], "found no suffix"),
        ("walls.csv", ["--tolerance-m", "-1"], "expected 0 or more, found -1"),
    ],
)
def test_the_command_says_what_is_wrong(name, more, words, as_built, tmp_path, capsys):
    write_as_built(tmp_path / "as_built.json", as_built)
    target = tmp_path / name
    assert run(["export", str(tmp_path), "--to", "as-built", "-o", str(target), *more]) == 2
    assert re.search(words, capsys.readouterr().err)
    assert not target.exists()


def test_a_run_without_verdicts_is_told(tmp_path, capsys):
    words = ["export", str(tmp_path), "--to", "as-built", "-o", str(tmp_path / "walls.csv")]
    assert run(words) == 2
    assert "as_built.json: expected the walls of a run" in capsys.readouterr().err


def opening(is_drawn, at, open_share, closed_share, edges=(NAN, NAN), kind="", element_id=""):
    """A door of 1 m in a wall along x, 0.2 m thick."""
    return AsBuiltOpening(
        is_drawn,
        np.array([[at, 5.0], [at + 1.0, 5.0]]),
        np.array([0.0, 1.0]),
        0.2,
        open_share,
        closed_share,
        int(10 * open_share),
        int(10 * closed_share),
        edges,
        (0.03, 0.04) if np.isfinite(edges[0]) else (NAN, NAN),
        kind,
        element_id,
    )


@pytest.fixture
def with_openings(as_built) -> AsBuilt:
    """Of each verdict one; and a window, which is closed as planned."""
    openings = (
        opening(True, 0.0, 1.0, 0.0, (0.05, 0.95), "door", GLOBAL_ID),
        opening(True, 2.0, 0.0, 0.9, kind="door", element_id=GLOBAL_ID),
        opening(True, 4.0, 0.0, 0.0),
        opening(False, 6.0, 0.8, 0.0, (-0.1, 0.9)),
        opening(True, 8.0, 0.0, 1.0, kind="window"),
    )
    return replace(as_built, openings=openings)


def test_the_table_has_a_line_an_opening(with_openings, tmp_path):
    write_as_built_csv(tmp_path / "walls.csv", with_openings)
    with (tmp_path / "walls.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["what"] for row in rows[:6]] == ["wall"] * 6
    told = [(row["wall"], row["what"], row["verdict"]) for row in rows[6:]]
    assert told == [
        ("O1", "door", "open"),
        ("O2", "door", "closed"),
        ("O3", "opening", "not seen"),
        ("O4", "opening", "new"),
        ("O5", "window", "closed"),
    ]
    first, closed, _, new, _ = rows[6:]
    assert (first["length_m"], first["width_m"], first["shift_m"]) == ("1.0000", "0.9000", "0.0000")
    assert first["width_sigma_m"] == "0.0500"
    assert first["element_id"] == GLOBAL_ID
    assert (closed["width_m"], closed["closed_share"]) == ("", "0.90")
    assert (new["width_m"], new["shift_m"]) == ("1.0000", "")
    # No cell of a line is left over or out.
    assert all(None not in row and None not in row.values() for row in rows)


def test_geojson_has_openings_where_they_are_drawn_and_where_they_are(with_openings, tmp_path):
    write_as_built_geojson(tmp_path / "walls.geojson", with_openings)
    content = json.loads((tmp_path / "walls.geojson").read_text())
    lines = [
        (f["properties"]["opening"], f["properties"]["line"], f["geometry"]["coordinates"])
        for f in content["features"]
        if "opening" in f["properties"]
    ]
    assert [one[:2] for one in lines] == [
        (1, "as drawn"),
        (1, "as built"),
        (2, "as drawn"),
        (3, "as drawn"),
        (4, "as built"),
        (5, "as drawn"),
    ]
    assert lines[1][2] == [[0.05, 5.0], [0.95, 5.0]]
    assert lines[4][2] == [[5.9, 5.0], [6.9, 5.0]]


def test_dxf_has_openings_on_layers_of_their_own(with_openings, tmp_path):
    write_as_built_dxf(tmp_path / "walls.dxf", with_openings)
    document = ezdxf.readfile(tmp_path / "walls.dxf")
    space = document.modelspace()
    counts = [
        len(space.query(f'LINE[layer=="AS_BUILT_OPENING_{verdict.name}"]'))
        for verdict in OpeningVerdict
    ]
    assert counts == [1, 2, 1, 1]
    (line,) = space.query('LINE[layer=="AS_BUILT_OPENING_OPEN"]')
    assert tuple(line.dxf.start)[:2] == (0.05, 5.0)
    texts = [text.dxf.text for text in space.query('TEXT[layer=="AS_BUILT_OPENING_OPEN"]')]
    assert texts == ["0.90 m +- 0.05"]
    assert not document.audit().has_errors


def test_bcf_has_a_topic_for_what_is_closed_or_new(with_openings, tmp_path):
    write_bcf(tmp_path / "walls.bcf", with_openings)
    by_label = {
        m.findtext("Topic/Labels"): (m, v) for m, v in topics_of(tmp_path / "walls.bcf").values()
    }
    walls = {"as built: missing", "as built: moved", "as built: new"}
    assert set(by_label) == walls | {"as built: opening closed", "as built: opening new"}
    markup, view = by_label["as built: opening closed"]
    assert markup.findtext("Topic/Title") == "Door is closed (shut door or walled up): (2.5, 5.0)"
    assert "90%" in markup.findtext("Topic/Description")
    selected = [c.get("IfcGuid") for c in view.findall("Components/Selection/Component")]
    assert selected == [GLOBAL_ID]
    assert float(view.findtext("PerspectiveCamera/CameraDirection/Y")) == -1.0


def test_the_command_counts_openings(with_openings, tmp_path, capsys):
    write_as_built(tmp_path / "as_built.json", with_openings)
    words = ["export", str(tmp_path), "--to", "as-built", "-o", str(tmp_path / "walls.csv")]
    assert run(words) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "openings: 1 open, 2 closed, 1 not seen, 1 new" in told
