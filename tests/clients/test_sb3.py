"""stable-baselines3: one policy for all slots, and a loss without those who have left."""

import numpy as np
import pytest
from client_examples import client_example
from late import Late, late

from crowd_env import CrowdEnv

DQN = late("stable_baselines3", "DQN")
BaseCallback = late("stable_baselines3.common.callbacks", "BaseCallback")
CrowdVecEnv = late("crowd_env.envs.adapters.sb3", "CrowdVecEnv")
example = Late(lambda: client_example("sb3", "torch", "stable_baselines3"))


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(example.ROOM, "people", 6)
    monkeypatch.setitem(example.ROOM, "time_limit", 6.0)


def make_watch():
    """Return a callback that counts who was inside, and keeps what was said of those whose room has ended."""

    class Watch(BaseCallback):
        def __init__(self):
            super().__init__()
            self.inside, self.told = [], []

        def _on_step(self):
            self.inside.append(int(self.training_env.venv.acted.sum()))
            self.told += [info for info in self.locals["infos"] if "episode" in info]
            return True

    return Watch()


def learned(seed, steps=64 * 2 * 6 * 2):
    model, watch = example.make_model(rooms=2, seed=seed), make_watch()
    return model.learn(steps, callback=watch), watch


def parameters(model):
    return np.concatenate([value.detach().numpy().ravel() for value in model.policy.parameters()])


def test_the_loss_holds_those_inside_and_no_other():
    model, watch = learned(seed=0, steps=1)
    assert len(watch.inside) == 64 and min(watch.inside) < 12 == max(watch.inside)
    assert len(model.rollout_buffer.observations) == sum(watch.inside)
    assert model.rollout_buffer.observations.any(axis=1).all()  # the rows of those who are out are zeros


def test_everyone_has_one_end_of_each_episode():
    _, watch = learned(seed=0)
    ends = len(watch.told)
    assert ends >= 12 and ends % 6 == 0  # a room ends for all of its six people at once
    for info in watch.told:
        assert info["is_success"] != info["TimeLimit.truncated"]
        assert info["steps_inside"] <= info["episode"]["l"] <= 60
    assert len({info["steps_inside"] for info in watch.told[:6]}) > 2  # and yet each got out in a step of its own


@pytest.mark.more
def test_the_same_seed_learns_the_same():
    first = parameters(learned(seed=1)[0])
    np.testing.assert_array_equal(first, parameters(learned(seed=1)[0]))
    assert not np.array_equal(first, parameters(learned(seed=2)[0]))


def test_the_example_runs_and_compares_with_the_rule(capsys):
    model = example.main(steps=1, seed=0)
    text = capsys.readouterr().out
    assert "rule: " in text and "learned: " in text and text.count("of 120 people still inside at the end") == 2
    actions, _ = model.predict(CrowdEnv(**example.ROOM).reset(seed=0)[0], deterministic=True)
    assert (actions == 4).all()  # it starts at the rule: full speed along the way out


def test_replay_buffers_hold_those_who_have_left_too():
    """Off-policy algorithms have no mask: as docs/clients.md says, rows of zeros are among their samples."""
    venv = CrowdVecEnv(CrowdEnv(**example.ROOM, num_envs=2, autoreset=True))
    model = DQN("MlpPolicy", venv, learning_starts=60, train_freq=1, buffer_size=12 * 100, seed=0, device="cpu")
    model.learn(12 * 60)
    rows = model.replay_buffer.observations[:60].reshape(-1, 46)
    nobody = ~rows.any(axis=1)
    assert 0.1 < nobody.mean() < 0.9
