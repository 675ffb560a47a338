"""Plans that are only read, beside what is right: published ones, and some that people have.

What is right comes from the drawings themselves, from marks on them (tests/floorplan/real_plan_marks.json,
real_drawing_walls.json), docs/real-plans.md and the EXPECT.txt beside each plan; never from what is read
today.
"""

from functools import partial

from faults.scans import SHARED

from buildings import plan_checks as checks
from buildings.plan_checks import Check
from buildings.reading_cases import ReadingCase, case_of
from buildings.rows import Reading
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan

NOTES = (
    "drawn as single lines",
    "plans on one sheet",
    "the sheet is turned",
    "curved walls were read as straight",
)
"""Of warnings that tell what was read, and say nothing against it; all others are doubts."""

ROOM_OUTER = (
    (183.4, 51.6, 1858.4, 51.6, 1858.4, 748.1, 183.4, 748.1, 183.4, 51.6),
    (233.0, 77.2, 1808.8, 77.2, 1808.8, 722.5, 233.0, 722.5, 233.0, 77.2),
)
"""Of the furnished flat: the two nested rectangles that are its outer wall, px."""
EMPTY_PATH = (
    (20, 20, 480, 20, 480, 380, 20, 380, 20, 20),
    (32, 32, 468, 32, 468, 368, 32, 368, 32, 32),
    (240, 32, 240, 368),
    (248, 32, 248, 368),
)
"""Walls of the least SVG with a path that draws nothing, px."""
MARGIN = 50
"""Of the page around the two layouts like the furnished flat, px."""


def plan_cases() -> tuple[ReadingCase, ...]:
    """All plans, published ones first."""
    return (
        *_pictures(),
        *_drawings(),
        *_models(),
        *_university_floor(),
        *_field_pictures(),
        *_field_drawings(),
        *_field_svg(),
        *_field_rooms(),
    )


def _pictures() -> tuple[ReadingCase, ...]:
    names = ("apartment_bw.png", "apartment_hebrew.png", "flat_grey_walls.png",
             "house_two_floors.jpg", "villa.png")  # fmt: skip
    return tuple(
        _published(
            f"raster/{name}",
            checks.marked_picture,
            partial(checks.plans_on_sheet, right=2 if name == "house_two_floors.jpg" else 1),
            is_short=name == "villa.png",
        )
        for name in names
    )


def _drawings() -> tuple[ReadingCase, ...]:
    furniture = partial(checks.layers_without, names=("furniture", "shelves", "couch"))
    room, two_rooms = "dxf/room_centimetres.dxf", "dxf/two_rooms_metres.dxf"
    return (
        _published(
            room,
            partial(checks.sides, right=(7.83, 5.5), tolerance=0.1, unit="m"),
            partial(checks.drawn_walls, file=f"floorplans/{room}"),
            furniture,
            is_short=True,
        ),
        _published(
            two_rooms,
            partial(checks.drawn_walls, file=f"floorplans/{two_rooms}"),
            partial(checks.plans_on_sheet, right=2),
            furniture,
            is_short=True,
        ),
        _published(
            "dxf/office_metres.dxf",
            partial(checks.sides, right=(34.0, 27.0), tolerance=0.5, unit="m"),
            furniture,
        ),
    )


def _models() -> tuple[ReadingCase, ...]:
    """Doors and windows as the storey that is read contains them."""
    house = "ifc/AC20-FZK-Haus.ifc"
    return (
        _published(
            house,
            partial(checks.sides, right=(12.0, 10.0), tolerance=0.05, unit="m"),
            partial(checks.drawn_walls, file=f"floorplans/{house}"),
            partial(checks.openings_of, kind="door", low=5, high=5),
            partial(checks.openings_of, kind="window", low=9, high=9),
        ),
        _published(
            "ifc/duplex.ifc",
            partial(checks.sides, right=(17.8, 8.8), tolerance=0.05, unit="m"),
            partial(checks.openings_of, kind="door", low=6, high=6),
            partial(checks.openings_of, kind="window", low=4, high=4),
            is_short=True,
        ),
        _published("ifc/no_walls.ifc", steps=("export the architect's model",), is_short=True),
    )


