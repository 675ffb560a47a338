"""From a cloud and its trajectory to a `Recording`: frames that are depth images of instants."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.priors import FRAME_RATE_HZ, STEP_AT_VIDEO_RATE_M
from planfit.scan.formats import whole_files
from planfit.scan.images.lens import Lens
from planfit.scan.laser.cloud import (
    CHUNK_POINTS,
    MIN_INSIDE,
    ClockRelation,
    CloudFile,
    relate_clocks,
)
from planfit.scan.laser.faces import Faces, choose_faces, find_up
from planfit.scan.laser.instants import MIN_POINTS, Instants, cut
from planfit.scan.laser.kernels import move_by_time
from planfit.scan.laser.trajectory import Columns, Trajectory, clock_unit, in_order, read_trajectory
from planfit.scan.recording import Frame, Recording, Size, StoredImages
from planfit.scan.source import FolderSource, fingerprint
from planfit.scan.types import ScanOptions

KILOMETRE_M = 1000.0
"""Offsets of the world are whole ones, so that they can be told and added back exactly."""


@dataclass(frozen=True)
class Correction:
    """Motions of the world at some times, and between them; before the first and after the last, theirs.

    Between two, the rotation goes at constant speed, and the place of the scanner straight from where one
    carries it to where the other does: a point moves with the scanner that saw it.
    """

    times: Float[np.ndarray, " k"]
    """s, of the trajectory's clock, increasing."""
    refined_from_recorded: Float[np.ndarray, "k 4 4"]
    """Both near the origin: less the trajectory's `metres_away`."""
    trajectory: Trajectory
    target_metres_away: Float[np.ndarray, "3"]
    """To be added to refined places for those of the target's axes."""

    def move(
        self,
        xyz: Float[np.ndarray, "n 3"],
        cloud_times: Float[np.ndarray, " n"],
        clock: ClockRelation,
    ) -> Float[np.ndarray, "n 3"]:
        """Points (m, axes of the cloud) seen at times as the file has them, of a clock of its own."""
        with np.errstate(invalid="ignore", over="ignore"):  # a point may have no time
            times = clock.of(cloud_times)
        before, share = self._between(times)
        rotations = np.ascontiguousarray(self.refined_from_recorded[:, :3, :3])
        centres, to_centres = self._centres(times, before, share)
        return move_by_time(
            xyz - self.trajectory.metres_away, centres, to_centres + self.target_metres_away,
            before, share, rotations, self._turns(),
        )  # fmt: skip

    def poses(self) -> Float[np.ndarray, "n 4 4"]:
        """Of the trajectory, refined; less `target_metres_away`."""
        times = self.trajectory.times
        before, share = self._between(times)
        turn = se3.exp_so3(share[:, None] * self._turns()[before])
        rotation = self.refined_from_recorded[before, :3, :3] @ turn
        recorded = self.trajectory.world_from_scanner[:, :3, :3]
        return se3.make_transform(rotation @ recorded, self._centres(times, before, share)[1])

    def _between(
        self, times: Float[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The correction before each time, and how far on the way to the next it is, 0 to 1."""
        last = len(self.times) - 1
        if last == 0:
            return np.zeros(len(times), dtype=np.int64), np.zeros(len(times))
        known = np.where(np.isfinite(times), times, self.times[0])
        before = np.clip(np.searchsorted(self.times, known, side="right") - 1, 0, last - 1)
        gap = self.times[before + 1] - self.times[before]
        return before, np.clip((known - self.times[before]) / gap, 0.0, 1.0)

    def _turns(self) -> Float[np.ndarray, "k 3"]:
        """Rotation (rad) from each correction to the next, before it is applied."""
        rotations = self.refined_from_recorded[:, :3, :3]
        after = np.append(rotations[1:], rotations[-1:], axis=0)
        return se3.log_so3(np.swapaxes(rotations, -1, -2) @ after)

    def _centres(
        self,
        times: Float[np.ndarray, " n"],
        before: Int[np.ndarray, " n"],
        share: Float[np.ndarray, " n"],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Where the scanner was recorded, and where it was."""
        recorded = self.trajectory.world_from_scanner[:, :3, 3]
        known = np.where(np.isfinite(times), times, self.times[0])
        at = [np.interp(known, self.trajectory.times, recorded[:, axis]) for axis in range(3)]
        centres = np.stack(at, axis=1)
        after = np.minimum(before + 1, len(self.times) - 1)
        carried = [
            np.einsum("nij,nj->ni", self.refined_from_recorded[k, :3, :3], centres)
            + self.refined_from_recorded[k, :3, 3]
            for k in (before, after)
        ]
        return centres, carried[0] + share[:, None] * (carried[1] - carried[0])


@dataclass(frozen=True)
class LaserImages(StoredImages):
    """`StoredImages` of a laser scan: depth, rendered when it is asked for, and no colour."""

    instants: Instants
    faces: Faces

    def sizes(self, frame: Frame) -> tuple[Size, Size]:  # noqa: ARG002
        """Of the camera."""
        size = (self.faces.camera.width, self.faces.camera.height)
        return size, size

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
            p.name
            for p in path.parent.glob("*")
            if p.suffix in (".txt", ".csv", ".traj", ".las", ".laz") and p != path
        )
        hint = f"; beside it are {', '.join(beside[:3])}" if beside else ""
        raise ScanError(
            f"{path}: expected the trajectory of the scanner with the cloud, found none; give it with "
            f"--poses FILE, in the cloud's axes{hint}"
        )
    if file.n_points == 0:
        raise ScanError(f"{path}: expected a cloud, found no points; export it again")
    path_file = _cloud_of_path(options.poses)
    recorded = _path_of_cloud(path_file) if path_file else read_trajectory(options.poses)
    clock = relate_clocks(file, recorded, options.cloud_time_offset_s)
    middle = np.median(recorded.world_from_scanner[:, :3, 3], axis=0)
    trajectory = recorded.moved(np.rint(middle / KILOMETRE_M) * KILOMETRE_M)
    instants = cut(file, trajectory, clock, options.instant_s)
    poses, _ = trajectory.at(instants.times, 1e9)
    level_from_world, told = find_up(instants.centres, options.cloud_up)
    faces = choose_faces(instants, poses, level_from_world)
    images = LaserImages(instants, faces)
    frames = _frames(images)

    def write_cloud(
        target: Path, written: Sequence[Frame], refined: Float[np.ndarray, "k 4 4"], is_world: bool
    ) -> None:
        correction = _correction(written, refined, trajectory, is_world)
        move = partial(correction.move, clock=clock)
        file.write_moved(target, move, to_other_axes=not is_world)

    def write_poses(
        directory: Path, written: Sequence[Frame], refined: Float[np.ndarray, "k 4 4"]
    ) -> None:
        correction = _correction(written, refined, trajectory, is_world=True)
        target = directory / recorded.path.name
        if path_file:  # its points are the scanner, which moves with what it saw
            own_clock = ClockRelation(0.0, "", recorded.seconds_per_unit)
            path_file.write_moved(target, partial(correction.move, clock=own_clock))
        else:
            trajectory.write(target, correction.poses())
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


def _cloud_of_path(path: Path) -> CloudFile | None:
    """The file of a trajectory that is a cloud itself, a point a pose, as programs of scanners export it."""
    for one in whole_files().values():
        if one.takes_poses and one.claims(path):
            return one.open(path)
    return None


def _path_of_cloud(file: CloudFile) -> Trajectory:
    """The path of a scanner whose places are points.

    Raises:
        ScanError: they are those of a cloud, not of a path.
    """
    pieces = list(file.pieces()) if file.n_points <= CHUNK_POINTS else []
    times = np.concatenate([np.zeros(0), *(p.times[p.is_valid] for p in pieces)])
    places = np.concatenate([np.zeros((0, 3)), *(p.xyz[p.is_valid] for p in pieces)])
    if len(times) < 2:
        raise _no_path(file)
    poses = se3.make_transform(np.eye(3), places)
    found = in_order(file.path, Columns(times, poses))
    steps_m = np.linalg.norm(np.diff(found.world_from_scanner[:, :3, 3], axis=0), axis=1)
    fastest_m_s = STEP_AT_VIDEO_RATE_M.value * FRAME_RATE_HZ.value
    if steps_m.sum() > fastest_m_s * np.ptp(found.times):
        raise _no_path(file)
    return found


def _no_path(file: CloudFile) -> ScanError:
    return ScanError(
        f"{file.path}: expected the path of the scanner, found {file.n_points:,} points of a cloud itself; "
        "give the trajectory that was exported with it"
    )


def _frames(images: LaserImages) -> list[Frame]:
    """A frame a camera that sees something, instant by instant."""
    instants, faces = images.instants, images.faces
    frames = []
    for k, time in enumerate(instants.times):
        n_seen = faces.n_seen(instants.points(k), k)
        # Of an instant without a surface in view one frame stays, so that its pose is refined as well.
        seeing = [f for f, n in enumerate(n_seen) if n >= MIN_POINTS]
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
    if clock.seconds_per_unit != 1:
        found.append(f"times of the cloud are {clock_unit(clock.seconds_per_unit)}, not seconds")
    if clock.words:
        found.append(
            f"times of the cloud and of its trajectory differ by {clock.offset_s:+.3f} s: {clock.words}"
        )
    if instants.n_without_pose > (1 - MIN_INSIDE) * instants.n_total:
        found.append(
            f"{instants.n_without_pose / instants.n_total:.0%} of the points were seen at times that the "
            "trajectory does not cover: they take no part, and are moved as the nearest that do"
        )
    return found
