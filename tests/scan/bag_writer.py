"""Bags of a sample: ROS 1, ROS 2, MCAP; poses in tf or on a topic."""

import numpy as np

from scan_samples import HEIGHT, WIDTH, k_of, png, quaternion

TF_KINDS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
COLOR_FRAME, BODY_FRAME = "camera_color_optical_frame", "base_link"
# The camera's axes as a robot carries it: forward is x, left is y, up is z.
BODY_FROM_CAM = np.array([[0, 0, 1, 0.2], [-1, 0, 0, 0.05], [0, -1, 0, 0.4], [0, 0, 0, 1.0]])


class BagWriter:
    """Messages by name, for either ROS."""

    def __init__(self, path, ros, storage=None):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        if ros == 1:  # not among the library's own
            for name in TF_KINDS:
                text = "geometry_msgs/TransformStamped[] transforms"
                self.store.register(get_types_from_msg(text, name))
        if ros == 1:
            from rosbags.rosbag1 import Writer

            self.writer = Writer(path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer(path, version=9, storage_plugin=plugin)
        self.connections = {}
        self.seq = 0

    def make(self, name, *values):
        return self.store.types[name](*values)

    def header(self, time, frame):
        stamp = self.make("builtin_interfaces/msg/Time", *divmod(round(time * 1e9), 10**9))
        self.seq += 1
        return self.make(
            "std_msgs/msg/Header", *([self.seq] if self.ros == 1 else []), stamp, frame
        )

    def write(self, topic, kind, time, message):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        encode = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        # Logged a little after it was made, all within the same instant of each other.
        self.writer.write(
            self.connections[topic], round((time + 0.01) * 1e9), encode(message, kind)
        )

    def image(self, topic, time, frame, array, encoding, padding=0):
        rows = (
            array.reshape(HEIGHT, -1).view(np.uint8)
            if array.ndim == 2
            else array.reshape(HEIGHT, -1)
        )
        rows = np.pad(rows, ((0, 0), (0, padding)))
        self.write(topic, "sensor_msgs/msg/Image", time, self.make(
            "sensor_msgs/msg/Image", self.header(time, frame), HEIGHT, WIDTH, encoding, 0, rows.shape[1],
            rows.ravel()))  # fmt: skip

    def compressed(self, topic, time, frame, data, form):
        self.write(topic, "sensor_msgs/msg/CompressedImage", time, self.make(
            "sensor_msgs/msg/CompressedImage", self.header(time, frame), form,
            np.frombuffer(data, dtype=np.uint8)))  # fmt: skip

    def info(self, topic, time, frame, camera, distortion=()):
        k = k_of(camera)
        p = np.zeros((3, 4))
        p[:, :3] = k
        roi = self.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        self.write(topic, "sensor_msgs/msg/CameraInfo", time, self.make(
            "sensor_msgs/msg/CameraInfo", self.header(time, frame), HEIGHT, WIDTH, "plumb_bob",
            np.array(distortion or [0.0] * 5), k.ravel(), np.eye(3).ravel(), p.ravel(), 0, 0,
            roi))  # fmt: skip

    def transform(self, pose):
        vector = self.make("geometry_msgs/msg/Vector3", *pose[:3, 3])
        rotation = self.make("geometry_msgs/msg/Quaternion", *quaternion(pose))
        return self.make("geometry_msgs/msg/Transform", vector, rotation)

    def tf(self, topic, time, parent, child, pose, kind=TF_KINDS[0]):
        item = self.make("geometry_msgs/msg/TransformStamped", self.header(time, parent), child,
                         self.transform(pose))  # fmt: skip
        self.write(topic, kind, time, self.make(kind, [item]))

    def pose(self, pose):
        point = self.make("geometry_msgs/msg/Point", *pose[:3, 3])
        rotation = self.make("geometry_msgs/msg/Quaternion", *quaternion(pose))
        return self.make("geometry_msgs/msg/Pose", point, rotation)

    def odometry(self, topic, time, frame, child, pose):
        zero = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        twist = self.make("geometry_msgs/msg/Twist", zero, zero)
        cov = np.zeros(36)
        self.write(topic, "nav_msgs/msg/Odometry", time, self.make(
            "nav_msgs/msg/Odometry", self.header(time, frame), child,
            self.make("geometry_msgs/msg/PoseWithCovariance", self.pose(pose), cov),
            self.make("geometry_msgs/msg/TwistWithCovariance", twist, cov)))  # fmt: skip

    def pose_stamped(self, topic, time, frame, pose):
        self.write(topic, "geometry_msgs/msg/PoseStamped", time, self.make(
            "geometry_msgs/msg/PoseStamped", self.header(time, frame), self.pose(pose)))  # fmt: skip


def compressed_png(depth_mm):
    return bytes(12) + png(depth_mm), "16UC1; compressedDepth png"


def write_images(bag, s, compressed=False, compressed_depth=compressed_png):
    for i, time in enumerate(s.times):
        if compressed:
            bag.compressed("/camera/color/image_raw/compressed", time, COLOR_FRAME, png(s.color[i]),
                           "rgb8; png compressed bgr8")  # fmt: skip
            bag.compressed("/camera/aligned_depth_to_color/image_raw/compressedDepth", time + 0.002,
                           COLOR_FRAME, *compressed_depth(s.depth_mm[i]))  # fmt: skip
        else:
            bgr = np.ascontiguousarray(s.color[i][..., ::-1])
            bag.image("/camera/color/image_raw", time, COLOR_FRAME, bgr, "bgr8", padding=8)
            bag.image("/camera/aligned_depth_to_color/image_raw", time + 0.002, COLOR_FRAME,
                      s.depth_mm[i], "16UC1")  # fmt: skip
        bag.info("/camera/color/camera_info", time, COLOR_FRAME, s.camera)


def write_tf(bag, s):
    """map <- odom <- base_link (moving) <- camera_link <- optical frame, as a RealSense on a robot has it."""
    origin = np.eye(4)
    origin[:3, 3] = (1.0, -2.0, 0.5)
    bag.tf("/tf_static", s.times[0], BODY_FRAME, COLOR_FRAME, BODY_FROM_CAM)
    for i, time in enumerate(s.times):
        odom_from_body = np.linalg.inv(origin) @ s.poses[i] @ np.linalg.inv(BODY_FROM_CAM)
        bag.tf("/tf", time, "map", "odom", origin)
        bag.tf("/tf", time, "odom", BODY_FRAME, odom_from_body)
