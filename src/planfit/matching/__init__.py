"""Keypoint matches between frames, verified in 3D."""

from planfit.matching.matches import Matches as Matches
from planfit.matching.matches import find_matches as find_matches
from planfit.matching.options import MatchingOptions as MatchingOptions
