"""The command line: the only part of planfit that prints."""

from planfit.cli.main import main as main
from planfit.cli.main import run as run
