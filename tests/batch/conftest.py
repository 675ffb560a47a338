"""Modules of this folder can be started as processes of jobs."""

import os
from pathlib import Path

import pytest

from planfit.batch.ledger import Ledger


@pytest.fixture
def ledger(tmp_path, monkeypatch):
    """Of an empty batch, in a folder with a space and an umlaut."""
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    made = Ledger(tmp_path / "the öut")
    made.open()
    return made
