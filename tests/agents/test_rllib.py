"""Training with RLlib: it begins as the rule, goes on when a runner or its node dies, and leaves what the native one leaves."""

import csv
import json
import os
import signal
from dataclasses import asdict, replace

import numpy as np
import pytest
from cases import looped
from repository import ROOT
from training_runs import with_ppo

ray = pytest.importorskip("ray", reason="Ray is not installed: an environment of its own has it, see docs/ray.md")
pytest.importorskip("ray.rllib", reason="RLlib is not installed: pip install 'ray[rllib]'")
pytestmark = pytest.mark.nightly

import torch  # noqa: E402

from crowd_env.agents.learned.generalist import KEPT  # noqa: E402
from crowd_env.agents.learned.rllib import training  # noqa: E402  (these load RLlib)
from crowd_env.agents.learned.rllib.runner import _Seen  # noqa: E402
from crowd_env.agents.trained import LearnedPolicy  # noqa: E402
from crowd_env.agents.training_config import generalist_config, make_env, places_of_tasks, task_config  # noqa: E402
from crowd_env.core.files.json_file import write_json  # noqa: E402

MEMORY = {"object_store_memory": 150_000_000}


def config(**changes):
    found = task_config("literal-room", 0, people=6, envs=2, steps=2_000, minutes=30.0)
    found = with_ppo(found, n_steps=16, n_epochs=2, hidden=8)
    return replace(found, **{"backend": "rllib", "eval_every": 10**9, "eval_runs": 2} | changes)


@pytest.fixture(scope="module")
def nodes():
    """A cluster of a head, which learns, and of two nodes of one core each, which simulate."""
    from ray.cluster_utils import Cluster

    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setenv("PYTHONPATH", str(ROOT), prepend=":")
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **MEMORY})
    cluster.doomed = [cluster.add_node(num_cpus=1, **MEMORY) for _ in range(2)]
    ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
    yield cluster
    ray.shutdown()
    cluster.shutdown()
    monkeypatch.undo()


def trained(folder, monkeypatch, event, until=lambda healthy: False, **changes):
    """Train with ``event`` happening after two updates, and stop ``until`` the numbers of healthy runners say so.

    Returns whether training came to its end, and steps and healthy runners after each update.
    """
    rows, iterate = [], training._Training._iterate

    def watched(self):
        returns = iterate(self)
        rows.append((self.steps, self.algorithm.env_runner_group.num_healthy_remote_workers()))
        if len(rows) == 2:
            event(self)
        elif until([count for _, count in rows]) and not self.callback.interrupted:
            interrupt(self)
        return returns

    write_json(folder / "config.json", config(**changes).as_table())
    with monkeypatch.context() as patched:
        patched.setattr(training._Training, "_iterate", watched)
        whole = training.train_on_cluster(folder, config(**changes), runners=2)
    return whole, rows


def interrupt(part):
    part.callback.interrupt(signal.SIGINT, None)


def kill_process(part):
    """Kill the process of a runner; its node stays."""
    group = part.algorithm.env_runner_group
    (pid,) = group.foreach_env_runner(lambda runner: os.getpid(), remote_worker_ids=[1], local_env_runner=False)
    os.kill(pid, signal.SIGKILL)


def check_folder(folder):
    """Check that a folder holds a network that evaluation reads, and its curve; return the steps in the curve."""
    policy = LearnedPolicy.load(folder / "best.safetensors")
    env = make_env(config(), envs=1)
    observation, _ = env.reset(seed=0)
    assert policy.act(observation, env.layout, np.random.default_rng(0)).shape == (6,)
    assert (folder / "rllib").is_dir() and not (folder / "rllib.new").exists()
    with (folder / "learning_curve.csv").open() as file:
        return [float(row["steps"]) for row in csv.DictReader(file)]


def test_training_goes_on_when_a_runner_is_killed_and_it_is_begun_again(nodes, tmp_path, monkeypatch):
    def again(healthy):
        return 1 in healthy and healthy[-3:] == [2, 2, 2]

    _, rows = trained(tmp_path, monkeypatch, kill_process, again, steps=10**8)
    steps, healthy = ([row[k] for row in rows] for k in (0, 1))
    assert again(healthy)
    made = np.diff(steps)
    assert made[-1] == made[0] == 2 * made[healthy.index(1)]  # one of two simulates alone, then both do
    assert check_folder(tmp_path)[-1] == steps[-1]


def test_an_interrupted_training_goes_on_from_its_checkpoint(nodes, tmp_path, monkeypatch):
    whole, rows = trained(tmp_path, monkeypatch, interrupt)
    assert not whole and len(rows) == 2
    assert check_folder(tmp_path) == [0.0, rows[-1][0]]
    whole, more = trained(tmp_path, monkeypatch, lambda part: None)
    assert whole and more[0][0] > rows[-1][0] and check_folder(tmp_path)[-1] >= 2_000


