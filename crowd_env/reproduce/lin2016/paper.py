"""What can be redone of Lin, Ma, Lo 2016: its figures are made of runs that they share, computed once and kept."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import cast

from crowd_env.reproduce.lin2016 import fig4, fig5, fig6, fig9, fig10
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.lin2016.sample import Cases, Key, Sample, sample
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.lin2016.speeds import FIG7, FIG8
from crowd_env.reproduce.paper import Figure, Paper, Work
from crowd_env.reproduce.result import Result

_ALL = frozenset(one.name for one in fields(LinSettings))


def _of_samples(
    title: str,
    cases: Cases[Key],
    reproduce: Callable[[LinSettings, Mapping[Key, Sample]], Result],
    cpu_time: float,
    options: frozenset[str] = _ALL,
) -> Figure[LinSettings]:
    """Return a figure that is made of all draws of each of its cases."""

    def runs(settings: LinSettings) -> list[Run]:
        return [run for case in cases.values() for run in settings.draws(**case)]

    def from_records(settings: LinSettings, work: Work) -> Result:
        return reproduce(settings, {k: sample(work.records, settings.draws(**case)) for k, case in cases.items()})

    return Figure(title, from_records, runs=runs, options=options, cpu_time=cpu_time)


_FIGURES = {
    "lin-fig4": _of_samples(fig4.TITLE, fig4.CASES, fig4.reproduce, 30),
    "lin-fig5": _of_samples(fig5.TITLE, fig5.CASES, fig5.reproduce, 30, _ALL - {"no_rotation"}),
    "lin-fig6": Figure(fig6.TITLE, fig6.reproduce, runs=fig6.runs, options=_ALL - {"runs"}, cpu_time=3),
    "lin-fig7": _of_samples(FIG7.title, FIG7.cases, FIG7.reproduce, 4 * 60),
    "lin-fig8": _of_samples(FIG8.title, FIG8.cases, FIG8.reproduce, 6 * 60),
    "lin-fig9": _of_samples(fig9.TITLE, fig9.CASES, fig9.reproduce, 4 * 60),
    "lin-fig10": _of_samples(fig10.TITLE, fig10.CASES, fig10.reproduce, 10 * 60),
}


def check(chosen: Mapping[str, LinSettings]) -> None:
    """Raise ValueError, before anything runs, if a configuration cannot be used; one draw of each is tried."""
    needed = [run for name, settings in chosen.items() if (runs := _FIGURES[name].runs) for run in runs(settings)]
    for run in dict.fromkeys(replace(cast(Run, run), seed=0) for run in needed):
        run.check()


PAPER = Paper("Lin, Ma, Lo", LinSettings, _FIGURES, cpu_time=12 * 60, check=check)
