"""Experiments and tests of standards, one file each: geometry, people, what is measured, criterion and source."""

from validation.cases import doors
from validation.cases.case import Case, Row, Setting

CASES = {
    "doors": Case("doors of 0.5 to 5 m", doors.run, doors.SOURCE),
}

__all__ = ["CASES", "Case", "Row", "Setting"]
