"""Each kind of evidence, alone, turns the verdict as it should."""

import numpy as np
import pytest

from planfit.adjust import TornStep
from planfit.alignment import AdjustedAlignment
from planfit.findings import Finding, PlanKind, PoseKind, ResultKind
from planfit.pipeline.verdict import Outcome
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
            {
                "stretches": stretches({2, 3}, predicted_m=0.5, open_direction=(1.0, 0.0)),
                "predicted_error_m": np.repeat([0.03, 0.5, 0.03], [20, 20, 10]),
            },
            ResultKind.FRAMES_NOT_FIXED,
            ((20, 39),),
            {
                "predicted_m": 0.5,
                "direction": (1.0, 0.0),
                "within_share": pytest.approx(0.0344, abs=1e-4),
                "tolerance_m": 0.15,
            },
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
            {"predicted_error_m": np.full(50, 0.12)},
            ResultKind.ALL_MAY_BE_OFF,
            ALL,
            {
                "predicted_rms_m": pytest.approx(0.12),
                "within_share": pytest.approx(0.8038, abs=1e-4),
                "tolerance_m": 0.15,
            },
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
            {"predicted_error_m": np.full(50, 0.6)},
            ResultKind.ERROR_TOO_LARGE,
            {"predicted_rms_m": pytest.approx(0.6), "moved_rms_m": pytest.approx(0.5)},
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


@pytest.mark.parametrize(
    ("score", "runner_up", "is_tie"), [(0.98, 0.97, True), (0.98, 0.6, False), (0.8, 0.97, False)]
)
def test_where_several_places_explain_the_walls_the_overlay_is_to_decide(score, runner_up, is_tie):
    verdict = make_verdict(alignment=AdjustedAlignment(score, runner_up, 0.0, ELSEWHERE))
    assert verdict.outcome is Outcome.NO_BETTER
    several, uncertain = ResultKind.PLACE_OF_SEVERAL, ResultKind.PLACE_NOT_CERTAIN
    assert verdict.because[0].kind is (several if is_tie else uncertain)
    assert verdict.headline.endswith(several.message.advice) == is_tie
    assert ("use the recorded poses" in verdict.headline) != is_tie
    assert (verdict.advice == several.message.advice) == is_tie
    assert verdict.has_rival


def test_a_large_correction_with_a_large_error_is_an_improvement_nevertheless():
    moved = make_verdict(correction_m=np.full(50, 5.0), predicted_error_m=np.full(50, 0.5))
    assert moved.outcome == "improved"


def test_poses_that_were_right_are_refined():
    right = make_verdict(
        correction_m=np.full(50, 0.01), visits=(make_visit(before_m=0.02, kept_out_m=0.03),)
    )
    assert right.is_refined


def test_a_stretch_whose_walls_the_plan_lacks_is_held_by_the_rest():
    lacking = stretches({0, 4}, near_kept_out=0.0)
    assert make_verdict(stretches=lacking, visits=()).is_refined


def test_few_contradicted_visits_are_an_accident():
    good = tuple(make_visit() for _ in range(3))
    assert make_verdict(visits=(*good, make_visit(after_m=0.8))).is_refined
    assert not make_verdict(visits=(*good[:2], make_visit(after_m=0.8))).is_refined


@pytest.mark.parametrize(("tolerance_m", "outcome"), [(0.15, "refined"), (0.04, "improved")])
def test_the_tolerance_is_the_users(tolerance_m, outcome):
    assert make_verdict(tolerance_m=tolerance_m).outcome == outcome


@pytest.mark.parametrize(("n_sure", "outcome"), [(48, "refined"), (46, "improved")])
def test_95_of_100_frames_are_to_lie_within_the_tolerance(n_sure, outcome):
    """Frames that are spread over the walk, so that no stretch of it is worse than the others."""
    predicted_m = np.full(50, 0.01)
    predicted_m[np.linspace(4, 44, 50 - n_sure).astype(int)] = 9.0
    verdict = make_verdict(predicted_error_m=predicted_m, correction_m=np.full(50, 5.0))
    assert verdict.outcome == outcome


def test_what_is_expected_within_the_tolerance_is_what_errors_drawn_from_the_covariance_are():
    evidence = make_evidence(predicted_error_m=np.linspace(0.02, 0.3, 50))
    rng = np.random.default_rng(3)
    drawn = [
        rng.multivariate_normal(np.zeros(3), covariance[3:, 3:], 4000)
        for covariance in evidence.pose_covariances
    ]
    share = np.mean(np.linalg.norm(drawn, axis=2) < 0.15)
    assert evidence.share_within(0.15) == pytest.approx(share, abs=0.005)


def test_a_short_stretch_that_is_likelier_off_is_named_in_a_result_that_is_vouched_for():
    predicted_m = np.full(200, 0.02)
    predicted_m[:8] = 0.4
    found = (make_stretch(0, frames=(0, 7), predicted_m=0.4), make_stretch(1, frames=(8, 199)))
    verdict = make_verdict(200, stretches=found, predicted_error_m=predicted_m)
    assert [r.frames for r in verdict.reservations] == [((0, 7),)]


def test_without_a_plan_few_visits_say_nothing_against():
    def outcome(is_alone, **changes):
        return make_verdict(is_alone=is_alone, **changes).outcome

    apart = make_visit(before_m=0.1, kept_out_m=0.2)
    assert outcome(False, visits=(apart,)) == "no better"
    assert outcome(True, visits=(apart,)) == "refined"
    assert outcome(True, visits=(apart,) * 3) == "no better"


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


def test_an_error_that_is_not_mostly_of_another_place_is_told_of_frames():
    unsure = {"predicted_error_m": np.full(50, 0.25), "correction_m": np.full(50, 2.0)}
    (first,) = make_verdict(rival_error_m=0.15, **unsure).reservations
    assert first.kind is ResultKind.ALL_MAY_BE_OFF


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