def test_it_trains_in_all_places(nodes, tmp_path):
    told = generalist_config(0, people=20, envs=2, steps=1_000, minutes=30.0)
    told = with_ppo(replace(told, eval_every=10**9, eval_runs=2), n_steps=16, n_epochs=1, hidden=8)
    told = replace(told, places=replace(told.places, taught=20, rounds=1))
    everywhere = {"of_seed": {str(k): "rule" for k in range(20)}, "of_beside": ["evolution"] * len(places_of_tasks(20))}
    write_json(tmp_path / KEPT, everywhere)
    assert training.train_on_cluster(tmp_path, told, runners=2)
    env = make_env(told, envs=1)
    policy = LearnedPolicy.load(tmp_path / "best.safetensors")
    assert policy.act(env.reset(seed=0)[0], env.layout, np.random.default_rng(0)).shape == (20,)
    with (tmp_path / "learning_curve.csv").open() as file:
        assert [float(row["steps"]) for row in csv.DictReader(file)] == [0.0, 1_280.0]


@looped("kind", ["speeds", "continuous"])
def test_it_begins_as_the_native_training(kind, tmp_path):
    from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
    from ray.rllib.core.rl_module.rl_module import RLModuleSpec

    from crowd_env.agents.learned.rllib.algorithm import first_policy, model_config, policy_in, state_with

    settings = replace(config().ppo, rule_logit=2.0)
    told = config(action=kind, start="rule", ppo=settings)
    env, first = make_env(told, envs=1), first_policy(told, tmp_path, 1)
    module = RLModuleSpec(
        module_class=DefaultPPOTorchRLModule,
        observation_space=env.single_observation_space,
        action_space=env.single_action_space,
        model_config=asdict(model_config(env, settings)),
    ).build()
    state = state_with({name: value.numpy() for name, value in module.state_dict().items()}, first, -0.5)
    module.load_state_dict({name: torch.as_tensor(value) for name, value in state.items()})
    observation = torch.as_tensor(env.reset(seed=0)[0])
    inputs = module.forward_inference({"obs": observation})["action_dist_inputs"].numpy()
    np.testing.assert_allclose(inputs[:, : first.outputs], first(observation.numpy()), atol=1e-5)
    assert np.array_equal(policy_in(state)(observation.numpy()), first(observation.numpy()))
    if kind == "speeds":
        assert (inputs.argmax(axis=1) == int(env.action_kind.neutral)).all()
    else:
        np.testing.assert_allclose(inputs, np.tile([1.0, 0.0, -0.5, -0.5], (6, 1)), atol=0.1)


def test_stretches_end_where_people_leave_and_where_an_evacuation_begins_anew():
    numbers, views = np.zeros((6, 2), dtype=np.float32), np.zeros((6, 2, 5), dtype=np.float32)
    flags = [np.zeros((6, 2), dtype=np.bool_) for _ in range(3)]
    seen = _Seen(views, views, np.zeros((6, 2), dtype=np.int64), numbers, numbers.copy(), views, *flags)
    seen.inside[:] = [[1, 1], [1, 1], [0, 1], [0, 1], [1, 1], [1, 1]]
    seen.terminated[1, 0] = seen.terminated[3, 1] = True  # both get out; then everybody begins anew
    seen.reward[:] = np.arange(12).reshape(6, 2)
    first, second, third, fourth = seen.episodes()
    assert [len(one) for one in (first, second, third, fourth)] == [2, 2, 4, 2]
    assert [one.is_terminated for one in (first, second, third, fourth)] == [True, False, True, False]
    assert not any(one.is_truncated for one in (first, second, third, fourth))
    assert first.get_rewards().tolist() == [0.0, 2.0] and second.get_rewards().tolist() == [8.0, 10.0]


def test_training_goes_on_when_a_node_is_killed(nodes, tmp_path, monkeypatch, capsys):
    """The last test of the cluster: afterwards it has a node less."""

    def kill_node(part):
        nodes.remove_node(nodes.doomed[0], allow_graceful=False)

    whole, rows = trained(tmp_path, monkeypatch, kill_node, steps=3_000)
    assert whole and rows[-1][0] >= 3_000
    healthy = [count for _, count in rows]
    assert healthy[1] == 2 and healthy[-1] == 1
    assert "1 of 2 workers failed; 1 remain while they restart" in capsys.readouterr().err
    check_folder(tmp_path)
    assert json.loads((tmp_path / "config.json").read_text())["backend"] == "rllib"
