"""How good poses are: against true ones, against the plan, and by how sharp the map is that they make.

Each figure is defined in docs/metrics.md.
"""

from planfit.evaluate.figures import EvaluateOptions as EvaluateOptions
from planfit.evaluate.figures import Figure as Figure
from planfit.evaluate.figures import MapJudge as MapJudge
from planfit.evaluate.figures import Truth as Truth
from planfit.evaluate.figures import make_map_judge as make_map_judge
from planfit.evaluate.figures import map_figures as map_figures
from planfit.evaluate.figures import surface_figures as surface_figures
from planfit.evaluate.figures import trajectory_figures as trajectory_figures
from planfit.evaluate.layers import LayerOptions as LayerOptions
from planfit.evaluate.layers import Layers as Layers
from planfit.evaluate.layers import wall_layers as wall_layers
from planfit.evaluate.map_quality import MapQuality as MapQuality
from planfit.evaluate.map_quality import map_quality as map_quality
from planfit.evaluate.orthogonal import OrthogonalSets as OrthogonalSets
from planfit.evaluate.orthogonal import find_orthogonal_sets as find_orthogonal_sets
from planfit.evaluate.orthogonal import mom_m2 as mom_m2
from planfit.evaluate.paired import Paired as Paired
from planfit.evaluate.paired import compare_paired as compare_paired
from planfit.evaluate.plan_distance import FloorFlatness as FloorFlatness
from planfit.evaluate.plan_distance import WallDistances as WallDistances
from planfit.evaluate.plan_distance import floor_flatness as floor_flatness
from planfit.evaluate.plan_distance import wall_distances as wall_distances
from planfit.evaluate.sampling import MapOptions as MapOptions
from planfit.evaluate.sampling import MapSample as MapSample
from planfit.evaluate.sampling import sample_depth_maps as sample_depth_maps
from planfit.evaluate.trajectory import PositionErrors as PositionErrors
from planfit.evaluate.trajectory import StepErrors as StepErrors
from planfit.evaluate.trajectory import associate_times as associate_times
from planfit.evaluate.trajectory import position_errors as position_errors
from planfit.evaluate.trajectory import step_errors as step_errors
from planfit.evaluate.truth_cloud import NearestNeighbours as NearestNeighbours
from planfit.evaluate.truth_cloud import TrueCloud as TrueCloud
from planfit.evaluate.truth_cloud import make_true_cloud as make_true_cloud
from planfit.evaluate.truth_cloud import nearest_neighbours as nearest_neighbours
from planfit.evaluate.truth_cloud import read_true_cloud as read_true_cloud
