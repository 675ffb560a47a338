"""Floor, walls, ceiling and columns by a segmentation model over the colour images.

Models come through transformers (SegFormer, Mask2Former, MaskFormer, OneFormer and the like) by hub name or
local folder, or as an ONNX file; both need the extra `learned`. planfit ships no weights. Beside
`model.onnx`, `config.json` names the classes (`id2label`), and `preprocessor_config.json` may say `size`,
`image_mean`, `image_std` and `rescale_factor`: what exports of transformers models come with.
"""

import hashlib
import importlib
import json
import re
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Integer, UInt8

from planfit.errors import OptionError, ScanError, require_positive
from planfit.runtime import find_weights, first_line
from planfit.runtime import load_model as load_weights
from planfit.scan import Label, Scan

_KEPT_BATCHES = 4
"""Batches of label images in memory at a time: threads work on chunks of frames side by side."""


@dataclass(frozen=True)
class LearnedOptions:
    """Which model labels the images, and how it is run."""

    model: str = ""
    """A folder that transformers saved, an ONNX file, or the name of a model on the Hugging Face hub, such
    as `facebook/mask2former-swin-large-ade-semantic`. Mind the licence of its weights."""
    batch_size: int = 4
    """Images that go through the model at once; more is faster on a GPU and takes more memory."""
    device: str = "auto"
    """`cpu`, `cuda`, `cuda:1` and so on; `auto` takes a GPU where there is one."""

    def __post_init__(self) -> None:
        require_positive(self, "batch_size")


