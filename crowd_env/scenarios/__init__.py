"""The scenarios that ship with crowd_env, by name."""

from collections.abc import Callable
from typing import Any

from crowd_env.scenario import Scenario
from crowd_env.scenarios.lin_room import lin_room
from crowd_env.scenarios.room import room

# Name -> function that makes the scenario; its keyword arguments are the scenario's options.
SCENARIOS: dict[str, Callable[..., Scenario]] = {
    "room-v0": room,
    "lin-room-v0": lin_room,
}


def make_scenario(scenario: str | Scenario, **options: Any) -> Scenario:
    """Return a scenario by name, made with ``options``, or the scenario itself.

    Raises
    ------
    ValueError
        If the name or an option is unknown; the message lists the known ones.
    """
    if isinstance(scenario, Scenario):
        if options:
            raise ValueError(f"options {', '.join(options)} need a scenario name, not a finished scenario")
        return scenario
    if scenario not in SCENARIOS:
        raise ValueError(f"unknown scenario {scenario!r}; known: {', '.join(SCENARIOS)}")
    make = SCENARIOS[scenario]
    known = make.__kwdefaults__ or {}
    unknown = [name for name in options if name not in known]
    if unknown:
        raise ValueError(f"{scenario} has no option {unknown[0]!r}; known: {', '.join(known)}")
    return make(**options)
