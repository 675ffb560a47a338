"""Semantic and universal segmentation models through the transformers library."""

import importlib
from typing import Any

import numpy as np
from jaxtyping import Integer, UInt8

from planfit.errors import OptionError
from planfit.runtime import find_weights, first_line, load_model
from planfit.segmentation.label_names import label_table

_NOT_SAVED = ("criterion.",)
"""Weights of the training loss, which are not saved with every model."""


class TransformersModel:
    """SegFormer and its like, Mask2Former, MaskFormer, OneFormer."""

    def __init__(self, name: str, device: str) -> None:
        """Load by hub name or local folder.

        Raises:
            OptionError: see `planfit.segmentation.learned.load_model`.
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
        self._model, self._device = load_model(
            weights, auto, "a segmentation model", "segmentation.learned.device", device, _NOT_SAVED
        )

    def classes(
        self, images: list[UInt8[np.ndarray, "_ _ 3"]], sizes: list[tuple[int, int]]
    ) -> list[Integer[np.ndarray, "_ _"]]:
        """See `planfit.segmentation.learned.Model`."""
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
