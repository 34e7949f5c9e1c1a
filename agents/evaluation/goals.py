"""Where people mean to go: a policy whose people leave by the way that they came from has not led them out.

Physics lets out whoever crosses an exit line.  Two streams that meet in a corridor could therefore step back, each through the
exit behind it.  Whoever has a route of its cohort, and leaves by an exit that it does not lead to, counts as left inside.
"""

import numpy as np

from crowd_env import Scenario
from crowd_env.core.arrays.state import Bools, Ints
from crowd_env.envs.metrics import summarise_exits
from crowd_env.envs.rollout import Episode


def strayed(exit_index: Ints, place: Scenario) -> Bools:
    """Return who of the people of a place (..., N) left by an exit that the route of its cohort does not lead to.

    Parameters
    ----------
    exit_index : (..., N), the row of `Geometry.exits` by which each is out; -1 for those inside.
    """
    leads_to = {route.name: route.exits or place.exits for route in place.routes}
    names = place.geometry.exit_names
    meant = np.ones((place.population.people, len(names) + 1), dtype=bool)  # the last is that of -1
    begin = 0
    for part in place.population.parts:
        if part.route is not None:
            to = leads_to.get(part.route, (part.route,))
            meant[begin : begin + part.people, :-1] = [name in to for name in names]
        begin += part.people
    return ~meant[np.arange(len(meant)), exit_index]


def at_goals(episode: Episode, place: Scenario) -> Episode:
    """Return an evacuation in which people who strayed count as left inside."""
    stray = strayed(episode.exit_index, place)
    if not stray.any():
        return episode
    times = np.where(stray, np.nan, episode.exit_time)
    exits = summarise_exits(np.sort(times))
    found = episode.metrics._replace(
        evacuation_time=exits.last, mean_exit_time=exits.mean, unfinished=exits.missing, flow=exits.flow
    )
    index = np.where(stray, -1, episode.exit_index)
    return episode._replace(metrics=found, exit_time=times, exit_index=index)