def _university_floor() -> tuple[ReadingCase, ...]:
    """Without truth of its walls: docs/real-plans.md tells its width and counts its swings of doors."""
    doors = partial(checks.openings_of, kind="door", low=62, high=72)
    along = partial(checks.along_axes, least=0.9)
    return (
        _published(
            "pdf/NSH2012_GIS-1.pdf",
            partial(checks.sides, right=(676.0,), tolerance=3.0, unit="points"),
            doors,
            along,
            partial(checks.right_of, least_x=150.0),
        ),
        _published(
            "svg/NSH2012_GIS-1.svg",
            partial(checks.sides, right=(845.0,), tolerance=4.0, unit="px"),
            doors,
            along,
            partial(checks.right_of, least_x=187.5),
        ),
        _published("pdf/NSH2012_GIS-A.pdf", along),
    )


def _field_pictures() -> tuple[ReadingCase, ...]:
    one = partial(checks.plans_on_sheet, right=1)
    picture = partial(checks.kind_begins, words="picture in a PDF")
    slide = "slide-with-overlay"
    return (
        _field("escape-plan-picture/escape_plan.png", checks.grey_bodies, one),
        _field("double-line-jpeg/plan.jpeg", checks.on_ink, one, is_short=True),
        _field(f"{slide}/floor_slide.pdf", picture, is_short=True),
        _field(f"{slide}/own_five_notes.pdf", picture, one, is_short=True),
        _field(f"{slide}/own_control_no_notes.pdf", picture, one),
    )


def _field_drawings() -> tuple[ReadingCase, ...]:
    ajar = "dxf-doors-ajar"
    club = partial(checks.sides, right=(23.82,), tolerance=0.1, unit="m")
    own = partial(checks.sides, right=(24.0, 7.0), tolerance=0.05, unit="m")
    return (
        # Sills outside of windows make it a little longer; frame, table and title block twice as long.
        _field(
            "archicad-sheet-pdf/sheet.pdf",
            partial(checks.sides, right=(14.64,), tolerance=0.6, unit="m"),
            partial(checks.length, low=300.0, high=380.0),
        ),
        _field(
            "cad-pdf-hatch-refused/house.pdf",
            partial(checks.proportion, right=50 / 30),
            partial(checks.gaps, low=10, high=40),
        ),
        _field(f"{ajar}/floorplan.dxf", club, checks.doors_ajar, is_short=True),
        _field(f"{ajar}/own_45deg.dxf", own, checks.doors_ajar, is_short=True),
        _field(f"{ajar}/own_90deg.dxf", own, checks.doors_ajar),
        _field(
            "layers-circulation/etage01.dxf",
            partial(checks.sides, right=(62.0, 54.25), tolerance=0.3, unit="m"),
            partial(checks.layers_without, names=("circulation", "fleche")),
            # Without the 261 m of these layers; walls themselves were read with recall 0.88 and more.
            partial(checks.length, low=4500.0, high=5800.0),
        ),
    )


def _field_svg() -> tuple[ReadingCase, ...]:
    flat = (
        partial(checks.gaps, low=5, high=10),
        # Its walls have some ten bits askew, its five arcs a dozen each and more.
        partial(checks.few_bits_askew, shortest=60.0, most=25),
    )
    base = partial(checks.layers_without, names=("furniture",))
    room = "furnished-room-svg"
    return (
        # 120 mm on paper at 1:100; dimension chains and eaves stand outside of it.
        _field(
            "bonsai-svg/house.svg",
            partial(checks.sides, right=(12.0, 8.0), tolerance=0.15, unit="m"),
            is_short=True,
        ),
        _field("bonsai-svg/minimal_empty_path.svg", _lines(EMPTY_PATH, 5.0, 0.95)),
        _field("doors-as-sectors/flat.svg", *flat),
        _field(
            "doors-as-sectors/flat.svg",
            *flat,
            base,
            options=PlanOptions(layers=("Base plan",)),
            of="layer Base plan",
        ),
        _field(
            f"{room}/room.svg",
            partial(checks.outer_walls, lines=ROOM_OUTER, least=0.6),
            is_short=True,
        ),
        _field(f"{room}/own_thick_walls.svg", _lines(_layout(46), checks.NEAR_ROOM, 0.8)),
        _field(f"{room}/own_control_thinner.svg", _lines(_layout(25), checks.NEAR_ROOM, 0.8)),
    )


