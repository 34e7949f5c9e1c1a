"""Trained networks: numbers in a file that opens without running anything, and acts as the model did."""

import json
import struct
import sys

import numpy as np
import pytest
from cases import looped
from evaluations import SMALL, call, random_network, random_policy
from safetensors import safe_open
from safetensors.numpy import save

from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.agents import make_policy
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.networks import MLP, read_network, write_network
from crowd_env.agents.trained import LearnedController, LearnedPolicy, load_trained
from crowd_env.envs.action import make_action

NARROW = ObservationLayout(terms=("direction", "neighbors"), neighbors=2)


def test_a_saved_policy_is_the_same_policy(tmp_path):
    policy = random_policy(frame="world", observation=NARROW)
    policy.trained = {"scenario": "room-v0", "dt": 0.01}
    policy.save(tmp_path / "model.safetensors")
    assert [path.name for path in tmp_path.iterdir()] == ["model.safetensors"]
    read = make_policy(str(tmp_path / "model.safetensors"))
    assert read.env_options == policy.env_options and read.trained == policy.trained
    single = [weight.astype(np.float32) for weight in policy.network.weights]
    assert all((one == other).all() for one, other in zip(read.network.weights, single, strict=True))
    result = evaluate(read, SMALL, runs=2)
    again = evaluate(LearnedPolicy.load(tmp_path / "model.safetensors"), SMALL, runs=2)
    assert repr(result.episodes) == repr(again.episodes) and result.policy == "learned"


def test_the_file_says_what_it_is_for(tmp_path):
    random_policy(frame="world", observation=NARROW).save(tmp_path / "a.safetensors")
    _, facts = read_network(tmp_path / "a.safetensors")
    assert facts["format"] == "crowd_env network" and facts["version"] == 2 and facts["kind"] == "policy"
    assert facts["network"] == {"kind": "mlp", "activation": "tanh"}
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
    loud.network = MLP((*loud.network.weights[:2], 30 * loud.network.weights[2]), loud.network.biases)
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
    with pytest.raises(ValueError, match=r"turns 5 numbers into 2; its observation and action have 46 and 2"):
        LearnedPolicy(random_network(5, 2), random_policy().env_options)
    with pytest.raises(ValueError, match="7 outputs for choices among"):
        LearnedController(random_network(5, 7), np.array([3, 3]), {})
    with pytest.raises(ValueError, match="do not fit"):
        MLP((np.ones((3, 2)), np.ones((2, 4))), (np.ones(3), np.ones(2)))
    with pytest.raises(ValueError, match="not finite"):
        MLP((np.full((3, 2), np.nan),), (np.ones(3),))


# --------------------------------------------------------------------------------------------------------- broken files


def _file(path, facts=None, **changes):
    """Return the bytes of the file with facts or tensors replaced, or left out if None."""
    with safe_open(path, framework="numpy") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()} | changes  # noqa: SIM118
        said = json.loads(file.metadata()["crowd_env"]) | (facts or {})
    return save({name: one for name, one in tensors.items() if one is not None}, {"crowd_env": json.dumps(said)})


def _header(path, change):
    """Return the file with its header replaced, as text."""
    content = path.read_bytes()
    end = 8 + struct.unpack("<Q", content[:8])[0]
    header = change(json.loads(content[8:end])).encode()
    return struct.pack("<Q", len(header)) + header + content[end:]


def _claims(path):
    """Return the file with a tensor that says it holds 4 TB."""
    return _header(path, lambda header: json.dumps(header | {"weight0": header["weight0"] | {"shape": [10**6, 10**6]}}))


def _reaches(path):
    """Return the file with a tensor that says it ends after the file does."""
    weight = {"dtype": "F32", "shape": [10**6], "data_offsets": [0, 4 * 10**6]}
    return _header(path, lambda header: json.dumps({"__metadata__": header["__metadata__"], "weight0": weight}))


