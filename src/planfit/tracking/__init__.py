"""How far the recorded poses can be believed: convention, clock, noise, breaks."""

from planfit.tracking.clock import ClockOffset as ClockOffset
from planfit.tracking.clock import TrackingOptions as TrackingOptions
from planfit.tracking.judge import believe as believe
from planfit.tracking.judge import judge_tracking as judge_tracking
from planfit.tracking.judge import require_asked_convention as require_asked_convention
from planfit.tracking.keyframes import KeyframeOptions as KeyframeOptions
from planfit.tracking.keyframes import choose_keyframes as choose_keyframes
from planfit.tracking.keyframes import frames_in_doubt as frames_in_doubt
from planfit.tracking.motions import measured_motions as measured_motions
from planfit.tracking.motions import surface_motions as surface_motions
from planfit.tracking.numbered import in_metres as in_metres
from planfit.tracking.submaps import pairs_across as pairs_across
from planfit.tracking.submaps import place_submaps as place_submaps
from planfit.tracking.submaps import with_open_steps as with_open_steps
from planfit.tracking.types import Tracking as Tracking
from planfit.tracking.types import TrackingBreak as TrackingBreak
from planfit.tracking.types import with_longer_steps as with_longer_steps
