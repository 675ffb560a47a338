"""What the names of layers say, in the languages that drawings are mostly made in, and what became of each
layer: what was left out, with its length, and the words for it."""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

import numpy as np

from planfit.errors import FloorplanError
from planfit.findings.finding import MAX_NAMED
from planfit.floorplan.plausible import COMPARE
from planfit.floorplan.vector.drawing import VectorDrawing
from planfit.floorplan.vector.line_work import Candidates, WallFaces
from planfit.geometry import segments

# Words, folded: in lower case and without accents; ä, ö, ü also as ae, oe, ue, which is left to the reader of
# these lists. Beams are overhead, and drawn like walls, as two lines across a room. What is no wall wins over
# an opening, and that over a wall: "wall text" holds text.
_WALL = """
    wall walls partition partitions prtn structure structural shearwall firewall drywall facade
    column columns cols colm pier piers pillar pillars brickwork masonry blockwork concrete
    mur murs cloison cloisons voile voiles refend refends poteau poteaux maconnerie gros-oeuvre beton doublage
    wand wande waende mauer mauern mauerwerk stutze stutzen stuetze stuetzen pfeiler saule saulen saeule
    saeulen fassade trockenbau rohbau tragwerk tragend nichttragend nichttragende tragende
    parede paredes alvenaria pilar pilares muro muros pared tabique tabiques tabiqueria cerramiento
    cerramientos muratura murature muri parete pareti tramezzo tramezzi tramezzature tamponamento
    tamponamenti pilastro pilastri setto setti colonna colonne fachada fachadas facciata columna columnas
    muur muren wanden scheidingswand kolom kolommen gevel gevels metselwerk
    vagg vaggar vegg vegger vaeg vaegge seina seinat sciana sciany stena steny zid zidovi perete pereti duvar
    duvarlar pelare pilier piliers słup słupy sloup sloupy kolon kolona
    стена стены перегородка перегородки колонна колонны 壁 柱 墙 墙体 벽 기둥
    קיר קירות עמוד עמודים מחיצה מחיצות
"""
_WALL_ENDS = """
    wand wande waende mauer mauern mauerwerk stutze stutzen stuetze stuetzen pfeiler
    saule saulen saeule saeulen muur muren wanden kolom kolommen vagg vaggar
    vegg vegger wall walls fassade gevel
"""
"""Of compounds: Innenwände, Stahlbetonstützen, buitenmuren, innervägg, firewalls."""
_OPENING = """
    door doors window windows wind wndw wdw glaz glazing opening openings porte portes fenetre fenetres baie
    baies tur turen tuer tueren tuere fenster offnung offnungen oeffnung oeffnungen porta portas janela
    janelas puerta puertas ventana ventanas carpinteria hueco huecos finestra finestre porte serramento
    serramenti infisso infissi deur deuren raam ramen kozijn kozijnen dorr dorrar fonster dør dører drzwi okno
    okna dvere menuiserie menuiseries дверь двери окно окна ドア 窓 门 窗 문 창 דלת דלתות חלון חלונות
"""
_OPENING_ENDS = """
    tuer tueren innentur innenturen aussentur aussenturen zimmertur zimmerturen fenster offnung offnungen
    oeffnung oeffnungen deur deuren raam ramen
"""
"""Not `tur`, which ends Architektur and Struktur."""
_NO_WALL = """
    furniture furn fixture fixtures fixt sanitary plumbing equipment eqpm dimension dimensions dim dims text
    texts txt annotation annotations anno note notes iden label labels hatch hatching hatches patt pattern
    title titleblock ttlb border frame viewport vport vpno defpoints leader legend legende leyenda legenda
    grid gridline gridlines axis axes stair stairs strs step steps virtual storage power lighting light
    lights lite electrical elec hvac mechanical duct ceiling ceilings clng roof roofing landscape vegetation
    planting plnt tree trees car cars vehicle vehicles people table tables chair chairs shelf shelves couch
    benches bench desk desks kitchen symbol symbols room-text area areas flooring tiles tiling paving carpet
    sofa sofas lamp lamps muebles
    beam beams girder girders joist joists rafter rafters purlin purlins
    handrail handrails hral railing railings overhead ovhd above case casework appl cntr centerline
    centreline header lintel demo demolition sketch projection furnishing furnishings millwork lvtry
    circulation circulations route routes paths portal portals waypoint waypoints
    arrow arrows escape evacuation evac egress guide guides guideline
    fnsh symb head sanr htng domw powr comm sprn pfix wdwk detl
    guidelines measurement measurements measure measures radiator radiators heater heaters
    garden gardens parking contour contours property vports zone zones elevation elevations
    mobilier mobiliers meuble meubles cote cotes cotation cotations texte textes escalier escaliers hachure
    hachures cartouche axe dallage carrelage sanitaire sanitaires plomberie faux-plafond plafond toiture
    parcours cheminement cheminements fleche fleches mesure mesures radiateur radiateurs chauffage
    garde-corps poutre poutres poutrelle poutrelles solive solives
    mobel moebel mobiliar moblierung moeblierung inventar
    bemassung bemassungen bemaung masse masslinie masslinien masskette massketten treppe
    treppen gelander gelaender schraffur schraffuren beschriftung beschriftungen raumstempel achse achsen
    raster sanitar sanitaer kuche kueche decke decken unterdecke dach plankopf rahmen einrichtung
    trager traeger balken unterzug unterzuge unterzuege uberzug ueberzug sparren pfette pfetten
    ausstattung schrankwand duschwand leinwand abbruch projektion sanitarobjekte sanitaerobjekte elektro
    heizung heizkorper heizkoerper pfeil pfeile fluchtweg fluchtwege rettungsweg rettungswege laufweg laufwege
    evakuierung hilfslinie hilfslinien messung messungen
    garten grundstuck grundstueck stellplatz stellplatze stellplaetze aussenanlagen ansicht ansichten
    mobiliario moveis cota cotas texto textos escalera escaleras escada escadas eje ejes eixo eixos
    sombreado sombreados trama tramas sanitario sanitarios pavimento pavimentos baldosas cubierta techo techos
    falso-techo cajetin marco aparatos barandilla
    circulacion recorrido recorridos ruta rutas evacuacion flecha flechas guia guias medida medidas
    medicion mediciones radiador radiadores calefaccion
    viga vigas vigueta viguetas jacena jacenas
    mobili arredo arredi quota quote quotatura quotature testo testi scala scale assi campitura campiture
    retino retini tratteggio sanitari pavimenti controsoffitto copertura cartiglio squadratura ringhiera
    circolazione percorso percorsi esodo evacuazione freccia frecce guida misura misure misurazioni
    radiatore radiatori termosifone termosifoni riscaldamento
    trave travi architrave
    meubilair meubels maat maten maatvoering maatlijnen tekst teksten trap trappen arcering arceringen
    stramien plafonds plafond dak sanitair inrichting onderhoek
    ligger liggers balk
    amenagement amenagements wyposazenie mobilya mobilyalar kaluste kalusteet butor butorok nabytok namestaj
    mebel meble wymiary schody nabytek koty matt mattsattning trappa trappor mobler mobel inredning
    балка балки
    мебель размеры текст оси лестница лестницы штриховка 家具 尺寸 文字 寸法 轴 가구 치수
    קורה קורות ריהוט מידות טקסט מדרגות צירים סניטריה רהיטים
"""
_THINGS = """
    furniture furn desk desks chair chairs table tables couch sofa sofas shelf shelves bench benches lamp
    lamps tree trees dimension dimensions dim dims bemassung masslinie masslinien cota cotas grid gridline
    gridlines arrow arrows route routes mobel moebel meuble meubles mobilier mobili muebles
"""
"""Of the words for what is no wall, those that a single shape is named by, first of all. Others name rooms as
well (a layer `kitchen` holds furniture, a shape `kitchen` or `bed_2` is a room), or how text is set."""
_LAYOUT = "column columns col cols colm structure stroke"
"""Words by which pages of the web name parts and styles of themselves, some of them words for walls."""
_NO_WALL_ENDS = """
    fluchtweg fluchtwege rettungsweg rettungswege pfeil pfeile hilfslinie hilfslinien heizkorper heizkoerper
    mobel moebel bemassung beschriftung schraffur treppe treppen text texte gelander gelaender decke decken
    achse achsen raster leuchte leuchten lampe lampen schrank schranke schraenke belag belage
    stempel dammung daemmung maatvoering arcering tekst trap trappen meubilair verkleidung
    trager traeger balken unterzug unterzuge unterzuege sparren
"""
_WORD = re.compile(r"[^\W\d_]+")
_CAMEL = re.compile(r"(?<=[a-zà-ÿ])(?=[A-Z])")
_ISO_13567 = re.compile(
    r"[A-Z][0-9_-](?P<element>[A-Z0-9_-]{6})(?P<presentation>[A-Z][_-]|[_-]{2})"
)
"""Agent 2, element 6, presentation 2 characters, then optional fields; `-` and `_` fill (ISO 13567-2)."""
_SFB_WALLS = {"16", "17", "21", "22", "28"}
"""Of SfB, table 1, and NL-SfB: foundations, external and internal walls, frames."""
_SFB_OPENINGS = {"31", "32"}
_SFB = re.compile(r"(?:^|[-_ (])(?P<code>[1-9]\d)(?![\d])")
LITTLE = 0.3
"""A layer that is called wall and of which less became faces is questioned. Where less did than this share of
the long lines left, walls are drawn as single lines."""


