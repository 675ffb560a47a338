"""Keypoint matches between frames, verified in 3D."""

from planfit.matching.by_hand import HandLoop as HandLoop
from planfit.matching.by_hand import HandMatches as HandMatches
from planfit.matching.by_hand import HandVerdicts as HandVerdicts
from planfit.matching.by_hand import PickedPoint as PickedPoint
from planfit.matching.by_hand import carried as carried
from planfit.matching.by_hand import match_by_hand as match_by_hand
from planfit.matching.by_hand import no_hand_matches as no_hand_matches
from planfit.matching.cycles import spanned_steps as spanned_steps
from planfit.matching.find import find_matches as find_matches
from planfit.matching.find import search_matches as search_matches
from planfit.matching.options import MatchingOptions as MatchingOptions
from planfit.matching.options import SurfaceOptions as SurfaceOptions
from planfit.matching.relative_motions import NeighbourMotions as NeighbourMotions
from planfit.matching.relative_motions import measure_between as measure_between
from planfit.matching.relative_motions import measure_more as measure_more
from planfit.matching.relative_motions import measure_neighbours as measure_neighbours
from planfit.matching.surfaces.find import SurfaceMotions as SurfaceMotions
from planfit.matching.surfaces.find import find_surface_pairs as find_surface_pairs
from planfit.matching.surfaces.find import (
    measure_surface_neighbours as measure_surface_neighbours,
)
from planfit.matching.surfaces.types import SurfacePairs as SurfacePairs
from planfit.matching.types import Matches as Matches
from planfit.matching.types import RelativePoses as RelativePoses
from planfit.matching.visits import group_visits as group_visits
from planfit.matching.visits import relative_poses_of as relative_poses_of
from planfit.matching.visits import without_misled as without_misled
