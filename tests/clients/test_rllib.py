"""RLlib trains on the PettingZoo environment as it stands, in processes of its own."""

import importlib.util

import numpy as np
import pytest
from repository import ROOT

ray = pytest.importorskip("ray", reason="Ray is not installed: an environment of its own has it, see docs/ray.md")
pytest.importorskip("ray.rllib", reason="RLlib is not installed: pip install 'ray[rllib]'")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def cluster():
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


def example():
    spec = importlib.util.spec_from_file_location("rllib_client", ROOT / "examples/clients/rllib.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_ppo_trains_everybody_with_one_network():
    returns = example().main(iterations=2, runners=1)
    assert len(returns) == 2 and np.isfinite(returns[-1])


def test_those_who_get_out_leave_and_the_others_go_on():
    env = example().make_env({"scheme": "nsm2"})
    observations, _ = env.reset(seed=0)
    inside, left = set(observations), set()
    assert len(inside) == 20
    while True:
        actions = {agent: np.array([1.0, 0.0], dtype=np.float32) for agent in env.agents}
        _, _, terminated, truncated, _ = env.step(actions)
        left |= {agent for agent, out in terminated.items() if out and agent != "__all__"}
        assert not left & set(env.agents)
        if terminated["__all__"] or truncated["__all__"]:
            break
    assert left == inside
