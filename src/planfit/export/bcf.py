"""Walls and openings that are not as planned as issues of the BIM Collaboration Format 2.1.

A zip of folders, one a topic: `markup.bcf` says what is wrong, `viewpoint.bcfv` from where to look at it and
which elements of the model it is. Elements stand in the order of the schemas (markup.xsd and visinfo.xsd of
buildingSMART/BCF-XML, release 2.1), as readers expect.
"""

import uuid
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from jaxtyping import Float

from planfit.as_built import (
    AsBuilt,
    Verdict,
    deviations,
    in_words,
    opening_title,
    opening_words,
    title,
)
from planfit.priors import EYE_HEIGHT_M, WALL_HEIGHT_M
from planfit.runtime import whole_file

AUTHOR = "planfit"
FIELD_OF_VIEW_DEG = 60.0
"""Most that 2.1 allows."""
NEAREST_M = 2.0
"""Least distance of the viewpoint from the wall."""
_NAMES = uuid.UUID("2a8e5c1e-7a53-4c0c-9d58-0b4c2f6f8a11")
"""Names of topics are made in this space, so that the same wall of the same plan keeps its own."""
IFC_ID_LENGTH = 22
"""128 bits, six a character (IfcGloballyUniqueId)."""


def write_bcf(
    path: Path, as_built: AsBuilt, tolerance_m: float | None = None, now: datetime | None = None
) -> None:
    """A topic for each wall that was moved, is missing, or is new, and each opening that is closed or new; m,
    z from the floor of the plan.

    Raises:
        OutputError: the file cannot be written.
    """
    made = (now or datetime.now(UTC)).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        version = Element("Version", VersionId="2.1")
        SubElement(version, "DetailedVersion").text = "2.1"
        archive.writestr("bcf.version", _xml(version))
        for index, issue in enumerate(_issues(as_built, tolerance_m)):
            topic = _guid(as_built, issue, "topic")
            viewpoint = _guid(as_built, issue, "viewpoint")
            markup = _markup(as_built, issue, index, topic, viewpoint, made)
            archive.writestr(f"{topic}/markup.bcf", _xml(markup))
            view = _view(as_built, issue, viewpoint)
            archive.writestr(f"{topic}/viewpoint.bcfv", _xml(view))


@dataclass(frozen=True)
class _Issue:
    """What a topic tells of; plan frame, m."""

    title: str
    label: str
    description: tuple[str, ...]
    """A line a face."""
    element_ids: tuple[str, ...]
    ends: Float[np.ndarray, "2 2"]
    """That the viewpoint looks at."""
    normal: Float[np.ndarray, "2"]
    """Towards the viewpoint."""
    lines: tuple[Float[np.ndarray, "2 2"], ...]
    """Where it stands."""
    places: tuple[Float[np.ndarray, "2 2"], ...]
    """Where it is drawn: names its topic."""


def _issues(as_built: AsBuilt, tolerance_m: float | None) -> Iterator[_Issue]:
    """Walls that are not as planned, the longest first, then openings."""
    for deviation in deviations(as_built, tolerance_m):
        walls, verdict = deviation.walls, deviation.verdict
        yield _Issue(
            title(walls[0], verdict),
            f"as built: {verdict.value}",
            tuple(_described(wall.ends, in_words(wall, verdict)) for wall in walls),
            deviation.element_ids,
            walls[0].ends,
            walls[0].normal,
            tuple(w.built_ends if verdict is Verdict.MOVED else w.ends for w in walls),
            tuple(wall.ends for wall in walls),
        )
    for opening in as_built.openings:
        if opening.differs:
            yield _Issue(
                opening_title(opening),
                f"as built: opening {opening.verdict.value}",
                (_described(opening.ends, opening_words(opening)),),
                (opening.element_id,),
                opening.ends,
                opening.normal,
                (opening.built_ends,),
                (opening.ends,),
            )


def _described(ends: Float[np.ndarray, "2 2"], words: str) -> str:
    return f"({ends[0, 0]:.2f}, {ends[0, 1]:.2f})-({ends[1, 0]:.2f}, {ends[1, 1]:.2f}): {words}"


def _markup(
    as_built: AsBuilt, issue: _Issue, index: int, topic: str, viewpoint: str, made: str
) -> Element:
    markup = Element("Markup")
    if as_built.plan_name:
        file = SubElement(SubElement(markup, "Header"), "File", isExternal="true")
        SubElement(file, "Filename").text = Path(as_built.plan_name).name
    element = SubElement(markup, "Topic", Guid=topic, TopicType="Issue", TopicStatus="Open")
    SubElement(element, "Title").text = issue.title
    SubElement(element, "Index").text = str(index)
    SubElement(element, "Labels").text = issue.label
    SubElement(element, "CreationDate").text = made
    SubElement(element, "CreationAuthor").text = AUTHOR
    lines = ("Metres, in the plan's axes.", *issue.description)
    SubElement(element, "Description").text = "\n".join(lines)
    points = SubElement(markup, "Viewpoints", Guid=viewpoint)
    SubElement(points, "Viewpoint").text = "viewpoint.bcfv"
    return markup


def _view(as_built: AsBuilt, issue: _Issue, viewpoint: str) -> Element:
    """Looking at it from its free side, at eye level, its elements selected, its place as lines."""
    view = Element("VisualizationInfo", Guid=viewpoint)
    components = SubElement(view, "Components")
    ids = [one for one in issue.element_ids if len(one) == IFC_ID_LENGTH]
    if ids:
        selection = SubElement(components, "Selection")
        for one in ids:
            SubElement(selection, "Component", IfcGuid=one)
    SubElement(components, "Visibility", DefaultVisibility="true")
    floor_m, length_m = as_built.elevation_m, float(np.linalg.norm(issue.ends[1] - issue.ends[0]))
    back_m = max(NEAREST_M, 0.5 * length_m / np.tan(np.deg2rad(FIELD_OF_VIEW_DEG / 2)))
    eye = issue.ends.mean(axis=0) + back_m * issue.normal
    camera = SubElement(view, "PerspectiveCamera")
    _point(camera, "CameraViewPoint", eye[0], eye[1], floor_m + EYE_HEIGHT_M.value)
    _point(camera, "CameraDirection", -issue.normal[0], -issue.normal[1], 0.0)
    _point(camera, "CameraUpVector", 0.0, 0.0, 1.0)
    SubElement(camera, "FieldOfView").text = f"{FIELD_OF_VIEW_DEG:g}"
    lines = SubElement(view, "Lines")
    for stands in issue.lines:
        for height in (floor_m, floor_m + WALL_HEIGHT_M.value):
            line = SubElement(lines, "Line")
            _point(line, "StartPoint", stands[0, 0], stands[0, 1], height)
            _point(line, "EndPoint", stands[1, 0], stands[1, 1], height)
    return view


def _point(parent: Element, name: str, x: float, y: float, z: float) -> None:
    point = SubElement(parent, name)
    for axis, value in zip("XYZ", (x, y, z), strict=True):
        SubElement(point, axis).text = f"{float(value):.6f}"


def _guid(as_built: AsBuilt, issue: _Issue, what: str) -> str:
    places = ";".join(f"{value:.3f}" for ends in issue.places for value in ends.ravel())
    return str(uuid.uuid5(_NAMES, f"{what} {Path(as_built.plan_name).name} {places}"))


def _xml(root: Element) -> bytes:
    indent(root)
    return tostring(root, encoding="utf-8", xml_declaration=True)
