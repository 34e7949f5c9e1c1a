"""What no crowd can do better than in a place, and what recorded crowds do there."""

from dataclasses import replace

import numpy as np

from crowd_env import Routing, Scenario
from crowd_env.core.arrays.state import Floats, segment_lengths
from crowd_env.envs.rollout import run_episodes
from crowd_env.envs.tasks.task import Task

from .variations import AS_IT_STANDS, Variation

# 1/(m s)  79 published flows through doors of 0.4 to 2.8 m, among them Kretz, Grünebohm, Schreckenberg 2006 (J. Stat. Mech.
# P10014), Seyfried et al. 2009 (Transp. Sci. 43:395) and Nagai 2006, lie from 1.6 to 2.8; Seyfried's door of 1 m passes 1.9.
RECORDED_FLOW, LARGEST_RECORDED_FLOW = 1.9, 2.8
_BODIES = 2000  # that are drawn for the means of a population
_ALONE = 100  # runs of people who are alone


def exit_widths(place: Scenario) -> Floats:
    """Return the widths (X,) [m] of the exits."""
    return segment_lengths(place.geometry.exits)


def touching_flow(place: Scenario) -> float:
    """Return how many people a second [1/s] pass all exits one behind the other, touching, each at the own desired speed.

    As many walk abreast as bodies of mean width fit into an exit side by side, at least one.  In a zigzag bodies could pass a
    little closer.
    """
    rng = np.random.default_rng(0)
    parts = place.population.parts
    counts = [max(1, _BODIES * part.people // place.population.people) for part in parts]
    bodies = [part.changed(people=n, starts=None).draw_bodies(rng) for part, n in zip(parts, counts, strict=True)]
    width = 2.0 * float(np.concatenate([one.radius for one in bodies]).mean())
    speed = float(np.concatenate([one.desired_speed for one in bodies]).mean())
    abreast = np.maximum(1.0, np.floor(exit_widths(place) / width + 1e-9))
    return float(abreast.sum()) * speed / width


def capacity_time(place: Scenario) -> float:
    """Return how long all people of a place [s] take through its exits at the largest flow that was recorded."""
    return float(place.population.people / (LARGEST_RECORDED_FLOW * exit_widths(place).sum()))


def free_walk_time(task: Task, one: Variation = AS_IT_STANDS) -> float:
    """Return when the last person [s] of a task, varied, would be out if nobody stood in the way: the mean over crowds.

    People walk alone (of crowds of several cohorts, one of each) as the rule says, from places and with bodies that are drawn
    anew in each of 100 runs; of as many of these as the task has people, the last one is out after

        E[max] = sum_k t_(k) [(k / n)^N - ((k - 1) / n)^N]
    """
    people, parts = round(one.people * task.people), len(task.place().population.parts)
    alone = replace(one, people=parts / task.people).place(task)
    arguments = task.arguments(one.scheme)
    if (
        not alone.zones
    ):  # without slow zones the fastest route of a lone pedestrian is the shortest, which takes no planning
        arguments["routing"] = Routing("shortest", signs=False)
    times = np.sort(np.concatenate([one.exit_time for one in run_episodes(alone, _ALONE, seed=0, **arguments)]))
    times = times[np.isfinite(times)]
    share = (np.arange(len(times) + 1) / len(times)) ** people
    return float(times @ np.diff(share))


def bound_time(task: Task, one: Variation = AS_IT_STANDS) -> float:
    """Return when the last person [s] could be out at the flow of the best recorded crowd, or alone if that is later."""
    return max(capacity_time(one.place(task)), free_walk_time(task, one))
