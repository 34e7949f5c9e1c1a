"""What can be redone of Lin, Ma, Lo 2016: figures made of evacuations that they share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.lin2016 import clearance, flow, room
from crowd_env.reproduce.lin2016.sample import Sample, Samples
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.paper import Figure, Paper, every
from crowd_env.reproduce.result import Result

_ALL = every(LinSettings)
_STRENGTH, _ROTATION, _FEW, _MANY = clearance.FIGURES


def _figure(
    title: str, cases: Any, reproduce: Callable[[LinSettings, Samples], Result], cpu_time: float, **more: Any
) -> Figure[LinSettings]:
    """Return a figure that is made of all draws of each of its cases."""

    def of_runs(settings: LinSettings, runs: Mapping[Any, Sequence[Episode]]) -> Result:
        return reproduce(settings, {key: Sample(case, runs[key]) for key, case in cases(settings).items()})

    return Figure(f"Lin, Ma, Lo, Figure {title}", of_runs, cases, **{"options": _ALL, **more}, cpu_time=cpu_time)


PAPER = Paper(
    title="Lin, Ma, Lo",
    settings=LinSettings,
    figures={
        "lin-fig4": _figure(
            "4: 100 people at 1 m/s, by the strength A of the social force", _STRENGTH.cases, _STRENGTH.reproduce, 30
        ),
        "lin-fig5": _figure(
            "5: 100 people with and without rotation",
            _ROTATION.cases,
            _ROTATION.reproduce,
            30,
            options=_ALL - {"no_rotation"},
        ),
        "lin-fig6": _figure(
            "6: 200 people at 0, 30, 60 and 120 s",
            room.cases,
            room.reproduce,
            3,
            options=_ALL - {"runs"},
            defaults={"runs": 1},
        ),
        "lin-fig7": _figure("7: 200 people, by desired speed", _FEW.cases, _FEW.reproduce, 4 * 60),
        "lin-fig8": _figure("8: 300 people, by desired speed", _MANY.cases, _MANY.reproduce, 6 * 60),
        "lin-fig9": _figure(
            "9: flow through the exit in windows of 10 s, people/s", flow.window_cases, flow.windows, 4 * 60
        ),
        "lin-fig10": _figure("10: mean flow through the exit, people/s", flow.mean_cases, flow.means, 10 * 60),
    },
    cpu_time=12 * 60,
)
