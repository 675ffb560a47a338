"""One reader a format: each lists frames, poses and lenses as a `Recording`, and decodes no pixel."""

READERS = {
    "facap": "facap",
    "stray": "stray",
    "record3d": "record3d",
    "scanner-app": "scanner_app",
    "polycam": "polycam",
    "tum": "tum",
    "bundlefusion": "bundlefusion",
    "7-scenes": "seven_scenes",
    "scannet": "scannet",
    "arkit-scenes": "arkit_scenes",
    "scannetpp": "scannetpp",
    "replica": "replica",
    "redwood": "redwood",
    "nerfstudio": "nerfstudio",
    "colmap": "colmap",
    "rtabmap": "rtabmap",
    "sens": "sens",
    "las": "las",
    "e57": "e57",
    "bag": "bag",
}
"""Module of this package that reads each format, in the order in which they are tried. Each has `EXPECTS`
(what the format is told by, in words), `CHECKED` (where the layout is known from, and what was checked with
it), `recognise(source)` and `read(source, options)`, which gives a `Recording`, and `PARTS` where several
files (or folders, with a slash; one of several, `a|b`) make the format. They are imported when they are asked
for, and import the libraries of their own (video, bags) only when they read."""

OWN_FILES = ("las", "e57", "bag", "rtabmap", "sens")
"""Formats that a library of their own opens: their modules have `claims(path)`, whether a path is one, and
`open_own(path)`, the source that they recognise and read."""
