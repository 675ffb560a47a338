"""Learned keypoints and matchers: SuperPoint, LightGlue, SuperGlue, through transformers.

Keypoints are found once a frame and matched once a pair. The matchers of transformers find keypoints
themselves, from two images; here their detector is replaced by one that hands over those found already.
"""

from threading import Lock
from typing import Any

import numpy as np
from jaxtyping import Int, UInt8

from planfit.errors import OptionError
from planfit.matching.types import Detections, Detector, Keypoints, Matcher
from planfit.runtime import find_weights, load_model

_WITHOUT = "--matching.keypoints.kind sift and --matching.matcher.kind nearest"
_CLASSES = {
    "superpoint": "SuperPointForKeypointDetection",
    "lightglue": "LightGlueForKeypointMatching",
    "superglue": "SuperGlueForKeypointMatching",
}
"""What transformers calls the models."""


def superpoint(weights: str, device: str, max_per_frame: int) -> Detector:
    """SuperPoint (DeTone, Malisiewicz and Rabinovich 2018); whole pixels, (k, 256) float16 descriptors.

    Raises:
        OptionError: the weights cannot be had.
    """
    torch, model, device_found = _load("keypoints", weights, "superpoint", device)
    lock = Lock()

    def detect(grey: UInt8[np.ndarray, "h w"], _: object) -> Detections:
        image = torch.from_numpy(grey.astype(np.float32) / 255.0)[None, None].to(device_found)
        with lock, torch.inference_mode():
            found = model(image.expand(1, 3, -1, -1))
        scores = found.scores[0].cpu().numpy()
        best = np.argsort(-scores, kind="stable")[:max_per_frame]
        best = best[found.mask[0].cpu().numpy()[best] > 0]
        height, width = grey.shape
        uv = found.keypoints[0].cpu().numpy()[best] * np.array([width, height], np.float32)
        descriptors = found.descriptors[0].cpu().numpy()[best].astype(np.float16)
        return Detections(uv.astype(np.float32), scores[best], descriptors)

    return detect


def glue(kind: str, weights: str, device: str) -> Matcher:
    """LightGlue (Lindenberger et al. 2023) or SuperGlue (Sarlin et al. 2020) on SuperPoint's keypoints.

    Raises:
        OptionError: the weights cannot be had.
    """
    torch, model, device_found = _load("matcher", weights, kind, device)
    given = _given_keypoints(torch)
    model.keypoint_detector = given
    lock = Lock()

    def match(
        a: Keypoints, b: Keypoints, size_a: tuple[int, int], size_b: tuple[int, int]
    ) -> Int[np.ndarray, "m 2"]:
        if len(a) == 0 or len(b) == 0:
            return np.zeros((0, 2), dtype=int)
        width, height = max(size_a[0], size_b[0]), max(size_a[1], size_b[1])
        size = np.array([width, height], np.float32)
        most = max(len(a), len(b))
        # A batch needs one length: the shorter list is filled up, and masked out (the last pair below).
        tensors = [
            torch.from_numpy(np.stack([_filled(part, most) for part in both])).to(device_found)
            for both in (
                (a.uv / size, b.uv / size),
                (a.scores, b.scores),
                (a.descriptors.astype(np.float32), b.descriptors.astype(np.float32)),
                (np.ones(len(a), np.int32), np.ones(len(b), np.int32)),
            )
        ]
        with lock, torch.inference_mode():
            given.found = tuple(tensors)
            # Of the images, the model now looks at the size alone.
            matches = model(torch.zeros(1, 2, 1, height, width, device=device_found)).matches
        other = matches.reshape(2, most)[0, : len(a)].cpu().numpy()
        first = np.flatnonzero((other >= 0) & (other < len(b)))
        return np.column_stack([first, other[first]]).astype(int)

    return match


def _load(part: str, name: str, kind: str, device: str) -> tuple[Any, Any, Any]:
    """torch, a model of the kind that an option of matching names, and the device that it is on."""
    weights = find_weights(f"matching.{part}.weights", name, _WITHOUT)
    found = weights.config.model_type
    if found != kind:
        raise OptionError(
            f"{weights.where}: expected weights of {kind}, found those of {found}; give a model of that kind"
        )
    model_class = getattr(weights.transformers, _CLASSES[kind])
    model, device_found = load_model(weights, model_class, kind, "matching.device", device)
    return weights.torch, model, device_found


def _given_keypoints(torch: Any) -> Any:
    """A detector that returns what it was given, in the order of SuperPoint's output."""

    class FixedOutput(torch.nn.Module):
        found: tuple = ()

        def forward(self, _: Any) -> tuple:
            return self.found

    return FixedOutput()


def _filled(part: np.ndarray, length: int) -> np.ndarray:
    filled = np.zeros((length, *part.shape[1:]), dtype=part.dtype)
    filled[: len(part)] = part
    return filled
