"""JSON of scans with values of another kind: one line or read, never a traceback."""

import json
from pathlib import Path

import numpy as np
import pytest

from scan_samples import Sample, make_sample, put, write_zip
from spoiled_scans import files_of, spoken, write_all


@pytest.fixture(scope="module")
def sample() -> Sample:
    return make_sample()


WRONG_VALUES = [None, "x", [], {}, [1], -1, 0, 1e308, True, "", [[1, 2], [3]], 10**400]


def places_in(value, place=()):
    """Ways to every value of nested JSON, of long lists to the first two."""
    items = value.items() if isinstance(value, dict) else enumerate(value[:2])
    for key, inner in items:
        yield (*place, key)
        if isinstance(inner, dict | list):
            yield from places_in(inner, (*place, key))


@pytest.mark.parametrize("kind", ["nerfstudio", "polycam", "scanner-app", "record3d", "replica"])
def test_json_of_other_values_is_one_line_or_read(
    kind: str, sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = files_of(kind, sample, tmp_path / "whole")
    name = "metadata" if kind == "record3d" else next(n for n in files if n.endswith(".json"))
    path = write_all(kind, files, tmp_path / "spoiled")
    places = list(places_in(json.loads(files[name])))
    choose = np.random.default_rng(7)
    for number in choose.permutation(len(places))[:15]:
        for wrong in choose.permutation(len(WRONG_VALUES))[:3]:
            content = json.loads(files[name])
            at = content
            for key in places[number][:-1]:
                at = at[key]
            at[places[number][-1]] = WRONG_VALUES[wrong]
            data = json.dumps(content).encode()
            if kind == "record3d":
                write_zip(path, files | {name: data})
            else:
                put(tmp_path / "spoiled" / name, data)
            code, errors, _ = spoken(
                capsys, "export", path, "--to", "kitti", "-o", tmp_path / "poses.txt"
            )
            (tmp_path / "poses.txt").unlink(missing_ok=True)
            assert code in (0, 2)
            assert len(errors) == (code == 2)
