"""A COLMAP model with a folder of depth.

    SCAN/sparse/0/, sparse/, or SCAN/    cameras and images, .bin or .txt
    SCAN/images/ (or color/, rgb/)       colour, by the names of the model
    SCAN/depth/ (or depths/)             NAME.png 16-bit millimetres, or NAME.npy metres

The model must be in metres, as the depth is: structure from motion alone does not know its scale.
"""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from planfit.scan.formats.colmap_model import ColmapImage, model_files, read_model, write_model
from planfit.scan.images.image_files import Entry
from planfit.scan.images.lens import Lens
from planfit.scan.layout import Layout, scan_of_layout
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source
from planfit.scan.types import Scan

LOOKS_FOR = (
    "images.bin or images.txt in sparse/0/, sparse/ or the folder itself, with a folder depth/"
)
MODEL_FOLDERS = ("sparse/0", "sparse", "")
COLOR_FOLDERS = ("images", "color", "rgb")
DEPTH_FOLDERS = ("depth", "depths")
PARTS = ("sparse/", "depth/")


def recognise(source: Source) -> bool:
    """Whether a folder has this layout."""
    return _model_folder(source) is not None and any(
        name in source.folders() for name in DEPTH_FOLDERS
    )


def read(source: Source, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    folder = _model_folder(source)
    assert folder is not None
    prefix = f"{folder}/" if folder else ""
    cameras_file, images_file = (PurePosixPath(name).name for name in model_files(source, folder))
    cameras, images = read_model(source, folder)
    colors = next((n for n in COLOR_FOLDERS if n in source.folders()), COLOR_FOLDERS[0])
    depths = next(n for n in DEPTH_FOLDERS if n in source.folders())
    image_of = {f"{colors}/{image.name}": image for image in images}
    entries = [
        Entry(
            str(PurePosixPath(image.name).with_suffix("")).replace("../", "").replace("/", "_"),
            float(i),
            image.world_from_cam,
            f"{colors}/{image.name}",
            _depth_name(source, depths, image.name),
        )
        for i, image in enumerate(images)
    ]

    lone = [n for n in source.names(colors) if f"{colors}/{n}" not in image_of]
    skipped = [
        f"frame {PurePosixPath(name).stem}: {images_file} has no pose"
        for name in lone
        if source.exists(_depth_name(source, depths, name))
    ]

    def lens(entry: Entry, _: tuple[int, int]) -> Lens:
        camera = cameras[image_of[entry.color].camera_id]
        where = source.path / folder / f"{cameras_file}, camera {camera.camera_id}"
        return camera.lens(str(where))

    def write_poses(directory: Path, written: Sequence[Entry], poses: np.ndarray) -> None:
        refined = [
            ColmapImage(old.image_id, old.camera_id, old.name, pose)
            for old, pose in zip((image_of[e.color] for e in written), poses, strict=True)
        ]
        write_model(directory, list(cameras.values()), refined)

    layout = Layout(
        "colmap",
        entries,
        1e-3,
        write_poses,
        lens,
        other_files=[
            name
            for stem in ("cameras", "images")
            for name in (f"{prefix}{stem}.bin", f"{prefix}{stem}.txt")
            if source.exists(name)
        ],
        skipped=skipped,
    )
    return scan_of_layout(source, layout, options)


def _model_folder(source: Source) -> str | None:
    for folder in MODEL_FOLDERS:
        prefix = f"{folder}/" if folder else ""
        if source.exists(f"{prefix}images.bin") or source.exists(f"{prefix}images.txt"):
            return folder
    return None


def _depth_name(source: Source, folder: str, name: str) -> str:
    stem = PurePosixPath(name).with_suffix("")
    candidates = [f"{folder}/{stem}.png", f"{folder}/{stem}.npy", f"{folder}/{name}.png"]
    return next((n for n in candidates if source.exists(n)), candidates[0])
