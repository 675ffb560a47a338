"""ScanNet's container, one file a scan: also what BundleFusion and its apps record into.

    SCAN.sens   little endian. Version 4 (uint32), the sensor's name (uint64 length, bytes), then 4x4 float32
                by row: intrinsics and extrinsics of colour, of depth; codes of colour and depth (int32),
                their sizes (4 uint32), stored units a metre (float32), number of frames (uint64)
                a frame: world_from_cam (4x4 float32, OpenCV axes, all minus infinity where tracking was
                lost), times of colour and depth (uint64 us), lengths of both images (uint64), and the
                images: colour as JPEG, PNG or RGB, depth as 16 bit, by row, packed with zlib or as it is

A file that ends early is read up to its last whole frame. Depth in the code of the Structure sensor's maker
(2) is refused: only his library unpacks it. Refined poses are written as SensReader writes those of a file,
one N.txt a frame.
"""

from planfit.scan.formats.sens.container import SensSource as open_own
from planfit.scan.formats.sens.container import claims
from planfit.scan.formats.sens.read import EXPECTS, read, recognise

CHECKED = (
    "sensorData.h and SensorData.py (github.com/ScanNet/ScanNet). No real file",
    "every field and code but the sensor maker's, by files that the test writes as sensorData.h does",
)
"""Where the layout is known from, and what was checked with it."""

__all__ = ["CHECKED", "EXPECTS", "claims", "open_own", "read", "recognise"]
