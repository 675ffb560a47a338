"""Partitions drawn as single lines in thick outer walls are told where they are left out."""

from pathlib import Path

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
