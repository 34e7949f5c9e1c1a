"""Trained networks: numbers in a file that opens without running anything, and acts as the model did."""

import base64
import io
import json
import os
import zipfile

import numpy as np
import pytest
from evaluations import SMALL, call, random_network, random_policy

from agents import make_policy
from agents.evaluation.evaluation import evaluate
from agents.network import Network, read_network
from agents.trained import LearnedController, LearnedPolicy, load_trained
from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.envs.action import make_action

NARROW = ObservationLayout(terms=("direction", "neighbors"), neighbors=2)


def test_a_saved_policy_is_the_same_policy(tmp_path):
    policy = random_policy(frame="world", observation=NARROW)
    policy.trained = {"scenario": "room-v0", "dt": 0.01}
    policy.save(tmp_path / "model.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["model.npz"]
    read = make_policy(str(tmp_path / "model.npz"))
    assert read.env_options == policy.env_options and read.trained == policy.trained
    single = [weight.astype(np.float32) for weight in policy.network.weights]
    assert all((one == other).all() for one, other in zip(read.network.weights, single, strict=True))
    result = evaluate(read, SMALL, runs=2)
    again = evaluate(LearnedPolicy.load(tmp_path / "model.npz"), SMALL, runs=2)
    assert repr(result.episodes) == repr(again.episodes) and result.policy == "learned"


def test_the_file_says_what_it_is_for(tmp_path):
    random_policy(frame="world", observation=NARROW).save(tmp_path / "a.npz")
    _, facts = read_network(tmp_path / "a.npz")
    assert facts["format"] == "crowd_env network" and facts["version"] == 1 and facts["kind"] == "policy"
    assert facts["layers"] == [NARROW.size, 8, 8, 2] and facts["activation"] == "tanh"
    assert facts["action"] == {"kind": "continuous", "frame": "world"}
    assert facts["observation"]["terms"] == ["direction", "neighbors"]


def test_a_row_comes_out_the_same_in_a_batch_of_any_size():
    network, rng = random_network(48, 2, hidden=64), np.random.default_rng(0)
    rows = rng.uniform(-1.0, 1.0, (301, 48)).astype(np.float32)
    rows[::7] = 0.0  # who is out
    every = network(rows)
    np.testing.assert_array_equal(every, np.concatenate([network(rows[k : k + 1]) for k in range(len(rows))]))
    np.testing.assert_array_equal(every[13:250], network(rows[13:250]))
    assert network(rows[:0]).shape == (0, 2)


def test_actions_stay_within_their_bounds_and_choices_are_the_likeliest():
    layout, rng = ObservationLayout(), np.random.default_rng(0)
    rows = rng.uniform(-1.0, 1.0, (50, layout.size)).astype(np.float32)
    loud = random_policy()
    loud.network = Network((*loud.network.weights[:2], 30 * loud.network.weights[2]), loud.network.biases)
    action = loud.act(rows, layout, rng)
    assert np.abs(action).max() == 1.0 and np.abs(loud.network(rows)).max() > 2.0
    discrete = random_policy(action="discrete")
    assert (discrete.act(rows, layout, rng) == discrete.network(rows).argmax(axis=1)).all()
    env = CrowdEnv(SMALL, action="discrete")
    observation, _ = env.reset([0])
    env.step(discrete.act(observation, layout, rng))
    controller = LearnedController(random_network(5, 7), np.array([3, 2, 2]), {})
    logits = controller.network(rows[:, :5])
    expected = np.column_stack(
        [logits[:, :3].argmax(axis=1), logits[:, 3:5].argmax(axis=1), logits[:, 5:].argmax(axis=1)]
    )
    np.testing.assert_array_equal(controller.act(rows[:, :5], None, rng), expected)


def test_a_policy_is_asked_only_about_observations_it_knows():
    env = CrowdEnv(SMALL)
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match="other observations"):
        random_policy(observation=NARROW).act(observation, env.layout, np.random.default_rng(0))


def test_a_network_has_to_fit_what_it_is_for():
    with pytest.raises(ValueError, match=r"turns 5 numbers into 2; its observation and action have 48 and 2"):
        LearnedPolicy(random_network(5, 2), random_policy().env_options)
    with pytest.raises(ValueError, match="7 outputs for choices among"):
        LearnedController(random_network(5, 7), np.array([3, 3]), {})
    with pytest.raises(ValueError, match="do not fit"):
        Network((np.ones((3, 2)), np.ones((2, 4))), (np.ones(3), np.ones(2)))
    with pytest.raises(ValueError, match="not finite"):
        Network((np.full((3, 2), np.nan),), (np.ones(3),))


