"""RTAB-Map's database: RGB-D nodes of a map, from its apps, from ROS, or from `rtabmap-reprocess`.

    MAP.db     sqlite. Node: id, map_id, stamp (s), pose (3x4 float32, by row: odom_from_base)
               Data: image (JPEG or PNG), depth (PNG of 16-bit millimetres, PNG of float32 metres in four
               channels, DEPTHRVL, DEPTHINV), calibration (size, K, P, base_from_camera with OpenCV axes)
               Admin: opt_ids, opt_poses (zlib): poses after loops were closed

Optimised poses are taken where the database has them; nodes between them, which are not optimised, follow
the last optimised one as odometry says. Without, odometry is taken, of the session with most nodes: sessions
that no loop joins have a world each. As in RTAB-Map, images are taken as rectified, and as P shows them where
there is one. Of several cameras the first is read; stereo is refused, for it has no depth. Whether the world
is level is not told. Refined poses are written as the optimised ones of a copy, in which clouds, meshes and
grids of the old poses are dropped.
"""

from planfit.scan.formats.rtabmap.read import EXPECTS, read, recognise
from planfit.scan.formats.rtabmap.source import DatabaseSource as open_own
from planfit.scan.formats.rtabmap.source import is_database as claims

CHECKED = (
    "RTAB-Map's CameraModel.cpp, Compression.cpp and schema "
    "(github.com/introlab/rtabmap); a real database of 411 nodes, without images",
    "pose and calibration blobs, every code of depth, times, tables; its images were put "
    "in by the test",
)
"""Where the layout is known from, and what was checked with it."""

__all__ = ["CHECKED", "EXPECTS", "claims", "open_own", "read", "recognise"]
