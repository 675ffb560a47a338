"""As built against as planned: a verdict on every wall and opening of a plan, from a finished result
(docs/as-built.md)."""

from planfit.as_built.compare import compare_as_built as compare_as_built
from planfit.as_built.compare import judge_walls as judge_walls
from planfit.as_built.openings import SURE_SIGMAS as SURE_SIGMAS
from planfit.as_built.openings import AsBuiltOpening as AsBuiltOpening
from planfit.as_built.openings import ClosedBy as ClosedBy
from planfit.as_built.openings import OpeningVerdict as OpeningVerdict
from planfit.as_built.openings import counted_openings as counted_openings
from planfit.as_built.openings import opening_title as opening_title
from planfit.as_built.openings import opening_words as opening_words
from planfit.as_built.record import AS_BUILT as AS_BUILT
from planfit.as_built.record import read_as_built as read_as_built
from planfit.as_built.record import write_as_built as write_as_built
from planfit.as_built.rooms import ClearWidth as ClearWidth
from planfit.as_built.rooms import RoomAsBuilt as RoomAsBuilt
from planfit.as_built.rooms import rooms_as_built as rooms_as_built
from planfit.as_built.types import AsBuilt as AsBuilt
from planfit.as_built.types import AsBuiltOptions as AsBuiltOptions
from planfit.as_built.types import AsBuiltWall as AsBuiltWall
from planfit.as_built.types import Deviation as Deviation
from planfit.as_built.types import Verdict as Verdict
from planfit.as_built.types import counted as counted
from planfit.as_built.types import deviations as deviations
from planfit.as_built.types import in_words as in_words
from planfit.as_built.types import title as title
