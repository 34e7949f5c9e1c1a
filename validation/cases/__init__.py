"""Experiments and tests of standards, one file each: geometry, people, what is measured, criterion and source."""

from collections.abc import Callable, Iterable

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
from validation.cases.case import FACTS, Case, Row, Setting

# What runs a case, and what draws a picture of all its rows; the rest is said in cases.toml.
_CASES = (
    gate,
    doors,
    corridor,
    ring,
    counterflow,
    crossing,
    corner,
    faster,
    clogging,
    row,
    frozen,
    jambs,
    standards,
    laws,
)
_RUN: dict[str, Callable[[Setting], Iterable[Row]]] = {
    **{one.__name__.rpartition(".")[2]: one.run for one in _CASES},
    "halls": halls.run_in(halls.HALLS, "halls"),
    "great-halls": halls.run_in(halls.GREAT_HALLS, "great-halls"),
}
_DRAW = {"gate": figures.gate, "corridor": figures.corridor, "ring": figures.ring, "clogging": clogging.draw}

CASES = {name: Case(run=run, draw=_DRAW.get(name), **FACTS["cases"][name]) for name, run in _RUN.items()}

__all__ = ["CASES", "Case", "Row", "Setting"]
