"""ARKitScenes: images and poses with times of their own, intrinsics by the time of colour."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.lens import Lens
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.pairing import read_camera
from planfit.scan.poses import BETWEEN_POSES_S, MAX_ENTRY, join_times, poses_at
from planfit.scan.recording import Frame, LensOfFrame
from planfit.scan.source import FileSource
from planfit.scan.tables import first_of, read_matrix
from planfit.scan.timed_lists import image_lacked
from planfit.scan.types import ScanOptions

POSES, DEPTHS = ("lowres_wide.traj", "color.traj"), ("lowres_depth", "depth_densified")
"""Names of today, and of the first release."""
CONFIDENCE = "confidence"
COLORS = ("vga_wide", "lowres_wide", "wide")
"""Colour of the same camera, best first: VGA at 30 Hz; 256 x 192 at 60 Hz; 1920 x 1440, but only of frames
whose depth fits the laser scanner's."""
MAX_POSE_GAP_S = BETWEEN_POSES_S / 2
"""Poses come at 10 Hz: no image between two of them is further from the nearer one. Nor do intrinsics change
within as much."""
MAX_IMAGE_GAP_S = 0.005
"""Images of one moment have one time, up to the rounding of their names."""


@dataclass(frozen=True)
class _Tables:
    """The file of poses, and those of intrinsics by the ids of frames."""

    poses: str
    pincam_of: dict[str, str]


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Tables]:  # noqa: ARG001
    color = next((n for n in COLORS if source.names(n)), "lowres_wide")
    depth_folder = next((n for n in DEPTHS if source.names(n)), DEPTHS[0])
    poses_name = first_of(source, POSES)
    lens_folders = (f"{color}_intrinsics", "color_intrinsics")
    lenses = next((n for n in lens_folders if source.names(n)), lens_folders[0])
    color_times, color_names = _by_time(source, color, ".png")
    depth_times, depth_names = _by_time(source, depth_folder, ".png")
    mine, depth, times = join_times(color_times, depth_times, MAX_IMAGE_GAP_S)
    pincam_times, pincams = _by_time(source, lenses, ".pincam")
    nearest = [int(np.argmin(np.abs(pincam_times - time))) for time in times]
    # Colour has a file of its own, whose loss is told; depth between two images takes the nearer one's.
    max_gap_s = np.where(mine >= 0, MAX_IMAGE_GAP_S, MAX_POSE_GAP_S)
    has_lens = np.abs(pincam_times[nearest] - times) <= max_gap_s
    pose_times, recorded = _read_poses(source, poses_name)
    poses, known = poses_at(pose_times, recorded, times, MAX_POSE_GAP_S)
    if not (known & (mine >= 0) & (depth >= 0)).any():
        raise ScanError(
            f"{source.path}: expected colour ({len(color_times)} images), depth ({len(depth_times)}) and "
            f"poses of {poses_name} ({len(pose_times)}) of the same times, found none; are they of one video?"
        )
    names = [color_names[i] if i >= 0 else depth_names[j] for i, j in zip(mine, depth, strict=True)]
    frames = [
        Frame(
            name.removesuffix(".png"),
            float(time),
            pose,
            f"{color}/{color_names[i]}" if i >= 0 else "",
            f"{depth_folder}/{depth_names[j]}" if j >= 0 else "",
            f"{CONFIDENCE}/{depth_names[j]}" if j >= 0 else "",
            lacks=image_lacked(i, j),
        )
        for name, i, j, time, pose, ok in zip(
            names, mine, depth, times, poses, known & has_lens, strict=True
        )
        if ok
    ]
    pincam_of = {
        name.removesuffix(".png"): f"{lenses}/{pincams[k]}"
        for name, k in zip(names, nearest, strict=True)
    }
    skipped = [
        f"frame {names[k]}: {lenses} has none near its time" for k in np.flatnonzero(~has_lens)
    ]
    skipped += [
        f"frame {names[k]}: {poses_name} has no pose near its time" for k in np.flatnonzero(~known)
    ]
    return Listing(source, frames, _Tables(poses_name, pincam_of), [poses_name], skipped)


def _lens(listing: Listing[_Tables]) -> LensOfFrame:
    lens_of = cache(lambda name: Lens(read_camera(listing.source, name)))
    return lambda frame, _: lens_of(listing.content.pincam_of[frame.frame_id])


