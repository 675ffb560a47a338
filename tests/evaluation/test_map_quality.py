"""MME, MPV and MOM against slow twins written from the definitions, and against planes of known thickness."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import look, random_transforms
from planfit.evaluation import MapSample, find_orthogonal_sets, map_quality, mom_m2
from planfit.evaluation.map_quality import orthogonal_triple, planar_normals
from planfit.geometry import se3


def slow_mme_mpv(points, radius_m):
    """Point by point, as the definitions read."""
    entropies, variances = [], []
    for point in points:
        near = points[np.linalg.norm(points - point, axis=1) <= radius_m]
        if len(near) > 5:
            covariance = np.cov(near.T)
            variances.append(np.linalg.eigvalsh(covariance)[0])
            determinant = np.linalg.det(2 * np.pi * np.e * covariance)
            if determinant > 0:
                entropies.append(0.5 * np.log(determinant))
    return np.mean(entropies), np.mean(variances)


def plane(rng, n, sigma_m, side_m=2.0):
    return np.stack([*rng.uniform(0, side_m, (2, n)), sigma_m * rng.normal(size=n)], axis=1)


def corner(rng, n, sigma_m=0.0, side_m=1.5):
    """Three walls that meet in a corner, each with n points."""
    walls = []
    for axis in range(3):
        points = rng.uniform(0, side_m, (n, 3))
        points[:, axis] = sigma_m * rng.normal(size=n)
        walls.append(points)
    return np.concatenate(walls)


@pytest.mark.parametrize("radius_m", [0.15, 0.2, 1.0])
def test_the_definitions_point_by_point(rng, radius_m):
    points = np.concatenate([plane(rng, 600, 0.01), rng.uniform(0, 2, (60, 3)), [[9.0, 9, 9]]])
    mme, mpv = slow_mme_mpv(points, radius_m)
    found = map_quality(points, radius_m)
    assert found.mme == pytest.approx(mme, abs=1e-9)
    assert found.mpv_m2 == pytest.approx(mpv, rel=1e-9)


def test_a_plane_has_the_variance_of_its_noise(rng):
    quality = map_quality(plane(rng, 200_000, 0.01, side_m=8.0), 0.2)
    assert quality.mpv_m2 == pytest.approx(1e-4, rel=0.02)
    # In the middle of a disc of radius r the two large variances are r^2 / 4.
    expected = 0.5 * np.log((2 * np.pi * np.e) ** 3 * 0.01**2 * 1e-4)
    assert quality.mme == pytest.approx(expected, abs=0.06)


def test_a_second_layer_shows_in_both(rng):
    once, twice = plane(rng, 20_000, 0.005), plane(rng, 20_000, 0.005)
    twice[::2, 2] += 0.06  # half of the points on each layer: a variance of 3 cm squared more
    first, last = map_quality(once, 0.2), map_quality(twice, 0.2)
    assert last.mpv_m2 - first.mpv_m2 == pytest.approx(0.03**2, rel=0.03)
    assert last.mme > first.mme + 1.0


def test_a_rigid_motion_changes_nothing(rng):
    points = corner(rng, 800, 0.01)
    here = map_quality(points, 0.2)
    there = map_quality(se3.transform(random_transforms(rng, 1)[0], points), 0.2)
    assert there.mme == pytest.approx(here.mme, abs=1e-6)
    assert there.mpv_m2 == pytest.approx(here.mpv_m2, rel=1e-6)


def test_order_and_threads_change_nothing(rng):
    points = corner(rng, 800, 0.01)
    mixed = rng.permutation(len(points))
    one, two = map_quality(points, 0.2), map_quality(points[mixed], 0.2, workers=3)
    assert two.mme == pytest.approx(one.mme, abs=1e-12)
    assert_array_equal(two.n_neighbours, one.n_neighbours[mixed])
    assert_allclose(two.plane_variance_m2, one.plane_variance_m2[mixed], rtol=1e-5)


def test_exactly_flat_points_have_no_entropy(rng):
    quality = map_quality(plane(rng, 2000, 0.0), 0.2)
    assert np.isnan(quality.mme)
    assert quality.mpv_m2 == pytest.approx(0.0, abs=1e-15)


def test_five_neighbours_are_too_few():
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1], [0.05, 0.05, 0.02]])
    assert np.isnan(map_quality(points, 0.5).mpv_m2)
    six = np.concatenate([points, [[0.03, 0.02, 0.05]]])
    assert map_quality(six, 0.5).mpv_m2 > 0


def test_no_points():
    quality = map_quality(np.zeros((0, 3)), 0.2)
    assert np.isnan(quality.mme)
    assert np.isnan(quality.mpv_m2)


# MOM


def sample_of(plan_from_cams, clouds_plan):
    """Each camera's cloud, given in the plan frame, as a sample in camera frames."""
    cams = [
        se3.transform(se3.inverse(pose), cloud)
        for pose, cloud in zip(plan_from_cams, clouds_plan, strict=True)
    ]
    start = np.cumsum([0, *(len(c) for c in cams)])
    return MapSample(np.concatenate(cams).astype(np.float32), start)


