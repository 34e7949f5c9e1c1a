"""The contact forces of an evacuation at the moment that tells most, or at a given one."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Episode, rollout
from crowd_env.envs.settings import arguments_of
from crowd_env.physics import ContactScheme
from crowd_env.physics.pressure import ContactForces, contact_forces, mean_contact_forces
from crowd_env.scenarios.scenario import Scenario


def forces_of_run(
    scenario: Scenario,
    scheme: str | ContactScheme,
    *,
    seed: int = 0,
    at: float | None = None,
    seen: Episode | None = None,
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> ContactForces:
    """Return the mean contact forces of the last 0.1 s before ``at`` in the evacuation of one seed.

    Parameters
    ----------
    at : s; default the end if the exits blocked, else the moment when people bear the largest forces in all.
    seen : this evacuation as a `LoadRecorder` saw it, whose record is its own; without it the evacuation is run to find that
        moment.
    progress : called with the number of decisions that have just been run again, and of all up to that moment.
    **options : of `crowd_env.envs.crowd.CrowdEnv`; by default all walk the shortest path.

    Raises
    ------
    ValueError
        If ``at`` is not positive or after the end of the evacuation.
    """
    if at is not None and not (np.isfinite(at) and at > 0):
        raise ValueError(f"the moment of the forces is {at!r} s; it must be > 0 and finite")
    options["scheme"] = scheme
    env = CrowdEnv(scenario, **arguments_of(options))
    if at is None:
        if seen is None:
            (seen,) = rollout(scenario, 1, seed=seed, recorder=LoadRecorder(), **options)
        decisions = _most_telling_decision(seen)
    else:
        decisions = max(int(np.ceil(at / env.decision_dt - 1e-9)), 1)
    env.reset([seed])
    for _ in range(decisions - 1):
        env.step(None)
        if progress is not None:
            progress(1, decisions)
        if env.finished.all():
            end = float(env.simulation.state.time[0])
            raise ValueError(f"the evacuation was over after {end:.1f} s; there are no forces at {at:g} s")
    samples = []
    for _ in range(env.n_substeps):  # not by way of the environment, which takes people out when it is over
        env.simulation.advance()
        if env.simulation.inside[0] > 0:
            samples.append(contact_forces(env.simulation))
    return mean_contact_forces(samples or [contact_forces(env.simulation)])


class LoadRecorder:
    """Adds up the contact impulses [N s] that people bear in each decision step."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Forget the batch before."""
        self._load: list[list[float]] = [[] for _ in range(env.num_envs)]

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Keep what people bear in a step."""
        for e, load in enumerate(self._load):
            load.append(float(env.simulation.results.impulse_magnitude[env.people(e)].sum()))

    def record(self, env: CrowdEnv, e: int) -> list[float]:
        """Return the sum over people of environment ``e``, decision by decision."""
        return list(self._load[e])


def _most_telling_decision(seen: Episode) -> int:
    """Return the number of decisions after which the forces are looked at."""
    load: list[float] = seen.record
    return len(load) if np.isfinite(seen.metrics.blocked_since) else int(np.argmax(load)) + 1
