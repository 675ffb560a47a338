"""Photos beside findings: of the frames that they name, and of frames that see the walls that they name."""

import base64
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from planfit.adjust.association import wall_patches_in_plan
from planfit.findings import Finding
from planfit.findings.finding import FEW_NAMED
from planfit.pipeline.result import RefineResult
from planfit.priors import PATCH_TURN_MOST_DEG, WALL_MOVED_MOST_M


def items_with_photos(
    items: Iterable[tuple[Finding, str]], result: RefineResult, pictures: Mapping[int, bytes]
) -> str:
    """List items of findings and their words (HTML), with photos where there are some: few beside each, and
    twice as many in all.

    Args:
        items: findings about one scan or several; those about one of several have no photo.
        result: whose frames they name.
        pictures: JPEGs by frame.
    """
    left, html = 2 * FEW_NAMED, []
    for finding, words in items:
        frames = list(dict.fromkeys(frames_to_show(finding, result, pictures)))
        frames = frames[: min(left, FEW_NAMED)]
        left -= len(frames)
        photos = "".join(_photo(frame, pictures[frame]) for frame in frames)
        html.append(
            f"<li>{words}" + (f'<div class="photos">{photos}</div>' if photos else "") + "</li>"
        )
    return "".join(html)


def frames_to_show(
    finding: Finding, result: RefineResult, pictures: Mapping[int, bytes]
) -> Iterator[int]:
    """Of each run of frames the one in its middle that has a picture; of each wall the one whose piece of
    wall lies nearest to it."""
    if not pictures or finding.subject:
        return
    pictured = np.array(sorted(pictures))
    for first, last in finding.frames:
        inside = pictured[(pictured >= first) & (pictured <= last)]
        if len(inside):
            yield int(inside[len(inside) // 2])
    if finding.faces and result.floorplan is not None:
        yield from _frames_that_see(finding.faces, result, pictured)


def _frames_that_see(
    faces: tuple[int, ...], result: RefineResult, pictured: np.ndarray
) -> Iterator[int]:
    plan, patches = result.floorplan, result.structure.walls
    assert plan is not None
    normals, ends = wall_patches_in_plan(patches, result.plan_from_cams)
    is_pictured = np.isin(patches.frame_idx, pictured)
    for face in faces:
        off = ends.mean(axis=1) - plan.ends[face].mean(axis=0)
        along = np.abs(off @ (plan.ends[face, 1] - plan.ends[face, 0])) / plan.lengths[face]
        facing = np.abs(normals @ plan.normals[face])
        sees = is_pictured & (facing > np.cos(np.deg2rad(PATCH_TURN_MOST_DEG.value)))
        sees &= np.abs(off @ plan.normals[face]) < WALL_MOVED_MOST_M.value
        sees &= along < plan.lengths[face] / 2
        if sees.any():
            yield int(patches.frame_idx[sees][np.argmin(along[sees])])


def _photo(frame: int, jpeg: bytes) -> str:
    data = base64.b64encode(jpeg).decode("ascii")
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" alt="image of frame {frame}">'
        f'<figcaption>frame <span data-frame="{frame}">{frame}</span></figcaption></figure>'
    )
