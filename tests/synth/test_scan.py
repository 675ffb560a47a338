"""The synthetic scan as a scan: frames, truth, repeatability, and the way through the disk."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError, OutputError, ScanError
from planfit.floorplan import read_floorplan
from planfit.geometry import se3
from planfit.scan import Label, read_scan, read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    NoDepthNoise,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
    make_scan,
    write_facap,
)

SMALL = {
    "camera": CameraOptions(width_px=96, height_px=64),
    "walk": WalkOptions(n_frames=12),
}


def small(**options):
    return make_scan(SynthOptions(**(SMALL | options)))


def test_default_scan_is_a_scan():
    synthetic = small()
    scan = synthetic.scan
    assert len(scan) == 12
    assert scan.frame_ids[0] == "0001"
    assert_array_equal(scan.timestamps, np.arange(1, 13))
    assert scan.files.color(0).shape == (64, 96, 3)
    assert scan.files.color(0).dtype == np.uint8
    assert scan.files.depth(0).dtype == np.float32
    assert scan.files.labels(0).dtype == np.uint8
    assert {Label.FLOOR, Label.WALL} <= set(np.unique(scan.files.labels(3)))


def test_truth_is_in_the_axes_it_says():
    synthetic = small()
    assert_allclose(PLAN_FROM_WORLD @ synthetic.true_world_from_cams, synthetic.true_plan_from_cams,
                    atol=1e-12)  # fmt: skip
    assert_allclose(synthetic.true_plan_from_world, PLAN_FROM_WORLD, atol=1e-12)
    assert_allclose(synthetic.true_world_from_cams[:, 1, 3], 1.5, atol=0.2)  # y up


def test_drift_starts_at_the_truth_and_can_be_off():
    synthetic = small()
    assert_allclose(synthetic.scan.world_from_cams[0], synthetic.true_world_from_cams[0], atol=1e-9)
    gap = np.abs(synthetic.scan.world_from_cams[-1] - synthetic.true_world_from_cams[-1]).max()
    assert gap > 1e-3
    still = small(drift=DriftOptions(yaw_deg=0.0, translation_m=0.0))
    assert_allclose(still.scan.world_from_cams, still.true_world_from_cams, atol=1e-9)


def test_frames_are_the_same_in_any_order():
    one, two = small().scan.files, small().scan.files
    forth = [(one.color(i), one.depth(i), one.labels(i)) for i in range(4)]
    back = [(two.labels(i), two.depth(i), two.color(i)) for i in reversed(range(4))][::-1]
    for (color, depth, labels), (labels_2, depth_2, color_2) in zip(forth, back, strict=True):
        assert_array_equal(color, color_2)
        assert_array_equal(depth, depth_2)
        assert_array_equal(labels, labels_2)
    assert_array_equal(one.depth(2), forth[2][1])


def test_writing_into_a_frame_does_not_change_the_next_read():
    files = small(depth_noise=NoDepthNoise()).scan.files
    first = files.depth(1).copy(), files.labels(1).copy()
    files.depth(1)[:] = 0.0
    files.labels(1)[:] = 0
    assert_array_equal(files.depth(1), first[0])
    assert_array_equal(files.labels(1), first[1])


def test_same_options_same_scan_other_seed_other_scan():
    one, two, other = small(seed=3), small(seed=3), small(seed=4)
    assert_array_equal(one.scan.world_from_cams, two.scan.world_from_cams)
    assert_array_equal(one.floorplan.ends, two.floorplan.ends)
    assert one.scan.fingerprint == two.scan.fingerprint != other.scan.fingerprint
    assert one.floorplan.ends.shape != other.floorplan.ends.shape or not np.allclose(
        one.floorplan.ends, other.floorplan.ends
    )


def test_noise_does_not_change_building_or_walk():
    light, time = small(), small(depth_noise=TimeOfFlightNoise(), drift=DriftOptions(yaw_deg=1.0))
    assert_array_equal(light.true_plan_from_cams, time.true_plan_from_cams)
    assert_array_equal(light.scan.files.color(2), time.scan.files.color(2))
    assert np.nanmax(np.abs(light.scan.files.depth(2) - time.scan.files.depth(2))) > 0


def test_depth_noise_is_an_option():
    noisy, exact = small(), small(depth_noise=NoDepthNoise())
    view = exact.renderer.render(exact.scan.cameras[5], exact.true_plan_from_cams[5])
    assert_array_equal(exact.scan.files.depth(5), view.depth)
    error = noisy.scan.files.depth(5) - view.depth
    assert 0.0005 < np.nanstd(error) < 0.05


def test_moved_world_is_turned_about_the_vertical_and_not_told():
    synthetic = small(world="moved")
    plan_from_world = synthetic.true_plan_from_world
    assert synthetic.scan.plan_from_world_axes is None
    assert_allclose(plan_from_world[:3, :3] @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    assert np.abs(plan_from_world[:3, 3]).max() > 0.5
    assert np.abs(plan_from_world[:3, :3] - PLAN_FROM_WORLD[:3, :3]).max() > 0.05
    assert_allclose(plan_from_world @ synthetic.true_world_from_cams, synthetic.true_plan_from_cams,
                    atol=1e-9)  # fmt: skip


def test_labels_can_be_off():
    scan = small(has_labels=False).scan
    assert not scan.has_labels
    with pytest.raises(ScanError, match="has_labels"):
        scan.files.labels(0)


def test_camera_has_the_field_of_view():
    camera = small(camera=CameraOptions(100, 80, fov_deg=90.0)).scan.cameras[0]
    edges = camera.rays(np.array([[-0.5, 0.0], [99.5, 0.0]]))
    assert_allclose(edges[:, 0], [-1.0, 1.0])


def test_unknown_world_is_refused():
    with pytest.raises(OptionError, match="world"):
        SynthOptions(world="mars")  # pyright: ignore[reportArgumentType]
    with pytest.raises(OptionError, match="seed"):
        SynthOptions(seed=-1)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    synthetic = small(seed=2)
    path = tmp_path_factory.mktemp("scan") / "new"
    seen = []
    write_facap(path, synthetic, on_progress=lambda done, total: seen.append((done, total)))
    return path, synthetic, seen


def test_written_scan_reads_back(written):
    path, synthetic, seen = written
    scan = read_scan(path)
    assert seen == [(i, 12) for i in range(1, 13)]
    assert scan.frame_ids == synthetic.scan.frame_ids
    assert scan.has_labels
    assert_allclose(scan.world_from_cams, synthetic.scan.world_from_cams, atol=1e-8)
    camera, true_camera = scan.cameras[0], synthetic.scan.cameras[0]
    assert_allclose([camera.fx, camera.cx, camera.cy], [true_camera.fx, 47.5, 31.5], rtol=1e-7)
    for i in (0, 7):
        depth, true_depth = scan.files.depth(i), synthetic.scan.files.depth(i)
        assert_array_equal(np.isnan(depth), np.isnan(true_depth))
        assert np.nanmax(np.abs(depth - true_depth)) <= 0.00051
        difference = scan.files.color(i).astype(float) - synthetic.scan.files.color(i)
        assert np.abs(difference).mean() < 6
        labels = synthetic.scan.files.labels(i)
        # The layout has no mask for everything else.
        assert_array_equal(scan.files.labels(i), np.where(labels == Label.OTHER, 0, labels))


def test_written_plan_reads_back(written):
    path, synthetic, _ = written
    plan = read_floorplan(path / "floorplan.npy")
    assert_allclose(plan.ends, synthetic.floorplan.ends, atol=1e-12)
    assert_allclose(
        plan.normals[plan.is_oriented], synthetic.floorplan.normals[plan.is_oriented], atol=1e-9
    )


def test_written_truth_reads_back(written):
    path, synthetic, _ = written
    numbers, poses = read_tum(path / "groundtruth.tum")
    assert_array_equal(numbers, np.arange(1, 13))
    assert_allclose(poses, synthetic.true_world_from_cams, atol=1e-8)


def test_poses_are_written_as_the_layout_has_them(tmp_path, written):
    path, synthetic, _ = written
    synthetic.scan.files.write_poses(tmp_path, synthetic.scan.world_from_cams)
    assert (tmp_path / "pose-0003.txt").read_text() == (
        path / "arcore" / "pose-0003.txt"
    ).read_text()


def test_frames_do_not_depend_on_the_number_of_threads(tmp_path, written):
    path, synthetic, _ = written
    write_facap(tmp_path / "one", synthetic, n_threads=1)
    for file in sorted((path / "arcore").iterdir()):
        assert file.read_bytes() == (tmp_path / "one" / "arcore" / file.name).read_bytes()


def test_full_folders_and_moved_worlds_are_refused(tmp_path, written):
    path, synthetic, _ = written
    with pytest.raises(OutputError, match="empty or new folder"):
        write_facap(path, synthetic)
    with pytest.raises(OptionError, match="world"):
        write_facap(tmp_path / "moved", small(world="moved"))
    assert not (tmp_path / "moved").exists()


def test_without_labels_no_masks_are_written(tmp_path):
    synthetic = small(has_labels=False, walk=WalkOptions(n_frames=2))
    write_facap(tmp_path / "scan", synthetic)
    assert not (tmp_path / "scan" / "segmentation").exists()
    assert not read_scan(tmp_path / "scan").has_labels


def test_true_poses_of_the_scan_map_into_the_plan():
    synthetic = small(world="moved", depth_noise=NoDepthNoise())
    scan = synthetic.scan
    labels, depth = scan.files.labels(4), scan.files.depth(4)
    points = scan.cameras[4].lift_image(depth)[labels == Label.FLOOR]
    plan_from_cam = synthetic.true_plan_from_world @ synthetic.true_world_from_cams[4]
    assert_allclose(se3.transform(plan_from_cam, points)[:, 2], 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("seed", "n_rooms", "n_quads", "centre", "quad_sum", "seeds", "color_sum", "depth_sum"),
    [
        (0, 4, 888, (3.269493546164359, 5.470518068508973, 1.5106519616142051), 7397.955303303968,
         (4324570511989843741, 4516311196764656904), 2254101, 12400.160),
        (1, 7, 1504, (8.85265919333605, 6.590590061803159, 1.499241054407934), 18533.45987140294,
         (215147191440313793, 719433196919304227), 2838754, 12952.865),
    ],
)  # fmt: skip
def test_scans_of_old_seeds_stay_as_they_were(
    seed, n_rooms, n_quads, centre, quad_sum, seeds, color_sum, depth_sum
):
    """Recorded from planfit 4ea2412: new options of buildings and walks change no scan that lacks them."""
    options = SynthOptions(
        seed=seed,
        building=BuildingOptions(n_rooms=n_rooms, n_columns=seed, yaw_deg=10.0 * seed),
        walk=WalkOptions(n_frames=40),
        camera=CameraOptions(width_px=96, height_px=64),
    )
    synthetic = make_scan(options)
    quads = synthetic.renderer.quads
    assert len(quads) == n_quads
    assert_allclose(synthetic.true_plan_from_cams[17, :3, 3], centre, atol=1e-9)
    assert_allclose(quads.origin.sum(), quad_sum, rtol=1e-9)
    assert tuple(int(v) for v in quads.seed[[0, -1]]) == seeds
    assert_allclose(synthetic.scan.files.color(7).sum(dtype=int), color_sum, rtol=1e-5)
    assert_allclose(np.nansum(synthetic.scan.files.depth(7)), depth_sum, rtol=1e-5)
