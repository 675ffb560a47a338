"""Each kind of evidence, alone, turns the verdict as it should."""

import re

import numpy as np
import pytest

from planfit.adjust import TornStep
from planfit.alignment import AdjustedAlignment
from planfit.pipeline.verdict import Outcome, judge
from planfit.pipeline.verdict_options import VerdictOptions
from planfit.tracking import TrackingDoubt
from verdicts import make_evidence, make_stretch, make_verdict, make_visit


def stretches(changed, **changes):
    return tuple(make_stretch(k, **(changes if k in changed else {})) for k in range(5))


def test_good_evidence_is_refined():
    verdict = make_verdict()
    assert verdict.outcome == "refined"
    assert verdict.is_refined
    assert verdict.reservations == ()
    assert verdict.headline.startswith("refined: cameras were moved by 0.50 m")
    assert "within about 0.03 m" in verdict.headline


@pytest.mark.parametrize(
    ("changes", "frames", "words"),
    [
        (
            {"stretches": stretches({2, 3}, predicted_m=0.5, open_direction=(1.0, 0.0))},
            ((20, 39),),
            r"frames 20-39 are not fixed along the plan's direction \(1.00, 0.00\): .* off by 0.50 m",
        ),
        (
            {"unplaced": ((5, 9), (30, 30))},
            ((5, 9), (30, 30)),
            "frames 5-9 and 30 have no place: tracking was lost there",
        ),
        (
            {"tracking_doubt": TrackingDoubt("poses repeat while the images move", "export again")},
            ((0, 49),),
            "poses repeat while the images move$",
        ),
        (
            {"torn": (TornStep((12, 13), 0.5, 2.4, 2.0, 30.0, 90.0),)},
            ((12, 13),),
            "torn at frames 12-13: .* 2.0 m and",
        ),
        (
            {"leaps": ((30, 31),)},
            ((30, 31),),
            "the walk leaps at frames 30-31, further than any walk does",
        ),
        (
            {"stretches": stretches({0, 1}, near_kept_out=0.0), "visits": ()},
            ((0, 19),),
            "frames 0-19 are confirmed by nothing: 0% of their 40 wall patches",
        ),
        (
            {"stretches": stretches(set(range(5)), near_kept_out=0.4), "visits": (), "scan_costs": {}},
            ((0, 49),),
            "nothing but walls corrects the recorded motion, .* only 40% of the wall patches",
        ),
        ({"visits": (make_visit(after_m=0.8),)}, ((0, 9), (40, 49)), "1 contradict the result, by 0.8 m"),
        ({"scan_costs": {"points": (300.0, 400.0)}}, ((0, 49),), "misfit of the points rises 1.3 times"),
        ({"predicted_error_m": np.full(50, 0.15)}, ((0, 49),), "all frames may be off by 0.15 m"),
        ({"is_placed": False, "alignment": None}, ((0, 49),), "not placed on the plan"),
    ],
)  # fmt: skip
def test_what_reserves(changes, frames, words):
    verdict = make_verdict(**changes)
    assert verdict.outcome == "improved"
    assert not verdict.is_refined
    (reservation,) = verdict.reservations
    assert reservation.frames == frames
    assert re.search(words, reservation.words)
    assert verdict.headline.startswith("improved, with reservations: ")
    assert reservation.advice in verdict.headline


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"alignment": AdjustedAlignment(0.3, 0.3, 0.2, "it fits elsewhere")}, "it fits elsewhere"),
        ({"visits": (make_visit(before_m=0.1, kept_out_m=0.2),)}, "from 0.100 to 0.200 m"),
        ({"stretches": stretches(range(5), near_before=0.97)}, "from 97% to 90% on it"),
        (
            {"predicted_error_m": np.full(50, 0.4)},
            "0.40 m, is too large a part of what was corrected, 0.50 m",
        ),
    ],
)
def test_what_is_no_better(changes, words):
    verdict = make_verdict(**changes)
    assert verdict.outcome is Outcome.NO_BETTER
    assert words in verdict.headline
    assert "use the recorded poses" in verdict.headline
    assert "use the recorded poses" in verdict.advice


def test_a_large_correction_with_a_large_error_is_an_improvement_nevertheless():
    moved = make_verdict(correction_m=np.full(50, 5.0), predicted_error_m=np.full(50, 0.5))
    assert moved.outcome == "improved"


def test_poses_that_were_right_are_refined():
    right = make_verdict(
        correction_m=np.full(50, 0.01), visits=(make_visit(before_m=0.02, kept_out_m=0.03),)
    )
    assert right.is_refined


def test_unexplained_walls_between_confirmed_ones_tell_only_where_no_wall_is_near():
    def judged(which, **changes):
        found = stretches(which, near_kept_out=0.0, **changes)
        return make_verdict(stretches=found, visits=()).is_refined

    assert judged({2})
    assert judged({2, 3}, beside=0.9)  # moved walls
    assert not judged({2, 3}, beside=0.1)
    assert judged({2, 3}, beside=0.1, n_patches=4)


