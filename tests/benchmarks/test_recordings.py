"""The battery of recordings: cases change what their names say, in both halves, and are judged."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from recordings import measure as measuring
from recordings.cases import (
    CLOCK_FAULTS,
    CLOCKS,
    MOUNTS,
    NO_MOUNTS,
    OTHER_UNITS,
    UNITS,
    all_cases,
    choose,
)
from recordings.measure import ASKED, RIGHT, WRONG, Row, StoredDepth, measure
from recordings.page import make_page
from recordings.sources import NAMES, Recording

import planfit
from builders import look, room_plan, room_scan
from planfit.geometry import se3
from planfit.tracking.motions import MeasuredMotions

CASES = all_cases()


def test_both_halves_have_every_scan_and_every_change():
    assert [case.number for case in CASES] == list(range(len(CASES)))
    assert len({case.name for case in CASES}) == len(CASES)
    for is_last in (False, True):
        half = [case for case in CASES if case.is_last == is_last]
        of_units = [case for case in half if case.group == UNITS]
        assert {case.scan for case in of_units} == set(NAMES)
        assert {case.variant for case in of_units} == set(range(len(OTHER_UNITS)))
    counts = Counter(case.group for case in CASES if case.scan != "lounge")
    assert counts[UNITS] >= 200
    assert counts[MOUNTS] >= 40
    clocks = {(case.variant, case.is_last) for case in CASES if case.group == CLOCKS}
    assert clocks == {(k, half) for k in range(len(CLOCK_FAULTS)) for half in (False, True)}


def test_words_and_shares_choose_cases():
    chosen = choose(CASES, "kitchen|: clock", 1)
    assert {case.scan == "kitchen" or case.group == CLOCKS for case in chosen} == {True}
    thinned = choose(CASES, "", 3)
    assert {case.is_last for case in thinned} == {False, True}
    assert len(thinned) == pytest.approx(len(CASES) / 3, abs=2)


def test_depth_is_read_in_another_unit_than_it_is_stored_in():
    scan = room_scan(np.stack([look([3, 2, 1.5], 30)]))
    true = scan.files.depth(0)
    read = StoredDepth(scan.files, 1 / 5000, 1e-3, 1.01).depth(0)
    assert_allclose(read, 5 * 1.01 * true, atol=1e-3)
    cut = StoredDepth(scan.files, 1 / 65535, 1 / 65535, 1.0).depth(0)
    assert np.isnan(cut[true > 1.001]).all()


def walked(n=360):
    """A recording of 12 s whose camera sways, and motions that images of it would show."""
    t = np.arange(n) / 30
    turns = se3.exp_so3(
        np.column_stack([0.2 * np.sin(5 * t), np.sin(1.3 * t), 0.1 * np.cos(3 * t)])
    )
    places = np.column_stack([np.sin(2 * t), 0.1 * np.cos(7 * t), 0.8 * t])
    true = se3.make_transform(turns, places)
    scan = room_scan(true)
    i = np.repeat(np.arange(n - 4), 4)
    pairs = np.column_stack([i, i + np.tile([1, 2, 3, 4], n - 4)])
    exact = se3.inverse(true[pairs[:, 0]]) @ true[pairs[:, 1]]
    sigma = np.repeat([0.003, 0.01], 3)
    noisy = se3.retract(exact, np.random.default_rng(0).normal(size=(len(pairs), 6)) * sigma)
    covariance = np.tile(np.diag(sigma**2), (len(pairs), 1, 1))
    motions = MeasuredMotions(pairs, noisy, covariance, np.full(len(pairs), 100))
    return Recording(scan, true, np.array([0.0, 1, 0]), room_plan()), motions


@pytest.mark.parametrize("clock", CLOCK_FAULTS, ids=lambda clock: clock.words)
def test_trajectories_have_the_clock_that_their_name_says(clock):
    recording, _ = walked(60)
    true, image_s = recording.true_world_from_cams, np.arange(60) / 30
    times, poses = measuring._trajectory(true, image_s, clock)
    order = np.argsort(times)[:: -1 if clock.order == "backwards" else 1]
    if clock.order != "set back":
        assert_allclose(order, np.arange(len(times)))
        first = poses[np.argmin(times)]
        assert_allclose(times.min() / clock.per_s - measuring.BEGIN_S, clock.late_s, atol=1e-3)
        assert_allclose(first, true[0], atol=1e-9)
        spacing = np.abs(np.diff(times)).mean() / clock.per_s * clock.poses_hz
        assert spacing == pytest.approx(1 + clock.rate, abs=1e-4)
    else:
        assert (np.diff(times) < 0).sum() == 1


@pytest.fixture
def how(tmp_path):
    return SimpleNamespace(cache_dir=tmp_path, digest="d", options=planfit.RefineOptions())


@pytest.mark.parametrize("group", [CLOCKS, MOUNTS, NO_MOUNTS])
def test_a_case_of_each_group_is_right(group, how, monkeypatch):
    recording, motions = walked()
    monkeypatch.setattr(measuring, "walk_at_rate", lambda _: recording)
    monkeypatch.setattr(measuring, "piece", lambda *_: recording)
    monkeypatch.setattr(measuring, "_motions", lambda *_: motions)
    case = next(case for case in CASES if case.group == group)
    row = measure(case, how)
    assert (row.outcome, row.exit_code) == (RIGHT, 0), row


def test_wrong_and_asked_are_told_apart(how, monkeypatch):
    def refuse(*_):
        raise measuring.PlanfitError("say which")

    case = CASES[0]
    monkeypatch.setattr(measuring, "piece", refuse)
    assert measure(case, how).outcome == ASKED
    monkeypatch.setattr(measuring, "piece", lambda *_: None)
    row = measure(case, how)
    assert (row.outcome, row.exit_code) == (WRONG, 3)


def test_the_page_counts_and_names_what_is_not_right():
    rows = [
        Row(0, CASES[0].name, "d", 0, outcome=RIGHT, put_in="a", found="a"),
        Row(1, CASES[1].name, "d", 1, outcome=ASKED, put_in="b", found="or b", by_plan=RIGHT),
        Row(3, CASES[3].name, "d", 0, outcome=WRONG, put_in="c", found="d"),
    ]
    page = make_page(CASES, rows)
    assert f"| {UNITS} | even | 1 | 1 | 0 | 0 | 0 |" in page
    assert f"| {UNITS} | odd | 2 | 0 | 1 | 1 | 1 |" in page
    assert CASES[3].name in page
    assert CASES[0].name not in page
