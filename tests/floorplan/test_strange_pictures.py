"""Pictures as offices, agents, scanners and phones make them, by a generator that shares nothing with the
readers. Parameters were chosen at seeds below 10; these are others."""

import numpy as np
import pytest
import shapely

from planfit.floorplan import PlanOptions, nearest_faces
from planfit.floorplan.raster import plan_of_picture
from planfit.geometry import segments
from strange_pictures import strange_picture


@pytest.mark.parametrize(("style", "seed", "px_per_m"), [
    ("solid, scanned", 11, 32), ("solid, JPEG", 12, 45), ("solid, blueprint", 13, 45),
    ("solid, sepia", 14, 45), ("dimensioned, scanned", 15, 45), ("coloured rooms", 16, 32),
    ("coloured walls", 17, 110), ("hatched", 18, 60), ("grey, outlined, dark screen", 19, 60),
    ("grey, outlined, dark screen", 52, 45),
    ("parquet", 20, 45), ("watermarked", 21, 45), ("gridded, JPEG", 22, 45), ("white walls", 23, 60),
    ("black and outlined, scanned", 31, 45), ("outlined and black", 32, 60), ("black and grey", 33, 45),
    ("grey and black", 31, 60), ("hatched and black, JPEG", 33, 60), ("hatched and outlined", 31, 45),
    ("black with cupboards", 34, 60), ("middle grey, JPEG", 11, 50), ("middle grey, JPEG", 12, 50),
])  # fmt: skip
def test_walls_are_read_whatever_the_office_draws_with(
    style: str, seed: int, px_per_m: float
) -> None:
    picture = strange_picture(style, seed, px_per_m)
    plan = plan_of_picture(picture.image, style, "", PlanOptions(), "picture")
    ends = np.ascontiguousarray(plan.ends * (1.0, -1.0))
    missed = nearest_faces.nearest_distance(picture.outline, ends)
    points, _ = segments.sample(ends, 1.0)
    found = shapely.STRtree(shapely.points(picture.outline)).query_nearest(
        shapely.points(points), return_distance=True, all_matches=False
    )[1]
    assert (missed < picture.near_px).mean() > 0.95
    assert (found < picture.near_px).mean() > 0.95
    assert plan.source.storeys == ()
