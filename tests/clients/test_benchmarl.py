"""BenchMARL: MAPPO on a task of people who leave one by one, with the state of the whole crowd for its critic."""

from itertools import pairwise

import pytest
from client_examples import client_example

example = client_example("benchmarl", "torch", "torchrl", "benchmarl")

import torch  # noqa: E402
from benchmarl.experiment import Callback  # noqa: E402

from crowd_env import parallel_env  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore:PettingZoo in TorchRL is tested")
GROUP = example.GROUP


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(example.ROOM, "people", 4)
    monkeypatch.setitem(example.ROOM, "time_limit", 15.0)


class Watch(Callback):
    """Keeps the rollouts."""

    def __init__(self):
        super().__init__()
        self.rollouts = []

    def on_batch_collected(self, batch):
        self.rollouts.append(batch.clone())


def learned(seed, folder, iterations=1):
    experiment, watch = example.make_experiment(iterations, seed, folder), Watch()
    experiment.callbacks.append(watch)
    experiment.run()
    weights = [value.detach().ravel() for value in experiment.policy.parameters()]
    return torch.cat(weights), watch.rollouts, experiment


def test_each_leaves_once_and_the_others_go_on(tmp_path):
    weights, rollouts, _ = learned(0, tmp_path, iterations=2)
    assert weights.isfinite().all() and len(rollouts) == 2
    rollout = torch.cat([part.reshape(-1) for part in rollouts])  # an episode goes on in the next one
    assert len(rollout) == 400
    inside, over = rollout[GROUP, "mask"], rollout["next", "done"].squeeze(-1)
    alive = inside.sum(dim=1)
    ends = [-1, *over.nonzero().squeeze(-1).tolist()]
    assert len(ends) > 2 and alive.min() == 1
    ended = rollout["next", GROUP, "done"].squeeze(-1) & inside
    for begin, end in pairwise(ends):
        episode = slice(begin + 1, end + 1)
        assert alive[begin + 1] == 4 and (alive[episode].diff() <= 0).all()
        assert (ended[episode].sum(dim=0) == 1).all()
    assert not rollout["next", GROUP, "reward"].squeeze(-1)[~inside].any()


def test_the_critic_sees_the_whole_crowd(tmp_path):
    _, (rollout,), _ = learned(0, tmp_path)
    layout = parallel_env(**example.ROOM).state_layout
    state = rollout["state"].reshape(200, -1)
    assert state.shape == (200, layout.size)
    masks = rollout[GROUP, "mask"].reshape(200, 4).numpy()
    for row, mask in zip(state.numpy()[::7], masks[::7], strict=True):
        assert (layout.split(row).people[:, layout["inside"]].ravel() == mask).all()


def test_the_same_seed_learns_the_same(tmp_path):
    first, same, other = (learned(seed, tmp_path / str(k))[0] for k, seed in enumerate((1, 1, 2)))
    assert torch.equal(first, same) and not torch.equal(first, other)


def test_the_example_runs(tmp_path):
    experiment = example.main(iterations=1, seed=0, folder=tmp_path / "new")
    assert experiment.total_frames == 200 and experiment.n_iters_performed == 1


def test_a_task_is_trained_on_and_judged(tmp_path, capsys):
    example.main(iterations=1, seed=0, folder=tmp_path, task="room", runs=2)
    assert "benchmarl-mappo: left inside in" in capsys.readouterr().out


def test_the_policy_of_a_task_takes_any_number_of_people(tmp_path):
    experiment = example.make_experiment(1, 0, tmp_path)
    policy = example.outside(experiment, "room")
    width = parallel_env(**example.ROOM).observation_space("pedestrian_0").shape[0]
    seen = torch.rand(11, width).numpy()
    chosen = policy.choose(seen)
    assert chosen.shape == (11,) and (chosen[:4] == policy.choose(seen[:4])).all()
