"""The folder layout of the paper's published code (FACaP).

    SCAN/arcore/frame-NNNN.jpg (or .png)   colour
    SCAN/arcore/depth-NNNN.png             16-bit depth, millimetres
    SCAN/arcore/pose-NNNN.txt              world_from_cam, 4x4, OpenCV camera axes, y up
    SCAN/arcore/cam_params-NNNN.txt        w h fx fy cx cy
    SCAN/segmentation/frame-NNNN_{wall,floor,ceiling,columns}.png   masks, a quarter turn off (optional)
    SCAN/floorplan.npy                     (n, 4) segments (u1, v1, u2, v2) m, in world (x, z) (optional)

The plan shares the world's axes. Plan points are (x, -z), so that x, y and up stay right-handed.
"""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.corrupt_frames import MAX_DAMAGED_SHARE
from planfit.scan.images.images import image_size, read_color, read_depth_mm, read_image
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source
from planfit.scan.types import Label, Scan, check_pose

PLAN_FROM_WORLD = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""World (x, y up, z) to plan (x, -z, y)."""

UP_WORLD = np.array([0.0, 1.0, 0.0])

# Later ones win where masks overlap: a column in front of a wall is marked in both.
MASKS = {
    "ceiling": Label.CEILING,
    "wall": Label.WALL,
    "floor": Label.FLOOR,
    "columns": Label.COLUMN,
}

_FRAME = re.compile(r"frame-(\d+)\.(jpg|jpeg|png)$", re.IGNORECASE)


LOOKS_FOR = (
    "a folder arcore/ with frame-NNNN.jpg, depth-NNNN.png, pose-NNNN.txt, cam_params-NNNN.txt"
)


def recognise(source: Source) -> bool:
    """Whether a folder has this layout."""
    return "arcore" in source.folders()


def read(source: Source, options: ScanOptions) -> Scan:
    """As `read_facap`.

    Raises:
        ScanError: also where it lies in an archive.
    """
    if not source.path.is_dir():
        raise ScanError(
            f"{source.path}: expected this layout in a folder; unpack the archive first"
        )
    if options.depth_scale is not None:
        raise ScanError(
            f"{source.path}: expected depth in millimetres, as this layout has it; "
            "leave out --depth-scale"
        )
    return read_facap(source.path, options.use_masks)


def read_facap(path: Path, use_masks: bool = True) -> Scan:
    """Read a scan; images stay on disk until they are asked for.

    With `use_masks` false the segmentation folder is left unread, as if it were not there.

    Raises:
        ScanError: files are missing, unreadable, or contradict each other.
    """
    folder = path / "arcore"
    color_paths = _color_paths(folder)
    frame_ids = sorted(color_paths, key=int)
    _check_counts(folder, frame_ids)
    frame_ids, skipped = _without_damaged(folder, color_paths, frame_ids)
    files = FacapFiles(
        color_paths=tuple(color_paths[i] for i in frame_ids),
        depth_paths=tuple(folder / f"depth-{i}.png" for i in frame_ids),
        pose_names=tuple(f"pose-{i}.txt" for i in frame_ids),
        mask_folder=path / "segmentation",
    )
    cameras = tuple(_read_camera(folder / f"cam_params-{i}.txt") for i in frame_ids)
    for camera, color, depth in zip(cameras, files.color_paths, files.depth_paths, strict=True):
        _check_size(color, camera)
        _check_size(depth, camera)
    mask_paths = files.mask_paths() if use_masks else []
    _check_masks(mask_paths, files.color_paths, cameras, files.mask_folder)
    plan = path / "floorplan.npy"
    return Scan(
        name=str(path),
        frame_ids=tuple(frame_ids),
        timestamps=np.array([int(i) for i in frame_ids], dtype=float),
        cameras=cameras,
        world_from_cams=np.stack([_read_pose(folder / name) for name in files.pose_names]),
        files=files,
        has_labels=bool(mask_paths),
        up_world=UP_WORLD,
        plan_from_world_axes=PLAN_FROM_WORLD,
        floorplan_path=plan if plan.exists() else None,
        fingerprint=_fingerprint([*sorted(folder.iterdir()), *mask_paths]),
        format="facap",
        skipped=skipped,
    )


@dataclass(frozen=True)
class FacapFiles:
    """Images of one scan in this layout."""

    color_paths: tuple[Path, ...]
    depth_paths: tuple[Path, ...]
    pose_names: tuple[str, ...]
    mask_folder: Path

    def color(self, frame_idx: int) -> np.ndarray:
        """Colour image (h, w, 3) uint8, RGB."""
        return read_color(self.color_paths[frame_idx])

    def depth(self, frame_idx: int) -> np.ndarray:
        """Depth (h, w) float32 m, NaN where there is no reading."""
        return read_depth_mm(self.depth_paths[frame_idx])

    def labels(self, frame_idx: int) -> np.ndarray:
        """Labels (h, w) uint8 from the masks."""
        height, width = image_size(self.color_paths[frame_idx])[::-1]
        labels = np.full((height, width), Label.NONE, dtype=np.uint8)
        for name, label in MASKS.items():
            path = self._mask_path(frame_idx, name)
            if path.exists():
                mask = np.rot90(read_image(path, 0))
                if mask.shape != labels.shape:
                    raise ScanError(_mask_size_message(path, mask.shape[::-1], (width, height)))
                labels[mask > mask.max() // 2] = label  # stored as 0/255, or as 0/1
        return labels

    def write_poses(
        self, directory: Path, world_from_cams: np.ndarray, frame_idx: np.ndarray | None = None
    ) -> None:
        """Write `pose-NNNN.txt` files."""
        frames = range(len(self.pose_names)) if frame_idx is None else frame_idx
        for i, pose in zip(frames, world_from_cams, strict=True):
            write_pose(directory / self.pose_names[i], pose)

    def mask_paths(self) -> list[Path]:
        """The masks that exist."""
        every = (self._mask_path(i, name) for i in range(len(self.color_paths)) for name in MASKS)
        return [path for path in every if path.exists()]

    def _mask_path(self, frame_idx: int, name: str) -> Path:
        return self.mask_folder / f"{self.color_paths[frame_idx].stem}_{name}.png"


def write_pose(path: Path, world_from_cam: np.ndarray) -> None:
    """Write one 4x4 pose as text."""
    path.write_text("\n".join(" ".join(f"{v:.9f}" for v in row) for row in world_from_cam) + "\n")


def _color_paths(folder: Path) -> dict[str, Path]:
    found: dict[int, tuple[str, Path]] = {}
    for path in sorted(folder.iterdir()):
        if match := _FRAME.match(path.name):
            number = int(match[1])
            if number in found:
                raise ScanError(
                    f"{path}: expected one colour image a frame, found {found[number][1].name} "
                    "of the same number beside it; delete one of them"
                )
            found[number] = (match[1], path)
    if not found:
        raise ScanError(f"{folder}: expected colour images named frame-NNNN.jpg, found none")
    return dict(found.values())


def _check_counts(folder: Path, frame_ids: list[str]) -> None:
    for kind, name in (("depth", "depth-{}.png"), ("pose", "pose-{}.txt"),
                       ("camera", "cam_params-{}.txt")):  # fmt: skip
        missing = [i for i in frame_ids if not (folder / name.format(i)).exists()]
        if missing:
            raise ScanError(
                f"{folder / name.format(missing[0])}: expected a {kind} file for each of "
                f"{len(frame_ids)} colour frames, found {len(frame_ids) - len(missing)}; "
                "copy the missing files or delete the colour frames without them"
            )
    depth_ids = {p.stem.split("-")[1] for p in folder.glob("depth-*.png")}
    extra = sorted(depth_ids - set(frame_ids))
    if extra:
        raise ScanError(
            f"{folder}: expected as many colour as depth images, found {len(frame_ids)} colour "
            f"and {len(depth_ids)} depth (depth-{extra[0]}.png has no colour); "
            "copy the missing colour frames or delete the depth without them"
        )


def _without_damaged(
    folder: Path, color_paths: dict[str, Path], frame_ids: list[str]
) -> tuple[list[str], tuple[str, ...]]:
    """Frames whose images begin as images do, and a line for each of the others.

    Raises:
        ScanError: more than one in a hundred do not.
    """
    kept, errors = [], []
    for frame_id in frame_ids:
        try:
            for path in (color_paths[frame_id], folder / f"depth-{frame_id}.png"):
                image_size(path)
            kept.append(frame_id)
        except ScanError as error:
            errors.append((frame_id, error))
            if len(errors) > MAX_DAMAGED_SHARE * len(frame_ids):
                raise
    return kept, tuple(f"frame {frame_id}: {error}" for frame_id, error in errors)


def _read_numbers(path: Path, expected: str) -> np.ndarray:
    try:
        return np.array([[float(v) for v in line.split()] for line in path.read_text().splitlines()
                         if line.strip()])  # fmt: skip
    except OSError as error:
        raise ScanError(
            f"{path}: expected {expected}, cannot be read ({error.strerror})"
        ) from error
    except ValueError as error:
        raise ScanError(f"{path}: expected {expected}, found text that is not ({error})") from error


def _read_pose(path: Path) -> np.ndarray:
    pose = _read_numbers(path, "a 4x4 matrix of numbers")
    check_pose(pose, str(path))
    return pose


def _read_camera(path: Path) -> Camera:
    values = _read_numbers(path, "six numbers: w h fx fy cx cy").ravel()
    if values.size != 6:
        raise ScanError(f"{path}: expected six numbers (w h fx fy cx cy), found {values.size}")
    try:
        return Camera(int(values[0]), int(values[1]), *(float(v) for v in values[2:]))
    except (ValueError, OverflowError) as error:
        raise ScanError(
            f"{path}: expected usable intrinsics (w h fx fy cx cy), {error}; "
            "export the calibration again"
        ) from error


def _check_size(path: Path, camera: Camera) -> None:
    width, height = image_size(path)
    if (width, height) != (camera.width, camera.height):
        raise ScanError(
            f"{path}: expected {camera.width} x {camera.height} px as cam_params says, "
            f"found {width} x {height}; resample it or correct cam_params"
        )


def _check_masks(
    mask_paths: list[Path], color_paths: tuple[Path, ...], cameras: tuple[Camera, ...], folder: Path
) -> None:
    camera_by_stem = dict(zip((path.stem for path in color_paths), cameras, strict=True))
    seen = set()
    for path in mask_paths:
        stem = path.stem.rsplit("_", 1)[0]
        camera = camera_by_stem[stem]
        seen.add(stem)
        height, width = image_size(path)  # stored a quarter turn off
        if (width, height) != (camera.width, camera.height):
            raise ScanError(
                _mask_size_message(path, (width, height), (camera.width, camera.height))
            )
    if mask_paths and len(seen) < len(color_paths):
        absent = next(path.stem for path in color_paths if path.stem not in seen)
        raise ScanError(
            f"{folder}: expected masks for each of {len(color_paths)} frames, found {len(seen)} "
            f"({absent} has none); add them, or leave masks out with "
            "--segmentation.back-end geometry"
        )


def _mask_size_message(path: Path, found: tuple[int, ...], expected: tuple[int, int]) -> str:
    return (
        f"{path}: expected {expected[0]} x {expected[1]} px after the quarter turn of this layout, "
        f"found {found[0]} x {found[1]}; store masks turned a quarter against the image, full size"
    )


def _fingerprint(paths: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        stat = path.stat()
        digest.update(f"{path.name} {stat.st_size} {stat.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]
