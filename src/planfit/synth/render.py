"""Colour, depth and labels of a synthetic building by a depth buffer."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.compiled import kernel
from planfit.geometry.camera import Camera
from planfit.scan.types import Label
from planfit.synth.depth_buffer import first_rectangles
from planfit.synth.quads import Lights, Quads
from planfit.synth.texture import paint


@dataclass(frozen=True)
class View:
    """What a faultless camera would record; colour is linear, before exposure and noise."""

    color: Float[np.ndarray, "h w 3"]
    """Linear red, green, blue, about 0 to 1."""
    depth: Float[np.ndarray, "h w"]
    """Along the optical axis, m, NaN where nothing is hit."""
    labels: UInt8[np.ndarray, "h w"]
    """Values of `Label`."""
    incidence: Float[np.ndarray, "h w"]
    """Cosine of the angle between ray and surface normal; 0 where nothing is hit."""


@dataclass(frozen=True)
class Renderer:
    """Renders rectangles in the plan frame."""

    quads: Quads
    lights: Lights

    @cached_property
    def _room_starts(self) -> tuple[Int[np.ndarray, " r"], Int[np.ndarray, " r"]]:
        """Where the lamps and footprints of each room begin in their sorted lists."""
        rooms = np.arange(int(self.quads.room.max()) + 2)
        return (
            np.searchsorted(self.lights.lamp_room, rooms),
            np.searchsorted(self.lights.footprint_room, rooms),
        )

    def hit_quads(
        self, camera: Camera, plan_from_cam: Float[np.ndarray, "4 4"]
    ) -> Int[np.ndarray, "h w"]:
        """Index of the rectangle that each pixel sees; -1 for none."""
        quads = self.quads
        return first_rectangles(
            camera, plan_from_cam, quads.origin, quads.u_axis, quads.v_axis, quads.size
        )

    def render(self, camera: Camera, plan_from_cam: Float[np.ndarray, "4 4"]) -> View:
        """Render one view.

        Args:
            camera: intrinsics and image size.
            plan_from_cam: pose, OpenCV camera axes.
        """
        quads, lights = self.quads, self.lights
        shape = (camera.height, camera.width)
        hit = self.hit_quads(camera, plan_from_cam).ravel()
        depth = np.full(hit.size, np.nan, dtype=np.float32)
        incidence, footprint, brightness = np.zeros((3, hit.size), dtype=np.float32)
        uv = np.zeros((hit.size, 2))
        lamp_starts, foot_starts = self._room_starts
        _locate(
            hit, _rays(camera), np.ascontiguousarray(plan_from_cam), 1.0 / camera.fx,
            quads.origin, quads.u_axis, quads.v_axis, quads.normal, quads.size, quads.room,
            quads.label, lights.lamps, lamp_starts, lights.footprints, foot_starts,
            uv, depth, incidence, footprint, brightness,
        )  # fmt: skip
        color = np.zeros((hit.size, 3), dtype=np.float32)
        paint(
            hit, uv, footprint, brightness, quads.material, quads.size, quads.color, quads.seed,
            color,
        )  # fmt: skip
        labels = np.where(hit >= 0, quads.label[hit], np.uint8(Label.NONE))
        return View(
            color.reshape(*shape, 3), depth.reshape(shape), labels.reshape(shape),
            incidence.reshape(shape),
        )  # fmt: skip


@lru_cache(maxsize=4)
def _rays(camera: Camera) -> Float[np.ndarray, "n 3"]:
    """Directions of all pixels, z = 1, camera frame; shared, so not to be written to."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return camera.rays(np.stack([u.ravel(), v.ravel()], axis=-1).astype(float))


_FLOOR, _WALL = int(Label.FLOOR), int(Label.WALL)


