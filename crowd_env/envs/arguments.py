"""What a `CrowdEnv` is made from: checked, and its size, before anything is computed."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.checks import refuse
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Bodies, make_bodies

MOST_PEOPLE_IN_BATCH = 10_000_000


def scenarios_of(scenario: Any) -> list[Any]:
    """Return the scenarios, or their names or files; one alone is a list of one.

    Raises
    ------
    ValueError
        If it is something else, or there is none.
    """
    if isinstance(scenario, str | Path | Scenario):
        return [scenario]
    if not isinstance(scenario, Iterable) or isinstance(scenario, Mapping | bytes):
        refuse("scenario", scenario, "the name of a scenario, its file, a Scenario, or a list of them")
    kinds = list(scenario)
    if not kinds:
        raise ValueError("no scenario; give at least one")
    return kinds


def check_size(scenarios: Sequence[Scenario], num_envs: int) -> None:
    """Raise ValueError if a batch has more people than any memory has room for, before anything is allocated."""
    each = sum(scenario.population.count for scenario in scenarios) / len(scenarios)
    if num_envs * each > MOST_PEOPLE_IN_BATCH:
        raise ValueError(
            f"num_envs is {num_envs}; with {each:g} people in each it must be at most {int(MOST_PEOPLE_IN_BATCH // each)}: "
            f"a batch has room for {MOST_PEOPLE_IN_BATCH} people"
        )


def substeps_of(decision_dt: float, dt: float) -> int:
    """Return the number of physics steps of ``dt`` [s] in a decision step [s].

    Raises
    ------
    ValueError
        If it is not a whole number of at least 1.
    """
    ratio = decision_dt / dt
    if not 0.5 < ratio < 1e9 or abs(ratio - round(ratio)) > 1e-6:
        raise ValueError(f"decision_dt = {decision_dt:g} s is not a whole number of physics steps of dt = {dt:g} s")
    return round(ratio)


def bodies_before_reset(scenarios: Sequence[Scenario]) -> Bodies:
    """Return bodies (P,) for the crowds of some environments, all as wide, heavy and quick as their population allows.

    They hold the room of those that a reset draws.
    """
    parts = [part for scenario in scenarios for part in scenario.population.parts]
    counts = [part.count for part in parts]
    return make_bodies(
        np.repeat([part.radius.high for part in parts], counts),
        np.repeat([part.mass.high for part in parts], counts),
        desired_speed=np.repeat([part.desired_speed.high for part in parts], counts),
        relaxation_time=np.repeat([part.relaxation_time.low for part in parts], counts),
        env_start=np.cumsum([0, *(scenario.population.count for scenario in scenarios)]),
    )
