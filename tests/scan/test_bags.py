"""ROS 1 and 2 bags and MCAP: topics by name or guessed, poses from tf or a topic."""

import random

import numpy as np
import pytest
from bag_writer import (
    BODY_FRAME,
    BODY_FROM_CAM,
    COLOR_FRAME,
    TF_KINDS,
    BagWriter,
    write_images,
    write_tf,
)
from numpy.testing import assert_allclose, assert_array_equal
from rtabmap_writer import inverse_png, rvl

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import ScanOptions, read_scan, read_tum, write_tum
from planfit.scan.poses import poses_at
from scan_samples import HEIGHT, WIDTH, N

KINDS = {"ros1": (1, None), "sqlite": (2, "sqlite"), "mcap": (2, "mcap")}


def write_bag(tmp_path, kind, *steps):
    ros, storage = KINDS[kind]
    path = tmp_path / ("scan.bag" if ros == 1 else "scan")
    bag = BagWriter(path, ros, storage)
    with bag.writer:
        for step in steps:
            step(bag)
    return path


def assert_is_sample(scan, sample, atol=1e-6):
    assert len(scan) == N
    assert_allclose(scan.world_from_cams, sample.poses, atol=atol)
    assert_allclose(scan.timestamps, sample.times, atol=1e-6)
    for i in (0, 3, 1, N - 1):
        assert_array_equal(scan.files.color(i), sample.color[i])
        depth = sample.depth_mm[i] / 1000.0
        assert_allclose(scan.files.depth(i), np.where(depth > 0, depth, np.nan), atol=1e-5)
    camera = scan.cameras[0]
    assert (camera.fx, camera.cy) == (sample.camera.fx, sample.camera.cy)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("compressed", [False, True])
def test_a_bag_with_tf(kind, compressed, sample, tmp_path):
    path = write_bag(tmp_path, kind, lambda b: write_images(b, sample, compressed),
                     lambda b: write_tf(b, sample))  # fmt: skip
    scan = read_scan(path)
    assert scan.format == "bag"
    assert scan.warnings == ()
    assert_is_sample(scan, sample)


@pytest.mark.parametrize("lack", ["colour", "depth"])
def test_frames_that_lack_an_image_come_out_with_poses(lack, sample, tmp_path):
    topic = {"colour": "/camera/color", "depth": "/camera/aligned"}[lack]

    class Without:
        """Messages but for the third image of a topic."""

        def __init__(self, bag):
            self.bag, self.seen = bag, 0

        def image(self, name, *message, **more):
            self.seen += name.startswith(topic)
            if self.seen != 3 or not name.startswith(topic):
                self.bag.image(name, *message, **more)

        def info(self, *message):
            self.bag.info(*message)

    path = write_bag(tmp_path, "ros1", lambda b: write_images(Without(b), sample),
                     lambda b: write_tf(b, sample))  # fmt: skip
    scan = read_scan(path)
    assert scan.lacking == ("", "", lack, "", "", "")
    assert scan.skipped == ()
    expected, _ = poses_at(sample.times, sample.poses, scan.timestamps, 0.02)
    assert_allclose(
        scan.world_from_cams, expected, atol=0.06
    )  # tf is interpolated, not its product
    assert (scan.files.color(2) is None) == (lack == "colour")
    assert np.isnan(scan.files.depth(2)).all() == (lack == "depth")
    assert any(f"have no {lack}" in warning for warning in scan.warnings)


def compressed_rvl(depth_mm):
    return bytes(12) + rvl(depth_mm)[8:], "16UC1; compressedDepth rvl"


def compressed_inverse(depth_mm):
    """Metres as 32FC1: quantised inverse depth, by two numbers in the header."""
    data = inverse_png(depth_mm)
    return bytes(4) + data[8:16] + data[16:], "32FC1; compressedDepth png"


@pytest.mark.parametrize(
    ("compressed_depth", "relative"), [(compressed_rvl, 1e-6), (compressed_inverse, 2e-3)]
)
def test_every_code_of_compressed_depth(compressed_depth, relative, sample, tmp_path):
    def images(bag):
        write_images(bag, sample, compressed=True, compressed_depth=compressed_depth)

    path = write_bag(tmp_path, "sqlite", images, lambda bag: write_tf(bag, sample))
    depth = sample.depth_mm[1] / 1000
    assert_allclose(
        read_scan(path).files.depth(1), np.where(depth > 0, depth, np.nan), rtol=relative
    )


