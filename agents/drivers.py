"""What drives a rollout beside the rules of the environment: a policy, or a controller that sends people to exits."""

from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, cast

import numpy as np

from agents.controllers import Controller
from agents.policy import Policy
from agents.walking import RuleAtShare
from crowd_env import CrowdEnv, Scenario, Step
from crowd_env.envs.rollout import Driver, run_episodes
from crowd_env.envs.routing.batch import RoutingBatch

SAMPLE = 0.1  # s  between two measurements of a crowd

SHARES = tuple(k / 10 for k in range(10, 1, -1))  # of the desired speed
SEARCH_RUNS, SEARCH_SEED = 10, 10_000  # draws of `best_share`, below those that are held out


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


@dataclass(frozen=True)
class PolicyBatches:
    """Makes batches of a scenario under a policy.

    Parameters
    ----------
    options : of `CrowdEnv`; the policy's own override them.
    """

    policy: Policy
    scenario: Scenario
    options: dict[str, Any]

    @property
    def constants(self) -> dict[str, Any]:
        """Return the constants of a policy that is made of them, ready for JSON."""
        return asdict(cast(Any, self.policy)) if is_dataclass(self.policy) else {}

    def __call__(self, num_envs: int) -> Driver:
        """Return a batch of so many evacuations."""
        options = {**self.options, **self.policy.env_options}
        return PolicyDriver(self.policy, CrowdEnv(self.scenario, num_envs=num_envs, **options))


def policy_driver(policy: Policy, scenario: Scenario, **options: Any) -> PolicyBatches:
    """Return a maker of batches of a scenario under a policy, whose own options of `CrowdEnv` override ``options``.

    A `RuleAtShare` without a share gets the best one for this scenario and these options: see `best_share`.
    """
    if isinstance(policy, RuleAtShare) and policy.share is None:
        policy = RuleAtShare(best_share(scenario, **options))
    return PolicyBatches(policy, scenario, options)


def best_share(scenario: Scenario, **options: Any) -> float:
    """Return the share of the desired speed at which the rule "walk the shortest path" empties a scenario soonest.

    Every share in `SHARES` is tried, from full speed downwards, on the same `SEARCH_RUNS` draws, which are neither those that
    policies are judged on nor those of training.  What counts is the mean time of the last person out; a run in which somebody
    is left counts until the time limit.  The search ends at the first share that takes longer than the best although everyone
    gets out: whoever walks slower still takes longer still.
    """
    found, soonest = 1.0, np.inf
    for share in SHARES:
        driver = policy_driver(RuleAtShare(share), scenario, **options)
        episodes = run_episodes(scenario, SEARCH_RUNS, seed=SEARCH_SEED, driver=driver)
        last = np.array([episode.metrics.evacuation_time for episode in episodes])
        limits = np.array([max(episode.end, episode.time_limit) for episode in episodes])
        time = np.where(np.isfinite(last), last, limits).mean()
        if time < soonest:
            found, soonest = share, time
        elif np.isfinite(last).all():
            break
    return found


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
