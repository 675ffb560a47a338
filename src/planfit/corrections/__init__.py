"""Corrections by hand: what a person saw at a glance and no program can know, in a file of its own."""

from planfit.corrections.file import read_corrections as read_corrections
from planfit.corrections.file import to_toml as to_toml
from planfit.corrections.file import write_corrections as write_corrections
from planfit.corrections.types import NO_CORRECTIONS as NO_CORRECTIONS
from planfit.corrections.types import AddedLoop as AddedLoop
from planfit.corrections.types import Contradiction as Contradiction
from planfit.corrections.types import Correction as Correction
from planfit.corrections.types import Corrections as Corrections
from planfit.corrections.types import DeletedLoop as DeletedLoop
from planfit.corrections.types import ExcludedFrames as ExcludedFrames
from planfit.corrections.types import Place as Place
from planfit.corrections.types import WallByHand as WallByHand