class Role(IntEnum):
    """What a layer holds, going by its name."""

    NO_WALL = 0
    UNKNOWN = 1
    OPENING = 2
    WALL = 3


def role_of(name: str) -> Role:
    """Role of a layer going by its name: `A-WALL-FULL`, `015 Innenwände`, `OuterWalls`, `Mobilier`.

    Names of ISO 13567 with elements of SfB (`A-21----E-`) are told by their fields.
    """
    return _role_of(unicodedata.normalize("NFC", name))


@cache
def _role_of(name: str) -> Role:
    words = words_of(name)
    joined = {folded(word) for word in re.findall(r"[^\W\d_]+(?:-[^\W\d_]+)+", name)}
    every = words | joined
    if every & _words(_NO_WALL) or _ends(words, _NO_WALL_ENDS):
        return Role.NO_WALL
    if every & _words(_OPENING) or _ends(words, _OPENING_ENDS):
        return Role.OPENING
    if every & _words(_WALL) or _ends(words, _WALL_ENDS) or any(i in name for i in "壁墙벽"):
        return Role.WALL
    return _role_by_fields(name)


def _role_by_fields(name: str) -> Role:
    """By the fields of ISO 13567; a name of another form is unknown."""
    fields = _ISO_13567.match(name.upper())
    if fields is None:
        return Role.UNKNOWN
    code = _SFB.search(fields["element"])
    if code is None:
        return Role.UNKNOWN
    presentation = fields["presentation"].strip("-_")
    if presentation not in ("", "E"):
        return Role.NO_WALL  # text, hatching, dimensions, marks, grids, borders
    if code["code"] in _SFB_WALLS:
        return Role.WALL
    return Role.OPENING if code["code"] in _SFB_OPENINGS else Role.NO_WALL


