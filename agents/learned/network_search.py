"""Search in the parameters of a network without hidden layers: it explores by noise in weights, and follows no gradient.

All pedestrians of a room share the noise for an episode, whose return is the last exit (parameter exploration; Sehnke et al.
2010).  The network is a linear map of the standardized observation (Mania, Guy, Recht 2018).  Separable CMA-ES (Ros, Hansen
2008) samples it.  Unlike `crowd_env.agents.learned.evolution` it sees all that learned policies of the task see.
"""

from functools import partial

import numpy as np

from crowd_env import ObservationLayout
from crowd_env.core.arrays.state import Floats
from crowd_env.envs.action import RULE, SpeedTable, make_action
from crowd_env.envs.tasks.task import HELD_OUT_SEED

from ..networks import MLP
from ..policy import Policy
from ..trained import LearnedPolicy
from ..training_config import TrainingConfig, physics_of, place_of
from .callbacks import EvaluationCallback
from .evolution import SHARE, begun, race, rooms

POPULATION, DRAWS = 24, 3  # candidates of a generation, and runs of each on the same draws
_STEP = 0.6  # of the weights of standardized inputs at first
_LEAST = 0.05  # standard deviation of an input: smaller ones may be those of rare events
_SLOWEST = 0.2  # of the constant speeds of the first runs, which standardize


def train(config: TrainingConfig, callback: EvaluationCallback[Policy]) -> None:
    """Search from full speed until the ``callback`` ends it, with half of the pedestrians.

    The first runs, at constant speeds, standardize the observation.  Then the noise of every term is the same: that of each
    column is divided by the root of their number.  Commands have a sideways component where the action of the config has
    several headings.

    Raises
    ------
    ModuleNotFoundError
        If the library cma is not installed.
    """
    place, table = place_of(config), make_action(config.action).decode
    layout, path = ObservationLayout(**config.observation), {"frame": config.frame, "action": make_action("continuous")}
    options = {**path, "observation": layout}
    components = 1 if isinstance(table, SpeedTable) and len(table.headings) == 1 else 2
    people = max(1, round(SHARE * place.population.people))
    env = rooms(place, {**physics_of(config), **options}, people, POPULATION * DRAWS)
    rng, sums = np.random.default_rng(config.seed), np.zeros((2, layout.size))

    def draws() -> list[int]:
        first = int(rng.integers(0, HELD_OUT_SEED - DRAWS))
        return POPULATION * [*range(first, first + DRAWS)]

    def at_constant_speed(seen: np.ndarray, room: np.ndarray) -> Floats:
        rows = seen.astype(np.float64)
        sums[:] += rows.sum(axis=0), (rows**2).sum(axis=0)
        return np.linspace(1.0, _SLOWEST, env.num_envs)[room]

    _, steps = race(env, draws(), at_constant_speed)
    mean, square = sums / steps
    scale = np.sqrt(np.maximum(square - mean**2, _LEAST**2))
    for name in layout.names:  # else the six nearest people drown the rest in noise
        scale[layout[name]] *= np.sqrt(len(mean[layout[name]]))

    def networks(found: Floats) -> tuple[Floats, Floats]:
        """Return weights (N, C, D) and biases (N, C) for vectors (N, C (D + 1)) of a search."""
        found = found.reshape(len(found), components, -1)
        weights = found[..., :-1] / scale
        return weights, found[..., -1] + RULE[:components] - weights @ mean

    def policy(found: Floats) -> LearnedPolicy:
        (weight,), (bias,) = networks(found[None])
        rest = 2 - components
        return LearnedPolicy(MLP((np.pad(weight, ((0, rest), (0, 0))),), (np.pad(bias, (0, rest)),)), options)

    def judged(candidates: Floats) -> tuple[Floats, int]:
        weights, biases = networks(np.repeat(candidates, DRAWS, axis=0))
        return race(env, draws(), lambda seen, room: np.einsum("kd,kcd->kc", seen, weights[room]) + biases[room])

    best = np.zeros(components * (layout.size + 1))
    search = begun(best, _STEP, POPULATION, config.seed, diagonal=True)
    while callback.on_update(steps, partial(policy, best)):
        candidates = np.asarray(search.ask())
        costs, decided = judged(candidates)
        search.tell(candidates, costs.reshape(POPULATION, DRAWS).mean(axis=1))
        best, steps = np.asarray(search.result.xfavorite), steps + decided
