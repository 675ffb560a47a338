"""Another visit to one building: walls stay, walk and world are others, furniture if one likes."""

import numpy as np

from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan


def visit(number, refurnished=0):
    return make_scan(
        SynthOptions(
            seed=4,
            visit=number,
            world="moved",
            building=BuildingOptions(n_rooms=2, refurnished=refurnished),
            walk=WalkOptions(n_frames=12),
            camera=CameraOptions(width_px=64, height_px=48),
        )
    )


def test_another_visit_is_another_walk_in_the_same_building():
    first, again, second = visit(0), visit(0), visit(1)
    np.testing.assert_array_equal(first.scan.world_from_cams, again.scan.world_from_cams)
    np.testing.assert_array_equal(first.floorplan.ends, second.floorplan.ends)
    assert first.building.furniture == second.building.furniture
    assert np.abs(first.true_plan_from_cams - second.true_plan_from_cams).max() > 0.1
    assert np.abs(first.true_plan_from_world - second.true_plan_from_world).max() > 0.1


def test_rooms_are_furnished_anew_and_nothing_else_changes():
    before, after = visit(0), visit(0, refurnished=1)
    np.testing.assert_array_equal(before.floorplan.ends, after.floorplan.ends)
    assert before.building.furniture != after.building.furniture
    assert visit(0, refurnished=2).building.furniture != after.building.furniture
    # Where no furniture is in the way, both see the same walls with the same pictures.
    camera, pose = before.scan.cameras[0], before.true_plan_from_cams[0]
    views = [synthetic.renderer.render(camera, pose) for synthetic in (before, after)]
    same_depth = np.abs(views[0].depth - views[1].depth) < 1e-6
    assert 0.1 < same_depth.mean() < 1.0
    assert np.mean(np.abs(views[0].color - views[1].color)[same_depth].astype(float)) < 1.0