@kernel
def _locate(
    hit: np.ndarray, rays: np.ndarray, plan_from_cam: np.ndarray, pixel_angle: float,
    origin: np.ndarray, u_axis: np.ndarray, v_axis: np.ndarray, normal: np.ndarray,
    size: np.ndarray, room: np.ndarray, label: np.ndarray,
    lamps: np.ndarray, lamp_starts: np.ndarray, feet: np.ndarray, foot_starts: np.ndarray,
    uv: np.ndarray, depth: np.ndarray, incidence: np.ndarray, footprint: np.ndarray,
    brightness: np.ndarray,
) -> None:  # fmt: skip
    """Where on its rectangle each pixel looks, how far away that is, and how bright."""
    rotation, eye = plan_from_cam[:3, :3], plan_from_cam[:3, 3]
    point, d = np.zeros(3), np.zeros(3)
    for i in range(len(hit)):
        q = hit[i]
        if q < 0:
            continue
        along, ahead, length_sq = 0.0, 0.0, 0.0
        for a in range(3):
            d[a] = rotation[a, 0] * rays[i, 0] + rotation[a, 1] * rays[i, 1] + rotation[a, 2]
            length_sq += d[a] * d[a]
            along += normal[q, a] * d[a]
            ahead += normal[q, a] * (origin[q, a] - eye[a])
        if along == 0.0:
            continue
        z = ahead / along
        u, v = 0.0, 0.0
        for a in range(3):
            point[a] = eye[a] + z * d[a]
            u += u_axis[q, a] * (point[a] - origin[q, a])
            v += v_axis[q, a] * (point[a] - origin[q, a])
        cosine = abs(along) / math.sqrt(length_sq)
        uv[i, 0], uv[i, 1] = u, v
        depth[i], incidence[i] = z, cosine
        # Between the pixel's short and long side on a slanted surface.
        footprint[i] = z * pixel_angle / math.sqrt(max(cosine, 0.1))
        k = 1.0
        if room[q] >= 0:
            first, last = int(lamp_starts[room[q]]), int(lamp_starts[room[q] + 1])
            k = _light(point, normal[q], lamps, first, last)
            if label[q] == _FLOOR:
                first, last = int(foot_starts[room[q]]), int(foot_starts[room[q] + 1])
                k *= _floor_shadow(point, feet, first, last)
            if label[q] == _WALL or label[q] == _FLOOR:
                k *= _corner_shadow(u, v, size[q, 0], size[q, 1])
        brightness[i] = k


@kernel
def _light(
    point: np.ndarray, normal: np.ndarray, lamps: np.ndarray, start: int, stop: int
) -> float:
    total = 0.0
    for n in range(start, stop):
        x, y, z = lamps[n, 0] - point[0], lamps[n, 1] - point[1], lamps[n, 2] - point[2]
        distance_sq = x * x + y * y + z * z + 0.05
        cosine = (x * normal[0] + y * normal[1] + z * normal[2]) / math.sqrt(distance_sq)
        total += (0.45 + 0.55 * max(cosine, 0.0)) * 3.0 / (2.0 + distance_sq)
    return 0.42 + 0.75 * total / (0.6 + 0.5 * total)


@kernel
def _floor_shadow(point: np.ndarray, feet: np.ndarray, start: int, stop: int) -> float:
    """Floors are darker under and beside furniture."""
    k = 1.0
    for n in range(start, stop):
        x, y = point[0] - feet[n, 0], point[1] - feet[n, 1]
        c, s = math.cos(feet[n, 4]), math.sin(feet[n, 4])
        du, dv = abs(c * x + s * y) - feet[n, 2], abs(c * y - s * x) - feet[n, 3]
        distance = math.hypot(max(du, 0.0), max(dv, 0.0))
        if distance < 0.6:
            k *= 1.0 - 0.4 * math.exp(-distance / 0.12)
    return k


@kernel
def _corner_shadow(u: float, v: float, width: float, height: float) -> float:
    edge = min(min(u, width - u), min(v, height - v))
    return 1.0 - 0.22 * math.exp(-max(edge, 0.0) / 0.1)
