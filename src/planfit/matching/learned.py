"""Learned keypoints and matchers: SuperPoint, LightGlue, SuperGlue, through transformers.

Keypoints are found once a frame and matched once a pair. The matchers of transformers find keypoints
themselves, from two images; here their detector is replaced by one that hands over those found already.
"""

import importlib
from threading import Lock
from typing import Any

import numpy as np

from planfit.matching.detectors import Detections, Detector
from planfit.matching.matchers import Matcher
from planfit.matching.weights import load_model


def superpoint(weights: str, device: str, max_per_frame: int) -> Detector:
    """SuperPoint (DeTone, Malisiewicz and Rabinovich 2018); whole pixels, (k, 256) float16 descriptors.

    Raises:
        OptionError: the weights cannot be had.
    """
    model = load_model(
        "keypoints.weights", weights, "SuperPointForKeypointDetection", "superpoint", device
    )
    torch = importlib.import_module("torch")

    lock = Lock()

    def detect(grey: np.ndarray, _: np.ndarray | None) -> Detections:
        image = torch.from_numpy(grey.astype(np.float32) / 255.0)[None, None].to(device)
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
    class_name = {"lightglue": "LightGlue", "superglue": "SuperGlue"}[kind] + "ForKeypointMatching"
    model = load_model("matcher.weights", weights, class_name, kind, device)
    given = _given_keypoints()
    model.keypoint_detector = given
    torch = importlib.import_module("torch")

    lock = Lock()

    def match(a: Any, b: Any, size_a: tuple[int, int], size_b: tuple[int, int]) -> np.ndarray:
        if len(a) == 0 or len(b) == 0:
            return np.zeros((0, 2), dtype=int)
        width, height = max(size_a[0], size_b[0]), max(size_a[1], size_b[1])
        size = np.array([width, height], np.float32)
        most = max(len(a), len(b))
        tensors = [
            torch.from_numpy(np.stack([_filled(part, most) for part in both])).to(device)
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
            matches = model(torch.zeros(1, 2, 1, height, width, device=device)).matches
        other = matches.reshape(2, most)[0, : len(a)].cpu().numpy()
        first = np.flatnonzero((other >= 0) & (other < len(b)))
        return np.column_stack([first, other[first]]).astype(int)

    return match


def _given_keypoints() -> Any:
    """A detector that returns what it was given, in the order of SuperPoint's output."""
    torch = importlib.import_module("torch")

    class Given(torch.nn.Module):
        found: tuple = ()

        def forward(self, _: Any) -> tuple:
            return self.found

    return Given()


def _filled(part: np.ndarray, length: int) -> np.ndarray:
    filled = np.zeros((length, *part.shape[1:]), dtype=part.dtype)
    filled[: len(part)] = part
    return filled
