"""ONNX files say the same as the networks they were made of; ONNX Runtime is the reader of others."""

import json
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cases import looped
from evaluations import random_network, random_policy
from typer import Typer
from typer.testing import CliRunner

from crowd_env import ObservationLayout
from crowd_env.agents.networks import MLP, BetweenMLP
from crowd_env.agents.onnx_graph import to_onnx
from crowd_env.agents.trained import LearnedController, LearnedPolicy
from crowd_env.cli.agents import export
from crowd_env.envs.action import SpeedTable, make_action

LAYOUT = ObservationLayout(terms=("direction", "neighbors"), neighbors=3)
SPEEDS = {"name": "speeds", "speeds": [-0.5, 0.0, 1.0]}

app = Typer(pretty_exceptions_enable=False)
app.command()(export.main)


def call(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def loud(inputs, outputs):
    """Return a network whose outputs go far beyond the bounds of actions."""
    quiet = random_network(inputs, outputs, seed=2, hidden=16)
    return MLP((*quiet.weights[:2], 5.0 * quiet.weights[2]), (*quiet.biases[:2], np.linspace(-1.0, 1.0, outputs)))


def policy(action, outputs):
    options = {"frame": "path", "action": action, "observation": LAYOUT}
    return LearnedPolicy(loud(LAYOUT.size, outputs), options, {"scenario": "room-v0"})


def session(path):
    pytest.importorskip("onnx", reason="the test writes ONNX files: pip install onnx")
    runtime = pytest.importorskip("onnxruntime", reason="the test runs ONNX files: pip install onnxruntime")
    return runtime.InferenceSession(path, providers=["CPUExecutionProvider"])


def exported(found, tmp_path):
    """Return the session of a network that was saved and exported, and what the command printed."""
    pytest.importorskip("onnx", reason="the test writes ONNX files: pip install onnx")
    found.save(tmp_path / "net.safetensors")
    told = call(tmp_path / "net.safetensors", "--onnx", tmp_path / "net.onnx", "--json")
    assert told.exit_code == 0, told.output
    return session(tmp_path / "net.onnx"), json.loads(told.stdout)


def rows(columns, count=2000):
    found = np.random.default_rng(5).uniform(-1.0, 1.0, (count, columns)).astype(np.float32)
    found[::50] = 0.0  # of people who are out
    return found


@looped(("action", "outputs"), [("continuous", 2), ("discrete", 9), (SPEEDS, 3)])
def test_an_exported_policy_acts_as_it_does_here(tmp_path, action, outputs):
    found = policy(action, outputs)
    runs, _ = exported(found, tmp_path)
    seen = rows(LAYOUT.size)
    given = runs.run(None, {"observation": seen})
    expected = found.act(seen, LAYOUT, None)
    if action == "continuous":
        np.testing.assert_allclose(given[0], expected, atol=2e-6)
        assert (
            given[0].shape == (2000, 2) and 0.1 < (np.abs(given[0]) == 1.0).mean() < 0.9
        )  # some are cut, some are not
        return
    chosen, logits = given
    np.testing.assert_allclose(logits, found.network(seen), atol=2e-5)
    best = np.sort(logits, axis=1)
    clear = best[:, -1] - best[:, -2] > 1e-4  # single precision may decide a tie otherwise
    assert clear.mean() > 0.99 and (chosen == expected)[clear].all() and len(set(chosen.tolist())) == outputs


@looped("speeds", [[-0.5, 1.0, 0.0, 0.4], [1.0]])
def test_an_exported_network_acts_between_the_same_speeds(tmp_path, speeds):
    table, found = SpeedTable(speeds, (0.0, 0.5, -0.5)), policy("continuous", 2)
    layers = loud(LAYOUT.size, len(table.commands))
    found.network = BetweenMLP(layers.weights, layers.biases, table=table)
    runs, _ = exported(found, tmp_path)
    seen = rows(LAYOUT.size)
    given, expected = runs.run(["action"], {"observation": seen})[0], found.act(seen, LAYOUT, None)
    close = np.abs(given - expected).max(axis=1) < 1e-4  # single precision may decide a tie otherwise
    assert given.shape == (2000, 2) and close.mean() > 0.995 and len(np.unique(expected.round(3), axis=0)) >= 3


@looped("activation", ["tanh", "relu"])
def test_an_exported_network_has_the_same_units(tmp_path, activation):
    found = policy(SPEEDS, 3)
    found.network = replace(found.network, activation=activation)
    runs, _ = exported(found, tmp_path)
    seen = rows(LAYOUT.size)
    np.testing.assert_allclose(
        runs.run(["logits"], {"observation": seen})[0], found.network(seen), rtol=1e-5, atol=2e-4
    )


def test_an_exported_controller_acts_as_it_does_here(tmp_path):
    found = LearnedController(loud(11, 7), np.array([3, 2, 2]), {"scenario": "hall"})
    runs, told = exported(found, tmp_path)
    seen = rows(11)
    chosen, logits = runs.run(["action", "logits"], {"observation": seen})
    np.testing.assert_allclose(logits, found.network(seen), atol=2e-5)
    assert chosen.shape == (2000, 3) and (chosen == found.act(seen, None, None)).mean() > 0.999
    assert told["metadata"]["choices"] == [3, 2, 2]


def test_the_file_says_what_goes_in_and_what_comes_out(tmp_path):
    found = policy(SPEEDS, 3)
    runs, told = exported(found, tmp_path)
    said = {key: json.loads(text) for key, text in runs.get_modelmeta().custom_metadata_map.items()}
    assert said == told["metadata"] and told["inputs"] == {"observation": ["N", LAYOUT.size]}
    assert ObservationLayout(**said["observation"]) == LAYOUT and said["action"]["frame"] == "path"
    assert make_action(said["action"]["kind"]) == make_action(SPEEDS)
    assert said["columns"] == {"direction": [0, 2], "neighbors": [2, LAYOUT.size]}
    assert said["commands"] == [[-0.5, 0.0], [0.0, 0.0], [1.0, 0.0]]  # of each choice: forward, to the left
    assert "ways" not in said
    assert (tmp_path / "net.onnx").stat().st_size == told["bytes"]


def test_a_policy_that_chooses_exits_says_what_each_choice_does(tmp_path):
    """Command and way of the choice that the graph takes are those that the policy's own action is decoded as."""
    kind = {"name": "speeds-exits", "speeds": [0.0, 1.0], "routes": 2}
    found = policy(kind, 6)
    runs, told = exported(found, tmp_path)
    seen, said = rows(LAYOUT.size), told["metadata"]
    chosen, acted = runs.run(["action"], {"observation": seen})[0], found.act(seen, LAYOUT, None)
    same = chosen == acted
    commands, ways = make_action(kind).decoded(acted[same])
    assert same.mean() > 0.99 and set(ways.tolist()) == {-1, 0, 1}
    np.testing.assert_array_equal(np.array(said["commands"])[chosen[same]], commands)
    np.testing.assert_array_equal(np.array(said["ways"])[chosen[same]], ways)


@pytest.mark.more
def test_exporting_needs_no_torch(tmp_path):
    pytest.importorskip("onnx", reason="the test writes ONNX files: pip install onnx")
    import subprocess

    random_policy().save(tmp_path / "a.safetensors")
    program = f"""
import sys
for name in ("torch", "stable_baselines3"):
    sys.modules[name] = None
from pathlib import Path
from crowd_env.cli.agents.export import main
main({(tmp_path / "a.safetensors").as_posix()!r}, Path({(tmp_path / "a.onnx").as_posix()!r}))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and (tmp_path / "a.onnx").exists(), done.stderr


@looped(
    ("network", "onnx", "words"),
    [
        ("nobody", "a.onnx", "unknown trained policy 'nobody'; shipped:"),
        ("none.safetensors", "a.onnx", "cannot read the network none.safetensors"),
        ("a.safetensors", "a.pt", "'a.pt' ends in '.pt'; it must end in .onnx"),
        ("a.safetensors", "file/a.onnx", "is not a folder"),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path, monkeypatch, network, onnx, words):
    monkeypatch.chdir(tmp_path)
    random_policy().save("a.safetensors")
    (tmp_path / "file").write_text("")
    told = call(network, "--onnx", onnx)
    assert told.exit_code == 2 and words in told.stderr and len(told.stderr.splitlines()) == 1
    assert not list(tmp_path.glob("*.onnx"))


def test_a_missing_library_says_what_to_install(tmp_path, monkeypatch):
    random_policy().save(tmp_path / "a.safetensors")
    monkeypatch.setitem(sys.modules, "onnx", None)
    told = call(tmp_path / "a.safetensors", "--onnx", tmp_path / "a.onnx")
    assert told.exit_code == 2 and "export to ONNX needs onnx" in told.stderr and "pip install onnx" in told.stderr


def test_a_kind_of_network_without_a_graph_is_refused():
    @dataclass(frozen=True, eq=False)
    class Other(MLP):
        kind = "other"

    found, inner = policy(SPEEDS, 3), loud(LAYOUT.size, 3)
    found.network = Other(inner.weights, inner.biases)
    pytest.importorskip("onnx", reason="the test writes ONNX files: pip install onnx")
    with pytest.raises(ValueError, match="unknown kind of network with an ONNX graph 'other'; known: mlp"):
        to_onnx(found)


def test_the_rule_of_a_task_is_exported_by_the_name_that_tables_give_it(tmp_path):
    for name in ("rule", "shortest"):
        told = call(name, "--transitions", tmp_path / f"{name}.npz", "--task", "room", "--runs", "1")
        assert told.exit_code == 0, told.output
    rule, shortest = (np.load(tmp_path / f"{name}.npz")["0/reward"] for name in ("rule", "shortest"))
    np.testing.assert_array_equal(rule, shortest)


def test_a_dataset_of_minari_is_made_of_runs_and_by_minari(tmp_path, monkeypatch):
    told = call("rule", "--minari", "rule-v0", "--onnx", tmp_path / "a.onnx")
    assert told.exit_code == 2 and "give that too" in told.stderr
    monkeypatch.setitem(sys.modules, "minari", None)
    told = call("rule", "--minari", "rule-v0", "--transitions", tmp_path / "runs.npz")
    assert told.exit_code == 2 and "pip install minari h5py" in told.stderr and not list(tmp_path.iterdir())
