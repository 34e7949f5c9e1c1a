"""What drives a rollout beside the rules of the environment: a policy, or a controller that sends people to exits."""

from dataclasses import asdict, dataclass, field, is_dataclass, replace
from typing import NamedTuple

import numpy as np
from typing_extensions import Unpack

from crowd_env import CrowdEnv, Physics, Scenario, Step, Walking
from crowd_env.envs.rollout import Driver, run_episodes
from crowd_env.envs.routing.batch import RoutingBatch, routing_arguments
from crowd_env.envs.settings import EnvArguments, arguments_of

from .controllers import Controller
from .mixed import BatchArguments, MixedEnv
from .plain import Plain
from .policy import Policy
from .rules import ShortestPath
from .sight import Sight
from .walking import RuleAtShare

SAMPLE = 0.1  # s  between two measurements of a crowd
INTERVAL = 2.0  # s  between two decisions of a controller that does not say otherwise

SHARES = tuple(k / 10 for k in range(10, 1, -1))  # of the desired speed
SEARCH_RUNS, SEARCH_SEED = 10, 10_000  # draws of `best_share`, below those that are held out

REST, AT_REST = 1e-4, 3.0  # m/s, s: a crowd in which everyone has been slower for so long is at rest

_NOISE = 8  # beside its seed: what disturbs the senses in a run


class Hindrance(NamedTuple):
    """What disturbs the senses and decisions of a policy; the rule of the environment and a manner are not disturbed."""

    noise: float = (
        0.0  # standard deviation of what is added to every number seen that is not 0; the sum stays in [-1, 1]
    )
    delay: float = 0.0  # s, after which a decision takes effect; until the first does, people follow the rule
    unseen: float = 0.0  # share of the others that a pedestrian does not see, drawn for every decision, see `Sight`


UNHINDERED = Hindrance()


class PolicyDriver(Driver):
    """A batch of evacuations in which a `Policy` moves the pedestrians.

    Parameters
    ----------
    others : moves the others of a mixed crowd.
    hindrance : of the policy; a run's seed alone draws it.
    passes_rest : where people have come to rest for good, pass over the wait until the exits count as blocked.
    """

    def __init__(
        self,
        policy: Policy,
        env: CrowdEnv,
        *,
        others: Policy | None = None,
        hindrance: Hindrance = UNHINDERED,
        passes_rest: bool = False,
    ) -> None:
        super().__init__(env)
        self.policy, self.noise = policy, hindrance.noise
        self._sight = Sight(env, hindrance.unseen) if hindrance.unseen else None
        self._late = round(hindrance.delay / env.decision_dt)  # decisions
        disturbed = bool(hindrance.noise or hindrance.unseen) and not isinstance(policy, ShortestPath)
        self._rests = passes_rest and not disturbed and rests_for_good(env, policy, others)

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
        """Let the policy act on the pedestrians that it moves."""
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


def rests_for_good(env: CrowdEnv, *policies: Policy | None) -> bool:
    """Return whether a crowd at rest stays so: all policies are steady, and no way, door or sign changes."""
    steady = all(getattr(one, "steady", False) for one in policies if one is not None)
    changes = (place.is_dynamic or place.plan.rules or place.plan.events for place in env.route_set)
    return (
        steady and env.simulation.behaviors["manner"] is None and env.action_kind.dwell < AT_REST and not any(changes)
    )


