"""Semantic and universal segmentation models through the transformers library."""

import importlib
from typing import Any

import numpy as np

from planfit.errors import OptionError
from planfit.structure.label_names import label_table

_IGNORED = ("criterion.",)
"""Weights of the training loss, which are not saved with every model."""


class TransformersModel:
    """SegFormer and its like, Mask2Former, MaskFormer, OneFormer."""

    def __init__(self, name: str, device: str) -> None:
        """Load by hub name or local folder.

        Raises:
            OptionError: see `planfit.structure.learned.load_model`.
        """
        torch, transformers = _import("torch"), _import("transformers")
        where = f"structure.learned.model: {name}"
        try:
            config = transformers.AutoConfig.from_pretrained(name)
        except (OSError, ValueError) as error:
            raise OptionError(
                f"{where}: expected a folder with config.json and weights, or a model on the Hugging "
                f"Face hub, found neither ({_first_line(error)}); without network, fetch the model "
                "elsewhere and give its folder"
            ) from error
        mapping = importlib.import_module("transformers.models.auto.modeling_auto")
        is_universal = config.model_type in mapping.MODEL_FOR_UNIVERSAL_SEGMENTATION_MAPPING_NAMES
        auto = (
            transformers.AutoModelForUniversalSegmentation
            if is_universal
            else transformers.AutoModelForSemanticSegmentation
        )
        self._needs_task = config.model_type == "oneformer"
        processor = (
            transformers.AutoProcessor if self._needs_task else transformers.AutoImageProcessor
        )
        self.table = label_table(config.id2label, where)
        try:
            self._processor: Any = processor.from_pretrained(name)
            model, loaded = auto.from_pretrained(name, output_loading_info=True)
        except (OSError, ValueError, ImportError) as error:
            raise OptionError(
                f"{where}: expected a segmentation model with weights and preprocessor_config.json, "
                f"found a {config.model_type} that cannot be loaded ({_first_line(error)})"
            ) from error
        # transformers would fill these with random numbers and go on.
        missing = sorted(k for k in loaded["missing_keys"] if not k.startswith(_IGNORED))
        if missing:
            raise OptionError(
                f"{where}: expected the weights of a whole segmentation model, found none for "
                f"{missing[0]} and {len(missing) - 1} more; take a model that was fine-tuned for "
                "segmentation, not its backbone"
            )
        self._torch = torch
        self._device = _device(torch, device)
        self._model = model.to(self._device).eval()

    def classes(self, images: list[np.ndarray], sizes: list[tuple[int, int]]) -> list[np.ndarray]:
        """See `planfit.structure.learned.Model`."""
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


def _import(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise OptionError(
            f"structure.back_end: learned needs the library {name}, which is not installed; run "
            "`pip install 'planfit[learned]'`, or use --structure.back-end geometry"
        ) from error


def _device(torch: Any, name: str) -> Any:
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise OptionError(
            f"structure.learned.device: expected auto, cpu or a GPU that PyTorch sees, found {name!r} "
            f"({_first_line(error)})"
        ) from error
    return device


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0][:200]
