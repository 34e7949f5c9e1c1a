"""What can be redone of Lin, Ma, Lo 2016: figures made of evacuations that they share."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016 import fig4, fig5, fig6, fig9, fig10
from crowd_env.reproduce.lin2016.sample import Sample, Samples
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.lin2016.speeds import FIG7, FIG8
from crowd_env.reproduce.paper import Figure, Paper
from crowd_env.reproduce.result import Result

_ALL = frozenset(one.name for one in fields(LinSettings))


def _figure(
    title: str,
    cases: Callable[[LinSettings], Mapping[Any, Case]],
    reproduce: Callable[[LinSettings, Samples], Result],
    cpu_time: float,
    **more: Any,
) -> Figure[LinSettings]:
    """Return a figure that is made of all draws of each of its cases."""

    def of_runs(settings: LinSettings, runs: Mapping[Any, Sequence[Episode]]) -> Result:
        return reproduce(settings, {key: Sample(case, runs[key]) for key, case in cases(settings).items()})

    return Figure(title, of_runs, cases, **{"options": _ALL, **more}, cpu_time=cpu_time)


_ONE_DRAW: dict[str, Any] = {"options": _ALL - {"runs"}, "defaults": {"runs": 1}}

PAPER = Paper(
    "Lin, Ma, Lo",
    LinSettings,
    {
        "lin-fig4": _figure(fig4.TITLE, fig4.cases, fig4.reproduce, 30),
        "lin-fig5": _figure(fig5.TITLE, fig5.cases, fig5.reproduce, 30, options=_ALL - {"no_rotation"}),
        "lin-fig6": _figure(fig6.TITLE, fig6.cases, fig6.reproduce, 3, **_ONE_DRAW),
        "lin-fig7": _figure(FIG7.title, FIG7.cases, FIG7.reproduce, 4 * 60),
        "lin-fig8": _figure(FIG8.title, FIG8.cases, FIG8.reproduce, 6 * 60),
        "lin-fig9": _figure(fig9.TITLE, fig9.cases, fig9.reproduce, 4 * 60),
        "lin-fig10": _figure(fig10.TITLE, fig10.cases, fig10.reproduce, 10 * 60),
    },
    cpu_time=12 * 60,
)
