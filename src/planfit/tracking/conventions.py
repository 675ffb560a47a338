"""What recorded poses may mean: the usual mistakes of export, and which one explains the measured motions.

A convention is a transform of the whole trajectory. Motions between neighbouring frames, measured from images
and depth, know nothing of it, so they tell which one holds. What turns the world as a whole (y up or z up)
does not change motions. Where the format says which axis is up, two others tell whether it is: people walk
level, and hold cameras upright.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.priors import CLEAR_ODDS
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.scan.poses import from_opengl
from planfit.tracking.motions import (
    FREEDOM,
    MeasuredMotions,
    departures,
    expected_covariance,
    squared_sigmas,
)
from planfit.tracking.numbered import (
    MIN_DEPARTURE,
    MOUNT,
    OPTICAL_AXES,
    UNIT,
    in_metres,
    metres_named,
    mount_by_motions,
    mount_named,
    mount_of,
    share_of_measured,
    unit_by_motions,
    unit_named,
)
from planfit.units import FOOT_M

RECORDED, AUTO = "recorded", "auto"
EXPLAINED_SIGMAS = 4.0
"""A motion is explained if it departs by less, as a norm of six numbers."""
NOISE = (1.0, 2.0, 4.0, 8.0)
"""Factors on the tracker's sigmas: a bad tracker in the right convention is no other convention."""
MIN_MOTIONS, MAX_MOTIONS = 20, 2000
"""Fewer motions do not tell a convention; more do not tell it better, and are thinned."""
MAX_SIGMA_M = 0.1
"""Sigma of a step's translation, at most."""
MIN_SHARE = 0.5
"""A convention explains at least this share of the motions."""
MIN_LOG_RATIO = 0.25
"""And is more likely than the poses as recorded by this, natural logarithm, a motion. Where poses are right,
none of the others is likelier at all."""
MIN_MORE = 0.05
"""And explains more of the motions than these by this share. Surfaces that leave most of a motion free, as a
floor does, agree with any convention, and a few false motions among them would decide."""
MAX_UNIT_ERROR = 1.5
"""Factor up to which the lengths of recorded and measured steps agree in the right unit. Noise makes a
smaller unit likelier than it should be."""

_MIRROR_Y = np.diag([1.0, -1.0, 1.0, 1.0])


def _quarter_turn(turns: int) -> np.ndarray:
    """Rotation about the optical axis, by exact quarters."""
    return np.round(se3.yaw_transform(turns * np.pi / 2))


def _reordered(poses: Poses, order: tuple[int, int, int, int]) -> Poses:
    """Poses whose quaternions x y z w are these entries of the present ones."""
    xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, order]
    return se3.make_transform(Rotation.from_quat(xyzw).as_matrix(), poses[:, :3, 3])


def _shifted(poses: Poses, frames: int) -> Poses:
    """The pose that stands `frames` further on; at the end the usual motion goes on."""
    if frames < 0:
        return _shifted(poses[::-1], -frames)[::-1]
    last = poses[-1] @ se3.inverse(poses[-2]) if len(poses) > 1 else np.eye(4)
    beyond = [poses[-1]]
    for _ in range(frames):
        beyond.append(last @ beyond[-1])
    return np.concatenate([poses, np.stack(beyond[1:])])[frames:]


def _transposed(poses: Poses) -> Poses:
    return se3.make_transform(np.swapaxes(poses[:, :3, :3], 1, 2), poses[:, :3, 3])


def _with_centres(poses: Poses) -> Poses:
    """Translations of camera_from_world beside rotations of world_from_camera."""
    centres = -(poses[:, :3, :3] @ poses[:, :3, 3:])[..., 0]
    return se3.make_transform(poses[:, :3, :3], centres)


_FROM_WXYZ, _FROM_XYZW = (1, 2, 3, 0), (3, 0, 1, 2)

FRAME_DELAYS = {
    "one_frame_late": 1,
    "two_frames_late": 2,
    "one_frame_early": -1,
    "two_frames_early": -2,
}
"""Of the conventions, those that are a delay of whole frames."""

_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "feet": FOOT_M}
"""Metres of those that have names."""

