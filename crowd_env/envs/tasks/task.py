"""What a task is: where, who, under which contact law, for how long, and which draws are held out.

No task of ``tasks.toml`` changes but with its version: `Task.digest` sums up everything that a task comes to, defaults of the
package included, and `crowd_env.agents.tasks.probe` what the code makes of it.  A test compares both with what is ``frozen``
there.  Where a default has changed, write the old value into the task.  Where that cannot be, or where physics, ways or
observation do other things, raise the version, freeze both anew (``crowd-env freeze``), and judge
everything again: figures of two versions do not stand in one table.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from crowd_env.core.behaviors.headway import Headway, Manner
from crowd_env.core.behaviors.pulls import Pulls
from crowd_env.core.checks import NAMES, Plain, known, whole
from crowd_env.core.files.fingerprint import counting_fields, fingerprint
from crowd_env.envs.observation.layout import USUAL, ObservationLayout
from crowd_env.envs.settings import EnvArguments, Routing
from crowd_env.physics import make_scheme
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import AsPhysics, Physics, Walking
from crowd_env.scenarios import PLACES_OF_TASKS, SCENARIOS, make_scenario
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario

# Training draws from (seed, environment) with seeds below this; from here on draws are held out.
HELD_OUT_SEED = 1_000_000
Decides = Literal["walking", "routing"]
_WORDS = ("name", "title", "reference")  # of a scenario, which change no evacuation


@dataclass(frozen=True)
class Task:
    """What policies are judged on.

    Parameters
    ----------
    name : what the command line and tables call it.
    about : a line for people.
    scenario : name of the scenario.
    options : of the scenario.
    people : how many; another number (`place`) gets as much time for each.
    scheme : contact law.
    dt : s, physics step: the one that its environment would take.
    time_limit : s.
    blocked_after : s without anyone getting out, after which the exits count as blocked and the run ends.
    manner : how people walk under policies that do not say so themselves.
    rule : strategy of the policy ``rule``, along whose ways the other policies walk too.
    decision_dt : s, interval between two decisions of a policy.
    runs : held-out draws of a full evaluation.
    decides : what is to be decided: how everyone walks, or to which exit people are sent (``crowd_env/routing-v0``).
    no_harm : there is little to gain; a policy only must not be slower than the rule.
    learned_share : of the people whom policies move, others in every run; nobody is told that the others walk at full speed.
        None = all.
    selfish : everyone is paid for the own time alone.  Training keeps its last network, and not the one that serves all best.
    version : goes up with every change of the task.
    frozen : digest of this version.
    frozen_learned : `digest_learned` of this version.
    probe : what it does in this version, see `crowd_env.agents.tasks.probe`.
    references : SHA-256 of the file of rules that submissions are held against, its first 16 digits; "" = any file.
    action : kind of action in the environment of its name.
    terms : of the observation there.
    reward : table of `RewardWeights` there; None = the usual ones.
    """

    name: str
    about: str
    _: KW_ONLY
    scenario: str
    options: Plain
    people: int
    scheme: str
    dt: float
    time_limit: float
    blocked_after: float
    frozen: str
    frozen_learned: str = ""
    probe: Sequence[float] = ()
    manner: Manner = "competitive"
    rule: str = "shortest"
    decision_dt: float = DECISION_DT
    runs: int = 200
    decides: Decides = "walking"
    no_harm: bool = False
    learned_share: float | None = None
    selfish: bool = False
    version: int = 1
    references: str = ""
    action: str | Plain = "speeds"
    terms: Sequence[str] = (*USUAL, "ahead")
    reward: Plain | None = None

    @property
    def id(self) -> str:
        """Name and version, by which registries list its environment after ``crowd_env/``."""
        return f"{self.name}{'-task' if f'{self.name}-v0' in SCENARIOS else ''}-v{self.version}"

    @property
    def seeds(self) -> range:
        """The draws of a full evaluation, on which nobody trains."""
        return range(HELD_OUT_SEED, HELD_OUT_SEED + self.runs)

    def place(self, people: int | None = None) -> Scenario:
        """Return the scenario of the task, with ``people`` of the same kinds if given; more people have more time.

        Raises
        ------
        ValueError
            If so many do not fit.
        """
        count = self.people if people is None else whole("--people", people)
        try:
            population = make_scenario(self.scenario, **self.options).population.changed(people=count)
            scenario = make_scenario(self.scenario, **self.options, population=population)
        except ValueError as error:
            raise ValueError(f"task {self.name} cannot have {count} people: {error}") from None
        limit = self.time_limit * max(1.0, count / self.people)
        return replace(scenario, time_limit=limit, blocked_after=self.blocked_after, manner=self.manner)

    def arguments(self, physics: AsPhysics | None = None) -> EnvArguments:
        """Return the arguments of `CrowdEnv` of a run of the task, under its own contact law or under other ``physics``.

        The law of the task has its own step unless ``physics`` gives one.
        """
        part = Physics.of(self.scheme if physics is None else physics)
        if part.dt is None and part.law.info.name == self.scheme:
            part = replace(part, dt=self.dt)
        return {"physics": part, "routing": Routing(self.rule, signs=False), "decision_dt": self.decision_dt}

    def environment(self) -> dict[str, Any]:
        """Return the arguments of `CrowdEnv` that make the environment of the task, beside its `place`."""
        learned = {
            "action": self.action,
            "observation": ObservationLayout(terms=tuple(self.terms)),
            "reward": self.reward,
        }
        return {**self.arguments(), "walking": Walking(self.manner, share=self.learned_share), **learned}

    def configuration(self) -> Plain:
        """Return everything that decides what happens in the task, as plain data."""
        return {
            "scenario": plain_place(self.place()),
            "manner": _plain(Headway.of(self.manner)),
            "scheme": [self.scheme, _plain(make_scheme(self.scheme))],
            "env": _plain({"strategy": self.rule, "decision_dt": self.decision_dt, "dt": self.dt}),
            "seeds": [self.seeds.start, self.seeds.stop],
            **({} if self.learned_share is None else {"learned_share": self.learned_share}),
        }

    def digest(self) -> str:
        """Return a hash of the `configuration`."""
        return fingerprint(self.configuration())

    def digest_learned(self) -> str:
        """Return a hash of what a learner sees, does and is paid for in the environment of the task."""
        return fingerprint(_plain({"action": self.action, "terms": list(self.terms), "reward": self.reward}))

    def identity(self) -> dict[str, object]:
        """Return what files that were made for this very task note of it: name, version and digest."""
        return {"name": self.name, "version": self.version, "digest": self.digest()}


def plain_place(place: Scenario) -> Plain:
    """Return everything in a scenario that decides what happens, as plain data; what is as in the papers goes unsaid."""
    usual = {name: FULL_SPEED[name] for name in ("strategy", "max_drive")} | {"pulls": Pulls(), "balance": None}
    unsaid = [*_WORDS, *(name for name, value in usual.items() if getattr(place, name) == value)]
    return {name: _plain(getattr(place, name)) for name in counting_fields(place) if name not in unsaid}


def place_digest(place: Scenario) -> str:
    """Return a hash of a scenario and of the manner of its people."""
    return fingerprint(plain_place(place), _plain(place.behavior(Headway)))


# Names of today -> the older ones in digests, which do not change with words.
_OLDER = {"Cohorts": "Groups", "GroupCohesion": "Companionship", "group_size": "companions", "groups": "companions"}


def _plain(value: Any) -> Any:
    """Return numbers to nine digits, texts, lists and tables: the same wherever classes stand and however numbers are kept."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if value is None or isinstance(value, int | str):
        return value
    if hasattr(value, "wkb"):  # a shape; rings may begin anywhere
        return _plain([value.area, value.length, value.bounds])
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    names = counting_fields(value) if is_dataclass(value) else list(vars(value))
    names = [name for name in names if name != "group_size" or value.group_size is not None]  # as if it had none
    kind = type(value).__name__
    known = {"": _OLDER.get(kind, kind)}
    return known | {_OLDER.get(name, name): _plain(getattr(value, name)) for name in names}


