"""A finished run at the screen: the report's page, served on this machine alone, with corrections by hand."""

from planfit.viewer.server import ViewServer as ViewServer
from planfit.viewer.session import FILE as FILE
from planfit.viewer.session import Session as Session
from planfit.viewer.session import Solve as Solve
