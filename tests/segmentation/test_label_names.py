"""Names of label sets to labels of the method."""

import numpy as np
import pytest

from planfit.errors import OptionError
from planfit.scan import Label
from planfit.segmentation.learned import label_of_name, label_table


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("floor", Label.FLOOR), ("floor, flooring", Label.FLOOR), ("earth, ground", Label.FLOOR),
        ("rug;carpet;carpeting", Label.FLOOR), ("rug-merged", Label.FLOOR), ("Floor", Label.FLOOR),
        ("floor-other-merged", Label.FLOOR), ("floor-wood", Label.FLOOR), ("floors", Label.FLOOR),
        ("ground-other", Label.FLOOR), ("area rug", Label.FLOOR),
        ("wall", Label.WALL), ("wall-brick", Label.WALL), ("wall-other-merged", Label.WALL),
        ("stone_wall", Label.WALL), ("wall-panel", Label.WALL),
        ("ceiling", Label.CEILING), ("ceiling-merged", Label.CEILING), ("ceiling-tile", Label.CEILING),
        ("column, pillar", Label.COLUMN), ("pillar", Label.COLUMN),
        ("wall clock", Label.OTHER), ("wallet", Label.OTHER), ("floor lamp", Label.OTHER),
        ("ceiling fan", Label.OTHER), ("playground", Label.OTHER), ("wardrobe", Label.OTHER),
        ("spinal column", Label.OTHER), ("carpet sweeper", Label.OTHER), ("", Label.OTHER),
        ("glass", Label.OTHER), ("wood", Label.OTHER),
    ],
)  # fmt: skip
def test_names_of_known_label_sets(name, label):
    assert label_of_name(name) == label


def test_the_table_follows_the_numbers_of_the_classes():
    table = label_table({0: "wall", 3: "floor", 5: "person"}, "m")
    assert table.dtype == np.uint8
    none, other = Label.NONE, Label.OTHER
    assert table.tolist() == [Label.WALL, none, none, Label.FLOOR, none, other]


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        ({0: "floor", 1: "cat"}, "no wall"),
        ({0: "LABEL_0"}, "no floor and no wall"),
        ({}, "no floor"),
    ],
)
def test_a_label_set_without_floor_or_wall_is_refused(names, missing):
    with pytest.raises(
        OptionError, match=f"m: expected classes named floor and wall.*found {missing}"
    ):
        label_table(names, "m")
