"""The training loop: stable-baselines3 PPO on `competitive-door` with the preset of the task, started as a clone, one thread.

It runs in turn with the same PPO on an empty environment of the same shapes, whose step returns the same arrays over and over:
the ratio says how much of what is possible the environment leaves.  Decisions are counted as the loss sees them: of people who
were inside when they acted.  What stable-baselines3 itself calls timesteps counts all slots, also those of people who are out.
The learning rate has fallen to nothing by the time of the measurement, so that no early stop (``target_kl``) shortens an
update: every epoch runs.
"""

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from benchmarks.measuring import Contender, Effort, Row, Sample, Stopwatch, in_turn, timed, times
from crowd_env.envs.protocol import WalkingBatch

if TYPE_CHECKING:
    from crowd_env.agents.training_config import TrainingConfig

RATE = "decisions of people inside per CPU s"
# Rollouts until as many are inside as later on: at first all rooms are full together.  Who counts in the empty environment is
# taken from then: were it more, learning would be spread over more samples there, and the ratio not that of the environments.
_SETTLE = 4


class Training(Contender):
    """PPO, rollout by rollout; with an environment that does nothing if ``inside`` is given.

    Parameters
    ----------
    config : of the run.
    """

    def __init__(self, name: str, config: "TrainingConfig", inside: np.ndarray | None = None) -> None:
        from crowd_env.agents.learned import make_ppo
        from crowd_env.agents.learned.starts import begin
        from crowd_env.agents.training_config import make_env

        self.name = name
        env = cast(WalkingBatch, make_env(config))
        self.model = make_ppo(env, config.ppo, seed=0)
        self.venv: Any = self.model.get_env()
        self.rollout = config.ppo.n_steps * env.num_people
        if inside is None:
            begin(self.model, config)
        else:
            _empty(self.venv, inside)
        for _ in range(_SETTLE if inside is None else 1):  # compile, and let the rooms fall out of step
            self.model.learn(self.rollout, reset_num_timesteps=False)
        self.environment, self.learning = Stopwatch(self.venv, "step_wait"), Stopwatch(self.model, "train")
        self.acting = Stopwatch(self.model.policy, "forward")
        self.slots = 0

    def once(self) -> Sample:
        """Collect a rollout and learn from it."""
        spent = timed(lambda: self.model.learn(self.rollout, reset_num_timesteps=False))
        self.slots += self.rollout
        inside = int(self.model.rollout_buffer.mask.sum())  # type: ignore[attr-defined]
        return Sample(*spent, 0.1 * self.rollout / self.venv.num_envs, inside)


def _empty(venv: Any, inside: np.ndarray) -> None:
    """Let the steps of a `CrowdVecEnv` do nothing; row by row of ``inside`` (steps, slots) says who counts."""
    from crowd_env.envs.adapters.sb3 import SlotRewards, Slots

    people = venv.num_envs
    observation = (
        np.random.default_rng(0).uniform(-1.0, 1.0, (people, *venv.observation_space.shape)).astype(np.float32)
    )
    nobody = np.zeros(people, dtype=bool)
    rooms = venv.env.env_of_person
    infos: list[dict[str, Any]] = [{} for _ in range(people)]
    calls = 0

    def step_wait() -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        nonlocal calls
        acted = inside[calls % len(inside)]
        calls += 1
        reward = SlotRewards.of(np.zeros(people), Slots(acted, acted, nobody, rooms, 0.0))
        return observation.copy(), reward, nobody.copy(), infos

    venv.step_wait = step_wait


def rows(effort: Effort, envs: int | None = None, people: int | None = None, start: str = "evolution") -> list[Row]:
    """Return decisions per CPU second, where the time goes, and the ratio to the empty environment."""
    import torch

    from crowd_env.agents.training_config import task_config

    torch.set_num_threads(1)
    asked = {"envs": envs, "people": people}
    config = task_config("competitive-door", 0, start=start, **{name: n for name, n in asked.items() if n is not None})
    crowd = f"{config.envs} x {config.people}"
    effort.tell(f"{crowd}: cloning, first rollouts")
    real = Training(f"{crowd}, {config.scheme}", config)
    mask = real.model.rollout_buffer.mask.copy()  # type: ignore[attr-defined]
    nothing = Training(f"{crowd}, empty", config, mask)
    mine, empty = in_turn([real, nothing], effort)
    parts = {"environment": real.environment, "acting": real.acting, "learning": real.learning}
    shares = {name: watch.seconds / real.all.cpu for name, watch in parts.items()}
    shares["storing and the rest"] = 1.0 - sum(shares.values())
    return [
        Row(real.name, RATE, mine.rate),
        Row(real.name, "inside, of slots", real.all.steps / real.slots),
        *(Row(real.name, f"{name}, of CPU time", share) for name, share in shares.items()),
        *times(real.name, mine.rate, {"the same PPO on an empty environment": empty.rate}),
        Row(nothing.name, RATE, empty.rate),
    ]
