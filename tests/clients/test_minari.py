"""Minari: each pedestrian of each run is an episode, whole and in order."""

import json

import numpy as np
import pytest
from client_examples import client_example
from typer.testing import CliRunner

from crowd_env.agents import make_policy
from crowd_env.agents.tasks import make_task
from crowd_env.agents.transitions import RunArrays, runs_of, write_minari, write_runs

example = client_example("minari", "h5py", "minari")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))


def test_episodes_are_the_runs_pedestrian_by_pedestrian(capsys):
    found = example.main(runs=2, policy="shortest", dataset="crowd_env/room/rule-v0")
    assert found.total_episodes == 40 and "40 episodes" in capsys.readouterr().out
    facts, runs = zip(*runs_of(make_policy("shortest"), make_task("room"), 2), strict=True)
    about = found.storage.get_episode_metadata(range(40))
    for episode, told in zip(found, about, strict=True):
        run, i = int(told["options"]["run"]), int(told["options"]["pedestrian"])
        assert (episode.id, told["seed"]) == (20 * run + i, run)
        arrays = runs[run]
        steps = int(arrays.mask[:, i].sum())
        assert arrays.mask[:steps, i].all() and len(episode.observations) == steps + 1
        kept = (episode.observations[:-1], *(getattr(episode, name) for name in ("actions", "rewards")))
        kept += (episode.terminations, episode.truncations)
        names = [name for name in RunArrays._fields if name != "mask"]
        for values, name in zip(kept, names, strict=True):
            np.testing.assert_array_equal(values, getattr(arrays, name)[:steps, i].astype(values.dtype))
        np.testing.assert_array_equal(episode.observations[-1], arrays.observation[steps, i])
        assert (episode.terminations | episode.truncations).tolist() == [False] * (steps - 1) + [True]
        assert found.action_space.contains(episode.actions[0])
    assert found.total_steps == sum(int(arrays.mask.sum()) for arrays in runs)
    assert json.loads(found.storage.metadata["description"])["columns"] == facts[0]["columns"]


def test_the_command_writes_it_and_refuses_an_id_that_is_taken_before_it_runs(tmp_path):
    from crowd_env.cli.agents.export import app

    arguments = ["rule", "--transitions", str(tmp_path / "runs.npz"), "--task", "room", "--runs", "1", "--json"]
    told = CliRunner().invoke(app, [*arguments, "--minari", "crowd_env/rule-v0"])
    assert told.exit_code == 0 and json.loads(told.stdout)["episodes"] == 20, told.output
    for name, words in (("crowd_env/rule-v0", "already"), ("ru le", "Malformed dataset ID")):
        (tmp_path / "runs.npz").unlink(missing_ok=True)
        told = CliRunner().invoke(app, [*arguments, "--minari", name])
        assert told.exit_code == 2 and words in told.stderr and not (tmp_path / "runs.npz").exists()
    with pytest.raises(ValueError, match="already"):
        write_minari("crowd_env/rule-v0", tmp_path / "runs.npz")


def test_a_dataset_is_whole_or_not_there(tmp_path):
    path, broken = tmp_path / "runs.npz", tmp_path / "broken.npz"
    write_runs(path, make_policy("shortest"), make_task("room"), 2)
    with np.load(path) as file:
        np.savez(broken, **{name: file[name] for name in file if not name.startswith("1/")})
    with pytest.raises(KeyError, match="1/observation"):
        write_minari("crowd_env/rule-v0", broken)
    assert write_minari("crowd_env/rule-v0", path) == 40
