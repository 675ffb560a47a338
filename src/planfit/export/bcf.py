"""Walls that are not as planned as issues of the BIM Collaboration Format 2.1.

A zip of folders, one a topic: `markup.bcf` says what is wrong, `viewpoint.bcfv` from where to look at it and
which elements of the model it is. Elements stand in the order of the schemas (markup.xsd and visinfo.xsd of
buildingSMART/BCF-XML, release 2.1), as readers expect.
"""

import uuid
import zipfile
from datetime import UTC, datetime
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from planfit.as_built import AsBuilt, Deviation, Verdict, deviations, in_words, title
from planfit.whole_files import whole_file

AUTHOR = "planfit"
FIELD_OF_VIEW_DEG = 60.0
"""Most that 2.1 allows."""
EYE_M, NEAREST_M, WALL_M = 1.6, 2.0, 2.5
"""Height of the viewpoint over the floor, least distance from the wall, and height of walls in lines."""
_NAMES = uuid.UUID("2a8e5c1e-7a53-4c0c-9d58-0b4c2f6f8a11")
"""Names of topics are made in this space, so that the same wall of the same plan keeps its own."""
IFC_ID_LENGTH = 22


def write_bcf(
    path: Path, as_built: AsBuilt, tolerance_m: float | None = None, now: datetime | None = None
) -> None:
    """A topic for each wall that was moved, is missing, or is new; m, z from the floor of the plan.

    Args:
        path: `.bcf` or `.bcfzip`.
        as_built: verdicts.
        tolerance_m: another than that of its options.
        now: when the topics were made, if not now.

    Raises:
        OutputError: the file cannot be written.
    """
    made = (now or datetime.now(UTC)).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        version = Element("Version", VersionId="2.1")
        SubElement(version, "DetailedVersion").text = "2.1"
        archive.writestr("bcf.version", _xml(version))
        for index, deviation in enumerate(deviations(as_built, tolerance_m)):
            topic = _guid(as_built, deviation, "topic")
            viewpoint = _guid(as_built, deviation, "viewpoint")
            markup = _markup(as_built, deviation, index, topic, viewpoint, made)
            archive.writestr(f"{topic}/markup.bcf", _xml(markup))
            view = _view(as_built, deviation, viewpoint)
            archive.writestr(f"{topic}/viewpoint.bcfv", _xml(view))


def _markup(
    as_built: AsBuilt, deviation: Deviation, index: int, topic: str, viewpoint: str, made: str
) -> Element:
    wall, verdict = deviation.walls[0], deviation.verdict
    markup = Element("Markup")
    if as_built.plan_name:
        file = SubElement(SubElement(markup, "Header"), "File", isExternal="true")
        SubElement(file, "Filename").text = Path(as_built.plan_name).name
    element = SubElement(markup, "Topic", Guid=topic, TopicType="Issue", TopicStatus="Open")
    SubElement(element, "Title").text = title(wall, verdict)
    SubElement(element, "Index").text = str(index)
    SubElement(element, "Labels").text = f"as built: {verdict.value}"
    SubElement(element, "CreationDate").text = made
    SubElement(element, "CreationAuthor").text = AUTHOR
    SubElement(element, "Description").text = _description(deviation)
    points = SubElement(markup, "Viewpoints", Guid=viewpoint)
    SubElement(points, "Viewpoint").text = "viewpoint.bcfv"
    return markup


def _description(deviation: Deviation) -> str:
    """A line a face."""
    lines = [
        f"({w.ends[0, 0]:.2f}, {w.ends[0, 1]:.2f})-({w.ends[1, 0]:.2f}, {w.ends[1, 1]:.2f}): "
        f"{in_words(w, deviation.verdict)}"
        for w in deviation.walls
    ]
    return "\n".join(["Metres, in the plan's axes.", *lines])


def _view(as_built: AsBuilt, deviation: Deviation, viewpoint: str) -> Element:
    """Looking at the wall from its free side, at eye level, its elements selected, its place as lines."""
    view = Element("VisualizationInfo", Guid=viewpoint)
    components = SubElement(view, "Components")
    ids = [one for one in deviation.element_ids if len(one) == IFC_ID_LENGTH]
    if ids:
        selection = SubElement(components, "Selection")
        for one in ids:
            SubElement(selection, "Component", IfcGuid=one)
    SubElement(components, "Visibility", DefaultVisibility="true")
    wall, floor_m = deviation.walls[0], as_built.elevation_m
    back_m = max(NEAREST_M, 0.5 * wall.length_m / np.tan(np.deg2rad(FIELD_OF_VIEW_DEG / 2)))
    eye = wall.ends.mean(axis=0) + back_m * wall.normal
    camera = SubElement(view, "PerspectiveCamera")
    _point(camera, "CameraViewPoint", eye[0], eye[1], floor_m + EYE_M)
    _point(camera, "CameraDirection", -wall.normal[0], -wall.normal[1], 0.0)
    _point(camera, "CameraUpVector", 0.0, 0.0, 1.0)
    SubElement(camera, "FieldOfView").text = f"{FIELD_OF_VIEW_DEG:g}"
    lines = SubElement(view, "Lines")
    for one in deviation.walls:
        stands = one.built_ends if deviation.verdict is Verdict.MOVED else one.ends
        for height in (floor_m, floor_m + WALL_M):
            line = SubElement(lines, "Line")
            _point(line, "StartPoint", stands[0, 0], stands[0, 1], height)
            _point(line, "EndPoint", stands[1, 0], stands[1, 1], height)
    return view


def _point(parent: Element, name: str, x: float, y: float, z: float) -> None:
    point = SubElement(parent, name)
    for axis, value in zip("XYZ", (x, y, z), strict=True):
        SubElement(point, axis).text = f"{float(value):.6f}"


def _guid(as_built: AsBuilt, deviation: Deviation, what: str) -> str:
    places = ";".join(f"{value:.3f}" for wall in deviation.walls for value in wall.ends.ravel())
    return str(uuid.uuid5(_NAMES, f"{what} {Path(as_built.plan_name).name} {places}"))


def _xml(root: Element) -> bytes:
    indent(root)
    return tostring(root, encoding="utf-8", xml_declaration=True)
