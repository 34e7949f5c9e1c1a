"""What a policy is trained with, task by task: place, people, step, action, observation, reward, algorithm and budget.

A preset is a start that was seen to learn, not a part of the task: what is trained is judged in the task as it stands, at its
own physics step and with its own number of people.
"""

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from crowd_env import Scenario, make_scenario
from crowd_env.core.checks import known, whole
from crowd_env.envs.observation.terms import USUAL

from .registry import make_task

# What everyone sees: the usual terms, and of those who are nearer the exit the next one and how many they are.
_WITH_AHEAD = (*USUAL, "ahead")
_HALF = math.pi / 4  # half left


@dataclass(frozen=True)
class Preset:
    """What policies of people's own steps are trained with for a task.

    Parameters
    ----------
    task : name of the task.
    people : how many are trained with; by and large fewer than the policy is judged with.
    dt : s, physics step of training: a longer one than the task's where that changes no distribution and saves time.
    options : of the scenario, where they are others than the task's.
    action : kind of action.
    terms : of the observation.
    reward : table of `RewardWeights`.
    start : what the policy starts as: "rule", full speed along the way, or a policy of `agents.POLICIES` that is cloned.
    ppo : settings of `crowd_env.agents.learned.PPOSettings` that are others than its defaults ...
    once_cloned : ... and those that are others again where learning starts from a cloned rule.
    envs : rooms side by side.
    steps : training steps, summed over all pedestrian slots.
    eval_every, eval_runs : steps between evaluations on validation draws, and how many draws each takes.
    """

    task: str
    _: KW_ONLY
    people: int
    dt: float
    options: Mapping[str, Any] = field(default_factory=dict)
    action: str | Mapping[str, Any] = "speeds"
    terms: tuple[str, ...] = _WITH_AHEAD
    reward: Mapping[str, Any] = field(
        default_factory=lambda: {"weights": {"progress": 0.5, "time": 1.0, "contact": 1.0}, "team_share": 0.0}
    )
    start: str = "rule"
    ppo: Mapping[str, Any] = field(
        default_factory=lambda: {
            "gamma": 0.98,
            "n_steps": 32,
            "batch_size": 4096,
            "n_epochs": 4,
            "ent_coef": 0.001,
        }
    )
    # Small steps and no wish to be random: the clone acts well already, and its logits are sure of it.
    once_cloned: Mapping[str, Any] = field(
        default_factory=lambda: {"learning_rate": 2e-4, "ent_coef": 0.0, "rule_logit": 0.0}
    )
    envs: int = 24
    steps: int = 12_000_000
    eval_every: int = 1_200_000
    eval_runs: int = 24

    def settings(self, start: str) -> dict[str, Any]:
        """Return the settings of PPO for a start."""
        return {**self.ppo, **(self.once_cloned if start != "rule" else {})}

    def place(self, people: int | None = None) -> Scenario:
        """Return the scenario that is trained in, with ``people`` of the same kinds if given.

        Raises
        ------
        ValueError
            If so many do not fit.
        """
        return training_place(
            make_task(self.task).scenario,
            {**make_task(self.task).options, **self.options},
            self.people if people is None else people,
        )


def training_place(scenario: str, options: Mapping[str, Any], people: int | None) -> Scenario:
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


# Everyone alone would rather push in front; who heads the queue pays for those who wait behind.
_CHARGED = {"weights": {"progress": 0.5, "time": 1.0, "contact": 1.0, "head": 5.0}, "team_share": 0.0}

# Where full speed is nearly best, contacts cost little.
_NO_HARM: dict[str, Any] = {
    "reward": {"weights": {"progress": 0.5, "time": 1.0, "contact": 0.1}, "team_share": 0.0},
    "steps": 3_000_000,
    "eval_every": 600_000,
}

# Doors that pass one body at a time: there is an order to find.
_BY_ORDER: dict[str, Any] = {
    "start": "evolution",
    "action": {"name": "speeds", "speeds": [-1.0, -0.5, 0.0, 0.5, 1.0]},
    "reward": _CHARGED,
    "steps": 3_000_000,
    "eval_every": 300_000,
}

_ALL = (
    # A room of 10 m instead of 15 m: the way to the door is shorter, and more of the training happens at the door.
    Preset("competitive-door", people=60, dt=0.01, options={"side": 10.0}, **_BY_ORDER),
    Preset("narrow-door", people=80, dt=0.01, **_BY_ORDER | {"envs": 16}),
    Preset("hertz-room", people=60, dt=0.01, **_BY_ORDER),
    Preset("literal-room", people=20, dt=0.01, envs=48, reward=_CHARGED),
    # Both groups have to agree on a side, which takes many updates.  At full speed alone, or where contacts cost a tenth, lanes
    # form as well, but whoever is slow is pushed along by those behind.
    Preset(
        "counter-flow",
        people=30,
        dt=0.01,
        action={
            "name": "speeds-directions",
            "speeds": [0.6, 1.0],
            "headings": [-_HALF, -_HALF / 2, 0.0, _HALF / 2, _HALF],
        },
        terms=USUAL,
        reward={"weights": {"progress": 0.5, "time": 1.0, "contact": 0.6}, "team_share": 0.0},
        ppo={"gamma": 0.99, "rule_logit": 1.0, "batch_size": 4096},
        envs=16,
        steps=8_000_000,
        eval_every=800_000,
        eval_runs=100,
    ),
    # Doors of 1 m pass two abreast: there is little to gain beside the fastest way.  No progress is paid: it would count the
    # longer way to the other exit at once, and what is saved there only later.
    Preset(
        "two-exit-hall",
        people=150,
        dt=0.01,
        action={"name": "speeds-exits", "speeds": [0.5, 1.0]},
        terms=(*_WITH_AHEAD, "routes", "queues_shown"),
        reward={"weights": {"time": 1.0}, "team_share": 0.5},
        ppo={"gamma": 0.995, "rule_logit": 4.0, "batch_size": 4096},
        envs=4,
        steps=2_400_000,
        eval_every=800_000,
    ),
    # Where to go and in which order: people may follow one another to either door.  More steps lead away from the clone.
    Preset(
        "two-narrow-exits",
        people=100,
        dt=0.01,
        **_BY_ORDER
        | {
            "action": {"name": "speeds-exits", "speeds": [-1.0, -0.5, 0.0, 0.5, 1.0]},
            "terms": (*_WITH_AHEAD, "routes", "queues_shown"),
            "envs": 12,
            "steps": 2_000_000,
        },
    ),
    Preset("room", people=20, dt=0.01, **_NO_HARM | {"envs": 48, "eval_runs": 100}),
    Preset("pillar", people=60, dt=0.01, **_NO_HARM),
    Preset("bottleneck", people=60, dt=0.01, **_NO_HARM),
    Preset("t-junction", people=60, dt=0.01, **_NO_HARM),
    Preset("crossing", people=40, dt=0.01, **_NO_HARM | {"envs": 32}),
)

# Name of the task -> preset.
PRESETS: Mapping[str, Preset] = {preset.task: preset for preset in _ALL}


def make_preset(task: str) -> Preset:
    """Return the preset of a task in `PRESETS`.

    Raises
    ------
    ValueError
        If there is none; the message lists the tasks that have one.
    """
    make_task(task)
    return PRESETS[known("task with a training preset", task, PRESETS)]