def _named_place(task: Task) -> Scenario:
    return replace(task.place(), name=task.name)


FILE = Path(__file__).with_name("tasks.toml")
#: name -> task
TASKS: dict[str, Task] = {
    name: Task(name, **facts) for name, facts in tomllib.loads(FILE.read_text(encoding="utf-8")).items()
}
PLACES_OF_TASKS.update({said: partial(_named_place, task) for task in TASKS.values() for said in (task.name, task.id)})
NAMES["task"] = TASKS


def named_task(place: Any) -> Task | None:
    """Return the task that a place means: one itself, or its name or id; None if it means another place.

    Raises
    ------
    ValueError
        If it is the id of another version than that of today.
    """
    if isinstance(place, Task):
        return place
    if not isinstance(place, str):
        return None
    name, _, version = place.rpartition("-v")
    task = TASKS.get(place) or TASKS.get(name.removesuffix("-task"))
    if task is None or place in (task.name, task.id):
        return task
    if place in SCENARIOS or not version.isdecimal():
        return None
    raise ValueError(f"the task {task.name} is at version {task.version}, there is no {place!r}: say {task.id!r}")


def make_task(name: str) -> Task:
    """Return the task of a name in `TASKS`, or of its id.

    Raises
    ------
    ValueError
        If it is unknown; the message lists the known ones.
    """
    return named_task(name) or TASKS[known("task", name, TASKS)]
