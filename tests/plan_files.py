"""One synthetic building, written as DXF, SVG, PDF, IFC, GeoJSON and a mesh by the tests alone."""

import json

import ezdxf
import numpy as np
import shapely

from planfit.synth import BuildingOptions, make_building
from planfit.synth.building import Part


def make_plan(seed=3, **options):
    """(solid wall as seen at a door's height, building) of a synthetic building, m, building frame."""
    building = make_building(BuildingOptions(**options), np.random.default_rng(seed))
    faces = building.faces
    low = faces.ends[faces.parts != Part.LINTEL]
    cells = shapely.get_parts(shapely.polygonize(list(shapely.get_parts(shapely.node(
        shapely.multilinestrings(shapely.linestrings(np.round(low, 9)))
    )))))  # fmt: skip
    along = low[:, 1] - low[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    behind = shapely.points(low.mean(axis=1) - 1e-4 * np.stack([-along[:, 1], along[:, 0]], axis=1))
    tree = shapely.STRtree(behind)
    solid = [cell for cell in cells if len(tree.query(cell, predicate="contains"))]
    return shapely.union_all(solid), building


def rings_of(area):
    return [
        np.asarray(ring.coords)
        for part in shapely.get_parts(area)
        for ring in (part.exterior, *part.interiors)
    ]


def write_dxf(path, area, metres_per_unit=1.0, insunits=6, layer="A-WALL", hatch=False, extra=None):
    document = ezdxf.new()
    document.header["$INSUNITS"] = insunits
    document.layers.add(layer)
    space = document.modelspace()
    for part in shapely.get_parts(area):
        rings = [r / metres_per_unit for r in rings_of(part)]
        if hatch:
            fill = space.add_hatch(dxfattribs={"layer": layer})
            for ring in rings:
                fill.paths.add_polyline_path(ring[:, :2], is_closed=True)
        else:
            for ring in rings:
                space.add_lwpolyline(ring[:-1], close=True, dxfattribs={"layer": layer})
    if extra:
        extra(document)
    document.saveas(path)
    return path


def _path_data(rings, scale, offset):
    return " ".join(
        "M " + " L ".join(f"{x * scale + offset:.6f},{-y * scale + offset:.6f}" for x, y in ring[:-1])
        + " Z" for ring in rings
    )  # fmt: skip


def write_svg(
    path, area, units_per_metre=20.0, fill="none", stroke="black", extra="", group="", root=""
):
    body = "".join(
        f'<path d="{_path_data(rings_of(p), units_per_metre, 100)}" fill="{fill}" '
        f'fill-rule="evenodd" stroke="{stroke}"/>'
        for p in shapely.get_parts(area)
    )
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" {root}>'
        f"<g {group}>{body}</g>{extra}</svg>"
    )
    return path


def write_pdf(path, area, points_per_metre=20.0, fill=None, rotate=0, extra=""):
    """A PDF with one page, by hand: a stream of path operators."""
    commands = ["0.5 w"]
    for part in shapely.get_parts(area):
        for ring in rings_of(part):
            points = [
                f"{x * points_per_metre + 100:.5f} {y * points_per_metre + 100:.5f}"
                for x, y in ring
            ]
            commands += [f"{points[0]} m", *(f"{p} l" for p in points[1:-1]), "h"]
        commands.append("S" if fill is None else f"{fill} rg f*")
    return write_pdf_stream(path, "\n".join([*commands, extra]), rotate)


def write_pdf_stream(path, stream, rotate=0, extra_objects=(), resources="", catalog=""):
    objects = [
        f"<< /Type /Catalog /Pages 2 0 R {catalog} >>",
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 1200 900] /Rotate {rotate} "
        f"/Resources << /Font << /F1 5 0 R >> {resources} >> /Contents 4 0 R >>",
        f"<< /Length {len(stream)} >>\nstream\n{stream}\nendstream",
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        *extra_objects,
    ]
    data, offsets = "%PDF-1.4\n", []
    for i, body in enumerate(objects):
        offsets.append(len(data))
        data += f"{i + 1} 0 obj\n{body}\nendobj\n"
    start = len(data)
    data += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n"
    data += "".join(f"{o:010d} 00000 n \n" for o in offsets)
    data += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n"
    path.write_bytes(data.encode("latin-1"))
    return path