def test_compressed_depth_that_is_damaged(sample, tmp_path):
    def images(bag):
        write_images(
            bag, sample, True, lambda mm: (compressed_rvl(mm)[0][:60], "16UC1; compressedDepth rvl")
        )

    path = write_bag(tmp_path, "sqlite", images, lambda bag: write_tf(bag, sample))
    with pytest.raises(ScanError, match="128 x 96 px of depth in RVL code, found a damaged one"):
        read_scan(path)


def test_the_old_name_of_tf(sample, tmp_path):
    def poses(bag):
        for time, pose in zip(sample.times, sample.poses, strict=True):
            bag.tf("/tf", time, "/world", f"/{COLOR_FRAME}", pose, TF_KINDS[1])

    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample), poses)
    assert_is_sample(read_scan(path), sample)


def test_a_single_mcap_file(sample, tmp_path):
    path = write_bag(
        tmp_path, "mcap", lambda b: write_images(b, sample), lambda b: write_tf(b, sample)
    )
    (file,) = path.glob("*.mcap")
    alone = tmp_path / "alone.mcap"
    alone.write_bytes(file.read_bytes())
    assert_is_sample(read_scan(alone), sample)


def test_odometry_of_a_body_is_carried_over_to_the_camera(sample, tmp_path):
    def poses(bag):
        bag.tf("/tf_static", sample.times[0], BODY_FRAME, COLOR_FRAME, BODY_FROM_CAM)
        for time, pose in zip(sample.times, sample.poses, strict=True):
            body = pose @ np.linalg.inv(BODY_FROM_CAM)
            bag.odometry("/odom", time, "odom", BODY_FRAME, body)

    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample), poses)
    scan = read_scan(path, options=ScanOptions(pose_topic="/odom"))
    assert scan.warnings == ()
    assert_is_sample(scan, sample)


@pytest.mark.parametrize("has_child", [True, False])
def test_poses_of_a_topic_are_taken_where_tf_is_static(has_child, sample, tmp_path):
    """Odometry, and PoseStamped, which does not say of what it is."""

    def poses(bag):
        bag.tf("/tf_static", sample.times[0], BODY_FRAME, COLOR_FRAME, BODY_FROM_CAM)
        for time, pose in zip(sample.times, sample.poses, strict=True):
            body = pose @ np.linalg.inv(BODY_FROM_CAM)
            if has_child:
                bag.odometry("/odom", time, "odom", BODY_FRAME, body)
            else:
                bag.pose_stamped("/pose", time, "map", body)

    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample), poses)
    scan = read_scan(path)
    assert "as tf is static" in scan.warnings[0]
    assert len(scan.warnings) == (1 if has_child else 2)
    assert_is_sample(scan, sample)


def test_tf_without_its_static_part_is_told(sample, tmp_path):
    def poses(bag):
        for time, pose in zip(sample.times, sample.poses, strict=True):
            bag.tf("/tf", time, "map", BODY_FRAME, pose)

    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample), poses)
    with pytest.raises(ScanError, match="no /tf_static was recorded"):
        read_scan(path)


def test_a_lens_from_a_file(sample, tmp_path):
    def images(bag):
        for i, time in enumerate(sample.times):
            bag.image("/camera/color/image_raw", time, COLOR_FRAME, sample.color[i], "rgb8")
            bag.image("/camera/depth/image_raw", time, COLOR_FRAME, sample.depth_mm[i], "16UC1")

    path = write_bag(tmp_path, "ros1", images, lambda b: write_tf(b, sample))
    with pytest.raises(ScanError, match=r"expected a CameraInfo topic beside .* --intrinsics"):
        read_scan(path)
    c, lens = sample.camera, tmp_path / "lens.txt"
    lens.write_text(f"{c.fx} {c.fy} {c.cx} {c.cy}\n")
    assert_is_sample(read_scan(path, options=ScanOptions(intrinsics=str(lens))), sample)


def test_a_pose_topic_without_a_frame_is_the_cameras_with_a_word(sample, tmp_path):
    def poses(bag):
        for time, pose in zip(sample.times, sample.poses, strict=True):
            bag.pose_stamped("/slam/pose", time, "map", pose)

    path = write_bag(tmp_path, "sqlite", lambda b: write_images(b, sample), poses)
    scan = read_scan(path)
    assert len(scan.warnings) == 1
    assert "/slam/pose" in scan.warnings[0]
    assert_is_sample(scan, sample)