CONVENTIONS: dict[str, Callable[[Poses], Poses]] = {
    "camera_from_world": se3.inverse,
    "opengl": from_opengl,
    "camera_from_world_opengl": lambda p: from_opengl(se3.inverse(p)),
    "arkit": lambda p: from_opengl(p) @ _quarter_turn(-1),
    "arkit_other_way": lambda p: from_opengl(p) @ _quarter_turn(1),
    "camera_from_world_arkit": lambda p: from_opengl(se3.inverse(p)) @ _quarter_turn(-1),
    "image_turned_left": lambda p: p @ _quarter_turn(1),
    "image_turned_right": lambda p: p @ _quarter_turn(-1),
    "image_upside_down": lambda p: p @ _quarter_turn(2),
    "opengl_upside_down": lambda p: from_opengl(p) @ _quarter_turn(2),
    "quaternion_wxyz": lambda p: _reordered(p, _FROM_WXYZ),
    "quaternion_xyzw": lambda p: _reordered(p, _FROM_XYZW),
    "camera_from_world_quaternion_wxyz": lambda p: se3.inverse(_reordered(p, _FROM_WXYZ)),
    "camera_from_world_quaternion_xyzw": lambda p: se3.inverse(_reordered(p, _FROM_XYZW)),
    "rotation_camera_from_world": _transposed,
    "translation_camera_from_world": _with_centres,
    **{name: partial(_shifted, frames=k) for name, k in FRAME_DELAYS.items()},
    **{name: partial(in_metres, metres=metres) for name, metres in _UNITS.items()},
    "ros_body": lambda p: p @ OPTICAL_AXES,
    "left_handed": lambda p: _MIRROR_Y @ p @ _MIRROR_Y,
    "left_handed_camera_from_world": lambda p: _MIRROR_Y @ se3.inverse(p) @ _MIRROR_Y,
}
"""By name, what makes world_from_cams with OpenCV axes in metres of poses that follow the convention. *Late*
poses are those that stand beside an image which the camera took earlier."""


def _world_turned(degrees: float) -> Callable[[Poses], Poses]:
    """A quarter turn of the world about x, by exact quarters."""
    turn = se3.make_transform(
        np.round(Rotation.from_euler("x", degrees, degrees=True).as_matrix()), np.zeros(3)
    )
    return lambda poses: turn @ poses


WORLD_AXES: dict[str, Callable[[Poses], Poses]] = {
    "z_up": _world_turned(-90.0),
    "y_up": _world_turned(90.0),
}
"""What brings poses whose z (y) is up to the axes of a format whose y (z) is."""
LEVEL_RATIO = 3.0
"""A walk spreads so many times as far along a level axis as along the vertical."""
MIN_SPREAD_M = 0.3
"""A camera that moved less (standard deviation) tells no axis."""
UPRIGHT = 0.6
"""Length of the mean of all image-up directions along the vertical. Where a camera lies on its side, what is
up in the image turns with whoever walks, and the mean is short."""


@dataclass(frozen=True)
class ConventionFit:
    """How well a convention explains the measured motions."""

    name: str
    share: float
    """Of the measured motions, those that it explains."""
    asked: str
    """The convention that it was compared with."""
    asked_share: float
    """Of the measured motions, those that it explains."""
    n_motions: int
    log_ratio: float
    """How much likelier the better one makes a motion than the other, natural logarithm, on average."""

    @property
    def is_clear(self) -> bool:
        """Whether it explains the scan, and clearly better than the one that was asked for."""
        is_enough = self.is_told and self.share >= MIN_SHARE
        # A unit is a median of lengths, which a few false motions do not move.
        is_more = self.is_own_unit or self.share >= self.asked_share + MIN_MORE
        return self.name != self.asked and is_enough and is_more and self.log_ratio >= MIN_LOG_RATIO

    @property
    def is_mount(self) -> bool:
        """Whether poses are those of a body, turned and shifted against the camera in no usual way."""
        return self.name != self.asked and mount_of(self.name) is not None

    @property
    def is_doubtful_mount(self) -> bool:
        """Whether they are, as it seems, and yet explain as much as a convention must without."""
        return self.is_clear and self.is_mount and self.asked_share >= MIN_SHARE

    @property
    def is_own_unit(self) -> bool:
        """Whether all that is other than asked for is a unit that no name is known of."""
        unit = self.name.removeprefix(f"{self.asked}, ")
        return self.name != self.asked and metres_named(unit) is not None

    @property
    def is_unexplained(self) -> bool:
        """Whether enough was measured, and no convention explains it, as recorded or otherwise."""
        return self.is_told and max(self.share, self.asked_share) < MIN_SHARE

    @property
    def is_told(self) -> bool:
        """Whether enough was measured to tell a convention."""
        return self.n_motions >= MIN_MOTIONS


