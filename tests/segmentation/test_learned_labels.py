"""The learned back end: tiny models with random weights, saved to a folder and run end to end."""

import json
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from builders import NoFiles, look, room_scan
from planfit.errors import OptionError, ScanError
from planfit.runtime import Runtime
from planfit.scan import Label
from planfit.segmentation import Gravity, SegmentationOptions, choose_back_end, segment_scan
from planfit.segmentation.learned import LearnedBackEnd, LearnedOptions, load_model

NAMES = {0: "wall", 1: "floor, flooring", 2: "ceiling", 3: "column, pillar", 4: "chair"}
UP = Gravity(np.array([0, 0, 1.0]), 1.0, "known")
POSES = np.stack([look([2 + 0.1 * i, 1.6, 1.4], 20 * i, 12) for i in range(10)])
LABELS = {Label.NONE, Label.FLOOR, Label.WALL, Label.CEILING, Label.COLUMN, Label.OTHER}


class Colored(NoFiles):
    """The room's depth with random colour images, and which of them were read."""

    def __init__(self, scan):
        self._scan, self.read = scan, []

    def depth(self, i):
        return self._scan.files.depth(i)

    def color(self, i):
        self.read.append(i)
        blocks = np.random.default_rng(i).integers(0, 256, (6, 8, 3), dtype=np.uint8)
        return cv2.resize(blocks, (160, 120), interpolation=cv2.INTER_NEAREST)


def colored_room():
    scan = room_scan(POSES)
    return replace(scan, files=Colored(scan))


def names(config):
    config.id2label, config.label2id = dict(NAMES), {v: k for k, v in NAMES.items()}
    return config


def segformer(transformers):
    config = transformers.SegformerConfig(
        depths=[1] * 4, hidden_sizes=[8, 8, 16, 16], num_attention_heads=[1, 1, 2, 2],
        decoder_hidden_size=16, num_labels=len(NAMES),
    )  # fmt: skip
    model = transformers.SegformerForSemanticSegmentation(names(config))
    size = {"height": 64, "width": 64}
    return model, transformers.SegformerImageProcessor(size=size, do_reduce_labels=False)


def _swin(transformers):
    return transformers.SwinConfig(
        image_size=64, embed_dim=8, depths=[1] * 4, num_heads=[1, 1, 2, 2], window_size=2,
        out_features=["stage1", "stage2", "stage3", "stage4"],
    )  # fmt: skip


def mask2former(transformers):
    config = transformers.Mask2FormerConfig(
        backbone_config=_swin(transformers), feature_size=32, mask_feature_size=32, hidden_dim=32,
        encoder_feedforward_dim=16, encoder_layers=1, decoder_layers=2, num_attention_heads=2,
        dim_feedforward=16, num_queries=6,
    )  # fmt: skip
    model = transformers.Mask2FormerForUniversalSegmentation(names(config))
    size = {"height": 64, "width": 64}
    return model, transformers.Mask2FormerImageProcessor(size=size, ignore_index=255)


def oneformer(transformers, folder):
    classes = {str(k): {"name": v, "isthing": int(k == 4)} for k, v in NAMES.items()}
    (folder / "classes.json").write_text(json.dumps(classes))
    vocabulary = ["<|startoftext|>", "<|endoftext|>", *"theaskimnc", *(c + "</w>" for c in "esc")]
    vocabulary = {token: i for i, token in enumerate(dict.fromkeys(vocabulary))}
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokenizer = transformers.CLIPTokenizer(
        str(folder / "vocab.json"), str(folder / "merges.txt"), pad_token="<|endoftext|>"
    )
    config = transformers.OneFormerConfig(
        backbone_config=_swin(transformers), num_queries=6, hidden_dim=32, mask_dim=32, conv_dim=32,
        encoder_feedforward_dim=16, encoder_layers=1, decoder_layers=2, num_attention_heads=2,
        dim_feedforward=16, text_encoder_width=32, text_encoder_num_layers=1,
        text_encoder_vocab_size=len(vocabulary), text_encoder_context_length=77,
        text_encoder_proj_layers=1, text_encoder_n_ctx=4, task_seq_len=77, max_seq_len=77,
        query_dec_layers=1, is_training=False,
    )  # fmt: skip
    images = transformers.OneFormerImageProcessor(
        size={"height": 64, "width": 64}, repo_path=str(folder), class_info_file="classes.json",
        num_text=2, num_labels=len(NAMES), ignore_index=255, do_reduce_labels=False,
    )  # fmt: skip
    processor = transformers.OneFormerProcessor(images, tokenizer, 77, 77)
    return transformers.OneFormerForUniversalSegmentation(names(config)), processor


