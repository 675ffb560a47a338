"""How good poses are: against true ones, against the plan, and by how sharp the map is that they make.

Each metric is defined in docs/metrics.md.
"""

from planfit.evaluation.evaluate import ComparedPoses as ComparedPoses
from planfit.evaluation.evaluate import EvaluateOptions as EvaluateOptions
from planfit.evaluation.evaluate import Evaluation as Evaluation
from planfit.evaluation.evaluate import evaluate as evaluate
from planfit.evaluation.layers import LayerOptions as LayerOptions
from planfit.evaluation.layers import Layers as Layers
from planfit.evaluation.layers import wall_layers as wall_layers
from planfit.evaluation.map_quality import MapQuality as MapQuality
from planfit.evaluation.map_quality import map_quality as map_quality
from planfit.evaluation.matches import match_distances as match_distances
from planfit.evaluation.matches import median_match_distance as median_match_distance
from planfit.evaluation.metrics import MapJudge as MapJudge
from planfit.evaluation.metrics import Metric as Metric
from planfit.evaluation.metrics import Truth as Truth
from planfit.evaluation.metrics import layer_metrics as layer_metrics
from planfit.evaluation.metrics import make_map_judge as make_map_judge
from planfit.evaluation.metrics import map_metrics as map_metrics
from planfit.evaluation.metrics import surface_metrics as surface_metrics
from planfit.evaluation.metrics import trajectory_metrics as trajectory_metrics
from planfit.evaluation.orthogonal import OrthogonalSets as OrthogonalSets
from planfit.evaluation.orthogonal import find_orthogonal_sets as find_orthogonal_sets
from planfit.evaluation.orthogonal import mom_m2 as mom_m2
from planfit.evaluation.paired import Paired as Paired
from planfit.evaluation.paired import compare_paired as compare_paired
from planfit.evaluation.sampling import MapOptions as MapOptions
from planfit.evaluation.sampling import MapSample as MapSample
from planfit.evaluation.sampling import sample_depth_maps as sample_depth_maps
from planfit.evaluation.surfaces import NEAR_FACE_M as NEAR_FACE_M
from planfit.evaluation.surfaces import FloorHeights as FloorHeights
from planfit.evaluation.surfaces import WallDistances as WallDistances
from planfit.evaluation.surfaces import floor_heights as floor_heights
from planfit.evaluation.surfaces import wall_distances as wall_distances
from planfit.evaluation.surfaces import wall_points as wall_points
from planfit.evaluation.trajectory import PositionErrors as PositionErrors
from planfit.evaluation.trajectory import RelativeErrors as RelativeErrors
from planfit.evaluation.trajectory import associate_times as associate_times
from planfit.evaluation.trajectory import position_errors as position_errors
from planfit.evaluation.trajectory import relative_errors as relative_errors
from planfit.evaluation.truth_cloud import NearestNeighbours as NearestNeighbours
from planfit.evaluation.truth_cloud import TrueCloud as TrueCloud
from planfit.evaluation.truth_cloud import make_true_cloud as make_true_cloud
from planfit.evaluation.truth_cloud import nearest_neighbours as nearest_neighbours
from planfit.evaluation.truth_cloud import read_true_cloud as read_true_cloud
