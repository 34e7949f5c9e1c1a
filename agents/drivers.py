"""What drives a rollout beside the rules of the environment: a policy, or a controller that sends people to exits."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, is_dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np

from crowd_env import CrowdEnv, ObservationLayout, Scenario, Step
from crowd_env.envs.rollout import Driver, run_episodes
from crowd_env.envs.routing.batch import RoutingBatch, routing_arguments
from crowd_env.envs.settings import arguments_of

from .controllers import Controller
from .mixed import MixedEnv
from .policy import Policy
from .rules import ShortestPath, StandStill, StrategyPolicy
from .sight import Sight
from .trained import LearnedPolicy
from .walking import DensityCap, Evolved, Follow, RuleAtShare, Zipper

SAMPLE = 0.1  # s  between two measurements of a crowd
INTERVAL = 2.0  # s  between two decisions of a controller that does not say otherwise

SHARES = tuple(k / 10 for k in range(10, 1, -1))  # of the desired speed
SEARCH_RUNS, SEARCH_SEED = 10, 10_000  # draws of `best_share`, below those that are held out

REST, AT_REST = 1e-4, 3.0  # m/s, s: a crowd of which nobody has been faster for so long is at rest
# What these ask for follows from what is seen alone: who has come to rest is asked for the same, again and again.
_STEADY = (ShortestPath, StrategyPolicy, StandStill, RuleAtShare, DensityCap, Follow, Zipper, Evolved, LearnedPolicy)

_NOISE = 8  # beside its seed: what disturbs the senses in a run


class PolicyDriver(Driver):
    """A batch of evacuations whose people a `Policy` moves.

    Parameters
    ----------
    passes_rest : where people have come to rest for good, pass over the wait until the exits count as blocked.
    noise : standard deviation of what is added to every number that the policy sees and that is not 0, which stays within
        [-1, 1]; a run's seed alone draws it.
    delay : s, after which a decision takes effect; until the first does, people follow the rule of the environment.  That rule
        itself, and what a manner makes of a policy's wish, is neither disturbed nor late.
    unseen : share of the others whom a person does not see, others in every decision, see `crowd_env.agents.sight.Sight`.
    """

    def __init__(
        self,
        policy: Policy,
        env: CrowdEnv,
        passes_rest: bool = False,
        noise: float = 0.0,
        delay: float = 0.0,
        unseen: float = 0.0,
    ) -> None:
        super().__init__(env)
        self.policy, self.noise = policy, noise
        self._sight = Sight(env, unseen) if unseen else None
        self._late = round(delay / env.decision_dt)  # decisions
        self._rests = passes_rest and rests_for_good(policy, env)
        self._rests &= not (noise or unseen) or isinstance(policy, ShortestPath)

    def reset(self, seeds: list[int]) -> None:
        """Start new evacuations, each from its seed."""
        self._observation, _ = self.env.reset(seeds)
        self.policy.reset(np.ones(len(seeds), dtype=np.bool_))
        self._rng = np.random.default_rng(seeds[0])
        if self._sight is not None:
            self._sight.reset(seeds)
        self._noises = [np.random.default_rng((seed, _NOISE)) for seed in seeds]
        self._decided: list[np.ndarray | None] = [None] * self._late  # what is yet to take effect
        self._moved = np.zeros(len(seeds))  # s  when someone was last faster than `REST`

    def step(self) -> Step:
        """Let the policy act on those whom it moves."""
        self._decided.append(self.policy.act(self._seen(), self.env.layout, self._rng))
        step = self.env.step(self._decided.pop(0))
        self._observation = step.observation
        if self._rests:
            self._pass_rest()
        return step

    def _seen(self) -> np.ndarray:
        """Return the observation that the policy is given."""
        observation = self._observation if self._sight is None else self._sight.observe()
        if not self.noise:
            return observation
        start, width = self.env.env_start, observation.shape[1]
        drawn = [
            rng.standard_normal((n, width), np.float32)
            for rng, n in zip(self._noises, np.diff(start).tolist(), strict=True)
        ]
        seen = observation + np.float32(self.noise) * np.concatenate(drawn)
        return np.where(observation != 0.0, np.clip(seen, -1.0, 1.0), 0.0)

    def _pass_rest(self) -> None:
        """Let the wait be over where people are at rest for good, and have all begun to walk."""
        env, state, response = self.env, self.env.simulation.state, self.env.simulation.bodies.response_time
        moves = (np.hypot(*state.velocity.T) > REST) | (response > state.time[env.env_of_person])
        moved = np.logical_or.reduceat(env.active & moves, env.env_start[:-1])
        self._moved = np.where(moved, state.time, self._moved)
        for e in np.flatnonzero(~env.finished & (state.time > self._moved + AT_REST)):
            env.pass_rest(int(e))


def rests_for_good(policy: Policy, env: CrowdEnv) -> bool:
    """Return whether a crowd at rest stays so: nobody loses patience, and no way, door or sign changes."""
    for one in (policy, getattr(env, "others", None) or policy):
        if type(one) not in _STEADY or (isinstance(one, LearnedPolicy) and one.draws):
            return False
    changes = (place.is_dynamic or place.plan.rules or place.plan.events for place in env.route_set)
    return env.simulation.behaviors["manner"] is None and env.action_kind.dwell < AT_REST and not any(changes)


@dataclass(frozen=True)
class PolicyBatches:
    """Makes batches of a scenario under a policy.

    Parameters
    ----------
    options : of `CrowdEnv`; the policy's own override them.
    learned_share : of the people whom the policy moves, and the manner of the run is that of the others alone, see `MixedEnv`.
        None: all, and a manner is everyone's.
    others : moves the others; None: the rule does.
    passes_rest : see `PolicyDriver`: the figures are those of the whole wait, but nobody can look on.
    noise, delay, unseen : see `PolicyDriver`.
    """

    policy: Policy
    scenario: Scenario
    options: dict[str, Any]
    learned_share: float | None = None
    others: Policy | None = None
    passes_rest: bool = False
    noise: float = 0.0
    delay: float = 0.0
    unseen: float = 0.0

    @property
    def constants(self) -> dict[str, Any]:
        """Return the constants of a policy that is made of them, ready for JSON."""
        return asdict(cast(Any, self.policy)) if is_dataclass(self.policy) else {}

    def __call__(self, num_envs: int) -> Driver:
        """Return a batch of so many evacuations."""
        options = {**self.options, **self.policy.env_options}
        if self.learned_share is None:
            env = CrowdEnv(self.scenario, num_envs=num_envs, **arguments_of(options))
        else:
            if self.others is not None:  # who observes less finds it among what the other observes
                both = (one.env_options for one in (self.policy, self.others))
                options["observation"] = max((one["observation"] for one in both if "observation" in one), key=_size)
            mixed: dict[str, Any] = {"share": self.learned_share, "others": self.others, "num_envs": num_envs}
            env = MixedEnv(self.scenario, **mixed, **arguments_of(options))
        return PolicyDriver(self.policy, env, self.passes_rest, self.noise, self.delay, self.unseen)


def _size(layout: ObservationLayout) -> int:
    return layout.size


def policy_driver(
    policy: Policy,
    scenario: Scenario,
    *,
    learned_share: float | None = None,
    noise: float = 0.0,
    delay: float = 0.0,
    unseen: float = 0.0,
    **options: Any,
) -> PolicyBatches:
    """Return a maker of batches of a scenario under a policy, whose own options of `CrowdEnv` override ``options``.

    A `RuleAtShare` without a share gets the best one for this scenario and these options: see `best_share`.
    """
    if isinstance(policy, RuleAtShare) and policy.share is None:
        policy = RuleAtShare(best_share(scenario, learned_share=learned_share, **options))
    return PolicyBatches(policy, scenario, options, learned_share, noise=noise, delay=delay, unseen=unseen)


def best_share(scenario: Scenario, **options: Any) -> float:
    """Return the share of the desired speed at which the rule "walk the shortest path" empties a scenario soonest.

    Every share in `SHARES` is tried, from full speed downwards, on the same `SEARCH_RUNS` draws, which are neither those that
    policies are judged on nor those of training.  What counts is how many people are left inside in all of them, and only then
    the mean time of the last person, over the runs that cleared: no time limit stands for a time.  The search ends at the
    first share under which everyone gets out, but later than under the best: whoever walks slower still takes longer still.
    """
    found, best = 1.0, (np.inf, np.inf)
    for share in SHARES:
        driver = replace(policy_driver(RuleAtShare(share), scenario, **options), passes_rest=True)
        episodes = run_episodes(scenario, SEARCH_RUNS, seed=SEARCH_SEED, driver=driver)
        left = sum(episode.metrics.unfinished for episode in episodes)
        cleared = [episode.metrics.evacuation_time for episode in episodes if not episode.metrics.unfinished]
        outcome = left, float(np.mean(cleared)) if cleared else np.inf
        if outcome < best:
            found, best = share, outcome
        elif not left:
            break
    return found


class ControllerDriver(Driver):
    """A batch of evacuations whose people a controller of ``crowd_env/routing-v0`` sends to exits.

    A step may be shorter than the interval between two decisions, so that crowds are measured in between.

    Parameters
    ----------
    options : of `RoutingBatch`; the controller's own override them.
    """

    def __init__(self, controller: Controller, scenario: Scenario, **options: Any) -> None:
        self.controller = controller
        interval = controller.options.get("interval", INTERVAL)
        sample_dt = SAMPLE if _divides(SAMPLE, interval) and _divides(options.get("dt") or SAMPLE, SAMPLE) else interval
        self.batch = RoutingBatch(
            **routing_arguments(scenario, sample_dt=sample_dt, **{**options, **controller.options})
        )
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


def _divides(part: float, whole: float) -> bool:
    return abs(whole / part - round(whole / part)) < 1e-6 and whole > 0.5 * part


def _controlled(who: Controller, scenario: Scenario, options: dict[str, Any], num_envs: int) -> Driver:
    return ControllerDriver(who, scenario, num_envs=num_envs, **options)


def driver_of(
    who: Policy | Controller, scenario: Scenario, *, learned_share: float | None = None, **options: Any
) -> Callable[[int], Driver]:
    """Return a maker of batches of a scenario under a policy (`policy_driver`) or a controller.

    Parameters
    ----------
    options : of `CrowdEnv`; a controller chooses routes, and decides at its own interval.
    """
    if not isinstance(who, Policy):
        not_own = ("strategy", "decision_dt", "rules", "noise", "delay", "unseen")
        own = {name: value for name, value in options.items() if name not in not_own}
        return partial(_controlled, who, scenario, own)
    return policy_driver(who, scenario, learned_share=learned_share, **options)
