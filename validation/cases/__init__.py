"""Experiments and tests of standards, one file each: geometry, people, what is measured, criterion and source."""

from typing import Any

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

_PRESS: dict[str, Any] = {"manners": ("competitive",)}
_HALLS: dict[str, Any] = {**_PRESS, "draws": 1, "discs_because": _NO_ROOM}
_DEEP = "its discs are as deep as the chests of those who were pushed"
_OF_LIN = "it is about the crowd of Lin, Ma, Lo, who are discs"
_EMPTY = "people leave a crowded hall by one door, until all are out or nobody was for 30 s"


def _case(module: Any, title: str, **more: Any) -> Case:
    return Case(title, module.run, module.SOURCE, **more)


CASES = {
    "gate": _case(gate, "75 students and a gate of 0.5 m", recordings=True, draw=figures.gate),
    "doors": _case(doors, "doors of 0.5 to 5 m"),
    "corridor": _case(corridor, "open corridor of 1.8 m, nine runs", recordings=True, draw=figures.corridor),
    "ring": _case(ring, "single file around a ring of 27 m", draw=figures.ring),
    "counterflow": _case(counterflow, "two streams in a corridor of 4 m"),
    "crossing": _case(crossing, "people of two rooms change places through a corridor", discs_because=_NO_ROOM),
    "corner": _case(corner, "corner of a corridor of 2.4 m, ever denser"),
    "faster": _case(faster, "door of 0.8 m, by desired speed, push and friction", draws=5),
    "clogging": _case(clogging, "100 people press through a door of 0.7 m", **_PRESS, draw=clogging.draw),
    "row": _case(row, "a push through a row of five people who stand", **_PRESS, draws=1, discs_because=_DEEP),
    "frozen": _case(frozen, frozen.TITLE, **_PRESS, draws=10, discs_because=_OF_LIN),
    "jambs": _case(jambs, jambs.TITLE, manners=("competitive", "hurried")),
    "standards": _case(standards, "tests of RiMEA, ISO, NIST and IMO", draws=5),
    "laws": _case(laws, "laws in which one draw is enough", draws=1, manners=("calm", "hurried")),
    "halls": Case(f"500 or 1000 {_EMPTY}", halls.run_in(halls.HALLS, "halls"), halls.SOURCE, **_HALLS),
    "great-halls": Case(
        f"2000 or 5000 {_EMPTY}", halls.run_in(halls.GREAT_HALLS, "great-halls"), halls.SOURCE, **_HALLS
    ),
}

__all__ = ["CASES", "Case", "Row", "Setting"]
