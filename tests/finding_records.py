"""Findings in files of a run against their page, docs/findings.md."""

import re
from numbers import Real
from pathlib import Path

from planfit.findings import PlanKind, PoseKind, ResultKind, ScanKind, SurveyKind

PAGE = (Path(__file__).parents[1] / "docs" / "findings.md").read_text()
KINDS = {
    kind.code: kind
    for kinds in (ScanKind, PoseKind, PlanKind, ResultKind, SurveyKind)
    for kind in kinds
}
FIELDS = re.findall(
    r"^\| `(\w+)` \|", PAGE.split("Each finding has")[1].split("New kinds")[0], re.MULTILINE
)


def check_findings(records: list) -> None:
    """Assert that each record is a finding as the page has it."""
    for record in records:
        assert set(record) == set(FIELDS), record
        kind = KINDS[record["kind"]]
        assert record["severity"] == kind.message.severity
        assert kind.message.fact_names <= set(record["facts"])
        assert all(is_fact(value) for value in record["facts"].values()), record["facts"]
        for first, last in record["frames"]:
            assert 0 <= first <= last
        assert all(isinstance(face, int) for face in record["faces"])
        assert isinstance(record["subject"], str)
        assert record["words"]
        assert isinstance(record["advice"], str)
        check_findings(record["parts"])


def is_fact(value) -> bool:
    if isinstance(value, list):
        return all(isinstance(each, Real | str) for each in value)
    return value is None or isinstance(value, Real | str)
