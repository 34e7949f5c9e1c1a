"""MaskablePPO: no choice that is masked, and a loss of those inside."""

import numpy as np
from client_examples import client_example

example = client_example("maskable", "torch", "stable_baselines3", "sb3_contrib")

from stable_baselines3.common.callbacks import BaseCallback  # noqa: E402


class Watch(BaseCallback):
    """Keeps the masks by which people chose, what they chose, and who was inside then."""

    def __init__(self):
        super().__init__()
        self.masks, self.chosen, self.inside = [], [], []

    def _on_step(self):
        self.masks.append(self.locals["action_masks"])
        self.chosen.append(self.locals["actions"].ravel())
        self.inside.append(self.training_env.acted.copy())
        return True


def test_what_is_masked_is_never_chosen_and_the_loss_holds_those_inside():
    model, watch = example.make_model(rooms=2, seed=0), Watch()
    model.learn(1, callback=watch)
    masks, chosen, inside = np.array(watch.masks), np.array(watch.chosen), np.array(watch.inside)
    assert masks.shape == (64, 60, 15) and 0.2 < masks.mean() < 0.9
    assert np.take_along_axis(masks, chosen[..., None], axis=2).all()
    shut = masks[35:, :, 5:10]  # the way to the gate, once it has shut
    assert not shut.any() and masks[:20, :, 5:10].any()
    samples = model.rollout_buffer
    assert len(samples.observations) == len(samples.action_masks) == inside.sum() < inside.size
    (batch,) = samples.get()
    assert batch.action_masks.shape == (inside.sum(), 15)
    assert batch.action_masks.gather(1, batch.actions.long()).all()  # each row beside its own mask


def test_the_example_runs(capsys):
    example.main(steps=1)
    assert capsys.readouterr().out.count("s inside") == 2
