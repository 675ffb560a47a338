"""What the page asks for and does: the state of a run folder, its corrections, a solve in the background.

There is no state but that of the files: each change is read from and written to OUT/corrections.toml, so that
a page that is closed, a browser that dies and a file that is changed by hand meanwhile lose nothing.
"""

import io
import json
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock
from PIL import Image

from planfit.corrections import (
    NO_CORRECTIONS,
    Corrections,
    Place,
    read_corrections,
    write_corrections,
)
from planfit.corrections.file import corrections_of
from planfit.errors import OptionError, OutputError, PlanfitError
from planfit.floorplan import Floorplan
from planfit.floorplan.edits import faces_at
from planfit.geometry import segments
from planfit.report.make_scene import depth_in_grey
from planfit.runtime.run_folder import finished_record
from planfit.scan import Scan
from planfit.scan.statistics import lift_pixel
from planfit.units import Units, asked, in_units, told_in
from planfit.viewer.points import NOTE, PickedPoints, at_rim, is_dragged, to_drag

FILE = "corrections.toml"
_QUALITY = 88
_MAX_VISITS = 500

Solve = Callable[[Corrections], None]
"""Refines once more with corrections, into the folder of the run."""


@dataclass
class Session:
    """A run folder that is looked at; safe to use from several threads."""

    folder: Path
    scan: Scan
    floorplan: Floorplan | None
    """As read, before corrections; None where the run had none."""
    solve: Solve
    given: Corrections = NO_CORRECTIONS
    """Corrections that hold where the folder has no file of them."""
    units: Units = field(default_factory=asked)
    """That lengths are told in, in the page and by solves."""
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _thread: threading.Thread | None = None
    _failed: str = ""
    _before: dict[str, Any] | None = None
    """What the run before the last solve said of itself."""
    _points: PickedPoints = field(init=False)

    def __post_init__(self) -> None:
        self._points = PickedPoints(self.scan, self.floorplan)

    @property
    def path(self) -> Path:
        """The file of corrections."""
        return self.folder / FILE

    @property
    def is_solving(self) -> bool:
        """Whether a solve is on."""
        return self._thread is not None and self._thread.is_alive()

    def corrections(self) -> Corrections:
        """Those of the file, which may have been changed by hand; where there is none, those given.

        Raises:
            OptionError: the file is damaged.
        """
        return read_corrections(self.path) if self.path.exists() else self.given

    def state(self) -> dict[str, Any]:
        """All that the page shows beside the report, as plain values."""
        record = self._record()
        told = record.get("corrections") or {}
        came_to = {(each["kind"], each["number"]): each for each in told.get("used", [])}
        failed = self._failed
        try:
            given = self.corrections()
        except OptionError as error:
            given, failed = NO_CORRECTIONS, str(error)
        # What an entry came to is told only where the run was made with this very entry.
        rows = []
        for each in given:
            ran = came_to.get((each.kind, each.number), {})
            if ran.get("words") != each.words:
                ran = {}
            rows.append(
                {
                    "kind": each.kind,
                    "number": each.number,
                    "words": each.words,
                    "note": each.note,
                    "is_solved": bool(ran),
                    "residual_m": ran.get("residual_m"),
                    "contradicted": ran.get("contradicted"),
                    "mark": self._points.mark(each, record) if isinstance(each, Place) else None,
                }
            )
        return {
            "frames": len(self.scan),
            "corrections": rows,
            "left_out": told.get("left_out", []),
            "visits": _visits(record),
            "disagreements": self._disagreements(record),
            "solving": self.is_solving,
            "failed": failed,
            "changed": self._changed(record),
            "verdict": (record.get("verdict") or {}).get("outcome", ""),
        }

    def plan(self) -> dict[str, Any]:
        """Faces of the plan in the coordinates at the rim of its picture, and the refined path on it."""
        if self.floorplan is None:
            return {"faces": [], "path": [], "is_picture": False}
        faces = segments.moved(self.floorplan.ends, self.floorplan.source.rim_from_plan)
        path = np.zeros((0, 2))
        if (self.folder / "trajectory.tum").exists():
            rows = np.loadtxt(self.folder / "trajectory.tum", ndmin=2)
            path = at_rim(self.floorplan, rows[:, 1:3], self._record())
        return {
            "faces": np.round(faces, 4).tolist(),
            "path": np.round(path, 3).tolist(),
            "is_picture": self.floorplan.source.is_picture,
        }

    def shape(self) -> dict[str, Any]:
        """The scan from above where the run put it, for dragging it over the plan.

        Raises:
            OptionError: there is no plan, or the run is not finished.
            ScanError: its cloud is damaged.
        """
        record, path = self._record(), self.folder / "trajectory.tum"
        if self.floorplan is None or not record or not path.exists():
            raise OptionError("expected a finished run on a plan to drag, found none")
        positions = np.loadtxt(path, ndmin=2)[:, 1:4]
        return to_drag(self.folder, positions, self.floorplan, record)

    def place_dragged(self, pairs: Sequence[dict[str, Any]]) -> None:
        """Save where the scan was dragged to; where it was before is taken out. Pairs have `scan` and `plan`,
        as a place has.

        Raises:
            OptionError: they are not as they should be, or there is no plan.
        """
        tables = [{**pair, "note": NOTE} for pair in pairs]
        added = corrections_of({"place": tables}, "this correction")
        self._require_seen(added)
        with self._changing():
            kept = [
                each
                for each in self.corrections()
                if not (isinstance(each, Place) and is_dragged(each))
            ]
            self._write((*kept, *added.entries))

    def image(self, frame: int) -> bytes:
        """A frame's image at its own size, as JPEG; its depth in grey where it has no colour.

        Raises:
            OptionError: there is no such frame.
            ScanError: it cannot be read.
        """
        self._require_frame(frame)
        color = self.scan.files.color(frame)
        if color is None:
            color = depth_in_grey(self.scan.files.depth(frame))
        buffer = io.BytesIO()
        Image.fromarray(color).save(buffer, "JPEG", quality=_QUALITY)
        return buffer.getvalue()

    def pixel_of(self, frame: int, point_cam: Sequence[float]) -> dict[str, Any]:
        """The pixel of a frame that shows a point (m, the frame's axes) of the report's cloud.

        Raises:
            OptionError: there is no such frame, or the point lies at the edge of something.
        """
        self._require_frame(frame)
        return self._points.pixel_of(frame, point_cam, self._record())

    def add(self, kind: str, table: dict[str, Any]) -> None:
        """Add a correction, as a table of the file, and write the file.

        Raises:
            OptionError: it is not as it should be, or names what is not there.
            FloorplanError: there is no such wall.
        """
        added = corrections_of({kind: [table]}, "this correction")
        added.require_frames(len(self.scan))
        self._require_seen(added)
        with self._changing():
            given = self.corrections()
            self._write((*given.entries, *added.entries))

    def remove(self, kind: str, number: int, words: str) -> None:
        """Take a correction out, and write the file.

        Raises:
            OptionError: there is none of this number that says these words: the file was changed meanwhile.
        """
        with self._changing():
            given = self.corrections().entries
            left = [
                each
                for each in given
                if (each.kind, each.number, each.words) != (kind, number, words)
            ]
            if len(left) == len(given):
                raise OptionError(
                    f"{self.path}: expected {words!r}, found it no longer; the list was changed elsewhere"
                )
            self._write(tuple(left))

    def start_solve(self) -> None:
        """Solve again in the background.

        Raises:
            OptionError: a solve is on already, or the file is damaged.
        """
        with self._lock:
            if self.is_solving:
                raise OptionError("expected no solve on, found one; wait for it")
            corrections = self.corrections()
            self._before, self._failed = finished_record(self.folder), ""
            thread = threading.Thread(target=self._run, args=(corrections,), daemon=True)
            thread.start()
            self._thread = thread  # never one that has not begun, for who waits

    def wait(self, seconds: float | None = None) -> None:
        """Until a solve that is on has ended."""
        if self._thread is not None:
            self._thread.join(seconds)

    def _run(self, corrections: Corrections) -> None:
        try:
            with told_in(self.units):
                self.solve(corrections)
        except PlanfitError as error:
            self._failed = str(error)
        except Exception as error:  # a page that waits has to be told, whatever it was
            self._failed = f"{type(error).__name__}: {error}"

    def _record(self) -> dict[str, Any]:
        """What the run says of itself; while a solve is on, which writes it at last, what it said before."""
        record = self._before if self.is_solving else finished_record(self.folder)
        return record or {}

    def _disagreements(self, record: dict[str, Any]) -> list[dict[str, Any]]:
        """What contradicts what, in words, and the corrections that take it out."""
        found = []
        for each in (record.get("verdict") or {}).get("disagreements", []):
            item, correction = each["item"], None
            if item["kind"] == "loop":
                frames = [item["first_frames"], item["last_frames"]]
                correction = {"kind": "delete_loop", "entry": {"frames": frames}}
            elif item["kind"] == "wall" and self.floorplan is not None:
                drawn = np.array(item["ends"], dtype=float)
                ends = np.round(at_rim(self.floorplan, drawn, record), 4).tolist()
                correction = {"kind": "exclude_wall", "entry": {"ends": ends}}
            frames = [item[name][0] for name in ("first_frames", "last_frames") if item[name]]
            found.append({"words": each["words"], "frames": frames, "correction": correction})
        # A point is taken out in its own file, which other tools read too.
        of_points = (record.get("survey") or {}).get("contradicted", [])
        return found + [{"words": words, "frames": [], "correction": None} for words in of_points]

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """The file of corrections for this thread alone, and for this process: the folder may be open in two
        windows.

        Raises:
            OutputError: the folder cannot be written to.
        """
        lock = FileLock(self.path.with_name(f".{FILE}.lock"))
        try:
            lock.acquire()
        except OSError as error:
            raise OutputError(
                f"{self.path}: expected a file to write, found one that cannot be written ({error.strerror})"
                "; check the folder's rights"
            ) from error
        try:
            with self._lock:
                yield
        finally:
            lock.release()

    def _write(self, entries: tuple[Any, ...]) -> None:
        write_corrections(self.path, Corrections(str(self.path), entries))

    def _require_frame(self, frame: int) -> None:
        if not 0 <= frame < len(self.scan):
            raise OptionError(f"expected a frame from 0 to {len(self.scan) - 1}, found {frame}")

    def _require_seen(self, added: Corrections) -> None:
        """Refuse at once what a solve would refuse."""
        for place in added.places:
            if place.frame is not None and place.pixel is not None:
                lift_pixel(self.scan, place.frame, place.pixel)
        for loop in added.added:
            for frame, uv in zip(loop.frames, loop.pixels or (), strict=False):
                lift_pixel(self.scan, frame, uv)
        ends = np.concatenate([added.wall_ends("exclude_wall"), added.wall_ends("erase_wall")])
        if len(ends) and self.floorplan is not None:
            faces_at(self.floorplan, ends, "this correction")
        on_plan = [each for each in added if each.kind not in _OF_SCAN]
        if on_plan and self.floorplan is None:
            raise OptionError(f"{on_plan[0].kind}: expected a plan, found a run without one")

    def _changed(self, record: dict[str, Any]) -> list[list[str]]:
        """What the last solve changed: name, before, after."""
        if self._before is None or self.is_solving or not record:
            return []
        rows = []
        for name, of in _NUMBERS.items():
            before, after = of(self._before), of(record)
            if before != after:
                rows.append([name, before, after])
        return rows


