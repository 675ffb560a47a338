"""Small pictures of some frames, the right way up."""

import io
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan

WIDTH_PX = 320
_QUALITY = 60


def frames_with_pictures(n_frames: int, max_pictures: int) -> Int[np.ndarray, " k"]:
    """Frames to show pictures of, evenly spread, first and last among them."""
    if max_pictures == 0:
        return np.zeros(0, dtype=int)
    return np.unique(np.linspace(0, n_frames - 1, min(n_frames, max_pictures)).round().astype(int))


def make_pictures(
    scan: Scan, plan_from_cams: Float[np.ndarray, "n 4 4"], max_pictures: int, runtime: Runtime
) -> dict[int, bytes]:
    """JPEGs by frame: colour, or nearness in grey where a frame has none; turned so that up is up."""
    chosen = frames_with_pictures(len(scan), max_pictures)
    turns = [quarter_turns(plan_from_cams[i]) for i in chosen]
    key = cache_key(scan.fingerprint, WIDTH_PX, _QUALITY, chosen.tolist(), turns)
    make = partial(_picture, scan, chosen, turns)
    found = runtime.map("pictures", key, len(chosen), make)
    return {int(i): item["jpeg"].tobytes() for i, item in zip(chosen, found, strict=True)}


def quarter_turns(plan_from_cam: Float[np.ndarray, "4 4"]) -> int:
    """Quarter turns, counter-clockwise, that bring what is up in the plan up in the image; 0 where the camera
    looks along it."""
    right, down = plan_from_cam[2, :2]  # heights of the camera's axes
    if np.hypot(right, down) < 0.3:
        return 0
    # Up in the image is -down: its angle from there, to the nearest quarter.
    return int(np.round(np.arctan2(right, -down) / (np.pi / 2))) % 4


def _picture(scan: Scan, chosen: Int[np.ndarray, " k"], turns: list[int], k: int) -> Arrays:
    frame = int(chosen[k])
    image = scan.files.color(frame)
    if image is None:
        image = _grey(scan.files.depth(frame))
    height = max(1, round(image.shape[0] * WIDTH_PX / image.shape[1]))
    if image.shape[1] > WIDTH_PX:
        image = cv2.resize(image, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    buffer = io.BytesIO()
    turned = np.ascontiguousarray(np.rot90(image, turns[k]))
    Image.fromarray(turned).save(buffer, "JPEG", quality=_QUALITY)
    return {"jpeg": np.frombuffer(buffer.getvalue(), dtype=np.uint8)}


def _grey(depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Near is white, far is dark, unknown is black."""
    known = np.isfinite(depth) & (depth > 0)
    if not known.any():
        return np.zeros((*depth.shape, 3), dtype=np.uint8)
    near, far = np.percentile(depth[known], [1, 99])
    share = np.clip((depth - near) / max(far - near, 1e-6), 0.0, 1.0)
    grey = np.where(known, 255 - 215 * share, 0).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
