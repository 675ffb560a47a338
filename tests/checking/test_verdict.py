"""Each kind of evidence, alone, turns the verdict as it should."""

import numpy as np
import pytest

from planfit.adjust import TornStep
from planfit.alignment import AdjustedAlignment
from planfit.findings import Finding, PlanKind, PoseKind, ResultKind
from planfit.pipeline.verdict import Outcome, judge
from planfit.pipeline.verdict_options import VerdictOptions
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


ALL = ((0, 49),)
DOUBT = Finding(PoseKind.POSES_REPEAT, {"repeated_count": 40, "frame_count": 50})
ELSEWHERE = Finding(PlanKind.ADJUSTED_FITS_ELSEWHERE, {"wall_share": 0.3, "other_wall_share": 0.3})


@pytest.mark.parametrize(
    ("changes", "kind", "frames", "facts"),
    [
        (
            {"stretches": stretches({2, 3}, predicted_m=0.5, open_direction=(1.0, 0.0))},
            ResultKind.FRAMES_NOT_FIXED,
            ((20, 39),),
            {"predicted_m": 0.5, "direction": (1.0, 0.0)},
        ),
        (
            {"unplaced": ((5, 9), (30, 30))},
            ResultKind.FRAMES_WITHOUT_PLACE,
            ((5, 9), (30, 30)),
            {},
        ),
        ({"tracking_doubt": DOUBT}, PoseKind.POSES_REPEAT, ALL, DOUBT.facts),
        (
            {"torn": (TornStep((12, 13), 0.5, 2.4, 2.0, 30.0, 90.0),)},
            ResultKind.PATH_TORN,
            ((12, 13),),
            {"departure_m": 2.0, "departure_deg": 30.0},
        ),
        ({"leaps": ((30, 31),)}, ResultKind.WALK_LEAPS, ((30, 31),), {}),
        (
            {"stretches": stretches({0, 1}, near_kept_out=0.0), "visits": ()},
            ResultKind.FRAMES_UNCONFIRMED,
            ((0, 19),),
            {"near_share": 0.0, "near_share_elsewhere": pytest.approx(0.9), "patch_count": 40},
        ),
        (
            {"stretches": stretches(set(range(5)), near_kept_out=0.4), "visits": (), "scan_costs": {}},
            ResultKind.WALLS_ALONE,
            ALL,
            {"near_share": pytest.approx(0.4)},
        ),
        (
            {"visits": (make_visit(after_m=0.8),)},
            ResultKind.REVISITS_CONTRADICT_RESULT,
            ((0, 9), (40, 49)),
            {"revisit_count": 1, "contradicted_count": 1, "distance_m": 0.8},
        ),
        (
            {"scan_costs": {"points": (300.0, 400.0)}},
            ResultKind.PLAN_STRAINS_TERM,
            ALL,
            {"term": "points", "misfit_ratio": pytest.approx(4 / 3)},
        ),
        (
            {"predicted_error_m": np.full(50, 0.15)},
            ResultKind.ALL_MAY_BE_OFF,
            ALL,
            {"predicted_rms_m": pytest.approx(0.15)},
        ),
        ({"is_placed": False, "alignment": None}, ResultKind.NOT_PLACED, ALL, {}),
    ],
)  # fmt: skip
def test_what_reserves(changes, kind, frames, facts):
    verdict = make_verdict(**changes)
    assert verdict.outcome == "improved"
    assert not verdict.is_refined
    (reservation,) = verdict.reservations
    assert reservation.kind is kind
    assert reservation.severity == "reservation"
    assert reservation.frames == frames
    assert reservation.facts == facts
    first = f"{reservation.words}; {reservation.advice}"
    assert verdict.headline == f"improved, with reservations: {first}"