def write_ifc(path, area, unit_prefix=None, height_m=2.6, storeys=(("Ground", 0.0),)):
    """Walls as upright prisms over the parts of the area, on each storey."""
    import ifcopenshell
    import ifcopenshell.guid

    scale = {None: 1.0, "MILLI": 1000.0}[unit_prefix]
    model = ifcopenshell.file(schema="IFC4")
    make = model.create_entity
    point = lambda *c: make("IfcCartesianPoint", tuple(float(v) * scale for v in c))  # noqa: E731
    unit = make("IfcSIUnit", None, "LENGTHUNIT", unit_prefix, "METRE")
    origin = make("IfcAxis2Placement3D", point(0, 0, 0))
    context = make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, origin)
    new = ifcopenshell.guid.new
    project = make("IfcProject", new(), RepresentationContexts=[context],
                   UnitsInContext=make("IfcUnitAssignment", [unit]))  # fmt: skip
    building = make("IfcBuilding", new(), Name="House", CompositionType="ELEMENT")
    make("IfcRelAggregates", new(), RelatingObject=project, RelatedObjects=[building])
    levels = []
    for name, elevation in storeys:
        at = make("IfcLocalPlacement", None, make("IfcAxis2Placement3D", point(0, 0, elevation)))
        storey = make("IfcBuildingStorey", new(), Name=name, ObjectPlacement=at,
                      CompositionType="ELEMENT", Elevation=elevation * scale)  # fmt: skip
        levels.append(storey)
        walls = []
        for part in shapely.get_parts(area):
            curves = [make("IfcPolyline", [point(*xy) for xy in ring]) for ring in rings_of(part)]
            kind = (
                "IfcArbitraryProfileDefWithVoids" if curves[1:] else "IfcArbitraryClosedProfileDef"
            )
            profile = make(kind, "AREA", None, curves[0], *([curves[1:]] if curves[1:] else []))
            solid = make("IfcExtrudedAreaSolid", profile, origin,
                         make("IfcDirection", (0.0, 0.0, 1.0)), height_m * scale)  # fmt: skip
            shape = make("IfcShapeRepresentation", context, "Body", "SweptSolid", [solid])
            walls.append(make(
                "IfcWall", new(), Name="wall",
                ObjectPlacement=make("IfcLocalPlacement", at, origin),
                Representation=make("IfcProductDefinitionShape", None, None, [shape]),
            ))  # fmt: skip
        make("IfcRelContainedInSpatialStructure", new(), RelatedElements=walls,
             RelatingStructure=storey)  # fmt: skip
    make("IfcRelAggregates", new(), RelatingObject=building, RelatedObjects=levels)
    model.write(str(path))
    return path


def write_geojson(path, area, kind="wall", longitude=11.57, latitude=48.14):
    """Degrees by the radii of the WGS84 ellipsoid at the building."""
    e2, a, phi = 0.00669437999014, 6378137.0, np.deg2rad(latitude)
    w = np.sqrt(1 - e2 * np.sin(phi) ** 2)
    scale = np.rad2deg([w / (a * np.cos(phi)), w**3 / (a * (1 - e2))])
    features = [
        {"type": "Feature", "properties": {"category": kind},
         "geometry": {"type": "Polygon", "coordinates": [
             (ring * scale + (longitude, latitude)).tolist() for ring in rings_of(part)]}}
        for part in shapely.get_parts(area)
    ]  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def write_png(path, area, pixels_per_metre=50.0, lines=(), arcs=()):
    """Walls solid black, each pixel as dark as the share of it that is wall, and thin line work in m. A point
    (x, y) m lies at the pixel coordinates of `pixels_of`."""
    import cv2

    sub = 8  # drawn this many times larger, then averaged
    low, high = np.array(area.bounds).reshape(2, 2)
    width, height = np.ceil((high - low) * pixels_per_metre).astype(int) + 2 * PNG_MARGIN_PX
    canvas = np.full((height * sub, width * sub), 255, np.uint8)

    def drawn(xy):
        # Pixel centres are integers, so that the edge of the first pixel is at -0.5.
        uv = (pixels_of(xy, area, pixels_per_metre) + 0.5) * sub - 0.5
        return np.round(uv * 16).astype(np.int32)

    for part in shapely.get_parts(area):
        cv2.fillPoly(canvas, [drawn(ring) for ring in rings_of(part)], 0, cv2.LINE_AA, 4)
    turned = [
        centre + radius * np.stack([np.cos(t), np.sin(t)], axis=1)
        for centre, radius, start, end in arcs
        for t in [np.deg2rad(np.linspace(start, end, 40))]
    ]
    for points in [*lines, *turned]:
        cv2.polylines(canvas, [drawn(points)], False, 0, int(1.5 * sub), cv2.LINE_AA, 4)
    image = cv2.resize(canvas, (int(width), int(height)), interpolation=cv2.INTER_AREA)
    assert cv2.imwrite(str(path), image)
    return path


PNG_MARGIN_PX = 40


def pixels_of(xy, area, pixels_per_metre=50.0):
    """Pixel coordinates (n, 2), v down, of points (n, 2) m in the picture of `write_png`."""
    west, _, _, north = area.bounds
    return (np.asarray(xy) - (west, north)) * (1, -1) * pixels_per_metre + PNG_MARGIN_PX


