"""What can be redone of Pécol et al. 2011.

Of section 4.3 (the theatre: Table 7, Figures 4 to 6) the plan is not given, so that Table 7 and Figure 6 are illustrations
on a synthetic one.
"""

from dataclasses import fields
from typing import Any

from crowd_env.reproduce.paper import DRAWS, Figure, Paper
from crowd_env.reproduce.pecol2011 import fig1, fig2, fig3, fig6, table3, table5, table7, theatre
from crowd_env.reproduce.pecol2011.settings import PecolSettings

_ROOM = DRAWS | {one.name for one in fields(PecolSettings)} - {"scheme"}
_THEATRE: dict[str, Any] = {"defaults": {"runs": theatre.RUNS}}

PAPER = Paper(
    title="Pécol et al. 2011",
    settings=PecolSettings,
    figures={
        "table3": Figure(table3.TITLE, table3.reproduce),
        "fig1": Figure(fig1.TITLE, fig1.reproduce),
        "fig2": Figure(fig2.TITLE, fig2.reproduce),
        "fig3": Figure(fig3.TITLE, fig3.reproduce, fig3.cases, _ROOM | {"scheme"}, cpu_time=2),
        "table5": Figure(table5.TITLE, table5.reproduce, table5.cases, _ROOM, cpu_time=5),
        "table7": Figure(table7.TITLE, table7.reproduce, table7.cases, **_THEATRE, cpu_time=60),
        "fig6": Figure(fig6.TITLE, fig6.reproduce, fig6.cases, **_THEATRE, cpu_time=40),
    },
    cpu_time=60,
)
