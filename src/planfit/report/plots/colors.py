"""Colours of all pictures, as #rrggbb."""

# Okabe and Ito's palette, which colour-blind readers can tell apart.
BEFORE, AFTER = "#d55e00", "#0072b2"
AGREES, MOVED, UNMATCHED, NOT_SEEN = "#009e73", "#aa3377", "#e69f00", "#b8c0c9"
INK, GREY, LIGHT, PAPER = "#1f2933", "#6b7785", "#d5dae0", "#ffffff"
PATH = "#7b3fa0"
PATHS = (PATH, "#009e73", "#b8860b", "#cc3399", "#56b4e9", "#8c510a")
"""Of several scans, one after the other."""
