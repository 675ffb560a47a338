"""Which layers of a drawing are read as walls, what of them is not, and walls drawn as single lines."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely

from plan_files import write_dxf
from planfit.cli import run
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.vector.layer_names import Role, role_of

OUTSIDE = shapely.box(0, 0, 12, 8).difference(shapely.box(0.4, 0.4, 11.6, 7.6))
INSIDE = shapely.union_all(
    [shapely.box(5, 0.4, 5.12, 5), shapely.box(5, 6, 5.12, 7.6), shapely.box(5.12, 4, 9, 4.12)]
)
COLUMNS = [shapely.box(8, 2, 8.4, 2.4), shapely.box(2.5, 5, 2.9, 5.4)]


@pytest.mark.parametrize(
    ("names", "role"),
    [
        # German, umlauts as letters, as letter and dots, and written out.
        (["015 Innenwände", "010 Außenwände", "020 Stützen", "015 Innenwa\u0308nde", "010 Aussenwaende",
          "020 STUETZEN", "Trennwand_GK", "Leichtbauwände", "Stahlbetonstützen", "KS-Mauerwerk",
          "ROHBAU - Darstellungen - Waende"], Role.WALL),
        (["MURS PORTEURS", "cloisons", "A-POTEAUX", "Refend", "Façade"], Role.WALL),
        (["MUROS", "Tabiquería", "PILARES", "cerramiento", "Fachada"], Role.WALL),
        (["MURI", "Tramezzi", "PILASTRI", "tamponamento", "Pareti_int"], Role.WALL),
        (["קירות", "עמודים", "A-מחיצות"], Role.WALL),
        (["BINNENWANDEN", "buitenmuren", "Kolommen", "scheidingswand"], Role.WALL),
        (["A-WALL", "A-WALL-FULL-E", "S-COLS", "I-WALL-PRHT", "ExteriorWalls", "wall_new"], Role.WALL),
        (["A-21----E-", "A-22----E-N01", "A222----E-", "B_28____--"], Role.WALL),
        (["A-21----T-", "A-22----D-", "A-24----E-", "A-27----E-", "A-21----H-"], Role.NO_WALL),
        (["A-31----E-", "A-DOOR", "A-GLAZ-CURT", "Innentüren", "Fenster", "ventanas", "חלונות",
          "carpintería"], Role.OPENING),
        (["A-WALL-PATT", "A-WALL-IDEN", "A-WALL-HEAD-TEXT", "A-FLOR-STRS", "Wandlampen", "Schrankwand",
          "Bemaßung Wände", "Wandschraffur", "mobiliario", "Cotas", "Arredi", "Maatvoering", "ריהוט",
          "A-ANNO-DIMS", "A-WALL-FNSH", "A-WALL-SYMB", "A-WALL-HEAD", "E-POWR-WALL", "P-SANR",
          "A-FLOR-PFIX", "Paths", "Portals"], Role.NO_WALL),
        (["Furnishing", "Sanitärobjekte", "AMENAGEMENT", "Wyposażenie", "MOBİLYA", "LVTRY", "KALUSTEET",
          "BÚTOR", "Garten", "Stellplätze", "Elektro", "CONTOURS"], Role.NO_WALL),
        # Overhead, as two lines from wall to wall.
        (["Stahltraeger", "Stahlträger", "Querbalken", "Unterzüge", "S-BEAM", "Structure Beams", "Poutres",
          "Vigas", "Travi", "Stalen liggers", "קורות"], Role.NO_WALL),
        # Ways through the building, what is measured in it and what helped to draw it.
        (["ligne circulation", "Flèche", "parcours", "Fluchtweg", "Rettungswege", "Pfeile", "escape route",
          "A-EGRESS", "Evacuation", "recorrido", "flechas", "percorso", "Frecce", "Guides", "Measurements",
          "Mesures", "Medidas", "Misure", "Heizkörper", "Radiateurs", "Radiatori",
          "Radiadores"], Role.NO_WALL),
        (["0", "Layer 1", "ARCHITEKTUR", "Struktur", "Strukturen", "LAYER_21_E_", "Ground floor"],
         Role.UNKNOWN),
    ],
)  # fmt: skip
def test_names_in_several_languages_and_standards(names: list[str], role: Role) -> None:
    assert {name: role_of(name) for name in names} == dict.fromkeys(names, role)


def german(path: Path) -> Path:
    """Outer walls as many closed pieces, partitions filled, columns closed and round, furniture."""

    def add(document: ezdxf.document.Drawing) -> None:
        space = document.modelspace()
        for part in shapely.get_parts(INSIDE):
            fill = space.add_hatch(dxfattribs={"layer": "015 Innenwände"})
            fill.paths.add_polyline_path(np.asarray(part.exterior.coords), is_closed=True)
        for part in COLUMNS:
            corners = np.asarray(part.exterior.coords)[:-1]
            space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "020 Stützen"})
        space.add_circle((10.5, 6), 0.25, dxfattribs={"layer": "020 Stützen"})
        desk = np.array([(1, 1), (2.6, 1), (2.6, 1.8), (1, 1.8)])
        for shift in (0.0, 0.05):
            space.add_lwpolyline(desk + shift, close=True, dxfattribs={"layer": "Möbel"})

    # Every 0.75 m of an outer wall is a piece of its own, as some programs write them.
    cuts = shapely.MultiLineString([[(x, -1), (x, 9)] for x in np.arange(0.75, 12, 0.75)])
    pieces = shapely.difference(OUTSIDE, cuts.buffer(1e-4))
    return write_dxf(path, pieces, layer="010 Außenwände", extra=add)


def distances(plan, area) -> np.ndarray:
    """From points every 5 cm along the outline of an area to the nearest face, m."""
    outline = shapely.segmentize(shapely.boundary(area), 0.05)
    lines = shapely.multilinestrings(shapely.linestrings(plan.ends))
    return shapely.distance(shapely.points(shapely.get_coordinates(outline)), lines)


def test_outer_walls_partitions_and_columns_are_read_together(tmp_path: Path) -> None:
    plan = read_floorplan(german(tmp_path / "a.dxf"))
    assert set(plan.source.layers) == {"015 Innenwände", "010 Außenwände", "020 Stützen"}
    for area in (OUTSIDE, INSIDE, *COLUMNS, shapely.Point(10.5, 6).buffer(0.25)):
        assert np.mean(distances(plan, area) < 0.02) > 0.97
    middles = shapely.points(plan.ends.mean(axis=1))
    drawn = shapely.union_all([OUTSIDE, INSIDE, *COLUMNS, shapely.Point(10.5, 6).buffer(0.25)])
    is_on = shapely.distance(middles, shapely.boundary(drawn)) < 0.02
    assert plan.lengths[is_on].sum() > 0.99 * plan.lengths.sum()
    assert any("Möbel (9.6 m)" in words for words in plan.source.dropped)


@pytest.mark.parametrize(
    "flags",
    [
        ["--layer", "010 Außenwände", "--layer", "020*"],
        ["--layer", "010 Außenwände", "020*"],
        ["--layer=010 Außenwände", "--layer=020*"],
    ],
)
def test_layers_may_be_given_one_by_one_or_together(tmp_path: Path, flags, capsys) -> None:
    assert run(["plan", str(german(tmp_path / "a.dxf")), *flags]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "layers 010 Außenwände, 020 Stützen" in said
    assert "on layers that were not chosen: Möbel (9.6 m)" in said


def test_what_is_not_read_of_a_layer_of_walls_is_said_with_its_length(tmp_path: Path) -> None:
    def add(document: ezdxf.document.Drawing) -> None:
        space = document.modelspace()
        for k in range(30):  # short strokes, which no wall is
            at = (1 + 0.3 * k, 1 + 0.2 * (k % 3))
            space.add_line(
                at, (at[0] + 0.1, at[1] + 0.03 * (k % 5)), dxfattribs={"layer": "Wände OG"}
            )

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", OUTSIDE, extra=add))
    assert any("line work taken for no wall: Wände OG (" in words for words in plan.source.dropped)
    (warning,) = plan.source.warnings
    assert warning.startswith("layer 'Wände OG' is called wall, but of its")
    assert "only 0 m became faces" in warning


ROOMS = [
    ((0, 0), (12, 0)), ((12, 0), (12, 8)), ((12, 8), (0, 8)), ((0, 8), (0, 0)),
    ((5, 0), (5, 3)), ((5, 4), (5, 8)), ((5, 5), (12, 5)), ((8, 0), (8, 4)),
]  # fmt: skip
"""Walls as single lines, m."""


def single_lines(path: Path, layer: str, counter: bool = True) -> Path:
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    for start, end in ROOMS:
        space.add_line(start, end, dxfattribs={"layer": layer})
    if counter:  # of 0.5 m, drawn double
        for x0, y0, x1, y1 in (
            (9, 6, 11.5, 6),
            (9, 6.5, 11.5, 6.5),
            (9, 6, 9, 7.5),
            (9.5, 6.5, 9.5, 7.5),
        ):
            space.add_line((x0, y0), (x1, y1), dxfattribs={"layer": "0"})
    document.saveas(path)
    return path


@pytest.mark.parametrize("layer", ["0", "MUROS"])
def test_single_lines_are_walls_even_beside_a_double_one(tmp_path: Path, layer: str) -> None:
    plan = read_floorplan(single_lines(tmp_path / "a.dxf", layer))
    lines = shapely.multilinestrings(shapely.linestrings(plan.ends[~plan.is_oriented]))
    walls = shapely.segmentize(shapely.multilinestrings(ROOMS), 0.05)
    apart = shapely.distance(shapely.points(shapely.get_coordinates(walls)), lines)
    assert np.mean(apart < 0.01) > 0.97
    assert any("walls are drawn as single lines" in words for words in plan.source.warnings)


def test_single_lines_beside_walls_drawn_double_are_no_walls(tmp_path: Path) -> None:
    def add(document: ezdxf.document.Drawing) -> None:
        for y in (2.0, 3.5):  # the edge of a carpet, a beam above
            document.modelspace().add_line((0.4, y), (5, y), dxfattribs={"layer": "0"})

    walls = shapely.union_all([OUTSIDE, INSIDE])
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", walls, layer="PLAN", extra=add))
    assert plan.is_oriented.all()
    assert any("taken for no wall: 0 (9.2 m)" in words for words in plan.source.dropped)


def reactor(path: Path) -> Path:
    """Offices by single lines with gaps for doors on one layer, where a vault has double walls too; a machine
    of double lines; a stub on a layer that is called wall; a line over a wall on a layer of labels."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    space = document.modelspace()

    def add(layer: str, *chains: list[tuple[float, float]]) -> None:
        for chain in chains:
            space.add_lwpolyline(chain, dxfattribs={"layer": layer})

    add("rooms", *OFFICES, [(20, 1), (25, 1), (25, 7), (20, 7), (20, 1)])
    add("rooms", [(20.3, 1.3), (24.7, 1.3), (24.7, 6.7), (20.3, 6.7), (20.3, 1.3)])
    for inset in (0, 0.4):
        box = [(22 + inset, 12 + inset), (27 - inset, 12 + inset), (27 - inset, 17 - inset)]
        add("machine", [*box, (22 + inset, 17 - inset), box[0]])
    add("walls", [(1, 3), (1, 4)])
    add("labels", [(4, 0), (4, 1)])
    document.saveas(path)
    return path


