"""Every table and figure of two papers that can be redone, the paper's number beside ours: ``crowd-env reproduce NAME``.

Pécol et al. 2011 (`PECOL`): of section 4.3 (the theatre: Table 7, Figures 4 to 6) the plan is not given, so
that Table 7 and Figure 6 are illustrations on a synthetic one.
Lin, Ma, Lo (`LIN`): its figures share runs, which are computed once and kept.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import NamedTuple

from crowd_env.reproduce.lin2016 import fig4, fig5, fig9, fig10
from crowd_env.reproduce.lin2016 import fig6 as lin_fig6
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.lin2016.sample import Records
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.lin2016.speeds import FIG7, FIG8
from crowd_env.reproduce.pecol2011 import fig1, fig2, fig3, fig6, table3, table5, table7, theatre
from crowd_env.reproduce.pecol2011.settings import Settings
from crowd_env.reproduce.result import Progress, RawTable, Result, Row

__all__ = [
    "GROUPS",
    "LIN",
    "PECOL",
    "REPRODUCTIONS",
    "LinFigure",
    "LinSettings",
    "Progress",
    "RawTable",
    "Reproduction",
    "Result",
    "Row",
    "Settings",
    "find",
]

_DRAWS = frozenset({"runs", "seed"})
_ROOM = _DRAWS | {f.name for f in fields(Settings)} - {"scheme"}
_LIN = frozenset({f.name for f in fields(LinSettings)} | {"workers", "fresh"})


class Reproduction(NamedTuple):
    """How one table or figure of Pécol et al. 2011 is redone."""

    title: str
    run: Callable[[Settings, Progress], Result]
    steps: Callable[[Settings], int]  # length of the progress bar
    schemes: Callable[[Settings], tuple[str, ...]] | None = None  # that run in the room; None: no room
    options: frozenset[str] = _DRAWS  # of the command line, that it takes
    about: str = "1 s"  # running time with the defaults, once the kernels are compiled
    runs: int = Settings.runs  # default number of draws


class LinFigure(NamedTuple):
    """How one figure of Lin, Ma, Lo is redone."""

    title: str
    runs: Callable[[LinSettings], list[Run]]  # that it needs
    tell: Callable[[LinSettings, Records], Result]  # the figure, from what came of them
    about: str  # CPU time of the default draws; runs that another figure has computed cost nothing
    options: frozenset[str] = _LIN


PECOL: dict[str, Reproduction] = {
    "table3": Reproduction(table3.TITLE, table3.reproduce, table3.steps),
    "fig1": Reproduction(fig1.TITLE, fig1.reproduce, fig1.steps),
    "fig2": Reproduction(fig2.TITLE, fig2.reproduce, fig2.steps),
    "fig3": Reproduction(fig3.TITLE, fig3.reproduce, fig3.steps, fig3.schemes, _ROOM | {"scheme"}, "2 s"),
    "table5": Reproduction(table5.TITLE, table5.reproduce, table5.steps, table5.schemes, _ROOM, "5 s"),
    "table7": Reproduction(table7.TITLE, table7.reproduce, table7.steps, about="1 min", runs=theatre.RUNS),
    "fig6": Reproduction(fig6.TITLE, fig6.reproduce, fig6.steps, about="40 s", runs=theatre.RUNS),
}
LIN: dict[str, LinFigure] = {
    "lin-fig4": LinFigure(fig4.TITLE, fig4.runs, fig4.tell, "30 s"),
    "lin-fig5": LinFigure(fig5.TITLE, fig5.runs, fig5.tell, "30 s", _LIN - {"no_rotation"}),
    "lin-fig6": LinFigure(lin_fig6.TITLE, lin_fig6.runs, lin_fig6.tell, "3 s", _LIN - {"runs"}),
    "lin-fig7": LinFigure(FIG7.title, FIG7.runs, FIG7.tell, "4 min"),
    "lin-fig8": LinFigure(FIG8.title, FIG8.runs, FIG8.tell, "6 min"),
    "lin-fig9": LinFigure(fig9.TITLE, fig9.runs, fig9.tell, "4 min"),
    "lin-fig10": LinFigure(fig10.TITLE, fig10.runs, fig10.tell, "10 min"),
}
REPRODUCTIONS: dict[str, Reproduction | LinFigure] = {**PECOL, **LIN}
GROUPS: dict[str, dict[str, Reproduction | LinFigure]] = {"pecol": {**PECOL}, "lin": {**LIN}, "all": REPRODUCTIONS}


def find(name: str) -> dict[str, Reproduction | LinFigure]:
    """Return what a name stands for: one table or figure, those of one paper, or all, by their own names.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the known ones.
    """
    if name in GROUPS:
        return dict(GROUPS[name])
    if name not in REPRODUCTIONS:
        raise ValueError(f"unknown name {name!r}; known: {', '.join(REPRODUCTIONS)}, or list, {', '.join(GROUPS)}")
    return {name: REPRODUCTIONS[name]}
