"""`planfit doctor`: whether this installation works, in a form to be put into a report of a fault.

It starts where libraries are missing or broken: nothing but the standard library is imported until a check
needs it, and each check says what it came across.
"""

import argparse
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, distributions, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

from planfit import __version__
from planfit.errors import OptionError, PlanfitError, printable

EXTRAS = {
    "fast": ("MKL's sparse solver", ("pypardiso",)),
    "ifc": ("plans out of building models", ("ifcopenshell",)),
    "usd": ("rooms of RoomPlan as USDZ", ("pxr",)),
    "video": ("scans whose colour is a video", ("av",)),
    "bag": ("ROS 1 and 2 bags, MCAP", ("rosbags",)),
    "rerun": ("recordings of Rerun", ("rerun",)),
    "laser": ("clouds of laser scanners: LAS, LAZ, E57", ("laspy", "lazrs", "pye57")),
    "record3d": ("depth of Record3D", ("liblzfse", "OpenEXR")),
    "map": ("meshes of a scan", ("open3d",)),
    "torch": ("the paper's solver", ("torch",)),
    "cluster": ("batches on a cluster of dask", ("distributed",)),
    "remote": ("scans and plans at s3:// and https:// addresses", ("fsspec", "s3fs", "aiohttp")),
    "learned": ("labels, keypoints and matches by models", ("onnxruntime", "torch", "transformers")),
}  # fmt: skip
"""What each extra is for, and the modules that it brings."""
_OPTIONAL = "extras, none of which must be there"
_MIN_FREE_GB = 1.0
"""A run of a few hundred frames leaves some hundred megabytes."""
_FREE_SHARE = 0.01
"""Of the disturbance, that the self-test may leave."""


@dataclass(frozen=True)
class DoctorArguments:
    """Check this installation: versions, extras and what each is for, threads, GPU, cache, disk, a self-test
    of two seconds. Exit code 1 where something that planfit needs is broken."""

    json: bool = False
    """Print all of it as JSON."""
    folder: Path = Path()
    """Where results would go: its disk is looked at."""
    cache: Path | None = None
    """A cache that runs share (`--cache` of refine and align): its size is told."""
    compile: bool = False
    """First compile all kernels into the installation, which otherwise happens during the first runs of each
    user: one to two minutes of CPU time. Needs the right to write there."""

    @staticmethod
    def from_words(words: Sequence[str]) -> "DoctorArguments":
        """Arguments of the words of a command line, which are known flags.

        Raises:
            OptionError: a flag has no value behind it, or a word belongs to none.
        """
        parser = _Parser("planfit doctor", allow_abbrev=False)
        for switch in ("--json", "--compile"):
            parser.add_argument(switch, action=argparse.BooleanOptionalAction, default=False)
        parser.add_argument("--folder", type=Path, default=Path())
        parser.add_argument("--cache", type=Path)
        return DoctorArguments(**vars(parser.parse_args(words)))


class _Parser(argparse.ArgumentParser):
    """Python's own, as others may be missing."""

    def error(self, message: str) -> NoReturn:
        """Instead of usage and exit."""
        raise OptionError(f"doctor: {message}; 'planfit doctor --help' tells more")


@dataclass(frozen=True)
class CheckedPart:
    """What one check found."""

    group: str
    name: str
    found: str
    fault: str = ""
    """What is broken and what to do, where planfit cannot work so."""


def doctor_command(arguments: DoctorArguments) -> int:
    """Check, print. Exit code 1 where something that is needed is broken.

    Raises:
        OutputError: kernels were to be compiled and cannot be.
    """
    if arguments.compile:
        package = import_module("planfit.compiled.decorator").READY
        print("compiling kernels takes a minute or two", file=sys.stderr, flush=True)
        import_module("planfit.compiled.making").make_ready(package)
    findings = [
        *_system(),
        *_dependencies(),
        _kernels(),
        *_extras(),
        _gpu(),
        *_disk(arguments.folder, arguments.cache),
        _self_test(),
    ]
    faults = [finding for finding in findings if finding.fault]
    if arguments.json:
        record: dict[str, Any] = {"planfit": __version__, "works": not faults}
        print(json.dumps(record | {"findings": [asdict(each) for each in findings]}, indent=1))
    else:
        _tell(findings)
    return 1 if faults else 0


