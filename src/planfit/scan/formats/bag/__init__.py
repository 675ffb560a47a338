"""ROS 1 and 2 bags and MCAP files, by the library rosbags (planfit[bag]).

Topics are named by the options, or guessed: colour and depth images (raw, compressed or compressedDepth),
the colour camera's CameraInfo, and poses from tf (the chain from the camera's frame up), else from
PoseStamped, Odometry, TransformStamped or the last Path. Times are those of the messages' headers. Depth
that is not registered to colour is, by the static tf between the two cameras. Refined poses are written as
`trajectory.tum`, world_from_cam: a bag is not rewritten.
"""

from planfit.scan.formats.bag.read import EXPECTS, read, recognise
from planfit.scan.formats.bag.read import BagSource as open_own
from planfit.scan.formats.bag.read import is_bag as claims

CHECKED = (
    "ROS 1, ROS 2 and MCAP files of evo's tests, without images; names of librealsense's "
    "recorder; compressed_depth_image_transport's codes",
    "tf of the real files; images of all codes by bags that rosbags writes",
)
"""Where the layout is known from, and what was checked with it."""

__all__ = ["CHECKED", "EXPECTS", "claims", "open_own", "read", "recognise"]
