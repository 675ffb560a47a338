"""Where a disk is full or a process stopped, nothing half stays, and what was there before is as it was."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from planfit.cli import run
from planfit.errors import OutputError
from planfit.runtime import whole_file, whole_folder, write_whole
from planfit.synth import write_facap

resource = pytest.importorskip("resource", reason="limits of files are those of Unix")


@contextmanager
def full_disk(max_bytes: int) -> Iterator[None]:
    """No file grows beyond so many bytes: the system then says so in the middle of writing."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (max_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def test_a_file_is_there_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file.txt"
    with whole_file(path) as part:
        part.write_text("all of it")
        assert not path.exists()
    assert path.read_text() == "all of it"
    write_whole(path, "ä")
    assert [p.read_bytes() for p in path.parent.iterdir()] == ["ä".encode()]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_an_error_leaves_what_was_there(error: BaseException, tmp_path: Path) -> None:
    path, folder = tmp_path / "file.txt", tmp_path / "folder"
    path.write_text("old")
    expected = OutputError if isinstance(error, OSError) else type(error)

    def fail(part: Path) -> None:
        part.write_text("half")
        raise error

    with pytest.raises(expected), whole_file(path) as part:
        fail(part)
    with pytest.raises(expected), whole_folder(folder) as part:
        fail(part / "file")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"file.txt": "old"}


def test_errors_of_files_that_are_read_meanwhile_are_their_own(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="other"), whole_file(tmp_path / "file"):
        (tmp_path / "other").read_text()


def test_the_line_names_the_file_and_what_to_do(tmp_path: Path) -> None:
    with full_disk(100), pytest.raises(OutputError) as told:
        write_whole(tmp_path / "file.txt", bytes(10_000))
    advice = "free disk space or choose another place"
    path = tmp_path / "file.txt"
    assert str(told.value) == f"{path}: cannot be written (File too large); {advice}"
    assert not list(tmp_path.iterdir())


def test_a_folder_takes_the_place_of_an_empty_one_with_usual_rights(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    folder = tmp_path / "folder"
    folder.mkdir()
    with whole_folder(folder) as part:
        (part / "file").touch()
    assert [p.name for p in folder.iterdir()] == ["file"]
    assert folder.stat().st_mode & 0o777 == 0o755


def refused(words: list[object], capsys: pytest.CaptureFixture[str]) -> str:
    with full_disk(1000):
        assert run([str(word) for word in words]) == 2
    (line,) = [one for one in capsys.readouterr().err.splitlines() if one.startswith("planfit: ")]
    assert "None" not in line
    return line


@pytest.mark.parametrize("suffix", ["png", "svg", "dxf", "json"])
def test_plan_leaves_nothing_cut_on_a_full_disk(
    suffix: str, small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / f"plan.{suffix}"
    target.write_text("old")
    line = refused(["plan", small_scan / "floorplan.npy", "-o", target], capsys)
    assert line.startswith(
        f"planfit: {target}: cannot be written (File too large); free disk space"
    )
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {target.name: "old"}


@pytest.mark.parametrize("kind", ["tum", "ply", "g2o", "open3d", "colmap", "nerfstudio"])
def test_export_leaves_nothing_on_a_full_disk(
    kind: str, small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / ("poses.log" if kind == "open3d" else "poses")
    line = refused(["export", small_scan, "--to", kind, "-o", target], capsys)
    assert str(target) in line
    assert not list(tmp_path.iterdir())


def test_inspect_and_synth_leave_nothing_on_a_full_disk(
    small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["inspect", small_scan, "-o", tmp_path / "view.png"], capsys)
    small = ["--walk.n-frames", 2, "--camera.width-px", 64, "--camera.height-px", 48]
    line = refused(["synth", tmp_path / "scan", *small, "--building.n-rooms", 1], capsys)
    assert line.startswith(f"planfit: {tmp_path / 'scan'}: cannot be written")
    assert not list(tmp_path.iterdir())


def test_half_a_synthetic_scan_is_none(tmp_path: Path) -> None:
    from planfit.synth import CameraOptions, SynthOptions, WalkOptions, make_scan

    synthetic = make_scan(SynthOptions(walk=WalkOptions(n_frames=3), camera=CameraOptions(64, 48)))

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_facap(tmp_path / "scan", synthetic, stop)
    assert not list(tmp_path.iterdir())