@dataclass(frozen=True)
class _Likelihood:
    """Of the measured motions, given poses and the factor on their sigmas that suits them best."""

    cost: float
    """Twice the negative logarithm, a motion."""
    factor: float


def apply_convention(world_from_cams: Poses, name: str) -> Poses:
    """Poses that were recorded in a convention, as world_from_cams with OpenCV axes in metres.

    Several hold together where a comma and a space stand between their names: `opengl, unit:0.71`.

    Raises:
        OptionError: there is no convention of this name.
    """
    poses, known = world_from_cams, CONVENTIONS | WORLD_AXES
    for part in name.split(", "):
        metres, mount = metres_named(part), mount_of(part)
        if metres is not None:
            poses = in_metres(poses, metres)
        elif mount is not None:
            poses = poses @ mount
        elif part in known:
            poses = known[part](poses)
        elif part != RECORDED:
            raise OptionError(
                f"poses_convention: expected {RECORDED}, {AUTO}, {', '.join(known)}, {UNIT} and "
                f"the metres of a unit, {MOUNT} and roll/pitch/yaw/x/y/z of a camera on a body, found "
                f"{part!r}"
            )
    return poses


def turned_axes(world_from_cams: Poses, up_world: Float[np.ndarray, "3"]) -> str:
    """The axes that poses are in where these are others than those of the format; empty where they are not.

    Both the walk and how the camera was held must say so: the walk leads up and down along `up_world` but is
    level across another axis, and that axis is up in the images.

    Args:
        up_world: unit vector against gravity, as the format has it.
    """
    spread_m = float(np.std(world_from_cams[:, :3, 3] @ up_world))
    up_in_images = -world_from_cams[:, :3, 1].mean(axis=0)
    if spread_m < MIN_SPREAD_M:
        return ""
    for name, change in WORLD_AXES.items():
        true_up = change(np.eye(4)[None])[0, :3, :3].T @ up_world
        across_m = float(np.std(world_from_cams[:, :3, 3] @ true_up))
        is_other = abs(true_up @ up_world) < 0.5
        if is_other and spread_m > LEVEL_RATIO * across_m and up_in_images @ true_up > UPRIGHT:
            return name
    return ""


