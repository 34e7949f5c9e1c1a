"""What can be redone of Lin, Ma, Lo 2016: figures made of evacuations that they share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.lin2016 import clearance, flow, room
from crowd_env.reproduce.lin2016.sample import TITLES, Sample, Samples
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.paper import Figure, Paper, every
from crowd_env.reproduce.result import Result

_ALL = every(LinSettings)
_STRENGTH, _ROTATION, _FEW, _MANY = clearance.FIGURES

# Number of a figure -> its cases, what makes it of their samples, cpu time [s], and more of `Figure`.
_FIGURES: dict[int, tuple[Any, Callable[[LinSettings, Samples], Result], float, dict[str, Any]]] = {
    4: (_STRENGTH.cases, _STRENGTH.reproduce, 30, {}),
    5: (_ROTATION.cases, _ROTATION.reproduce, 30, {"options": _ALL - {"no_rotation"}}),
    6: (room.cases, room.reproduce, 3, {"options": _ALL - {"runs"}, "defaults": {"runs": 1}}),
    7: (_FEW.cases, _FEW.reproduce, 4 * 60, {}),
    8: (_MANY.cases, _MANY.reproduce, 6 * 60, {}),
    9: (flow.window_cases, flow.windows, 4 * 60, {}),
    10: (flow.mean_cases, flow.means, 10 * 60, {}),
}


def _figure(number: int) -> Figure[LinSettings]:
    """Return a figure that is made of all draws of each of its cases."""
    cases, reproduce, cpu_time, more = _FIGURES[number]

    def of_runs(settings: LinSettings, runs: Mapping[Any, Sequence[Episode]]) -> Result:
        return reproduce(settings, {key: Sample(case, runs[key]) for key, case in cases(settings).items()})

    return Figure(TITLES[number], of_runs, cases, **{"options": _ALL, **more}, cpu_time=cpu_time)


PAPER = Paper("Lin, Ma, Lo", LinSettings, {f"lin-fig{n}": _figure(n) for n in _FIGURES}, cpu_time=12 * 60)
