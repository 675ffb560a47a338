"""PNG, JPEG and TIFF pictures of plans, as a viewer shows them."""

import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, UInt8
from PIL import Image, ImageOps

from planfit.errors import FloorplanError
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.formats.georeference import find_georeference, place_on_map
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.raster import MAX_PIXELS, check_size, plan_of_picture, shrink_for_reading
from planfit.floorplan.raster.picture import DARK
from planfit.floorplan.types import Floorplan
from planfit.units import INCH_M

_STRIP_PX = 256  # rows that are copied at a time


def read_picture(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a PNG, JPEG or TIFF picture of a plan.

    Plan x-y are the picture's (u, -v): pixels, unless the options tell the scale.

    Raises:
        FloorplanError: no picture, too large or too small, blank, a photograph, or without walls.
    """
    fingerprint = fingerprint_with_mask(path, options)
    is_told = options.unit != "auto" or options.metres_per_unit is not None
    warning = ""
    if options.paper_scale is not None:
        dpi = _dots_per_inch(path)
        options = options.on_paper(INCH_M / dpi)
        is_told = True
        if min(abs(dpi - usual) for usual in (72.0, 96.0)) < 0.5:
            warning = f"the picture says {dpi:.0f} dpi, which programs write where they know none"
            warning += ": check a length"
    georeference = None if is_told else find_georeference(path)
    image, shrink = load_picture(path)
    image = _blank_outside(image, options.keep_regions, shrink)
    plan = read_image(image, str(path), fingerprint, options, "raster picture", shrink)
    plan = replace(plan, source=replace(plan.source, is_picture=True))
    for each in filter(None, (warning, _other_pages(path))):
        plan = plan.with_warning(each)
    return plan if georeference is None else place_on_map(plan, georeference)


def _blank_outside(
    image_bgr: UInt8[np.ndarray, "h w 3"],
    regions: tuple[tuple[tuple[float, float], ...], ...],
    shrink: int,
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture with paper in place of what is outside of all regions (pixels of the file, `shrink` to one
    of the image): frames and tables there then do not mislead what is taken for a wall."""
    if not regions:
        return image_bgr
    height, width = image_bgr.shape[:2]
    is_kept = np.zeros((height, width), np.uint8)
    for region in regions:
        corners = (np.array(region) + 0.5) / shrink - 0.5
        # Corners far outside are beyond what OpenCV counts.
        shown = shapely.make_valid(shapely.Polygon(corners))
        parts = shapely.get_parts(shapely.clip_by_rect(shown, -1, -1, width, height))
        for part in parts[shapely.area(parts) > 0]:
            outline = np.round(shapely.get_coordinates(shapely.get_exterior_ring(part)))
            cv2.fillPoly(is_kept, [outline.astype(np.int32)], 1)
    if not is_kept.any():
        return image_bgr  # no wall will be left in them, which is said
    paper = np.median(image_bgr[is_kept > 0], axis=0).astype(np.uint8)
    return np.where(is_kept[..., None] > 0, image_bgr, paper)


def _other_pages(path: Path) -> str:
    """What to say of pages of a scanned document that are not read; empty where there is one."""
    with warnings.catch_warnings(action="ignore"), Image.open(path) as file:
        try:
            n_pages = getattr(file, "n_frames", 1) if file.format == "TIFF" else 1
        except (OSError, ValueError, TypeError, SyntaxError, KeyError):
            return "the first page is read: what follows it in the file is damaged"
    if n_pages == 1:
        return ""
    return f"the first of {n_pages} pages is read: save another as a file of its own to read that"


def _dots_per_inch(path: Path) -> float:
    """What the picture's metadata say.

    Raises:
        FloorplanError: they say nothing, or differ along both sides.
    """
    try:
        with Image.open(path) as file:
            found = [float(value) for value in file.info.get("dpi", ())]
    except (OSError, ValueError, SyntaxError, TypeError, ZeroDivisionError):
        found = []
    is_one = len(found) == 2 and min(found) > 1 and max(found) < 1.01 * min(found)
    if not (is_one and np.isfinite(found).all()):
        raise FloorplanError(
            f"{path}: expected the picture's dots an inch (dpi) for a scale 1:N, found "
            f"{'none' if not found else ' x '.join(f'{v:g}' for v in found)} in its metadata; give the "
            "metres of a pixel: --scale 0.0254 * N / dpi"
        )
    return sum(found) / 2


def read_image(
    image_bgr: UInt8[np.ndarray, "h w 3"],
    name: str,
    fingerprint: str,
    options: PlanOptions,
    kind: str,
    shrink: int = 1,
) -> Floorplan:
    """Wall faces of a picture that is loaded, with the wall mask that the options name.

    Args:
        image_bgr: integer pixels are pixel centres.
        fingerprint: of the file and the mask.
        options: unit, scale, storey and wall mask are used.
        shrink: pixels of the file to one of the image.
    """
    mask = None
    if options.wall_mask is not None:
        mask = load_wall_mask(options.wall_mask, image_bgr.shape[:2], name)
    return plan_of_picture(image_bgr, name, fingerprint, options, kind, mask, shrink)


def fingerprint_with_mask(path: Path, options: PlanOptions) -> str:
    """Changes when the file does, or the wall mask that is used with it."""
    if options.wall_mask is None:
        return fingerprint_of(path)
    return fingerprint_of(path, _existing(options.wall_mask))


def load_picture(path: Path) -> tuple[UInt8[np.ndarray, "h w 3"], int]:
    """BGR, as a viewer shows it: transparent is white, what is drawn in white alone on it black, EXIF
    rotations are made; and how many times it was shrunk: 1 for all but huge pictures.

    Raises:
        FloorplanError: not a picture, damaged, or too large to be read in reasonable time.
    """
    try:
        # Pillow's own limit warns from 89 million pixels on and raises from twice that.
        with warnings.catch_warnings(action="ignore"), Image.open(path) as file:
            check_size(str(path), file.width, file.height)
            shrink = shrink_for_reading(file.width, file.height)
            ImageOps.exif_transpose(file, in_place=True)
            upright: Image.Image = file
            if upright.mode.startswith("I") or upright.mode == "F":  # 16 and 32 bits a pixel
                values = np.asarray(upright, dtype=float)
                top = max(float(values.max()), 1.0)
                top = 65535.0 if 255.0 < top <= 65535.0 else max(top, 255.0)
                upright = Image.fromarray(np.round(values / top * 255).astype(np.uint8))
            if shrink > 1:  # before the picture takes four bytes a pixel
                if upright.mode in ("1", "P"):  # numbers of colours have no mean
                    upright = upright.convert("L" if upright.mode == "1" else "RGBA")
                upright = upright.reduce(shrink)
            # Of large pictures each copy counts: four bytes a pixel.
            if upright.has_transparency_data:
                rgba = upright.convert("RGBA")
                page = Image.new("RGB", rgba.size, "white")
                page.paste(rgba, mask=rgba)
                if np.asarray(page.convert("L")).min() > 255 * (1 - DARK):  # nothing would be read
                    page = Image.new("RGB", rgba.size, "black")
                    page.paste(rgba, mask=rgba)
                    page = ImageOps.invert(page)
            else:
                page = upright if upright.mode == "RGB" else upright.convert("RGB")
            bgr = _to_bgr(page)
    except Image.DecompressionBombError as error:
        raise FloorplanError(
            f"{path}: expected a picture of at most {MAX_PIXELS // 1_000_000} million pixels, found more; "
            "scale it down until walls are 10 to 30 px thick"
        ) from error
    except (OSError, ValueError, SyntaxError) as error:
        raise FloorplanError(
            f"{path}: expected a picture (PNG, JPEG, TIFF), found a damaged or other file; "
            "open it in a viewer and save it again"
        ) from error
    return bgr, shrink


def _to_bgr(page: Image.Image) -> UInt8[np.ndarray, "h w 3"]:
    """Pixels of an RGB picture, strip by strip: Pillow copies what it hands over twice."""
    bgr = np.zeros((page.height, page.width, 3), np.uint8)
    for top in range(0, page.height, _STRIP_PX):
        bottom = min(top + _STRIP_PX, page.height)
        bgr[top:bottom] = np.asarray(page.crop((0, top, page.width, bottom)))[:, :, ::-1]
    return bgr


def load_wall_mask(path: Path, shape: tuple[int, ...], name: str) -> Bool[np.ndarray, "h w"]:
    """Where the user's picture of the walls of plan `name` is white, of the plan's `shape`.

    Raises:
        FloorplanError: it is missing, of another size, or all of one tone.
    """
    mask = load_picture(_existing(path))[0].mean(axis=2) > 127
    if mask.shape != shape:
        h, w = shape
        raise FloorplanError(
            f"{path}: expected a wall mask of the size of {name}, {w} x {h} px, "
            f"found {mask.shape[1]} x {mask.shape[0]}; resize it"
        )
    if not mask.any() or mask.all():
        raise FloorplanError(
            f"{path}: expected white where there is wall and black elsewhere, found one tone"
        )
    return mask


def _existing(path: Path) -> Path:
    if not path.exists():
        raise FloorplanError(f"{path}: expected a wall mask, found nothing; check the path")
    return path