# --------------------------------------------------------------------------------------------------------- broken files


def _npz(path, facts=None, **changes):
    """Return the bytes of the file with facts or arrays replaced, or left out if None."""
    with np.load(path) as file:
        arrays = dict(file) | {name: array for name, array in changes.items() if array is not None}
    if facts is not None:
        arrays["facts"] = np.array(json.dumps(json.loads(str(arrays["facts"])) | facts))
    out = io.BytesIO()
    np.savez(out, **{name: array for name, array in arrays.items() if name not in changes or changes[name] is not None})
    return out.getvalue()


def _claims(path):
    """Return the file with an array that says it holds 8 TB."""
    out = io.BytesIO()
    header = (
        b"\x93NUMPY\x01\x00v\x00"
        + b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }".ljust(117)
    )
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            new.writestr(name, header + b"\n" if name == "weight0.npy" else old.read(name))
    return out.getvalue()


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: b"",
        lambda path: b"no zip",
        lambda path: path.read_bytes()[:1000],
        lambda path: _npz(path, weight1=None),
        lambda path: _npz(path, facts={"format": "other"}),
        lambda path: _npz(path, facts={"version": 2}),
        lambda path: _npz(path, facts={"kind": "dancer"}),
        lambda path: _npz(path, facts={"action": {"kind": "continuous"}}),
        lambda path: _npz(path, facts={"action": 3}),
        lambda path: _npz(path, facts={"observation": {"smell": 1}}),
        lambda path: _npz(path, facts={"observation": {"terms": ["smell"]}}),
        lambda path: _npz(path, weight0=np.ones((3, 3), dtype=np.float32)),
        lambda path: _npz(path, weight0=np.array([{"a": 1}], dtype=object)),
        lambda path: _npz(path, bias0=np.full(8, np.inf, dtype=np.float32)),
        lambda path: _npz(path, more=np.ones(3)),
        lambda path: _npz(path)[:-30],
        _claims,
    ],
)  # fmt: skip
def test_a_broken_file_is_refused_by_name_in_one_sentence(tmp_path, harm):
    good, bad = tmp_path / "good.npz", tmp_path / "bad.npz"
    random_policy().save(good)
    bad.write_bytes(harm(good))
    with pytest.raises(ValueError, match=r"bad\.npz"):
        make_policy(str(bad))
    code, _, told = call("--runs", 1, "--policies", bad)
    assert code == 2
    assert told.startswith("error: ") and len(told.splitlines()) == 1 and "bad.npz" in told


@pytest.mark.parametrize("name", ["none.npz", "none.zip"])
def test_a_missing_file_is_refused_by_name(tmp_path, name):
    with pytest.raises(ValueError, match=rf"cannot read the network .*{name}: no such file"):
        make_policy(str(tmp_path / name))


def test_a_policy_is_no_controller_nor_the_other_way_round(tmp_path):
    random_policy().save(tmp_path / "policy.npz")
    LearnedController(random_network(5, 7), np.array([3, 4]), {"scenario": "hall"}).save(tmp_path / "controller.npz")
    with pytest.raises(ValueError, match=r"policy\.npz is a policy of people's own steps"):
        LearnedController.load(tmp_path / "policy.npz")
    with pytest.raises(ValueError, match=r"controller\.npz is a controller"):
        make_policy(str(tmp_path / "controller.npz"))
    with pytest.raises(ValueError, match=r"must end in \.npz"):
        random_policy().save(tmp_path / "policy.zip")


# ------------------------------------------------------------------------------------------------------------- pickles


@pytest.fixture(scope="module")
def model():
    """Return an untrained PPO model and its environment."""
    pytest.importorskip("stable_baselines3")
    from agents.learned import PPOSettings, make_ppo

    env = CrowdEnv(SMALL, autoreset=True, frame="world", observation=NARROW)
    return make_ppo(env, PPOSettings(), seed=0)


