"""The infos of a `ParallelEnv`: for each agent the terms of its reward, and at the end the metrics."""

import pytest

from crowd_env import CrowdEnv, parallel_env

SMALL = {"people": 8, "time_limit": 6.0}


def test_infos_are_those_of_the_step_that_made_them():
    """Each belongs to the agent that it was made for, though others have left since."""
    env, batch = parallel_env(**SMALL), CrowdEnv("room-v0", **SMALL)
    env.reset(seed=1)
    batch.reset([1])
    made = []
    while env.agents:
        agents = env.agents
        made.append((agents, env.step({})[4], batch.step(None).info))
    assert len(made[0][0]) > len(made[-1][0]) > 0
    for agents, infos, terms in made:
        for agent in agents:
            slot = env.possible_agents.index(agent)
            assert infos[agent]["reward/progress"] == terms["reward/progress"][slot]
            assert ("metrics" in infos[agent]) == (infos is made[-1][1])
    assert {repr(info["metrics"]) for info in made[-1][1].values()} == {repr(env.env.metrics(0)._asdict())}


def test_agents_that_are_taken_out_by_hand_are_missed_before_anything_moves():
    env = parallel_env(**SMALL)
    env.reset(seed=1)
    env.agents.remove("pedestrian_3")
    before = env.env.simulation.state.time.copy()
    with pytest.raises(ValueError, match=r"^env\.agents was changed by hand"):
        env.step({})
    assert env.env.simulation.state.time == before
    env.reset(seed=1)
    env.step({})
