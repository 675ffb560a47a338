"""Scans as people have them (PLANFIT_SHARED): each is read as its maker's notes say it is right."""

import os
from pathlib import Path

import numpy as np
import pytest

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from planfit.scan.statistics import path_statistics

REAL = (
    Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
    / "field/scans"
)
pytestmark = pytest.mark.skipif(
    not REAL.is_dir(), reason="no scans of others: set PLANFIT_SHARED to their folder"
)
COMMAS = "decimal-comma-trajectory"


def read(path, poses="", **options):
    poses_path = REAL / poses if poses else None
    return read_scan(REAL / path, options=ScanOptions(poses=poses_path, **options))


@pytest.mark.parametrize("kind", ["space.txt", "tab.txt", "semicolon.csv", "kitti.txt"])
def test_decimal_commas_are_read(kind):
    scan = read(COMMAS, f"{COMMAS}/poses_{kind}")
    np.testing.assert_allclose(scan.world_from_cams, read(COMMAS).world_from_cams, atol=1e-5)