@pytest.fixture(scope="module")
def model_folder(tmp_path_factory):
    """Makes a folder with a tiny model of the kind asked for, once."""
    made = {}

    def make(kind):
        torch = pytest.importorskip(
            "torch", reason="PyTorch is not installed (pip install planfit[learned])"
        )
        transformers = pytest.importorskip(
            "transformers", reason="transformers is not installed (pip install planfit[learned])"
        )
        if kind not in made:
            folder = tmp_path_factory.mktemp(kind)
            torch.manual_seed(0)
            parts = {
                "segformer": lambda: segformer(transformers),
                "mask2former": lambda: mask2former(transformers),
                "oneformer": lambda: oneformer(transformers, folder),
            }[kind]()
            for part in parts:
                part.save_pretrained(folder)
            made[kind] = folder
        return made[kind]

    return make


@pytest.fixture(scope="module")
def onnx_file(tmp_path_factory):
    """A tiny ONNX model: brighter red is wall, brighter green floor, brighter blue ceiling."""
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed (planfit[learned])")
    onnx = pytest.importorskip(
        "onnx", reason="onnx is not installed, which writes the test's model"
    )

    def make(batch="n", size=("h", "w"), output="scores", settings=None, id2label=NAMES):
        folder = tmp_path_factory.mktemp("onnx")
        make_value, numbers = onnx.helper.make_tensor_value_info, onnx.TensorProto
        nodes = [onnx.helper.make_node("Identity", ["pixels"], ["scores"])]
        if output == "classes":
            nodes.append(
                onnx.helper.make_node("ArgMax", ["scores"], ["classes"], axis=1, keepdims=0)
            )
        shape, kind = (
            ((batch, 3, *size), numbers.FLOAT)
            if output == "scores"
            else ((batch, *size), numbers.INT64)
        )
        graph = onnx.helper.make_graph(
            nodes, "tiny",
            [make_value("pixels", numbers.FLOAT, (batch, 3, *size))],
            [make_value(output, kind, shape)],
        )  # fmt: skip
        model = onnx.helper.make_model(
            graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8
        )
        onnx.save(model, folder / "model.onnx")
        plain = {"size": {"height": 60, "width": 80}, "image_mean": [0] * 3, "image_std": [1] * 3}
        settings = plain if settings is None else settings
        (folder / "preprocessor_config.json").write_text(json.dumps(settings))
        if id2label:
            (folder / "config.json").write_text(json.dumps({"id2label": id2label}))
        return folder / "model.onnx"

    return make


@pytest.mark.parametrize("kind", ["segformer", "mask2former", "oneformer"])
def test_ten_frames_end_to_end(model_folder, kind):
    scan = colored_room()
    options = SegmentationOptions(
        back_end="learned", learned=LearnedOptions(model=str(model_folder(kind)), batch_size=4)
    )
    found = segment_scan(scan, UP, options, Runtime(2))
    assert found.back_end == "learned"
    assert sorted(scan.files.read) == list(range(10))  # each image once
    labels = choose_back_end(scan, UP, options, Runtime(1)).labels(9, scan.files.depth(9))
    assert labels.shape == (120, 160)
    assert labels.dtype == np.uint8
    assert set(np.unique(labels)) <= {int(x) for x in LABELS}


def test_labels_are_the_models_own_classes_by_name(model_folder):
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    folder, scan = model_folder("segformer"), colored_room()
    back_end = LearnedBackEnd(scan, LearnedOptions(model=str(folder), batch_size=3))
    model = transformers.SegformerForSemanticSegmentation.from_pretrained(folder).eval()
    processor = transformers.AutoImageProcessor.from_pretrained(folder)
    for i in (0, 7):
        pixels = processor(images=scan.files.color(i), return_tensors="pt")["pixel_values"]
        with torch.inference_mode():
            logits = torch.nn.functional.interpolate(
                model(pixels).logits, (120, 160), mode="bilinear", align_corners=False
            )[0]
        ours = np.array([Label.WALL, Label.FLOOR, Label.CEILING, Label.COLUMN, Label.OTHER])
        expected = ours[logits.argmax(0).numpy()]
        assert np.mean(back_end.labels(i, scan.files.depth(i)) == expected) > 0.999


def test_loading_a_model_prints_nothing(model_folder, capfd):
    folder = model_folder("segformer")
    capfd.readouterr()
    load_model(LearnedOptions(model=str(folder)))
    assert capfd.readouterr() == ("", "")


def test_order_and_threads_do_not_change_the_labels(onnx_file):
    path = str(onnx_file())

    def labels(order):
        scan = colored_room()
        back_end = LearnedBackEnd(scan, LearnedOptions(model=path, batch_size=4))
        found = {i: back_end.labels(i, scan.files.depth(i)) for i in order}
        return np.stack([found[i] for i in range(10)])

    np.testing.assert_array_equal(labels(range(10)), labels(reversed(range(10))))


@pytest.mark.parametrize("batch_size", [1, 3, 16])
@pytest.mark.parametrize("kind", [{}, {"output": "classes"}, {"batch": 2, "size": (60, 80)}])
def test_onnx_labels_are_what_the_model_says(onnx_file, kind, batch_size):
    scan = colored_room()
    options = LearnedOptions(model=str(onnx_file(**kind)), batch_size=batch_size)
    back_end = LearnedBackEnd(scan, options)
    ours = np.array([Label.WALL, Label.FLOOR, Label.CEILING])
    for i in range(10):
        true = ours[scan.files.color(i).argmax(axis=2)]
        assert np.mean(back_end.labels(i, scan.files.depth(i)) == true) > 0.9


