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
from pathlib import Path
from typing import Any, Literal

import numpy as np

from crowd_env import FULL_SPEED, Physics, Pulls, Routing, Scenario, make_scenario, make_scheme
from crowd_env.core.behaviors.headway import Headway, Manner
from crowd_env.core.checks import known, whole
from crowd_env.core.files.fingerprint import counting_fields, fingerprint
from crowd_env.envs.settings import EnvArguments
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import AsPhysics

from ..evaluation.evaluation import HELD_OUT_SEED
from ..plain import Plain

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
    probe : what it does in this version, see `crowd_env.agents.tasks.probe`.
    references : SHA-256 of the file of rules that submissions are held against, its first 16 digits; "" = any file.
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


FILE = Path(__file__).with_name("tasks.toml")
# Name -> task.
TASKS: dict[str, Task] = {
    name: Task(name, **facts) for name, facts in tomllib.loads(FILE.read_text(encoding="utf-8")).items()
}


def make_task(name: str) -> Task:
    """Return the task of a name in `TASKS`.

    Raises
    ------
    ValueError
        If it is unknown; the message lists the known ones.
    """
    return TASKS[known("task", name, TASKS)]
