"""Rows in a file: the same numbers as in memory, and memory that comes back when they are let go."""

import gc
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planfit.errors import OutputError
from planfit.runtime import mapped
from planfit.runtime.mapped import (
    changed,
    concatenated,
    for_kernels,
    is_mapped,
    let_go,
    map_rows,
    row_parts,
)

FLOAT32 = np.dtype(np.float32)
needs_maps = pytest.mark.skipif(not mapped.CAN_LET_GO, reason="maps take no advice here")


@pytest.fixture
def parts(rng):
    return [rng.normal(size=(k, 3)).astype(np.float32) for k in (70_000, 1, 0, 333_333, 12_345)]


@pytest.fixture
def whole(parts):
    return np.concatenate(parts)


@pytest.fixture
def rows(parts, whole, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return map_rows(iter(parts), whole.shape, FLOAT32)


def resident_bytes():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@needs_maps
def test_rows_are_those_of_the_parts_however_they_are_let_go(rows, whole):
    assert is_mapped(rows)
    assert is_mapped(rows[5:7])
    assert_array_equal(rows, whole)
    for first in range(0, len(rows), 1000):
        own = slice(first, first + 1000)
        assert_array_equal(rows[own], whole[own])
        let_go(rows[own])
    let_go(rows)
    assert_array_equal(rows, whole)
    assert_array_equal(np.concatenate(list(row_parts(rows))), whole)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's process table")
@needs_maps
def test_a_pass_in_parts_takes_the_memory_of_a_part(rows):
    let_go(rows)
    before = resident_bytes()
    sums = [float(part.sum()) for part in row_parts(rows)]
    passed = resident_bytes() - before
    rows.sum()
    looked_at = resident_bytes() - before
    let_go(rows)
    assert len(sums) > 5
    assert passed < 0.2 * rows.nbytes
    assert looked_at > 0.8 * rows.nbytes  # else the test would measure nothing
    assert resident_bytes() - before < 0.2 * rows.nbytes


@needs_maps
def test_nobody_can_write_what_would_be_lost(rows):
    with pytest.raises(ValueError, match="read-only"):
        rows[0] = 1.0


@needs_maps
def test_kernels_are_given_the_same_rows_of_the_type_that_they_are_compiled_for(rows, whole):
    given = for_kernels(rows[7:100])
    assert given.flags.writeable
    assert given.flags.c_contiguous
    assert type(given) is np.ndarray
    assert_array_equal(given, whole[7:100])
    assert for_kernels(whole) is whole


@needs_maps
def test_the_file_goes_with_the_last_array(parts, whole, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    part = map_rows(iter(parts), whole.shape, FLOAT32)[:10]
    assert len(list(tmp_path.iterdir())) == 1
    assert_array_equal(part, whole[:10])
    del part
    gc.collect()
    assert not list(tmp_path.iterdir())


@needs_maps
def test_rows_made_of_mapped_ones_are_mapped(rows, whole):
    both = concatenated([rows, whole[:5]])
    assert is_mapped(both)
    assert_array_equal(both, np.concatenate([whole, whole[:5]]))
    twice = changed(rows, lambda part: 2 * part)
    assert is_mapped(twice)
    assert_array_equal(twice, 2 * whole)


def test_few_rows_stay_in_memory(rng):
    few = [rng.normal(size=(k, 3)).astype(np.float32) for k in (3, 0, 5)]
    rows = map_rows(few, (8, 3), FLOAT32)
    assert not is_mapped(rows)
    assert rows.dtype == np.float32
    assert_array_equal(rows, np.concatenate(few))
    assert map_rows([], (0, 3), FLOAT32).shape == (0, 3)
    assert not is_mapped(concatenated([rows, rows]))
    let_go(rows)  # nothing to give back


@needs_maps
def test_a_disk_that_is_full_is_said_in_one_line(whole, monkeypatch):
    def full():
        yield whole[:10]
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match=r"No space left on device.*TMPDIR"):
        map_rows(full(), whole.shape, FLOAT32)
