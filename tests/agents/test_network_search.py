"""The search in the weights of a network: a known optimum, the network that it returns, and what its seed fixes."""

import numpy as np
from cases import looped
from late import late

from crowd_env import ObservationLayout
from crowd_env.agents.training_config import default_config
from crowd_env.envs.tasks.task import HELD_OUT_SEED

search = late("crowd_env.agents.learned.network_search")
SPEEDS = {"speeds": 1, "speeds-directions": 2}  # kind of action -> components of a command


class Generations:
    """Lets a search go on for so many generations."""

    def __init__(self, count):
        self.left, self.policies, self.steps = count, [], []

    def on_update(self, steps, policy):
        self.policies.append(policy())
        self.steps.append(steps)
        self.left -= 1
        return self.left >= 0

    @property
    def numbers(self):
        """The numbers of every network."""
        return [np.hstack([one.ravel() for one in policy.network.tensors().values()]) for policy in self.policies]


def searched(generations, seed=3, **given):
    config = default_config("room-v0", "nsm2", seed, 1, 5000, 5.0, people=6, **{"action": "speeds", **given})
    found = Generations(generations)
    search.train(config, found)
    return found


@looped(("action", "components"), SPEEDS.items())
def test_the_search_finds_the_best_map_of_what_is_seen(action, components, monkeypatch):
    """With a made-up cost: the distance to known commands, linear in inputs of different size."""
    rows = (np.random.default_rng(0).normal(size=(60, 4)) * [0.1, 30.0, 0.3, 0.3]).astype(np.float32)
    wanted = np.column_stack([0.6 - 4.0 * rows[:, 0], 0.01 * rows[:, 1]])[:, :components]

    def race(env, seeds, decide):
        rooms = np.repeat(np.arange(env.num_envs), len(rows))
        command = decide(np.tile(rows, (env.num_envs, 1)), rooms).reshape(env.num_envs, len(rows), -1)
        return ((command - wanted) ** 2).mean(axis=(1, 2)), len(rooms)

    monkeypatch.setattr(search, "race", race)
    layout = ObservationLayout(terms=("velocity", "travel_time", "density")).as_table()
    command = searched(50, action=action, observation=layout).policies[-1].network(rows)
    np.testing.assert_allclose(command[:, :components], wanted, atol=0.01)
    assert components == 2 or not command[:, 1].any()


def test_the_columns_of_a_term_share_its_noise(monkeypatch):
    """The noise of a command, summed over the columns of a term, is the same for a term of 30 columns and for one."""
    commands = []

    def race(env, seeds, decide):
        size = env.layout.size
        rows = np.vstack([np.zeros(size), np.eye(size)])
        rooms = np.repeat(np.arange(env.num_envs), len(rows))
        commands.append(decide(np.tile(rows, (env.num_envs, 1)), rooms).reshape(env.num_envs, -1))
        return np.arange(env.num_envs), len(rooms)

    monkeypatch.setattr(search, "race", race)
    monkeypatch.setattr(search, "POPULATION", 400)
    monkeypatch.setattr(search, "DRAWS", 1)
    layout = searched(1).policies[0].env_options["observation"]
    noise = (commands[1][:, 1:] - commands[1][:, :1]).var(axis=0)
    noises = [noise[layout[name]].sum() for name in layout.names]
    assert len(noises) > 5 and np.ptp(noises) < 0.3 * np.mean(noises)


def test_a_search_begins_at_full_speed_takes_training_draws_and_can_be_repeated(monkeypatch):
    draws, race = [], search.race
    monkeypatch.setattr(search, "POPULATION", 4)

    def recorded(env, seeds, decide):
        draws.append(seeds)
        return race(env, seeds, decide)

    monkeypatch.setattr(search, "race", recorded)
    first, again, other = searched(2), searched(2), searched(2, 4)
    assert all(map(np.array_equal, first.numbers, again.numbers)) and first.steps == again.steps
    assert not np.array_equal(first.numbers[1], other.numbers[1])
    rows = np.random.default_rng(0).normal(size=(5, first.policies[0].network.inputs))
    assert (first.policies[0].network(rows) == (1.0, 0.0)).all() and not (first.policies[2].network(rows) == 1.0).all()
    assert all(seeds == 4 * seeds[:3] and max(seeds) < HELD_OUT_SEED for seeds in draws)  # all are judged on the same
    assert draws[0] != draws[1] and draws[:3] == draws[3:6]
    assert 0 < first.steps[0] < first.steps[1] < first.steps[2]
