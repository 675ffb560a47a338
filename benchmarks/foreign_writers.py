"""Pages of primitives as SVG, DXF, PDF and PNG, each beside the way back to metres (FILE.json)."""

import itertools
import json
from pathlib import Path

import cv2
import ezdxf
import numpy as np
from foreign_pages import Fill, Label, Page, Stroke

PX_PER_M, MARGIN_M = 60.0, 1.0
POINTS_PER_M = 28.3465
"""1:100 on paper."""
SHIFT = 4


def write_page(page: Page, path: Path) -> Path:
    """Write a page in the format of the suffix."""
    low, high = page.bounds
    low, size = low - MARGIN_M, high - low + 2 * MARGIN_M
    write = {".svg": _svg, ".dxf": _dxf, ".pdf": _pdf, ".png": _png}[path.suffix]
    file_from_page = write(page, path, low, size)
    page_from_file = np.linalg.inv(file_from_page).tolist()
    path.with_suffix(path.suffix + ".json").write_text(json.dumps(page_from_file))
    return path


def _affine(scale: float, low: np.ndarray, size: np.ndarray, is_down: bool) -> np.ndarray:
    if is_down:
        return np.array(
            [[scale, 0, -scale * low[0]], [0, -scale, scale * (low[1] + size[1])], [0, 0, 1.0]]
        )
    return np.array([[scale, 0, -scale * low[0]], [0, scale, -scale * low[1]], [0, 0, 1.0]])


def _moved(points: np.ndarray, affine: np.ndarray) -> np.ndarray:
    return points @ affine[:2, :2].T + affine[:2, 2]


def _svg(page: Page, path: Path, low: np.ndarray, size: np.ndarray) -> np.ndarray:
    affine = _affine(PX_PER_M, low, size, is_down=True)
    width, height = PX_PER_M * size
    rows = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.1f} {height:.1f}" '
            f'width="{width:.1f}" height="{height:.1f}">']  # fmt: skip
    for part in page.parts:
        if isinstance(part, Label):
            x, y = _moved(part.xy, affine)
            size_px = PX_PER_M * part.height
            rows.append(
                f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size_px:.1f}">{part.text}</text>'
            )
            continue
        rings = part.rings if isinstance(part, Fill) else [part.points]
        data = " ".join(
            "M" + " L".join(f"{x:.2f},{y:.2f}" for x, y in _moved(ring, affine))
            + (" Z" if isinstance(part, Fill) else "")
            for ring in rings
        )  # fmt: skip
        colour = "#{:02x}{:02x}{:02x}".format(*part.colour)
        if isinstance(part, Fill):
            rows.append(f'<path d="{data}" fill="{colour}" fill-rule="evenodd" stroke="none"/>')
        else:
            dash = ' stroke-dasharray="6 4"' if part.is_dashed else ""
            wide = f'stroke="{colour}" stroke-width="{PX_PER_M * part.width:.2f}"{dash}'
            rows.append(f'<path d="{data}" fill="none" {wide}/>')
    path.write_text("\n".join([*rows, "</svg>"]))
    return affine


def _dxf(page: Page, path: Path, *_: np.ndarray) -> np.ndarray:
    """Metres, all on one layer, as drawings are that were converted from others."""
    document = ezdxf.new(setup=True)  # pyright: ignore[reportPrivateImportUsage]
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    for part in page.parts:
        if isinstance(part, Label):
            space.add_text(part.text, height=part.height).set_placement(tuple(part.xy))
        elif isinstance(part, Fill):
            hatch = space.add_hatch()
            hatch.rgb = part.colour
            for ring in part.rings:
                hatch.paths.add_polyline_path([tuple(p) for p in ring], is_closed=True)
        else:
            wide = part.width if part.width >= 0.05 else 0.0
            line = space.add_lwpolyline([tuple(p) for p in part.points])
            line.dxf.const_width = wide
            line.rgb = part.colour
            line.dxf.linetype = "DASHED" if part.is_dashed else "CONTINUOUS"
    document.saveas(path)
    return np.eye(3)


