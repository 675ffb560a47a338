"""Opening and closing by squares, without shifts and without the border of the picture taking part."""

import cv2
import numpy as np


def opened(mask: np.ndarray, size: int) -> np.ndarray:
    """Without what is thinner than `size` px."""
    kernel = np.ones((size, size), np.uint8)
    # OpenCV's own opening shifts by a pixel where the size is even.
    back = (size - 1 - size // 2, size - 1 - size // 2)
    return cv2.dilate(cv2.erode(mask, kernel), kernel, anchor=back)


def closed(mask: np.ndarray, size: int) -> np.ndarray:
    """With gaps thinner than `size` px filled."""
    reach = size + 1  # the border of the picture is no wall
    padded = cv2.copyMakeBorder(mask, reach, reach, reach, reach, cv2.BORDER_CONSTANT, value=0)
    kernel = np.ones((size, size), np.uint8)
    back = (size - 1 - size // 2, size - 1 - size // 2)
    padded = cv2.erode(cv2.dilate(padded, kernel), kernel, anchor=back)
    return np.ascontiguousarray(padded[reach:-reach, reach:-reach])
