"""Physical quantities have one home: `planfit.priors`."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import planfit
from planfit import priors
from planfit.alignment.plan_scale import HALF_THICKNESS_M
from planfit.priors import Prior, PriorRange

SOURCE = Path(planfit.__file__).parent
ALL = {name: value for name, value in vars(priors).items() if isinstance(value, Prior | PriorRange)}
UNITS = ("_M", "_DEG", "_HZ", "_SHARE", "_SIGMAS", "_ODDS")
OWNED = re.compile(
    r"THICKNESS_M$|THICKEST_M$|THINNEST_M$|^(DOOR|LEAF|WALL|COLUMN|STOREY|CEILING|EYE|SLAB)_M$"
    r"|(WALL|STOREY|CEILING|CAMERA|EYE|DOOR|WORKTOP|CUPBOARD)_HEIGHT_M$|(DOOR|LEAF|CORRIDOR|STAIR)_WIDTH_M$"
    r"|^(MAX|MIN)_(WALL|STOREY|DOOR)_M$|^MAX_WORKTOP_M$|^WIDEST_PAPER"
)
"""Names of constants that say how large a thing of `planfit.priors` is."""
ELSEWHERE = {
    ("alignment/plan_scale.py", "HALF_THICKNESS_M"),  # steps of a search, checked below
}


def _literal_constants() -> Iterator[tuple[str, str]]:
    """Module and name of each constant of a module that is a number, or numbers, written there."""
    for path in sorted(SOURCE.rglob("*.py")):
        module = path.relative_to(SOURCE).as_posix()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if not isinstance(node, ast.Assign):
                continue
            of_node = node.targets[0]
            targets = of_node.elts if isinstance(of_node, ast.Tuple) else [of_node]
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            if len(values) != len(targets):
                targets, values = targets * len(values), values * len(targets)
            for target, value in zip(targets, values, strict=False):
                number = value.value if isinstance(value, ast.Constant) else None
                if isinstance(target, ast.Name) and isinstance(number, int | float):
                    yield module, target.id


def test_nothing_else_is_kept_in_priors() -> None:
    assert len(ALL) > 30
    assert ALL.keys() == {name for name in vars(priors) if name.isupper()}


@pytest.mark.parametrize("name", ALL)
def test_a_prior_is_ordered_and_has_a_source_and_a_unit(name: str) -> None:
    prior = ALL[name]
    assert name.endswith(UNITS)
    assert prior.source.endswith(".")
    assert re.search(r"\d|[Cc]hosen\s+here", prior.source), "a standard, a measurement, or a choice"
    if isinstance(prior, PriorRange):
        assert 0 < prior.low < prior.middle < prior.high
        assert prior.both == (prior.low, prior.high)
    else:
        assert prior.value > 0


def test_narrow_ranges_lie_in_wide_ones() -> None:
    wide = priors.WALL_FACES_APART_M
    for inner in (priors.WALL_THICKNESS_M, priors.PARTITION_THICKNESS_M):
        assert wide.low < inner.low < inner.high < wide.high
    assert wide.low <= priors.WALL_LINES_APART_LEAST_M.value < wide.high
    assert priors.WALL_THICKNESS_M.low <= priors.PARTITION_THICKNESS_M.low
    assert priors.WALL_AS_DRAWN_M.value < priors.WALL_MOVED_MOST_M.value
    size, likely = priors.BUILDING_SIZE_M, priors.BUILDING_LIKELY_SIZE_M
    assert size.low < likely.low < priors.BUILDING_USUAL_SIZE_M.value < likely.high < size.high
    leaf = priors.DOOR_LEAF_WIDTH_M
    assert leaf.low < priors.DOOR_LEAF_USUAL_WIDTH_M.value < leaf.high
    assert (
        priors.DOOR_CLEAR_HEIGHTS_M.high < priors.STOREY_HEIGHT_M.low < priors.WALL_HEIGHT_M.value
    )
    assert (
        priors.WORKTOP_HEIGHT_M.value < priors.EYE_HEIGHT_M.value < priors.CUPBOARD_HEIGHT_M.value
    )


def test_walls_that_are_tried_are_walls_of_buildings() -> None:
    usual = priors.WALL_THICKNESS_M
    assert all(usual.low <= 2 * half_m <= usual.high for half_m in HALF_THICKNESS_M)


def test_no_other_module_says_how_large_these_things_are() -> None:
    found = {
        (module, name) for module, name in _literal_constants() if OWNED.search(name.lstrip("_"))
    }
    assert found - ELSEWHERE == set()
    assert found >= ELSEWHERE


def test_priors_import_nothing_of_planfit() -> None:
    tree = ast.parse(Path(priors.__file__).read_text(encoding="utf-8"))
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not any(module.startswith("planfit") for module in modules)
