"""The evacuations that tables and figures are made of: each is kept as soon as it has ended, and never computed twice."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from crowd_env.analysis.results.config import FREE, run_config
from crowd_env.analysis.results.folder import decode, encode
from crowd_env.core.checks import Plain
from crowd_env.core.executors import Executor, WorkerDied
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.files.store import Store
from crowd_env.envs.rollout import Episode, Recorder, make_batches, simulate_batch
from crowd_env.envs.settings import Routing
from crowd_env.physics import ContactScheme
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.arguments import check_step
from crowd_env.scenarios.cohorts import extreme_bodies
from crowd_env.scenarios.scenario import Scenario

Key = TypeVar("Key")

_MANY = 50  # people; larger crowds are simulated one run at a time, so that a killed command loses little


class Interrupted(Exception):
    """The work was stopped; finished runs are kept."""


@dataclass(frozen=True, eq=False)
class Case:
    """Draws of one place under one scheme: draw ``k`` is that of ``crowd-env run`` with the seed ``k``."""

    label: str  # beginning of the names of its files
    place: Scenario
    scheme: ContactScheme
    seeds: range
    dt: float  # s
    rules: bool = True
    recorder: Recorder | None = None  # what it keeps of a run is ready for JSON
    facts: Plain = field(default_factory=dict)  # that a table names

    @property
    def decision_dt(self) -> float:
        """Time between looks at whether a run is over [s]: about 0.1; the runs do not depend on it."""
        return self.dt * max(1, round(0.1 / self.dt))

    @cached_property
    def identity(self) -> Plain:
        """All that decides a run of a given seed, ready for JSON."""
        config = run_config(self.place, Physics(self.scheme, self.dt), Routing("shortest", self.rules), 1, seed=0)
        kept = "" if self.recorder is None else type(self.recorder).__name__
        decided = {name: value for name, value in config.items() if name not in (*FREE, "seed")}
        return {**decided, "decision_dt": self.decision_dt, "record": kept}

    def name(self, seed: int) -> str:
        """Return the name of a run in a store."""
        return f"{self.label}-{fingerprint(self.identity)}/{seed}"

    def check(self) -> None:
        """Raise ValueError if the crowd does not fit, or the step is too long."""
        people = self.place.population
        people.draw(np.random.default_rng([self.seeds.start, 0]), self.place.geometry)
        check_step(self.scheme, extreme_bodies(people), self.dt)


def evacuate(
    cases: Mapping[Key, Case],
    store: Store,
    executor: Executor,
    *,
    fresh: bool = False,
    progress: Callable[[int], object] = lambda count: None,
) -> dict[Key, list[Episode]]:
    """Return the runs of every case in the order of their seeds, from the store or computed now.

    Parameters
    ----------
    executor : computes the runs; they do not depend on it.
    fresh : compute all of them, whatever is in the store.
    progress : called with the number of runs just done.

    Raises
    ------
    Interrupted
        On Ctrl-C, in one sentence; the runs that had ended by then are in the store.
    ValueError
        If a file cannot be written or a process has died.
    FloatingPointError
        If a person was found outside of the plan: no figure is made of such a run.
    """
    found: dict[Key, dict[int, Episode]] = {key: {} for key in cases}
    pieces = []
    for key, case in cases.items():
        for run, seed in enumerate(case.seeds if not fresh else ()):
            content = store.load(case.name(seed), case.identity, redo=True)
            if content is not None and (episode := decode(run, content)) is not None:
                found[key][run] = episode._replace(record=content.get("record"))
        progress(len(found[key]))
        batches = make_batches(
            case.place,
            len(case.seeds),
            seed=case.seeds.start,
            recorder=case.recorder,
            only=[run for run in range(len(case.seeds)) if run not in found[key]],
            at_once=1 if case.place.population.people >= _MANY else None,
            workers=executor.workers,
            physics=Physics(case.scheme, case.dt),
            routing=Routing(signs=case.rules),
            decision_dt=case.decision_dt,
        )
        pieces += [(key, batch) for batch in batches]
    # What takes longest comes first.
    pieces.sort(key=lambda piece: cases[piece[0]].place.population.people, reverse=True)

    def done(k: int, outcome: Any) -> None:
        key = pieces[k][0]
        for episode in outcome.episodes:
            content = {**encode(episode), "record": episode.record}
            store.keep(cases[key].name(episode.seed), content, cases[key].identity)
            found[key][episode.run] = episode
        progress(len(outcome.episodes))

    def kept() -> str:
        of, ready = sum(len(case.seeds) for case in cases.values()), sum(map(len, found.values()))
        return f"{ready} of {of} runs are kept in {store.folder}; without --fresh, the same command goes on from there"

    try:
        if executor.apart and pieces:  # compile here, once: processes that start together would each do it
            env = pieces[0][1].driver(1).env
            env.reset([0])
            env.step(None)
        executor.run(simulate_batch, [batch for _, batch in pieces], done)
    except KeyboardInterrupt:
        raise Interrupted(kept()) from None
    except OSError as error:
        raise ValueError(f"cannot keep the runs in {store.folder}: {error}") from None
    except WorkerDied as error:
        raise ValueError(f"{error}: {kept()}") from None
    return {key: _sound(cases[key], [runs[run] for run in sorted(runs)]) for key, runs in found.items()}


def _sound(case: Case, episodes: list[Episode]) -> list[Episode]:
    if escaped := sum(episode.metrics.escaped for episode in episodes):
        name = case.scheme.info.name
        raise FloatingPointError(f"{name}: {escaped} people were outside of the plan at some decision; the run is void")
    return episodes