@looped(
    "harm",
    [
        lambda path: b"",
        lambda path: b"no zip",
        lambda path: path.read_bytes()[:1000],
        lambda path: _file(path, weight1=None),
        lambda path: _file(path, facts={"format": "other"}),
        lambda path: _file(path, facts={"version": 1}),
        lambda path: _file(path, facts={"network": {"kind": "forest"}}),
        lambda path: _file(path, facts={"network": {"kind": ["mlp"]}}),
        lambda path: _file(path, facts={"network": {"kind": "mlp", "activation": "sine"}}),
        lambda path: _file(path, facts={"network": {}}),
        lambda path: _file(path, facts={"network": "mlp"}),
        lambda path: _file(path, facts={"kind": "dancer"}),
        lambda path: _file(path, facts={"action": {"kind": "continuous"}}),
        lambda path: _file(path, facts={"action": 3}),
        lambda path: _file(path, facts={"observation": {"smell": 1}}),
        lambda path: _file(path, facts={"observation": {"terms": ["smell"]}}),
        lambda path: _file(path, weight0=np.ones((3, 3), dtype=np.float32)),
        lambda path: _file(path, weight0=np.ones((8, 48))),
        lambda path: _file(path, weight0=np.ones((8, 48), dtype=np.float16)),
        lambda path: _file(path, bias0=np.full(8, np.inf, dtype=np.float32)),
        lambda path: _file(path, more=np.ones(3)),
        lambda path: _file(path, **dict.fromkeys(["weight0", "weight1", "weight2", "bias0", "bias1", "bias2"])),
        lambda path: _file(path)[:-30],
        lambda path: _file(path) + b"more",
        lambda path: _header(path, lambda header: "no JSON"),
        lambda path: _header(path, lambda header: json.dumps({"__metadata__": {"crowd_env": "["}})),
        lambda path: _header(path, lambda header: json.dumps({"__metadata__": {"crowd_env": "[" * 10**5}})),
        lambda path: _header(path, lambda header: json.dumps({"__metadata__": {"format": "np"}})),
        lambda path: _header(path, lambda header: "{}"),
        lambda path: struct.pack("<Q", 2**63) + path.read_bytes()[8:],
        _claims,
        _reaches,
    ],
)  # fmt: skip
def test_a_broken_file_is_refused_by_name_in_one_sentence(tmp_path, harm):
    good, bad = tmp_path / "good.safetensors", tmp_path / "bad.safetensors"
    random_policy().save(good)
    bad.write_bytes(harm(good))
    with pytest.raises(ValueError, match=r"bad\.safetensors"):
        make_policy(str(bad))
    code, _, told = call("--runs", 1, "--policies", bad)
    assert code == 2
    assert told.startswith("error: ") and len(told.splitlines()) == 1 and "bad.safetensors" in told


def test_a_flipped_bit_is_refused_or_harmless(tmp_path):
    """No bit of a file makes reading it fail otherwise than in a sentence."""
    path, bad = tmp_path / "good.safetensors", tmp_path / "bad.safetensors"
    random_policy(observation=NARROW).save(path)
    whole, rng, refused = path.read_bytes(), np.random.default_rng(0), 0
    header = 8 + struct.unpack("<Q", whole[:8])[0]
    for bit in [*range(64), *rng.integers(64, 8 * header, 400), *rng.integers(8 * header, 8 * len(whole), 50)]:
        harmed = bytearray(whole)
        harmed[bit // 8] ^= 1 << (bit % 8)
        bad.write_bytes(bytes(harmed))
        try:
            LearnedPolicy.load(bad)
        except ValueError as error:
            assert "bad.safetensors" in str(error)
            refused += 1
    assert refused > 100


def test_a_file_too_large_is_not_opened(tmp_path, monkeypatch):
    random_policy().save(tmp_path / "a.safetensors")
    monkeypatch.setattr("crowd_env.agents.networks.file._MOST_BYTES", 1000)
    with pytest.raises(ValueError, match=r"a\.safetensors .* bytes; at most 1000 are read"):
        make_policy(str(tmp_path / "a.safetensors"))


def test_a_tensor_is_written_as_it_is_however_it_lies_in_memory(tmp_path):
    weight = np.arange(6.0).reshape(2, 3)
    for k, same in enumerate((weight, np.asfortranarray(weight), np.repeat(weight, 2, axis=1)[:, ::2])):
        write_network(tmp_path / f"{k}.safetensors", MLP((same,), (np.zeros(2),)), {})
        read, _ = read_network(tmp_path / f"{k}.safetensors")
        np.testing.assert_array_equal(read.weights[0], weight)
    assert len({path.read_bytes() for path in tmp_path.iterdir()}) == 1  # the same network is the same file


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match=r"cannot read the network .*none\.safetensors: no such file"):
        make_policy(str(tmp_path / "none.safetensors"))


