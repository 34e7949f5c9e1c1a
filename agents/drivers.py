"""Drivers of rollouts: a policy that moves pedestrians, or a controller that sends them to exits."""

from dataclasses import asdict, dataclass, field, is_dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Unpack

from crowd_env import CrowdEnv, ObservationLayout, Physics, Scenario, Step, Walking
from crowd_env.core.checks import NOT_NEGATIVE, Range, number, refuse
from crowd_env.envs.observation.observer import Observer
from crowd_env.envs.rollout import Driver, run_episodes
from crowd_env.envs.routing.batch import RoutingBatch, routing_arguments
from crowd_env.envs.settings import EnvArguments, arguments_of

from .controllers import Controller
from .mixed import BatchArguments, MixedEnv
from .plain import Plain
from .policy import Policy
from .rules import ShortestPath
from .walking import RuleAtShare

SAMPLE = 0.1  # s  between two measurements of a crowd
INTERVAL = 2.0  # s  between two decisions of a controller, by default

SHARES = tuple(k / 10 for k in range(10, 1, -1))  # of the desired speed
SEARCH_RUNS, SEARCH_SEED = 10, 10_000  # draws of `best_share`, below the held-out ones

REST, AT_REST = 1e-4, 3.0  # m/s, s: a crowd is at rest if all pedestrians have been slower for this time

_NOISE, _HIDDEN = 8, 9  # second words of a run's seed, for the noise and for hidden pedestrians


class Hindrance(NamedTuple):
    """Disturbances of the observations and decisions of a policy; they do not affect the environment's rule or a manner."""

    noise: float = 0.0  # standard deviation of noise on every observed number but 0; the sum stays in [-1, 1]
    delay: float = 0.0  # s, until a decision takes effect; before the first one pedestrians follow the rule
    unseen: float = 0.0  # share of the others that a pedestrian does not see, drawn in every decision, see `Sight`


UNHINDERED = Hindrance()


class Sight:
    """The observations of pedestrians if each misses a share of the others.

    In every decision the pedestrians of an environment form n random cohorts.  A cohort does not see the next one.  So each
    pedestrian misses each other one with a probability of 1 / n.  This holds for all terms about others: density, nearest
    neighbors, pedestrians ahead, queues.  Contacts, walls and ways remain known.

    Parameters
    ----------
    env : of the pedestrians that observe.
    share : of the others that a pedestrian does not see, 1 / n.

    Raises
    ------
    ValueError
        If the share is not 1 / n of a whole n from 2 on.
    """

    def __init__(self, env: CrowdEnv, share: float) -> None:
        self.cohorts = round(1.0 / share) if 0.0 < share <= 0.5 else 0
        if self.cohorts < 2 or abs(self.cohorts * share - 1.0) > 1e-9:
            raise ValueError(f"unseen is {share:g}; it must be 1 / n of a whole n from 2 on, such as 0.5 or 0.2")
        self.env = env
        ways, in_world = env.observer.view.fields.ways, env.action_kind.frame == "world"
        # All pairs: the cells of the physics would show all pedestrians inside.
        self._observer = Observer(env.simulation, env.layout, ways, in_world=in_world, all_pairs=env.num_people)

    def reset(self, seeds: list[int]) -> None:
        """Start again; the seed of an environment alone determines the cohorts there."""
        self._rngs = [np.random.default_rng((seed, _HIDDEN)) for seed in seeds]

    def observe(self) -> NDArray[np.float32]:
        """Return the observation (P, D) of a decision; zero for pedestrians outside."""
        people, active = np.diff(self.env.env_start).tolist(), self.env.active
        cohort = np.concatenate([rng.integers(self.cohorts, size=n) for rng, n in zip(self._rngs, people, strict=True)])
        found = np.zeros((self.env.num_people, self.env.layout.size), dtype=np.float32)
        for k in range(self.cohorts):
            mine = active & (cohort == k)
            found[mine] = self._observer.observe(active & (cohort != (k + 1) % self.cohorts))[mine]
        return found


