"""The environment of a task: what `CrowdEnv` is made with when the place that it is given is a task."""

import warnings
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from crowd_env.envs.settings import Routing
from crowd_env.envs.tasks.task import Task, named_task
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import Physics, Walking

# What environments are made with that are of no task.
_USUAL: Mapping[str, Any] = {
    "physics": "nsm2",
    "walking": None,
    "routing": None,
    "action": "continuous",
    "observation": None,
    "reward": None,
    "decision_dt": DECISION_DT,
}


def made_for(
    place: Any, people: int | None, time_limit: float | None, given: Mapping[str, Any]
) -> tuple[Task | None, tuple[str, ...], Any, dict[str, Any]]:
    """Return the task, what is another than there, the place, and the arguments of `CrowdEnv` in the order of ``given``.

    Parameters
    ----------
    place : a task, its name or id; anything else is no task, and stays as it is.
    given : arguments of `CrowdEnv`; None = that of the task, or the usual one.

    Raises
    ------
    ValueError
        If the people do not fit, or a part of the physics, walking or routing is refused.

    Warns
    -----
    UserWarning
        If something is another than in the task.
    """
    task = named_task(place)
    _refuse_within(place)
    if task is None:
        return None, (), place, {name: _USUAL[name] if value is None else value for name, value in given.items()}
    own: dict[str, Any] = {**_USUAL, **task.environment()}
    made = {name: own[name] if value is None else _instead(name, value, own, task) for name, value in given.items()}
    others = [name for name in given if _decides(made[name]) != _decides(own[name])]
    others += ["people"] if people not in (None, task.people) else []
    others += ["time_limit"] if time_limit not in (None, task.time_limit) else []
    if others:
        warnings.warn(
            f"{task.id} with another {', '.join(others)}: its figures do not stand beside those of the task",
            stacklevel=4,
        )
    return task, tuple(others), task.place(people), made


def _refuse_within(place: Any) -> None:
    """Refuse a task in a list of places or in a table: the rest of it would get lost."""
    listed = place if isinstance(place, list | tuple) else [place] if isinstance(place, Mapping) else []
    for one in listed:
        name = one.get("name") if isinstance(one, Mapping) else one
        if (task := named_task(name)) is not None:
            raise ValueError(
                f"the task {task.name} stands alone, not in a list or a table: say scenario={task.name!r}, and what is "
                f"another beside it; its place alone is make_scenario({task.name!r})"
            )


def _instead(name: str, value: Any, own: Mapping[str, Any], task: Task) -> Any:
    """Return an argument that is given in place of that of the task; a table of a part changes no other fields."""
    part = own[name]
    if isinstance(part, Physics | Walking | Routing):
        if isinstance(value, Mapping) and set(value) <= {field.name for field in fields(part)}:
            value = replace(part, **value)
        value = type(part).of(value)
    return task.arguments(value)["physics"] if isinstance(value, Physics) else value


def _decides(value: Any) -> Any:
    """Return what of an argument decides what happens: threads do not."""
    return replace(value, threads=1) if isinstance(value, Physics) else value
