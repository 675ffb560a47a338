"""What ezdxf's repair of a DXF lost: most of what it reports (names, styles, owners) loses nothing."""

import re

from ezdxf.audit import AuditError, Auditor

_HARMLESS = {
    AuditError.INVALID_LAYER_NAME,
    AuditError.BLOCK_NAME_MISMATCH,
    AuditError.DECODING_ERROR,
    AuditError.ROOT_DICT_NOT_FOUND,
    AuditError.MISSING_REQUIRED_ROOT_DICT_ENTRY,
    AuditError.ACTIVE_PAPERSPACE_LAYOUT_NOT_FOUND,
    AuditError.INVALID_MLINESTYLE_ELEMENT_COUNT,
}
"""Errors that stay in the document and leave its geometry whole."""
_LOST = {
    AuditError.FOUND_TAG_OUTSIDE_SECTION,
    AuditError.REMOVED_INVALID_GRAPHIC_ENTITY,
    AuditError.REMOVED_ENTITY_WITH_INVALID_OWNER_HANDLE,
    AuditError.UNDEFINED_BLOCK,
    AuditError.UNDEFINED_BLOCK_NAME,
    AuditError.INVALID_VERTEX_COUNT,
    AuditError.INVALID_MAJOR_AXIS,
    AuditError.INVALID_HATCH_BOUNDARY_PATH,
    AuditError.INVALID_SPLINE_DEFINITION,
    AuditError.INVALID_SPLINE_CONTROL_POINT_COUNT,
    AuditError.INVALID_SPLINE_FIT_POINT_COUNT,
    AuditError.INVALID_SPLINE_KNOT_VALUE_COUNT,
    AuditError.INVALID_SPLINE_WEIGHT_COUNT,
}
"""Repairs that take an entity away."""
_RECOVERED = re.compile(r'value "(?P<found>[^"]*)".* as "(?P<read>[^"]*)"')


def lost_parts(auditor: Auditor) -> list[str]:
    """A sentence of ezdxf's for each entity that was taken away and each number that was guessed."""
    errors = [e.message for e in auditor.errors if e.code not in _HARMLESS]
    fixes = [e.message for e in auditor.fixes if e.code in _LOST]
    # The codes of splines also stand for superfluous knots and weights.
    return [m for m in errors if not _is_same_number(m)] + [m for m in fixes if "unused" not in m]


def _is_same_number(message: str) -> bool:
    """Whether a number in the wrong form, as 3.0 for a whole one, was read as what it says."""
    match = _RECOVERED.search(message)
    try:
        return match is not None and float(match["found"]) == float(match["read"])
    except ValueError:
        return False
