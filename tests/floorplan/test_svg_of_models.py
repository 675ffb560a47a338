"""SVG as programs for building models write it: classes of IFC, a scale, elements without content."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from planfit.floorplan import read_floorplan

OUTER, INNER = shapely.box(20, 20, 120, 90), shapely.box(22.4, 22.4, 117.6, 87.6)
"""mm on paper."""
BROKEN = [
    '<path class="x"/>',
    '<path d=""/>',
    '<polyline points="1"/>',
    '<rect width="a"/>',
    "<line/>",
]


def ring(area: shapely.Polygon) -> str:
    return "M" + " L".join(f"{x},{y}" for x, y in area.exterior.coords) + "Z"


def written(path: Path, *, scale: str = "", extra: str = "", classes: bool = True) -> Path:
    wall = 'class="material-x IfcWall cut"' if classes else ""
    other = 'class="IfcAnnotation PredefinedType-DIMENSION"' if classes else ""
    eaves = "".join(f"<path d='{ring(OUTER.buffer(d, join_style='mitre'))}'/>" for d in (8.0, 10.0))
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="150mm" height="110mm" viewBox="0 0 150 110" {scale}>'
        f'<g {wall} fill="black" fill-rule="evenodd"><path d="{ring(OUTER)} {ring(INNER)}"/></g>'
        f'<g {other} fill="none" stroke="black" stroke-width="0.2">{eaves}</g>{extra}</svg>'
    )
    return path


def test_classes_tell_walls_and_the_scale_is_told(tmp_path: Path) -> None:
    plan = read_floorplan(written(tmp_path / "a.svg", scale='data-scale="1:50"'))
    assert plan.is_metric
    np.testing.assert_allclose(sorted(plan.size), [3.5, 5.0], atol=0.01)
    assert set(plan.source.layers) == {"IfcWall"}
    assert any("IfcAnnotation" in words for words in plan.source.dropped)


def test_without_classes_and_scale_nothing_is_told(tmp_path: Path) -> None:
    plan = read_floorplan(written(tmp_path / "a.svg", classes=False))
    assert not plan.is_metric


@pytest.mark.parametrize("broken", BROKEN)
def test_broken_elements_are_left_out(tmp_path: Path, broken: str) -> None:
    right = read_floorplan(written(tmp_path / "a.svg"))
    plan = read_floorplan(written(tmp_path / "b.svg", extra=broken))
    np.testing.assert_allclose(plan.ends, right.ends)


def test_a_path_without_data_is_told(tmp_path: Path) -> None:
    plan = read_floorplan(written(tmp_path / "a.svg", extra="<g><path/><path/></g>"))
    assert "2 broken elements, which draw nothing" in plan.source.dropped
