"""Pedestrians that see only a part of the others: another stands in between, or they look elsewhere."""

import numpy as np
from numpy.typing import NDArray

from crowd_env import CrowdEnv
from crowd_env.core.arrays.state import Bools
from crowd_env.envs.observation.observer import Observer

_HIDDEN = 9  # beside its seed: what hides people in a run


class Sight:
    """What people observe while each of the others is unseen by them with a fixed probability.

    In every decision the pedestrians of an environment fall into n groups at random.  A group does not see the next one, as if
    it were not there: of every pair the one misses the other in one decision of n.  This holds for all that is seen of others:
    density, nearest neighbors, pedestrians ahead, queues.  What is felt, and what is known of walls and ways, stays.

    Parameters
    ----------
    env : of the pedestrians that observe.
    share : of the others that a pedestrian does not see, 1 / n.

    Raises
    ------
    ValueError
        If the share is not 1 / n of a whole n from 2 on.
    """

    def __init__(self, env: CrowdEnv, share: float) -> None:
        self.groups = round(1.0 / share) if 0.0 < share <= 0.5 else 0
        if self.groups < 2 or abs(self.groups * share - 1.0) > 1e-9:
            raise ValueError(f"unseen is {share:g}; it must be 1 / n of a whole n from 2 on, such as 0.5 or 0.2")
        self.env = env
        ways = env.observer.view.fields.ways
        in_world = env.action_kind.frame == "world"
        # Of all pairs: cells of the physics would show everyone inside.
        self._observer = Observer(env.simulation, env.layout, ways, in_world=in_world, all_pairs=env.num_people)

    def reset(self, seeds: list[int]) -> None:
        """Start again; the seed of an environment alone decides which pedestrians are unseen there."""
        self._rngs = [np.random.default_rng((seed, _HIDDEN)) for seed in seeds]

    def observe(self) -> NDArray[np.float32]:
        """Return the observation (P, D) of a decision; zero for pedestrians that are out."""
        people = np.diff(self.env.env_start).tolist()
        group = np.concatenate([rng.integers(self.groups, size=n) for rng, n in zip(self._rngs, people, strict=True)])
        found = np.zeros((self.env.num_people, self.env.layout.size), dtype=np.float32)
        for k in range(self.groups):
            there: Bools = self.env.active & (group != (k + 1) % self.groups)
            mine = self.env.active & (group == k)
            found[mine] = self._observer.observe(there)[mine]
        return found
