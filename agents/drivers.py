"""What drives a rollout beside the rules of the environment: a policy, or a controller that sends people to exits."""

from collections.abc import Callable
from typing import Any

import numpy as np

from agents.controllers import Controller
from agents.policy import Policy
from crowd_env import CrowdEnv, Scenario, Step
from crowd_env.envs.rollout import Driver
from crowd_env.envs.routing.batch import RoutingBatch

SAMPLE = 0.1  # s  between two measurements of a crowd


class PolicyDriver(Driver):
    """A batch of evacuations whose people a `Policy` moves."""

    def __init__(self, policy: Policy, env: CrowdEnv) -> None:
        super().__init__(env)
        self.policy = policy

    def reset(self, seeds: list[int]) -> None:
        """Start new evacuations, each from its seed."""
        self._observation, _ = self.env.reset(seeds)
        self.policy.reset(np.ones(len(seeds), dtype=np.bool_))
        self._rng = np.random.default_rng(seeds[0])

    def step(self) -> Step:
        """Let the policy act on everyone."""
        step = self.env.step(self.policy.act(self._observation, self.env.layout, self._rng))
        self._observation = step.observation
        return step


def policy_driver(policy: Policy, scenario: Scenario, **options: Any) -> Callable[[int], Driver]:
    """Return a maker of batches of a scenario under a policy, whose own options of `CrowdEnv` override ``options``."""

    def make(num_envs: int) -> Driver:
        return PolicyDriver(policy, CrowdEnv(scenario, num_envs=num_envs, **{**options, **policy.env_options}))

    return make


class ControllerDriver(Driver):
    """A batch of evacuations whose people a controller of ``crowd_env/Routing-v0`` sends to exits.

    A step may be shorter than the interval between two decisions (`sample_step`), so that crowds are measured in between.

    Parameters
    ----------
    options : of `RoutingBatch`.
    """

    def __init__(self, controller: Controller, scenario: str | Scenario, **options: Any) -> None:
        self.controller = controller
        self.batch = RoutingBatch(scenario, **options)
        super().__init__(self.batch.env)

    def reset(self, seeds: list[int]) -> None:
        """Start new evacuations, each from its seed."""
        self._observation = self.batch.reset(seeds)
        self._rng = np.random.default_rng(seeds[0])
        self._left = np.zeros(self.env.num_people, dtype=np.bool_)
        self._count = 0

    def step(self) -> Step:
        """Tell people where to go if an interval has passed, and let them walk for a sample."""
        if self._count % self.batch.samples == 0:
            self.batch.send(self.controller.act(self._observation, self.batch, self._rng))
            self._left[:] = False
        step = self.env.step(None)
        self._count += 1
        self._left |= step.terminated
        if self._count % self.batch.samples == 0:
            self._observation = self.batch.observe(self.env.active, self._left)
        return step


def sample_step(interval: float, dt: float) -> float:
    """Return the decision step of `ControllerDriver` [s]: `SAMPLE`, or ``interval`` where `SAMPLE` does not fit into it."""
    return SAMPLE if _divides(SAMPLE, interval) and _divides(dt, SAMPLE) else interval


def _divides(part: float, whole: float) -> bool:
    return abs(whole / part - round(whole / part)) < 1e-6 and whole > 0.5 * part
