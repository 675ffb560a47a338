"""Paths that hold no scan: what is there instead is said, and what to do."""

import zipfile

import pytest

from planfit.errors import ScanError
from planfit.scan import read_scan
from planfit.synth import SynthOptions, WalkOptions, make_scan, write_facap
from scan_samples import put, write_seven_scenes, write_tum


def told(path) -> str:
    with pytest.raises(ScanError) as caught:
        read_scan(path)
    message = str(caught.value)
    assert len(message) < 600
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("name", "what", "step"),
    [
        ("flat.ply", "a model or a cloud without its frames", "raw data or developer export"),
        ("flat.glb", "a model or a cloud without its frames", "raw data or developer export"),
        ("poses.txt", "a list, of poses perhaps", "--poses FILE"),
        ("Room.json", "a single file of JSON", "'planfit plan FILE' reads it"),
        ("ground.dxf", "what may be a plan", "planfit refine SCAN FILE -o OUT"),
        ("walk.MP4", "a video alone", "Stray Scanner"),
        ("walk.svo2", "a ZED recording", "ROS bag"),
        ("scan.tar.gz", "a packed archive of another kind", "unpack it"),
        ("plan.png", "a picture", "'planfit plan FILE'"),
        ("walk.xyz1", "a file", "planfit help scan-formats"),
    ],
)
def test_a_file_of_another_kind(tmp_path, name, what, step):
    put(tmp_path / name, b"something")
    message = told(tmp_path / name)
    assert f"found {what}; " in message
    assert step in message


def test_a_file_out_of_a_scan_names_the_folder(sample, tmp_path):
    write_seven_scenes(tmp_path / "scan", sample)
    file = next((tmp_path / "scan").glob("*.color.png"))
    assert told(file).endswith(
        f"found a file of a 7-scenes scan; give its folder, {tmp_path / 'scan'}"
    )


def test_a_folder_out_of_a_scan_names_the_scan(sample, tmp_path):
    """Its images and poses alone lack what lies beside them: nothing is made of them unasked."""
    write_facap(tmp_path / "a", make_scan(SynthOptions(walk=WalkOptions(n_frames=3))))
    write_tum(tmp_path / "b", sample)
    for part, kind in (("a/arcore", "facap"), ("b/rgb", "tum")):
        expected = f"found a folder of a {kind} scan; give {(tmp_path / part).parent}"
        assert told(tmp_path / part).endswith(expected)


def test_scans_inside_a_folder_are_named(sample, tmp_path):
    for name in ("a", "b", "c", "d"):
        write_seven_scenes(tmp_path / name, sample)
    with zipfile.ZipFile(tmp_path / "e.zip", "w") as archive:
        archive.writestr("x", b"")
    put(tmp_path / "f.db", b"SQLite format 3\0")
    message = told(tmp_path)
    assert message.startswith(
        f"expected a scan, found a folder that holds {tmp_path / 'a'} (7-scenes)"
    )
    assert "more; give one of them" in message


def test_a_bag_in_a_folder_is_named(tmp_path):
    put(tmp_path / "walk.bag", b"#ROSBAG V2.0\n")
    assert told(tmp_path).endswith(f"holds {tmp_path / 'walk.bag'} (bag); give it")


@pytest.mark.parametrize(
    ("names", "what", "step"),
    [
        (["a.jpg", "b.JPG"], "2 pictures, and neither depth nor poses", "give depth and poses too"),
        (["flat.obj", "flat.mtl"], "a model or a cloud without its frames (flat.obj)", "raw data"),
        (["walk.mov", "notes.doc"], "a video alone (walk.mov)", "give depth and poses too"),
        ([], "an empty folder", "'planfit help scan-formats' describes"),
    ],
)  # fmt: skip
def test_a_folder_of_other_things(tmp_path, names, what, step):
    for name in names:
        put(tmp_path / name, b"")
    message = told(tmp_path)
    assert message.startswith(f"expected a scan, found {what}; ")
    assert step in message


def test_a_colmap_model_without_depth(tmp_path):
    for name in ("sparse/0/cameras.bin", "sparse/0/images.bin", "images/a.jpg"):
        put(tmp_path / name, b"")
    message = told(tmp_path)
    assert "format colmap, of which depth/ or depths/ or stereo/depth_maps/ is missing" in message
    assert message.endswith("planfit needs depth of every frame")


def test_images_of_rtabmap_without_poses_are_answered_with_its_database(tmp_path):
    for name in (
        "walk_rgb/1.jpg",
        "walk_depth/1.png",
        "walk_calib/1.yaml",
    ):
        put(tmp_path / name, b"")
    message = told(tmp_path)
    assert message.startswith("expected a list of poses (walk_camera_poses.txt), found none")
    assert "or give the database" in message


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (
            ["rgb/1.png", "depth/1.png", "poses/1.txt", "intrinsic/intrinsic_color.txt"],
            [
                "most of one of the format scannet; it",
                "rename rgb/ to color/, rename poses/ to pose/",
            ],
        ),
        (
            ["images/1.png", "depth/1.png", "cameras.json"],
            ["format nerfstudio, of which transforms.json is missing", "copy or export"],
        ),
        (
            ["rgb/1.png", "depth/1.png", "K.txt"],
            ["format redwood, of which trajectory.log is missing"],
        ),
        (
            ["frames/1.png", "depth/1.png", "camera.json"],
            ["most of one of the format", "rename frames/ to images/"],
        ),
    ],
)
def test_the_nearest_layout_is_named_and_what_to_rename(names, words, tmp_path):
    for name in names:
        put(tmp_path / name, b"")
    message = told(tmp_path)
    assert [word for word in words if word not in message] == []
