"""Which walls of one interpretation of a picture are wall beside those of another."""

import numpy as np
import pytest
import shapely

from planfit.floorplan.raster.candidates import Candidate, WallStyle
from planfit.floorplan.raster.choice import with_other_styles
from planfit.floorplan.raster.interpretation import Interpretation

EXTENT_PX = 600.0
SHELL = shapely.box(0, 0, 600, 400).difference(shapely.box(20, 20, 580, 380))


def interpretation(style: str, *walls: shapely.Polygon, score: float = 1000.0) -> Interpretation:
    candidate = Candidate(WallStyle(style), np.zeros((4, 4), np.uint8), "edge", 0.5, 0.0, 1.0)
    return Interpretation(candidate, walls, (), 20.0, score, 0.9)


def bar(x0: float, y0: float, x1: float, y1: float) -> shapely.Polygon:
    return shapely.box(x0, y0, x1, y1)


def added(base: Interpretation, *others: Interpretation) -> list[shapely.Polygon]:
    return [
        wall for part in with_other_styles(base, others, EXTENT_PX).beside for wall in part.walls
    ]


@pytest.mark.parametrize(
    ("other", "is_wall"),
    [
        pytest.param(bar(300, 22, 308, 250), True, id="ends at a wall"),
        pytest.param(bar(300, 60, 308, 350), False, id="touches nothing"),
        pytest.param(bar(40, 22, 560, 60), False, id="stands along a wall"),
        pytest.param(bar(300, 22, 320, 60), False, id="is too short"),
    ],
)
def test_walls_end_at_walls(other: shapely.Polygon, is_wall: bool) -> None:
    found = added(interpretation("solid black", SHELL), interpretation("double lines", other))
    assert bool(found) == is_wall
    if is_wall:
        assert found[0].area == pytest.approx(other.area, rel=0.03)


def test_what_hangs_on_an_added_wall_is_wall_too() -> None:
    first, second = bar(300, 22, 308, 250), bar(310, 150, 500, 158)
    base = interpretation("solid black", SHELL)
    assert len(added(base, interpretation("double lines", first, second))) == 2
    assert not added(base, interpretation("double lines", second))


def test_a_window_is_no_wall() -> None:
    gap = bar(250, -5, 350, 25)
    base = interpretation("solid black", *shapely.get_parts(SHELL.difference(gap)))
    panes = interpretation("double lines", bar(250, 2, 350, 9), bar(250, 11, 350, 18))
    assert not added(base, panes)
    # The same bar across the room, from wall to wall, is one.
    assert added(base, interpretation("double lines", bar(22, 200, 578, 208)))


def test_few_walls_are_no_style_and_one_style_is_drawn_in_one_way() -> None:
    partition = bar(300, 22, 308, 250)
    base = interpretation("solid black", SHELL)
    assert not added(base, interpretation("double lines", partition, score=100.0))
    assert not added(base, interpretation("solid black", partition))
    assert not added(base, interpretation("solid black, nothing else drawn", partition))


def test_what_was_left_out_and_is_wall_of_the_other_style_is_not_left_out() -> None:
    partition, sofa = bar(300, 22, 308, 250), bar(100, 100, 180, 140)
    base = interpretation("solid black", SHELL)
    base = Interpretation(**{**vars(base), "dropped": (partition, sofa)})
    found = with_other_styles(base, [interpretation("double lines", partition)], EXTENT_PX)
    assert found.dropped == (sofa,)
    share = 100 * partition.length / (partition.length + SHELL.length)
    assert found.style == f"solid black ({100 - share:.0f} %) and double lines ({share:.0f} %)"
    assert len(found.all_walls) == 2


def test_outlines_that_cross_themselves_are_cut_too() -> None:
    crossed = shapely.Polygon([(300, 22), (308, 250), (308, 22), (300, 250)])
    shell = shapely.Polygon([(0, 0), (600, 400), (600, 0), (0, 400)])
    assert not crossed.is_valid
    assert not shell.is_valid
    with_other_styles(
        interpretation("solid black", shell), [interpretation("double lines", crossed)], EXTENT_PX
    )


def test_black_walls_go_on_across_their_own_doors_and_may_be_thin() -> None:
    """The flat that is sold, black among grey neighbours: its partitions touch no grey wall."""
    grey = interpretation("solid grey", SHELL)
    at_shell, beyond_door = bar(300, 22, 322, 150), bar(300, 200, 322, 358)
    thin = bar(322, 270, 478, 277)
    walls = shapely.get_parts(shapely.union_all([at_shell, beyond_door, thin]))
    far = bar(60, 200, 160, 222)
    black = interpretation("solid black", *walls, far)
    found = shapely.union_all(added(grey, black))
    assert found.intersection(beyond_door).area > 0.9 * beyond_door.area
    assert found.intersection(thin).area > 0.9 * thin.area
    assert found.intersection(far).area == 0.0
    # Of two lines, as furniture is, only what touches walls and is as thick as others.
    lines = shapely.union_all(added(grey, interpretation("double lines", *walls, far)))
    assert lines.intersection(beyond_door).area < 0.1 * beyond_door.area