def test_a_visit_confirms_a_stretch_whose_walls_the_plan_lacks():
    lacking = stretches({0}, near_kept_out=0.0)
    assert not make_verdict(stretches=lacking, visits=()).is_refined
    assert make_verdict(stretches=lacking).is_refined
    assert not make_verdict(stretches=lacking, visits=(make_visit(kept_out_m=0.6),)).is_refined


def test_a_plan_that_lacks_walls_everywhere_says_nothing_of_one_stretch():
    poor = stretches({1, 2, 3, 4}, near_kept_out=0.4)
    ends = (make_stretch(0, near_kept_out=0.0), *poor[1:])
    assert make_verdict(stretches=ends, visits=()).is_refined


def test_few_contradicted_visits_are_an_accident():
    good = tuple(make_visit() for _ in range(3))
    assert make_verdict(visits=(*good, make_visit(after_m=0.8))).is_refined
    assert not make_verdict(visits=(*good[:2], make_visit(after_m=0.8))).is_refined


@pytest.mark.parametrize(
    ("options", "outcome"),
    [
        (VerdictOptions(), "refined"),
        (VerdictOptions(max_error_m=0.02), "improved"),
        (VerdictOptions(max_stretch_error_m=0.02), "improved"),
    ],
)
def test_thresholds_are_options(options, outcome):
    assert judge(make_evidence(), options).outcome == outcome


def test_without_a_plan_more_is_allowed_and_few_visits_say_nothing_against(monkeypatch):
    def outcome(is_alone, **changes):
        return make_verdict(is_alone=is_alone, **changes).outcome

    error = {"predicted_error_m": np.full(50, 0.15)}
    assert outcome(False, **error) == "improved"
    assert outcome(True, **error) == "refined"
    less_moved = {"predicted_error_m": np.full(50, 0.22), "correction_m": np.full(50, 0.3)}
    assert outcome(False, **less_moved) == "no better"
    assert outcome(True, **less_moved) == "improved"
    assert outcome(True, **(less_moved | {"correction_m": np.full(50, 0.2)})) == "no better"
    apart = make_visit(before_m=0.1, kept_out_m=0.2)
    assert outcome(False, visits=(apart,)) == "no better"
    assert outcome(True, visits=(apart,)) == "refined"
    assert outcome(True, visits=(apart,) * 3) == "no better"
    monkeypatch.setattr("planfit.pipeline.verdict.ALONE_FACTOR", 1.0)
    judged = judge(make_evidence(is_alone=True, **error), VerdictOptions())
    assert judged.outcome == "improved"


def test_walls_are_named_where_the_scan_fits_in_two_ways():
    walls = tuple(f"the wall at ({k}.0, 0.0)-({k}.0, 3.0): 0.30 m towards +x" for k in range(5))
    unsure = {"predicted_error_m": np.full(50, 0.25), "correction_m": np.full(50, 2.0)}
    verdict = make_verdict(rival_error_m=0.2, moved_walls=walls, **unsure)
    assert verdict.outcome == "improved"
    first = verdict.reservations[0]
    assert first.walls == walls
    assert "0.20 m (RMS) elsewhere" in first.words
    assert all(name in first.words for name in (*walls[:3], "2 more"))
    assert walls[3] not in first.words
    assert "measure one of these walls" in verdict.advice
    bare = make_verdict(rival_error_m=0.2, **unsure).reservations[0]
    assert "moved" not in bare.words
    assert bare.advice.startswith("check the plan")


def test_a_scan_that_fits_in_two_places_is_better_than_recorded_in_either():
    half_metre = {"correction_m": np.full(50, 0.5), "predicted_error_m": np.full(50, 0.25)}
    assert make_verdict(rival_error_m=0.24, **half_metre).outcome == "improved"
    assert make_verdict(rival_error_m=0.1, **half_metre).outcome == "no better"
    little = {"correction_m": np.full(50, 0.3), "predicted_error_m": np.full(50, 0.25)}
    assert make_verdict(rival_error_m=0.24, **little).outcome == "no better"


def test_moved_walls_alone_are_no_reservation():
    assert make_verdict(moved_walls=("the wall at ...",), rival_error_m=0.05).is_refined


def test_poses_that_say_nothing_are_not_recommended():
    doubt = TrackingDoubt("the poses never change", "export the scan again")
    verdict = make_verdict(
        alignment=AdjustedAlignment(0.9, 0.4, 0.0, doubt="elsewhere"), tracking_doubt=doubt
    )
    assert verdict.outcome is Outcome.NO_BETTER
    assert verdict.headline.endswith("can be used, as the poses never change")
    assert "use the recorded poses" not in verdict.headline
    assert verdict.advice == "export the scan again"


def test_frames_without_a_place_do_not_count_in_the_predicted_error():
    predicted_m = np.full(50, 0.03)
    predicted_m[5:10] = 9.0
    changes = {"predicted_error_m": predicted_m}
    assert make_verdict(**changes).outcome is Outcome.NO_BETTER
    assert make_verdict(**changes, unplaced=((5, 9),)).outcome is Outcome.IMPROVED
