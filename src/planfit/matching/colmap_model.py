"""Images of a COLMAP sparse model: names, sizes, and where each saw which 3D point."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from planfit.errors import ScanError

N_PARAMETERS = (3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4)
"""Number of parameters of COLMAP's camera models, by their number."""


@dataclass(frozen=True)
class ModelImage:
    """One registered image."""

    name: str
    width: int
    height: int
    uv: np.ndarray  # (k, 2) px, as COLMAP counts them
    point_id: np.ndarray  # (k,) int64, -1 where no 3D point


def read_model(folder: Path) -> dict[int, ModelImage]:
    """Images by their id, from `cameras` and `images` in binary or text.

    Raises:
        ScanError: the files are missing or damaged.
    """
    for suffix, cameras, images in (
        (".bin", _binary_cameras, _binary_images),
        (".txt", _text_cameras, _text_images),
    ):
        paths = [folder / f"{name}{suffix}" for name in ("cameras", "images")]
        if all(path.is_file() for path in paths):
            try:
                return images(paths[1], cameras(paths[0]))
            except (OSError, ValueError, KeyError, IndexError, struct.error) as error:
                raise ScanError(
                    f"{folder}: expected a COLMAP model, found {paths[1].name} or {paths[0].name} "
                    f"damaged ({type(error).__name__}: {error}); export it again"
                ) from error
    raise ScanError(
        f"{folder}: expected a COLMAP model, found neither cameras.bin and images.bin nor "
        "cameras.txt and images.txt"
    )


Sizes = dict[int, tuple[int, int]]


def _read(file: BinaryIO, layout: str) -> tuple:
    return struct.unpack(f"<{layout}", file.read(struct.calcsize(f"<{layout}")))


def _binary_cameras(path: Path) -> Sizes:
    sizes = {}
    with path.open("rb") as file:
        for _ in range(_read(file, "Q")[0]):
            camera, model, width, height = _read(file, "iiQQ")
            file.read(8 * N_PARAMETERS[model])
            sizes[camera] = (width, height)
    return sizes


def _binary_images(path: Path, sizes: Sizes) -> dict[int, ModelImage]:
    images = {}
    layout = np.dtype([("uv", "<f8", 2), ("point", "<i8")])
    with path.open("rb") as file:
        for _ in range(_read(file, "Q")[0]):
            image, *_, camera = _read(file, "I7dI")
            name = bytearray()
            while (char := file.read(1)) != b"\0":
                if not char:
                    raise ValueError("the file ends inside a name")
                name += char
            n = _read(file, "Q")[0]
            data = file.read(layout.itemsize * n)
            points = np.frombuffer(data, dtype=layout, count=n)
            images[image] = ModelImage(
                name.decode(), *sizes[camera], points["uv"].copy(), points["point"].copy()
            )
    return images


def _text_cameras(path: Path) -> Sizes:
    rows = [line.split() for line in path.read_text().splitlines() if _is_data(line)]
    return {int(row[0]): (int(row[2]), int(row[3])) for row in rows}


def _text_images(path: Path, sizes: Sizes) -> dict[int, ModelImage]:
    # Every second line lists points, and is empty for an image without any.
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    images = {}
    for head, points in zip(lines[::2], lines[1::2], strict=True):
        fields = head.split(maxsplit=9)
        values = np.array(points.split(), dtype=float).reshape(-1, 3)
        images[int(fields[0])] = ModelImage(
            fields[9], *sizes[int(fields[8])], values[:, :2], values[:, 2].astype(np.int64)
        )
    return images


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.startswith("#")