def words_of(name: str) -> set[str]:
    """Words of a name, folded: floorId has floor and id."""
    return {folded(word) for word in _WORD.findall(_CAMEL.sub(" ", name))}


def folded(word: str) -> str:
    """Lower case, without accents: Wände and WANDE are wande, außen is aussen."""
    letters = unicodedata.normalize("NFKD", word.casefold())
    return "".join(letter for letter in letters if not unicodedata.combining(letter))


@cache
def _words(listed: str) -> frozenset[str]:
    return frozenset(folded(word) for word in listed.split())


def _ends(words: set[str], listed: str) -> bool:
    ends = tuple(_words(listed))
    return any(word.endswith(ends) for word in words)


def telling_word(names: str) -> str:
    """Of the classes or the id of a shape, the one that tells its role: of walls if any does, then of
    openings; empty where none does. Furniture has a word for it first (`desk-12`), as what has one otherwise
    may be a room or a style."""
    told: dict[Role, str] = {}
    for word in names.split():
        role, parts = role_of(word), [folded(part) for part in _WORD.findall(_CAMEL.sub(" ", word))]
        is_style = role == Role.NO_WALL and parts[0] not in _words(_THINGS)
        if not is_style and not (role == Role.WALL and set(parts) & _words(_LAYOUT)):
            told.setdefault(role, word)
    return next((told[r] for r in (Role.WALL, Role.OPENING, Role.NO_WALL) if r in told), "")


