"""Variations of the tasks, held out from training: other numbers of people, doors, contact laws, people, and mixed crowds.

They stand beside the tasks, whose digests do not depend on them.  What a policy gains in a task it should not lose here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Any

import tomllib

from crowd_env import MANNERS, Headway, Scenario

from .task import TASKS, Task

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
    manner : of the people who follow the rule.
    learned_share : of the people who follow the policy; None: all.
    """

    name: str
    about: str
    _: KW_ONLY
    people: float = 1.0
    options: Mapping[str, Any] = field(default_factory=dict)
    population: Mapping[str, Any] = field(default_factory=dict)
    scheme: str | None = None
    manner: Headway | None = None
    learned_share: float | None = None

    def place(self, task: Task) -> Scenario:
        """Return the scenario of the task, varied.

        Raises
        ------
        ValueError
            If so many people do not fit.
        """
        other = replace(task, options={**task.options, **self.options}, manner=self.manner or task.manner)
        place = other.place(round(self.people * task.people))
        return replace(place, population=place.population.changed(**self.population)) if self.population else place


AS_IT_STANDS = Variation("task", "the task as it stands")

_SLOWER = Variation("slow", "slow people: 1.0 ± 0.2 m/s", population={"desired_speed": _SLOW})
_MIXED = Variation("half-learned", "half of the people follow the rule", learned_share=0.5)
_HURRIED = Variation(
    "half-hurried",
    "half of the people follow the rule, and keep a distance (hurried)",
    learned_share=0.5,
    manner=MANNERS["hurried"],
)
_PEOPLE = (_SLOWER, _MIXED, _HURRIED)
# Times the people of the task.
_CROWDS = {
    2.0: Variation("twice", "twice the people", people=2.0),
    1.5: Variation("more", "half as many people again", people=1.5),  # where twice as many do not fit
    0.5: Variation("half", "half of the people", people=0.5),
}
# Option [m] of a scenario -> what it is.
_OPTIONS = {"door_width": "a door of", "exit_width": "exits of", "width": "a width of", "distance": "a pillar at"}


def _read(facts: Mapping[str, Any]) -> Iterator[Variation]:
    """Yield the variations of a task in ``variations.toml``, in the order of tables."""
    yield _CROWDS[facts["people"]]
    for name, about in _OPTIONS.items():
        for value in facts.get(name, ()):
            short = name.removesuffix("_width")
            yield Variation(f"{short}-{value:g}", f"{about} {value:g} m", options={name: value})
    for scheme in facts["physics"]:
        yield Variation(scheme, f"under {scheme}", scheme=scheme)
    yield from _PEOPLE


_FILE = Path(__file__).with_name("variations.toml")
# Task -> what it is varied by.
VARIATIONS: dict[str, tuple[Variation, ...]] = {
    name: tuple(_read(facts)) for name, facts in tomllib.loads(_FILE.read_text(encoding="utf-8")).items()
}


def variations(task: Task) -> tuple[Variation, ...]:
    """Return a task as it stands and its variations; of a task that is not registered, those of people alone."""
    held_out = VARIATIONS[task.name] if task.name in TASKS and task.name in VARIATIONS else (_CROWDS[2.0], *_PEOPLE)
    return AS_IT_STANDS, *held_out
