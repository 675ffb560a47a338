"""From the names of a label set (ADE20K, COCO, MSeg and the like) to the labels of the method."""

import re
from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8

from planfit.errors import OptionError
from planfit.scan import Label

_NAMES = {
    Label.FLOOR: {"floor", "flooring", "ground", "carpet", "carpeting", "rug", "pavement"},
    Label.WALL: {"wall"},
    Label.CEILING: {"ceiling"},
    Label.COLUMN: {"column", "pillar"},
}
_QUALIFIERS = {
    "area", "brick", "concrete", "inside", "interior", "indoor", "marble", "merged", "other", "panel",
    "plaster", "stone", "stuff", "tile", "tiled", "wood", "wooden",
}  # fmt: skip
"""Words that a name may carry without meaning something else: `wall-brick`, `floor-other-merged`."""


def label_of_name(name: str) -> Label:
    """The label of one class: `rug;carpet;carpeting` is floor, `wall-brick` wall, `wall clock` other.

    Synonyms are parted by `,` `;` or `/`; one of them is enough.
    """
    for synonym in re.split(r"[,;/]", name.lower()):
        words = {_singular(word) for word in re.findall(r"[a-z]+", synonym)} - _QUALIFIERS
        for label, names in _NAMES.items():
            if len(words) == 1 and words <= names:
                return label
    return Label.OTHER


def label_table(id2label: Mapping[int, str], where: str) -> UInt8[np.ndarray, " n"]:
    """Labels of `Label` by class number, 0 to the largest; numbers without name are NONE.

    Raises:
        OptionError: no class is a floor or a wall; `where` names the model.
    """
    table = np.full(max(id2label, default=-1) + 1, Label.NONE, dtype=np.uint8)
    for number, name in id2label.items():
        table[number] = label_of_name(name)
    missing = [
        label.name.lower() for label in (Label.FLOOR, Label.WALL) if not np.any(table == label)
    ]
    if missing:
        shown = ", ".join(list(id2label.values())[:8])
        raise OptionError(
            f"{where}: expected classes named floor and wall (or ground, carpet, rug), found no "
            f"{' and no '.join(missing)} among {len(id2label)} classes ({shown} ...); take a model that "
            "was trained on indoor scenes, or name its classes in id2label of its config.json"
        )
    return table


def _singular(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word
