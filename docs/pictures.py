"""Draw the pictures of docs/pipeline.md: `python docs/pictures.py` writes docs/images/pipeline_*.png.

One synthetic scan is followed through the pipeline. Its plan is the drawing of the building, a picture
without unit. Takes about a minute.
"""

import io
import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import planfit
from planfit import synth
from planfit.adjust.association import wall_patches_in_plan
from planfit.alignment import metric_plan
from planfit.floorplan import Floorplan
from planfit.pipeline.align import AlignResult, align
from planfit.pipeline.observations import extract_observations
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.report.measures import measure
from planfit.report.plots import colors
from planfit.report.plots.axes import Axes
from planfit.report.plots.drawing import Box, Cells, Drawing, Words, to_png
from planfit.report.plots.overlay import draw_overlay
from planfit.report.plots.plan_picture import draw_plan_picture
from planfit.report.plots.scan_view import draw_alignment
from planfit.runtime import Runtime
from planfit.scan import Scan

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
from drawn_plans.drawing import DrawingOptions, draw_building

IMAGES = Path(__file__).parent / "images"
N_LINES = 60
"""Of the matches of two frames, so that single ones can be followed."""
FLOOR, WALLS = "#009e73", ("#0072b2", "#d55e00", "#cc79a7", "#e69f00", "#56b4e9")
MAX_BYTES = 90_000
"""Of a picture: fewer colours, then fewer pixels, until it is as small."""


def save(name: str, picture: bytes | Drawing, largest_px: int = 1000) -> None:
    """A picture, as a PNG of few colours."""
    if isinstance(picture, Drawing):
        picture = to_png(picture)
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    path = IMAGES / f"pipeline_{name}.png"
    for share, n_colors in ((1.0, 200), (1.0, 100), (0.8, 100), (0.8, 50)):
        small = image.copy()
        small.thumbnail((int(share * largest_px),) * 2, Image.Resampling.LANCZOS)
        small.quantize(n_colors, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size < MAX_BYTES:
            break
    image = small
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB, {image.width} x {image.height} px")


def panels(
    titles: list[str], x: tuple[float, float], y: tuple[float, float], width_pt: float
) -> tuple[Drawing, list[Axes]]:
    """Pictures side by side, true to scale, a title above each."""
    height_pt = width_pt * abs((y[1] - y[0]) / (x[1] - x[0]))
    drawing = Drawing(len(titles) * (width_pt + 8), height_pt + 26)
    axes = []
    for k, words in enumerate(titles):
        left = 4 + k * (width_pt + 8)
        axes.append(Axes(drawing, Box(left, 20, left + width_pt, 20 + height_pt), x, y))
        drawing.items.append(Words(words, (left + width_pt / 2, 14), colors.INK, "middle"))
    return drawing, axes


def show(axes: Axes, image: np.ndarray) -> None:
    """An image (RGB) that fills axes, in 256 colours."""
    few = Image.fromarray(image).quantize(256, dither=Image.Dither.NONE)
    palette = np.full((256, 4), 255, np.uint8)
    rgb = np.array(few.getpalette(), np.uint8).reshape(-1, 3)
    palette[: len(rgb), :3] = rgb
    axes.drawing.items.append(Cells(np.array(few), palette, axes.box))


def draw_structure(scan: Scan, prepared: PreparedScan) -> Drawing:
    """Colour, depth, and what is floor and which patches are wall, of one frame."""
    structure = prepared.measurements.structure
    frame = int(np.argmax(np.bincount(structure.walls.frame_idx)))
    color, camera = scan.files.color(frame), scan.cameras[frame]
    depth = scan.files.depth(frame)
    grey = np.round(255 * np.nan_to_num(depth / np.nanmax(depth))).astype(np.uint8)
    viridis = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS)[:, :, ::-1]
    titles = ["colour", "depth", "floor and wall patches"]
    rim = (0.0, float(camera.width)), (float(camera.height), 0.0)
    drawing, axes = panels(titles, *rim, 210)
    show(axes[0], color)
    show(axes[1], np.where(np.isnan(depth)[:, :, None], 255, viridis).astype(np.uint8))
    show(axes[2], np.round(255 - 0.45 * (255.0 - color)).astype(np.uint8))
    level = structure.floor
    points = [(level.points_cam[level.start[frame] : level.start[frame + 1]], FLOOR)]
    patches = np.flatnonzero(structure.walls.frame_idx == frame)
    for k, patch in enumerate(patches):
        begin, end = structure.walls.start[patch : patch + 2]
        points.append((structure.walls.points_cam[begin:end], WALLS[k % len(WALLS)]))
    for xyz, paint in points:
        axes[2].squares(camera.project(xyz), paint, 1.6)
    return drawing


