"""What tests of the command that reproduces the figures of Lin, Ma, Lo share."""

import numpy as np

from crowd_env.reproduce.lin2016.record import Record, Snapshot


def invented(run):
    """Return what could have come of a run: the paper's times, and blocked above 1.6 m/s in every second draw."""
    if run.desired_speed > 1.6 and run.seed % 2 == 1:
        left = run.count // 2
        return Record(tuple(float(k) for k in range(run.count - left)), left, float(run.count - left - 1))
    pace = {200.0: 1.7}.get(run.strength, 1.2) / min(run.desired_speed, 1.0) + 0.01 * run.seed
    times = pace * np.arange(1.0, run.count + 1.0)
    moments = tuple(
        (moment, *(((5.0,) * int((times > moment).sum()),) * 2), *(((0.3,) * int((times > moment).sum()),) * 2))
        for moment in run.moments
    )
    return Record(tuple(times.tolist()), 0, None, tuple(Snapshot(*moment) for moment in moments))
