"""Variations of the tasks, held out from training: other numbers of people, doors, contact laws and people, mixed crowds, the
place seen from another side, and policies that see less well or are late.

They stand beside the tasks, whose digests do not depend on them.  What a policy gains in a task it should not lose here.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path

import numpy as np

from crowd_env import Scenario
from crowd_env.envs.tasks.task import TASKS, Task

from ..plain import Plain

_SLOW = {"distribution": "normal", "mean": 1.0, "sd": 0.2, "low": 0.5, "high": 1.5}  # m/s  many old people


@dataclass(frozen=True)
class Variation:
    """What is other than in a task.

    Parameters
    ----------
    name : what tables and files call it.
    about : a line for people.
    people : times the number of the task; more people have more time.
    options : of the scenario.
    population : distributions of everyone.
    scheme : contact law, at its own step.
    learned_share : of the people who follow the policy; None: all.
    angle : rad, by which the whole place is turned to the left.
    mirrored : the place is, before it is turned.
    noise, delay, unseen : of what a policy sees and decides, see `crowd_env.agents.drivers.PolicyDriver`.
    """

    name: str
    about: str
    _: KW_ONLY
    people: float = 1.0
    options: Plain = field(default_factory=dict)
    population: Plain = field(default_factory=dict)
    scheme: str | None = None
    learned_share: float | None = None
    angle: float = 0.0
    mirrored: bool = False
    noise: float = 0.0
    delay: float = 0.0
    unseen: float = 0.0

    def hindrances(self) -> dict[str, float]:
        """Return by what policies are hindered: fields of `crowd_env.agents.drivers.Hindrance`."""
        return {name: value for name in ("noise", "delay", "unseen") if (value := getattr(self, name))}

    def place(self, task: Task) -> Scenario:
        """Return the scenario of the task, varied.

        Raises
        ------
        ValueError
            If so many people do not fit.
        """
        place = replace(task, options={**task.options, **self.options}).place(round(self.people * task.people))
        if self.angle or self.mirrored:
            place = place.turned(self.angle, self.mirrored)
        return replace(place, population=place.population.changed(**self.population)) if self.population else place


AS_IT_STANDS = Variation("task", "the task as it stands")

# What every task is varied by.
_ALWAYS = (
    Variation("slow", "slow people: 1.0 ± 0.2 m/s", population={"desired_speed": _SLOW}),
    Variation("unfollowing", "30 % of the people follow the rule", learned_share=0.7),
    Variation("turned", "the place turned by 137 degrees", angle=np.radians(137.0)),
    Variation("mirrored", "the place mirrored", mirrored=True),
    Variation("noise", "all that a policy sees disturbed by 0.05", noise=0.05),
    Variation("delay", "decisions take effect after 0.3 s", delay=0.3),
)
# Times the people of the task.
_CROWDS = {
    2.0: Variation("twice", "twice the people", people=2.0),
    1.5: Variation("more", "half as many people again", people=1.5),  # where twice as many do not fit
    0.5: Variation("half", "half of the people", people=0.5),
}
# Option [m] of a scenario -> what it is.
_OPTIONS = {"door_width": "a door of", "exit_width": "exits of", "width": "a width of", "distance": "a pillar at"}


def _read(facts: Plain) -> Iterator[Variation]:
    """Yield the variations of a task in ``variations.toml``, in the order of tables."""
    yield _CROWDS[facts["people"]]
    for name in (one for one in _OPTIONS if one in facts):
        value, short = facts[name], name.removesuffix("_width")
        yield Variation(f"{short}-{value:g}", f"{_OPTIONS[name]} {value:g} m", options={name: value})
    for scheme in facts["physics"]:
        yield Variation(scheme, f"under {scheme}", scheme=scheme)
    yield from _ALWAYS


_FILE = Path(__file__).with_name("variations.toml")
# Task -> what it is varied by.
VARIATIONS: dict[str, tuple[Variation, ...]] = {
    name: tuple(_read(facts)) for name, facts in tomllib.loads(_FILE.read_text(encoding="utf-8")).items()
}


def variations(task: Task) -> tuple[Variation, ...]:
    """Return a task as it stands and its variations: of one that is not registered, those of all tasks and twice the people."""
    held_out = VARIATIONS[task.name] if task.name in TASKS and task.name in VARIATIONS else (_CROWDS[2.0], *_ALWAYS)
    return AS_IT_STANDS, *held_out