def chosen_layers(path: Path, patterns: tuple[str, ...], names: tuple[str, ...]) -> list[bool]:
    """Which layers the user's patterns name, `*` and `?` being wildcards, in any case.

    Raises:
        FloorplanError: a pattern names none; the message lists the layers there are.
    """
    lower = [name.lower() for name in names]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern.lower()) for name in lower):
            listed = ", ".join(repr(name) for name in names[:20]) or "none"
            raise FloorplanError(
                f"{path}: expected a layer named {pattern!r}, found the layers {listed}"
                + (f" and {len(names) - 20} more" if len(names) > 20 else "")
            )
    return [any(fnmatchcase(name, p.lower()) for p in patterns) for name in lower]


@dataclass(frozen=True)
class LayerLength:
    """Line work of a layer, in the drawing's own unit."""

    name: str
    role: Role
    n_lines: int
    drawn: float
    """Length of lines that were looked at as faces; of all of them where the layer holds no walls."""
    taken: float
    """Length of the faces among them."""


def length_words(amount: float, metres_per_unit: float | None) -> str:
    """A length in a drawing's unit, in metres where that is known."""
    if metres_per_unit is None:
        return f"{amount:.3g} units"
    return f"{amount * metres_per_unit:.3g} m"


def counted(n: int, thing: str) -> str:
    """How many there are of a thing: "1 door", "2 doors"; empty for none."""
    return "" if n == 0 else f"1 {thing}" if n == 1 else f"{n} {thing}s"


def words_on_layers(
    layers: Sequence[LayerLength], metres_per_unit: float | None, is_chosen: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Layers that were left out by name, line work that was taken for no wall, and layers called wall that
    gave few faces.

    Args:
        layers: lengths in the unit of the drawing.
        metres_per_unit: None where it is unknown.
        is_chosen: whether the user named the layers that hold walls.

    Returns what was left out and what to look at, a sentence each, for `PlanSource`.
    """

    def length(amount: float) -> str:
        return length_words(amount, metres_per_unit)

    def listed(left: list[tuple[LayerLength, float]]) -> str:
        named = sorted(left, key=lambda pair: -pair[1])[:MAX_NAMED]
        words = [f"{each.name or 'no layer'} ({length(amount)})" for each, amount in named]
        more = f" and {len(left) - MAX_NAMED} more" if len(left) > MAX_NAMED else ""
        return ", ".join(words) + more

    dropped, warnings = [], []
    no_wall = [(each, each.drawn) for each in layers if each.role == Role.NO_WALL and each.n_lines]
    if no_wall:
        count = sum(each.n_lines for each, _ in no_wall)
        why = "layers that were not chosen" if is_chosen else "layers of no walls"
        dropped.append(f"{count} lines on {why}: {listed(no_wall)}")
    longest = max((each.drawn for each in layers), default=0.0)
    looked_at = [each for each in layers if each.role != Role.NO_WALL]
    left = [(each, each.drawn - each.taken) for each in looked_at]
    left = [(each, amount) for each, amount in left if amount > 0.05 * each.drawn > 0]
    if left:
        dropped.append(f"line work taken for no wall: {listed(left)}")
    for each in looked_at:
        is_little = each.taken < LITTLE * each.drawn and each.drawn > 0.02 * longest
        if each.role == Role.WALL and is_little:
            called = "was chosen" if is_chosen else "is called wall"
            warnings.append(
                f"layer {each.name!r} {called}, but of its {length(each.drawn)} of lines only "
                f"{length(each.taken)} became faces: {COMPARE}"
            )
    return tuple(dropped), tuple(warnings)


def lengths_by_layer(
    drawing: VectorDrawing, roles: list[Role], candidates: Candidates, faces: WallFaces
) -> tuple[LayerLength, ...]:
    """What was looked at of each layer that is to be, all line work of the others, and what became faces."""
    n = len(drawing.layers)
    lines = drawing.lines
    count = np.bincount(lines.layer, minlength=n)
    whole = np.bincount(lines.layer, segments.lengths(lines.ends), minlength=n)
    own = candidates.layer >= 0
    drawn = np.bincount(candidates.layer[own], segments.lengths(candidates.ends[own]), minlength=n)
    on_line = faces.line >= 0
    layer = candidates.layer[faces.line[on_line]]
    length = segments.lengths(faces.ends[on_line])
    taken = np.bincount(layer[layer >= 0], length[layer >= 0], minlength=n)
    return tuple(
        LayerLength(
            name,
            roles[i],
            int(count[i]),
            float(whole[i] if roles[i] == Role.NO_WALL else drawn[i]),
            float(taken[i]),
        )
        for i, name in enumerate(drawing.layers)
    )
