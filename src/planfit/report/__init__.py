"""What a run did, to look at: the overlay picture and the report, one self-contained HTML file."""

from planfit.report.comparison_words import conclusion as conclusion
from planfit.report.html.comparison_page import Compared as Compared
from planfit.report.html.comparison_page import make_comparison as make_comparison
from planfit.report.html.page import make_report as make_report
from planfit.report.key_metrics import TruthErrors as TruthErrors
from planfit.report.options import ReportOptions as ReportOptions
from planfit.report.plots.alignment import draw_alignment as draw_alignment
from planfit.report.plots.overlay import draw_overlay as draw_overlay
from planfit.report.plots.overlay import draw_overlays as draw_overlays
from planfit.report.plots.overlay import plot_result as plot_result
from planfit.report.plots.plan_picture import draw_plan_picture as draw_plan_picture
from planfit.report.plots.scan_view import draw_scan_view as draw_scan_view
from planfit.report.provenance import Provenance as Provenance
from planfit.report.provenance import provenance_now as provenance_now
from planfit.report.scene.make import make_scene as make_scene
from planfit.report.scene.pictures import make_pictures as make_pictures
from planfit.report.scene.scene import Scene as Scene
