"""From a cloud and its trajectory to a `Recording`: frames that are depth images of instants."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.lens import Lens
from planfit.scan.laser.cloud import ClockRelation, CloudFile, relate_clocks
from planfit.scan.laser.correction import Correction
from planfit.scan.laser.faces import MIN_FACE_POINTS, Faces, choose_faces, find_up
from planfit.scan.laser.instants import Instants, cut
from planfit.scan.laser.trajectory import Trajectory, read_trajectory
from planfit.scan.recording import Frame, Recording, Size
from planfit.scan.source import FolderSource, fingerprint
from planfit.scan.types import ScanOptions

KILOMETRE_M = 1000.0
"""Offsets of the world are whole ones, so that they can be told and added back exactly."""
MAX_UNUSED_SHARE = 0.1
"""More points without a pose are worth a warning."""


@dataclass(frozen=True)
class LaserImages:
    """`StoredImages` of a laser scan: depth, rendered when it is asked for, and no colour."""

    instants: Instants
    faces: Faces

    def missing(self, frame: Frame) -> str:  # noqa: ARG002
        """Nothing."""
        return ""

    def sizes(self, frame: Frame) -> tuple[Size, Size]:  # noqa: ARG002
        """Of the camera."""
        size = (self.faces.camera.width, self.faces.camera.height)
        return size, size

    def warnings(self, frames: Sequence[Frame]) -> list[str]:  # noqa: ARG002
        """None."""
        return []

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:  # noqa: ARG002
        """Black: a laser scanner sees no colour."""
        camera = self.faces.camera
        return np.zeros((camera.height, camera.width, 3), dtype=np.uint8)

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m along the optical axis, NaN where nothing was measured."""
        k, face = (int(number) for number in frame.depth.split("/"))
        return self.faces.depth(self.instants.points(k), k, face)


def laser_recording(file: CloudFile, options: ScanOptions) -> Recording:
    """List a laser scan.

    Raises:
        ScanError: there is no trajectory, or it does not belong to the cloud; a file is damaged.
    """
    path = file.path
    if options.poses is None:
        beside = sorted(
            p.name for p in path.parent.glob("*") if p.suffix in (".txt", ".csv", ".traj")
        )
        hint = f"; beside it are {', '.join(beside[:3])}" if beside else ""
        raise ScanError(
            f"{path}: expected the trajectory of the scanner with the cloud, found none; give it with "
            f"--poses FILE, in the cloud's axes{hint}"
        )
    if file.n_points == 0:
        raise ScanError(f"{path}: expected a cloud, found no points; export it again")
    recorded = read_trajectory(options.poses)
    clock = relate_clocks(file, recorded, options.cloud_time_offset_s)
    middle = np.median(recorded.world_from_scanner[:, :3, 3], axis=0)
    trajectory = recorded.moved(np.rint(middle / KILOMETRE_M) * KILOMETRE_M)
    instants = cut(file, trajectory, clock.offset_s, options.instant_s)
    poses, _ = trajectory.at(instants.times, 1e9)
    level_from_world, told = find_up(instants.centres, options.cloud_up)
    faces = choose_faces(instants, poses, level_from_world)
    images = LaserImages(instants, faces)
    frames = _frames(images)

    def write_cloud(
        target: Path, written: Sequence[Frame], refined: Float[np.ndarray, "k 4 4"], is_world: bool
    ) -> None:
        correction = _correction(written, refined, trajectory, is_world)
        move = partial(correction.move, clock_offset_s=clock.offset_s)
        file.write_moved(target, move, to_other_axes=not is_world)

    def write_poses(
        directory: Path, written: Sequence[Frame], refined: Float[np.ndarray, "k 4 4"]
    ) -> None:
        correction = _correction(written, refined, trajectory, is_world=True)
        trajectory.write(directory / recorded.path.name, correction.poses())
        write_cloud(directory / path.name, written, refined, True)

    sources = [(FolderSource(p.parent), p.name) for p in (path, options.poses)]
    return Recording(
        format=path.suffix[1:].lower(),
        path=path,
        frames=frames,
        images=images,
        color_lens=lambda *_: Lens(faces.camera),
        write_poses=write_poses,
        write_cloud=write_cloud,
        fingerprint="-".join(fingerprint(source, [name], options) for source, name in sources),
        warnings=[*_warnings(instants, clock, trajectory), *told, *recorded.warnings],
    )


def _frames(images: LaserImages) -> list[Frame]:
    """A frame a camera that sees something, instant by instant."""
    instants, faces = images.instants, images.faces
    frames = []
    for k, time in enumerate(instants.times):
        n_seen = faces.n_seen(instants.points(k), k)
        # Of an instant without a surface in view one frame stays, so that its pose is refined as well.
        seeing = [f for f, n in enumerate(n_seen) if n >= MIN_FACE_POINTS]
        for face in seeing or [int(np.argmax(n_seen))]:
            pose = se3.make_transform(faces.cam_from_world(k, face).T, instants.centres[k])
            name = f"{k:06d}" if len(faces.azimuths) == 1 else f"{k:06d}_{face}"
            frames.append(Frame(name, float(time), pose, "", f"{k}/{face}"))
    return frames


def _correction(
    frames: Sequence[Frame],
    refined: Float[np.ndarray, "k 4 4"],
    trajectory: Trajectory,
    is_world: bool,
) -> Correction:
    """One motion an instant: cameras of an instant are fixed to each other."""
    times, first = np.unique([frame.time for frame in frames], return_index=True)
    recorded = np.stack([frames[i].world_from_cam for i in first])
    moved = refined[first] @ se3.inverse(recorded)
    target_metres_away = trajectory.metres_away if is_world else np.zeros(3)
    return Correction(times, moved, trajectory, target_metres_away)


def _warnings(instants: Instants, clock: ClockRelation, trajectory: Trajectory) -> list[str]:
    found = []
    if trajectory.metres_away.any():
        named = ", ".join(f"{v:.0f}" for v in trajectory.metres_away)
        found.append(
            f"places of frames are the cloud's less ({named}) m; the trajectory and the cloud are written "
            "with it"
        )
    if clock.words:
        found.append(
            f"times of the cloud and of its trajectory differ by {clock.offset_s:+.3f} s: {clock.words}"
        )
    if instants.n_without_pose > MAX_UNUSED_SHARE * instants.n_total:
        found.append(
            f"{instants.n_without_pose / instants.n_total:.0%} of the points were seen at times that the "
            "trajectory does not cover: they take no part, and are moved as the nearest that do"
        )
    return found
