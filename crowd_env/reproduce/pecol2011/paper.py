"""What can be redone of Pécol et al. 2011.

Of section 4.3 (the theatre: Table 7, Figures 4 to 6) the plan is not given, so that Table 7 and Figure 6 are illustrations
on a synthetic one.
"""

from collections.abc import Mapping
from dataclasses import fields

from crowd_env.reproduce.paper import DRAWS, Figure, Paper
from crowd_env.reproduce.pecol2011 import fig1, fig2, fig3, fig6, table3, table5, table7, theatre
from crowd_env.reproduce.pecol2011.settings import PecolSettings

_ROOM = DRAWS | {one.name for one in fields(PecolSettings)} - {"scheme"}
_THEATRE = {"runs": theatre.RUNS}
_SCHEMES = {"fig3": fig3.schemes, "table5": table5.schemes}  # that run in the room


def check(chosen: Mapping[str, PecolSettings]) -> None:
    """Raise ValueError, before anything runs, if the room cannot be used with the schemes that the figures run there."""
    rooms = {name: settings for name, settings in chosen.items() if name in _SCHEMES}
    schemes = dict.fromkeys(scheme for name, settings in rooms.items() for scheme in _SCHEMES[name](settings))
    for settings in rooms.values():
        settings.check(schemes)


PAPER = Paper(
    title="Pécol et al. 2011",
    settings=PecolSettings,
    figures={
        "table3": Figure(table3.TITLE, table3.reproduce, table3.steps),
        "fig1": Figure(fig1.TITLE, fig1.reproduce, fig1.steps),
        "fig2": Figure(fig2.TITLE, fig2.reproduce, fig2.steps),
        "fig3": Figure(fig3.TITLE, fig3.reproduce, fig3.steps, options=_ROOM | {"scheme"}, cpu_time=2),
        "table5": Figure(table5.TITLE, table5.reproduce, table5.steps, options=_ROOM, cpu_time=5),
        "table7": Figure(table7.TITLE, table7.reproduce, table7.steps, defaults=_THEATRE, cpu_time=60),
        "fig6": Figure(fig6.TITLE, fig6.reproduce, fig6.steps, defaults=_THEATRE, cpu_time=40),
    },
    cpu_time=60,
    check=check,
)
