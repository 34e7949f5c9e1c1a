"""CrowdEnv: a batch of evacuations over arrays; the only place where learning meets physics."""

import copy
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env._kernels.struct_ref import struct_ref
from crowd_env.checks import COUNT, POSITIVE, Range, array, flag, number, refuse, text, whole
from crowd_env.envs.action import ActionKind, Frame, action_space, check_frame, to_command
from crowd_env.envs.episode import open_books, settle
from crowd_env.envs.metrics import EpisodeMetrics, summarise_exits
from crowd_env.envs.observation.layout import ObservationLayout, make_layout
from crowd_env.envs.observation.observer import Observer
from crowd_env.envs.reward import RewardFunction, RewardWeights, Transition, make_weights
from crowd_env.envs.seeding import seed_words
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.groups import extreme_bodies
from crowd_env.scenarios.scenario import Scenario
from crowd_env.simulation.arguments import check_step
from crowd_env.simulation.checkpoint import EnvCheckpoint, copy_arrays, write_arrays
from crowd_env.simulation.simulation import Simulation
from crowd_env.state import Bodies, Bools, Floats, Ints, make_state

MOST_PEOPLE_IN_BATCH = 10_000_000
_THREADS = Range(1, 1024)


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
        A pedestrian terminates when its center crosses an exit line, and is truncated at the scenario's time limit.  An
        environment is finished when nobody is left inside, at its time limit, or when its exits are blocked (nobody has got
        out for ``Scenario.blocked_after``; the rest are truncated); ``info["finished"]`` (E,).
    Diagnostics
        ``info["diagnostics"]`` holds the overlaps, solver residual and iterations of the step, per environment (E,).
    Randomness
        Environment ``e`` has its own generator, made of (seed, e); a list of seeds gives environment ``e`` what a batch of
        one gets from that seed.  Physics and observations draw nothing.

    Parameters
    ----------
    scenario : name in ``SCENARIOS``, a file, a Scenario, or a sequence of them, dealt out to the environments in turn.
    num_envs : number of environments E.
    scheme : name in ``SCHEMES``, a scheme, or plain data: ``{"name": "nsm2", "tolerance": 1e-3, "social": "lin"}``.
    dt, decision_dt : s, physics step (default: the scheme's) and decision step, a whole multiple of the first.
    frame, action : see `crowd_env.envs.action`.
    observation, reward : layout and weights, or plain data: ``{"terms": ["velocity"], "rays": 16}``, ``{"time": 1.0}``.
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
        scheme: str | Mapping[str, Any] | ContactScheme = "nsm2",
        dt: float | None = None,
        decision_dt: float = 0.1,
        frame: Frame = "path",
        action: ActionKind = "continuous",
        observation: ObservationLayout | Mapping[str, Any] | None = None,
        reward: RewardWeights | Mapping[str, Any] | None = None,
        time_limit: float | None = None,
        autoreset: bool = False,
        threads: int = 1,
        strategy: str = "shortest",
        rules: bool = True,
        **scenario_options: Any,
    ) -> None:
        num_envs, threads = whole("num_envs", num_envs, COUNT), whole("threads", threads, _THREADS)
        check_frame(frame)
        scheme = make_scheme(scheme)
        dt = scheme.info.default_dt if dt is None else number("dt", dt, POSITIVE, "s")
        decision_dt = number("decision_dt", decision_dt, POSITIVE, "s")
        self.n_substeps = _whole_number(decision_dt, dt)
        if time_limit is not None:
            time_limit = number("time_limit", time_limit, POSITIVE, "s")
        rules, autoreset = flag("rules", rules), flag("autoreset", autoreset)
        text("strategy", strategy, "the name of a strategy")
        self.layout, self.reward_weights = make_layout(observation), make_weights(reward)
        self.single_action_space = action_space(action)
        self.scenarios = [make_scenario(kind, **scenario_options) for kind in _as_several(scenario)]
        self.num_envs = num_envs
        self.decision_dt = decision_dt
        self.frame: Frame = frame
        self.action_kind: ActionKind = action
        self.autoreset = autoreset
        self.single_observation_space = gymnasium.spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)
        _check_size(self.scenarios, num_envs)
        which = np.arange(num_envs) % len(self.scenarios)
        for place in self.scenarios:
            check_step(make_scheme(scheme), extreme_bodies(place.population), dt)  # every draw, not only the first
        time_limits = np.array([time_limit or self.scenarios[k].time_limit for k in which])
        self.scenario_of_env = [self.scenarios[k] for k in which]
        self._generators = [np.random.default_rng() for _ in range(num_envs)]
        draws = [
            s.population.draw(rng, s.geometry) for s, rng in zip(self.scenario_of_env, self._generators, strict=True)
        ]
        self.env_start = np.concatenate([[0], np.cumsum([len(position) for _, position in draws])]).astype(np.int64)
        columns = [np.concatenate(column) for column in zip(*(bodies[:-1] for bodies, _ in draws), strict=True)]
        self.strategy = strategy
        self.route_set = [s.route_set(strategy, rules=rules) for s in self.scenarios]
        self.simulation = Simulation(
            [s.geometry for s in self.scenarios],
            Bodies._make([*columns, self.env_start]),
            make_state(np.concatenate([position for _, position in draws]), environments=num_envs),
            scheme=scheme,
            dt=dt,
            fields=self.route_set,
            geometry_of_env=which,
            threads=threads,
        )
        self.simulation.state.active[:] = False  # nobody is there before the first reset
        people = int(self.env_start[-1])
        self.env_of_person = np.repeat(np.arange(num_envs), np.diff(self.env_start))
        self._observer = Observer(self.simulation, self.layout, in_world=frame == "world", threads=threads)
        self._route_of_all: list[Ints | None] = [None] * len(
            self.scenarios
        )  # known when it is the same in each episode
        self._transition = struct_ref(
            Transition(
                inside=np.zeros(people, dtype=np.bool_),
                left=np.zeros(people, dtype=np.bool_),
                travel_time_before=np.zeros(people),
                travel_time_after=self._observer.potential,
                duration=np.zeros(people),
                crush=self.simulation.results.impulse_magnitude,
                mass=self.simulation.bodies.mass,
                env_start=self.env_start,
            )
        )
        blocked_after = np.array([place.blocked_after for place in self.scenario_of_env])
        self._books = open_books(self._transition, self.simulation.state, time_limits, blocked_after)
        self._reward = RewardFunction(self.reward_weights, people)
        self._started = False
        self._times_restored = 0
        self._unsettled = False  # a step was begun whose books were never closed: Ctrl-C, or a crowd that diverged

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
        """Who is still inside (P,): an array of one's own, which later steps do not change."""
        return self.simulation.state.active.copy()

    def people(self, e: int) -> slice:
        """Return the slots of environment ``e``, 0 to E - 1."""
        e = whole("environment", e, Range(0, self.num_envs - 1))
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
            If a seed is negative or there are not as many as environments, or the mask is no array of booleans.
        """
        chosen = np.ones(self.num_envs, dtype=np.bool_) if mask is None else array("mask", mask, (self.num_envs,), "b")
        for e, words in enumerate(seed_words(seed, self.num_envs)):
            if chosen[e] and words is not None:
                self._generators[e] = np.random.default_rng(words)
        for k in np.flatnonzero(chosen):
            self._restart(int(k))
        self._started = True
        observation, transition = self._observer.observe(self.active), self._transition.fields
        fresh = chosen[self.env_of_person]
        transition.travel_time_before[fresh] = transition.travel_time_after[fresh]
        if chosen.all():
            self._times_restored, self._unsettled = self.simulation.times_restored, False
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
        if simulation.times_restored != self._times_restored:
            raise ValueError(
                "the simulation alone was restored, the environment was not; restore or reset the environment"
            )
        command, relative = self._command(action, rule)
        transition, books = self._transition.fields, self._books.fields
        if not self._unsettled:  # else this step goes on with the one before: who got out in between has left
            transition.inside[:], books.started[:] = state.active, state.time
        self._unsettled = True
        simulation.advance(command, relative=relative, n_substeps=self.n_substeps)
        observation = self._observer.observe(transition.inside)
        settle(self._books, simulation.dt)
        self._unsettled = False
        left, truncated, ended = transition.left.copy(), books.truncated.copy(), books.ended.copy()
        reward, terms = self._reward(self._transition)
        over = np.flatnonzero(ended)
        info: dict[str, Any] = {**terms, "finished": ended}
        info["diagnostics"] = simulation.results.diagnostics.copy()
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

    def checkpoint(self) -> EnvCheckpoint:
        """Return a copy of all that the future depends on, to `restore` here, or in an environment made like this one.

        The last observation is the caller's, who keeps it beside the checkpoint if he needs it.
        """
        return EnvCheckpoint(
            self.simulation.checkpoint(),
            copy_arrays(self._books.fields),
            copy_arrays(self._transition.fields),
            tuple(array.copy() for array in self._observer.kept),
            tuple(copy.deepcopy(rng.bit_generator.state) for rng in self._generators),
            self._started,
            self._unsettled,
        )

    def restore(self, checkpoint: EnvCheckpoint) -> None:
        """Go back to a moment: the same actions, and resets without a seed, lead bit by bit to what they led to then.

        Raises
        ------
        TypeError
            If it is no checkpoint of an environment.
        ValueError
            If the checkpoint is of an environment of other people, places, scheme or steps.
        """
        if not isinstance(checkpoint, EnvCheckpoint):
            raise TypeError(f"restore takes a checkpoint() of an environment, not {type(checkpoint).__name__}")
        self.simulation.restore(checkpoint.simulation)
        write_arrays(self._books.fields, checkpoint.books)
        write_arrays(self._transition.fields, checkpoint.step)
        for kept, then in zip(self._observer.kept, checkpoint.seen, strict=True):
            kept[:] = then
        for rng, state in zip(self._generators, checkpoint.generators, strict=True):
            rng.bit_generator.state = copy.deepcopy(state)
        self._started, self._unsettled = checkpoint.started, checkpoint.unsettled
        self._times_restored = self.simulation.times_restored

    def _restart(self, e: int) -> None:
        scenario = self.scenario_of_env[e]
        bodies, position = scenario.population.draw(self._generators[e], scenario.geometry)
        kind = e % len(self.scenarios)
        route = self._route_of_all[kind]
        self.simulation.restart(e, bodies, position, route=0 if route is None else route)
        if route is None:
            route_set = self.simulation.planner.route_set(e)  # as the doors stand at the start
            assert route_set is not None
            chosen = scenario.choose(route_set, self.strategy, position)
            self.simulation.send(e, chosen)
            if not scenario.depends_on_place(self.strategy):
                self._route_of_all[kind] = chosen
        self._books.fields.impulse[self.people(e)] = 0.0
        self._books.fields.last_exit[e] = 0.0
        self._books.fields.started[e] = 0.0
        self._transition.fields.inside[self.people(e)] = True
        self.finished[e] = False

    def _command(self, action: ArrayLike | None, rule: ArrayLike | None) -> tuple[Floats | None, Bools | None]:
        if action is None:
            return None, None
        asked = self.active
        if rule is not None:
            asked = asked & ~array("rule", rule, (self.num_people,), "b")
        command = to_command(action, self.action_kind, self.num_people, asked)
        return command, (~asked if self.frame == "world" else None)


def _as_several(scenario: Any) -> list[Any]:
    """Return the scenarios; one alone is a name, a file or a Scenario."""
    if isinstance(scenario, str | Path | Scenario):
        return [scenario]
    if not isinstance(scenario, Iterable) or isinstance(scenario, Mapping | bytes):
        refuse("scenario", scenario, "the name of a scenario, its file, a Scenario, or a list of them")
    kinds = list(scenario)
    if not kinds:
        raise ValueError("no scenario; give at least one")
    return kinds


def _check_size(scenarios: Sequence[Scenario], num_envs: int) -> None:
    """Raise ValueError if a batch has more people than any memory has room for, before anything is allocated."""
    each = sum(place.population.count for place in scenarios) / len(scenarios)
    if num_envs * each > MOST_PEOPLE_IN_BATCH:
        raise ValueError(
            f"num_envs is {num_envs}; with {each:g} people in each it must be at most {int(MOST_PEOPLE_IN_BATCH // each)}: "
            f"a batch has room for {MOST_PEOPLE_IN_BATCH} people"
        )


def _whole_number(decision_dt: float, dt: float) -> int:
    ratio = decision_dt / dt
    if not 0.5 < ratio < 1e9 or abs(ratio - round(ratio)) > 1e-6:
        raise ValueError(f"decision_dt = {decision_dt:g} s is not a whole number of physics steps of dt = {dt:g} s")
    return round(ratio)
