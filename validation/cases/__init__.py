"""Experiments and tests of standards, one file each: geometry, people, what is measured, criterion and source."""

from importlib import import_module

from validation.cases import clogging, corner, halls, ovals, panels, row, standing
from validation.cases.case import FACTS, Case, Row, Setting

# The cases of one module; any other case is the function `run` of the module of its name.
_RUN = {
    "halls": halls.run_in(halls.HALLS, "halls"),
    "jam": ovals.jam,
    "turn": corner.run_turn,
    "great-halls": halls.run_in(halls.GREAT_HALLS, "great-halls"),
}
_DRAW = {"gate": panels.gate, "corridor": panels.corridor, "ring": panels.ring, "clogging": clogging.draw}
_DRAW |= {"row": row.draw, "standing": standing.draw}

# In the order of cases.toml, which says the rest.
CASES = {
    name: Case(run=_RUN.get(name) or import_module(f"{__name__}.{name}").run, draw=_DRAW.get(name), **facts)
    for name, facts in FACTS["cases"].items()
}

__all__ = ["CASES", "Case", "Row", "Setting"]
