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
        "table3": Figure("Table 3: velocity after contact as a function of the time step, DEM", table3.reproduce),
        "fig1": Figure("Figure 1: two pedestrians meet head-on, for several relaxation times", fig1.reproduce),
        "fig2": Figure("Figure 2: a particle against a wall under the three schemes", fig2.reproduce),
        "fig3": Figure(
            "Figure 3: pedestrians out of the room against time; flows in persons/s",
            room.fig3,
            lambda my: my.cases([my.scheme]),
            _ROOM | {"scheme"},
            cpu_time=2,
        ),
        "table5": Figure(
            "Table 5: average flow through the door, persons/s",
            room.table5,
            lambda my: my.cases(room.SCHEMES),
            _ROOM,
            cpu_time=5,
        ),
        "table7": Figure(
            "Table 7: evacuation of a movie theatre (synthetic plan), times in s",
            table7.table7,
            lambda my: theatre.cases(my, ["yes", "no"]),
            **_THEATRE,
            cpu_time=60,
        ),
        "fig6": Figure(
            "Figure 6: people out of a movie theatre (synthetic plan) against time, in s",
            table7.fig6,
            lambda my: theatre.cases(my, ["yes"]),
            **_THEATRE,
            cpu_time=40,
        ),
    },
    cpu_time=60,
)