def test_few_batches_are_kept(onnx_file):
    scan = colored_room()
    back_end = LearnedBackEnd(scan, LearnedOptions(model=str(onnx_file()), batch_size=1))
    for i in range(10):
        back_end.labels(i, scan.files.depth(i))
    back_end.labels(9, scan.files.depth(9))
    assert scan.files.read == list(range(10))
    back_end.labels(0, scan.files.depth(0))  # forgotten, and read again
    assert scan.files.read[-1] == 0


def test_mean_std_and_rescale_reach_the_pixels(onnx_file):
    # With all weight taken from red, green always wins over it.
    no_red = {
        "size": 64,
        "image_mean": [9, 0, 9],
        "image_std": [1, 1, 1],
        "rescale_factor": 1 / 255,
    }
    scan = colored_room()
    back_end = LearnedBackEnd(scan, LearnedOptions(model=str(onnx_file(settings=no_red))))
    assert np.all(back_end.labels(0, scan.files.depth(0)) == Label.FLOOR)


def test_the_identity_changes_with_the_weights(onnx_file):
    path = onnx_file()
    options = LearnedOptions(model=str(path))
    before = LearnedBackEnd(colored_room(), options).identity
    assert LearnedBackEnd(colored_room(), options).identity == before
    (path.parent / "config.json").touch()
    path.write_bytes(path.read_bytes())
    assert LearnedBackEnd(colored_room(), options).identity != before


def test_a_depth_image_of_another_size_is_named(onnx_file):
    back_end = LearnedBackEnd(colored_room(), LearnedOptions(model=str(onnx_file())))
    with pytest.raises(
        ScanError, match=r"frame 0003: expected a depth image of 160 x 120.*32 x 24"
    ):
        back_end.labels(3, np.zeros((24, 32), np.float32))


# What cannot be had.


def refused(match, **options):
    with pytest.raises(OptionError, match=match):
        load_model(LearnedOptions(**options))


def test_no_model_named():
    refused("segmentation.learned.model: expected a folder .* found none; for example")


def test_no_such_folder_and_no_such_file(tmp_path):
    refused("found no such folder; check the path", model=str(tmp_path / "nowhere"))
    refused("found no such folder", model="./nowhere")
    refused("expected an ONNX file, found no such file", model=str(tmp_path / "nowhere.onnx"))


@pytest.mark.parametrize("library", ["torch", "transformers"])
def test_a_missing_library_is_named(monkeypatch, tmp_path, library):
    pytest.importorskip("torch", reason="PyTorch is not installed (pip install planfit[learned])")
    monkeypatch.setitem(sys.modules, library, None)
    refused(rf"needs the library {library}.*planfit\[learned\].*geometry", model=str(tmp_path))


def test_missing_onnxruntime_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    (tmp_path / "m.onnx").write_bytes(b"")
    refused(r"needs the library onnxruntime.*planfit\[learned\]", model=str(tmp_path / "m.onnx"))


def test_no_network(model_folder, monkeypatch):
    model_folder("segformer")  # skips where the libraries are absent
    constants = pytest.importorskip("huggingface_hub.constants")
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    refused("no-one/nothing: expected a folder .* without network, fetch", model="no-one/nothing")


def test_a_folder_without_a_model(model_folder, tmp_path):
    model_folder("segformer")
    refused("expected a folder with config.json", model=str(tmp_path))


def test_a_backbone_without_head_is_refused(model_folder, tmp_path):
    transformers = pytest.importorskip("transformers", reason="transformers is not installed")
    model, processor = segformer(transformers)
    model.segformer.config = model.config
    model.segformer.save_pretrained(tmp_path)
    processor.save_pretrained(tmp_path)
    refused(
        "found none for decode_head.* and .* more; .*take a model that was", model=str(tmp_path)
    )


def test_a_device_that_does_not_exist(model_folder, onnx_file):
    folder = str(model_folder("segformer"))
    refused("segmentation.learned.device: expected auto, cpu", model=folder, device="abacus")
    refused(
        "segmentation.learned.device: expected auto.*it has .*CPU",
        model=str(onnx_file()),
        device="abacus",
    )


def test_an_onnx_file_without_names_or_of_something_else(onnx_file):
    refused("names of its classes as id2label", model=str(onnx_file(id2label=None)))
    refused("found no floor and no wall", model=str(onnx_file(id2label={"0": "cat"})))
    broken = onnx_file()
    broken.write_bytes(b"not a model")
    refused("expected an ONNX model that onnxruntime runs", model=str(broken))
    (broken.parent / "config.json").write_text("{")
    refused("expected JSON in config.json", model=str(broken))


def test_options_of_no_sense():
    with pytest.raises(OptionError, match="batch_size"):
        LearnedOptions(batch_size=0)
