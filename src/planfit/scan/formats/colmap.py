"""A COLMAP model with a folder of depth.

    SCAN/sparse/0/, sparse/, or SCAN/    cameras and images, .bin or .txt
    SCAN/images/ (or color/, rgb/)       colour, by the names of the model
    SCAN/depth/ (or depths/)             NAME.png 16-bit millimetres, or NAME.npy metres

The model must be in metres, as the depth is: structure from motion alone does not know its scale. Refined
poses are written with what the images observed, and without points, which `colmap point_triangulator` finds
again.
"""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float

from planfit.scan.formats.colmap_model import ColmapImage, model_files, read_model, write_model
from planfit.scan.images.files import ImageFiles
from planfit.scan.images.lens import Lens
from planfit.scan.options import ScanOptions
from planfit.scan.recording import Frame, Recording, Size, id_of_name
from planfit.scan.source import FileSource

EXPECTS = (
    "images.bin or images.txt in sparse/0/, sparse/ or the folder itself, with a folder depth/"
)
CHECKED = (
    "two real models: binary by COLMAP (10 images, 1,430 observations in the first), text"
    " by an ARKit exporter (20 images)",
    "both read with their observations; pycolmap reads what is written",
)
"""Where the layout is known from, and what was checked with it."""
MODEL_FOLDERS = ("sparse/0", "sparse", "")
COLOR_FOLDERS = ("images", "color", "rgb")
DEPTH_FOLDERS = ("depth", "depths")
PARTS = (
    "sparse/|cameras.txt|cameras.bin",
    "|".join(
        str(PurePosixPath(f) / name) for f in MODEL_FOLDERS for name in ("images.txt", "images.bin")
    ),
    "|".join(f"{name}/" for name in DEPTH_FOLDERS),
)


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return _model_folder(source) is not None and any(
        name in source.folders() for name in DEPTH_FOLDERS
    )


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    folder = _model_folder(source)
    assert folder is not None
    cameras_file, images_file = (PurePosixPath(name).name for name in model_files(source, folder))
    cameras, images = read_model(source, folder)
    colors = next((n for n in COLOR_FOLDERS if n in source.folders()), COLOR_FOLDERS[0])
    depths = next(n for n in DEPTH_FOLDERS if n in source.folders())
    image_of = {f"{colors}/{image.name}": image for image in images}
    frames = [
        Frame(
            id_of_name(image.name),
            float(i),
            image.world_from_cam,
            color=f"{colors}/{image.name}",
            depth=_depth_name(source, depths, image.name),
        )
        for i, image in enumerate(images)
    ]
    lone = [n for n in source.names(colors) if f"{colors}/{n}" not in image_of]
    skipped = [
        f"frame {PurePosixPath(name).stem}: {images_file} has no pose"
        for name in lone
        if source.exists(_depth_name(source, depths, name))
    ]

    def lens(frame: Frame, _: Size) -> Lens:
        camera = cameras[image_of[frame.color].camera_id]
        where = source.path / folder / f"{cameras_file}, camera {camera.camera_id}"
        return camera.lens(str(where))

    def write_poses(
        directory: Path, written: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
    ) -> None:
        olds = [image_of[frame.color] for frame in written]
        write_model(directory, list(cameras.values()), _refined(source, folder, olds, poses))

    tables = [f"{folder}/{name}".lstrip("/") for name in (cameras_file, images_file)]
    scale = options.depth_scale
    stored = ImageFiles(source, scale or 1e-3, metres_per_float=scale or 1.0)
    return Recording(
        format="colmap",
        path=source.path,
        frames=frames,
        images=stored,
        color_lens=lens,
        write_poses=write_poses,
        fingerprint=stored.fingerprint(tables, frames, options),
        skipped=skipped,
    )


def _refined(
    source: FileSource,
    folder: str,
    olds: Sequence[ColmapImage],
    poses: Float[np.ndarray, "k 4 4"],
) -> list[ColmapImage]:
    """Images with other poses. What they observe stays, the points do not: they lay where the old poses put
    them, and point_triangulator finds them again."""
    _, whole = read_model(source, folder, observations=True)
    uv_of = {image.image_id: image.uv for image in whole}
    refined = []
    for old, pose in zip(olds, poses, strict=True):
        uv = uv_of[old.image_id]
        none = np.full(0 if uv is None else len(uv), -1)
        refined.append(ColmapImage(old.image_id, old.camera_id, old.name, pose, uv, none))
    return refined


def _model_folder(source: FileSource) -> str | None:
    for folder in MODEL_FOLDERS:
        prefix = f"{folder}/" if folder else ""
        if source.exists(f"{prefix}images.bin") or source.exists(f"{prefix}images.txt"):
            return folder
    return None


def _depth_name(source: FileSource, folder: str, name: str) -> str:
    stem = PurePosixPath(name).with_suffix("")
    candidates = [f"{folder}/{stem}.png", f"{folder}/{stem}.npy", f"{folder}/{name}.png"]
    return next((n for n in candidates if source.exists(n)), candidates[0])
