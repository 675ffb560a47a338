"""Matches of a COLMAP database or sparse model, instead of our own keypoints and pairs.

Of a database, the verified matches are taken (`two_view_geometries`), or the raw ones where it has none;
of a model, two images match where they share 3D points. COLMAP puts the centre of the first pixel at
0.5, planfit at 0. Everything is still lifted by the scan's depth and verified like our own matches.
"""

import re
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int

from planfit.errors import ScanError
from planfit.scan import Scan
from planfit.scan.formats.colmap_model import read_model
from planfit.scan.source import FolderSource

_MAX_IMAGE_ID = 2_147_483_647
"""2**31 - 1, as COLMAP has it: two ids are one number of 64 bits in its database."""
MIN_SHARED = 8
"""Images of a model that share fewer points are no pair: verification would refuse them anyway."""


@dataclass(frozen=True)
class Imported:
    """Keypoints of each frame of a scan, and which of them match."""

    uv: tuple[Float32[np.ndarray, "_ 2"], ...]
    """px, of each frame."""
    pairs: Int[np.ndarray, "p 2"]
    """Frame indices, first < second."""
    matches: tuple[Int[np.ndarray, "_ 2"], ...]
    """Of each pair, indices into uv of the two."""


def stamp(path: Path) -> tuple:
    """What changes when the imported files do."""
    files = [path] if path.is_file() else sorted(path.iterdir()) if path.is_dir() else []
    return tuple((f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files)


def read_colmap_matches(path: Path, scan: Scan) -> Imported:
    """Matches of a database file or of the folder of a sparse model (text or binary).

    Images are told apart by their names: a frame's id, or the number that the name ends with.

    Raises:
        ScanError: the file is not such, or its images are not those of the scan.
    """
    if path.is_dir():
        names, sizes, uv, point_id = _read_model(path)
        frame_of = _frames(names, scan, path)
        pairs = _shared(point_id, frame_of)
    elif path.is_file():
        names, sizes, uv, pairs = _read_database(path)
        frame_of = _frames(names, scan, path)
    else:
        raise ScanError(
            f"{path}: expected a COLMAP database or the folder of a sparse model, found nothing there"
        )
    by_frame = [np.zeros((0, 2), np.float32)] * len(scan)
    for image, frame in frame_of.items():
        camera = scan.cameras[frame]
        scale = np.array([camera.width / sizes[image][0], camera.height / sizes[image][1]])
        by_frame[frame] = (uv[image] * scale - 0.5).astype(np.float32)
    return _by_frame_pair(by_frame, pairs, frame_of, names, path)


def _by_frame_pair(
    by_frame: list[np.ndarray],
    pairs: dict[tuple[int, int], np.ndarray],
    frame_of: dict[int, int],
    names: dict[int, str],
    path: Path,
) -> Imported:
    """Matches by pair of images to matches by pair of frames, sorted, the earlier frame first."""
    kept: dict[tuple[int, int], np.ndarray] = {}
    for (a, b), idx in pairs.items():
        if a in frame_of and b in frame_of and len(idx):
            i, j = frame_of[a], frame_of[b]
            if max(idx[:, 0].max() - len(by_frame[i]), idx[:, 1].max() - len(by_frame[j])) >= 0:
                raise ScanError(
                    f"{path}: expected matches of existing keypoints, found others between "
                    f"{names[a]} and {names[b]}; the file is damaged, make it again"
                )
            kept[(i, j) if i < j else (j, i)] = idx if i < j else idx[:, ::-1]
    order = sorted(kept)
    return Imported(
        tuple(by_frame),
        np.array(order, dtype=int).reshape(-1, 2),
        tuple(kept[pair] for pair in order),
    )


def _frames(names: dict[int, str], scan: Scan, path: Path) -> dict[int, int]:
    """Frame index of each image that is one of the scan's."""
    by_id = {frame_id: k for k, frame_id in enumerate(scan.frame_ids)}
    by_number: dict[int, int] = {}
    for k, frame_id in enumerate(scan.frame_ids):
        number = _number(frame_id)
        if number is not None:
            by_number[number] = k if number not in by_number else -1
    found: dict[int, int] = {}
    for image, name in names.items():
        stem = Path(name).stem
        number = _number(stem)
        frame = by_id.get(
            name, by_id.get(stem, by_number.get(-1 if number is None else number, -1))
        )
        if frame >= 0:
            if frame in found.values():
                raise ScanError(
                    f"{path}: expected one image a frame, found two that are frame "
                    f"{scan.frame_ids[frame]} (one is {name}); rename the images as the frames"
                )
            found[image] = frame
    if len(found) < 2:
        some = next(iter(names.values()), "no image")
        raise ScanError(
            f"{path}: expected images named as the scan's frames ({scan.frame_ids[0]} and so on), "
            f"found {len(names)} images of which {len(found)} are (such as {some})"
        )
    return found


def _number(name: str) -> int | None:
    found = re.search(r"(\d+)$", name)
    return int(found[1]) if found else None


def _read_model(path: Path) -> tuple[
    dict[int, str], dict[int, tuple[int, int]], dict[int, np.ndarray], dict[int, np.ndarray]
]:  # fmt: skip
    """Names, sizes, keypoints and their 3D points by image id."""
    cameras, images = read_model(FolderSource(path), observations=True)
    uv, point_id = {}, {}
    for image in images:
        assert image.uv is not None
        assert image.point_id is not None
        uv[image.image_id], point_id[image.image_id] = image.uv, image.point_id
    size_of = {number: (camera.width, camera.height) for number, camera in cameras.items()}
    names = {image.image_id: image.name for image in images}
    return names, {image.image_id: size_of[image.camera_id] for image in images}, uv, point_id


def _read_database(path: Path) -> tuple[
    dict[int, str], dict[int, tuple[int, int]], dict[int, np.ndarray], dict[tuple[int, int], np.ndarray]
]:  # fmt: skip
    """Names, sizes and keypoints by image id, and matches by pair of image ids."""
    try:
        # Read-only, and immutable: nothing of the input is ever changed, not even by a journal.
        database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            images = database.execute(
                "SELECT image_id, name, width, height FROM images JOIN cameras USING (camera_id)"
            ).fetchall()
            blobs = database.execute("SELECT image_id, rows, cols, data FROM keypoints").fetchall()
            query = "SELECT pair_id, rows, cols, data FROM {} WHERE rows > 0"
            pairs = database.execute(query.format("two_view_geometries")).fetchall()
            if not pairs:
                pairs = database.execute(query.format("matches")).fetchall()
        finally:
            database.close()
    except sqlite3.Error as error:
        raise ScanError(
            f"{path}: expected a COLMAP database, found a file that cannot be read as one ({error})"
        ) from error
    try:
        uv = {i: _array(data, rows, cols, np.float32)[:, :2] for i, rows, cols, data in blobs}
        matches = {
            (pair // _MAX_IMAGE_ID, pair % _MAX_IMAGE_ID): _array(data, rows, cols, np.uint32)
            for pair, rows, cols, data in pairs
        }
    except (ValueError, TypeError) as error:
        raise ScanError(
            f"{path}: expected whole keypoints and matches, found a damaged table ({error}); "
            "make the database again"
        ) from error
    for i, *_ in images:
        uv.setdefault(i, np.zeros((0, 2), np.float32))
    return (
        {i: name for i, name, _, _ in images},
        {i: (width, height) for i, _, width, height in images},
        uv,
        {pair: idx.astype(int) for pair, idx in matches.items()},
    )


def _array(data: bytes | None, rows: int, cols: int, dtype: type) -> np.ndarray:
    return np.frombuffer(data or b"", dtype=dtype).reshape(rows, cols)


def _shared(
    point_id: dict[int, np.ndarray], frame_of: dict[int, int]
) -> dict[tuple[int, int], np.ndarray]:
    """Matches by pair of images, from the 3D points that both see."""
    ids = sorted(frame_of)
    image = np.concatenate([np.full(len(point_id[i]), i) for i in ids])
    point = np.concatenate([point_id[i] for i in ids])
    number = np.concatenate([np.arange(len(point_id[i])) for i in ids])
    seen = point >= 0
    order = np.lexsort((image[seen], point[seen]))
    image, point, number = image[seen][order], point[seen][order], number[seen][order]
    # Observations of one point lie together: pair each with those k places on, while any is still of the
    # same point. The longest track bounds the loop, and no list of lists is built.
    rows: list[np.ndarray] = []
    for k in range(1, len(point)):
        same = np.flatnonzero((point[k:] == point[:-k]) & (image[k:] != image[:-k]))
        if not (point[k:] == point[:-k]).any():
            break
        rows.append(np.column_stack([image[same], image[same + k], number[same], number[same + k]]))
    if not rows:
        return {}
    every = np.concatenate(rows)
    every = every[np.lexsort(every.T[::-1])]  # lexsort takes its last key first
    borders = np.flatnonzero((np.diff(every[:, :2], axis=0) != 0).any(axis=1)) + 1
    groups: Sequence[np.ndarray] = np.split(every, borders)
    return {(int(g[0, 0]), int(g[0, 1])): g[:, 2:] for g in groups if len(g) >= MIN_SHARED}
