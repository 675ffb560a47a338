"""Classical keypoints: SIFT and ORB, each a function from a grey image to places and descriptors."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class Detections:
    """Keypoints of one image, before their depth is looked up."""

    uv: np.ndarray  # (k, 2) float32 px
    scores: np.ndarray  # (k,) float32, the larger the surer
    descriptors: np.ndarray  # (k, d): near in Euclidean distance where they show the same


Detector = Callable[[np.ndarray, np.ndarray | None], Detections]
"""Finds keypoints in a grey image (h, w) uint8; safe to call from several threads.

The second argument (h, w) uint8 is 0 where keypoints are of no use, or None: those may be left out, which
saves time, and no other may change for it.
"""


def sift(max_per_frame: int, contrast_threshold: float) -> Detector:
    """SIFT (Lowe 2004) with RootSIFT descriptors (Arandjelovic and Zisserman 2012).

    The Euclidean distance of RootSIFT is the Hellinger distance of the histograms. Descriptors are
    (k, 128) uint8, scaled by 512.
    """

    def detect(grey: np.ndarray, useful: np.ndarray | None) -> Detections:
        # OpenCV heeds the mask after it has chosen the strongest, before it describes them.
        found, raw = cv2.SIFT.create(
            nfeatures=max_per_frame, contrastThreshold=contrast_threshold
        ).detectAndCompute(grey, np.array([]) if useful is None else useful)
        if not found:
            return _nothing(128)
        normalised = raw / np.maximum(raw.sum(axis=1, keepdims=True), 1e-6)
        descriptors = np.minimum(np.sqrt(normalised) * 512.0, 255.0).astype(np.uint8)
        return Detections(*_places(found), descriptors)

    return detect


def orb(max_per_frame: int) -> Detector:
    """ORB (Rublee et al. 2011): a quarter of SIFT's time, fewer and less exact matches.

    Descriptors are their bits apart, (k, 256) uint8 of 0 and 1: the squared Euclidean distance is then
    the Hamming distance, and all that follows need not know which kind it is given.
    """

    # With a mask OpenCV's ORB would choose other keypoints; describing them takes little time anyway.
    def detect(grey: np.ndarray, _: np.ndarray | None) -> Detections:
        found, raw = cv2.ORB.create(nfeatures=max_per_frame, fastThreshold=8).detectAndCompute(
            grey, np.array([])
        )
        if not found:
            return _nothing(256)
        return Detections(*_places(found), np.unpackbits(raw.astype(np.uint8), axis=1))

    return detect


def without_descriptors(uv: np.ndarray) -> Detections:
    """Keypoints uv (k, 2) px that came from elsewhere, with their matches."""
    k = len(uv)
    return Detections(uv, np.ones(k, np.float32), np.zeros((k, 0), np.uint8))


def _places(found) -> tuple[np.ndarray, np.ndarray]:
    uv = np.array([k.pt for k in found], dtype=np.float32)
    return uv, np.array([k.response for k in found], dtype=np.float32)


def _nothing(dims: int) -> Detections:
    return Detections(
        np.zeros((0, 2), np.float32), np.zeros(0, np.float32), np.zeros((0, dims), np.uint8)
    )