def _by_time(
    source: FileSource, folder: str, suffix: str
) -> tuple[Float[np.ndarray, " n"], list[str]]:
    """Times and names of the files VIDEO_TIME of a folder, in order.

    Raises:
        ScanError: there are none.
    """
    found = []
    for name in source.names(folder):
        try:
            time = float(name.removesuffix(suffix).rsplit("_", 1)[-1])
        except ValueError:
            continue
        if name.endswith(suffix) and np.isfinite(time):
            found.append((time, name))
    if not found:
        raise ScanError(
            f"{source.path / folder}: expected files VIDEO_TIME{suffix}, found none; download the "
            f"asset {folder}"
        )
    found.sort()
    return np.array([time for time, _ in found]), [name for _, name in found]


def _read_poses(
    source: FileSource, name: str
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 4 4"]]:
    table = read_matrix(source, name, "lines `time rx ry rz tx ty tz`")
    if table.shape[1] != 7:
        raise ScanError(f"{source.path / name}: expected 7 numbers a line, found {table.shape[1]}")
    kept = table[np.isfinite(table).all(axis=1)]  # as if the tracker had written nothing
    if not len(kept) or np.abs(kept[:, 1:]).max() >= MAX_ENTRY:
        raise ScanError(f"{source.path / name}: expected finite poses, found none")
    rotations = Rotation.from_rotvec(kept[:, 1:4]).as_matrix()
    return kept[:, 0], se3.inverse(se3.make_transform(rotations, kept[:, 4:]))


def _write(refined: Refined[_Tables]) -> None:
    cam_from_world = se3.inverse(refined.poses)
    vectors = Rotation.from_matrix(cam_from_world[:, :3, :3]).as_rotvec()
    rows = np.concatenate([vectors, cam_from_world[:, :3, 3]], axis=1)
    lines = [
        np.format_float_positional(frame.time, trim="-") + " " + " ".join(f"{v:.9f}" for v in row)
        for frame, row in zip(refined.frames, rows, strict=True)
    ]
    (refined.directory / refined.content.poses).write_text("\n".join(lines) + "\n")


ARKIT_SCENES = FolderLayout(
    name="arkit-scenes",
    page="""ARKitScenes: the assets of one video of the raw or the 3dod set.

    SCAN/lowres_wide.traj                     `time rx ry rz tx ty tz`: cam_from_world, rotation vector, m
    SCAN/vga_wide/, lowres_wide/ or wide/     colour, VIDEO_TIME.png; the first of these that is there
    SCAN/COLOR_intrinsics/VIDEO_TIME.pincam   width height fx fy cx cy, of the colour of the same time
    SCAN/lowres_depth/VIDEO_TIME.png          256 x 192, 16-bit millimetres
    SCAN/confidence/VIDEO_TIME.png            0 low, 1 medium, 2 high (optional)
    SCAN/color.traj, color_intrinsics/, wide/, depth_densified/     the first release: files TIME, no VIDEO

Camera axes are those of OpenCV. Images come at up to 60 Hz, poses at 10 Hz: between two, a pose is
interpolated. Depth belongs to colour of the same time; either alone is a frame, too. Intrinsics are those of
the colour, up to a millisecond by name, as the set's own loader knows; of depth alone, the nearest ones.
Whether the world is level is not told. Refined poses are written in the file of poses, at the times of the
frames.
""",
    expects=(
        "lowres_wide.traj (color.traj) with folders lowres_depth/ (depth_densified/) and lowres_wide/ "
        "(vga_wide/, wide/)"
    ),
    checked=(
        "Apple's DATA.md, raw/README.md and tenFpsDataLoader.py "
        "(github.com/apple/ARKitScenes). No real file",
        "direction and form of poses, rates, names a millisecond apart, intrinsics, units",
    ),
    told_by=(
        "|".join(POSES),
        "|".join(f"{name}/" for name in DEPTHS),
        "|".join(f"{name}/" for name in COLORS),
    ),
    parts=(POSES[0], f"{DEPTHS[0]}/", "lowres_wide/"),
    frames=_frames,
    lens=_lens,
    write=_write,
)
