"""Which topics are taken of the names that drivers of cameras give them."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from planfit.errors import ScanError
from planfit.scan import ScanOptions
from planfit.scan.formats.bag_messages import COMPRESSED, IMAGE, INFO_TYPE, choose_topics

TF = {"/tf": "tf2_msgs/msg/TFMessage"}


def chosen(*images: str, kind: str = IMAGE):
    """Topics of a bag with these images, each with a CameraInfo in its folder, and tf."""
    infos = {f"{name.rsplit('/', 1)[0]}/camera_info": INFO_TYPE for name in images}
    types = {**TF, **infos, **dict.fromkeys(images, kind)}
    topics = [SimpleNamespace(topic=name, msgtype=kind) for name, kind in types.items()]
    return choose_topics(Path("walk.bag"), topics, ScanOptions())


@pytest.mark.parametrize(
    ("color", "depth", "others"),
    [
        pytest.param(
            "/rgb/image_raw", "/depth_to_rgb/image_raw",
            ["/depth/image_raw", "/rgb_to_depth/image_raw", "/ir/image_raw"],
            id="Azure Kinect, which shows both cameras as the other sees",
        ),
        pytest.param("/oak/rgb/image_raw", "/oak/stereo/image_raw", [], id="DepthAI"),
        pytest.param(
            "/spot/camera/frontleft/image", "/spot/depth_registered/frontleft/image",
            ["/spot/camera/left/image", "/spot/camera/back/image", "/spot/depth/left/image"],
            id="several cameras: both of one",
        ),
        pytest.param(
            "/zed/zed_node/rgb/image_rect_color", "/zed/zed_node/depth/depth_registered",
            ["/zed/zed_node/left/image_rect_color", "/zed/zed_node/confidence/confidence_map"],
            id="ZED",
        ),
        pytest.param(
            "/camera/camera/color/image_raw", "/camera/camera/aligned_depth_to_color/image_raw",
            ["/camera/camera/depth/image_rect_raw", "/camera/camera/infra1/image_rect_raw"],
            id="RealSense",
        ),
        pytest.param(
            "/kinect2/hd/image_color_rect", "/kinect2/hd/image_depth_rect",
            ["/kinect2/qhd/image_color_rect", "/kinect2/qhd/image_depth_rect"], id="Kinect 2",
        ),
        pytest.param(
            "/camera/image_raw", "/camera/depth/image_raw", ["/segmentation/mask/image_raw"],
            id="Gazebo, with a mask that a network made",
        ),
    ],
)  # fmt: skip
def test_names_of_drivers(color: str, depth: str, others: list[str]) -> None:
    topics = chosen(*others, color, depth)
    assert (topics.color, topics.depth) == (color, depth)
    assert topics.info == f"{color.rsplit('/', 1)[0]}/camera_info"


def test_compressed_images_of_a_pair() -> None:
    color, depth = "/oak/rgb/image_raw/compressed", "/oak/stereo/image_raw/compressedDepth"
    infos = {"/oak/rgb/camera_info": INFO_TYPE}
    types = {**TF, **infos, color: COMPRESSED, depth: COMPRESSED}
    listed = [SimpleNamespace(topic=name, msgtype=kind) for name, kind in types.items()]
    topics = choose_topics(Path("walk.bag"), listed, ScanOptions())
    assert (topics.color, topics.depth) == (color, depth)


@pytest.mark.parametrize(
    ("images", "step"),
    [
        ([], "record the camera's colour and depth images too"),
        (["/camera/color/image_raw"], "record the camera's colour and depth images too"),
        (
            ["/front/image_raw", "/range/image_raw"],
            "name them with --color-topic and --depth-topic",
        ),
    ],
)
def test_bags_without_depth(images: list[str], step: str) -> None:
    with pytest.raises(ScanError, match=f"; {step}$"):
        chosen(*images)