@pytest.mark.parametrize(
    ("changes", "kind", "facts"),
    [
        ({"alignment": AdjustedAlignment(0.3, 0.3, 0.2, ELSEWHERE)}, ResultKind.PLACE_NOT_CERTAIN, {}),
        (
            {"visits": (make_visit(before_m=0.1, kept_out_m=0.2),)},
            ResultKind.REVISITS_CAME_APART,
            {"before_m": 0.1, "after_m": 0.2},
        ),
        (
            {"stretches": stretches(range(5), near_before=0.97)},
            ResultKind.WALLS_LEFT_PLAN,
            {"before_share": pytest.approx(0.97), "after_share": pytest.approx(0.9)},
        ),
        (
            {"predicted_error_m": np.full(50, 0.4)},
            ResultKind.ERROR_TOO_LARGE,
            {"predicted_rms_m": pytest.approx(0.4), "moved_rms_m": pytest.approx(0.5)},
        ),
    ],
)  # fmt: skip
def test_what_is_no_better(changes, kind, facts):
    verdict = make_verdict(**changes)
    assert verdict.outcome is Outcome.NO_BETTER
    assert verdict.because[0].kind is kind
    assert verdict.because[0].severity == "against"
    assert verdict.because[0].facts == facts
    assert verdict.headline == f"no better: use the recorded poses, as {verdict.reasons[0]}"
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
    ],
)
def test_the_threshold_is_an_option(options, outcome):
    assert judge(make_evidence(), options).outcome == outcome


def test_a_stretch_that_may_be_further_off_is_a_reservation(monkeypatch):
    monkeypatch.setattr("planfit.pipeline.reservations.MAX_STRETCH_ERROR_M", 0.02)
    assert make_verdict().outcome == "improved"


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
    monkeypatch.setattr("planfit.pipeline.reservations.ALONE_FACTOR", 1.0)
    judged = judge(make_evidence(is_alone=True, **error), VerdictOptions())
    assert judged.outcome == "improved"


def moved_wall(k):
    ends = {"from_xy_m": (k, 0.0), "to_xy_m": (k, 3.0), "normal": (1.0, 0.0)}
    facts = ends | {"offset_m": 0.3, "sigma_m": 0.01, "patch_count": 4}
    return Finding(ResultKind.WALL_MOVED, facts, faces=(k,))


def test_walls_are_named_where_the_scan_fits_in_two_ways():
    walls = tuple(moved_wall(k) for k in range(5))
    unsure = {"predicted_error_m": np.full(50, 0.25), "correction_m": np.full(50, 2.0)}
    verdict = make_verdict(rival_error_m=0.2, moved_walls=walls, **unsure)
    assert verdict.outcome == "improved"
    first = verdict.reservations[0]
    assert first.kind is ResultKind.FITS_ELSEWHERE
    assert first.parts == walls
    assert first.faces == (0, 1, 2, 3, 4)
    assert all(name in first.words for name in (*(wall.sentence for wall in walls[:3]), "2 more"))
    assert walls[3].sentence not in first.words
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
    assert make_verdict(moved_walls=(moved_wall(1),), rival_error_m=0.05).is_refined


def test_poses_that_say_nothing_are_not_recommended():
    elsewhere = AdjustedAlignment(0.9, 0.4, 0.0, doubt=ELSEWHERE)
    verdict = make_verdict(alignment=elsewhere, tracking_doubt=DOUBT)
    assert verdict.outcome is Outcome.NO_BETTER
    assert verdict.headline.endswith(f"can be used, as {DOUBT.words}")
    assert "use the recorded poses" not in verdict.headline
    assert verdict.advice == DOUBT.advice


def test_frames_without_a_place_do_not_count_in_the_predicted_error():
    predicted_m = np.full(50, 0.03)
    predicted_m[5:10] = 9.0
    changes = {"predicted_error_m": predicted_m}
    assert make_verdict(**changes).outcome is Outcome.NO_BETTER
    assert make_verdict(**changes, unplaced=((5, 9),)).outcome is Outcome.IMPROVED
