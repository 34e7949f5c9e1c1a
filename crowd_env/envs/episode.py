"""What became of everyone in a decision step, compiled: who got out, and whose episode is over."""

from typing import Any, NamedTuple

import numpy as np

from crowd_env._kernels.jit import kernel
from crowd_env._kernels.struct_ref import StructRef, struct_ref
from crowd_env.envs.reward import Transition
from crowd_env.state import Bools, CrowdState, Floats


class Books(NamedTuple):
    """What is kept of a step and of the episodes so far."""

    step: Transition  # who was inside at its start, and what became of them
    active: Bools  # (P,)
    exit_time: Floats  # (P,)  s
    clock: Floats  # (E,)  s
    started: Floats  # (E,)  s    when the step started
    time_limit: Floats  # (E,)  s
    blocked_after: Floats  # (E,)  s
    last_exit: Floats  # (E,)  s    of the episode
    impulse: Floats  # (P,)  N s  of the episode, sum of contact impulse magnitudes
    finished: Bools  # (E,)
    truncated: Bools  # (P,)   whom the end of the episode found inside
    ended: Bools  # (E,)   whose episode ended in this step


def open_books(step: Any, state: CrowdState, time_limit: Floats, blocked_after: Floats) -> StructRef:
    """Return empty `Books` for a reference ``step`` to a `Transition`; all episodes are finished, none has begun."""
    people, rooms = len(state.active), len(state.time)
    return struct_ref(
        Books(
            step=step,
            active=state.active,
            exit_time=state.exit_time,
            clock=state.time,
            started=np.zeros(rooms),
            time_limit=time_limit,
            blocked_after=blocked_after,
            last_exit=np.zeros(rooms),
            impulse=np.zeros(people),
            finished=np.ones(rooms, dtype=np.bool_),
            truncated=np.zeros(people, dtype=np.bool_),
            ended=np.zeros(rooms, dtype=np.bool_),
        )
    )


@kernel
def settle(books: Books, dt: float) -> None:
    """Close the books of a step; who is truncated is no longer active."""
    step, active, exit_time = books.step, books.active, books.exit_time
    left, truncated, duration = step.left, books.truncated, step.duration
    for e in range(len(books.clock)):
        begin, end = step.env_start[e], step.env_start[e + 1]
        now, started, last, still = books.clock[e], books.started[e], books.last_exit[e], 0
        for i in range(begin, end):
            left[i] = step.inside[i] and not active[i]
            truncated[i] = False
            books.impulse[i] += step.crush[i]
            duration[i] = now - started
            still += active[i]
            if left[i]:
                duration[i] = exit_time[i] - started
                last = max(last, exit_time[i])
        books.last_exit[e] = last
        stopped = now > books.time_limit[e] - 0.5 * dt or now - last > books.blocked_after[e]
        books.ended[e] = (stopped or still == 0) and not books.finished[e]
        books.finished[e] |= books.ended[e]
        if stopped and still > 0:
            for i in range(begin, end):
                truncated[i] = active[i]
                active[i] = False