class LearnedBackEnd:
    """Labels frames in batches, in whatever order they are asked for.

    Batches begin at multiples of their size, so that the result does not depend on that order. Only the
    last few are kept: memory does not grow with the scan.
    """

    name = "learned"

    def __init__(self, scan: Scan, options: LearnedOptions) -> None:
        self._scan = scan
        self._batch_size = options.batch_size
        self._model = load_model(options)
        self._batches: OrderedDict[int, list[np.ndarray]] = OrderedDict()
        self._lock = Lock()
        self.identity = f"learned {_fingerprint(options.model)}"

    def labels(self, frame_idx: int, depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
        """As the model sees the colour image; NONE where its label set has no name.

        Raises:
            ScanError: the depth image is not as large as the frame's camera says.
        """
        if self._scan.lacking[frame_idx] == "colour":
            return np.zeros(depth.shape, dtype=np.uint8)
        batch, number = divmod(frame_idx, self._batch_size)
        with self._lock:  # one batch at a time: the model has all cores, or the GPU
            if batch not in self._batches:
                self._batches[batch] = self._run(batch)
                if len(self._batches) > _KEPT_BATCHES:
                    self._batches.popitem(last=False)
            self._batches.move_to_end(batch)
            labels = self._batches[batch][number]
        if labels.shape != depth.shape:
            raise ScanError(
                f"{self._scan.name}: frame {self._scan.frame_ids[frame_idx]}: expected a depth image "
                f"of {labels.shape[1]} x {labels.shape[0]} as its camera has, "
                f"found {depth.shape[1]} x {depth.shape[0]}"
            )
        return labels

    def _color(self, frame_idx: int) -> np.ndarray:
        image, camera = self._scan.files.color(frame_idx), self._scan.cameras[frame_idx]
        if self._scan.lacking[frame_idx] == "colour":
            return np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
        if image is None:
            raise ScanError(
                f"{self._scan.name}: frame {self._scan.frame_ids[frame_idx]}: expected a colour image "
                "for the learned model, found depth alone; use --segmentation.back-end geometry"
            )
        return image

    def _run(self, batch: int) -> list[np.ndarray]:
        start = batch * self._batch_size
        frames = range(start, min(start + self._batch_size, len(self._scan)))
        images = [self._color(i) for i in frames]
        cameras = [self._scan.cameras[i] for i in frames]
        found = self._model.classes(images, [(c.height, c.width) for c in cameras])
        table = self._model.table
        # A padding or "nothing" class has a number beyond the names.
        return [
            np.where((x >= 0) & (x < len(table)), table[np.clip(x, 0, len(table) - 1)], 0).astype(
                np.uint8
            )
            for x in found
        ]


def load_model(options: LearnedOptions) -> "TransformersModel | OnnxModel":
    """The model that `options` name, ready to run.

    Raises:
        OptionError: none is named, its library is not installed, there is no such folder, file or hub
            name, the device does not exist, or its classes include no floor or no wall.
    """
    name = options.model
    if not name:
        raise OptionError(
            "segmentation.learned.model: expected a folder of a transformers model, an ONNX file or the "
            "name of a model on the Hugging Face hub, found none; for example "
            "--segmentation.learned.model facebook/mask2former-swin-large-ade-semantic"
        )
    path = Path(name).expanduser()
    if path.suffix.lower() == ".onnx":
        return OnnxModel(path, options.device)
    return TransformersModel(name, options.device)


def _fingerprint(name: str) -> str:
    """Changes when the model's files do: their names, sizes and times; of a hub model, its name."""
    path = Path(name).expanduser()
    files = sorted(path.iterdir()) if path.is_dir() else [path] if path.exists() else []
    stats = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
    return hashlib.sha256(repr((name, stats)).encode()).hexdigest()[:16]


_DEFAULT_SIZE_PX = 512
"""Side that SegFormer was trained at on ADE20K, 512 px; of models that say none."""
_IMAGENET_MEAN = (0.485, 0.456, 0.406)
_IMAGENET_STD = (0.229, 0.224, 0.225)
_NAMES = {
    Label.FLOOR: {"floor", "flooring", "ground", "carpet", "carpeting", "rug", "pavement"},
    Label.WALL: {"wall"},
    Label.CEILING: {"ceiling"},
    Label.COLUMN: {"column", "pillar"},
}
_QUALIFIERS = {
    "area", "brick", "concrete", "inside", "interior", "indoor", "marble", "merged", "other", "panel",
    "plaster", "stone", "stuff", "tile", "tiled", "wood", "wooden",
}  # fmt: skip
"""Words that a name may carry without meaning something else: `wall-brick`, `floor-other-merged`."""
_NOT_SAVED = ("criterion.",)
"""Weights of the training loss, which are not saved with every model."""


class TransformersModel:
    """SegFormer and its like, Mask2Former, MaskFormer, OneFormer."""

    def __init__(self, name: str, device: str) -> None:
        """Load by hub name or local folder.

        Raises:
            OptionError: see `load_model`.
        """
        weights = find_weights(
            "segmentation.learned.model", name, "--segmentation.back-end geometry"
        )
        transformers, kind = weights.transformers, weights.config.model_type
        mapping = importlib.import_module("transformers.models.auto.modeling_auto")
        is_universal = kind in mapping.MODEL_FOR_UNIVERSAL_SEGMENTATION_MAPPING_NAMES
        auto = (
            transformers.AutoModelForUniversalSegmentation
            if is_universal
            else transformers.AutoModelForSemanticSegmentation
        )
        self._needs_task = kind == "oneformer"
        processor = (
            transformers.AutoProcessor if self._needs_task else transformers.AutoImageProcessor
        )
        self.table = label_table(weights.config.id2label, weights.where)
        try:
            self._processor: Any = processor.from_pretrained(
                weights.source, trust_remote_code=False
            )
        except (OSError, ValueError, ImportError) as error:
            raise OptionError(
                f"{weights.where}: expected a segmentation model with preprocessor_config.json, found a "
                f"{kind} whose images cannot be prepared ({first_line(error)})"
            ) from error
        self._torch = weights.torch
        self._model, self._device = load_weights(
            weights, auto, "a segmentation model", "segmentation.learned.device", device, _NOT_SAVED
        )

    def classes(
        self, images: list[UInt8[np.ndarray, "_ _ 3"]], sizes: list[tuple[int, int]]
    ) -> list[Integer[np.ndarray, "_ _"]]:
        """Class numbers of RGB images, at the sizes (h, w) asked for."""
        if self._needs_task:
            inputs = self._processor(
                images=images, task_inputs=["semantic"] * len(images), return_tensors="pt"
            )
        else:
            inputs = self._processor(images=images, return_tensors="pt")
        with self._torch.inference_mode():
            outputs = self._model(**inputs.to(self._device))
            maps = self._processor.post_process_semantic_segmentation(outputs, target_sizes=sizes)
        return [m.cpu().numpy() for m in maps]


class OnnxModel:
    """One image input (n, 3, h, w); class scores (n, classes, h', w') or class numbers (n, h', w') out."""

    def __init__(self, path: Path, device: str) -> None:
        """Load a file.

        Raises:
            OptionError: see `load_model`.
        """
        where = f"segmentation.learned.model: {path}"
        if not path.is_file():
            raise OptionError(f"{where}: expected an ONNX file, found no such file; check the path")
        try:
            runtime: Any = importlib.import_module("onnxruntime")
        except ImportError as error:
            raise OptionError(
                "segmentation.back_end: learned needs the library onnxruntime for ONNX files, which is "
                "not installed; run `pip install 'planfit[learned]'`, or use --segmentation.back-end "
                "geometry"
            ) from error
        config = _read_json(path.parent / "config.json", where)
        if "id2label" not in config:
            raise OptionError(
                f"{where}: expected the names of its classes as id2label in config.json beside it, "
                'found none; write {"id2label": {"0": "wall", "1": "floor", ...}}'
            )
        self.table = label_table({int(k): str(v) for k, v in config["id2label"].items()}, where)
        try:
            self._session = runtime.InferenceSession(
                str(path), providers=_providers(runtime, device)
            )
        except OptionError:
            raise
        except Exception as error:  # onnxruntime's errors share no public base
            line = str(error).strip().split("\n")[0][:200]
            raise OptionError(
                f"{where}: expected an ONNX model that onnxruntime runs, found: {line}"
            ) from error
        self._input = self._session.get_inputs()[0]
        shape = self._input.shape
        if len(shape) != 4 or (shape[1] not in (3, None) and not isinstance(shape[1], str)):
            raise OptionError(
                f"{where}: expected an image input of shape (n, 3, h, w), found {shape}"
            )
        settings = path.parent / "preprocessor_config.json"
        self._prepare(_read_json(settings, where) if settings.exists() else {}, shape)

    def _prepare(self, settings: dict[str, Any], shape: list[Any]) -> None:
        size = settings.get("size", _DEFAULT_SIZE_PX)
        if not isinstance(size, dict):
            size = {"height": size, "width": size}
        edge = size.get("shortest_edge", _DEFAULT_SIZE_PX)
        wanted = (size.get("height", edge), size.get("width", edge))
        # A number in the model's own input is a must; a name is a size that may vary.
        self._height, self._width = (
            int(must if isinstance(must, int) else want)
            for must, want in zip(shape[2:], wanted, strict=True)
        )
        self._fixed_batch = shape[0] if isinstance(shape[0], int) else None
        self._scale = float(settings.get("rescale_factor", 1 / 255))
        self._mean = np.array(settings.get("image_mean", _IMAGENET_MEAN), dtype=np.float32)
        self._std = np.array(settings.get("image_std", _IMAGENET_STD), dtype=np.float32)

    def classes(
        self, images: list[UInt8[np.ndarray, "_ _ 3"]], sizes: list[tuple[int, int]]
    ) -> list[Integer[np.ndarray, "_ _"]]:
        """Class numbers of RGB images, at the sizes (h, w) asked for."""
        pixels = np.stack([self._pixels(image) for image in images])
        n = self._fixed_batch or len(pixels)
        found: list[np.ndarray] = []
        for start in range(0, len(pixels), n):
            part = pixels[start : start + n]
            padded = np.concatenate([part, np.repeat(part[-1:], n - len(part), axis=0)])
            output = self._session.run(None, {self._input.name: padded})[0][: len(part)]
            found += list(np.asarray(output))
        return [_at_size(x, size) for x, size in zip(found, sizes, strict=True)]

    def _pixels(self, image: np.ndarray) -> np.ndarray:
        scaled = cv2.resize(
            image, (self._width, self._height), interpolation=cv2.INTER_LINEAR
        ).astype(np.float32)
        return ((scaled * self._scale - self._mean) / self._std).transpose(2, 0, 1)


def _at_size(output: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Class numbers (h, w) of scores (classes, h', w') or of class numbers (h', w') or (1, h', w')."""
    height, width = size
    if output.ndim == 3 and output.shape[0] > 1:
        scores = [
            cv2.resize(x.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
            for x in output
        ]
        return np.argmax(scores, axis=0)
    classes = output.reshape(output.shape[-2:]).astype(np.int32)
    return np.asarray(cv2.resize(classes, (width, height), interpolation=cv2.INTER_NEAREST))


def _providers(runtime: Any, device: str) -> list[Any]:
    available = runtime.get_available_providers()
    if device == "cpu" or (device == "auto" and "CUDAExecutionProvider" not in available):
        return ["CPUExecutionProvider"]
    kind, _, number = device.partition(":")
    if kind not in ("auto", "cuda") or "CUDAExecutionProvider" not in available:
        raise OptionError(
            f"segmentation.learned.device: expected auto, cpu or a GPU that onnxruntime sees, found "
            f"{device!r}; it has {', '.join(available)}"
        )
    return [("CUDAExecutionProvider", {"device_id": int(number or 0)}), "CPUExecutionProvider"]


def _read_json(path: Path, where: str) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise OptionError(f"{where}: expected JSON in {path.name} beside it, {error}") from error
    return content if isinstance(content, dict) else {}


def label_of_name(name: str) -> Label:
    """The label of one class: `rug;carpet;carpeting` is floor, `wall-brick` wall, `wall clock` other.

    Synonyms are parted by `,` `;` or `/`; one of them is enough.
    """
    for synonym in re.split(r"[,;/]", name.lower()):
        words = {_singular(word) for word in re.findall(r"[a-z]+", synonym)} - _QUALIFIERS
        for label, names in _NAMES.items():
            if len(words) == 1 and words <= names:
                return label
    return Label.OTHER


def label_table(id2label: Mapping[int, str], where: str) -> UInt8[np.ndarray, " n"]:
    """Labels of `Label` by class number, 0 to the largest; numbers without name are NONE.

    Raises:
        OptionError: no class is a floor or a wall; `where` names the model.
    """
    table = np.full(max(id2label, default=-1) + 1, Label.NONE, dtype=np.uint8)
    for number, name in id2label.items():
        table[number] = label_of_name(name)
    missing = [
        label.name.lower() for label in (Label.FLOOR, Label.WALL) if not np.any(table == label)
    ]
    if missing:
        shown = ", ".join(list(id2label.values())[:8])
        raise OptionError(
            f"{where}: expected classes named floor and wall (or ground, carpet, rug), found no "
            f"{' and no '.join(missing)} among {len(id2label)} classes ({shown} ...); take a model that "
            "was trained on indoor scenes, or name its classes in id2label of its config.json"
        )
    return table


def _singular(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word
