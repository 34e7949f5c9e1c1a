"""The environment runner of RLlib: a batch of crowds stepped over arrays, and an episode of RLlib for each pedestrian.

RLlib's own runner of many agents goes through dictionaries, agent by agent, for every decision.  Here the whole batch is one
call of the environment and one of the network, and only whole stretches of a pedestrian's steps become objects.
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
    """The spaces of a batch of which RLlib sees nothing else."""

    def __init__(self, observation: gymnasium.Space, action: gymnasium.Space) -> None:
        self.num_envs = 1
        self.single_observation_space, self.single_action_space = observation, action
        self.observation_space = gymnasium.vector.utils.batch_space(observation, 1)
        self.action_space = gymnasium.vector.utils.batch_space(action, 1)


class CrowdEnvRunner(SingleAgentEnvRunner):
    """Steps crowds and returns the experience of every pedestrian: from the start, or the last call, to the exit.

    ``env_config`` holds ``run``, the parameters of a training run, and ``envs``, how many environments this runner has.
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
        """Return the experience of the next decision steps, however many RLlib asks for."""
        begun = time.process_time()
        crowd, steps = self.crowd, self._run.ppo.n_steps
        if self._needs_initial_reset or force_reset:
            seed = self._run.seed + _APART * (self.worker_index or 0)
            self._last, _info = crowd.reset(int(seed % SEEDS.high))
            self._needs_initial_reset = False
            self._return = np.zeros(crowd.num_people)
        seen = _Seen.of(steps, self._last, crowd)
        for t in range(steps):
            seen.inside[t] = crowd.active & crowd.learned
            acted = np.flatnonzero(seen.inside[t])
            seen.observation[t] = self._last
            action, seen.log_prob[t, acted], inputs = self._act(self._last[acted], explore)
            if seen.inputs is None:
                seen = seen._replace(inputs=np.zeros((steps, crowd.num_people, inputs.shape[1]), dtype=np.float32))
            assert seen.inputs is not None
            seen.action[t, acted], seen.inputs[t, acted] = action, inputs
            step = crowd.step(seen.clipped(t, crowd.single_action_space))
            seen.after[t] = step.info.get("final_observation", step.observation)
            seen.reward[t], seen.terminated[t], seen.truncated[t] = step.reward, step.terminated, step.truncated
            self._last = step.observation
            self._count_returns(seen, t, step.info["finished"])
        episodes = seen.episodes()
        self._log_env_steps(metric=self._metrics_num_env_steps_sampled, num_steps=steps * crowd.num_people)
        self.metrics.log_value("slot_steps", steps * crowd.num_people, reduce="sum")
        self.metrics.log_value("cpu_seconds", time.process_time() - begun, reduce="sum")
        self._increase_sampled_metrics(steps * crowd.num_people, sum(one.is_done for one in episodes))
        return episodes

    def _act(self, observation: np.ndarray, explore: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return actions, their log-probabilities and the parameters of their distribution, a row each."""
        with torch.no_grad():
            batch = {Columns.OBS: torch.from_numpy(np.ascontiguousarray(observation, dtype=np.float32))}
            inputs = self.module.forward_exploration(batch)[Columns.ACTION_DIST_INPUTS]
            drawn = self.module.get_exploration_action_dist_cls().from_logits(inputs)
            action = drawn.sample() if explore else drawn.to_deterministic().sample()
            return action.numpy(), drawn.logp(action).numpy(), inputs.numpy()

    def _count_returns(self, seen: "_Seen", t: int, finished: Bools) -> None:
        """Tell RLlib the mean return of the people of every evacuation that has ended."""
        self._return += seen.reward[t]
        for e in np.flatnonzero(finished):
            people = self.crowd.people(int(e))
            self._log_episode_metrics(t + 1, float(self._return[people].mean()), 0.0)
            self._return[people] = 0.0


class _Seen(NamedTuple):
    """Experience of P slots of pedestrians in T decision steps; rows of those that are out mean nothing."""

    observation: np.ndarray  # (T, P, D)
    after: np.ndarray  # (T, P, D)  after the step; at the end of an evacuation its last
    action: np.ndarray  # (T, P, ...)  as it was drawn
    reward: np.ndarray  # (T, P)
    log_prob: np.ndarray  # (T, P)
    inside: np.ndarray  # (T, P)  when the step began
    terminated: np.ndarray  # (T, P)
    truncated: np.ndarray  # (T, P)
    inputs: np.ndarray | None = None  # (T, P, K)  parameters of the distributions that actions were drawn from

    @classmethod
    def of(cls, steps: int, observation: np.ndarray, crowd: WalkingBatch) -> "_Seen":
        """Return space for so many steps."""
        rows, space = (steps, len(observation)), crowd.single_action_space
        flags = [np.zeros(rows, dtype=np.bool_) for _ in range(3)]
        numbers = [np.zeros(rows, dtype=np.float32) for _ in range(2)]
        views = [np.zeros((*rows, observation.shape[1]), dtype=np.float32) for _ in range(2)]
        action = np.zeros((*rows, *(space.shape or ())), dtype=space.dtype)
        return cls(views[0], views[1], action, numbers[0], numbers[1], flags[0], flags[1], flags[2])

    def clipped(self, t: int, space: gymnasium.Space) -> np.ndarray:
        """Return the actions of a step as the environment takes them."""
        if isinstance(space, gymnasium.spaces.Box):
            return np.clip(self.action[t], space.low, space.high)
        return self.action[t]

    def episodes(self) -> list[SingleAgentEpisode]:
        """Return an episode of RLlib for every pedestrian, and a second one where the environment has restarted."""
        assert self.inputs is not None
        found = []
        over = self.terminated | self.truncated
        for p in range(self.inside.shape[1]):
            begin = 0
            for end in (*(np.flatnonzero(over[:, p]) + 1), len(over)):
                steps = begin + np.flatnonzero(self.inside[begin:end, p])
                if len(steps):
                    found.append(self._episode(p, int(steps[0]), int(steps[-1]) + 1))
                begin = int(end)
        return found

    def _episode(self, p: int, begin: int, end: int) -> SingleAgentEpisode:
        assert self.inputs is not None
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
