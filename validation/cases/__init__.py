"""Experiments and tests of standards, one file each: geometry, people, what is measured, criterion and source."""

from validation.cases import corner, corridor, counterflow, crossing, doors, faster, gate, ring, standards
from validation.cases.case import Case, Row, Setting

CASES = {
    "doors": Case("doors of 0.5 to 5 m", doors.run, doors.SOURCE),
    "gate": Case("gate of 0.5 m behind a waiting area", gate.run, gate.SOURCE, takes_data=gate.DATA),
    "counterflow": Case("two streams in a corridor of 4 m", counterflow.run, counterflow.SOURCE),
    "crossing": Case("people of two rooms change places through a corridor", crossing.run, crossing.SOURCE),
    "ring": Case("single file around a ring of 27 m", ring.run, ring.SOURCE),
    "corridor": Case("open corridor of 1.8 m, nine runs", corridor.run, corridor.SOURCE),
    "corner": Case("corner of a corridor of 2.4 m, ever denser", corner.run, corner.SOURCE),
    "faster": Case("door of 0.8 m, by desired speed, push and friction", faster.run, faster.SOURCE),
    "standards": Case("tests of RiMEA, ISO, NIST and IMO", standards.run, standards.SOURCE),
}

__all__ = ["CASES", "Case", "Row", "Setting"]
