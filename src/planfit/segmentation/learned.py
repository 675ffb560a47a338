"""Floor, walls, ceiling and columns by a segmentation model over the colour images.

Models come through transformers (SegFormer, Mask2Former, MaskFormer, OneFormer and the like) by hub name or
local folder, or as an ONNX file; both need the extra `learned`. planfit ships no weights.
"""

import hashlib
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Integer, UInt8

from planfit.errors import OptionError, ScanError, require_positive
from planfit.scan import Scan
from planfit.segmentation.learned_models import OnnxModel, TransformersModel

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


@runtime_checkable
class Model(Protocol):
    """A segmentation model with its label set."""

    table: UInt8[np.ndarray, " n_classes"]
    """Of `Label`, by class number."""

    def classes(
        self, images: list[UInt8[np.ndarray, "_ _ 3"]], sizes: list[tuple[int, int]]
    ) -> list[Integer[np.ndarray, "_ _"]]:
        """Class numbers of RGB images, at the sizes (h, w) asked for."""
        ...


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


def load_model(options: LearnedOptions) -> Model:
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
