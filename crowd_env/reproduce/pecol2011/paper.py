"""What can be redone of Pécol et al. 2011.

Of section 4.3 (the theatre: Table 7, Figures 4 to 6) the plan is not given, so that Table 7 and Figure 6 are illustrations
on a synthetic one.
"""

from typing import Any

from crowd_env.reproduce.paper import Figure, Paper, every
from crowd_env.reproduce.pecol2011 import fig1, fig2, room, table3, table7, theatre
from crowd_env.reproduce.pecol2011.settings import PecolSettings

_ROOM = every(PecolSettings, "scheme")
_THEATRE: dict[str, Any] = {"defaults": {"runs": theatre.RUNS}}

PAPER = Paper(
    title="Pécol et al. 2011",
    settings=PecolSettings,
    figures={
        "table3": Figure(table3.TITLE, table3.reproduce),
        "fig1": Figure(fig1.TITLE, fig1.reproduce),
        "fig2": Figure(fig2.TITLE, fig2.reproduce),
        "fig3": Figure(room.FIG3, room.fig3, lambda my: my.cases([my.scheme]), _ROOM | {"scheme"}, cpu_time=2),
        "table5": Figure(room.TABLE5, room.table5, lambda my: my.cases(room.SCHEMES), _ROOM, cpu_time=5),
        "table7": Figure(table7.TABLE7, table7.table7, table7.table7_cases, **_THEATRE, cpu_time=60),
        "fig6": Figure(table7.FIG6, table7.fig6, table7.fig6_cases, **_THEATRE, cpu_time=40),
    },
    cpu_time=60,
)
