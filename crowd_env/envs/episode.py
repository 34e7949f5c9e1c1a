"""What became of everyone in a decision step, compiled: who got out, and whose episode is over."""

from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.kernels.jit import kernel
from crowd_env.core.kernels.struct_ref import StructRef, struct_ref
from crowd_env.envs.metrics import EpisodeMetrics, summarise_exits
from crowd_env.envs.reward import Transition
from crowd_env.physics.simulation.checkpoint import Arrays, Checkpoint
from crowd_env.physics.simulation.simulation import Simulation


class EpisodeState(NamedTuple):
    """What is kept of a step and of the episodes so far."""

    step: Transition  # who was inside at its start, and what became of them
    step_start: Floats  # (E,)  s    when the step started
    time_limit: Floats  # (E,)  s
    blocked_after: Floats  # (E,)  s
    last_exit: Floats  # (E,)  s    when somebody last got out in this episode; 0 = nobody has
    impulse: Floats  # (P,)  N s  sum of the contact impulse magnitudes of the episode
    finished: Bools  # (E,)   the episode is over, or none has begun
    truncated: Bools  # (P,)   still inside when the episode ended in this step
    ended: Bools  # (E,)   the episode ended in this step


class EnvCheckpoint(NamedTuple):
    """A moment of a `CrowdEnv`; made by `CrowdEnv.checkpoint`, taken up by `CrowdEnv.restore`.  It can be pickled."""

    simulation: Checkpoint
    episode: Arrays  # of the `EpisodeState`
    step: Arrays  # of the `Transition`
    ahead: Arrays  # of the `RouteAhead`
    chosen_at: Floats  # of the `RouteChoice`
    generators: tuple[Any, ...]  # states
    started: bool
    interrupted: bool


def init_episode(step: Any, time_limit: Floats, blocked_after: Floats) -> StructRef:
    """Return an `EpisodeState` for a reference ``step`` to a `Transition`; no episode has begun."""
    people, environments = len(step.fields.inside), len(time_limit)
    return struct_ref(
        EpisodeState(
            step=step,
            step_start=np.zeros(environments),
            time_limit=time_limit,
            blocked_after=blocked_after,
            last_exit=np.zeros(environments),
            impulse=np.zeros(people),
            finished=np.ones(environments, dtype=np.bool_),
            truncated=np.zeros(people, dtype=np.bool_),
            ended=np.zeros(environments, dtype=np.bool_),
        )
    )


def metrics_of(e: int, people: slice, episode: EpisodeState, simulation: Simulation) -> EpisodeMetrics:
    """Return the metrics of the episode so far of environment ``e``, whose slots are ``people``."""
    sums = simulation.diagnostics
    exits = summarise_exits(np.sort(simulation.state.exit_time[people]))
    blocked = simulation.state.time[e] - episode.last_exit[e] > episode.blocked_after[e]
    return EpisodeMetrics(
        evacuation_time=exits.last,
        mean_exit_time=exits.mean,
        unfinished=exits.missing,
        blocked_since=float(episode.last_exit[e]) if exits.missing and blocked else float("nan"),
        flow=exits.flow,
        contact_impulse=float(episode.impulse[people].mean()),
        max_overlap=float(sums.max_overlap[e]),
        mean_overlap=float(sums.overlap_sum[e] / max(sums.overlap_count[e], 1)),
        max_outside=float(sums.max_outside[e]),
        max_speed=float(sums.max_speed[e]),
        escaped=int(simulation.escaped[people].sum()),
        residual=float(sums.residual[e]),
        unconverged=int(sums.unconverged[e]),
    )


@kernel
def update_episode(episode: EpisodeState, dt: float) -> None:
    """Write what became of everyone in a step that is over; those who are truncated are no longer active.

    Parameters
    ----------
    dt : s, physics step: the time limit is reached when less than half of one is left.
    """
    step, env_start = episode.step, episode.step.bodies.env_start
    active, exit_time, time = step.state.active, step.state.exit_time, step.state.time
    left, truncated, duration = step.left, episode.truncated, step.duration
    for e in range(len(time)):
        begin, end = env_start[e], env_start[e + 1]
        now, start, last, inside = time[e], episode.step_start[e], episode.last_exit[e], 0
        for i in range(begin, end):
            left[i] = step.inside[i] and not active[i]
            truncated[i] = False
            episode.impulse[i] += step.impulse_magnitude[i]
            duration[i] = now - start
            inside += active[i]
            if left[i]:
                duration[i] = exit_time[i] - start
                last = max(last, exit_time[i])
        episode.last_exit[e] = last
        stopped = now > episode.time_limit[e] - 0.5 * dt or now - last > episode.blocked_after[e]
        episode.ended[e] = (stopped or inside == 0) and not episode.finished[e]
        episode.finished[e] |= episode.ended[e]
        if stopped and inside > 0:
            for i in range(begin, end):
                truncated[i] = active[i]
                active[i] = False