EYES = np.stack(
    [look([1.2, 1.2, 1.1], 225), look([0.9, 1.1, 1.0], 220), look([1.1, 0.8, 1.2], 230)]
)


def test_the_three_walls_of_a_corner_are_found(rng):
    points = corner(rng, 500, 0.003)
    cam_from_plan = se3.inverse(EYES[0])
    triple = orthogonal_triple(se3.transform(cam_from_plan, points), 0.2)
    walls = [np.bincount(idx // 500, minlength=3) for idx in triple]
    assert sorted(int(np.argmax(of)) for of in walls) == [0, 1, 2]
    for of in walls:
        assert of.max() > 0.97 * of.sum()  # next to a corner a neighbourhood holds another wall
        assert of.max() > 200


def test_normals_look_at_the_camera_and_only_of_planar_points(rng):
    points = np.concatenate([corner(rng, 400, 0.002), rng.uniform(0.4, 1.0, (60, 3))])
    seen = se3.transform(se3.inverse(EYES[0]), points)
    idx, normals = planar_normals(seen, 0.2)
    assert np.all(np.einsum("ni,ni->n", normals, seen[idx]) < 0)
    in_plan = normals @ EYES[0][:3, :3].T
    flat = idx < 1200
    expected = np.eye(3)[np.minimum(idx // 400, 2)]
    assert np.mean(np.einsum("ni,ni->n", in_plan, expected)[flat] > 0.99) > 0.9
    assert np.mean(idx >= 1200) < 0.02


def slow_triple(normals, labels, min_points=6):
    """The heaviest of all orthogonal triples of clusters, by trying them all."""
    kept = [k for k in np.unique(labels) if np.sum(labels == k) >= min_points]
    mean = {k: normals[labels == k].mean(axis=0) for k in kept}
    mean = {k: v / np.linalg.norm(v) for k, v in mean.items()}
    best, most = None, 0
    for three in itertools.combinations(kept, 3):
        if all(abs(mean[a] @ mean[b]) < 0.1 for a, b in itertools.combinations(three, 2)):
            total = sum(int(np.sum(labels == k)) for k in three)
            if total > most:
                best, most = three, total
    return best, most


def test_the_heaviest_triple_of_all_is_taken(rng):
    from scipy.cluster.hierarchy import fcluster, linkage

    # Two frames of axes, half a right angle apart: two triples to choose from.
    turned = se3.yaw_transform(np.deg2rad(40.0))
    turned[:3, 3] = [4.0, 4.0, 0.0]
    points = np.concatenate(
        [corner(rng, 260, 0.004), se3.transform(turned, corner(rng, 200, 0.004))]
    )
    seen = se3.transform(se3.inverse(look([2.5, 2.5, 1.5], 225)), points)
    _, normals = planar_normals(seen, 0.2)
    labels = fcluster(linkage(normals, "complete"), 0.1, criterion="distance")
    _, most = slow_triple(normals, labels)
    triple = orthogonal_triple(seen, 0.2)
    assert sum(len(part) for part in triple) == most
    assert most > 0


def test_one_wall_alone_has_no_mom(rng):
    wall = plane(rng, 800, 0.002) - [1.0, 1.0, -2.0]
    assert orthogonal_triple(wall, 0.2) is None
    sample = MapSample(wall.astype(np.float32), np.array([0, 800]))
    sets = find_orthogonal_sets(sample, 0.2, 10)
    assert sets == ()
    assert np.isnan(mom_m2(sets, map_quality(wall, 0.2)))


def slow_mom(sets, points, radius_m):
    sums = []
    for of_frame in sets:
        total = 0.0
        for idx in of_frame.sets:
            values = []
            for point in points[idx]:
                near = points[np.linalg.norm(points - point, axis=1) <= radius_m]
                if len(near) > 3:
                    values.append(np.linalg.eigvalsh(np.cov(near.T))[0])
            total += np.median(values)
        sums.append(total)
    return np.mean(sums)


def test_mom_by_its_definition_and_poses_play_no_part_in_the_sets(rng):
    clouds = [corner(rng, 300, 0.003) for _ in EYES]
    sample = sample_of(EYES, clouds)
    sets = find_orthogonal_sets(sample, 0.2, 10)
    assert [s.frame_idx for s in sets] == [0, 1, 2]
    drifted = EYES.copy()
    drifted[1, :3, 3] += [0.05, 0.0, 0.0]
    values = []
    for poses in (EYES, drifted):
        points = sample.at(poses)
        values.append(mom_m2(sets, map_quality(points, 0.2)))
        assert values[-1] == pytest.approx(slow_mom(sets, points, 0.2), rel=1e-4)
    assert values[1] > 3 * values[0]


def test_mom_frames(rng):
    sample = sample_of(EYES, [corner(rng, 300, 0.003) for _ in EYES])
    assert [s.frame_idx for s in find_orthogonal_sets(sample, 0.2, 2)] == [0, 2]
