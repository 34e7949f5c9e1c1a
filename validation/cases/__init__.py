"""Experiments and tests of standards, one file each: geometry, people, what is measured, criterion and source."""

from validation.cases import (
    clogging,
    corner,
    corridor,
    counterflow,
    crossing,
    doors,
    faster,
    figures,
    frozen,
    gate,
    halls,
    jambs,
    laws,
    ring,
    row,
    standards,
)
from validation.cases.case import Case, Row, Setting

_NO_ROOM = "where 4 people stand on a square meter, shoulders of their breadth cannot turn"

CASES = {
    "gate": Case("75 students and a gate of 0.5 m", gate.run, gate.SOURCE, recordings=True, draw=figures.gate),
    "doors": Case("doors of 0.5 to 5 m", doors.run, doors.SOURCE),
    "corridor": Case(
        "open corridor of 1.8 m, nine runs", corridor.run, corridor.SOURCE, recordings=True, draw=figures.corridor
    ),
    "ring": Case("single file around a ring of 27 m", ring.run, ring.SOURCE, draw=figures.ring),
    "counterflow": Case("two streams in a corridor of 4 m", counterflow.run, counterflow.SOURCE),
    "crossing": Case(
        "people of two rooms change places through a corridor",
        crossing.run,
        crossing.SOURCE,
        discs_because=_NO_ROOM,
    ),
    "corner": Case("corner of a corridor of 2.4 m, ever denser", corner.run, corner.SOURCE),
    "faster": Case("door of 0.8 m, by desired speed, push and friction", faster.run, faster.SOURCE, draws=5),
    "clogging": Case(
        "100 people press through a door of 0.7 m",
        clogging.run,
        clogging.SOURCE,
        manners=("competitive",),
        draw=clogging.draw,
    ),
    "row": Case(
        "a push through a row of five people who stand",
        row.run,
        row.SOURCE,
        draws=1,
        manners=("competitive",),
        discs_because="its discs are as deep as the chests of those who were pushed",
    ),
    "frozen": Case(
        frozen.TITLE,
        frozen.run,
        frozen.SOURCE,
        draws=10,
        manners=("competitive",),
        discs_because="it is about the crowd of Lin, Ma, Lo, who are discs",
    ),
    "jambs": Case(jambs.TITLE, jambs.run, jambs.SOURCE, manners=("competitive", "hurried")),
    "standards": Case("tests of RiMEA, ISO, NIST and IMO", standards.run, standards.SOURCE, draws=5),
    "laws": Case("laws in which one draw is enough", laws.run, laws.SOURCE, draws=1, manners=("calm", "hurried")),
    "halls": Case(
        "500 or 1000 people leave a crowded hall by one door, until all are out or nobody was for 30 s",
        halls.run_in(halls.HALLS, "halls"),
        halls.SOURCE,
        draws=1,
        manners=("competitive",),
        discs_because=_NO_ROOM,
    ),
    "great-halls": Case(
        "2000 or 5000 people leave a crowded hall by one door, until all are out or nobody was for 30 s",
        halls.run_in(halls.GREAT_HALLS, "great-halls"),
        halls.SOURCE,
        draws=1,
        manners=("competitive",),
        discs_because=_NO_ROOM,
    ),
}

__all__ = ["CASES", "Case", "Row", "Setting"]
