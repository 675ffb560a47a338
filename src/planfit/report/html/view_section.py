"""The section of the report that shows the scan in 3D; its programs are the files of `html/view`."""

from importlib import resources

from planfit.report.html.as_built_section import COLORS
from planfit.report.html.tables import color_keys
from planfit.report.scene import Scene, encode_levels, scene_json

SCRIPTS = (
    "matrix.js",
    "scene.js",
    "shaders.js",
    "renderer.js",
    "orbit.js",
    "picking.js",
    "card.js",
    "page_links.js",
    "main.js",
)
"""In the order in which they build on each other."""


def view_section(scene: Scene) -> str:
    """Controls, canvas and words; the page needs `view_style` and `view_script` beside it."""
    has_plan = bool(scene.walls)
    last = len(scene.frames) - 1
    low, high = (float(z - scene.origin[2]) for z in scene.bounds[:, 2])
    cut = min(float(scene.cut_m - scene.origin[2]), high)
    colorings = [(0, "image"), (1, "height"), (3, "time")]
    walls_box = wall_words = key = ""
    named = "Frames and walls" if has_plan else "Frames"
    if scene.points.plan_distances_m is not None:
        colorings.insert(2, (2, "distance to the plan"))
    if has_plan:
        walls_box = (
            '<label><input class="view-walls" type="checkbox" checked> walls of the plan</label>'
        )
        key = color_keys((color, verdict.value) for verdict, color in COLORS.items())
        wall_words = ", or a wall to see its points and how far it is from where it is drawn"
    options = "".join(f'<option value="{value}">{words}</option>' for value, words in colorings)
    sides = "".join(
        f'<label><input type="radio" name="view-side" value="{value}"{checked}> {words}</label>'
        for value, words, checked in (
            ("before", "before", ""),
            ("after", "after", " checked"),
            ("wipe", "wipe", ""),
        )
    )
    return f"""<section id="view" class="view-section"><h2>In 3D</h2>
<p>Press a camera of the path to see its image{wall_words}. {named} can be pressed in the plots and tables of
this page, too.</p>
<details><summary>Mouse, fingers, keys</summary><p>Drag to turn; with two fingers, Shift or the right button
to move; pinch, + and −, or the wheel once the view was pressed, for nearer and further. Arrows turn, with
Shift they move, Home shows the whole; B: before and after, W: wipe, C: next colour, comma and full stop:
frame before and next, Escape: nothing chosen.</p></details>
<div class="view-tools"><fieldset aria-label="poses">{sides}</fieldset>
<label>colour <select class="view-color">{options}</select></label>
{walls_box}
<label><input class="view-path" type="checkbox" checked> cameras</label>
<label>cut above <input class="view-cut" type="range" min="{low:.2f}" max="{high:.2f}" step="0.05"
value="{cut:.2f}"> <output class="view-cut-words"></output></label>
<label>dots <input class="view-size" type="range" min="0.006" max="0.06" step="0.002" value="0.022"></label>
<button type="button" class="view-whole">whole</button>
<button type="button" class="view-above">from above</button></div>
<div class="view-stage"><canvas tabindex="0" role="application"
aria-label="the scan in 3D; arrow keys turn it"></canvas>
<div class="view-sides" hidden><span class="before">before</span><span class="after">after</span></div>
<input class="view-wipe" type="range" min="0" max="1" step="0.002" value="0.5"
aria-label="where before ends and after begins" hidden>
<div class="view-legend" hidden></div><p class="view-note" role="status">loading …</p>
<aside class="view-card" aria-live="polite" hidden></aside></div>
<div class="view-below"><label>frame <input class="view-frame" type="range" min="0" max="{last}" step="1"
value="0"> <output class="view-frame-words"></output></label><span>{key}</span></div>
<noscript><p>The 3D view needs JavaScript.</p></noscript></section>"""


def view_data(scene: Scene) -> tuple[str, str]:
    """The scene, in elements that browsers do not run: what the page's script needs before it, and the other
    levels of detail, which follow it and end the page, so that neither words nor first points wait for them.
    """
    blocks = [
        f'<script type="text/plain" class="view-points">{level}</script>'
        for level in encode_levels(scene.points)
    ]
    text = scene_json(scene, len(blocks))
    head = f'<script type="application/json" id="view-scene">{text}</script>'
    return f"{head}\n{blocks[0]}\n", "\n".join(blocks[1:])


def view_style() -> str:
    """What the page's style needs in addition."""
    return _read("view.css")


def view_script() -> str:
    """What the page's script needs in addition; its names are its own."""
    parts = "\n".join(_read(name) for name in SCRIPTS)
    return f'(() => {{\n"use strict";\n{parts}}})();\n'


def _read(name: str) -> str:
    return resources.files("planfit.report.html").joinpath("view", name).read_text("utf-8")
