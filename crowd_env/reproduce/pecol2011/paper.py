"""What can be redone of Pécol et al. 2011.

Of section 4.3 (the theatre: Table 7, Figures 4 to 6) the plan is not given, so that Table 7 and Figure 6 are illustrations
on a synthetic one.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from crowd_env.reproduce.paper import DRAWS, SPREAD, Figure, Paper
from crowd_env.reproduce.pecol2011 import fig1, fig2, fig3, fig6, table3, table5, table7, theatre
from crowd_env.reproduce.pecol2011.settings import PecolSettings

_ROOM = DRAWS | SPREAD | {one.name for one in fields(PecolSettings)} - {"scheme"}
_THEATRE: dict[str, Any] = {"options": DRAWS | SPREAD, "defaults": {"runs": theatre.RUNS}}


def check(chosen: Mapping[str, PecolSettings]) -> None:
    """Raise ValueError, before anything runs, if the room cannot be used with the schemes that the figures run there."""
    schemes = {"table5": table5.SCHEMES, "fig3": (chosen["fig3"].scheme,) if "fig3" in chosen else ()}
    rooms = [name for name in chosen if name in schemes]
    for name in rooms:
        chosen[name].check(dict.fromkeys(scheme for other in rooms for scheme in schemes[other]))


PAPER = Paper(
    title="Pécol et al. 2011",
    settings=PecolSettings,
    figures={
        "table3": Figure(table3.TITLE, table3.reproduce, lambda _: table3.STEPS),
        "fig1": Figure(fig1.TITLE, fig1.reproduce, lambda _: fig1.STEPS),
        "fig2": Figure(fig2.TITLE, fig2.reproduce, lambda _: fig2.STEPS),
        "fig3": Figure(fig3.TITLE, fig3.reproduce, lambda s: s.runs, options=_ROOM | {"scheme"}, cpu_time=2),
        "table5": Figure(
            table5.TITLE, table5.reproduce, lambda s: len(table5.SCHEMES) * s.runs, options=_ROOM, cpu_time=5
        ),
        "table7": Figure(table7.TITLE, table7.reproduce, lambda s: 2 * s.runs, **_THEATRE, cpu_time=60),
        "fig6": Figure(fig6.TITLE, fig6.reproduce, lambda s: s.runs, **_THEATRE, cpu_time=40),
    },
    cpu_time=60,
    check=check,
)
