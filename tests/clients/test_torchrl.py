"""TorchRL: a group of fixed size whose mask says who is still inside."""

import numpy as np
import pytest
from client_examples import client_example

example = client_example("torchrl", "torch", "torchrl")

import torch  # noqa: E402
from torchrl.envs.libs.pettingzoo import PettingZooWrapper  # noqa: E402
from torchrl.envs.utils import check_env_specs  # noqa: E402

from crowd_env import parallel_env  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore:PettingZoo in TorchRL is tested using version")
GROUP = example.GROUP


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(example.ROOM, "people", 6)
    monkeypatch.setitem(example.ROOM, "time_limit", 12.0)


def walked(seed=0, **options):
    """Return a whole episode of people who take any choice, and its environment."""
    env = parallel_env(**example.ROOM)
    room = PettingZooWrapper(env, **{"use_mask": True, "done_on_any": False, **options})
    room.set_seed(seed)
    torch.manual_seed(seed)
    return env, room.rollout(120)


def test_the_specs_are_kept():
    check_env_specs(example.make_room())


def test_each_leaves_once_and_the_others_go_on():
    env, episode = walked()
    inside = episode[GROUP, "mask"]
    alive = inside.sum(dim=1)
    assert alive[0] == 6 and alive[-1] < 3 and (alive.diff() <= 0).all()
    assert len(episode) > 30 and episode["next", "done"].sum() == 1 == episode["next", "done"][-1]
    ended = episode["next", GROUP, "done"].squeeze(-1) & inside
    assert (ended.sum(dim=0) == 1).all()
    out = episode["next", GROUP, "terminated"].squeeze(-1) & inside
    assert example.got_out(episode) == int(out.sum()) == 6 - env.env.metrics(0).unfinished > 3
    assert not episode["next", GROUP, "reward"].squeeze(-1)[~inside].any()


def test_actions_of_those_who_are_out_do_nothing():
    """The wrapper sends some for the whole group; a run with those of people inside alone is the same."""
    _, episode = walked()
    env = parallel_env(**example.ROOM)
    env.reset(seed=0)  # what `set_seed` does
    env.reset()
    for step in episode:
        actions = dict(zip(env.possible_agents, step[GROUP, "action"].tolist(), strict=True))
        observations, rewards, *_ = env.step({agent: actions[agent] for agent in env.agents})
        for agent, observation in observations.items():
            slot = int(agent.split("_")[1])
            np.testing.assert_array_equal(step["next", GROUP, "observation"][slot], observation)
            assert step["next", GROUP, "reward"][slot].item() == pytest.approx(rewards[agent])
    assert not env.agents


def test_without_the_flags_it_ends_with_the_first_exit():
    _, episode = walked(done_on_any=None)
    assert example.got_out(episode) == 1 and (episode[GROUP, "mask"].sum(dim=1) == 6).all()
    with pytest.raises(ValueError, match="use_mask=True"):
        walked(use_mask=False)


def test_samples_are_of_those_inside():
    _, episode = walked()
    samples = example.samples_of(episode)
    assert len(samples) == episode[GROUP, "mask"].sum() < 6 * len(episode)
    assert samples[GROUP, "observation"].any(dim=1).all()


def test_the_same_seed_learns_the_same(capsys):
    def parameters(seed):
        return torch.cat([value.detach().ravel() for value in example.main(steps=200, seed=seed).parameters()])

    first = parameters(1)
    assert first.isfinite().all() and torch.equal(first, parameters(1))
    assert not torch.equal(first, parameters(2))
    assert capsys.readouterr().out.count("people got out in 10 s") == 6


def test_a_task_is_trained_on_and_judged(capsys):
    example.main(steps=100, task="room", runs=2)
    assert "torchrl-ppo: left inside in" in capsys.readouterr().out


def test_masked_actions_are_never_drawn():
    env = parallel_env("two-exit-hall-v0", people=6, action="speeds-exits", time_limit=8.0, physics="dem")
    room = PettingZooWrapper(env, use_mask=True, done_on_any=False)
    torch.manual_seed(0)
    episode = room.rollout(80)
    mask, action = episode[GROUP, "action_mask"], episode[GROUP, "action"]
    assert mask.shape == (*action.shape, 15) and not mask.all()
    assert mask.gather(-1, action[..., None]).all()
    check_env_specs(room)


def test_a_group_is_a_cohort():
    env = parallel_env("counter-flow-v0", people=6, action="speeds", time_limit=5.0, physics="dem")
    room = PettingZooWrapper(env, group_map=env.cohorts, use_mask=True, done_on_any=False)
    check_env_specs(room)
    episode = room.rollout(20)
    assert [episode[name, "observation"].shape[1] for name in ("eastwards", "westwards")] == [3, 3]
