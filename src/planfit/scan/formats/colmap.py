"""A COLMAP model with a folder of depth."""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from planfit.scan.formats.colmap_model import (
    ColmapCamera,
    ColmapImage,
    model_files,
    read_model,
    write_binary_model,
    write_frames,
    write_model,
)
from planfit.scan.images.lens import Lens
from planfit.scan.layout import FolderLayout, Listing, Refined, each_frame
from planfit.scan.recording import Frame, Size, id_of_name
from planfit.scan.source import FileSource
from planfit.scan.tables import first_of, has_part
from planfit.scan.types import ScanOptions

COLOR_FOLDERS = ("images", "color", "rgb")
DEPTH_FOLDERS = ("depth", "depths", "stereo/depth_maps")
IMAGES = {
    folder: "|".join(str(PurePosixPath(folder) / f"images.{end}") for end in ("txt", "bin"))
    for folder in ("sparse/0", "sparse", "")
}
"""A model's file of images, by the folder of the model."""
MODELS = "|".join(IMAGES.values())
DEPTHS = "|".join(f"{name}/" for name in DEPTH_FOLDERS)


@dataclass(frozen=True)
class _Model:
    """Cameras by their ids, and images by the names of their colour; `where` is the file of cameras."""

    folder: str
    cameras: dict[int, ColmapCamera]
    image_of: dict[str, ColmapImage]
    where: Path


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Model]:  # noqa: ARG001
    folder = next((one for one, names in IMAGES.items() if has_part(source, names)), "")
    cameras_file, images_file = model_files(source, folder)
    cameras, images = read_model(source, folder)
    colors = next((n for n in COLOR_FOLDERS if n in source.folders()), COLOR_FOLDERS[0])
    depths = next(n for n in DEPTH_FOLDERS if has_part(source, f"{n}/"))
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
        f"frame {PurePosixPath(name).stem}: {PurePosixPath(images_file).name} has no pose"
        for name in lone
        if source.exists(_depth_name(source, depths, name))
    ]
    model = _Model(folder, cameras, image_of, source.path / cameras_file)
    return Listing(source, frames, model, [cameras_file, images_file], skipped)


def _lens(listing: Listing[_Model], frame: Frame, _: Size) -> Lens:
    model = listing.content
    camera = model.cameras[model.image_of[frame.color].camera_id]
    return camera.lens(f"{model.where}, camera {camera.camera_id}")


def _write(refined: Refined[_Model]) -> None:
    """In the form it came in: COLMAP prefers a binary model to one of text beside it, and frames to images.

    What images observe stays, the points do not: they lay where the old poses put them, and
    point_triangulator finds them again.
    """
    model = refined.content
    _, whole = read_model(refined.source, model.folder, observations=True)
    uv_of = {image.image_id: image.uv for image in whole}
    images = []
    for frame, pose in zip(refined.frames, refined.poses, strict=True):
        old = model.image_of[frame.color]
        uv = uv_of[old.image_id]
        none = np.full(0 if uv is None else len(uv), -1)
        images.append(ColmapImage(old.image_id, old.camera_id, old.name, pose, uv, none))
    write = write_binary_model if model.where.suffix == ".bin" else write_model
    write(refined.directory, list(model.cameras.values()), images)
    if refined.source.exists(str(PurePosixPath(model.folder) / f"frames{model.where.suffix}")):
        write_frames(refined.directory, images, model.where.suffix == ".bin")


def _depth_name(source: FileSource, folder: str, name: str) -> str:
    stem = PurePosixPath(name).with_suffix("")
    dense = (f"{name}.geometric.bin", f"{name}.photometric.bin")
    names = (f"{stem}.png", f"{stem}.npy", f"{name}.png", *dense)
    return first_of(source, [f"{folder}/{one}" for one in names])


COLMAP = FolderLayout(
    name="colmap",
    page="""A COLMAP model with a folder of depth.

    SCAN/sparse/0/, sparse/, or SCAN/    cameras and images, .bin or .txt
    SCAN/images/ (or color/, rgb/)       colour, by the names of the model
    SCAN/depth/ (or depths/)             NAME.png 16-bit millimetres, or NAME.npy metres
    SCAN/stereo/depth_maps/              in its place: NAME.geometric.bin (else photometric) of COLMAP's own
                                         patch_match_stereo, in folders as the images are

The model must be in metres, as the depth is: structure from motion alone does not know its scale. Refined
poses are written as the model came, binary or text, with what the images observed, and without points, which
`colmap point_triangulator` finds again. Rigs and frames of COLMAP 3.12, where the model has them, are written
as COLMAP reads older models: a rig a camera, a frame an image, so that each image has its refined pose.
""",
    expects=(
        "images.bin or images.txt in sparse/0/, sparse/ or the folder itself, with depth/ or "
        "stereo/depth_maps/"
    ),
    checked=(
        "two real models: binary by COLMAP (10 images, 1,430 observations in the first), text"
        " by an ARKit exporter (20 images)",
        "both read with their observations; pycolmap reads what is written",
    ),
    told_by=(MODELS, DEPTHS),
    parts=("sparse/|cameras.txt|cameras.bin", MODELS, DEPTHS),
    frames=_frames,
    lens=each_frame(_lens),
    write=_write,
)
