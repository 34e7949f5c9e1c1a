"""What a policy is trained with, task by task: place, people, step, algorithm and budget.

A preset is a start that was seen to learn, not a part of the task: what is trained is judged in the task as it stands, at its
own physics step and with its own number of people.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

from crowd_env import Scenario, make_scenario
from crowd_env.core.checks import known, whole
from crowd_env.envs.tasks.task import make_task
from crowd_env.scenarios.generated import VERSION

from ..plain import Plain


@dataclass(frozen=True)
class Preset:
    """What policies of people's own steps are trained with for a task.

    Parameters
    ----------
    task : name of the task.
    people : how many are trained with; by and large fewer than the policy is judged with.
    dt : s, physics step of training: a longer one than the task's where that changes no distribution and saves time.
    options : of the scenario, where they are others than the task's.
    start : what the policy starts as: "rule", full speed along the way, "nothing", what a search from there finds, or a policy
        of `agents.POLICIES` that is cloned.
    ppo : settings of `crowd_env.agents.training_config.PPOSettings` that are others than its defaults ...
    once_cloned : ... and those that are others again where learning starts from a cloned rule.
    envs : rooms side by side.
    steps : training steps, summed over all pedestrian slots.
    eval_every, eval_runs : steps between evaluations on validation draws, and how many draws each takes.
    """

    task: str
    _: KW_ONLY
    people: int
    dt: float
    options: Plain
    start: str
    ppo: Plain
    once_cloned: Plain
    envs: int
    steps: int
    eval_every: int
    eval_runs: int

    def settings(self, start: str) -> Plain:
        """Return the settings of PPO for a start."""
        return {**self.ppo, **(self.once_cloned if start != "rule" else {})}


def training_place(scenario: str, options: Plain, people: int | None) -> Scenario:
    """Return a scenario under options, with so many people of its kinds if that is given.

    Raises
    ------
    ValueError
        If an option is unknown or out of range, or so many people do not fit.
    """
    place = make_scenario(scenario, **options)
    if people is None or people == place.population.people:
        return place
    return make_scenario(scenario, **options, population=place.population.changed(people=whole("--people", people)))


_FILE = Path(__file__).with_name("presets.toml")
_READ = tomllib.loads(_FILE.read_text(encoding="utf-8"))
_USUAL = _READ.pop("usual")
GENERALIST: Plain = _READ.pop("generated")  # what one policy for all places is trained with, see presets.toml
# What a training in all places is for, as files note it: the generator at its version.
ALL_PLACES: Plain = {"name": "generated", "version": VERSION}
# Name of the task -> preset.
PRESETS: Mapping[str, Preset] = {name: Preset(name, **{**_USUAL, **facts}) for name, facts in _READ.items()}


def make_preset(task: str) -> Preset:
    """Return the preset of a task in `PRESETS`.

    Raises
    ------
    ValueError
        If there is none; the message lists the tasks that have one.
    """
    make_task(task)
    return PRESETS[known("task with a training preset", task, PRESETS)]