def test_a_policy_is_no_controller_nor_the_other_way_round(tmp_path):
    random_policy().save(tmp_path / "policy.safetensors")
    LearnedController(random_network(5, 7), np.array([3, 4]), {"scenario": "hall"}).save(
        tmp_path / "controller.safetensors"
    )
    with pytest.raises(ValueError, match=r"policy\.safetensors is a policy of people's own steps"):
        LearnedController.load(tmp_path / "policy.safetensors")
    with pytest.raises(ValueError, match=r"controller\.safetensors is a controller"):
        make_policy(str(tmp_path / "controller.safetensors"))
    with pytest.raises(ValueError, match=r"must end in \.safetensors"):
        random_policy().save(tmp_path / "policy.zip")


# ------------------------------------------------------------------------------------------------------------- pickles


@pytest.fixture(scope="module")
def model():
    """Return an untrained PPO model and its environment."""
    pytest.importorskip("stable_baselines3")
    from crowd_env.agents.learned import PPOSettings, make_ppo

    env = CrowdEnv(SMALL, autoreset=True, action={"name": "continuous", "frame": "world"}, observation=NARROW)
    return make_ppo(env, PPOSettings(), seed=0)


def test_no_pickle_is_opened(model, tmp_path):
    path = tmp_path / "model.zip"
    model.save(path, exclude=["rollout_buffer_class", "rollout_buffer_kwargs"])
    for read in (load_trained, LearnedPolicy.load, LearnedController.load):
        with pytest.raises(ValueError, match=r"must end in \.safetensors"):
            read(str(path))
    code, _, told = call("--runs", 1, "--policies", path)
    assert code == 2 and "path of a learned network (.safetensors)" in told
    path.rename(tmp_path / "model.safetensors")  # under another name it is no network
    with pytest.raises(ValueError, match="is not a network"):
        make_policy(str(tmp_path / "model.safetensors"))


@looped(("activation", "sums"), [("tanh", np.tanh([0.5, -0.5])), ("relu", [0.5, 0.0])])
def test_a_file_says_which_units_a_network_has(activation, sums, tmp_path):
    network = MLP((np.array([[1.0], [-1.0]]), np.eye(2)), (np.zeros(2), np.zeros(2)), activation)
    write_network(tmp_path / "a.safetensors", network, {})
    read, facts = read_network(tmp_path / "a.safetensors")
    assert facts["network"] == {"kind": "mlp", "activation": activation}
    np.testing.assert_allclose(read(np.array([[0.5]], dtype=np.float32)), [sums], atol=1e-7)


@looped("action", ["continuous", "discrete", {"name": "speeds", "speeds": [0, 0.5, 1]}, "speeds-exits"])
def test_the_numbers_act_as_the_model_does(action, tmp_path):
    """Without torch, to 3e-6; weights far from zero, so that units bend and bounds cut."""
    torch = pytest.importorskip("torch")
    from crowd_env.agents.learned import PPOSettings, make_ppo
    from crowd_env.agents.learned.actor_critic import network_of
    from crowd_env.agents.learned.training import env_options_of

    env = CrowdEnv(SMALL, autoreset=True, action=action)
    model = make_ppo(env, PPOSettings(), seed=3)
    with torch.no_grad():
        for number in model.policy.parameters():
            number.mul_(2.0).add_(0.1 * torch.randn(number.shape))
    policy = LearnedPolicy(network_of(model), env_options_of(env))
    policy.save(tmp_path / "saved.safetensors")
    saved = make_policy(str(tmp_path / "saved.safetensors"))
    assert make_action(saved.env_options["action"]) == env.action_kind  # what it acts with is in its file
    rows = np.random.default_rng(0).uniform(-1.0, 1.0, (500, env.layout.size)).astype(np.float32)
    expected = model.predict(rows, deterministic=True)[0]
    found = policy.act(rows, env.layout, None)
    np.testing.assert_allclose(found, expected, atol=3e-6)
    if action == "continuous":
        assert 0.05 < (np.abs(found) == 1.0).mean() < 0.95


@pytest.mark.more
def test_acting_needs_no_torch(tmp_path):
    import subprocess

    random_policy().save(tmp_path / "a.safetensors")
    program = f"""
import sys
for name in ("torch", "stable_baselines3"):
    sys.modules[name] = None
from crowd_env.cli.agents import evaluate
sys.exit(evaluate.app(["--runs", "1", "--policies", "{(tmp_path / "a.safetensors").as_posix()}", "--json"]))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