VILLA_WINDOWS = [
    ((0, 0), (14, 0), 1.5, 3.0, 0.4), ((0, 0), (14, 0), 6.5, 8.0, 0.4),
    ((0, 0), (14, 0), 11.0, 13.0, 0.4), ((14, 0), (17, 4), 1.2, 3.2, 0.4),
    ((15, 11), (6, 12.5), 1.0, 2.6, 0.4), ((15, 11), (6, 12.5), 6.0, 7.4, 0.4),
    ((6, 12.5), (0, 9), 3.0, 4.6, 0.4), ((0, 9), (0, 0), 1.5, 3.0, 0.4),
]  # fmt: skip
"""Outer line of a wall that runs counter-clockwise, from and to along it, thickness, m."""
VILLA_DOORS = [
    ((5, 0), (5, 12.5), 1.2, 2.1, 0.25), ((5, 6), (16.5, 4.5), 2.0, 2.9, 0.25),
    ((5, 6), (16.5, 4.5), 7.5, 8.4, 0.25), ((0, 4.5), (5, 4.5), 1.9, 2.7, 0.1),
    ((10, 5.3), (10.8, 12.2), 3.0, 3.9, 0.1), ((9.5, 0), (9.5, 5.4), 3.0, 3.8, 0.1),
]  # fmt: skip
"""Middle line of a wall, from and to along it, thickness, m."""


def make_villa():
    """A building unlike `make_plan`'s, m: slanted and bevelled walls, 0.4 m outside, 0.25 and 0.1 m
    within, a column, doors, a passage and windows."""
    outside = shapely.Polygon([(0, 0), (14, 0), (17, 4), (15, 11), (6, 12.5), (0, 9)])
    solid = [outside.difference(outside.buffer(-0.4, join_style="mitre"))]

    def wall(start, end, thickness):
        line = shapely.LineString([start, end])
        return line.buffer(thickness / 2, cap_style="flat").intersection(outside)

    solid += [
        wall((5, 0), (5, 12.5), 0.25),
        wall((5, 6), (16.5, 4.5), 0.25),
        wall((0, 4.5), (5, 4.5), 0.1),
        wall((10, 5.3), (10.8, 12.2), 0.1),
        wall((9.5, 0), (9.5, 5.4), 0.1),
        shapely.box(7.0, 8.2, 7.5, 8.7),
    ]
    passage = ((5, 0), (5, 12.5), 8.0, 9.6, 0.25)
    gaps = [
        shapely.LineString(_along(*opening[:4])).buffer(0.45, cap_style="flat")
        for opening in (*VILLA_WINDOWS, *VILLA_DOORS, passage)
    ]
    return shapely.union_all(solid).difference(shapely.union_all(gaps))


def _along(start, end, low, high):
    """Two points (2, 2) on a line."""
    start, end = np.array(start, float), np.array(end, float)
    along = (end - start) / np.linalg.norm(end - start)
    return np.array([start + low * along, start + high * along])


def window_lines(style, windows=VILLA_WINDOWS):
    """Line work (k, 2, 2) of windows: "pane" one line in the middle, "panes" two 6 cm apart, "sills" one
    or two and the faces of the wall drawn through; all with the jambs."""
    lines = []
    for start, end, low, high, thickness in windows:
        line = _along(start, end, low, high)
        along = (line[1] - line[0]) / (high - low)
        inwards = np.array([-along[1], along[0]])
        depths = {"pane": [0.5], "panes": [0.425, 0.575], "sills": [0.0, 0.425, 0.575, 1.0]}[style]
        lines += [line + depth * thickness * inwards for depth in depths]
        lines += [np.array([p, p + thickness * inwards]) for p in line]
    return np.array(lines)


def door_lines(style, doors=VILLA_DOORS):
    """Leaves (k, 2, 2) of open doors, as a "line" or a "box" of 4 cm, and their quarter circles, a list of
    centre, radius, and angles (deg) from and to."""
    lines, arcs = [], []
    for start, end, low, high, thickness in doors:
        hinge, latch = _along(start, end, low, high)
        width = high - low
        along = (latch - hinge) / width
        left = np.array([-along[1], along[0]])
        hinge = hinge + 0.5 * thickness * left
        leaf = np.array([hinge, hinge + width * left])
        lines.append(leaf)
        if style == "box":
            other = leaf + 0.04 * along
            lines += [other, np.array([leaf[0], other[0]]), np.array([leaf[1], other[1]])]
        angle = np.rad2deg(np.arctan2(along[1], along[0]))
        arcs.append((hinge, width, angle, angle + 90.0))
    return np.array(lines), arcs