def test_topics_can_be_named(sample, tmp_path):
    def other(bag):
        for i, time in enumerate(sample.times):
            bag.image("/rear/rgb/image", time, "rear", sample.color[N - 1 - i], "rgb8")
            bag.image("/rear/depth/image", time, "rear", sample.depth_mm[N - 1 - i], "16UC1")
            bag.info("/rear/rgb/camera_info", time, "rear", sample.camera)
            bag.pose_stamped("/rear/pose", time, "map", sample.poses[N - 1 - i])

    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample),
                     lambda b: write_tf(b, sample), other)  # fmt: skip
    assert_is_sample(read_scan(path), sample)
    options = ScanOptions(
        color_topic="/rear/rgb/image",
        depth_topic="/rear/depth/image",
        pose_topic="/rear/pose",
    )
    scan = read_scan(path, options=options)
    assert_array_equal(scan.files.color(0), sample.color[N - 1])
    assert_allclose(scan.world_from_cams, sample.poses[::-1], atol=1e-6)
    with pytest.raises(
        ScanError, match=r"/front.*of --depth-topic, found .*/rear/depth/image \(Image\)"
    ):
        read_scan(path, options=ScanOptions(depth_topic="/front"))


def test_depth_in_metres_and_in_another_frame(sample, tmp_path):
    def images(bag):
        for i, time in enumerate(sample.times):
            bag.image("/camera/rgb/image_raw", time, COLOR_FRAME, sample.color[i], "rgb8")
            metres = sample.depth_mm[i].astype(np.float32) / np.float32(1000)
            metres[metres == 0] = np.nan
            bag.image("/camera/depth/image", time, "depth_frame", metres, "32FC1")
            bag.info("/camera/rgb/camera_info", time, COLOR_FRAME, sample.camera)

    path = write_bag(tmp_path, "ros1", images, lambda b: write_tf(b, sample))
    scan = read_scan(path)
    assert "depth_frame" in scan.warnings[0]
    assert "depth has no CameraInfo of its own" in scan.warnings[0]
    assert_is_sample(scan, sample)


@pytest.mark.parametrize("lack", ["", "static tf", "CameraInfo"])
def test_depth_of_a_camera_beside_is_registered_by_static_tf(lack, sample, tmp_path):
    """A plane square to the depth camera, which stands 5 cm left of the colour camera and squints."""
    link_from_color = BODY_FROM_CAM
    color_from_depth = se3.make_transform(
        se3.exp_so3(np.array([0.0, 0.03, 0.0])), np.array([-0.05, 0.0, 0.0])
    )

    def images(bag):
        plane = np.full((HEIGHT, WIDTH), 2000, dtype=np.uint16)
        for i, time in enumerate(sample.times):
            bag.image("/camera/color/image_raw", time, COLOR_FRAME, sample.color[i], "rgb8")
            bag.info("/camera/color/camera_info", time, COLOR_FRAME, sample.camera)
            bag.image("/camera/depth/image_raw", time, "depth_optical", plane, "16UC1")
            if lack != "CameraInfo":
                bag.info("/camera/depth/camera_info", time, "depth_optical", sample.camera)

    def tf(bag):
        start = sample.times[0]
        bag.tf("/tf_static", start, "link", COLOR_FRAME, link_from_color)
        if lack != "static tf":
            bag.tf("/tf_static", start, "link", "depth_link", np.eye(4))
        bag.tf(
            "/tf_static", start, "depth_link", "depth_optical", link_from_color @ color_from_depth
        )
        for time, pose in zip(sample.times, sample.poses, strict=True):
            bag.tf("/tf", time, "world", "link", pose @ se3.inverse(link_from_color))

    scan = read_scan(write_bag(tmp_path, "ros1", images, tf))
    if lack:
        assert lack in scan.warnings[0]
        assert_allclose(scan.files.depth(2), 2.0)
        return
    assert scan.warnings == ()
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-6)
    points = scan.cameras[0].lift_image(scan.files.depth(2)).reshape(-1, 3)
    seen = points[np.isfinite(points).all(axis=1)]
    assert 0.5 * HEIGHT * WIDTH < len(seen) < HEIGHT * WIDTH
    in_depth_camera = se3.transform(se3.inverse(color_from_depth), seen)
    assert_allclose(in_depth_camera[:, 2], 2.0, atol=5e-3)