def _pdf(page: Page, path: Path, low: np.ndarray, size: np.ndarray) -> np.ndarray:
    affine = _affine(POINTS_PER_M, low, size, is_down=False)
    rows = []
    for part in page.parts:
        if isinstance(part, Label):
            x, y = _moved(part.xy, affine)
            rows.append(
                f"0 g BT /F1 {POINTS_PER_M * part.height:.1f} Tf {x:.2f} {y:.2f} Td ({part.text}) Tj ET"
            )
            continue
        rings = part.rings if isinstance(part, Fill) else [part.points]
        for ring in rings:
            (x, y), *rest = _moved(ring, affine)
            rows.append(f"{x:.3f} {y:.3f} m " + " ".join(f"{x:.3f} {y:.3f} l" for x, y in rest))
        red, green, blue = np.array(part.colour) / 255
        if isinstance(part, Fill):
            rows.append(f"{red:.3f} {green:.3f} {blue:.3f} rg f*")
        else:
            dash = "[3 2] 0 d" if part.is_dashed else "[] 0 d"
            wide = POINTS_PER_M * part.width
            rows.insert(len(rows) - 1, f"{dash} {wide:.3f} w {red:.3f} {green:.3f} {blue:.3f} RG")
            rows.append("S")
    _write_pdf(path, "\n".join(rows), POINTS_PER_M * size)
    return affine


def _write_pdf(path: Path, content: str, size_pt: np.ndarray) -> None:
    """The least PDF of one page."""
    stream = content.encode()
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        (
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size_pt[0]:.2f} {size_pt[1]:.2f}] "
            "/Contents 4 0 R /Resources << /Font << /F1 5 0 R >> >> >>"
        ).encode(),
        b"<< /Length %d >>\nstream\n" % len(stream) + stream + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    data, offsets = b"%PDF-1.4\n", []
    for i, body in enumerate(objects, 1):
        offsets.append(len(data))
        data += b"%d 0 obj\n" % i + body + b"\nendobj\n"
    table = b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    head = b"xref\n0 6\n0000000000 65535 f \n"
    tail = b"trailer << /Size 6 /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % len(data)
    path.write_bytes(data + head + table + tail)


def _png(page: Page, path: Path, low: np.ndarray, size: np.ndarray) -> np.ndarray:
    affine = _affine(PX_PER_M, low, size, is_down=True)
    width, height = np.ceil(PX_PER_M * size).astype(int)
    image = np.full((height, width, 3), 255, np.uint8)
    for part in page.parts:
        if isinstance(part, Label):
            x, y = np.round(_moved(part.xy, affine)).astype(int)
            scale = PX_PER_M * part.height / 22
            cv2.putText(
                image, part.text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, (0, 0, 0), 1, cv2.LINE_AA
            )
            continue
        if isinstance(part, Fill):
            rings = [_fixed(_moved(r, affine)) for r in part.rings]
            cv2.fillPoly(image, rings, part.colour[::-1], cv2.LINE_AA, SHIFT)
        else:
            wide = max(round(PX_PER_M * part.width), 1)
            _stroke(image, _moved(part.points, affine), part, wide)
    cv2.imwrite(str(path), image)
    return affine


def _stroke(image: np.ndarray, points: np.ndarray, part: Stroke, wide: int) -> None:
    if part.is_dashed:
        for a, b in itertools.pairwise(points):
            n = max(int(np.hypot(*(b - a)) / 10), 1)
            for k in range(n):
                ends = np.array([a + (b - a) * k / n, a + (b - a) * (k + 0.6) / n])
                cv2.polylines(
                    image, [_fixed(ends)], False, part.colour[::-1], wide, cv2.LINE_AA, SHIFT
                )
    else:
        cv2.polylines(image, [_fixed(points)], False, part.colour[::-1], wide, cv2.LINE_AA, SHIFT)


def _fixed(points: np.ndarray) -> np.ndarray:
    return np.round((points - 0.5) * 2**SHIFT).astype(np.int32)
