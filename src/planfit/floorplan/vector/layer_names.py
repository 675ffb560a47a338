"""What the names of layers say, in the languages that drawings are mostly made in."""

import re
from enum import IntEnum
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

from planfit.errors import FloorplanError


class Role(IntEnum):
    """What a layer holds, going by its name."""

    NO_WALL = 0
    UNKNOWN = 1
    OPENING = 2
    WALL = 3


# Whole words. What is no wall wins over an opening, and that over a wall: "wall text" holds text.
_WALL = """
    wall walls partition partitions structure structural shearwall column columns mur murs
    cloison cloisons voile poteau porteur wand wande wände waende innenwand aussenwand außenwand
    mauer mauern trennwand tragwand stutze stütze parede paredes alvenaria muro muros pared
    tabique tabiques muratura muri parete pareti tramezzo tramezzi pilastro pilastri muur muren
    binnenmuur buitenmuur vagg vägg vaggar vegg seina sciana sciany ściana ściany stena steny
    stěna zid zidovi perete pereti duvar стена стены перегородка перегородки 壁 墙 墙体 벽 קיר קירות
"""
_OPENING = """
    door doors window windows glaz glazing opening porte portes fenetre fenêtre fenetres baie
    tur tür turen türen tuer fenster porta portas janela janelas puerta puertas ventana ventanas
    finestra finestre serramenti infissi deur deuren raam ramen dorr dörr fonster fönster drzwi
    okno okna dvere dveře дверь двери окно окна ドア 窓 门 窗 문 창
"""
_NO_WALL = """
    furniture furn fixture sanitary plumbing equipment dimension dimensions dim dims text texts
    annotation anno note notes hatch hatching title titleblock border frame viewport defpoints
    leader grid gridline axis axes stair stairs step virtual storage power lighting light
    electrical elec hvac mechanical duct ceiling roof landscape vegetation tree trees car cars
    people table tables chair chairs shelf shelves couch benches bench desk desks kitchen symbol
    symbols room-text area areas mobilier meuble meubles cote cotes cotation texte escalier
    hachure hachures cartouche axe mobel möbel moebel bemassung bemaßung bemassungen masse maße
    treppe treppen schraffur beschriftung achse achsen sanitar sanitär kuche küche mobiliario
    mobiliário moveis móveis cota cotas texto textos escalera escada eje ejes eixo mobili arredo
    arredi quota quote testo testi scala scale assi meubilair maat maten tekst trap mebel meble
    wymiary schody nabytek nábytek koty мебель размеры текст оси лестница 家具 尺寸 文字 寸法 轴 가구 치수
"""
_WORD = re.compile(r"[^\W\d_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")


@cache
def role_of(name: str) -> Role:
    """Role of a layer going by its name: `A-WALL-FULL`, `Wand (neu)`, `OuterWalls`, `Mobilier`."""
    words = set(_WORD.findall(_CAMEL.sub(" ", name).lower()))
    if words & set(_NO_WALL.split()):
        return Role.NO_WALL
    if words & set(_OPENING.split()):
        return Role.OPENING
    if words & set(_WALL.split()) or any(ideogram in name for ideogram in "壁墙벽"):
        return Role.WALL
    return Role.UNKNOWN


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