def draw_matches(scan: Scan, prepared: PreparedScan) -> Drawing:
    """Two frames of different visits, and the keypoints that were matched."""
    matches = prepared.measurements.matches
    apart = matches.pairs[:, 1] - matches.pairs[:, 0]
    sizes = np.diff(matches.start)
    # Very many matches belong to two views that are the same, and show nothing.
    pair = int(np.argmin(np.where(apart > len(scan) // 3, np.abs(sizes - 100), np.inf)))
    a, b = matches.pairs[pair]
    inside = np.linspace(matches.start[pair], matches.start[pair + 1] - 1, N_LINES).astype(int)
    camera = scan.cameras[a]
    words = f"frames {a + 1} and {b + 1}: {sizes[pair]} matches verified in 3D, {N_LINES} shown"
    rim = (0.0, 2.0 * camera.width), (float(camera.height), 0.0)
    drawing, (axes,) = panels([words], *rim, 640)
    show(axes, np.hstack([scan.files.color(int(a)), scan.files.color(int(b))]))
    uv_a = camera.project(matches.points_a[inside])
    uv_b = scan.cameras[b].project(matches.points_b[inside]) + np.array([camera.width, 0])
    axes.lines(np.stack([uv_a, uv_b], axis=1), "#ffd000", 0.8)
    return drawing


def draw_loops(scan: Scan, prepared: PreparedScan) -> Drawing:
    """Wall and path from above, as recorded and after loops are closed."""
    recorded = prepared.level_from_world @ scan.world_from_cams
    both = [(recorded, colors.BEFORE), (prepared.level_from_keys, colors.AFTER)]
    walls = prepared.measurements.structure.walls
    seen = [wall_patches_in_plan(walls, poses)[1] for poses, _ in both]
    everything = np.concatenate(seen).reshape(-1, 2)
    rim = np.stack([everything.min(axis=0) - 0.5, everything.max(axis=0) + 0.5], axis=1)
    x, y = ((float(low), float(high)) for low, high in rim)
    drawing, axes = panels(["as recorded", "loops closed"], x, y, 210)
    for one, ends, (poses, paint) in zip(axes, seen, both, strict=True):
        one.lines(ends, paint, 1.0)
        one.lines([poses[:, :2, 3]], colors.GREY, 0.8)
    return drawing


def draw_alignments(found: AlignResult, plan: Floorplan) -> bytes:
    """The hypothesis that was taken and the next one, side by side."""
    alignment, walls = found.alignment, found.walls
    pictures = []
    for number, hypothesis in enumerate(alignment.candidates[:2], start=1):
        words = f"hypothesis {number}: {hypothesis.score:.0%} of the scanned wall explained"
        png = draw_alignment(metric_plan(plan, hypothesis.scale_xy), walls, hypothesis, words)
        pictures.append(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR))
    height = max(len(one) for one in pictures)
    padded = [
        cv2.copyMakeBorder(one, height - len(one), 0, 0, 0, cv2.BORDER_CONSTANT, value=(255,) * 3)
        for one in pictures
    ]
    return cv2.imencode(".png", np.hstack(padded))[1].tobytes()


def main() -> None:
    """Follow one scan through the pipeline."""
    synthetic = synth.make_scan(
        synth.SynthOptions(
            walk=synth.WalkOptions(n_frames=140),
            camera=synth.CameraOptions(width_px=400, height_px=300),
            drift=synth.DriftOptions(yaw_deg=0.3, translation_m=0.025),
            world="moved",
        )
    )
    scan = synthetic.scan
    drawing = draw_building(
        synthetic.building, DrawingOptions(style="double filled"), np.random.default_rng(0)
    )
    sheet = IMAGES / "sheet.png"
    cv2.imwrite(str(sheet), drawing.image)
    plan = planfit.read_floorplan(sheet)
    save("plan", draw_plan_picture(plan, sheet), 720)
    sheet.unlink()

    options, runtime = planfit.RefineOptions(), Runtime(2)
    prepared = prepare(scan, extract_observations(scan, options, runtime), options)
    save("structure", draw_structure(scan, prepared))
    save("matches", draw_matches(scan, prepared))
    save("loops", draw_loops(scan, prepared))
    save("alignments", draw_alignments(align(scan, plan, options, runtime), plan))
    result = planfit.refine(scan, plan, options, runtime)
    save("walls", draw_overlay(result.floorplan, measure(result.floorplan, result)))
    print(*result.checks, *result.warnings, sep="\n")


if __name__ == "__main__":
    main()
