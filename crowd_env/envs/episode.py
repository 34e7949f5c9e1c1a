"""The outcome of a decision step, compiled: exits of pedestrians, and ends of episodes."""

from typing import TYPE_CHECKING

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.kernels.jit import kernel
from crowd_env.core.kernels.struct_ref import StructRef, struct_ref
from crowd_env.envs.metrics import EpisodeMetrics, summarise_exits
from crowd_env.envs.reward import Transition
from crowd_env.geometry.entrances import NEVER

if TYPE_CHECKING:  # no part of what kernels are made of
    from crowd_env.physics.simulation.simulation import Simulation


def init_transition(
    simulation: "Simulation", potential: Floats, time_limit: Floats, blocked_after: Floats
) -> StructRef:
    """Return a reference to a `Transition` before the first episode; ``potential`` (P,) [s] is that of now."""
    of_people, of_environments = np.zeros(len(potential)), np.zeros(len(time_limit))
    nobody, none = np.zeros(len(potential), dtype=bool), np.zeros(len(time_limit), dtype=bool)
    return struct_ref(
        Transition(
            inside=nobody,
            left=nobody.copy(),
            travel_time_before=of_people,
            travel_time_after=potential,
            duration=of_people.copy(),
            impulse_magnitude=simulation.results.impulse_magnitude,
            bodies=simulation.bodies,
            state=simulation.state,
            truncated=nobody.copy(),
            impulse=of_people.copy(),
            step_start=of_environments,
            time_limit=time_limit,
            blocked_after=blocked_after,
            last_exit=of_environments.copy(),
            finished=~none,
            ended=none,
            coming=np.zeros(len(time_limit), dtype=np.int64),
        )
    )


def metrics_of(e: int, people: slice, step: Transition, simulation: "Simulation") -> EpisodeMetrics:
    """Return the metrics of the episode so far of environment ``e``, with the slots ``people``."""
    sums, now = simulation.diagnostics, simulation.state.time[e]
    entry, times = simulation.entrances.times_of(e, now), simulation.state.exit_time[people]
    came, turned_away = entry < NEVER, int(np.isnan(entry).sum())  # people that wait outside have not come in
    exits, out = summarise_exits(np.sort(times[came])), np.isfinite(times)
    blocked = now - step.last_exit[e] > step.blocked_after[e]
    since = float(step.last_exit[e]) if out.any() else 0.0
    return EpisodeMetrics(
        evacuation_time=float("nan") if turned_away else exits.last,
        mean_exit_time=exits.mean - (float(entry[out].mean()) if out.any() else 0.0),
        unfinished=exits.missing + turned_away,
        blocked_since=since if exits.missing and blocked else float("nan"),
        flow=exits.flow,
        contact_impulse=float(step.impulse[people][came].mean()) if came.any() else 0.0,
        max_overlap=float(sums.max_overlap[e]),
        mean_overlap=float(sums.overlap_sum[e] / max(sums.overlap_count[e], 1)),
        max_outside=float(sums.max_outside[e]),
        max_speed=float(sums.max_speed[e]),
        escaped=int(simulation.escaped[people].sum()),
        residual=float(sums.residual[e]),
        unconverged=int(sums.unconverged[e]),
    )


@kernel
def update_episode(step: Transition, dt: float) -> None:
    """Write the outcome of a completed step; truncated pedestrians are no longer active.

    Parameters
    ----------
    dt : s, physics step: the time limit is reached when less than half of one is left.
    """
    env_start, left, truncated, duration = step.bodies.env_start, step.left, step.truncated, step.duration
    active, exit_time, time = step.state.active, step.state.exit_time, step.state.time
    for e in range(len(time)):
        begin, end = env_start[e], env_start[e + 1]
        now, start, last, inside = time[e], step.step_start[e], step.last_exit[e], 0
        for i in range(begin, end):
            left[i] = step.inside[i] and not active[i]
            truncated[i] = False
            step.impulse[i] += step.impulse_magnitude[i]
            duration[i] = now - start
            inside += active[i]
            if left[i]:
                duration[i] = exit_time[i] - start
                last = max(last, exit_time[i])
        step.last_exit[e] = last
        stopped = now > step.time_limit[e] - 0.5 * dt or now - last > step.blocked_after[e]
        step.ended[e] = (stopped or inside + step.coming[e] == 0) and not step.finished[e]
        step.finished[e] |= step.ended[e]
        if stopped and inside > 0:
            for i in range(begin, end):
                truncated[i] = active[i]
                active[i] = False
