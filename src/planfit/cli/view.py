"""`planfit view`: a finished run on a local page, and corrections by hand."""

import os
import threading
import webbrowser
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tyro

from planfit.cli.arguments import Flat, PlanFlags, SurveyFlags
from planfit.cli.console import out
from planfit.cli.refine import HandChoice, refine_into
from planfit.cli.run_record import RunRecord, read_present_scan, read_record
from planfit.corrections import NO_CORRECTIONS, Corrections
from planfit.errors import FloorplanError, OptionError
from planfit.floorplan import Floorplan, read_floorplan
from planfit.pipeline.depth_unit import in_unit
from planfit.report.html.page import ReportOptions
from planfit.runtime import options_of
from planfit.runtime.run_folder import finished_record
from planfit.saving import RunInputs
from planfit.viewer import FILE, Session, ViewServer

_OF_TERMINAL = ("www-browser", "links", "elinks", "lynx", "w3m")
"""Browsers that Python takes where there is no display: they run no script, and take the terminal."""


@dataclass(frozen=True)
class ViewArguments:
    """Show a finished run on a page that only this machine reaches, correct it there by hand, and solve
    again."""

    folder: tyro.conf.Positional[Path]
    """Output folder of `planfit refine`; corrections are kept in its `corrections.toml`."""
    scan: Path | None = None
    """Where the scan is now, if it was moved."""
    plan: Path | None = None
    """Where the plan is now, if it was moved."""
    port: int = 0
    """Port of the page; 0 takes one that is free."""
    no_browser: tyro.conf.FlagCreatePairsOff[bool] = False
    """Do not open the page in a browser; its address is printed either way."""
    without_contradicted: tyro.conf.FlagCreatePairsOff[bool] = False
    """Leave out corrections that others or the scan contradict when solving again."""
    plan_flags: Flat[PlanFlags] = field(default_factory=PlanFlags)
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""


def view_command(arguments: ViewArguments) -> int:
    """Serve until Ctrl-C."""
    serve(open_session(arguments), arguments.port, arguments.no_browser)
    return 0


def serve(session: Session, port: int, no_browser: bool) -> None:
    """Print the address, open it in a browser where one is wanted, and serve until Ctrl-C.

    Raises:
        OptionError: the port is taken, or may not be used.
    """
    with ViewServer(session, port) as server:
        out.print(f"{server.address}", soft_wrap=True)
        out.print(f"corrections are kept in {session.path}; Ctrl-C ends", soft_wrap=True)
        if not no_browser:
            # Beside the server, which has to answer browsers that are waited for until they are closed.
            threading.Thread(target=_open, args=(server.address,), daemon=True).start()
        try:
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            told = (
                "a solve was stopped, the results before it are whole; "
                if session.is_solving
                else ""
            )
            out.print(f"ended; {told}corrections are in {session.path}", soft_wrap=True)


def open_session(arguments: ViewArguments) -> Session:
    """The run, its scan and its plan as the run read them.

    Raises:
        ScanError: the folder is not that of a run, or the scan is another.
        FloorplanError: the plan is another.
    """
    folder = arguments.folder
    record = read_record(folder)
    written = finished_record(folder)
    if written is None:
        raise OptionError(
            f"{folder}: expected a finished run, found files missing; run 'planfit refine' again"
        )
    path = arguments.scan or record.scan_path
    scan = read_present_scan(path, record.options.segmentation, record.scan_options)
    floorplan = _plan(arguments, record, written["inputs"].get("plan_fingerprint", ""))
    convention = written["options"]["poses_convention"]
    options = replace(record.options, poses_convention=convention)
    cache = written.get("cache")

    report = options_of(
        written.get("report_options") or {}, ReportOptions(), f"{folder / 'run.json'}: report."
    )

    def solve(corrections: Corrections) -> None:
        # As the run was made, surveyed points and report included: only corrections are to tell.
        flags = SurveyFlags.of_record(written["inputs"])
        chosen = options
        if corrections.places:
            # Places say which alignment is meant; the number of one counts among those found without them.
            chosen = replace(options, align=replace(options.align, candidate=1))
        inputs = RunInputs(
            scan, floorplan, chosen, record.scan_options, Path(cache) if cache else None, report,
            flags.inputs,
        )  # fmt: skip
        refine_into(
            folder,
            inputs,
            arguments.workers,
            # The scan may have been moved; the folder is that of this run.
            overwrite=True,
            survey=flags.read(scan, floorplan is not None),
            by_hand=HandChoice(corrections, arguments.without_contradicted),
        )

    if len(scan) != record.n_frames:
        raise OptionError(
            f"{scan.name}: expected the {record.n_frames} frames of the run, found {len(scan)}; give the "
            "run's own scan with --scan"
        )
    return Session(
        folder, in_unit(scan, record.depth_unit), floorplan, solve, _given(record, written)
    )


def _given(record: RunRecord, written: dict[str, Any]) -> Corrections:
    """Those of another file that the run was made with: they go on until the page's own file is there."""
    told = written.get("corrections")
    if not told or Path(told["file"]).resolve() == (record.folder / FILE).resolve():
        return NO_CORRECTIONS
    return Corrections(told["file"], record.corrections.entries)


def _plan(arguments: ViewArguments, record: RunRecord, fingerprint: str) -> Floorplan | None:
    """The plan as the run read it, before corrections."""
    path = arguments.plan or record.plan_path
    if record.plan_path is None or path is None:
        return None
    floorplan = read_floorplan(path, arguments.plan_flags.options)
    if floorplan.fingerprint != fingerprint:
        raise FloorplanError(
            f"{path}: expected the plan as the run read it, found another, or other flags; give the same "
            "plan, unit and storey as to 'planfit refine'"
        )
    return floorplan


def _open(address: str) -> None:
    """In a browser, and say so where there is none."""
    try:
        name = getattr(webbrowser.get(), "name", "")
        is_open = Path(str(name)).name not in _OF_TERMINAL and webbrowser.open(address)
    except (webbrowser.Error, OSError):
        is_open = False
    if not is_open:
        out.print("no browser was found to open it: open the address above in one")
