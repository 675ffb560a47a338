"""Partitions drawn as single lines in thick outer walls are told where they are left out."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest

from planfit.floorplan import read_floorplan

OUTER = [(0, 0, 480, 240), (6, 6, 474, 234)]
PARTITIONS = [(6, 120, 474, 120), (120, 120, 120, 234), (360, 6, 360, 120), (60, 6, 60, 120)]
PANES = [(100, v, 300, v) for v in (0, 2, 4, 6)]
"""Of a window, in a gap of the wall of the same length."""


def drawn(path: Path, lines: list[tuple[float, ...]], has_gap: bool = False) -> Path:
    (x0, y0, x1, y1), (a0, b0, a1, b1) = OUTER
    text = "".join(f'<path d="M{a} {b}L{c} {d}"/>' for a, b, c, d in lines)
    gap = (100, 300) if has_gap else (x0, x0)
    text += f'<path d="M{gap[0]} {y0}L{x0} {y0}L{x0} {y1}L{x1} {y1}L{x1} {y0}L{gap[1]} {y0}"/>'
    gap = (100, 300) if has_gap else (a0, a0)
    text += f'<path d="M{gap[0]} {b0}L{a0} {b0}L{a0} {b1}L{a1} {b1}L{a1} {b0}L{gap[1]} {b0}"/>'
    text = f'<g fill="none" stroke="black" stroke-width="0.3">{text}</g>'
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-10 -10 500 260">{text}</svg>'
    )
    return path


@pytest.mark.parametrize(
    ("lines", "has_gap", "is_told"),
    [(PARTITIONS, True, True), ([], False, False), (PANES, True, False)],
)
def test_lines_from_wall_to_wall_that_were_left_out_are_told(
    tmp_path: Path, lines: list[tuple[float, ...]], has_gap: bool, is_told: bool
) -> None:
    plan = read_floorplan(drawn(tmp_path / "plan.svg", lines, has_gap))
    assert any("from wall to wall" in words for words in plan.source.warnings) == is_told


@pytest.mark.parametrize("layer", ["Base", "Walls existing"])
def test_an_outline_on_a_layer_of_no_name_is_missed(tmp_path: Path, layer: str) -> None:
    """Beside one partition on a layer that is called wall; silent before."""
    drawing = ezdxf.new(units=ezdxf.units.M)
    corners = [(0, 0), (8, 0), (8, 6), (0, 6)]
    drawing.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})
    for x in (4.0, 4.1):
        drawing.modelspace().add_line((x, 0), (x, 4.5), dxfattribs={"layer": "Wall new"})
    drawing.saveas(tmp_path / "plan.dxf")
    plan = read_floorplan(tmp_path / "plan.dxf")
    is_told = any("from wall to wall" in words for words in plan.source.warnings)
    is_read = np.ptp(plan.ends.reshape(-1, 2), axis=0)[0] > 7.9
    assert (is_told, is_read) == ((True, False) if layer == "Base" else (False, True))


def test_a_line_as_long_as_a_front_is_no_pane(tmp_path: Path) -> None:
    """The rest of an outer wall goes on from the wall beside it, as a pane does."""
    panes = [(100, v, 420, v) for v in (0, 6)]
    walls = "M100 0L0 0L0 240L480 240L480 0L420 0L420 6L474 6L474 234L6 234L6 6L100 6Z"
    text = f'<path d="{walls}" fill="black"/>' + "".join(
        f'<path d="M{a} {b}L{c} {d}" stroke="black" stroke-width="0.3"/>' for a, b, c, d in panes
    )
    (tmp_path / "plan.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-10 -10 500 260">{text}</svg>'
    )
    plan = read_floorplan(tmp_path / "plan.svg")
    assert any("from wall to wall" in words for words in plan.source.warnings)