class ControllerDriver(Driver):
    """A batch of evacuations in which a controller of ``crowd_env/routing-v0`` sends pedestrians to exits.

    A step may be shorter than the interval between two decisions, so that crowds are measured in between.

    Parameters
    ----------
    arguments : of `RoutingBatch`; the controller's own override them.
    """

    def __init__(self, controller: Controller, scenario: Scenario, **arguments: Unpack[BatchArguments]) -> None:
        self.controller = controller
        interval, dt = controller.options.get("interval", INTERVAL), Physics.of(arguments["physics"]).dt
        sample_dt = SAMPLE if _divides(SAMPLE, interval) and _divides(dt or SAMPLE, SAMPLE) else interval
        self.batch = RoutingBatch(
            **routing_arguments(scenario, sample_dt=sample_dt, **{**arguments, **controller.options})
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


@dataclass(frozen=True)
class DrivenCrowd:
    """A scenario with what drives its pedestrians, a policy or a controller: makes the batches of a rollout.

    Parameters
    ----------
    policy : that drives.
    scenario : where.
    arguments : of `CrowdEnv`; the policy's own override them.  A controller chooses routes, and decides at its own interval.
    name : what tables call it; by default that of the policy.
    learned_share : of the people whom the policy moves, and the manner of the run is that of the others alone, see `MixedEnv`.
        None: all, and a manner is everyone's.
    others : moves the others; None: the rule does.
    hindrance : see `PolicyDriver`; a controller is not hindered.
    passes_rest : see `PolicyDriver`: the figures are those of the whole wait, but no recorder sees it.
    """

    policy: Policy | Controller
    scenario: Scenario
    arguments: EnvArguments = field(default_factory=EnvArguments)
    name: str = ""
    learned_share: float | None = None
    others: Policy | None = None
    hindrance: Hindrance = UNHINDERED
    passes_rest: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or self.policy.name)

    @property
    def physics(self) -> Physics:
        """What bodies do when they touch."""
        return Physics.of(self.env_arguments.get("physics", "nsm2"))

    @property
    def walking(self) -> Walking:
        """How people walk before they touch."""
        return Walking.of(self.env_arguments.get("walking"))

    @property
    def env_arguments(self) -> Plain:
        """Arguments of `CrowdEnv`, with those that the policy was made for."""
        return {**self.arguments, **(own_arguments(self.policy) if isinstance(self.policy, Policy) else {})}

    @property
    def constants(self) -> dict[str, object]:
        """Constants of a policy that is made of them, ready for JSON."""
        made_of = isinstance(self.policy, Policy) and is_dataclass(self.policy)
        return asdict(self.policy) if made_of else {}  # type: ignore[call-overload]  # an instance, no class

    def settled(self) -> "DrivenCrowd":
        """Return the same crowd; a `RuleAtShare` without a share has the best one here, see `best_share`."""
        if not isinstance(self.policy, RuleAtShare) or self.policy.share is not None:
            return self
        return replace(self, policy=RuleAtShare(best_share(self)))

    def __call__(self, num_envs: int) -> Driver:
        """Return a batch of ``num_envs`` evacuations."""
        if not isinstance(self.policy, Policy):
            routed: BatchArguments = {"physics": "nsm2", **self.arguments, "num_envs": num_envs}
            routed.pop("routing", None)
            routed.pop("decision_dt", None)
            return ControllerDriver(self.policy, self.scenario, **routed)
        arguments = dict(self.env_arguments, num_envs=num_envs)
        if self.learned_share is None:
            env = CrowdEnv(self.scenario, **arguments)
        else:
            if self.others is not None:  # the larger observation holds the smaller one
                layouts = [own_arguments(one).get("observation") for one in (self.policy, self.others)]
                arguments["observation"] = max((one for one in layouts if one is not None), key=lambda one: one.size)
            env = MixedEnv(self.scenario, share=self.learned_share, others=self.others, **arguments)
        return PolicyDriver(
            self.policy, env, others=self.others, hindrance=self.hindrance, passes_rest=self.passes_rest
        )


def own_arguments(policy: Policy) -> Plain:
    """Return the arguments of `CrowdEnv` that a policy was made for; a strategy by its name alone leaves signs off."""
    own = policy.env_options
    return arguments_of({"rules": False, **own} if "strategy" in own else own)


def drive(policy: Policy | Controller, scenario: Scenario, **arguments: Unpack[EnvArguments]) -> DrivenCrowd:
    """Return the `DrivenCrowd` of a policy in a scenario under arguments of `CrowdEnv`, its best share found."""
    return DrivenCrowd(policy, scenario, arguments).settled()


def best_share(crowd: DrivenCrowd) -> float:
    """Return the share of the desired speed at which the rule "walk the shortest path" empties a scenario soonest.

    Every share in `SHARES` is tried, from full speed downwards, on the same `SEARCH_RUNS` draws.  Neither judging nor training
    uses these draws.  The number of pedestrians left inside in all of them counts first, then the mean time of the last one,
    over the runs that cleared: no time limit stands for a time.  The search ends at the first share under which everyone gets
    out, but later than under the best: slower walking takes longer still.
    """
    found, best = 1.0, (np.inf, np.inf)
    for share in SHARES:
        tried = replace(crowd, policy=RuleAtShare(share), hindrance=UNHINDERED, passes_rest=True)
        episodes = run_episodes(crowd.scenario, SEARCH_RUNS, seed=SEARCH_SEED, driver=tried)
        left = sum(episode.metrics.unfinished for episode in episodes)
        cleared = [episode.metrics.evacuation_time for episode in episodes if not episode.metrics.unfinished]
        outcome = left, float(np.mean(cleared)) if cleared else np.inf
        if outcome < best:
            found, best = share, outcome
        elif not left:
            break
    return found
