"""COLMAP's sparse models: cameras, images, and what they observed, as text or binary.

Poses in the files are cam_from_world; pixels count from the corner of the first. Binary layouts are those of
COLMAP's reconstruction_io_binary.cc.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped, UInt8
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.poses import ROUNDING
from planfit.scan.source import FileSource, in_order, read_text
from planfit.scan.tables import shorten

MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
)
"""Name and number of parameters of each camera model, by its number."""
CAMERA = 0
"""The kind of sensor that a rig's cameras are (colmap/util/types.h)."""
SEEN = np.dtype([("uv", "<f8", 2), ("point", "<i8")])
"""An observation in a binary file."""
N_LENSES = 7
"""The first so many models are lenses that can be undone here; of the others only the size is of use."""


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
            ScanError: the model is none of the lenses known here, or the parameters cannot be those of
                a camera; it begins with `where`.
        """
        p = self.parameters
        known = [name for name, _ in MODELS[:N_LENSES]]
        if self.model not in known:
            raise ScanError(
                f"{where}: expected a camera of {', '.join(known)}, found {self.model}; undistort the "
                "images first (colmap image_undistorter)"
            )
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
    world_from_cam: Float[np.ndarray, "4 4"]
    uv: Float[np.ndarray, "k 2"] | None = None
    """Observations, px from the corner of the first pixel; None: not read."""
    point_id: Int[np.ndarray, " k"] | None = None
    """Of each observation; -1 where no 3D point."""

    @property
    def cam_from_world(self) -> tuple[float, ...]:
        """qw qx qy qz tx ty tz, as the files have it."""
        cam_from_world = se3.inverse(self.world_from_cam)
        x, y, z, w = Rotation.from_matrix(cam_from_world[:3, :3]).as_quat(canonical=True)
        return tuple(float(v) for v in (w, x, y, z, *cam_from_world[:3, 3]))


def model_files(source: FileSource, folder: str = "") -> tuple[str, str]:
    """Names of a model's files of cameras and of images; binary ones first.

    Raises:
        ScanError: there are none.
    """
    prefix = f"{folder}/" if folder else ""
    for suffix in ("bin", "txt"):
        names = f"{prefix}cameras.{suffix}", f"{prefix}images.{suffix}"
        if all(source.exists(name) for name in names):
            return names
    raise ScanError(
        f"{source.path / folder}: expected a COLMAP model, found neither cameras.bin and images.bin nor "
        "cameras.txt and images.txt; export the model again"
    )


def read_model(
    source: FileSource, folder: str = "", observations: bool = False
) -> tuple[dict[int, ColmapCamera], list[ColmapImage]]:
    """Cameras by number, and images in the order of their names.

    `folder`: the model's, inside the source; `observations`: whether to read where each image saw which 3D
    point.

    Raises:
        ScanError: files are missing or damaged.
    """
    names = model_files(source, folder)
    if names[0].endswith(".bin"):
        cameras = _binary_cameras(source, names[0])
        images = _binary_images(source, names[1], observations)
    else:
        cameras = _text_cameras(source, names[0])
        images = _text_images(source, names[1], observations)
    if not images:
        raise ScanError(f"{source.path / names[1]}: expected posed images, found none")
    for image in images:
        if image.camera_id not in cameras:
            raise ScanError(
                f"{source.path / names[0]}: expected camera {image.camera_id} of {image.name}, found "
                "none of this number; export the model again"
            )
    return cameras, sorted(images, key=lambda image: in_order(image.name))


def write_model(
    directory: Path,
    cameras: Sequence[ColmapCamera],
    images: Sequence[ColmapImage],
    points: Float[np.ndarray, "k 3"] | None = None,
    colors: UInt8[np.ndarray, "k 3"] | None = None,
    error_px: Float[np.ndarray, " k"] | None = None,
) -> None:
    """cameras.txt, images.txt and points3D.txt in an existing folder.

    `points`, in m, with `colors` have the numbers 1 to k; where images observe them (`uv`, `point_id`), their
    tracks are written, and `error_px` with them.
    """
    lines = ["# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for camera in cameras:
        parameters = " ".join(repr(float(v)) for v in camera.parameters)  # to the last bit
        lines.append(
            f"{camera.camera_id} {camera.model} {camera.width} {camera.height} {parameters}"
        )
    (directory / "cameras.txt").write_text("\n".join(lines) + "\n")
    lines = ["# Image list with two lines an image: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID,"
             " NAME; then POINTS2D[] as (X, Y, POINT3D_ID)"]  # fmt: skip
    seen_in: dict[int, list[str]] = {}
    for image in images:
        numbers = " ".join(map(repr, image.cam_from_world))
        seen = []
        if image.uv is not None and image.point_id is not None:
            for k, ((u, v), point) in enumerate(zip(image.uv, image.point_id, strict=True)):
                seen.append(f"{u:.4f} {v:.4f} {point}")
                seen_in.setdefault(int(point), []).append(f"{image.image_id} {k}")
        lines += [f"{image.image_id} {numbers} {image.camera_id} {image.name}", " ".join(seen)]
    (directory / "images.txt").write_text("\n".join(lines) + "\n")
    lines = [
        "# 3D point list: POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"
    ]
    if points is not None and colors is not None:
        errors = np.zeros(len(points)) if error_px is None else error_px
        for i, ((x, y, z), (r, g, b), error) in enumerate(
            zip(points, colors, errors, strict=True), start=1
        ):
            words = [f"{i} {x:.6f} {y:.6f} {z:.6f} {r} {g} {b} {error:.4g}", *seen_in.get(i, [])]
            lines.append(" ".join(words))
    (directory / "points3D.txt").write_text("\n".join(lines) + "\n")


def write_binary_model(
    directory: Path, cameras: Sequence[ColmapCamera], images: Sequence[ColmapImage]
) -> None:
    """cameras.bin, images.bin and points3D.bin without points in an existing folder.

    All three, because COLMAP takes a folder for a binary model where all of them are there.
    """
    numbers = {name: number for number, (name, _) in enumerate(MODELS)}
    lenses = [
        struct.pack(f"<IiQQ{len(c.parameters)}d", c.camera_id, numbers[c.model], c.width, c.height,
                    *c.parameters)
        for c in cameras
    ]  # fmt: skip
    posed = []
    for image in images:
        seen = np.zeros(0 if image.uv is None else len(image.uv), SEEN)
        if image.uv is not None:
            seen["uv"], seen["point"] = image.uv, -1 if image.point_id is None else image.point_id
        head = struct.pack("<I7dI", image.image_id, *image.cam_from_world, image.camera_id)
        name = image.name.encode() + b"\0"
        posed.append(head + name + struct.pack("<Q", len(seen)) + seen.tobytes())
    for table, rows in (("cameras", lenses), ("images", posed), ("points3D", [])):
        _write_rows(directory / f"{table}.bin", rows)


def write_frames(directory: Path, images: Sequence[ColmapImage], is_binary: bool) -> None:
    """rigs and frames of COLMAP 3.12 and later, as it makes them of older models: a rig a camera, a frame an
    image, so that each image has its own pose, which COLMAP then takes from the frame."""
    cameras = sorted({image.camera_id for image in images})
    if is_binary:
        rigs = [struct.pack("<IIiI", number, 1, CAMERA, number) for number in cameras]
        frames = [
            struct.pack("<II7dIiIQ", image.image_id, image.camera_id, *image.cam_from_world, 1, CAMERA,
                        image.camera_id, image.image_id)
            for image in images
        ]  # fmt: skip
        _write_rows(directory / "rigs.bin", rigs)
        _write_rows(directory / "frames.bin", frames)
        return
    lines = ["# Rig list: RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID"]
    lines += [f"{number} 1 CAMERA {number}" for number in cameras]
    (directory / "rigs.txt").write_text("\n".join(lines) + "\n")
    lines = ["# Frame list: FRAME_ID, RIG_ID, QW, QX, QY, QZ, TX, TY, TZ, NUM_DATA_IDS, DATA_IDS[] as "
             "(SENSOR_TYPE, SENSOR_ID, DATA_ID)"]  # fmt: skip
    for image in images:
        pose = " ".join(map(repr, image.cam_from_world))
        number, camera = image.image_id, image.camera_id
        lines.append(f"{number} {camera} {pose} 1 CAMERA {camera} {number}")
    (directory / "frames.txt").write_text("\n".join(lines) + "\n")


def _write_rows(path: Path, rows: Sequence[bytes]) -> None:
    path.write_bytes(struct.pack("<Q", len(rows)) + b"".join(rows))


def _camera(number: int, model: str, size: tuple[int, int], parameters: Sequence[float], where: str
            ) -> ColmapCamera:  # fmt: skip
    count = dict(MODELS).get(model)
    if count is not None and len(parameters) != count:
        raise ScanError(f"{where}: expected {count} parameters of {model}, found {len(parameters)}")
    return ColmapCamera(number, model, *size, tuple(float(v) for v in parameters))


def _pose(numbers: Sequence[float], where: str) -> Float[np.ndarray, "4 4"]:
    """world_from_cam by the numbers of `ColmapImage.cam_from_world`."""
    w, x, y, z, *translation = numbers
    if not np.isfinite(numbers).all() or np.linalg.norm([w, x, y, z]) < ROUNDING:
        raise ScanError(f"{where}: expected a finite pose, found {[*numbers]}")
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
    return se3.inverse(se3.make_transform(rotation, np.array(translation)))


def camera_of_words(words: Sequence[str], where: str) -> ColmapCamera:
    """The camera that words of a line tell: its number, model, width, height and parameters.

    Raises:
        ScanError: they tell none; it begins with `where`.
    """
    try:
        number, size = int(words[0]), (int(words[2]), int(words[3]))
        parameters = [float(v) for v in words[4:]]
    except (ValueError, IndexError) as error:
        raise ScanError(
            f"{where}: expected lines of a camera's id, model, width, height and parameters, found "
            f"{shorten(' '.join(words))!r}"
        ) from error
    return _camera(number, words[1], size, parameters, where)


def _text_cameras(source: FileSource, name: str) -> dict[int, ColmapCamera]:
    lines = [line for line in read_text(source, name).splitlines() if not line.startswith("#")]
    rows = [words for line in lines if (words := line.split())]
    cameras = [camera_of_words(words, str(source.path / name)) for words in rows]
    return {camera.camera_id: camera for camera in cameras}


def _text_images(source: FileSource, name: str, observations: bool) -> list[ColmapImage]:
    where = str(source.path / name)
    lines = [line for line in read_text(source, name).splitlines() if not line.startswith("#")]
    images = []
    for k in range(0, len(lines), 2):  # every second line holds the image's points, or is empty
        words = lines[k].split(maxsplit=9)
        if not words:
            continue
        try:
            numbers = [float(v) for v in words[1:8]]
            image_id, camera_id, image_name = int(words[0]), int(words[8]), words[9]
        except (ValueError, IndexError) as error:
            raise ScanError(
                f"{where}: expected two lines an image, the first of 10 words, found "
                f"{shorten(lines[k])!r}, which is damaged; export the model again"
            ) from error
        pose = _pose(numbers, f"{where}, {image_name}")
        seen: tuple[np.ndarray, ...] = ()
        if observations:
            try:
                values = np.array(" ".join(lines[k + 1 : k + 2]).split(), dtype=float).reshape(
                    -1, 3
                )
            except (ValueError, IndexError) as error:
                raise ScanError(
                    f"{where}: expected a line of x, y and point of each observation behind "
                    f"{image_name}, found a damaged one ({error}); export the model again"
                ) from error
            seen = values[:, :2], values[:, 2].astype(np.int64)
        images.append(ColmapImage(image_id, camera_id, image_name, pose, *seen))
    return images


class _Bytes:
    """Values one after another; running out of bytes is an error that names the file."""

    def __init__(self, source: FileSource, name: str) -> None:
        self._data, self._at = source.read(name), 0
        self._where = source.path / name

    def take(self, layout: str) -> tuple:
        return struct.unpack_from(
            f"<{layout}", self._data, self._next(struct.calcsize(f"<{layout}"))
        )

    def text(self) -> str:
        end = self._data.find(b"\0", self._at)
        if end < 0:
            raise self._cut_off()
        begin = self._next(end + 1 - self._at)
        return self._data[begin:end].decode("utf-8", "replace")

    def array(self, layout: np.dtype, count: int) -> Shaped[np.ndarray, " count"]:
        return np.frombuffer(self._data, layout, count, self._next(count * layout.itemsize))

    def _next(self, n_bytes: int) -> int:
        begin = self._at
        if begin + n_bytes > len(self._data):
            raise self._cut_off()
        self._at += n_bytes
        return begin

    def _cut_off(self) -> ScanError:
        return ScanError(
            f"{self._where}: expected a whole binary model of COLMAP, found a damaged one, cut off; "
            "export it again"
        )


def _binary_cameras(source: FileSource, name: str) -> dict[int, ColmapCamera]:
    data, where = _Bytes(source, name), str(source.path / name)
    cameras = {}
    for _ in range(data.take("Q")[0]):
        number, model, width, height = data.take("IiQQ")
        if not 0 <= model < len(MODELS):
            raise ScanError(
                f"{where}: expected a camera model of numbers 0 to {len(MODELS) - 1}, found {model}; "
                "undistort the images first (colmap image_undistorter)"
            )
        title, count = MODELS[model]
        parameters = data.take(f"{count}d")
        cameras[number] = _camera(number, title, (width, height), parameters, where)
    return cameras


def _binary_images(source: FileSource, name: str, observations: bool) -> list[ColmapImage]:
    data, where = _Bytes(source, name), str(source.path / name)
    images = []
    for _ in range(data.take("Q")[0]):
        image_id, *numbers, camera_id = data.take("I7dI")
        image_name = data.text()
        points = data.array(SEEN, data.take("Q")[0])
        pose = _pose(numbers, f"{where}, {image_name}")
        seen = (points["uv"].copy(), points["point"].copy()) if observations else ()
        images.append(ColmapImage(image_id, camera_id, image_name, pose, *seen))
    return images
