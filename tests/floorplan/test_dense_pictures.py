"""Pictures of more lines than any plan: read or refused, by ways that find what slower ones would.

What they cost beside a plan of their size is measured in benchmarks/plan_pictures.py.
"""

import cv2
import numpy as np
import pytest
import shapely
from PIL import Image
from plan_pictures import DENSE, dense_grid

from planfit.errors import FloorplanError
from planfit.floorplan import read_floorplan
from planfit.floorplan.gaps import WIDEST, _gaps_px, find_openings
from planfit.floorplan.raster.trace import profiles, trace_regions
from planfit.floorplan.vector.regions import faces_of_regions
from planfit.geometry import segments


def is_read_or_asked_for(path) -> bool:
    """Whether a picture is read, or refused as no plan: not for what a library says."""
    try:
        return len(read_floorplan(path)) > 0
    except FloorplanError as error:
        return "is it a floorplan" in str(error)


@pytest.mark.slow
@pytest.mark.parametrize("make", DENSE.values(), ids=DENSE.keys())
def test_pictures_of_thousands_of_lines_are_read_or_asked_for(make, tmp_path):
    Image.fromarray(make()).save(tmp_path / "plan.png")
    assert is_read_or_asked_for(tmp_path / "plan.png")


def test_more_edges_than_opencv_maps_at_once(tmp_path):
    # 100,000 px of edges, one point each 3 px: more than 32,767 rows of a remap.
    Image.fromarray(dense_grid(step_px=14, line_px=4)).save(tmp_path / "plan.png")
    assert is_read_or_asked_for(tmp_path / "plan.png")


def test_a_mask_of_more_parts_than_any_plan_has_no_walls():
    mask = np.zeros((400, 400), np.uint8)
    mask[1::4, 1::4] = mask[2::4, 1::4] = mask[1::4, 2::4] = mask[2::4, 2::4] = 1
    assert trace_regions(mask, 0.5) == []
    assert len(trace_regions(mask[:100], 0.5)) == 2500


def random_faces(rng, n):
    """Faces along few lines, so that many go on in one another, and of walls of a few thicknesses."""
    horizontal = rng.random(n) < 0.5
    begin = rng.integers(0, 40, (n, 2)) * np.where(horizontal[:, None], [5, 12], [12, 5])
    length = rng.integers(3, 60, n)
    step = np.where(horizontal[:, None], [1, 0], [0, 1]) * length[:, None]
    ends = np.stack([begin, begin + step], axis=1).astype(float)
    ends += rng.normal(0, 0.6, ends.shape)
    flip = rng.random(n) < 0.5
    ends[flip] = ends[flip, ::-1]
    normals = -segments.left_normals(ends)
    return ends, normals, rng.choice([4.0, 6.0, 12.0], n)


def walls_with_doors(rng, n):
    """Faces of walls, front and back, interrupted by doors at the same places."""
    faces, thickness = [], []
    for k in range(n):
        thick, at = rng.choice([4.0, 6.0]), 0.0
        for _ in range(rng.integers(2, 5)):
            length = rng.uniform(20, 60)
            a, b = np.array([at, 30.0 * k]), np.array([at + length, 30.0 * k])
            back = np.array([0.0, thick])
            faces += [[a, b], [b + back, a + back]]
            thickness += [thick, thick]
            at += length + rng.uniform(1.0, 5.0) * thick
    ends = np.array(faces) + rng.normal(0, 0.3, (len(faces), 2, 2))
    if rng.random() < 0.5:
        ends = ends[:, ::-1, ::-1]  # the mirror image, its faces to the same side
    return ends, -segments.left_normals(ends), np.array(thickness)


def gaps_by_all(ends, normals, thickness):
    """As `_gaps_px`, each face against every other."""
    lengths = segments.lengths(ends)
    is_long = lengths > 0.5 * thickness
    found = []
    for i in np.flatnonzero(is_long):
        along = (ends[i, 1] - ends[i, 0]) / lengths[i]
        offset = np.abs((ends - ends[i, 0]) @ normals[i]).max(axis=1)
        first = ((ends - ends[i, 0]) @ along).min(axis=1)
        same = is_long & (normals @ normals[i] > 0.99) & (offset < 2.5)
        later = np.flatnonzero(same & (first > lengths[i] - 1.0))
        if len(later) == 0:
            continue
        j = later[np.argmin(first[later])]
        wide, thick = first[j] - lengths[i], min(thickness[i], thickness[j])
        is_pair = max(thickness[i], thickness[j]) < 1.7 * thick + 2
        is_column = max(lengths[i], lengths[j]) < 1.2 * thick
        if not is_column and is_pair and 0.5 * thick < wide < WIDEST * thick:
            nearest = ends[j][np.argmin((ends[j] - ends[i, 0]) @ along)]
            found.append((np.array([ends[i, 1], nearest]), normals[i], thick))
    return found


def openings_by_all(gaps):
    """As `find_openings`, each gap against every other."""
    kept = []
    for ends, normal, thick in gaps:
        along = ends[1] - ends[0]
        length = np.linalg.norm(along)
        for other, other_normal, _ in gaps:
            behind = (ends[0] - other[0]) @ normal
            at = np.sort((other - ends[0]) @ (along / length))
            overlap = min(at[1], length) - max(at[0], 0.0)
            if (
                other_normal @ normal < -0.99
                and abs(behind - thick) < 0.35 * thick + 1.0
                and overlap > 0.8 * max(length, at[1] - at[0])
            ):
                kept.append(ends)
                break
    return kept


@pytest.mark.parametrize("seed", range(6))
def test_openings_are_those_that_comparing_all_finds(seed):
    rng = np.random.default_rng(seed)
    both = zip(random_faces(rng, 300), walls_with_doors(rng, 20), strict=True)
    ends, normals, thickness = (np.concatenate(pair) for pair in both)
    expected = gaps_by_all(ends, normals, thickness)
    found = _gaps_px(ends, normals, thickness)
    np.testing.assert_array_equal([g[0] for g in found], [g[0] for g in expected])
    openings = openings_by_all(expected)
    assert len(openings) > 10
    np.testing.assert_array_equal(find_openings(ends, normals, thickness), openings)


def test_the_wall_behind_faces_of_one_wall_of_many_corners():
    # A comb of 150 teeth, 0.3 and 0.5 thick by turns: one polygon of 600 corners, cut in pieces.
    teeth = [shapely.box(2 * k, 0, 2 * k + (0.3 if k % 2 else 0.5), 20) for k in range(150)]
    comb = shapely.union_all([shapely.box(0, -1, 299, 0), *teeth])
    faces = faces_of_regions(comb, 0.001, 0.1)
    middle, is_side = faces.ends.mean(axis=1), np.abs(faces.normals[:, 0]) > 0.9
    is_tooth = is_side & (middle[:, 1] > 1.0) & (segments.lengths(faces.ends) > 19)
    assert is_tooth.sum() == 300
    expected = np.where((middle[is_tooth, 0] // 2) % 2 == 1, 0.3, 0.5)
    np.testing.assert_allclose(faces.thickness[is_tooth], expected, atol=1e-3)


def test_profiles_of_more_points_than_opencv_maps_at_once():
    points = np.stack([np.arange(40_000) % 60, np.full(40_000, 20)], axis=1).astype(float)
    picture = np.ones((40, 60), np.float32)
    found = profiles(picture, points, np.zeros_like(points), np.zeros(1), cv2.INTER_LINEAR)
    assert found.shape == (40_000, 1)
    assert (found == 1).all()
