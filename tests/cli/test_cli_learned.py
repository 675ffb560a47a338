"""Learned labels, keypoints and matches by flags of the command line: tiny random models, ten frames."""

import json
from pathlib import Path

import pytest

from planfit.cli import run
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
    write_facap,
)

DIMS = 16


@pytest.fixture(scope="module")
def ten_frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ten") / "scan"
    options = SynthOptions(
        seed=3,
        building=BuildingOptions(n_rooms=1),
        walk=WalkOptions(n_frames=10),
        camera=CameraOptions(width_px=160, height_px=120),
    )
    write_facap(folder, make_scan(options))
    return folder


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (planfit[learned])")
    tf = pytest.importorskip("transformers", reason="transformers is not installed")
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("models")
    names = {0: "wall", 1: "floor, flooring", 2: "ceiling", 3: "chair"}
    config = tf.SegformerConfig(
        depths=[1] * 4, hidden_sizes=[8, 8, 16, 16], num_attention_heads=[1, 1, 2, 2],
        decoder_hidden_size=16, id2label=names, label2id={v: k for k, v in names.items()},
    )  # fmt: skip
    tf.SegformerForSemanticSegmentation(config).save_pretrained(folder / "segformer")
    size = {"height": 64, "width": 64}
    tf.SegformerImageProcessor(size=size).save_pretrained(folder / "segformer")
    points = {
        "encoder_hidden_sizes": [8, 8, 16, 16],
        "decoder_hidden_size": 16,
        "descriptor_decoder_dim": DIMS,
        "keypoint_threshold": 0.0,
    }
    tf.SuperPointForKeypointDetection(tf.SuperPointConfig(**points)).save_pretrained(
        folder / "superpoint"
    )
    common = {"keypoint_detector_config": {"model_type": "superpoint", **points},
              "num_attention_heads": 2}  # fmt: skip
    tf.LightGlueForKeypointMatching(
        tf.LightGlueConfig(descriptor_dim=DIMS, num_hidden_layers=2, filter_threshold=0.0, **common)
    ).save_pretrained(folder / "lightglue")
    return folder


def test_refine_with_learned_labels_and_matches(
    ten_frames: Path, models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = [
        "--segmentation.back-end", "learned", "--segmentation.learned.model", str(models / "segformer"),
        "--segmentation.learned.batch-size", "4", "--matching.keypoints.kind", "superpoint",
        "--matching.keypoints.weights", str(models / "superpoint"),
        "--matching.keypoints.max-per-frame", "200", "--matching.matcher.kind", "lightglue",
        "--matching.matcher.weights", str(models / "lightglue"),
    ]  # fmt: skip
    out = tmp_path / "out"
    code = run(["refine", str(ten_frames), "-o", str(out), *flags])
    # Random weights see no floor and no walls worth the name: worse than before is no fault here.
    assert code in (0, 1), capsys.readouterr().err
    record = json.loads((out / "run.json").read_text())
    assert record["labels_from"] == "learned"
    assert record["matches"]["keypoints"] > 500
    assert record["matches"]["pairs_tried"] > 0
    assert record["options"]["matching"]["matcher"]["kind"] == "lightglue"
    assert len(list((out / "poses").iterdir())) == 10


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--segmentation.back-end", "learned"], "--segmentation.learned.model"),
        (["--segmentation.back-end", "learned", "--segmentation.learned.model", "./no"], "no"),
        (["--matching.keypoints.kind", "superpoint", "--matching.keypoints.weights", "./no"], "no"),
        (["--matching.matcher.kind", "lightglue"], "superpoint"),
    ],
)
def test_weights_that_cannot_be_had(
    flags: list[str],
    says: str,
    ten_frames: Path,
    models: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["refine", str(ten_frames), "-o", str(tmp_path / "out"), *flags]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith("planfit: ")
    assert "expected" in said[-1] or "matches superpoint keypoints only" in said[-1]
    assert says in said[-1]
