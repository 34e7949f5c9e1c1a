"""What tests of the command that reproduces the figures of Lin, Ma, Lo share."""

import numpy as np

from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.lin2016.room import MOMENTS


def episode(case, seed, times, blocked_since=None):
    """Return a run of which the people got out at these times."""
    people = case.facts["people"]
    exit_time = np.full(people, np.nan)
    exit_time[: len(times)] = times
    numbers = dict.fromkeys(EpisodeMetrics._fields, 0) | {
        "unfinished": people - len(times),
        "evacuation_time": float(times[-1]) if len(times) == people else float("nan"),
        "blocked_since": float("nan") if blocked_since is None else blocked_since,
    }
    end, nobody = float(max(times, default=0.0)), np.zeros(people)
    record = [[[5.0, 5.0, 0.3, 0.0]] * int((exit_time > moment).sum()) for moment in MOMENTS]
    index = np.where(np.isfinite(exit_time), 0, -1)
    metrics = EpisodeMetrics(**numbers)
    return Episode(seed - case.seeds.start, seed, metrics, exit_time, index, nobody, nobody, 1000.0, end, record)


def invented(case, seed):
    """Return what could have come of a run: the paper's times, and blocked above 1.6 m/s in every second draw."""
    people, speed, strength, _ = case.facts.values()
    if speed > 1.6 and seed % 2 == 1:
        out = people - people // 2
        return episode(case, seed, np.arange(float(out)), float(out - 1))
    pace = {200.0: 1.7}.get(strength, 1.2) / min(speed, 1.0) + 0.01 * seed
    return episode(case, seed, pace * np.arange(1.0, people + 1.0))


def stuck(case, seed):
    """Return a run in which nobody got out."""
    return episode(case, seed, np.empty(0), 0.0)


def made_of(figure, settings, outcome=invented):
    """Return a figure of runs that are made up."""
    runs = {key: [outcome(case, seed) for seed in case.seeds] for key, case in figure.cases(settings).items()}
    return figure.reproduce(settings, runs)
