"""What docs/security.md promises: nothing that is read is run, and nobody is asked over the network."""

import ast
import io
import pickle
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from planfit.errors import FloorplanError, OutputError, ScanError
from planfit.export.write import MATCHES, read_matches
from planfit.floorplan import read_floorplan
from planfit.scan import read_scan
from scan_samples import make_sample, write_tum

SOURCES = sorted((Path(__file__).parents[1] / "src").rglob("*.py"))
NETWORK = {"urllib", "http", "requests", "socket", "ftplib", "smtplib", "httpx", "aiohttp", "ssl"}
CODE = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "code", "runpy"}
CALLS = {"eval", "exec", "compile", "__import__"}


class Trap:
    """Whoever unpickles it leaves a mark."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return (Path.touch, (self.mark,))


def trapped_npy(mark: Path) -> bytes:
    data = io.BytesIO()
    np.save(data, np.array([[Trap(mark)] * 4], dtype=object), allow_pickle=True)
    return data.getvalue()


def calls(tree: ast.AST) -> list[tuple[str, dict[str, object], int]]:
    """Dotted names that are called, with the constants among their keywords, and the lines."""
    return [
        (
            ast.unparse(node.func),
            {k.arg or "**": getattr(k.value, "value", None) for k in node.keywords},
            node.lineno,
        )
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
    ]


def faults_of(source: str) -> list[str]:
    """What a source file does that planfit promises never to do."""
    tree, found = ast.parse(source), []
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        # Text alone, and what listens and asks nobody.
        asks = [n for n in names if n not in ("urllib.parse", "http.server")]
        found += [f"imports {n}" for n in asks if n.split(".")[0] in NETWORK | CODE]
    for name, keywords, line in calls(tree):
        last = name.split(".")[-1]
        if name in CALLS or name in ("os.system", "os.popen"):
            found.append(f"{line}: {name}")
        if (
            last == "load"
            and name in ("np.load", "numpy.load")
            and keywords.get("allow_pickle") is not False
        ):
            found.append(f"{line}: np.load without allow_pickle=False")
        if name.endswith("torch.load") and keywords.get("weights_only") is not True:
            found.append(f"{line}: torch.load without weights_only")
        if last == "from_pretrained":
            if keywords.get("trust_remote_code") is not False:
                found.append(f"{line}: from_pretrained without trust_remote_code=False")
            if "model" in name.lower() and keywords.get("weights_only") is not True:
                found.append(f"{line}: a model without weights_only=True")
        if name.startswith("subprocess.") and keywords.get("shell"):
            found.append(f"{line}: a shell")
        if name in ("yaml.load", "yaml.unsafe_load"):
            found.append(f"{line}: {name}")
    return found


OWN_CODE = {"compiled/decorator.py": ["imports pickle"]}
"""It loads compiled code of the package itself, as Python does its own; it is given no path."""


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_no_source_runs_what_it_reads_or_asks_the_network(path: Path) -> None:
    allowed = OWN_CODE.get(f"{path.parent.name}/{path.name}", [])
    assert faults_of(path.read_text(encoding="utf-8")) == allowed


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from urllib.request import urlopen",
        "import numpy as np\nnp.load(f)",
        "import numpy as np\nnp.load(f, allow_pickle=True)",
        "torch.load(f)",
        "model_class.from_pretrained(x, trust_remote_code=False)",
        "AutoConfig.from_pretrained(x)",
        "eval(text)",
        "subprocess.run(x, shell=True)",
    ],
)
def test_the_search_finds_what_it_is_for(source: str) -> None:
    assert faults_of(source)


def test_a_pickle_in_a_plan_is_refused_and_not_run(tmp_path: Path) -> None:
    mark, plan = tmp_path / "mark", tmp_path / "plan.npy"
    plan.write_bytes(trapped_npy(mark))
    with pytest.raises(FloorplanError, match="expected a NumPy array of numbers"):
        read_floorplan(plan)
    plan.write_bytes(pickle.dumps(Trap(mark)))
    with pytest.raises(FloorplanError):
        read_floorplan(plan)
    assert not mark.exists()
    np.load(io.BytesIO(trapped_npy(mark)), allow_pickle=True)
    assert mark.exists(), "the trap itself works"


def test_a_pickle_in_a_scan_or_a_run_is_refused_and_not_run(tmp_path: Path) -> None:
    mark, scan = tmp_path / "mark", tmp_path / "scan"
    write_tum(scan, make_sample())
    (frame,) = sorted((scan / "depth").iterdir())[:1]
    frame.write_bytes(trapped_npy(mark))
    with pytest.raises(ScanError):
        read_scan(scan).files.depth(0)
    np.savez(tmp_path / MATCHES, pairs=np.array([Trap(mark)], dtype=object))
    with pytest.raises(OutputError, match="allow_pickle=False"):
        read_matches(tmp_path)
    assert not mark.exists()


def test_reading_and_refusing_ask_nobody(small_room: Path, tmp_path: Path) -> None:
    """In a process where every socket is an error."""
    code = f"""
import socket
def refuse(*_, **__):
    raise AssertionError("asked the network")
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
from planfit.cli import run
assert run(["inspect", {str(small_room)!r}]) == 0
assert run(["plan", {str(small_room / "floorplan.png")!r}, "-o", {str(tmp_path / "plan.png")!r}]) == 0
assert run(["doctor"]) in (0, 1)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def small_room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan with a picture of a plan."""
    folder = tmp_path_factory.mktemp("room") / "scan"
    write_tum(folder, make_sample())
    picture = np.full((300, 400), 255, np.uint8)
    cv2.rectangle(picture, (40, 40), (360, 260), 0, 6)
    cv2.imwrite(str(folder / "floorplan.png"), picture)
    return folder


def test_one_source_alone_listens() -> None:
    """That of `planfit view`, which tests/test_viewer.py holds to this machine."""
    listening = [path for path in SOURCES if "http.server" in path.read_text(encoding="utf-8")]
    assert [path.parent.name + "/" + path.name for path in listening] == ["viewer/server.py"]
