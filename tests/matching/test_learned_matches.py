"""Learned keypoints and matchers, with tiny models of random weights; and what is said without them."""

import importlib.util
import sys

import numpy as np
import pytest

from builders import CAMERA, look, room_scan
from planfit.errors import OptionError
from planfit.matching import MatchingOptions, find_matches, relative_motions, verify
from planfit.matching.detect import KeypointOptions, detect, make_detector
from planfit.matching.matchers import MatcherOptions, make_matcher
from planfit.runtime import Runtime
from planfit.scan.odometry import OdometryOptions, make_odometry

HAS_LIBRARIES = all(importlib.util.find_spec(name) for name in ("torch", "transformers"))
needs_libraries = pytest.mark.skipif(
    not HAS_LIBRARIES, reason="needs torch and transformers (planfit[learned])"
)

POSES = np.stack([look([1.0 + 0.1 * i, 2.0, 1.3], 2.0 * i, 5) for i in range(10)])
DIMS = 16


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Folders with tiny models of random weights."""
    import torch
    import transformers as tf

    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("weights")
    points = {
        "encoder_hidden_sizes": [8, 8, 16, 16],
        "decoder_hidden_size": 16,
        "descriptor_decoder_dim": DIMS,
        "keypoint_threshold": 0.0,
    }
    superpoint = tf.SuperPointForKeypointDetection(tf.SuperPointConfig(**points))
    for (
        parameter
    ) in superpoint.parameters():  # wider than by default, or every pixel is like the next
        torch.nn.init.normal_(parameter, std=0.4)
    superpoint.save_pretrained(folder / "superpoint")
    common = {"keypoint_detector_config": {"model_type": "superpoint", **points},
              "num_attention_heads": 2}  # fmt: skip
    tf.LightGlueForKeypointMatching(
        tf.LightGlueConfig(descriptor_dim=DIMS, num_hidden_layers=2, filter_threshold=0.0, **common)
    ).save_pretrained(folder / "lightglue")
    tf.SuperGlueForKeypointMatching(
        tf.SuperGlueConfig(
            hidden_size=DIMS, keypoint_encoder_sizes=[8, 16], gnn_layers_types=["self", "cross"],
            sinkhorn_iterations=5, **common,
        )
    ).save_pretrained(folder / "superglue")  # fmt: skip
    return folder


def options_of(models, matcher="nearest"):
    return MatchingOptions(
        keypoints=KeypointOptions(
            kind="superpoint", weights=str(models / "superpoint"), max_per_frame=300
        ),
        matcher=MatcherOptions(kind=matcher, weights=str(models / matcher)),
    )


@needs_libraries
@pytest.mark.parametrize("matcher", ["nearest", "lightglue", "superglue"])
def test_ten_frames_end_to_end(models, matcher, monkeypatch):
    # Random weights match little: what they match must still come through.
    for module in (verify, relative_motions):
        monkeypatch.setattr(module, "MIN_INLIERS", 5)
    monkeypatch.setattr(verify, "MIN_INLIER_RATIO", 0.02)
    scan = room_scan(POSES)
    odometry = make_odometry(scan.world_from_cams, OdometryOptions())
    found = find_matches(scan, odometry, options_of(models, matcher), Runtime(2))
    assert found.n_keypoints > 500
    assert found.n_tried >= 30
    if matcher == "nearest":  # random convolutions describe a place well enough for neighbours
        assert len(found.pairs) >= 5


@needs_libraries
def test_keypoints_lie_in_the_image_and_have_depth(models):
    scan = room_scan(POSES[:1])
    options = options_of(models).keypoints
    color, depth = scan.files.color(0), scan.files.depth(0)
    found = detect(color, depth, CAMERA, options)
    assert 100 < len(found) <= 300
    assert found.descriptors.shape == (len(found), DIMS)
    assert np.allclose(CAMERA.project(found.points_cam.astype(float)), found.uv, atol=1e-3)
    assert np.all(np.diff(found.scores) <= 0)
    # Keypoints of a shifted image shift with it: their coordinates are pixels.
    moved = np.roll(color, 8, axis=1)
    again = detect(moved, np.roll(depth, 8, axis=1), CAMERA, options)
    one = {tuple(np.round(uv).astype(int)) for uv in found.uv}
    two = {(round(u - 8), round(v)) for u, v in again.uv.tolist()}
    assert len(one & two) > 0.6 * min(len(one), len(two))


@needs_libraries
@pytest.mark.parametrize("kind", ["lightglue", "superglue"])
def test_a_matcher_is_given_the_keypoints_that_it_is_asked_about(models, kind):
    scan = room_scan(POSES[:1])
    a = detect(scan.files.color(0), scan.files.depth(0), CAMERA, options_of(models).keypoints)
    matcher = make_matcher(options_of(models, kind).matcher)
    size = (CAMERA.width, CAMERA.height)
    few = type(a)(*(v[:40] if v.ndim else v for v in vars(a).values()))
    idx = matcher(a, few, size, size)
    assert idx.shape[1] == 2
    assert np.all(idx[:, 1] < 40)
    assert np.all(idx[:, 0] < len(a))
    assert len(np.unique(idx[:, 1])) == len(idx)
    nothing = type(a)(*(v[:0] if v.ndim else v for v in vars(a).values()))
    assert matcher(a, nothing, size, size).shape == (0, 2)
    assert matcher(nothing, a, size, size).shape == (0, 2)


@needs_libraries
def test_the_same_input_gives_the_same(models):
    scan = room_scan(POSES[:3])
    odometry = make_odometry(scan.world_from_cams, OdometryOptions())
    one, two = (
        find_matches(scan, odometry, options_of(models, "superglue"), Runtime(n)) for n in (1, 2)
    )
    assert np.array_equal(one.points_a, two.points_a)


@needs_libraries
def test_weights_of_another_kind_are_refused(models):
    with pytest.raises(OptionError, match="expected weights of superpoint, found those of lightgl"):
        make_detector(KeypointOptions(kind="superpoint", weights=str(models / "lightglue")))


@needs_libraries
def test_incomplete_weights_are_refused(models, tmp_path):
    from safetensors.torch import load_file, save_file

    (tmp_path / "config.json").write_text((models / "superpoint" / "config.json").read_text())
    tensors = load_file(models / "superpoint" / "model.safetensors")
    dropped = sorted(tensors)[0]
    save_file({k: v for k, v in tensors.items() if k != dropped}, tmp_path / "model.safetensors",
              metadata={"format": "pt"})  # fmt: skip
    with pytest.raises(OptionError, match=f"found none for {dropped} and 0 more; download"):
        make_detector(KeypointOptions(kind="superpoint", weights=str(tmp_path)))


@needs_libraries
def test_a_folder_without_weights_is_named(tmp_path):
    with pytest.raises(
        OptionError, match=r"expected a folder with config.json and weights, or a model"
    ):
        make_detector(KeypointOptions(kind="superpoint", weights=str(tmp_path)))


def test_no_such_folder():
    with pytest.raises(
        OptionError, match=r"/nowhere/superpoint: expected a folder .* found no such"
    ):
        make_detector(KeypointOptions(kind="superpoint", weights="/nowhere/superpoint"))


@needs_libraries
def test_no_network(monkeypatch):
    import huggingface_hub.constants

    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)
    with pytest.raises(OptionError, match="without network, fetch the model elsewhere and give"):
        make_detector(KeypointOptions(kind="superpoint", weights="planfit-test/no-such-model"))


@needs_libraries
def test_a_device_of_its_own_choice_gives_the_same_keypoints_as_cpu(models):
    import torch

    if torch.cuda.is_available():
        pytest.skip("on a GPU sums are rounded otherwise")
    grey = np.random.default_rng(0).integers(0, 256, (120, 160), dtype=np.uint8)
    found = []
    for device in ("cpu", "auto"):
        options = KeypointOptions(kind="superpoint", weights=str(models / "superpoint"))
        found.append(make_detector(options, device)(grey, None))
    assert len(found[0].uv) > 50
    assert np.array_equal(found[0].uv, found[1].uv)


@needs_libraries
def test_no_such_device(models):
    options = KeypointOptions(kind="superpoint", weights=str(models / "superpoint"))
    with pytest.raises(
        OptionError,
        match=r"matching.device: expected auto, cpu or a GPU .* found 'abacus'",
    ):
        make_detector(options, "abacus")


def test_no_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "transformers", None)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(OptionError, match=r"pip install 'planfit\[learned\]'"):
        make_detector(KeypointOptions(kind="superpoint", weights="a/b"))


def test_learned_matchers_match_superpoint_alone():
    with pytest.raises(OptionError, match="lightglue matches superpoint keypoints only"):
        MatchingOptions(matcher=MatcherOptions(kind="lightglue"))
