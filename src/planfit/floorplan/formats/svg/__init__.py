"""SVG: lines, areas and texts of the picture as it is shown."""

from planfit.floorplan.formats.svg.read import read_svg as read_svg