def _tell(findings: list[CheckedPart]) -> None:
    width = max(len(each.name) for each in findings)
    group = ""
    for each in findings:
        if each.group != group:
            group = each.group
            print(f"\n{group}" if each is not findings[0] else group)
        mark = "!!" if each.fault else "  "
        print(printable(f"{mark}{each.name:<{width}}  {each.found}"))
    faults = [f"{each.name}: {each.fault}" for each in findings if each.fault]
    print()
    print("\n".join(map(printable, faults)) if faults else "all that planfit needs works")


def _system() -> list[CheckedPart]:
    threads = os.environ.get("OMP_NUM_THREADS") or os.environ.get("NUMBA_NUM_THREADS")
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    limit = f"; limited to {threads} by the environment" if threads else ""
    old = sys.version_info < (3, 11)
    return [
        CheckedPart("system", "planfit", f"{__version__}, {Path(__file__).parents[1]}"),
        CheckedPart(
            "system",
            "Python",
            f"{platform.python_version()}, {sys.executable}",
            "expected 3.11 or newer; make an environment with one" if old else "",
        ),
        CheckedPart("system", "machine", f"{platform.platform()}, {platform.machine()}"),
        CheckedPart("system", "threads", f"{usable} usable of {os.cpu_count()}{limit}"),
        CheckedPart("system", "memory", _memory()),
    ]


def _memory() -> str:
    try:
        pages, size = os.sysconf("SC_PHYS_PAGES"), os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return "not known on this system"
    return f"{pages * size / 2**30:.1f} GB"


def _dependencies() -> list[CheckedPart]:
    """Each library that planfit needs: its version, and whether it can be imported."""
    try:
        lines = requires("planfit") or []
    except PackageNotFoundError:  # planfit runs from its sources alone
        lines = []
    found = [_dependency(line) for line in lines if "extra ==" not in line]
    doubled = [d.metadata["Name"] for d in distributions() if _is_opencv(d.metadata["Name"])]
    if len(set(doubled)) > 1:
        fault = f"they share a folder and spoil each other: pip uninstall {' '.join(sorted(set(doubled)))}, "
        words = f"{fault}then install one again"
        found.append(CheckedPart("libraries", "OpenCV", ", ".join(doubled), words))
    return [finding for finding in found if finding is not None]


def _is_opencv(name: str | None) -> bool:
    return (name or "").lower().replace("_", "-").startswith("opencv-")


def _dependency(line: str) -> CheckedPart | None:
    """A library by a line of requirements; None where the line is for other machines."""
    try:
        requirement = import_module("packaging.requirements").Requirement(line)
    except ImportError:  # it may be missing too
        requirement = None
    if requirement and requirement.marker and not requirement.marker.evaluate():
        return None
    name = re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0]
    try:
        found = version(name)
    except PackageNotFoundError:
        found = "not registered"
    fault = ""
    try:
        import_module("cv2" if _is_opencv(name) else {"pillow": "PIL"}.get(name, name))
    # A library that is broken may raise anything, an OSError of the loader or a SystemError among them.
    except Exception as error:
        fault = f"cannot be imported ({_reason(error)}); pip install --force-reinstall {name}"
    if not fault and requirement and not requirement.specifier.contains(found, True):
        fault = f"expected {line.split(';')[0].removeprefix(name).strip()}; "
        fault += f"pip install --upgrade '{line}'"
    return CheckedPart("libraries", name, found, fault)


def _reason(error: Exception) -> str:
    """What a library raised, on one line."""
    return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"


def _kernels() -> CheckedPart:
    """Whether compiled loops are ready in the installation. They need not be: numba compiles what is not."""
    later = "compiled in front of a first run, one to two minutes of CPU time in all"
    try:
        decorator = import_module("planfit.compiled.decorator")
        ready = decorator.usable(decorator.READY)
    except Exception as error:  # of numba; that it is broken stands in its own line
        return CheckedPart("libraries", "kernels", f"not known ({type(error).__name__})")
    if isinstance(ready, str):
        words = f"none ready: {ready}; each is {later}, or now by planfit doctor --compile"
        return CheckedPart("libraries", "kernels", words)
    spoilt = sum(ready.blob(line) is None for line in ready.places)
    words = f"{len(ready.places)} ready, compiled ahead for {ready.made.cpu}"
    words += f"; {spoilt} of them spoilt: each is {later}" if spoilt else ""
    return CheckedPart("libraries", "kernels", words)


