"""Tables and figures of papers that can be redone, the paper's number beside ours: ``crowd-env reproduce NAME``.

A paper is a folder with its settings, a file a figure and a `Paper` that lists them, and a line in `PAPERS`.
"""

from typing import Any

from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.footbridge.paper import PAPER as FOOTBRIDGE
from crowd_env.reproduce.granular.paper import PAPER as GRANULAR
from crowd_env.reproduce.helbing2000.paper import PAPER as HELBING
from crowd_env.reproduce.hostikka2007.paper import PAPER as HOSTIKKA
from crowd_env.reproduce.lin2016.paper import PAPER as LIN
from crowd_env.reproduce.moussaid2010.paper import PAPER as MOUSSAID
from crowd_env.reproduce.paper import Figure, Paper, Settings
from crowd_env.reproduce.pecol2011.paper import PAPER as PECOL
from crowd_env.reproduce.result import RawTable, Result, Row

__all__ = ["FIGURES", "PAPERS", "Case", "Figure", "Paper", "RawTable", "Result", "Row", "Settings", "find"]

PAPERS: dict[str, Paper[Any]] = {
    "pecol": PECOL,
    "lin": LIN,
    "helbing": HELBING,
    "moussaid": MOUSSAID,
    "hostikka": HOSTIKKA,
    "footbridge": FOOTBRIDGE,
    "granular": GRANULAR,
}
FIGURES: dict[str, Figure[Any]] = {name: one for paper in PAPERS.values() for name, one in paper.figures.items()}


def find(name: str) -> dict[str, list[str]]:
    """Return the figures, by paper, that a name stands for: a table or figure, a paper, or all.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the known ones.
    """
    if name not in {*FIGURES, *PAPERS, "all"}:
        raise ValueError(f"unknown name {name!r}; known: {', '.join(FIGURES)}, or list, {', '.join(PAPERS)}, all")
    chosen = {key: [one for one in paper.figures if name in (one, key, "all")] for key, paper in PAPERS.items()}
    return {key: names for key, names in chosen.items() if names}
