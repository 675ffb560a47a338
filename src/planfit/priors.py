"""What is known of buildings, devices and drawings before anything is measured, one home for each quantity.

Modules take their limits from here, or derive them from here, so that two of them cannot disagree on how
thick a wall may be. The end of a name is the unit. `source` says where a value comes from: a standard, a
measurement, or that it was chosen here, which is honest and waits for a measurement.

Thresholds of one method alone (scores, shares, numbers of pixels) stay beside that method.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Prior:
    """One value of a quantity."""

    value: float
    source: str
    """Standard, measurement or choice that the value comes from, and what it is used for."""


@dataclass(frozen=True)
class PriorRange:
    """The least and the greatest value of a quantity."""

    low: float
    high: float
    source: str
    """Standard, measurement or choice that both come from, and what they are used for."""

    @property
    def middle(self) -> float:
        """Half way between the two."""
        return 0.5 * (self.low + self.high)

    @property
    def both(self) -> tuple[float, float]:
        """The two, the least first."""
        return self.low, self.high


# Walls

WALL_FACES_APART_M = PriorRange(
    0.02,
    0.62,
    "How far apart the two faces of one wall may be drawn. The thinnest are panes and toilet partitions; "
    "the thickest masonry that is still common is two and a half bricks, 0.615 m by DIN 4172.",
)
WALL_LINES_APART_LEAST_M = Prior(
    0.03,
    "The same of two bare lines, of which nothing else tells that they are a wall: nearer ones are panes "
    "and frames of windows. Measured on the drawing of an office in metres: at 0.02 m, 15 more of its "
    "lines become faces.",
)
WALL_THIN_QUARTER_MOST_M = Prior(
    0.6,
    "At least a quarter of the walls of a building are thinner: bounds the scales tried of plans without "
    "unit. As wide as thickest walls, because some drawings have outer walls alone. Chosen here.",
)
WALL_THICKNESS_M = PriorRange(
    0.07,
    0.45,
    "Most walls of a building: from partitions of plasterboard (DIN 18183, 0.075 m and more) to outer "
    "walls of 0.365 m masonry (DIN 4172) with plaster and insulation. Chooses between units.",
)
PARTITION_THICKNESS_M = PriorRange(
    0.07,
    0.15,
    "Inner walls that carry nothing: stud walls of 0.075 to 0.125 m (DIN 18183), bricks of 0.115 m (DIN "
    "4172) and plaster on both sides.",
)
WALL_THICKNESS_SIGMA_M = Prior(
    0.08,
    "Standard deviation among the walls of one building, which are 0.10 to 0.25 m thick inside and 0.25 to "
    "0.40 m outside. Chosen here.",
)
COLUMN_SIDE_M = PriorRange(
    0.15,
    1.5,
    "Sides of columns: steel profiles of 0.15 m to piers of large halls. Chosen here.",
)
WALL_LENGTH_LEAST_M = Prior(
    0.5,
    "Shorter pieces are ends of walls and jambs of doors, which nothing is judged by. Chosen here.",
)
WALL_HEIGHT_M = Prior(
    2.5,
    "Clear height of usual rooms: building codes ask for 2.40 m (German model building code, paragraph "
    "47), 2.50 m is usual. Walls are shown so high where nothing tells.",
)

# Walls as built and as drawn

WALL_AS_DRAWN_M = Prior(
    0.07,
    "A wall less far from its line is built as drawn. DIN 18202 allows 0.016 m at lengths of 3 to 6 m and "
    "0.030 m beyond 30 m; the rest is for plaster, the pen and the depth camera.",
)
WALL_AS_BUILT_SIGMA_M = Prior(
    0.02,
    "Standard deviation of a wall about its line: DIN 18202 allows 0.016 m at lengths of 3 to 6 m and 0.030 "
    "m beyond 30 m, and plans leave plaster, skirting boards and doors in their recess out.",
)
WALL_MOVED_SHARE = Prior(
    0.1, "Walls that stand elsewhere than drawn, of plans that are wrong at all. Chosen here."
)
WALL_MOVED_MOST_M = Prior(
    0.7,
    "A wall further from its line is another wall: halves of corridors are wider. Chosen here.",
)
WALL_SPREAD_M = Prior(
    0.05,
    "What is seen of one wall lies within this: plaster, skirting boards and depth of some metres. Chosen "
    "here.",
)
WALL_BEFORE_ADJUSTMENT_SIGMA_M = Prior(
    0.15,
    "Standard deviation of scanned wall about its face while drift is left in the poses: a decimetre of "
    "drift, and centimetres between drawing and building. Chosen here.",
)
DRAWING_ROUNDING_M = Prior(
    0.01,
    "Ends and lines of a plan that are meant to be one: plans are dimensioned in centimetres or finer. "
    "Chosen here.",
)

# Directions of what is seen

PATCH_TURN_MOST_DEG = Prior(
    12.0,
    "Between a scanned piece of wall and its line: the normal of 0.5 m of wall with 0.03 m of noise is off "
    "by 5 degrees, drift adds some. Chosen here.",
)
SURFACE_TILT_MOST_DEG = Prior(
    15.0,
    "Between the normal of a floor and up, a wall and the horizontal, two patches of one wall: roof "
    "pitches begin at 15 degrees, and normals of depth are off by 5 to 10. Chosen here.",
)

# Doors and other openings

DOOR_LEAF_WIDTH_M = PriorRange(
    0.45,
    1.6,
    "Leaves that arcs are drawn of: DIN 18101 has 0.610 to 1.235 m; halves of double doors and cupboards "
    "are narrower, gates of halls wider.",
)
DOOR_LEAF_USUAL_WIDTH_M = Prior(0.85, "The commonest leaf of DIN 18101 is 0.860 m wide.")
DOOR_OPENING_M = PriorRange(
    0.6,
    1.4,
    "Gaps in walls that are doors: leaves of DIN 18101 (0.610 to 1.235 m) and what is left of a double "
    "door.",
)
DOOR_WIDTH_MOST_M = Prior(
    2.5,
    "Two leaves of the widest of DIN 18101 (1.235 m): what is called a door and wider is a front of glass or "
    "a movable partition, which stands like a wall.",
)
DOOR_PASSED_LEAST_M = Prior(
    0.5,
    "Clear way of the narrowest door, as cameras look through it: a leaf of 0.610 m (DIN 18101) less its "
    "frame, handle and the leaf itself.",
)
DOOR_GAP_M = Prior(
    1.01,
    "Widest gap that a usual door leaves between two pieces of one wall: openings of 0.885 and 1.010 m "
    "(DIN 18100).",
)
DOOR_LEAF_THICKNESS_M = PriorRange(
    0.04,
    0.045,
    "Leaves of inner doors are about 0.04 m thick (DIN 68706-1); fire doors a little more.",
)
DOOR_CLEAR_HEIGHTS_M = PriorRange(
    0.3,
    1.9,
    "Over the floor: what stands in a door is seen between thresholds and the lintel at 1.985 m (DIN "
    "18101), less the errors of poses.",
)

# Storeys and stairs

STOREY_HEIGHT_M = PriorRange(
    2.0,
    10.0,
    "Floor to floor. No room is lower than 2.0 m; halls of 10 m are the highest of scans walked by hand. "
    "Chosen here.",
)
FLOOR_LEVEL_MOST_M = Prior(
    20.0,
    "A floor higher than this over the plan's zero is given in heights above the sea. Chosen here.",
)
STAIR_RISER_MOST_M = Prior(
    0.2,
    "Risers of stairs are 0.14 to 0.20 m (DIN 18065); floors less far apart are one, uneven or drifted.",
)
FLOOR_PIECE_SIGMA_M = Prior(
    0.5,
    "Heights of split levels, platforms and pits about the main floor of a storey. Chosen here.",
)
FLOOR_SLOPE_SIGMA_SHARE = Prior(
    0.05, "Ramps and floors that fall: 6 % for wheelchairs (DIN 18040), up to 15 % in car parks."
)
FLOOR_SLOPE_MOST_SHARE = Prior(0.2, "Steeper than any ramp that is walked. Chosen here.")
FLOOR_NOT_LEVEL_SHARE = Prior(
    0.05, "Storeys that have a second piece of floor, and pieces that slope: few do. Chosen here."
)
WALL_LEAN_SIGMA_DEG = Prior(
    0.3,
    "Lean of all walls of a scan together, and slope of its floors: what the camera's depth and the frame's "
    "tilt share. Level buildings: 0.18 degrees on ConSLAM, 0.05 to 0.12 rendered, 0.47 in 7-Scenes' kitchen.",
)
WORKTOP_HEIGHT_M = Prior(
    1.2,
    "Level surfaces up to here are furniture: bars and counters of 1.10 to 1.15 m. Chosen here.",
)
CUPBOARD_HEIGHT_M = Prior(
    2.15, "Wardrobes and kitchens end at 2.0 to 2.1 m, wall goes on above. Chosen here."
)
SLAB_THICKNESS_M = PriorRange(
    0.2,
    0.3,
    "Ceilings of synthetic buildings: 0.2 m of concrete, 0.3 m with screed and plaster. Chosen here.",
)
STAIR_WIDTH_M = Prior(
    1.1,
    "Flights of synthetic buildings: DIN 18065 asks for 1.0 m and more in houses of several flats.",
)

# Buildings

BUILDING_SIZE_M = PriorRange(
    1.5,
    2000.0,
    "A building is larger than a cupboard and smaller than a town; outside, the unit is another one. The "
    "longest airport terminals are 1.7 km.",
)
BUILDING_LIKELY_SIZE_M = PriorRange(
    3.0, 400.0, "From a room to a large hospital. Chooses between units. Chosen here."
)
ROOM_SIDE_M = PriorRange(
    1.8, 6.0, "Sides of usual rooms: numbers of feet are 3.3 times as many. Chosen here."
)
BUILDING_USUAL_SIZE_M = Prior(
    30.0, "A house of flats or a floor of offices; for tolerances alone. Chosen here."
)

# Devices and how they are carried

DEPTH_REACH_M = Prior(
    8.0,
    "By their data sheets depth cameras of phones reach 5 m, Azure Kinect 5.5 m, RealSense D435 10 m; what "
    "is further is mostly noise.",
)
VIEW_DISTANCE_M = Prior(
    3.0,
    "What a camera in a room looks at is about so far away: rooms are 3 to 5 m wide. Turns lengths into "
    "angles. Chosen here.",
)
VIEW_DISTANCE_SIGMA_SHARE = Prior(
    0.6,
    "Of the natural logarithm of the same, as the median depth of a scan: desks at 1 m and halls at 9 m lie "
    "within two of these. Chosen here.",
)
DEPTH_EDGE_SHARE = Prior(
    0.04,
    "Depth that changes by more of itself between neighbouring pixels is that of two surfaces: one seen at "
    "75 degrees from its normal changes by 0.7 % a pixel at a focal length of 525 px. Chosen here.",
)
FRAME_RATE_HZ = Prior(
    30.0,
    "Video of phones and depth cameras, by their data sheets; of scans without times. Chosen here.",
)
STEP_AT_VIDEO_RATE_M = Prior(
    0.5,
    "No step between two frames is as long: people walk at 1.34 m/s (Weidmann 1993), 0.05 m a frame at 30 "
    "Hz and 0.27 m at 5 Hz.",
)
CLOCK_RATE_SHARE = Prior(
    0.005,
    "Share by which two clocks run apart: quartzes by 1e-4 (data sheets), frames that are taken at 29.97 a "
    "second and counted at 30 by 1e-3. Chosen here.",
)
DRIFT_SHARE = Prior(
    0.15,
    "No tracker loses as much of a path: published ones lose 0.5 to 2 % (KITTI odometry benchmark). What "
    "says so is in error.",
)
TRACKER_TILT_SIGMA_DEG = Prior(
    1.0,
    "Of a tracker that measures gravity, as those of phones and headsets do: accelerometers hold it within "
    "a degree while they are carried. Chosen here.",
)
SURVEYED_POINT_SIGMA_M = Prior(
    0.01,
    "What a total station with a prism held by hand or a good GNSS fix gives, of points whose file tells "
    "none. Chosen here.",
)
MOUNT_ARM_SIGMA_M = Prior(
    1.0,
    "Each axis of the arm from the origin of the body whose poses are recorded to the camera: a few "
    "centimetres in phones and headsets, up to a mast's height over the base of a robot. Chosen here.",
)
CAMERA_HEIGHT_M = Prior(
    1.3,
    "Over the floor, of a camera that scans a room: 1.2 to 1.6 m in the hand of who stands, 0.3 to 1 m on a "
    "robot, 1.7 m on a head or a tripod. Chosen here.",
)
CAMERA_HEIGHT_SIGMA_SHARE = Prior(
    0.4,
    "Of the natural logarithm of the same: robots' 0.5 m and backpacks' 2.1 m lie within 2.4 of these. "
    "Chosen here.",
)
ROOM_HEIGHT_SIGMA_SHARE = Prior(
    0.15,
    "Of the natural logarithm of the clear height of rooms, about WALL_HEIGHT_M: cellars of 2.1 m and old "
    "flats of 3.4 m lie within two of these. Chosen here.",
)
OTHER_HEIGHT_SHARE = Prior(
    0.2,
    "How often what nine frames show between floor and ceiling is no clear height of a usual room: halls and "
    "shells are higher, tables under shelves lower. Chosen here.",
)
STRANGE_SIZE_SHARE = Prior(
    0.02,
    "How often a size that depth shows is not that of a room, but any: drones in halls, things on a table. "
    "Chosen here.",
)
OTHER_UNIT_SHARE = Prior(
    0.1,
    "How often, beforehand, depth whose unit nothing states is in another than its format's usual one; poses "
    "have a unit of their own as often. Chosen here.",
)
EYE_HEIGHT_M = Prior(
    1.6, "Eyes of people who stand: 1.53 m of women, 1.63 m of men in the median (DIN 33402-2)."
)

# Drawings and files

COORDINATE_MOST_M = Prior(
    1e9,
    "No national grid reaches this far, in metres or in any smaller unit: such numbers are faults of a file. "
    "Chosen here.",
)

PAPER_WIDTH_MOST_M = Prior(
    1.6,
    "Rolls of plotters are up to 1.52 m (60 in) wide: a wider page is as large as the building.",
)

# Errors

SURE_SIGMAS = Prior(
    3.0,
    "The three-sigma rule: of normal errors 0.27 % lie beyond (Pukelsheim 1994), so that what departs by "
    "more is taken for a fact.",
)
SAME_MOTION_SIGMAS = Prior(
    6.0,
    "Two motions, as the norm of six numbers in sigmas: chi-square with six degrees of freedom leaves 3e-6 "
    "beyond. As wide because errors of matches are not independent.",
)
CLEAR_ODDS = Prior(
    100.0,
    "Of two explanations one is taken, and the other left, where it is so many times as likely: 'decisive' "
    "(Jeffreys 1961).",
)
