"""The environment runner of RLlib: steps a batch of crowds over arrays, and returns an RLlib episode of each pedestrian.

RLlib's own runner for many agents handles dictionaries, agent by agent, in every decision.  Here a decision of the whole batch
is one call of the environment and one of the network.  Only whole stretches of a pedestrian's steps become objects.
"""

import time
from typing import NamedTuple, cast

import gymnasium
import numpy as np
import torch
from ray.rllib.core.columns import Columns
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from ray.rllib.env.single_agent_episode import SingleAgentEpisode

from crowd_env.core.arrays.state import Bools
from crowd_env.envs.protocol import WalkingBatch

from ...training_config import SEEDS, TrainingConfig, make_env

_APART = 7919  # between the seeds of two runners


class Spaces(gymnasium.vector.VectorEnv):
    """The spaces of a batch, as RLlib requires them."""

    def __init__(self, observation: gymnasium.Space, action: gymnasium.Space) -> None:
        self.num_envs = 1
        self.single_observation_space, self.single_action_space = observation, action
        self.observation_space = gymnasium.vector.utils.batch_space(observation, 1)
        self.action_space = gymnasium.vector.utils.batch_space(action, 1)


class CrowdEnvRunner(SingleAgentEnvRunner):
    """Steps crowds and returns the experience of every pedestrian, from the start or the last call to the exit.

    ``env_config`` holds ``run``, the parameters of a training run, and ``envs``, the number of environments of this runner.
    """

    def make_env(self) -> None:
        """Make the batch of crowds."""
        self._run: TrainingConfig = self.config.env_config["run"]
        self.crowd = cast(WalkingBatch, make_env(self._run, envs=self.config.env_config["envs"]))
        self.env = Spaces(self.crowd.single_observation_space, self.crowd.single_action_space)
        self.num_envs = 1
        self._needs_initial_reset = True
        self._last: np.ndarray = np.empty(0)  # observation (P, D)

    def _sample(self, *, explore: bool, force_reset: bool = False, **_: object) -> list[SingleAgentEpisode]:
        """Return the experience of the next ``n_steps`` decision steps; RLlib's own number does not count."""
        begun, crowd, steps = time.process_time(), self.crowd, self._run.ppo.n_steps
        space, rows = crowd.single_action_space, list[tuple[np.ndarray, ...]]()
        if self._needs_initial_reset or force_reset:
            seed = self._run.seed + _APART * (self.worker_index or 0)
            self._last, _info = crowd.reset(int(seed % SEEDS.high))
            self._needs_initial_reset = False
            self._return = np.zeros(crowd.num_people)
        for t in range(steps):
            observation, inside = self._last.copy(), crowd.active & crowd.learned
            action, log_prob, inputs = (_spread(part, inside) for part in self._act(observation[inside], explore))
            bounded = np.clip(action, space.low, space.high) if isinstance(space, gymnasium.spaces.Box) else action
            step = crowd.step(bounded)
            self._last = step.observation
            after, reward = step.info.get("final_observation", step.observation), step.reward.astype(np.float32)
            ended = step.terminated.copy(), step.truncated.copy()
            rows.append((observation, after.copy(), action, reward, log_prob, inputs, inside, *ended))
            self._count_returns(reward, t, step.info["finished"])
        episodes = _Seen(*(np.stack(column) for column in zip(*rows, strict=True))).episodes()
        self._log_env_steps(metric=self._metrics_num_env_steps_sampled, num_steps=steps * crowd.num_people)
        self.metrics.log_value("slot_steps", steps * crowd.num_people, reduce="sum")
        self.metrics.log_value("cpu_seconds", time.process_time() - begun, reduce="sum")
        self._increase_sampled_metrics(steps * crowd.num_people, sum(one.is_done for one in episodes))
        return episodes

    def _act(self, observation: np.ndarray, explore: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return actions, their log-probabilities and the parameters of their distributions, for observations (K, D)."""
        with torch.no_grad():
            batch = {Columns.OBS: torch.from_numpy(np.ascontiguousarray(observation, dtype=np.float32))}
            inputs = self.module.forward_exploration(batch)[Columns.ACTION_DIST_INPUTS]
            drawn = self.module.get_exploration_action_dist_cls().from_logits(inputs)
            action = drawn.sample() if explore else drawn.to_deterministic().sample()
            return action.numpy(), drawn.logp(action).numpy(), inputs.numpy()

    def _count_returns(self, reward: np.ndarray, t: int, finished: Bools) -> None:
        """Log the mean return of the pedestrians of every finished evacuation."""
        self._return += reward
        for e in np.flatnonzero(finished):
            people = self.crowd.people(int(e))
            self._log_episode_metrics(t + 1, float(self._return[people].mean()), 0.0)
            self._return[people] = 0.0


def _spread(rows: np.ndarray, inside: Bools) -> np.ndarray:
    """Return rows (K, ...) of pedestrians inside as rows of all slots (P, ...), 0 elsewhere."""
    found = np.zeros((len(inside), *rows.shape[1:]), rows.dtype)
    found[inside] = rows
    return found


class _Seen(NamedTuple):
    """Experience of P slots of pedestrians in T decision steps; rows of pedestrians outside have no meaning."""

    observation: np.ndarray  # (T, P, D)
    after: np.ndarray  # (T, P, D)  after the step; at the end of an evacuation its last
    action: np.ndarray  # (T, P, ...)  as drawn
    reward: np.ndarray  # (T, P)
    log_prob: np.ndarray  # (T, P)
    inputs: np.ndarray  # (T, P, K)  parameters of the distributions of the actions
    inside: np.ndarray  # (T, P)  at the beginning of the step
    terminated: np.ndarray  # (T, P)
    truncated: np.ndarray  # (T, P)

    def episodes(self) -> list[SingleAgentEpisode]:
        """Return an RLlib episode of every pedestrian, and a second one where the environment has restarted."""
        found, over = [], self.terminated | self.truncated
        for p in range(self.inside.shape[1]):
            begin = 0
            for end in (*(np.flatnonzero(over[:, p]) + 1), len(over)):
                steps = begin + np.flatnonzero(self.inside[begin:end, p])
                if len(steps):
                    found.append(self._episode(p, int(steps[0]), int(steps[-1]) + 1))
                begin = int(end)
        return found

    def _episode(self, p: int, begin: int, end: int) -> SingleAgentEpisode:
        part = slice(begin, end)
        return SingleAgentEpisode(
            observations=np.concatenate([self.observation[part, p], self.after[end - 1 : end, p]]),
            infos=[{}] * (end - begin + 1),
            actions=self.action[part, p],
            rewards=self.reward[part, p],
            terminated=bool(self.terminated[end - 1, p]),
            truncated=bool(self.truncated[end - 1, p]),
            extra_model_outputs={
                Columns.ACTION_LOGP: self.log_prob[part, p],
                Columns.ACTION_DIST_INPUTS: self.inputs[part, p],
            },
            len_lookback_buffer=0,
        )
