"""CrowdEnv: a batch of evacuations over arrays; the only place where learning meets physics."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, get_args

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.headway import Manner
from crowd_env.core.arrays.outline import BodyShape, room_of
from crowd_env.core.arrays.state import Bools, Floats, Ints, make_state
from crowd_env.core.checks import COUNT, POSITIVE, Range, array, flag, known, number, text, whole
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.envs.action import FRAMES, ActionKind, Frame, make_action, to_command
from crowd_env.envs.arguments import (
    bodies_before_reset,
    check_size,
    one_manner,
    one_outline,
    parts_of,
    scenarios_of,
    seed_words,
)
from crowd_env.envs.episode import EnvCheckpoint, init_episode, metrics_of, update_episode
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.observation.layout import ObservationLayout, make_layout
from crowd_env.envs.observation.observer import Observer
from crowd_env.envs.observation.view import allocate_route_ahead
from crowd_env.envs.reward import RewardFunction, RewardWeights, Transition, make_weights
from crowd_env.envs.route_choice import fit_to_ways, make_route_choice, take_routes
from crowd_env.physics import ContactScheme, check_outline, make_scheme
from crowd_env.physics.simulation.arguments import check_step
from crowd_env.physics.simulation.checkpoint import copy_arrays, require_checkpoint, write_arrays
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.groups import extreme_bodies
from crowd_env.scenarios.scenario import Scenario

_THREADS = Range(1, 1024)
ActsOn = Literal["everyone", "ruled"]


class Step(NamedTuple):
    """What a decision step returns; P people, E environments, in slots that never move."""

    observation: np.ndarray  #: (P, D) float32; zero for those who are out
    reward: Floats  #: (P,)
    terminated: Bools  #: (P,) got out during this step: true exactly once an episode
    truncated: Bools  #: (P,) still inside when the time limit was reached
    info: dict[str, Any]  #: ``reward/<name>`` (P,), ``finished`` (E,), ``diagnostics``; see `CrowdEnv`


class CrowdEnv:
    """A batch of evacuations.

    Observation
        (P, D) float32 in [-1, 1], columns as ``layout`` says.  The row of someone who gets out holds the last observation in
        that step, zeros afterwards.
    Action
        (P, 2) in [-1, 1]: the desired velocity as a multiple of the own desired speed, in ``frame``; or (P,) 0..8, or what
        another kind of action takes, which may choose an exit too.  Where ``rule`` is true, or if the action is None, the
        pedestrian walks the shortest path instead.
    Reward
        (P,), see ``RewardWeights``; ``info["reward/<name>"]`` holds each term unweighted.  Those who are out get nothing but
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
    frame, action : axes of the actions, and a name in ``ACTIONS``, an `ActionKind`, or plain data such as
        ``{"name": "speeds", "speeds": [0, 0.5, 1]}``: see `crowd_env.envs.action`.
    observation, reward : layout and weights, or plain data: ``{"terms": ["velocity"], "rays": 16}``, ``{"time": 1.0}``.
    time_limit : s, replaces the scenario's.
    autoreset : start a new episode in the step in which an environment finishes; the last observations of the finished one
        are then in ``info["final_observation"]``.
    threads : spread environments over threads; results do not depend on it.
    strategy, rules : how people choose their route, and whether the scenario's control rules are in force, see
        `Scenario.route_set`.
    manner : how people walk before they touch: a name in ``MANNERS``, a Headway, or a table of its parameters; by default as
        the scenario says, and if that says nothing at full speed whatever is in front of them.
    manner_for : whom the manner acts on.  "everyone": also those who have an action, which then says what one would do with
        nobody in front.  "ruled": only those whom the rule leads; the others walk as their action says.
    outline : shape of all bodies: a name in ``OUTLINES``, an Outline, or a table of its parameters; by default as the scenario
        says, and if that says nothing they are discs.  Only `hertz` and `hertz-literal`, under which bodies turn, take another.
    max_drive : N, the largest force with which a person drives forwards, by default as large as the papers make it (up to
        2 kN); see `Simulation`.
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
        action: str | Mapping[str, Any] | ActionKind = "continuous",
        observation: ObservationLayout | Mapping[str, Any] | None = None,
        reward: RewardWeights | Mapping[Any, Any] | None = None,
        time_limit: float | None = None,
        autoreset: bool = False,
        threads: int = 1,
        strategy: str = "shortest",
        rules: bool = True,
        manner: Manner | None = None,
        manner_for: ActsOn = "everyone",
        outline: BodyShape | None = None,
        max_drive: float | None = None,
        **scenario_options: Any,
    ) -> None:
        num_envs, threads = whole("num_envs", num_envs, COUNT), whole("threads", threads, _THREADS)
        known("frame", frame, FRAMES)
        known("manner_for", manner_for, get_args(ActsOn))
        scheme = make_scheme(scheme)
        dt = scheme.info.default_dt if dt is None else number("dt", dt, POSITIVE, "s")
        decision_dt = number("decision_dt", decision_dt, POSITIVE, "s")
        self.n_substeps = parts_of("decision_dt", decision_dt, "physics steps of dt", dt)
        if time_limit is not None:
            time_limit = number("time_limit", time_limit, POSITIVE, "s")
        rules, autoreset = flag("rules", rules), flag("autoreset", autoreset)
        text("strategy", strategy, "the name of a strategy")
        self.reward_weights, kind, layout = make_weights(reward), make_action(action), make_layout(observation)
        self.scenarios = [make_scenario(kind, **scenario_options) for kind in scenarios_of(scenario)]
        self.action_kind, self.layout, choosing = fit_to_ways(kind, layout, self.scenarios)
        self.num_envs = num_envs
        self.decision_dt = decision_dt
        self.frame: Frame = frame
        self.manner_for: ActsOn = manner_for
        self.autoreset = autoreset
        self.single_observation_space = gymnasium.spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)
        self.single_action_space = copy.deepcopy(self.action_kind.space)  # whoever seeds it seeds no other
        check_size(self.scenarios, num_envs)
        shape = one_outline(self.scenarios, outline)
        check_outline(shape, scheme)
        for each in self.scenarios:
            check_step(scheme, extreme_bodies(each.population), dt, outline=shape)  # every draw, not only the first
        which = np.arange(num_envs) % len(self.scenarios)
        self.scenario_of_env = [self.scenarios[k] for k in which]
        self._generators = [np.random.default_rng() for _ in range(num_envs)]
        bodies = bodies_before_reset(self.scenario_of_env)
        people = len(bodies.radius)
        self.env_start = bodies.env_start
        self.env_of_person = np.repeat(np.arange(num_envs), np.diff(self.env_start))
        self.strategy = strategy
        self.route_set = [each.route_set(strategy, rules=rules, ways=choosing) for each in self.scenarios]
        self._usual_route: list[Ints | None] = [None] * len(self.scenarios)  # known where it is that of every episode
        self.simulation = Simulation(
            [each.geometry for each in self.scenarios],
            bodies,
            make_state(np.zeros((people, 2)), environments=num_envs),
            scheme=scheme,
            dt=dt,
            fields=self.route_set,
            geometry_of_env=which,
            threads=threads,
            manner=one_manner(self.scenarios, manner),
            outline=shape,
            max_drive=max_drive,
        )
        self.simulation.state.active[:] = False  # nobody is there before the first reset
        self._ahead = allocate_route_ahead(people)  # the observer writes it, the reward reads its potential
        in_world = frame == "world"
        routes_of_env = [self.route_set[k] for k in which]
        dwell = self.action_kind.dwell
        choice = make_route_choice(self.scenario_of_env, routes_of_env, self.env_start, dwell, used=choosing)
        self._choice, ways = struct_ref(choice), choice.ways
        self._observer = Observer(self.simulation, self.layout, self._ahead, ways, in_world=in_world, threads=threads)
        self._transition = struct_ref(
            Transition(
                inside=np.zeros(people, dtype=np.bool_),
                left=np.zeros(people, dtype=np.bool_),
                travel_time_before=np.zeros(people),
                travel_time_after=self._ahead.potential,
                duration=np.zeros(people),
                impulse_magnitude=self.simulation.results.impulse_magnitude,
                bodies=self.simulation.bodies,
                state=self.simulation.state,
            )
        )
        time_limits = np.array([time_limit or each.time_limit for each in self.scenario_of_env])
        blocked_after = np.array([each.blocked_after for each in self.scenario_of_env])
        self._episode = init_episode(self._transition, time_limits, blocked_after)
        self._reward = RewardFunction(self.reward_weights, people)
        self._started = False
        self._times_restored = 0
        self._interrupted = False  # a step was begun and never came to its end: Ctrl-C, or a crowd that diverged

    @property
    def time_limit(self) -> Floats:
        """Time limit of each environment (E,) [s]; what is written into it counts from the next step on."""
        limits: Floats = self._episode.fields.time_limit
        return limits

    @property
    def finished(self) -> Bools:
        """Which environments wait for a reset (E,): all of them until the first."""
        finished: Bools = self._episode.fields.finished
        return finished

    @property
    def num_people(self) -> int:
        """Number of slots P."""
        return int(self.env_start[-1])

    @property
    def active(self) -> Bools:
        """Who is still inside (P,): a copy, which later steps do not change."""
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
            get from its seed; None goes on drawing from the generators as they are, and the first time draws at random.

        Raises
        ------
        ValueError
            If a seed is negative or there are not as many as environments, or the mask is no array of booleans.
        """
        chosen = np.ones(self.num_envs, dtype=np.bool_) if mask is None else array("mask", mask, (self.num_envs,), "b")
        for e, words in enumerate(seed_words(seed, self.num_envs)):
            if chosen[e] and (words is not None or not self._started):  # copies that have not begun share no draw
                self._generators[e] = np.random.default_rng(words)
        for k in np.flatnonzero(chosen):
            self._restart(int(k))
        self._started = True
        observation, transition = self._observer.observe(self.active), self._transition.fields
        fresh = chosen[self.env_of_person]
        transition.travel_time_before[fresh] = transition.travel_time_after[fresh]
        if chosen.all():
            self._times_restored, self._interrupted = self.simulation.times_restored, False
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
        command, relative, gives_way = self._command(action, rule)
        transition, episode = self._transition.fields, self._episode.fields
        if not self._interrupted:  # else this step goes on with the one before: who got out in between has left
            transition.inside[:], episode.step_start[:] = state.active, state.time
        self._interrupted = True
        simulation.advance(command, relative=relative, n_substeps=self.n_substeps, gives_way=gives_way)
        # Before the end of an episode takes out those who are truncated: they are still seen, by themselves and by others,
        # and what is left of their route is not yet 0, which would pay them as if they had got out.
        observation = self._observer.observe(transition.inside)
        update_episode(self._episode, simulation.dt)
        self._interrupted = False
        left, truncated, ended = transition.left.copy(), episode.truncated.copy(), episode.ended.copy()
        reward, terms = self._reward(self._transition)
        over = np.flatnonzero(ended)
        info: dict[str, Any] = {**terms, "finished": ended}
        info["diagnostics"] = simulation.results.diagnostics.copy()
        info["metrics"] = {int(e): self.metrics(int(e)) for e in over}
        if self.autoreset and len(over):
            info["final_observation"] = observation.copy()
            for e in over:
                self._restart(int(e))
            self._observer.observe(state.active, over, observation)
        transition.travel_time_before[:] = transition.travel_time_after
        return Step(observation, reward, left, truncated, info)

    def metrics(self, e: int) -> EpisodeMetrics:
        """Return the metrics of the episode of environment ``e`` so far."""
        return metrics_of(e, self.people(e), self._episode.fields, self.simulation)

    def checkpoint(self) -> EnvCheckpoint:
        """Return a copy of all that the future depends on, to `restore` here, or in an environment made like this one.

        The last observation is no part of it: callers who need it keep it beside the checkpoint.
        """
        return EnvCheckpoint(
            self.simulation.checkpoint(),
            copy_arrays(self._episode.fields),
            copy_arrays(self._transition.fields),
            copy_arrays(self._ahead),
            self._choice.fields.chosen_at.copy(),
            tuple(copy.deepcopy(rng.bit_generator.state) for rng in self._generators),
            self._started,
            self._interrupted,
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
        require_checkpoint(checkpoint, EnvCheckpoint, "an environment")
        self.simulation.restore(checkpoint.simulation)
        write_arrays(self._episode.fields, checkpoint.episode)
        write_arrays(self._transition.fields, checkpoint.step)
        write_arrays(self._ahead, checkpoint.ahead)
        self._choice.fields.chosen_at[:] = checkpoint.chosen_at
        for rng, state in zip(self._generators, checkpoint.generators, strict=True):
            rng.bit_generator.state = copy.deepcopy(state)
        self._started, self._interrupted = checkpoint.started, checkpoint.interrupted
        self._times_restored = self.simulation.times_restored

    def _restart(self, e: int) -> None:
        scenario = self.scenario_of_env[e]
        bodies, position = scenario.population.draw(
            self._generators[e], scenario.geometry, room_of(self.simulation.outline)
        )
        kind = e % len(self.scenarios)
        route = self._usual_route[kind]
        self.simulation.restart(e, bodies, position, route=0 if route is None else route)
        if route is None:
            route_set = self.simulation.planner.route_set(e)  # as the doors stand at the start
            assert route_set is not None
            chosen = scenario.choose(route_set, self.strategy, position)
            self.simulation.send(e, chosen)
            if not scenario.depends_on_place(self.strategy):
                self._usual_route[kind] = chosen
        self._choice.fields.chosen_at[self.people(e)] = -np.inf
        self._episode.fields.impulse[self.people(e)] = 0.0
        self._episode.fields.last_exit[e] = 0.0
        self._episode.fields.step_start[e] = 0.0
        self._transition.fields.inside[self.people(e)] = True
        self.finished[e] = False

    def _command(
        self, action: ArrayLike | None, rule: ArrayLike | None
    ) -> tuple[Floats | None, Bools | None, Bools | None]:
        if action is None:
            return None, None, None
        controlled = self.active
        if rule is not None:
            controlled &= ~array("rule", rule, (self.num_people,), "b")
        command, way = to_command(action, self.action_kind, controlled)
        if way is not None:
            take_routes(way, controlled, self._choice, self._transition.fields.state)
        ruled = ~controlled
        return command, (ruled if self.frame == "world" else None), (ruled if self.manner_for == "ruled" else None)
