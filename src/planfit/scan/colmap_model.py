"""COLMAP's sparse models: cameras and images, as text or binary. Poses in the files are cam_from_world."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.frames import make_camera
from planfit.scan.lens import Lens
from planfit.scan.source import Source, read_text
from planfit.scan.tables import shorten

# Name, number of parameters, by number.
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
}


@dataclass(frozen=True)
class ColmapCamera:
    """A camera as the model has it."""

    camera_id: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]

    def lens(self, where: str) -> Lens:
        """Its lens; COLMAP counts from the corner of the first pixel, half a pixel more than we.

        Raises:
            ScanError: the parameters cannot be those of a camera; it begins with `where`.
        """
        p = self.parameters
        if self.model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"):
            focal, center, rest = (p[0], p[0]), p[1:3], p[3:]
            distortion = (*rest, *([0.0] * (4 - len(rest)))) if rest else ()
        else:
            focal, center, distortion = p[:2], p[2:4], p[4:]
        intrinsics = (*focal, center[0] - 0.5, center[1] - 0.5)
        camera = make_camera(self.width, self.height, intrinsics, where)
        return Lens(camera, tuple(distortion), self.model == "OPENCV_FISHEYE")


@dataclass(frozen=True)
class ColmapImage:
    """A posed image."""

    image_id: int
    camera_id: int
    name: str
    world_from_cam: np.ndarray  # (4, 4)


def read_model(source: Source, folder: str) -> tuple[dict[int, ColmapCamera], list[ColmapImage]]:
    """Cameras by number, and images sorted by name.

    Raises:
        ScanError: files are missing, cut off, or have cameras of another model.
    """
    prefix = f"{folder}/" if folder else ""
    if source.exists(f"{prefix}images.bin"):
        names = f"{prefix}cameras.bin", f"{prefix}images.bin"
        cameras, images = _binary_cameras(source, names[0]), _binary_images(source, names[1])
    else:
        names = f"{prefix}cameras.txt", f"{prefix}images.txt"
        cameras, images = _text_cameras(source, names[0]), _text_images(source, names[1])
    if not images:
        raise ScanError(f"{source.path / names[1]}: expected posed images, found none")
    for image in images:
        if image.camera_id not in cameras:
            raise ScanError(
                f"{source.path / names[0]}: expected camera {image.camera_id} of {image.name}, found "
                "none of this number; export the model again"
            )
    return cameras, sorted(images, key=lambda image: image.name)


def write_model(
    directory: Path,
    cameras: Sequence[ColmapCamera],
    images: Sequence[ColmapImage],
    points: np.ndarray | None = None,
    colors: np.ndarray | None = None,
) -> None:
    """cameras.txt, images.txt and points3D.txt in an existing folder.

    `points` (k, 3) m with `colors` (k, 3) uint8 are points without observations.
    """
    lines = ["# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for camera in cameras:
        parameters = " ".join(repr(float(v)) for v in camera.parameters)  # to the last bit
        lines.append(
            f"{camera.camera_id} {camera.model} {camera.width} {camera.height} {parameters}"
        )
    (directory / "cameras.txt").write_text("\n".join(lines) + "\n")
    lines = ["# Image list with two lines an image: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID,"
             " NAME; then POINTS2D[] as (X, Y, POINT3D_ID), empty here"]  # fmt: skip
    for image in images:
        cam_from_world = se3.inverse(image.world_from_cam)
        x, y, z, w = Rotation.from_matrix(cam_from_world[:3, :3]).as_quat(canonical=True)
        numbers = " ".join(f"{v:.12g}" for v in (w, x, y, z, *cam_from_world[:3, 3]))
        lines += [f"{image.image_id} {numbers} {image.camera_id} {image.name}", ""]
    (directory / "images.txt").write_text("\n".join(lines) + "\n")
    lines = [
        "# 3D point list: POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"
    ]
    if points is not None and colors is not None:
        lines += [
            f"{i} {x:.6f} {y:.6f} {z:.6f} {r} {g} {b} 0"
            for i, ((x, y, z), (r, g, b)) in enumerate(zip(points, colors, strict=True), start=1)
        ]
    (directory / "points3D.txt").write_text("\n".join(lines) + "\n")


def _camera(number: int, model: str, size: tuple[int, int], parameters: Sequence[float], where: str
            ) -> ColmapCamera:  # fmt: skip
    counts = dict(MODELS.values())
    if model not in counts:
        raise ScanError(
            f"{where}: expected a camera of {', '.join(counts)}, found {model}; undistort the images "
            "first (colmap image_undistorter)"
        )
    if len(parameters) != counts[model]:
        raise ScanError(
            f"{where}: expected {counts[model]} parameters of {model}, found {len(parameters)}"
        )
    return ColmapCamera(number, model, *size, tuple(float(v) for v in parameters))


def _pose(wxyz: Sequence[float], translation: Sequence[float], where: str) -> np.ndarray:
    w, x, y, z = wxyz
    if not np.isfinite([*wxyz, *translation]).all() or np.linalg.norm(wxyz) < 1e-6:
        raise ScanError(f"{where}: expected a finite pose, found {[*wxyz, *translation]}")
    turn = Rotation.from_quat([x, y, z, w]).as_matrix()
    return se3.inverse(se3.make_transform(turn, np.array(translation, dtype=float)))


def _text_cameras(source: Source, name: str) -> dict[int, ColmapCamera]:
    where = str(source.path / name)
    cameras = {}
    for line in read_text(source, name).splitlines():
        words = line.split()
        if not words or line.startswith("#"):
            continue
        try:
            number, size = int(words[0]), (int(words[2]), int(words[3]))
            parameters = [float(v) for v in words[4:]]
        except (ValueError, IndexError) as error:
            raise ScanError(
                f"{where}: expected lines of a camera's id, model, width, height and parameters, found "
                f"{shorten(line)!r}"
            ) from error
        cameras[number] = _camera(number, words[1], size, parameters, where)
    return cameras


def _text_images(source: Source, name: str) -> list[ColmapImage]:
    where = str(source.path / name)
    lines = [line for line in read_text(source, name).splitlines() if not line.startswith("#")]
    images = []
    for line in lines[::2]:  # every second line holds the image's points
        words = line.split(maxsplit=9)
        if not words:
            continue
        try:
            numbers = [float(v) for v in words[1:8]]
            image_id, camera_id, image_name = int(words[0]), int(words[8]), words[9]
        except (ValueError, IndexError) as error:
            raise ScanError(
                f"{where}: expected two lines an image, the first of 10 words, found {shorten(line)!r}"
            ) from error
        pose = _pose(numbers[:4], numbers[4:], f"{where}, {image_name}")
        images.append(ColmapImage(image_id, camera_id, image_name, pose))
    return images


class _Bytes:
    """Values one after another; running out of bytes is an error that names the file."""

    def __init__(self, source: Source, name: str) -> None:
        self._file = BytesIO(source.read(name))
        self._where = source.path / name

    def take(self, layout: str) -> tuple:
        data = self._file.read(struct.calcsize(f"<{layout}"))
        try:
            return struct.unpack(f"<{layout}", data)
        except struct.error as error:
            raise self._cut_off() from error

    def text(self) -> str:
        begin = self._file.tell()
        end = self._file.getvalue().find(b"\0", begin)
        if end < 0:
            raise self._cut_off()
        self._file.seek(end + 1)
        return self._file.getvalue()[begin:end].decode("utf-8", "replace")

    def skip(self, n_bytes: int) -> None:
        if self._file.tell() + n_bytes > len(self._file.getvalue()):
            raise self._cut_off()
        self._file.seek(n_bytes, 1)

    def _cut_off(self) -> ScanError:
        return ScanError(
            f"{self._where}: expected a whole binary model of COLMAP, found one that is cut off; "
            "export it again"
        )


def _binary_cameras(source: Source, name: str) -> dict[int, ColmapCamera]:
    data, where = _Bytes(source, name), str(source.path / name)
    cameras = {}
    for _ in range(data.take("Q")[0]):
        number, model, width, height = data.take("iiQQ")
        if model not in MODELS:
            raise ScanError(
                f"{where}: expected a camera model of numbers 0 to {max(MODELS)}, found {model}; "
                "undistort the images first (colmap image_undistorter)"
            )
        title, count = MODELS[model]
        parameters = data.take(f"{count}d")
        cameras[number] = _camera(number, title, (width, height), parameters, where)
    return cameras


def _binary_images(source: Source, name: str) -> list[ColmapImage]:
    data, where = _Bytes(source, name), str(source.path / name)
    images = []
    for _ in range(data.take("Q")[0]):
        image_id, *numbers, camera_id = data.take("i7di")
        image_name = data.text()
        data.skip(24 * data.take("Q")[0])
        pose = _pose(numbers[:4], numbers[4:], f"{where}, {image_name}")
        images.append(ColmapImage(image_id, camera_id, image_name, pose))
    return images