def _extras() -> list[CheckedPart]:
    """Whether the modules of each extra are there; they are looked for, not imported, which takes seconds."""
    found = []
    for extra, (purpose, modules) in EXTRAS.items():
        absent = [module for module in modules if find_spec(module) is None]
        state, advice = "installed", ""
        if absent:
            state = f"in part, without {', '.join(absent)}"
            state = state if len(absent) < len(modules) else "not installed"
            advice = f"; pip install 'planfit[{extra}]'"
        found.append(CheckedPart(_OPTIONAL, extra, f"{state}: {purpose}{advice}"))
    return found


def _gpu() -> CheckedPart:
    """Of torch: nothing else of planfit runs on one."""
    words = "not used: only models of planfit[learned] and planfit[torch] run on one"
    if find_spec("torch") is not None:
        try:
            torch = import_module("torch")
            words = "none that torch can use"
            if torch.cuda.is_available():
                words = f"{torch.cuda.get_device_name(0)}, by torch {torch.__version__}"
        except Exception as error:
            words = f"torch cannot be imported ({type(error).__name__}: {str(error)[:100]})"
    return CheckedPart(_OPTIONAL, "GPU", words)


def _disk(folder: Path, cache: Path | None) -> list[CheckedPart]:
    rows = []
    try:
        present = next(
            path for path in (folder.resolve(), *folder.resolve().parents) if path.exists()
        )
        free_gb = shutil.disk_usage(present).free / 1e9
        with tempfile.TemporaryDirectory(dir=present, prefix=".planfit-doctor-"):
            pass
        fault = (
            "less than 1 GB: free some, or choose another with -o" if free_gb < _MIN_FREE_GB else ""
        )
        rows.append(
            CheckedPart("disk", "free for results", f"{free_gb:.1f} GB in {present}", fault)
        )
    except OSError as error:
        fault = f"cannot be written ({error.strerror}); choose another folder with -o"
        rows.append(CheckedPart("disk", "free for results", str(folder), fault))
    words = "each run keeps its own in OUT/cache; --cache DIR is shared between runs"
    if cache is not None:
        sizes = [path.stat().st_size for path in cache.rglob("*") if path.is_file()]
        words = f"{cache}: {len(sizes)} files, {sum(sizes) / 1e6:.1f} MB"
        words += "" if cache.is_dir() else ", not there yet"
    return [*rows, CheckedPart("disk", "cache", words)]


def _self_test() -> CheckedPart:
    """Nine cameras on a ring, disturbed, are brought back by the motions between them."""
    begin = time.perf_counter()
    try:
        left, disturbed = _solve_tiny_problem()
    except PlanfitError as error:
        return CheckedPart("self-test", "solver", "failed", str(error))
    except Exception as error:  # whatever a broken library raises
        return CheckedPart(
            "self-test", "solver", "failed", f"{_reason(error)}; see the libraries above"
        )
    seconds = time.perf_counter() - begin
    words = f"{1000 * disturbed:.0f} mm off before, {1000 * left:.2g} mm after, in {seconds:.1f} s"
    is_right = left < _FREE_SHARE * disturbed
    fault = "" if is_right else "expected the true poses, found others; reinstall planfit"
    return CheckedPart("self-test", "solver", words, fault)


def _solve_tiny_problem() -> tuple[float, float]:
    """Largest error of a camera's position after and before, m."""
    import numpy as np

    from planfit.geometry import se3
    from planfit.lsq import BetweenTerm, PosePriorTerm, Problem

    rng = np.random.default_rng(0)
    yaw = np.linspace(0, 2 * np.pi, 9)
    turns = se3.exp_so3(yaw[:, None] * [0.0, 0.0, 1.0])
    true_poses = se3.make_transform(turns, 2 * turns[:, :, 0])
    pairs = np.array([(i, i + 1) for i in range(8)] + [(0, 8), (0, 4), (2, 6)])
    steps = se3.inverse(true_poses[pairs[:, 0]]) @ true_poses[pairs[:, 1]]
    poses = se3.retract(true_poses, 0.05 * rng.normal(size=(9, 6)))
    poses[0] = true_poses[0]
    information = np.tile(np.eye(6) * 1e4, (len(pairs), 1, 1))
    problem = Problem(
        [
            BetweenTerm(pairs, steps, information=information),
            PosePriorTerm(np.array([0]), true_poses[:1], np.full(6, 0.001)),
        ],
        poses,
    )
    solved = problem.solve().target_from_cams
    errors = [
        float(np.linalg.norm((each - true_poses)[:, :3, 3], axis=1).max())
        for each in (solved, poses)
    ]
    return errors[0], errors[1]
