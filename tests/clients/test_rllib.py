"""RLlib: agents that leave one by one, and one network for all of them."""

import numpy as np
import pytest
from client_examples import client_example

example = client_example("rllib", "torch", "ray", "ray.rllib")

import ray  # noqa: E402

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module", autouse=True)
def cluster():
    ray.cloudpickle.register_pickle_by_value(example)  # other processes cannot import it
    ray.init(
        address="local",
        num_cpus=2,
        include_dashboard=False,
        log_to_driver=False,
        logging_level="ERROR",
        object_store_memory=200_000_000,
    )
    yield
    ray.shutdown()


def test_those_who_get_out_leave_and_the_others_go_on():
    room = example.make_room(example.ROOM)
    observations, _ = room.reset(seed=0)
    inside, left = set(observations), set()
    assert len(inside) == 12
    while True:
        before = set(room.par_env.agents)
        _, _, terminated, truncated, _ = room.step(dict.fromkeys(room.par_env.agents, 4))
        out = {agent for agent in before if terminated[agent]}
        assert not out & left and set(room.par_env.agents) == before - out - {a for a in before if truncated[a]}
        left |= out
        if terminated["__all__"] or truncated["__all__"]:
            break
    assert left == inside


def test_ppo_trains_one_network_on_the_steps_of_everybody():
    algorithm = example.make_algorithm(runners=1)
    (name,) = algorithm.learner_group.get_weights()
    before = algorithm.learner_group.get_weights()[name]
    found = algorithm.train()["env_runners"]
    after = algorithm.learner_group.get_weights()[name]
    algorithm.stop()
    assert name == example.EVERYBODY
    steps, of_agents = found["num_env_steps_sampled"], found["num_agent_steps_sampled"]
    # Those who have left make no steps.
    assert steps >= example.ROLLOUT and steps < sum(of_agents.values()) < 12 * steps
    assert any(not np.array_equal(after[part], before[part]) for part in after)
