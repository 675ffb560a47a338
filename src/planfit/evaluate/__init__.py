"""How good poses are: against true ones, against the plan, and by how sharp the map is that they make.

Each metric is defined in docs/metrics.md.
"""

from planfit.evaluate.evaluation import ComparedPoses as ComparedPoses
from planfit.evaluate.evaluation import EvaluateOptions as EvaluateOptions
from planfit.evaluate.evaluation import Evaluation as Evaluation
from planfit.evaluate.evaluation import evaluate_poses as evaluate_poses
from planfit.evaluate.layers import LayerOptions as LayerOptions
from planfit.evaluate.layers import Layers as Layers
from planfit.evaluate.layers import wall_layers as wall_layers
from planfit.evaluate.map_quality import MapQuality as MapQuality
from planfit.evaluate.map_quality import map_quality as map_quality
from planfit.evaluate.matches import match_distances as match_distances
from planfit.evaluate.matches import median_match_distance as median_match_distance
from planfit.evaluate.metrics import MapJudge as MapJudge
from planfit.evaluate.metrics import Metric as Metric
from planfit.evaluate.metrics import Truth as Truth
from planfit.evaluate.metrics import layer_metrics as layer_metrics
from planfit.evaluate.metrics import make_map_judge as make_map_judge
from planfit.evaluate.metrics import map_metrics as map_metrics
from planfit.evaluate.metrics import surface_metrics as surface_metrics
from planfit.evaluate.metrics import trajectory_metrics as trajectory_metrics
from planfit.evaluate.orthogonal import OrthogonalSets as OrthogonalSets
from planfit.evaluate.orthogonal import find_orthogonal_sets as find_orthogonal_sets
from planfit.evaluate.orthogonal import mom_m2 as mom_m2
from planfit.evaluate.paired import Paired as Paired
from planfit.evaluate.paired import compare_paired as compare_paired
from planfit.evaluate.sampling import MapOptions as MapOptions
from planfit.evaluate.sampling import MapSample as MapSample
from planfit.evaluate.sampling import sample_depth_maps as sample_depth_maps
from planfit.evaluate.surfaces import NEAR_FACE_M as NEAR_FACE_M
from planfit.evaluate.surfaces import FloorHeights as FloorHeights
from planfit.evaluate.surfaces import WallDistances as WallDistances
from planfit.evaluate.surfaces import floor_heights as floor_heights
from planfit.evaluate.surfaces import wall_distances as wall_distances
from planfit.evaluate.surfaces import wall_points as wall_points
from planfit.evaluate.trajectory import PositionErrors as PositionErrors
from planfit.evaluate.trajectory import RelativeErrors as RelativeErrors
from planfit.evaluate.trajectory import associate_times as associate_times
from planfit.evaluate.trajectory import position_errors as position_errors
from planfit.evaluate.trajectory import relative_errors as relative_errors
from planfit.evaluate.truth_cloud import NearestNeighbours as NearestNeighbours
from planfit.evaluate.truth_cloud import TrueCloud as TrueCloud
from planfit.evaluate.truth_cloud import make_true_cloud as make_true_cloud
from planfit.evaluate.truth_cloud import nearest_neighbours as nearest_neighbours
from planfit.evaluate.truth_cloud import read_true_cloud as read_true_cloud