def pickled(model, path, payload=None):
    """Write a file of stable-baselines3 as earlier versions did; ``payload`` is pickled into its learning rate."""
    import cloudpickle

    model.save(path, exclude=["rollout_buffer_class", "rollout_buffer_kwargs"])
    with zipfile.ZipFile(path) as old:
        members = {name: old.read(name) for name in old.namelist()}
    if payload is not None:
        data = json.loads(members["data"])
        code = base64.b64encode(cloudpickle.dumps(payload)).decode()
        data["lr_schedule"] = {":type:": "<class 'function'>", ":serialized:": code}
        members["data"] = json.dumps(data).encode()
    options = {"frame": "world", "action": "continuous", "observation": {"terms": NARROW.terms, "neighbors": 2}}
    members["crowd_env.json"] = json.dumps(options).encode()
    with zipfile.ZipFile(path, "w") as new:
        for name, content in members.items():
            new.writestr(name, content)


class Payload:
    """Makes a folder when it is unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def test_what_is_in_a_pickle_is_not_executed(model, tmp_path):
    path, mark = tmp_path / "evil.zip", tmp_path / "executed"
    pickled(model, path, Payload(mark))
    for read in (make_policy, load_trained, LearnedPolicy.load, LearnedController.load):
        with pytest.raises(ValueError, match=r"evil\.zip .*run any code.* --trust-pickle"):
            read(str(path))
    code, _, told = call("--runs", 1, "--policies", path)
    assert code == 2 and "--trust-pickle" in told and not mark.exists()
    path.rename(tmp_path / "evil.npz")  # under another name it is no network
    with pytest.raises(ValueError, match="is not a network"):
        make_policy(str(tmp_path / "evil.npz"))
    assert not mark.exists()
    pickled(model, path, Payload(mark))
    make_policy(str(path), trust_pickle=True)
    assert mark.exists()  # so the payload is one: trust is what keeps it shut


def test_a_trusted_pickle_is_read_and_can_be_saved_as_numbers(model, tmp_path):
    path = tmp_path / "old.zip"
    pickled(model, path)
    policy = make_policy(str(path), trust_pickle=True)
    assert policy.env_options == {"frame": "world", "action": "continuous", "observation": NARROW}
    policy.save(tmp_path / "new.npz")
    rows = np.random.default_rng(0).uniform(-1.0, 1.0, (40, NARROW.size)).astype(np.float32)
    expected = model.predict(rows, deterministic=True)[0]
    for one in (policy, make_policy(str(tmp_path / "new.npz"))):
        np.testing.assert_allclose(one.act(rows, NARROW, None), expected, atol=1e-6)
    code, told, _ = call("--runs", 1, "--policies", path, "--trust-pickle", "--json")
    assert code == 0 and json.loads(told)["rows"][0]["policy"] == "old"
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(ValueError, match=r"old\.zip is not a model saved by crowd_env"):
        make_policy(str(path), trust_pickle=True)


@pytest.mark.parametrize(
    "action", ["continuous", "discrete", {"name": "speeds", "speeds": [0, 0.5, 1]}, "speeds-exits"]
)
def test_the_numbers_act_as_the_model_does(action, tmp_path):
    """Without torch, to 1e-6; weights far from zero, so that tanh bends and bounds cut."""
    torch = pytest.importorskip("torch")
    from agents.learned import PPOSettings, make_ppo
    from agents.learned.export import network_of
    from agents.learned.training import env_options_of

    env = CrowdEnv(SMALL, autoreset=True, action=action)
    model = make_ppo(env, PPOSettings(), seed=3)
    with torch.no_grad():
        for number in model.policy.parameters():
            number.mul_(2.0).add_(0.1 * torch.randn(number.shape))
    policy = LearnedPolicy(network_of(model), env_options_of(env))
    policy.save(tmp_path / "saved.npz")
    saved = make_policy(str(tmp_path / "saved.npz"))
    assert make_action(saved.env_options["action"]) == env.action_kind  # what it acts with is in its file
    rows = np.random.default_rng(0).uniform(-1.0, 1.0, (500, env.layout.size)).astype(np.float32)
    expected = model.predict(rows, deterministic=True)[0]
    found = policy.act(rows, env.layout, None)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    if action == "continuous":
        assert 0.05 < (np.abs(found) == 1.0).mean() < 0.95


def test_acting_needs_no_torch(tmp_path):
    import subprocess
    import sys

    random_policy().save(tmp_path / "a.npz")
    program = f"""
import sys
for name in ("torch", "stable_baselines3"):
    sys.modules[name] = None
from agents import evaluate
sys.exit(evaluate.app(["--runs", "1", "--policies", "{(tmp_path / "a.npz").as_posix()}", "--json"]))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
