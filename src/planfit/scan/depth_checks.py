"""What nine frames tell of a scan's depth: its unit, and along what it was measured."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.images.decode import N_DEPTH_FRAMES, USUAL_DEPTH_M
from planfit.scan.types import Scan
from planfit.scan.views import FilesView

_SIDE, _STEP_PX, _FULL = 3, 4, 0.9
"""Places are a third of an image wide and high, half of one apart; every so many pixels are looked at; and so
much of them must be measured."""
_FLAT = 0.01
"""Share of the depth by which flat places leave a plane, at the median of their pixels."""
_LEAST_PLACES, _MOST_FLATTER, _LOG_RATIO = 20, 0.7, -0.3
"""Flat places that tell; share of them that are flatter along rays; logarithm of by how much, at the median.
Of fifteen scans along the axis 0.07 at most are, and they are less flat by 0.4 and more; of two along rays
0.84 and 0.88, by -0.5 and -0.7. Densified laser depth has too few (9)."""


def checked_depth(scan: Scan) -> Scan:
    """The scan with depth along the camera's axis, and warnings of what depth cannot be right.

    Raises:
        ScanError: nothing was measured in any of nine frames.
    """
    depths = dict(depth_of_nine(scan))
    share, n_places = flatter_along_rays(scan.cameras, depths)
    if n_places >= _LEAST_PLACES and share > _MOST_FLATTER:
        told = (
            f"depth was measured along each pixel's ray, as {share:.0%} of {n_places} flat places show: it "
            "is put along the camera's axis"
        )
        mark = f"{scan.fingerprint}-rays" if scan.fingerprint else ""
        files = RayFiles(scan.files, scan.cameras)
        scan = replace(scan, files=files, fingerprint=mark, warnings=(*scan.warnings, told))
        depths = {i: along_axis(scan.cameras[i], depth) for i, depth in depths.items()}
    middle = _median_m(scan.name, depths.values())
    return replace(scan, warnings=(*scan.warnings, *check_depth_unit(middle)))


def flatter_along_rays(
    cameras: Sequence[Camera], depths: Mapping[int, Float[np.ndarray, "_ _"]]
) -> tuple[float, int]:
    """Share of flat places that are flatter where depth is taken as measured along the rays of pixels, 0
    unless they are so by far; and how many places were looked at.

    Depth of a plane along the axis has an inverse that is linear in the image.

    `cameras`: of all frames; `depths`: of some, m, by their index.
    """
    ratios: list[float] = []
    for i, depth in depths.items():
        camera = cameras[i]
        x, y = (each[::_STEP_PX, ::_STEP_PX] for each in _directions(camera, depth.shape))
        inverse = 1 / depth[::_STEP_PX, ::_STEP_PX]
        height, width = (max(side // _SIDE, 3) for side in inverse.shape)
        for v in range(0, inverse.shape[0] - height + 1, max(height // 2, 1)):
            for u in range(0, inverse.shape[1] - width + 1, max(width // 2, 1)):
                part = np.s_[v : v + height, u : u + width]
                ratios += _flatness(x[part].ravel(), y[part].ravel(), inverse[part].ravel())
    if not ratios or np.median(ratios) > _LOG_RATIO:
        return 0.0, len(ratios)
    return float(np.mean(np.array(ratios) < 0)), len(ratios)


def _flatness(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], inverse: Float[np.ndarray, " n"]
) -> list[float]:
    """Logarithm of how far from a plane pixels lie along rays over how far along the axis; none of a place
    that is flat by neither.

    Args:
        x: of their directions, z = 1.
        y: likewise.
        inverse: of their depth.
    """
    known = np.isfinite(inverse)
    if known.mean() < _FULL:
        return []
    x, y, inverse = x[known], y[known], inverse[known]
    linear = np.stack([x, y, np.ones_like(x)], axis=1)
    left = []
    for each in (inverse, inverse * np.sqrt(1 + x**2 + y**2)):
        fit = np.linalg.lstsq(linear, each, rcond=None)[0]
        left.append(float(np.median(np.abs(linear @ fit / each - 1))) + 1e-9)
    return [float(np.log(left[1] / left[0]))] if min(left) < _FLAT else []


def _directions(
    camera: Camera, shape: tuple[int, ...]
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """x and y of the rays of all pixels, z = 1."""
    points = camera.lift_image(np.ones(shape))
    return points[..., 0], points[..., 1]


def along_axis(camera: Camera, distances: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Depth along the axis, float32, of distances along the rays of pixels, both in m."""
    x, y = _directions(camera, distances.shape)
    return (distances / np.sqrt(1 + x**2 + y**2)).astype(np.float32)


@dataclass(frozen=True)
class RayFiles(FilesView):
    """A scan's files, whose depth was measured along rays."""

    cameras: tuple[Camera, ...]

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth along the axis, float32 m, NaN where nothing was measured."""
        return along_axis(self.cameras[frame_idx], self.files.depth(frame_idx))


def median_depth_m(scan: Scan) -> float | None:
    """Depth in the middle of the frames, by nine of them; None where none of these can be read.

    Raises:
        ScanError: nothing was measured in any of these frames.
    """
    return _median_m(scan.name, (depth for _, depth in depth_of_nine(scan)))


def _median_m(name: str, depths: Iterable[Float[np.ndarray, "_ _"]]) -> float | None:
    medians, n_read = [], 0
    for depth in depths:
        n_read += 1
        known = depth[np.isfinite(depth)]
        if len(known):
            medians.append(float(np.median(known)))
    if not medians and n_read:
        raise ScanError(
            f"{name}: expected depth, found no measurement in any of the {n_read} frames looked at; "
            "export the scan again with depth"
        )
    return float(np.median(medians)) if medians else None


def depth_of_nine(scan: Scan) -> Iterator[tuple[int, Float[np.ndarray, "h w"]]]:
    """Nine frames from all over the scan, and their depth in m; without those that cannot be read."""
    having = np.flatnonzero(np.array(scan.lacking) != "depth")
    for i in having[np.unique(np.linspace(0, len(having) - 1, N_DEPTH_FRAMES).astype(int))]:
        try:
            depth = scan.files.depth(int(i))
        except ScanError:
            continue  # told when a stage asks for the frame
        yield int(i), depth


def check_depth_unit(middle: float | None) -> list[str]:
    """Warnings about depth whose median (m) this is: nothing, or a unit that cannot be right."""
    near_m, far_m = USUAL_DEPTH_M
    if middle is None or near_m <= middle <= far_m:
        return []
    return [
        f"half of the depth is below {middle:.3g} m, where {near_m:g} to {far_m:g} m are usual in a "
        "building: is it in another unit? `planfit refine` takes a usual one where recorded motion agrees; "
        "else say which with --depth-scale (metres of one stored unit)"
    ]