_OF_SCAN = ("add_loop", "delete_loop", "exclude_frames")


def _metres(value: object) -> str:
    return in_units(value, ".3f") if isinstance(value, int | float) else "none"


_NUMBERS: dict[str, Callable[[dict[str, Any]], str]] = {
    "verdict": lambda r: str(r["verdict"]["outcome"]).replace("_", " "),
    "predicted error (RMS)": lambda r: _metres(r["verdict"]["predicted_error_rms_m"]),
    "wall explained by the plan": lambda r: (
        f"{r['alignment']['score']:.0%}" if r.get("alignment") else "none"
    ),
    "placed at": lambda r: "({}, {})".format(
        *(f"{r['plan_from_world_before'][k][3]:.2f}" for k in (0, 1))
    ),
    "matched pairs": lambda r: str(r["matches"]["pairs_verified"]),
    "loop closures": lambda r: str(r["matches"]["loop_closures"]),
    "keyframes": lambda r: str(r["keyframes"]),
    "wall faces": lambda r: str(r["plan_faces"]),
    "warnings": lambda r: str(len(r["warnings"])),
}
"""Of a record, what a correction is likely to change."""


def _visits(record: dict[str, Any]) -> list[dict[str, Any]]:
    """Loops as the run judged them, the worst first."""
    visits = (record.get("verdict") or {}).get("visits", [])
    return sorted(visits, key=lambda visit: -visit["after_m"])[:_MAX_VISITS]


def report_page(folder: Path) -> bytes:
    """The report of a run, UTF-8.

    Raises:
        OptionError: it is not there.
    """
    path = folder / "report.html"
    if not path.exists():
        raise OptionError(f"{path}: expected the report of a run, found none; run 'planfit refine'")
    return path.read_bytes()


def as_json(value: Any) -> bytes:
    """Plain values as JSON."""
    return json.dumps(value).encode()
