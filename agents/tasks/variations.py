"""Variations of the tasks, held out from training: other numbers of people, doors, contact laws, people, and mixed crowds.

They stand beside the tasks, whose digests do not depend on them.  What a policy gains in a task it should not lose here.
"""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

from crowd_env import Scenario

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
    manner: str | None = None
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

_TWICE = Variation("twice", "twice the people", people=2.0)
_MORE = Variation("more", "half as many people again", people=1.5)  # twice as many do not fit
_HALF = Variation("half", "half of the people", people=0.5)
_SLOWER = Variation("slow", "slow people: 1.0 ± 0.2 m/s", population={"desired_speed": _SLOW})
_MIXED = Variation("half-learned", "half of the people follow the rule", learned_share=0.5)
_HURRIED = Variation(
    "half-hurried",
    "half of the people follow the rule, and keep a distance (hurried)",
    learned_share=0.5,
    manner="hurried",
)
_PEOPLE = (_SLOWER, _MIXED, _HURRIED)


def _other(name: str, value: float, about: str) -> Variation:
    """Return a variation by an option [m] of the scenario."""
    return Variation(f"{name.removesuffix('_width')}-{value:g}", f"{about} {value:g} m", options={name: value})


def _under(*schemes: str) -> tuple[Variation, ...]:
    return tuple(Variation(scheme, f"under {scheme}", scheme=scheme) for scheme in schemes)


def _door(*widths: float) -> tuple[Variation, ...]:
    return tuple(_other("door_width", width, "a door of") for width in widths)


def _width(*widths: float) -> tuple[Variation, ...]:
    return tuple(_other("width", width, "a width of") for width in widths)


# Task -> what it is varied by, in the order of tables; no preset of training has any of these widths.
VARIATIONS: dict[str, tuple[Variation, ...]] = {
    "competitive-door": (_TWICE, *_door(0.8, 1.2), *_under("dem", "nsm2"), *_PEOPLE),
    "narrow-door": (_TWICE, *_door(0.55, 0.7), *_under("dem", "hertz"), *_PEOPLE),
    "hertz-room": (_TWICE, *_door(0.7, 1.0), *_under("nsm2"), *_PEOPLE),
    "literal-room": (_TWICE, *_door(0.7, 1.0), *_under("hertz"), *_PEOPLE),
    "counter-flow": (_TWICE, *_width(1.6, 2.5), *_under("dem", "hertz"), *_PEOPLE),
    "two-exit-hall": (_TWICE, *_door(0.8, 1.3), *_under("dem", "hertz"), *_PEOPLE),
    "two-narrow-exits": (_TWICE, *_door(0.6, 0.8), *_under("dem", "hertz"), *_PEOPLE),
    "theatre": (_HALF, *_under("dem", "hertz"), *_PEOPLE),
    "floor": (_TWICE, _other("exit_width", 0.9, "exits of"), *_under("dem", "hertz"), *_PEOPLE),
    "large-hall": (_HALF, *_door(2.0), *_under("nsm2"), *_PEOPLE),
    "room": (_TWICE, *_door(0.7, 1.0), *_under("dem", "hertz"), *_PEOPLE),
    "pillar": (_TWICE, *_door(1.2), _other("distance", 0.7, "a pillar at"), *_under("nsm2"), *_PEOPLE),
    "bottleneck": (_TWICE, *_width(0.8, 1.4), *_under("nsm2"), *_PEOPLE),
    "t-junction": (_MORE, *_width(1.8, 3.0), *_under("nsm2"), *_PEOPLE),
    "crossing": (_TWICE, *_width(3.0, 5.0), *_under("dem", "hertz"), *_PEOPLE),
}


def variations(task: Task) -> tuple[Variation, ...]:
    """Return a task as it stands and its variations; of a task that is not registered, those of people alone."""
    held_out = VARIATIONS[task.name] if task.name in TASKS and task.name in VARIATIONS else (_TWICE, *_PEOPLE)
    return AS_IT_STANDS, *held_out
