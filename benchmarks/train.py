"""The training loop: stable-baselines3 PPO with the settings of ``train.py`` on `CrowdVecEnv`, 64 rooms, one thread.

Samples are counted as the loss sees them: of people who were inside when they acted.  What stable-baselines3 itself calls
timesteps counts all slots, also those of people who are out.  The learning rate has fallen to nothing by the time of the
measurement, so that no early stop (``target_kl``) shortens an update: every epoch runs.
"""

import time

from benchmarks.measuring import Effort, Row, Stopwatch, significant
from crowd_env import CrowdEnv


def rows(effort: Effort, rooms: int = 64, n_steps: int | None = None) -> list[Row]:
    """Return samples per CPU second, and where the time goes."""
    import torch

    from agents.learned import PPOSettings, make_ppo

    torch.set_num_threads(1)
    settings = PPOSettings() if n_steps is None else PPOSettings(n_steps=n_steps, batch_size=rooms * 20)
    model = make_ppo(CrowdEnv("room-v0", num_envs=rooms, scheme="nsm2", autoreset=True), settings, seed=0)
    venv = model.get_env()
    assert venv is not None
    rollout = settings.n_steps * venv.num_envs
    model.learn(rollout, reset_num_timesteps=False)  # compile, and let the rooms fall out of step
    environment, learning = Stopwatch(venv, "step_wait"), Stopwatch(model, "train")
    best: tuple[float, list[Row]] = (0.0, [])
    for _ in range(effort.blocks):
        environment.restart()
        learning.restart()
        begin, inside, slots = time.process_time(), 0, 0
        while time.process_time() - begin < effort.seconds:
            model.learn(rollout, reset_num_timesteps=False)
            inside += int(model.rollout_buffer.mask.sum())  # type: ignore[attr-defined]
            slots += rollout
        spent = time.process_time() - begin
        shares = environment.seconds / spent, learning.seconds / spent
        if inside / spent > best[0]:
            best = (
                inside / spent,
                [
                    Row("samples that count", significant(inside / spent, 3), "1/CPU s"),
                    Row("slots, as stable-baselines3 counts", significant(slots / spent, 3), "1/CPU s"),
                    Row("slots with someone inside", significant(inside / slots, 2), "1"),
                    Row("CPU time in the environment", significant(shares[0], 2), "1"),
                    Row("CPU time choosing actions and storing them", significant(1.0 - sum(shares), 2), "1"),
                    Row("CPU time learning", significant(shares[1], 2), "1"),
                ],
            )
    return best[1]
