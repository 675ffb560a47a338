"""What `planfit.refine` runs on without a runtime: progress that is seen, a cache where it is asked for."""

import sys
from pathlib import Path

import pytest

import planfit
from planfit.errors import OptionError
from planfit.pipeline import given as module
from planfit.pipeline.given import running


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What was told to compile."""
    told: list[object] = []
    monkeypatch.setattr(module, "compile_what_is_not_ready", told.append)
    return told


@pytest.mark.parametrize("where", ["terminal", "notebook"])
def test_one_line_is_written_over_and_goes(
    where: str,
    compiled: list[object],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if where == "terminal":
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    else:
        monkeypatch.setitem(sys.modules, "ipykernel", None)
    with running(None, None, True) as runtime:
        runtime.report("matching", 3, 60)
        runtime.report("validate", 0, 0)
    shown = capsys.readouterr().err
    assert "\n" not in shown
    lines = [line.strip() for line in shown.split("\r") if line]
    assert lines == ["planfit: matching 3/60", "planfit: validate", ""]
    assert len(compiled) == 1


@pytest.mark.parametrize("is_terminal", [True, False])
def test_nothing_is_said_where_nobody_wants_or_sees_it(
    is_terminal: bool,
    compiled: list[object],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal, raising=False)
    with running(None, None, not is_terminal) as runtime:
        runtime.report("matching", 3, 60)
    assert capsys.readouterr().err.strip() == ""
    assert compiled == []


def test_a_cache_is_kept_where_it_is_asked_for(tmp_path: Path) -> None:
    with running(None, tmp_path, True) as runtime:
        assert runtime.cache_dir == tmp_path
    given = planfit.Runtime(1)
    with running(given, None, True) as runtime:
        assert runtime is given
    with pytest.raises(OptionError, match="found both"), running(given, tmp_path, True):
        pass