def _field_rooms() -> tuple[ReadingCase, ...]:
    """A refusal that asks for a storey, or says how kinds are told to be rooms, is right."""
    folder = "geojson-floors"
    five, two = (partial(checks.plans_on_sheet, right=n) for n in (5, 2))
    # A fifth of the 2,054 m of faces of all five floors.
    one_floor = partial(checks.length, low=200.0, high=700.0)
    return (
        _field(
            f"{folder}/rooms_as_room.geojson", five, one_floor, steps=("--storey",), is_short=True
        ),
        _field(f"{folder}/rooms_german.geojson", five, one_floor, steps=("--storey", "--rooms")),
        _field(
            f"{folder}/rooms_german.geojson",
            partial(checks.thin_walls, most_m=1.0),
            options=PlanOptions(layers=("Lager", "WC")),
            steps=("--storey", "--rooms"),
            of="layers Lager and WC",
        ),
        _field(f"{folder}/two_storeys_floor.geojson", two, steps=("--storey",)),
        _field(f"{folder}/two_storeys_level_control.geojson", two, steps=("--storey",)),
        # Five of its six "doors" are 5 to 7.5 m wide; the outline has about 62 m.
        _field(
            "roomplan-wide-doors/Room.usdz",
            partial(checks.sides, right=(18.7, 18.7), tolerance=0.3, unit="m"),
            partial(checks.length, low=50.0, high=70.0),
            partial(checks.wide_doors, most_m=4.0),
            is_short=True,
        ),
    )


def _published(
    path: str, *looked_at: Check, steps: tuple[str, ...] = (), is_short: bool = False
) -> ReadingCase:
    path = f"floorplans/{path}"
    read = partial(read_plan, path, PlanOptions(), looked_at)
    return case_of("plan", "plans", path.rpartition("/")[2], path, read, steps, is_short)


def _field(
    path: str,
    *looked_at: Check,
    options: PlanOptions | None = None,
    steps: tuple[str, ...] = (),
    of: str = "",
    is_short: bool = False,
) -> ReadingCase:
    """`of` tells two readings of one file apart."""
    name = f"{path}, {of}" if of else path
    path = f"field/plans/{path}"
    read = partial(read_plan, path, options or PlanOptions(), looked_at)
    return case_of("plan", "field plans", name, path, read, steps, is_short)


def _layout(wall: int) -> tuple[tuple[float, ...], ...]:
    """Walls of the layouts like the furnished flat, whose outer walls are `wall` px thick."""
    right, bottom = 1675 - wall, 696 - wall
    lines = (
        (0, 0, 1675, 0, 1675, 696, 0, 696, 0, 0),
        (wall, wall, right, wall, right, bottom, wall, bottom, wall, wall),
        (wall, 490, 700, 490, 700, bottom),
        (wall, 500, 690, 500, 690, bottom),
    )
    return tuple(tuple(float(v + MARGIN) for v in line) for line in lines)


def _lines(lines: tuple[tuple[float, ...], ...], near: float, least_precision: float) -> Check:
    return partial(checks.lines_of_file, lines=lines, near=near, least_precision=least_precision)


def read_plan(path: str, options: PlanOptions, checks: tuple[Check, ...]) -> Reading:
    """Read a plan as `planfit plan` does, and look at what was found.

    Raises:
        FloorplanError: it is refused.
    """
    plan = read_floorplan(SHARED / path, options)
    facts = tuple(fact for check in checks for fact in check(plan))
    return Reading(facts, doubts=doubts_of(plan))


def doubts_of(plan: Floorplan) -> tuple[str, ...]:
    """What is said against the reading, without notes on what was read."""
    return tuple(w for w in plan.source.warnings if not any(note in w for note in NOTES))
