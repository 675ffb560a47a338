"""Marks lifted by depth, and tags found in images that were drawn with them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import NoFiles, look
from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.runtime import Runtime
from planfit.survey import Mark, Survey, SurveyPoint, find_marks
from planfit.survey.marks import FAMILIES, detect, find_tags
from surveyed import scan_at

CAMERA = Camera(320, 240, 260.0, 255.0, 158.0, 121.0)


class WallFiles(NoFiles):
    """A wall at x = 3 m with tags on it, drawn by homographies of its plane: sharp, exact."""

    def __init__(self, poses, tags, side_m, family="apriltag-36h11", holes=()):
        self._poses, self._tags, self._side_m, self._holes = poses, tags, side_m, holes
        self._dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])

    def color(self, frame_idx):
        image = np.full((CAMERA.height, CAMERA.width), 200, np.uint8)
        cam_from_wall = se3.inverse(self._poses[frame_idx])
        for number, middle in self._tags.items():
            tag = cv2.aruco.generateImageMarker(self._dictionary, number, 200)
            half = 0.5 * self._side_m
            y, z = middle
            # Top left first, as the tag is drawn; seen from inside, the wall's left is its larger y.
            sides = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
            corners = np.column_stack([np.full(4, 3.0), sides + np.array([y, z])])
            uv = CAMERA.project(se3.transform(cam_from_wall, corners)).astype(np.float32)
            drawn = np.array(
                [[-0.5, -0.5], [199.5, -0.5], [199.5, 199.5], [-0.5, 199.5]], np.float32
            )
            warp = cv2.getPerspectiveTransform(drawn, uv)
            size = (CAMERA.width, CAMERA.height)
            inside = cv2.warpPerspective(np.full_like(tag, 255), warp, size)
            image = np.where(inside > 127, cv2.warpPerspective(tag, warp, size), image)
        return np.repeat(image[..., None], 3, axis=2)

    def depth(self, frame_idx):
        rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
        rays = CAMERA.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
        pose = self._poses[frame_idx]
        depth = (3 - pose[0, 3]) / (rays @ pose[0, :3])
        depth = np.where(depth > 0, depth, np.nan).reshape(CAMERA.height, CAMERA.width)
        for row, column in self._holes:
            depth[row, column] = np.nan
        return depth.astype(np.float32)


POSES = np.stack(
    [look([0, 0, 1.5], 5, 4), look([0.6, 0.8, 1.4], -25, 0), look([-0.5, -0.5, 1.6], 15, 8)]
)
TAGS = {3: (0.3, 1.6), 17: (-0.6, 1.3)}
SIGMA = 0.02


def wall_scan(**files):
    options = {"tags": TAGS, "side_m": 0.3} | files
    return replace(scan_at(POSES), cameras=(CAMERA,) * 3, files=WallFiles(POSES, **options))


def alike(depth):
    """Of every depth alike."""
    return SIGMA * np.ones_like(depth)


def survey_of_tags(**options):
    points = tuple(SurveyPoint(str(n), np.array([3.0, *at])) for n, at in TAGS.items())
    return Survey(points, **options)


@pytest.mark.parametrize("family", ["apriltag-36h11", "aruco-4x4-50", "aruco-original"])
def test_middles_of_tags_are_found_where_they_are(family):
    scan = wall_scan(family=family)
    found = find_tags(scan, family, None, np.arange(3), Runtime(1))
    assert len(found) >= 5
    for tag in found:
        at = se3.transform(POSES[tag.frame_idx], tag.middle_cam[None])[0]
        assert_allclose(at, [3.0, *TAGS[int(tag.id)]], atol=0.006)
        assert tag.sigma_m == 0.0


def test_without_depth_the_size_tells_the_distance():
    everywhere = [(slice(None), slice(None))]
    scan = wall_scan(holes=everywhere)
    assert find_tags(scan, "apriltag-36h11", None, np.arange(3), Runtime(1)) == []
    found = find_tags(scan, "apriltag-36h11", 0.3, np.arange(3), Runtime(1))
    assert len(found) >= 5
    for tag in found:
        at = se3.transform(POSES[tag.frame_idx], tag.middle_cam[None])[0]
        assert np.linalg.norm(at - [3.0, *TAGS[int(tag.id)]]) < 3 * tag.sigma_m < 0.3
    # A size that is a third too large puts tags a third too far.
    far = find_tags(scan, "apriltag-36h11", 0.4, np.arange(3), Runtime(1))
    for near, tag in zip(found, far, strict=True):
        assert_allclose(tag.middle_cam, near.middle_cam * 4 / 3, rtol=1e-6)


def test_only_tags_of_the_survey_count_and_frames_are_numbered_by_the_scan():
    one = Survey((SurveyPoint("17", np.array([3.0, -0.6, 1.3])),), tags="apriltag-36h11")
    marks = find_marks(wall_scan(), one, np.array([0, 2]), alike)
    assert set(marks.frame_idx) == {0, 2}
    assert set(marks.point_idx) == {0}
    assert_allclose(marks.sigma_m, SIGMA)


def test_an_id_that_is_seen_twice_in_an_image_is_none():
    image = wall_scan().files.color(0)
    twice = np.concatenate([image, image], axis=1)
    assert sorted(detect(image, "apriltag-36h11")[0]) == [3, 17]
    assert len(detect(twice, "apriltag-36h11")[0]) == 0


def test_marks_are_lifted_by_the_depth_about_them():
    """A pixel without depth among others with it, and noise of single pixels, do no harm."""
    holes = [(110, 150)]
    point = np.array([[3.0, 0.1, 1.5]])
    u, v = CAMERA.project(se3.transform(se3.inverse(POSES[0]), point))[0]
    survey = Survey(
        (SurveyPoint("A", point[0]),),
        (Mark(0, "A", (u, v)), Mark(1, "A"), Mark(0, "A", (150, 110))),
    )
    marks = find_marks(wall_scan(holes=holes), survey, np.arange(3), alike)
    assert_allclose(se3.transform(POSES[0], marks.points_cam[:1]), point, atol=0.01)
    assert_allclose(marks.points_cam[1], 0.0)
    assert marks.sigma_m[1] == 0.0
    assert np.isfinite(marks.points_cam[2]).all()


@pytest.mark.parametrize(
    ("mark", "words"),
    [
        (Mark(0, "A", (400, 20)), "expected a pixel within 320 x 240, found (400, 20)"),
        (Mark(0, "A", (20, -3)), "found (20, -3)"),
        (
            Mark(0, "A", (100, 100)),
            "expected a pixel with depth, found none at (100, 100) nor within 3 px",
        ),
    ],
)
def test_marks_that_cannot_be_lifted_are_named(mark, words):
    scan = wall_scan(holes=[(slice(95, 106), slice(95, 106))])
    survey = Survey((SurveyPoint("A", np.zeros(3)),), (mark,))
    with pytest.raises(OptionError) as found:
        find_marks(scan, survey, np.arange(3), alike)
    assert words in str(found.value)
    assert "mark of 'A': frame 0" in str(found.value)


def test_a_mark_of_no_point_and_a_family_that_is_none():
    with pytest.raises(OptionError, match="found 'B' in frame 2, which is none of A"):
        Survey((SurveyPoint("A", np.zeros(3)),), (Mark(2, "B", (1, 1)),))
    with pytest.raises(OptionError, match=r"found 'apriltag36h11'; did you mean 'apriltag-36h11'"):
        find_tags(wall_scan(), "apriltag36h11", None, np.arange(1), Runtime(1))
    blind = replace(wall_scan(), has_color=False)
    with pytest.raises(OptionError, match="expected colour images to look for tags in"):
        find_tags(blind, "apriltag-36h11", None, np.arange(1), Runtime(1))