def test_refined_poses_are_written_as_tum(sample, tmp_path):
    path = write_bag(
        tmp_path, "ros1", lambda b: write_images(b, sample), lambda b: write_tf(b, sample)
    )
    before = path.read_bytes()
    out = tmp_path / "out"
    out.mkdir()
    read_scan(path).files.write_poses(out, sample.poses)
    times, poses = read_tum(out / "trajectory.tum")
    assert_allclose(times, sample.times, atol=1e-6)
    assert_allclose(poses, sample.poses, atol=1e-8)
    assert path.read_bytes() == before


def test_a_bag_of_a_camera_alone_takes_a_trajectory_beside_it(sample, tmp_path):
    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample))
    write_tum(tmp_path / "slam.tum", sample.times, sample.poses)
    scan = read_scan(path, options=ScanOptions(poses=tmp_path / "slam.tum"))
    assert_is_sample(scan, sample)
    assert scan.warnings == ()


def test_topics_of_librealsenses_recorder(sample, tmp_path):
    """Names as its ros_file_format.h has them; the recorder knows no poses."""
    color, depth = "/device_0/sensor_1/Color_0", "/device_0/sensor_0/Depth_0"

    def images(bag):
        for i, time in enumerate(sample.times):
            bag.image(f"{color}/image/data", time, "", sample.color[i], "rgb8")
            bag.image(f"{depth}/image/data", time + 0.003, "", sample.depth_mm[i], "mono16")
            bag.info(f"{color}/info/camera_info", time, "", sample.camera)
            bag.info(f"{depth}/info/camera_info", time, "", sample.camera)

    path = write_bag(tmp_path, "ros1", images)
    write_tum(tmp_path / "slam.tum", sample.times, sample.poses)
    assert_is_sample(read_scan(path, options=ScanOptions(poses=tmp_path / "slam.tum")), sample)


def test_a_bag_without_poses(sample, tmp_path):
    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample))
    with pytest.raises(ScanError, match=r"expected poses \(tf, .*--poses"):
        read_scan(path)


def test_a_tf_that_never_moves(sample, tmp_path):
    def poses(bag):
        bag.tf("/tf_static", sample.times[0], BODY_FRAME, COLOR_FRAME, BODY_FROM_CAM)

    path = write_bag(tmp_path, "ros1", lambda b: write_images(b, sample), poses)
    with pytest.raises(ScanError, match="a world that it moves in"):
        read_scan(path)


def test_depth_of_another_hour(sample, tmp_path):
    def images(bag):
        for i, time in enumerate(sample.times):
            bag.image("/camera/rgb/image_raw", time, COLOR_FRAME, sample.color[i], "rgb8")
            bag.image("/camera/depth/image", time + 3600, COLOR_FRAME, sample.depth_mm[i], "16UC1")
            bag.info("/camera/rgb/camera_info", time, COLOR_FRAME, sample.camera)

    path = write_bag(tmp_path, "ros1", images, lambda b: write_tf(b, sample))
    with pytest.raises(ScanError, match=r"expected depth within 0\.02 s of colour"):
        read_scan(path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_that_is_cut_off(kind, sample, tmp_path):
    path = write_bag(
        tmp_path, kind, lambda b: write_images(b, sample), lambda b: write_tf(b, sample)
    )
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(ScanError, match=r"cannot be read|expected"):
        read_scan(path)


def test_a_bag_of_garbage(tmp_path):
    path = tmp_path / "scan.mcap"
    path.write_bytes(b"this is no recording" * 20)
    with pytest.raises(ScanError, match=r"scan\.mcap: expected a bag"):
        read_scan(path)


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite"])
def test_mutants_are_read_or_refused(kind, sample, tmp_path):
    """The library raises what its formats' parsers come across: struct.error, KeyError, apsw's."""
    path = write_bag(
        tmp_path, kind, lambda b: write_images(b, sample, "png"), lambda b: write_tf(b, sample)
    )
    files = [path] if path.is_file() else [p for p in path.iterdir() if p.suffix != ".yaml"]
    whole = files[0].read_bytes()
    n_refused = 0
    for seed in range(12):
        rng = random.Random(seed)
        spoiled = bytearray(whole)
        for _ in range(rng.randrange(1, 30)):
            spoiled[rng.randrange(len(spoiled) if seed % 2 else 4000)] = rng.randrange(256)
        files[0].write_bytes(bytes(spoiled))
        try:
            read_scan(path)
        except ScanError:
            n_refused += 1
    assert n_refused > 2