def best_convention(
    world_from_cams: Poses,
    motions: MeasuredMotions,
    options: OdometryOptions,
    asked: str = RECORDED,
    keyframe_idx: Int[np.ndarray, " k"] | None = None,
) -> ConventionFit:
    """The convention under which the measured motions are likeliest; the one asked for where none is more so.

    Beside the usual ones, the one asked for in a unit of its own, as the motions show it; and the poses of a
    body that carries the camera in any way (`mounts.py`), where these explain clearly more than all others.

    The likelihood is that of `motions.py`, at the noise that suits each convention best. Steps between
    keyframes, where they are given, are as sure as `options` say.

    Raises:
        OptionError: there is no convention of the name asked for.
    """
    n_all, as_asked = len(motions), apply_convention(world_from_cams, asked)
    if n_all < MIN_MOTIONS:
        return ConventionFit(asked, 0.0, asked, 0.0, n_all, 0.0)
    motions = motions[np.unique(np.linspace(0, n_all - 1, MAX_MOTIONS).astype(int))]
    of_asked = _likelihood(as_asked, motions, options, keyframe_idx)
    name, best, poses = asked, of_asked, as_asked
    in_own_unit = None if asked in _UNITS else _own_unit(as_asked, motions)
    own = () if in_own_unit is None else (_with_unit(asked, in_own_unit),)
    for candidate in (RECORDED, *CONVENTIONS, *own):
        converted = apply_convention(world_from_cams, candidate)
        if candidate in _UNITS and not _is_unit(converted, motions):
            continue
        found = _likelihood(converted, motions, options, keyframe_idx)
        if found.cost < best.cost:
            name, best, poses = candidate, found, converted

    def share_of(explaining: Poses, factor: float) -> float:
        ((_, squared, _),) = _squared(explaining, motions, options, (factor,), keyframe_idx)
        return float(np.mean(squared < EXPLAINED_SIGMAS**2))

    # Where all is explained by a tracker as good as usual, nothing can explain clearly more.
    if share_of(poses, NOISE[0]) <= 1 - MIN_MORE:
        odometry = make_odometry(world_from_cams, options, None, keyframe_idx)
        mount = mount_named(mount_by_motions(world_from_cams, motions, odometry))
        mounted = apply_convention(world_from_cams, mount)
        found = _likelihood(mounted, motions, options, keyframe_idx)
        left, left_of_mount = (1 - share_of(each, found.factor) for each in (poses, mounted))
        gain = (best.cost - found.cost) / 2
        # Schwarz's price of six parameters; motions of one frame err together, so that frames count.
        n_frames = len(np.unique(motions.pairs))
        is_earned = gain * n_frames >= 3 * np.log(n_frames) + np.log(CLEAR_ODDS.value)
        # Six parameters bend to what lens or depth get wrong; a mount that is one leaves next to nothing.
        is_more = left - left_of_mount >= max(MIN_MORE, left / 2)
        if is_earned and gain >= MIN_LOG_RATIO and is_more:
            name, best, poses = mount, found, mounted
    share, asked_share = (share_of(each, best.factor) for each in (poses, as_asked))
    log_ratio = (of_asked.cost - best.cost) / 2
    return ConventionFit(name, share, asked, asked_share, n_all, log_ratio)


def _own_unit(poses: Poses, motions: MeasuredMotions) -> float | None:
    """Metres of the unit that measured motions show, where it is none that has a name."""
    metres = unit_by_motions(poses, motions)
    if metres is None or any(
        1 / MIN_DEPARTURE < metres / u < MIN_DEPARTURE for u in _UNITS.values()
    ):
        return None
    return metres


def _with_unit(convention: str, metres: float) -> str:
    unit = unit_named(metres)
    return unit if convention == RECORDED else f"{convention}, {unit}"


def _likelihood(
    poses: Poses,
    motions: MeasuredMotions,
    options: OdometryOptions,
    keyframe_idx: Int[np.ndarray, " k"] | None,
) -> _Likelihood:
    found = []
    for factor, squared, covariance in _squared(poses, motions, options, NOISE, keyframe_idx):
        tail = (FREEDOM + 6.0) * np.log1p(squared / FREEDOM)
        cost = float(np.mean(tail + np.linalg.slogdet(covariance)[1]))
        found.append((cost, factor))
    return _Likelihood(*min(found))


def _squared(
    poses: Poses,
    motions: MeasuredMotions,
    options: OdometryOptions,
    factors: tuple[float, ...],
    keyframe_idx: Int[np.ndarray, " k"] | None,
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Factor on the tracker's sigmas, squared departures (p,) in sigmas of all motions, their covariance
    (p, 6, 6)."""
    odometry = make_odometry(poses, options, None, keyframe_idx)
    # In millimetres steps are a thousand times longer, and so would be their sigmas: any motion would do.
    capped = np.minimum(odometry.sigma_translation, MAX_SIGMA_M)
    odometry = replace(odometry, sigma_translation=capped)
    departed = departures(motions, poses)
    for factor in factors:
        covariance = expected_covariance(motions, odometry, (factor, factor))
        yield factor, squared_sigmas(departed, covariance), covariance


def _is_unit(poses: Poses, motions: MeasuredMotions) -> bool:
    """Whether recorded steps are about as long as those measured."""
    return 1 / MAX_UNIT_ERROR < share_of_measured(poses, motions) < MAX_UNIT_ERROR