class PolicyDriver(Driver):
    """A batch of evacuations in which a `Policy` moves the pedestrians.

    Parameters
    ----------
    others : policy of the other pedestrians in a mixed crowd.
    hindrance : of the policy; the seed of a run alone draws it.
    passes_rest : skip the wait for blocked exits where a crowd is at rest for good.
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
        """Start new evacuations, one for each seed."""
        self._observation, _ = self.env.reset(seeds)
        self.policy.reset(np.ones(len(seeds), dtype=bool))
        self._rng = np.random.default_rng(seeds[0])
        if self._sight is not None:
            self._sight.reset(seeds)
        self._noises = [np.random.default_rng((seed, _NOISE)) for seed in seeds]
        self._decided: list[np.ndarray | None] = [None] * self._late  # decisions before their effect
        self._moved = np.zeros(len(seeds))  # s  last time of a pedestrian faster than `REST`

    def step(self) -> Step:
        """Let the policy decide, and advance by one decision step."""
        self._decided.append(self.policy.act(self._seen(), self.env.layout, self._rng))
        step = self.env.step(self._decided.pop(0))
        self._observation = step.observation
        if self._rests:
            self._pass_rest()
        return step

    def _seen(self) -> np.ndarray:
        """Return the observation of the policy."""
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
        """Skip the wait where all pedestrians have begun to walk and the crowd is at rest for good."""
        env, state, response = self.env, self.env.simulation.state, self.env.simulation.bodies.response_time
        moves = (np.hypot(*state.velocity.T) > REST) | (response > state.time[env.env_of_person])
        moved = np.logical_or.reduceat(env.active & moves, env.env_start[:-1])
        self._moved = np.where(moved, state.time, self._moved)
        for e in np.flatnonzero(~env.finished & (state.time > self._moved + AT_REST)):
            env.pass_rest(int(e))


def rests_for_good(env: CrowdEnv, *policies: Policy | None) -> bool:
    """Return whether a crowd at rest stays at rest: all policies are steady, and no way, door or sign changes."""
    steady = all(getattr(one, "steady", False) for one in policies if one is not None)
    changes = [bool(place.is_dynamic or place.plan.rules or place.plan.events) for place in env.route_set]
    changes += [place.goes_on for place in env.scenarios]
    return (
        steady and env.simulation.behaviors["manner"] is None and env.action_kind.dwell < AT_REST and not any(changes)
    )


class ControllerDriver(Driver):
    """A batch of evacuations in which a controller of ``crowd_env/routing-v0`` sends pedestrians to exits.

    A step may be shorter than the interval between two decisions, for measurements in between.

    Parameters
    ----------
    arguments : of `RoutingBatch`; those of the controller override them.
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
        """Start new evacuations, one for each seed."""
        self._observation = self.batch.reset(seeds)
        self._rng = np.random.default_rng(seeds[0])
        self._left = np.zeros(self.env.num_people, dtype=bool)
        self._count = 0

    def step(self) -> Step:
        """Send pedestrians if an interval has passed, and advance by one sample."""
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
    """A scenario with the policy or controller of its pedestrians; makes the batches of a rollout.

    Parameters
    ----------
    policy : the policy or controller.
    scenario : the place.
    arguments : of `CrowdEnv`; those of the policy override them.  A controller has routes and an interval of its own.
    name : name in tables; by default that of the policy.
    learned_share : share of the pedestrians that the policy moves; the manner of the run is that of the others alone, see
        `MixedEnv`.  None: it moves all, and a manner is that of all.
    others : policy of the others; None: the rule.
    hindrance : see `PolicyDriver`; a controller is not hindered.
    passes_rest : see `PolicyDriver`.  The figures include the wait, but no recorder sees it.
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
        if self.learned_share is not None:
            number("learned_share", self.learned_share, Range(0.0, 1.0, above=True))
        if not isinstance(self.hindrance, Hindrance):
            refuse("hindrance", self.hindrance, "a Hindrance, such as Hindrance(noise=0.1)")
        for name in ("noise", "delay"):
            number(f"hindrance: {name}", getattr(self.hindrance, name), NOT_NEGATIVE)

    @property
    def physics(self) -> Physics:
        """The physics of the contacts."""
        return Physics.of(self.env_arguments.get("physics", "nsm2"))

    @property
    def walking(self) -> Walking:
        """The walking behavior before contacts."""
        return Walking.of(self.env_arguments.get("walking"))

    @property
    def env_arguments(self) -> Plain:
        """Arguments of `CrowdEnv`, including those of the policy."""
        return {**self.arguments, **own_arguments(self.policy)}

    @property
    def constants(self) -> Plain:
        """Constants of a policy that is a dataclass, as plain data."""
        made_of = isinstance(self.policy, Policy) and is_dataclass(self.policy)
        return asdict(self.policy) if made_of else {}  # type: ignore[call-overload]  # an instance, no class

    def settled(self) -> "DrivenCrowd":
        """Return the same crowd; a `RuleAtShare` without a share gets the best one, see `best_share`."""
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
            if self.others is not None:
                arguments["observation"] = _observed_by(self.policy, self.others)
            env = MixedEnv(self.scenario, share=self.learned_share, others=self.others, **arguments)
        return PolicyDriver(
            self.policy, env, others=self.others, hindrance=self.hindrance, passes_rest=self.passes_rest
        )


def _observed_by(*policies: Policy) -> ObservationLayout | None:
    """Return the largest of the layouts of policies, with the terms of the others that it lacks."""
    layouts = [own["observation"] for one in policies if (own := own_arguments(one)).get("observation") is not None]
    if not layouts:
        return None
    largest = max(layouts, key=lambda one: one.size)
    terms = {getattr(term, "name", term): term for one in (largest, *layouts) for term in one.terms}
    return replace(largest, terms=tuple(terms.values()))


def own_arguments(policy: Policy | Controller) -> Plain:
    """Return the arguments of `CrowdEnv` that belong to a policy; a strategy by its name alone switches signs off."""
    own: Plain = getattr(policy, "env_options", {})
    return arguments_of({"rules": False, **own} if "strategy" in own else own)


def drive(policy: Policy | Controller, scenario: Scenario, **arguments: Unpack[EnvArguments]) -> DrivenCrowd:
    """Return the settled `DrivenCrowd` of a policy in a scenario under arguments of `CrowdEnv`."""
    return DrivenCrowd(policy, scenario, arguments).settled()


def best_share(crowd: DrivenCrowd) -> float:
    """Return the share of the desired speed at which walking the shortest path empties a scenario soonest.

    It tries every share in `SHARES`, from full speed downwards, on the same `SEARCH_RUNS` draws, which neither evaluations nor
    trainings use.  The number of pedestrians left inside in all runs counts first.  Then counts the mean time of the last
    pedestrian over the runs that cleared, so that no time limit stands for a time.  The search ends at the first share that
    clears all runs, but later than the best: slower walking takes longer still.
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
