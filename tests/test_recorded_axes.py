"""Of which plans a scan's recorded poses are believed to be in the plan's axes."""

import dataclasses

import numpy as np
import pytest

from builders import room_plan
from planfit.errors import OptionError
from planfit.floorplan import PlanSource
from planfit.pipeline.align import claimed_alignment
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

LEVEL_FROM_WORLD = PLAN_FROM_WORLD


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """Its format says that poses are in the plan's axes; its folder has a plan."""
    small = SynthOptions(
        building=BuildingOptions(n_rooms=1, furniture_per_room=0),
        walk=WalkOptions(n_frames=4),
        camera=CameraOptions(width_px=32, height_px=24),
    )
    path = tmp_path_factory.mktemp("scan") / "floorplan.npy"
    return dataclasses.replace(make_scan(small).scan, floorplan_path=path)


def plan_of(name, kind, **changes):
    plan = room_plan(name=str(name))
    source = PlanSource(kind=kind, is_mirrored=changes.pop("is_mirrored", False))
    return dataclasses.replace(plan, source=source, **changes)


def test_the_plan_in_the_folder_of_the_scan_is_in_its_axes(scan):
    plan = plan_of(scan.floorplan_path, "segments (.npy)")
    claimed = claimed_alignment(scan, plan, LEVEL_FROM_WORLD)
    np.testing.assert_allclose(claimed, np.eye(4), atol=1e-12)


def test_so_are_arrays_of_the_callers_own(scan):
    assert claimed_alignment(scan, plan_of("segments", ""), LEVEL_FROM_WORLD) is not None


@pytest.mark.parametrize("kind", ["raster picture, walls solid", "DXF drawing", "segments (.npy)"])
def test_a_plan_from_elsewhere_is_not_unless_the_user_says_so(scan, kind):
    plan = plan_of("elsewhere/plan", kind)
    assert claimed_alignment(scan, plan, LEVEL_FROM_WORLD) is None
    assert claimed_alignment(scan, plan, LEVEL_FROM_WORLD, "plan") is not None


@pytest.mark.parametrize("changes", [{"is_metric": False}, {"is_mirrored": True}])
def test_a_plan_that_is_not_as_drawn_never_is(scan, changes):
    plan = plan_of(scan.floorplan_path, "segments (.npy)", **changes)
    assert claimed_alignment(scan, plan, LEVEL_FROM_WORLD) is None
    with pytest.raises(OptionError, match=r"align\.recorded-axes plan"):
        claimed_alignment(scan, plan, LEVEL_FROM_WORLD, "plan")


def test_a_user_may_deny_it(scan):
    plan = plan_of(scan.floorplan_path, "segments (.npy)")
    assert claimed_alignment(scan, plan, LEVEL_FROM_WORLD, "own") is None


def test_a_scan_whose_format_says_nothing_claims_nothing(scan):
    plan = plan_of(scan.floorplan_path, "segments (.npy)")
    bare = dataclasses.replace(scan, plan_from_world_axes=None)
    assert claimed_alignment(bare, plan, LEVEL_FROM_WORLD) is None
    with pytest.raises(OptionError, match="FACaP"):
        claimed_alignment(bare, plan, LEVEL_FROM_WORLD, "plan")
