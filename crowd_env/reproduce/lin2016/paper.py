"""What can be redone of Lin, Ma, Lo 2016: its figures are made of runs that they share, computed once and kept."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import cast

from crowd_env.reproduce.lin2016 import fig4, fig5, fig6, fig9, fig10
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.lin2016.speeds import FIG7, FIG8
from crowd_env.reproduce.paper import Figure, Paper

_ALL = frozenset(one.name for one in fields(LinSettings))

_FIGURES = {
    "lin-fig4": Figure(fig4.TITLE, fig4.reproduce, runs=fig4.runs, options=_ALL, cpu_time=30),
    "lin-fig5": Figure(fig5.TITLE, fig5.reproduce, runs=fig5.runs, options=_ALL - {"no_rotation"}, cpu_time=30),
    "lin-fig6": Figure(fig6.TITLE, fig6.reproduce, runs=fig6.runs, options=_ALL - {"runs"}, cpu_time=3),
    "lin-fig7": Figure(FIG7.title, FIG7.reproduce, runs=FIG7.runs, options=_ALL, cpu_time=4 * 60),
    "lin-fig8": Figure(FIG8.title, FIG8.reproduce, runs=FIG8.runs, options=_ALL, cpu_time=6 * 60),
    "lin-fig9": Figure(fig9.TITLE, fig9.reproduce, runs=fig9.runs, options=_ALL, cpu_time=4 * 60),
    "lin-fig10": Figure(fig10.TITLE, fig10.reproduce, runs=fig10.runs, options=_ALL, cpu_time=10 * 60),
}


def check(chosen: Mapping[str, LinSettings]) -> None:
    """Raise ValueError, before anything runs, if a configuration cannot be used; one draw of each is tried."""
    needed = [run for name, settings in chosen.items() if (runs := _FIGURES[name].runs) for run in runs(settings)]
    for run in dict.fromkeys(replace(cast(Run, run), seed=0) for run in needed):
        run.check()


PAPER = Paper("Lin, Ma, Lo", LinSettings, _FIGURES, cpu_time=12 * 60, check=check)
