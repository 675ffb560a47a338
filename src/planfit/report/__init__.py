"""What a run did, to look at: the overlay picture and the report, one self-contained HTML file."""

from planfit.report.key_figures import TruthErrors as TruthErrors
from planfit.report.overlay import draw_overlay as draw_overlay
from planfit.report.page import make_report as make_report
from planfit.report.placement import draw_place as draw_place
from planfit.report.scan_view import draw_scan_view as draw_scan_view
