"""CrowdEnv: a batch of evacuations over arrays; the only place where learning meets physics."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env._reference import refer
from crowd_env.action import ActionKind, Frame, action_space, check_frame, to_command
from crowd_env.metrics import EpisodeMetrics, summarise_exits
from crowd_env.observation import ObservationLayout
from crowd_env.observer import Observer
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.progress import open_books, settle
from crowd_env.reward import RewardFunction, RewardWeights, Transition
from crowd_env.scenario import Scenario
from crowd_env.scenarios import make_scenario
from crowd_env.simulation import Simulation, check_step
from crowd_env.state import Bodies, Bools, Floats, Ints, make_bodies, make_state


class Step(NamedTuple):
    """What a decision step returns; P people, E environments, in slots that never move."""

    observation: np.ndarray  # (P, D) float32; zero for those who are out
    reward: Floats  # (P,)
    terminated: Bools  # (P,)   got out during this step: true exactly once an episode
    truncated: Bools  # (P,)   still inside when the time limit was reached
    info: dict[str, Any]


class CrowdEnv:
    """A batch of evacuations.

    Observation
        (P, D) float32 in [-1, 1], columns as ``layout`` says.  The row of someone who got out is his last one in the step
        in which he got out, zero afterwards.
    Action
        (P, 2) in [-1, 1]: the desired velocity as a multiple of the own desired speed, in ``frame``; or (P,) 0..8.  Where
        ``rule`` is true, or if the action is None, the pedestrian walks the shortest path instead.
    Reward
        (P,), see ``RewardWeights``; ``info["reward/<name>"]`` holds each term unweighted.  0 for those who are out, but for
        their ``team_share``.
    Termination
        A pedestrian terminates when its centre crosses an exit line, and is truncated at the scenario's time limit.  An
        environment is finished when nobody is left inside, at its time limit, or when its exits are blocked (nobody has got
        out for ``Scenario.blocked_after``; the rest are truncated); ``info["finished"]`` (E,).
    Diagnostics
        ``info["diagnostics"]`` holds the overlaps, solver residual and iterations of the step, per environment (E,).
    Randomness
        Environment ``e`` has its own generator, made of (seed, e); a list of seeds gives environment ``e`` what a batch of
        one gets from that seed.  Physics and observations draw nothing.

    Parameters
    ----------
    scenario : name in ``SCENARIOS``, a Scenario, or a sequence of them, dealt out to the environments in turn.
    num_envs : number of environments E.
    scheme : name in ``SCHEMES`` or a scheme.
    dt, decision_dt : s, physics step (default: the scheme's) and decision step, a whole multiple of the first.
    frame, action : see `crowd_env.action`.
    observation, reward : layout and weights.
    time_limit : s, replaces the scenario's.
    autoreset : start a new episode in the step in which an environment finishes; the last observations of the finished one
        are then in ``info["final_observation"]``.
    threads : spread environments over threads; results do not depend on it.
    strategy, rules : how people choose their way, and whether the scenario's control rules are in force, see
        `Scenario.ways`.
    scenario_options : options of the scenario if it is given by name.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.

    Examples
    --------
    >>> env = CrowdEnv("room-v0", num_envs=4)
    >>> observation, info = env.reset(seed=0)
    >>> step = env.step(None)   # everyone walks the shortest path
    >>> step.reward.shape
    (80,)
    """

    def __init__(
        self,
        scenario: str | Scenario | Sequence[str | Scenario] = "room-v0",
        *,
        num_envs: int = 1,
        scheme: str | ContactScheme = "nsm2",
        dt: float | None = None,
        decision_dt: float = 0.1,
        frame: Frame = "path",
        action: ActionKind = "continuous",
        observation: ObservationLayout | None = None,
        reward: RewardWeights | None = None,
        time_limit: float | None = None,
        autoreset: bool = False,
        threads: int = 1,
        strategy: str = "shortest",
        rules: bool = True,
        **scenario_options: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}; it must be at least 1")
        check_frame(frame)
        dt = make_scheme(scheme).info.default_dt if dt is None else dt
        self.n_substeps = _whole_number(decision_dt, dt)
        kinds = [scenario] if isinstance(scenario, str | Scenario) else list(scenario)
        if not kinds:
            raise ValueError("no scenario; give at least one")
        self.scenarios = [make_scenario(kind, **scenario_options) for kind in kinds]
        self.num_envs = num_envs
        self.decision_dt = decision_dt
        self.frame: Frame = frame
        self.action_kind: ActionKind = action
        self.layout = observation or ObservationLayout()
        self.reward_weights = reward or RewardWeights()
        self.autoreset = autoreset
        self.single_action_space = action_space(action)
        self.single_observation_space = gymnasium.spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)
        which = np.arange(num_envs) % len(self.scenarios)
        if time_limit is not None and not 0 < time_limit < np.inf:
            raise ValueError(f"time_limit is {time_limit!r} s; it must be > 0 and finite")
        for place in self.scenarios:
            _check_stable(place, scheme, dt)
        time_limits = np.array([time_limit or self.scenarios[k].time_limit for k in which])
        self.scenario_of_env = [self.scenarios[k] for k in which]
        self._generators = [np.random.default_rng() for _ in range(num_envs)]
        draws = [
            s.population.draw(rng, s.geometry) for s, rng in zip(self.scenario_of_env, self._generators, strict=True)
        ]
        self.env_start = np.concatenate([[0], np.cumsum([len(position) for _, position in draws])]).astype(np.int64)
        columns = [np.concatenate(column) for column in zip(*(bodies[:-1] for bodies, _ in draws), strict=True)]
        self.strategy = strategy
        self.ways = [s.ways(strategy, rules=rules) for s in self.scenarios]
        self.simulation = Simulation(
            [s.geometry for s in self.scenarios],
            Bodies._make([*columns, self.env_start]),
            make_state(np.concatenate([position for _, position in draws]), environments=num_envs),
            scheme=scheme,
            dt=dt,
            fields=self.ways,
            geometry_of_env=which,
            threads=threads,
        )
        people = int(self.env_start[-1])
        self.env_of_person = np.repeat(np.arange(num_envs), np.diff(self.env_start))
        self._observer = Observer(self.simulation, self.layout, in_world=frame == "world", threads=threads)
        self._route_of_all: list[Ints | None] = [None] * len(
            self.scenarios
        )  # known when it is the same in each episode
        self._transition = refer(
            Transition(
                inside=np.zeros(people, dtype=np.bool_),
                left=np.zeros(people, dtype=np.bool_),
                travel_time_before=np.zeros(people),
                travel_time_after=self._observer.potential,
                duration=np.zeros(people),
                crush=self.simulation.memory.crush,
                mass=self.simulation.bodies.mass,
                env_start=self.env_start,
            )
        )
        blocked_after = np.array([place.blocked_after for place in self.scenario_of_env])
        self._books = open_books(self._transition, self.simulation.state, time_limits, blocked_after)
        self._reward = RewardFunction(self.reward_weights, people)
        self._started = False

    @property
    def time_limit(self) -> Floats:
        """Time limit of each environment (E,) [s]; what is written into it counts from the next step on."""
        limits: Floats = self._books.fields.time_limit
        return limits

    @property
    def finished(self) -> Bools:
        """Which environments wait for a reset (E,): all of them until the first."""
        finished: Bools = self._books.fields.finished
        return finished

    @property
    def num_people(self) -> int:
        """Number of slots P."""
        return int(self.env_start[-1])

    @property
    def active(self) -> Bools:
        """Who is still inside (P,)."""
        return self.simulation.state.active

    def people(self, e: int) -> slice:
        """Return the slots of environment ``e``."""
        return slice(int(self.env_start[e]), int(self.env_start[e + 1]))

    def reset(
        self, seed: int | Sequence[int] | None = None, mask: ArrayLike | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start a new episode everywhere, or where ``mask`` (E,) is true.

        Parameters
        ----------
        seed : an int gives environment ``e`` the generator of (seed, e); a sequence gives each what a batch of one would
            get from its seed; None goes on drawing from the generators as they are.

        Raises
        ------
        ValueError
            If a seed is negative or there are not as many as environments.
        """
        chosen = np.ones(self.num_envs, dtype=np.bool_) if mask is None else np.asarray(mask, dtype=np.bool_)
        if chosen.shape != (self.num_envs,):
            raise ValueError(f"mask must have the shape ({self.num_envs},), not {chosen.shape}")
        for e, words in enumerate(_seed_words(seed, self.num_envs)):
            if chosen[e] and words is not None:
                self._generators[e] = np.random.default_rng(words)
        for k in np.flatnonzero(chosen):
            self._restart(int(k))
        self._started = True
        observation, transition = self._observer.observe(self.active), self._transition.fields
        fresh = chosen[self.env_of_person]
        transition.travel_time_before[fresh] = transition.travel_time_after[fresh]
        return observation, {}

    def step(self, action: ArrayLike | None = None, rule: ArrayLike | None = None) -> Step:
        """Advance every unfinished environment by one decision step.

        Parameters
        ----------
        action : (P, 2) or, if discrete, (P,); rows of people who are out are ignored.  None: everyone follows the rule.
        rule : (P,), true for those who follow the rule whatever their action.

        Raises
        ------
        ValueError
            If an action is malformed or not finite.
        """
        if not self._started:
            raise ValueError("call reset before the first step")
        simulation, state = self.simulation, self.simulation.state
        command, relative = self._command(action, rule)
        transition, books = self._transition.fields, self._books.fields
        transition.inside[:], books.started[:] = state.active, state.time
        simulation.advance(command, relative=relative, n_substeps=self.n_substeps)
        observation = self._observer.observe(transition.inside)
        settle(self._books, simulation.dt)
        left, truncated, ended = transition.left.copy(), books.truncated.copy(), books.ended.copy()
        reward, terms = self._reward(self._transition)
        over = np.flatnonzero(ended)
        info: dict[str, Any] = {**terms, "finished": ended}
        info["diagnostics"] = type(simulation.last_diagnostics)._make(a.copy() for a in simulation.last_diagnostics)
        info["metrics"] = {int(e): self.metrics(int(e)) for e in over}
        if self.autoreset and len(over):
            info["final_observation"] = final = self._observer.rows.take()
            final[:] = observation
            for e in over:
                self._restart(int(e))
            self._observer.observe(state.active, over, observation)
        transition.travel_time_before[:] = transition.travel_time_after
        return Step(observation, reward, left, truncated, info)

    def metrics(self, e: int) -> EpisodeMetrics:
        """Return the metrics of the episode of environment ``e`` so far."""
        people, sums, books = self.people(e), self.simulation.diagnostics, self._books.fields
        exits = summarise_exits(np.sort(self.simulation.state.exit_time[people]))
        blocked = books.clock[e] - books.last_exit[e] > books.blocked_after[e]
        return EpisodeMetrics(
            evacuation_time=exits.last,
            mean_exit_time=exits.mean,
            unfinished=exits.missing,
            blocked_since=float(books.last_exit[e]) if exits.missing and blocked else float("nan"),
            flow=exits.flow,
            contact_impulse=float(books.impulse[people].mean()),
            max_overlap=float(sums.max_overlap[e]),
            mean_overlap=float(sums.overlap_sum[e] / max(sums.overlap_count[e], 1)),
            max_outside=float(sums.max_outside[e]),
            max_speed=float(sums.max_speed[e]),
            escaped=int(self.simulation.escaped[people].sum()),
            residual=float(sums.residual[e]),
            unconverged=int(sums.unconverged[e]),
        )

    def _restart(self, e: int) -> None:
        scenario = self.scenario_of_env[e]
        bodies, position = scenario.population.draw(self._generators[e], scenario.geometry)
        kind = e % len(self.scenarios)
        route = self._route_of_all[kind]
        self.simulation.restart(e, bodies, position, route=0 if route is None else route)
        if route is None:
            ways = self.simulation.wayfinder.ways(e)  # as the doors stand at the start
            assert ways is not None
            chosen = scenario.choose(ways, self.strategy, position)
            self.simulation.send(e, chosen)
            if not scenario.depends_on_place(self.strategy):
                self._route_of_all[kind] = chosen
        self._books.fields.impulse[self.people(e)] = 0.0
        self._books.fields.last_exit[e] = 0.0
        self.finished[e] = False

    def _command(self, action: ArrayLike | None, rule: ArrayLike | None) -> tuple[Floats | None, Bools | None]:
        if action is None:
            return None, None
        asked = self.active
        if rule is not None:
            ruled = np.asarray(rule, dtype=np.bool_)
            if ruled.shape != (self.num_people,):
                raise ValueError(f"rule must have the shape ({self.num_people},), not {ruled.shape}")
            asked = asked & ~ruled
        command = to_command(action, self.action_kind, self.num_people, asked)
        return command, (~asked if self.frame == "world" else None)


def _check_stable(scenario: Scenario, scheme: str | ContactScheme, dt: float) -> None:
    """Raise ValueError if some draw of the population could be unstable, not only the first one."""
    people = scenario.population
    scheme = make_scheme(scheme)
    one = (np.array([people.radius.low]), np.array([people.mass.low]))
    lightest = make_bodies(*one, relaxation_time=people.relaxation_time.low)
    check_step(scheme, lightest, dt)


def _whole_number(decision_dt: float, dt: float) -> int:
    if not (0 < dt < np.inf and 0 < decision_dt < np.inf):
        raise ValueError(f"dt is {dt!r} s and decision_dt {decision_dt!r} s; both must be > 0 and finite")
    ratio = decision_dt / dt
    if abs(ratio - round(ratio)) > 1e-6 or round(ratio) < 1:
        raise ValueError(f"decision_dt = {decision_dt:g} s is not a whole number of physics steps of dt = {dt:g} s")
    return round(ratio)


def _seed_words(seed: int | Sequence[int] | None, num_envs: int) -> list[list[int] | None]:
    """Return what each environment's generator is made of."""
    if seed is None:
        return [None] * num_envs
    words: list[list[int] | None]
    if isinstance(seed, list | tuple | np.ndarray):
        words = [[_seed(word), 0] for word in seed]
    else:
        words = [[_seed(seed), e] for e in range(num_envs)]
    if len(words) != num_envs:
        raise ValueError(f"{len(words)} seeds for {num_envs} environments; give one each, or a single int")
    return words


def _seed(word: Any) -> int:
    if not isinstance(word, int | np.integer) or word < 0:
        raise ValueError(f"seed {word!r} is not a whole number >= 0")
    return int(word)
