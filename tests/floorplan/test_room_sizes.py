"""Sizes written in rooms, as estate agents and apps write them, tell the unit of a drawing."""

import ezdxf
import numpy as np
import pytest

from planfit.floorplan import read_floorplan

ROOMS_M = [
    (0.3, 0.3, 4.2, 3.6), (4.7, 0.3, 3.1, 3.6), (8.0, 0.3, 2.4, 3.6),
    (0.3, 4.2, 5.5, 2.7), (6.0, 4.2, 4.4, 2.7),
]  # fmt: skip
"""Left, bottom, width and height of rooms between walls of 0.2 and 0.3 m."""
OUTER_M = (0.0, 0.0, 10.7, 7.2)
DOOR_M = 0.9


def feet(metres):
    inches = round(metres / 0.0254)
    return f"{inches // 12}' {inches % 12}\""


WRITTEN = {
    "m": lambda w, h: f"{w:.1f} x {h:.1f}",
    "m, named": lambda w, h: f"{w:.2f} × {h:.2f} m".replace(".", ","),
    "cm": lambda w, h: f"{100 * w:.0f}x{100 * h:.0f} cm",
    "feet": lambda w, h: f"{feet(w)} x {feet(h)}",
    "decimal feet": lambda w, h: f"{w / 0.3048:.1f}' X {h / 0.3048:.1f}'",
}


def drawing(path, write, units_per_metre, insunits=0, swapped=(), height_m=0.2):
    """A DXF of the rooms, each with a name and its size; of those `swapped`, height by width."""
    document = ezdxf.new(units=insunits)
    space = document.modelspace()
    for x, y, w, h in (OUTER_M, *ROOMS_M):
        corners = units_per_metre * np.array([(x, y), (x + w, y), (x + w, y + h), (x, y + h)])
        space.add_lwpolyline(corners.tolist(), close=True)
    for k, (x, y, w, h) in enumerate(ROOMS_M):
        at = units_per_metre * np.array([x + w / 2, y + h / 2])
        size = write(h, w) if k in swapped else write(w, h)
        text = space.add_mtext(f"ROOM {k}\\P{size}", {"char_height": units_per_metre * height_m})
        text.set_location(at.tolist(), attachment_point=5)
    document.saveas(path)
    return path


@pytest.mark.parametrize("how", WRITTEN)
@pytest.mark.parametrize("units_per_metre", [37.0, 1.0 / 0.3048])
def test_sizes_of_rooms_tell_the_unit(tmp_path, how, units_per_metre):
    path = drawing(tmp_path / "plan.dxf", WRITTEN[how], units_per_metre, swapped=(1, 3))
    plan = read_floorplan(path)
    assert plan.is_metric
    assert plan.size[0] == pytest.approx(OUTER_M[2], rel=0.02)
    assert "sizes of rooms" in plan.source.unit_from


def test_a_header_that_all_rooms_contradict_is_not_believed_and_it_is_said(tmp_path):
    path = drawing(tmp_path / "plan.dxf", WRITTEN["feet"], 1.0 / 0.3048, insunits=6)
    plan = read_floorplan(path)
    assert (plan.source.unit, plan.size[0]) == ("ft", pytest.approx(OUTER_M[2], rel=1e-3))
    assert any("the file says its unit is m" in words for words in plan.source.warnings)


def test_a_header_that_rounded_sizes_agree_with_is_kept(tmp_path):
    path = drawing(
        tmp_path / "plan.dxf", lambda w, h: f"{w + 0.1:.1f} x {h + 0.1:.1f} m", 1.0, insunits=6
    )
    plan = read_floorplan(path)
    assert plan.source.unit_from == "the file's header"
    assert plan.size[0] == pytest.approx(OUTER_M[2], rel=1e-6)


@pytest.mark.parametrize(
    "written", ["2 x 4", "{w:.1f} x {h2:.1f}", "{w:.1f}", "{w_ft:.0f} x {h_ft:.0f}"]
)
def test_what_is_no_size_of_its_room_tells_nothing(tmp_path, written):
    """Two numbers of timber; sides that disagree; one length; and feet that do not say so."""

    def write(w, h):
        return written.format(w=w, h2=2.0 * h, w_ft=w / 0.3048, h_ft=h / 0.3048)

    plan = read_floorplan(drawing(tmp_path / "plan.dxf", write, 37.0))
    assert "sizes of rooms" not in plan.source.unit_from


def test_a_door_beside_the_text_does_not_make_a_room_longer(tmp_path):
    path = drawing(tmp_path / "plan.dxf", WRITTEN["m"], 37.0, height_m=0.3)
    document = ezdxf.readfile(path)
    space = document.modelspace()
    # A gap in both faces between the first two rooms, where their texts are.
    for line in space.query("LWPOLYLINE"):
        corners = [tuple(p[:2]) for p in line]
        space.delete_entity(line)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            ys = sorted((a[1], b[1]))
            is_cut = a[0] == b[0] and 37 * 4.4 < a[0] < 37 * 4.8 and ys[0] < 37 * 2.1 < ys[1]
            parts = [(ys[0], 37 * 2.0), (37 * (2.0 + DOOR_M), ys[1])] if is_cut else [ys]
            for low, high in parts if a[0] == b[0] else ():
                space.add_line((a[0], low), (a[0], high))
            if a[0] != b[0]:
                space.add_line(a, b)
    document.saveas(path)
    plan = read_floorplan(path)
    assert plan.size[0] == pytest.approx(OUTER_M[2], rel=0.02)
