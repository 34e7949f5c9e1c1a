"""What became of everyone in a decision step, compiled: who got out, who has how far to go, and whose episode is over."""

from crowd_env._jit import kernel
from crowd_env.state import Bodies, Bools, CrowdState, Floats


@kernel
def settle(
    bodies: Bodies,
    state: CrowdState,
    inside: Bools,
    started: Floats,
    time_limit: Floats,
    blocked_after: Floats,
    dt: float,
    crush: Floats,
    last_exit: Floats,
    impulse: Floats,
    finished: Bools,
    duration: Floats,
    left: Bools,
    truncated: Bools,
    ended: Bools,
) -> int:
    """Close the books of a step; return how many environments ended in it.

    Parameters
    ----------
    inside, started : (P,) who was inside at its start, (E,) s when it started.
    time_limit, blocked_after : (E,) s.
    crush : (P,) N s, contact impulses of the step.
    last_exit, impulse, finished : (E,) s, (P,) N s, (E,), of the episode, brought up to date.
    duration, left, truncated, ended : written: (P,) s inside during the step, (P,) who got out, (P,) whom the end of the
        episode found inside, (E,) whose episode ended.  Who is truncated is no longer active.
    """
    env_start, active, exit_time, clock = bodies.env_start, state.active, state.exit_time, state.time
    count = 0
    for e in range(len(clock)):
        now, last, still = clock[e], last_exit[e], 0
        for i in range(env_start[e], env_start[e + 1]):
            left[i] = inside[i] and not active[i]
            truncated[i] = False
            impulse[i] += crush[i]
            duration[i] = now - started[e]
            still += active[i]
            if left[i]:
                duration[i] = exit_time[i] - started[e]
                last = max(last, exit_time[i])
        last_exit[e] = last
        stopped = now > time_limit[e] - 0.5 * dt or now - last > blocked_after[e]
        ended[e] = (stopped or still == 0) and not finished[e]
        count += ended[e]
        finished[e] = finished[e] or ended[e]
        if stopped and still > 0:
            for i in range(env_start[e], env_start[e + 1]):
                truncated[i] = active[i]
                active[i] = False
    return count