OFFICES = [
    [(3, 10), (0, 10), (0, 0), (8, 0)], [(9, 0), (18, 0), (18, 4)], [(18, 5), (18, 10), (12, 10)],
    [(4, 10), (11, 10)], [(6, 0), (6, 3)], [(6, 4), (6, 10)], [(6, 5), (9, 5)], [(10, 5), (18, 5)],
    [(0, 10), (0, 18), (12, 18), (12, 15)], [(12, 14), (12, 10)], [(4, 0), (4, 1)],
]  # fmt: skip


@pytest.mark.parametrize("layers", [(), ("rooms", "walls")])
def test_rooms_of_single_lines_beside_walls_drawn_double(
    tmp_path: Path, layers: tuple[str, ...]
) -> None:
    plan = read_floorplan(reactor(tmp_path / "a.dxf"), PlanOptions(layers=layers))
    offices = shapely.MultiLineString(OFFICES)
    single = shapely.MultiLineString(list(plan.ends[~plan.is_oriented]))
    assert single.intersection(offices.buffer(0.01)).length > 0.99 * offices.length
    machine = shapely.box(22, 12, 27, 17)
    on_machine = shapely.MultiLineString(list(plan.ends)).intersection(machine.buffer(0.01)).length
    assert on_machine == (0.0 if layers else pytest.approx(20 + 16.8, rel=0.01))
    vault = shapely.box(20, 1, 25, 7).boundary
    double = shapely.MultiLineString(list(plan.ends[plan.is_oriented]))
    assert double.intersection(vault.buffer(0.01)).length > 0.99 * vault.length
    assert any("walls are drawn as single lines" in words for words in plan.source.warnings)


def test_a_chosen_layer_alone_is_read(tmp_path: Path) -> None:
    plan = read_floorplan(german(tmp_path / "a.dxf"), PlanOptions(layers=("020*",)))
    assert plan.source.layers == ("020 Stützen",)
