"""Findings: facts with a kind, whose row in the table has its words (docs/adr/0034-findings.md)."""

from planfit.findings.finding import SCHEMA_VERSION as SCHEMA_VERSION
from planfit.findings.finding import Fact as Fact
from planfit.findings.finding import Finding as Finding
from planfit.findings.finding import Kind as Kind
from planfit.findings.finding import Severity as Severity
from planfit.findings.finding import direction_words as direction_words
from planfit.findings.finding import finding_record as finding_record
from planfit.findings.finding import frame_ranges as frame_ranges
from planfit.findings.finding import sentences_of as sentences_of
from planfit.findings.finding import some_ids as some_ids
from planfit.findings.plan_kinds import PlanKind as PlanKind
from planfit.findings.pose_kinds import PoseKind as PoseKind
from planfit.findings.pose_kinds import SurveyKind as SurveyKind
from planfit.findings.result_kinds import ResultKind as ResultKind
from planfit.findings.scan_kinds import ScanKind as ScanKind
