"""The places of tasks that a training in generated places visits too."""

from dataclasses import replace
from typing import NamedTuple

from crowd_env import Scenario
from crowd_env.scenarios.generated import Conditions

from .tasks import TASKS
from .tasks.presets import PRESETS, training_place

_LONGEST = 150.0  # s  of a run in the place of a task


class TaskPlace(NamedTuple):
    """A place of a task, and the conditions under which people walk there."""

    name: str
    place: Scenario
    conditions: Conditions


def places_of_tasks(people: int) -> list[TaskPlace]:
    """Return the places of all tasks of at most ``people`` pedestrians, and those in which their presets train."""
    found = []
    for name, task in TASKS.items():
        if task.learned_share is not None or task.selfish or task.people > people:
            continue
        conditions = Conditions(task.scheme, str(task.manner), 0.0)
        places = [task.place()]
        if name in PRESETS and (PRESETS[name].people, PRESETS[name].options) != (task.people, {}):
            preset = PRESETS[name]
            places.append(training_place(task.scenario, {**task.options, **preset.options}, preset.people))
        found += [
            TaskPlace(name, replace(one, time_limit=min(one.time_limit, _LONGEST), strategy=task.rule), conditions)
            for one in places
        ]
    return found
