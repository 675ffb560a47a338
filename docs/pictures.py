"""Draw the pictures of docs/pipeline.md: `python docs/pictures.py` writes docs/images/pipeline_*.png.

One synthetic scan is followed through the pipeline. Its plan is the drawing of the building, a picture
without unit. Takes about a minute.
"""

import io
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import planfit
from planfit import synth
from planfit.adjust.association import wall_patches_in_plan
from planfit.alignment import metric_plan
from planfit.floorplan import Floorplan
from planfit.pipeline.align import AlignResult, align
from planfit.pipeline.observations import extract_observations
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.report.plots.alignment import draw_alignment
from planfit.report.plots.drawing import AFTER, BEFORE, FONT_PT, GREY, INK, new_figure
from planfit.report.plots.overlay import draw_overlay
from planfit.report.plots.plan_picture import draw_plan_picture
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.synth.drawing import DrawingOptions, draw_building

IMAGES = Path(__file__).parent / "images"
N_LINES = 60
"""Of the matches of two frames, so that single ones can be followed."""
FLOOR, WALLS = "#009e73", ("#0072b2", "#d55e00", "#cc79a7", "#e69f00", "#56b4e9")
MAX_BYTES = 90_000
"""Of a picture: fewer colours, then fewer pixels, until it is as small."""


def save(name: str, picture: bytes | Figure, largest_px: int = 1000) -> None:
    """A picture, as a PNG of few colours."""
    if isinstance(picture, Figure):
        buffer = io.BytesIO()
        picture.savefig(buffer, format="png")
        picture = buffer.getvalue()
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    path = IMAGES / f"pipeline_{name}.png"
    for share, colors in ((1.0, 200), (1.0, 100), (0.8, 100), (0.8, 50)):
        small = image.copy()
        small.thumbnail((int(share * largest_px),) * 2, Image.Resampling.LANCZOS)
        small.quantize(colors, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size < MAX_BYTES:
            break
    image = small
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB, {image.width} x {image.height} px")


def panels(n: int, width_in: float, height_in: float) -> tuple[Figure, list[Axes]]:
    """Pictures side by side, without ticks."""
    figure = new_figure(width_in, height_in)
    axes = list(figure.subplots(1, n, squeeze=False)[0])
    for one in axes:
        one.set(xticks=[], yticks=[])
        one.spines[:].set_visible(False)
    figure.subplots_adjust(0.01, 0.01, 0.99, 0.9, 0.03)
    return figure, axes


def title(axes: Axes, words: str) -> None:
    """Above a panel."""
    axes.set_title(words, fontsize=FONT_PT, color=INK)


def draw_structure(scan: Scan, prepared: PreparedScan) -> Figure:
    """Colour, depth, and what is floor and which patches are wall, of one frame."""
    figure, axes = panels(3, 9.0, 2.6)
    frame = int(np.argmax(np.bincount(prepared.measurements.structure.walls.frame_idx)))
    color, camera = scan.files.color(frame), scan.cameras[frame]
    axes[0].imshow(color)
    axes[1].imshow(scan.files.depth(frame), cmap="viridis")
    axes[2].imshow(color, alpha=0.45)
    structure = prepared.measurements.structure
    level = structure.floor
    points = [(level.points_cam[level.start[frame] : level.start[frame + 1]], FLOOR)]
    patches = np.flatnonzero(structure.walls.frame_idx == frame)
    for k, patch in enumerate(patches):
        begin, end = structure.walls.start[patch : patch + 2]
        points.append((structure.walls.points_cam[begin:end], WALLS[k % len(WALLS)]))
    for xyz, paint in points:
        uv = camera.project(xyz)
        axes[2].plot(uv[:, 0], uv[:, 1], ".", color=paint, markersize=1.6)
    axes[2].set(xlim=(0, camera.width), ylim=(camera.height, 0))
    for one, words in zip(axes, ("colour", "depth", "floor and wall patches"), strict=True):
        title(one, words)
    return figure


def draw_matches(scan: Scan, prepared: PreparedScan) -> Figure:
    """Two frames of different visits, and the keypoints that were matched."""
    matches = prepared.measurements.matches
    apart = matches.pairs[:, 1] - matches.pairs[:, 0]
    sizes = np.diff(matches.start)
    # Very many matches belong to two views that are the same, and show nothing.
    pair = int(np.argmin(np.where(apart > len(scan) // 3, np.abs(sizes - 100), np.inf)))
    a, b = matches.pairs[pair]
    inside = np.linspace(matches.start[pair], matches.start[pair + 1] - 1, N_LINES).astype(int)
    figure, (axes,) = panels(1, 9.0, 3.6)
    width = scan.cameras[a].width
    axes.imshow(np.hstack([scan.files.color(int(a)), scan.files.color(int(b))]))
    uv_a = scan.cameras[a].project(matches.points_a[inside])
    uv_b = scan.cameras[b].project(matches.points_b[inside]) + np.array([width, 0])
    axes.plot(*np.stack([uv_a, uv_b], axis=2).transpose(1, 2, 0), "-", color="#ffd000", lw=0.8)
    title(
        axes, f"frames {a + 1} and {b + 1}: {sizes[pair]} matches verified in 3D, {N_LINES} shown"
    )
    return figure


def draw_loops(scan: Scan, prepared: PreparedScan) -> Figure:
    """Wall and path from above, as recorded and after loops are closed."""
    figure, axes = panels(2, 6.0, 4.2)
    recorded = prepared.level_from_world @ scan.world_from_cams
    both = ((recorded, BEFORE, "as recorded"), (prepared.level_from_keys, AFTER, "loops closed"))
    for one, (poses, paint, words) in zip(axes, both, strict=True):
        _, ends = wall_patches_in_plan(prepared.measurements.structure.walls, poses)
        one.plot(*ends.transpose(2, 1, 0), "-", color=paint, lw=1.0)
        one.plot(*poses[:, :2, 3].T, "-", color=GREY, lw=0.8)
        one.set_aspect("equal")
        title(one, words)
    return figure


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
    save("walls", draw_overlay(result.floorplan, result))
    print(*result.checks, *result.warnings, sep="\n")


if __name__ == "__main__":
    main()
