"""CrowdEnv: a batch of evacuations over arrays; the only module where learning meets physics."""

import copy
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias, cast

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Bools, Floats, Ints, join_bodies, make_state
from crowd_env.core.behaviors.outline import Outline, room_of
from crowd_env.core.checks import COUNT, POSITIVE, Plain, Range, array, flag, number, refuse, whole
from crowd_env.envs.action import ActionKind, Masks, make_action, mask_info, to_command
from crowd_env.envs.arguments import (
    MIXED,
    Place,
    bodies_before_reset,
    drawn_share,
    parts_of,
    scenarios_of,
    seed_words,
    settle,
)
from crowd_env.envs.episode import init_transition, metrics_of, update_episode
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.observation.layout import ObservationLayout, make_layout
from crowd_env.envs.observation.observer import Observer
from crowd_env.envs.restorable import Restorable
from crowd_env.envs.reward import RewardFunction, RewardWeights, make_weights
from crowd_env.envs.route_choice import RouteChoice, fit_to_ways
from crowd_env.envs.settings import AsRouting, Routing, answers_unknown, physics_step
from crowd_env.envs.tasks.environment import made_for
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.geometry.entrances import Entries
from crowd_env.physics.settings import AsPhysics, AsWalking, Physics, Walking
from crowd_env.physics.simulation.arguments import check_step
from crowd_env.physics.simulation.checkpoint import copy_arrays, write_arrays
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.scenarios.cohorts import extreme_bodies

Reset: TypeAlias = tuple[np.ndarray, dict[str, Any]]
"""What a reset returns: observations and an info."""


class Step(NamedTuple):
    """The result of a decision step; P people, E environments, in slots that never move."""

    observation: np.ndarray  #: (P, D) float32; zero for pedestrians outside
    reward: Floats  #: (P,)
    terminated: Bools  #: (P,) got out during this step: true exactly once an episode
    truncated: Bools  #: (P,) still inside when the time limit was reached
    info: dict[str, Any]  #: ``reward/<name>`` (P,), ``finished`` (E,), ``diagnostics``; see `CrowdEnv`


class CrowdEnv(Restorable):
    """A batch of evacuations.

    Observation
        (P, D) float32 in [-1, 1], columns as ``layout`` defines.  In the step of its exit a pedestrian's row holds its last
        observation, zeros afterwards.
    Action
        (P, 2) in [-1, 1]: the desired velocity as a multiple of the desired speed; or (P,) 0..8, or an action of another
        kind, which may choose an exit too: ``info["action_mask"]`` (P, n), also of a reset, is then the `action_mask`.  Where
        ``scripted`` is true, or if the action is None, the pedestrian walks the shortest path instead.
    Reward
        (P,), see ``RewardWeights``; ``info["reward/<name>"]`` holds each term unweighted.  Pedestrians outside receive only
        their ``team_share``.
    Termination
        A pedestrian terminates when its center crosses an exit line, and is truncated at the scenario's time limit.  An
        environment is finished when it is empty, at its time limit, or when its exits are blocked (no exit for
        ``Scenario.blocked_after``; the remaining pedestrians are truncated); ``info["finished"]`` (E,).
    Diagnostics
        ``info["diagnostics"]`` holds the overlaps, solver residual and iterations of the step, per environment (E,).
    Randomness
        Environment ``e`` has its own generator, made of (seed, e).  With a list of seeds environment ``e`` equals a batch of
        one with its seed.  Physics and observations draw nothing.

    Parameters
    ----------
    scenario : name or id of a task, which decides all that is not given here.  Or a name in ``SCENARIOS``, a file, a table
        ``{"name": "room-v0", "side": 8.0}`` of a name or file and the options of that scenario, a Scenario, or a sequence of
        these, dealt out to the environments in turn.
    people : number of people in each environment, instead of the scenario's.
    num_envs : number of environments E.
    physics : a `Physics`, a name in ``SCHEMES`` or a contact scheme, or a table of the fields of one of them.
    walking : a `Walking`, a name in ``MANNERS`` or a `Headway`, or a table of the fields of one of them.
    routing : a `Routing`, the name of a strategy, or a table of its fields.
    action : a name in ``ACTIONS``, an `ActionKind`, or a table such as ``{"name": "speeds", "speeds": [0, 0.5, 1]}`` or
        ``{"name": "continuous", "frame": "world"}``: see `crowd_env.envs.action`.
    observation, reward : layout and weights, or plain data: ``{"terms": ["velocity"], "rays": 16}``, ``{"time": 1.0}``.
    decision_dt : s, decision step, a whole multiple of the physics step.
    time_limit : s, replaces the scenario's.
    autoreset : start a new episode in the step in which an environment finishes; the last observations of the finished one
        are then in ``info["final_observation"]``.

    Attributes
    ----------
    task : the `Task` that the environment is of, or None.
    changed : what is another than in the task.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.
    TypeError
        If there is no such argument; the message names the right one.

    Examples
    --------
    >>> env = CrowdEnv("room-v0", num_envs=4)
    >>> observation, info = env.reset(seed=0)
    >>> step = env.step(None)   # everyone walks the shortest path
    >>> step.reward.shape
    (80,)
    """

    decides: Literal["walking"] = "walking"
    learned: Bools | bool = True  # (P,)  pedestrians that actions move
    _behind = "simulation"
    _kept: Collection[str] = ("_generators", "_started", "_interrupted", "learned")

    @answers_unknown()
    def __init__(
        self,
        scenario: Place | Sequence[Place] = "room-v0",
        *,
        people: int | None = None,
        num_envs: int = 1,
        physics: AsPhysics | None = None,
        walking: AsWalking = None,
        routing: AsRouting = None,
        action: str | Plain | ActionKind | None = None,
        observation: ObservationLayout | Plain | None = None,
        reward: RewardWeights | Mapping[Any, Any] | None = None,
        decision_dt: float | None = None,
        time_limit: float | None = None,
        autoreset: bool = False,
    ) -> None:
        given: dict[str, Any] = {
            "physics": physics,
            "walking": walking,
            "routing": routing,
            "action": action,
            "observation": observation,
            "reward": reward,
            "decision_dt": decision_dt,
        }
        self.task, self.changed, scenario, made = made_for(scenario, people, time_limit, given)
        physics, walking, routing, action, observation, reward, decision_dt = made.values()
        people = people if self.task is None else None  # the place has them
        self.num_envs = num_envs = whole("num_envs", num_envs, COUNT)
        self.physics = physics = Physics.of(physics)
        self.walking = walking = Walking.of(walking)
        self.routing = routing = Routing.of(routing)
        self.decision_dt = decision_dt = number("decision_dt", decision_dt, POSITIVE, "s")
        if time_limit is not None:
            time_limit = number("time_limit", time_limit, POSITIVE, "s")
        self.autoreset = flag("autoreset", autoreset)
        self.reward_weights, kind = make_weights(reward), make_action(action)
        layout = make_layout(observation, in_world=kind.frame == "world")
        self.scenarios = scenarios_of(scenario, people, num_envs)
        dt = physics_step(physics, *self.scenarios, within=decision_dt)
        self.n_substeps = parts_of("decision_dt", decision_dt, "physics steps of dt", dt)
        self.action_kind, self.layout, choosing = fit_to_ways(kind, layout, self.scenarios)
        self.single_observation_space = gymnasium.spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)
        self.single_action_space = copy.deepcopy(self.action_kind.space)  # a copy: seeding it seeds no other
        settled, walks = settle(self.scenarios, replace(physics, dt=dt), walking)
        for each in self.scenarios:  # every draw, not only the first
            check_step(settled.law, extreme_bodies(each.population), dt, outline=Outline.of(settled.outline))
        which = np.arange(num_envs) % len(self.scenarios)
        self.scenario_of_env = [self.scenarios[k] for k in which]
        self._generators = [np.random.default_rng() for _ in range(num_envs)]
        bodies = bodies_before_reset(self.scenario_of_env)
        slots = len(bodies.radius)
        self.env_start = bodies.env_start
        self.env_of_person = np.repeat(np.arange(num_envs), np.diff(self.env_start))
        self.strategies = [each.strategy_of_run(routing.strategy) for each in self.scenarios]
        self.route_set = [
            each.route_set(strategy, rules=routing.signs, ways=choosing)
            for each, strategy in zip(self.scenarios, self.strategies, strict=True)
        ]
        self._halts = [any(route.via for route in each.routes) for each in self.scenarios]
        self._usual_route: list[Ints | None] = [None] * len(self.scenarios)  # known where it is that of every episode
        self.simulation = Simulation(
            [each.geometry for each in self.scenarios],
            bodies,
            make_state(np.zeros((slots, 2)), environments=num_envs),
            physics=settled,
            walking=walks,
            fields=self.route_set,
            geometry_of_env=which,
        )
        self.simulation.state.active[:] = self.simulation.state.present[:] = False  # empty before the first reset
        in_world = self.action_kind.frame == "world"
        routes_of_env = [self.route_set[k] for k in which]
        self._choice = RouteChoice(self.scenario_of_env, routes_of_env, self.env_start, self.action_kind, used=choosing)
        self.observer = Observer(self.simulation, self.layout, self._choice.known.fields.ways, in_world=in_world)
        time_limits = np.array([time_limit or each.time_limit for each in self.scenario_of_env])
        blocked_after = np.array([each.blocked_after for each in self.scenario_of_env])
        self._transition = init_transition(self.simulation, self.observer.view.potential, time_limits, blocked_after)
        self._reward = RewardFunction(self.reward_weights, slots)
        self._decides = {
            "decision_dt": decision_dt,
            "share": walking.share,
            "frame": self.action_kind.frame,
            "dwell": self.action_kind.dwell,
            "time_limit": sorted({*time_limits.tolist()}),
            "blocked_after": sorted({*blocked_after.tolist()}),
            "acts_on": walks.acts_on,
            "reward": {getattr(term, "name", term): weight for term, weight in self.reward_weights.weights.items()},
            "team_share": self.reward_weights.team_share,
        }
        self._seeds: Sequence[int | None] | None = None  # of the reset that is under way
        if walking.share is not None:
            self.learned = np.ones(slots, dtype=bool)
        self._started = False
        self._interrupted = False  # a step began and did not end: Ctrl-C, or a crowd that diverged

    @property
    def id(self) -> str | None:
        """Id of the task, and what is another than there; None without a task."""
        if self.task is None:
            return None
        return f"{self.task.id} with another {', '.join(self.changed)}" if self.changed else self.task.id

    @property
    def time_limit(self) -> Floats:
        """Time limit of each environment (E,) [s]; a change counts from the next step on."""
        return self._transition.time_limit

    @property
    def finished(self) -> Bools:
        """Which environments wait for a reset (E,): all of them until the first."""
        return self._transition.finished

    @property
    def num_people(self) -> int:
        """Number of slots P."""
        return int(self.env_start[-1])

    @property
    def active(self) -> Bools:
        """Pedestrians still inside (P,): a copy, which later steps do not change."""
        return self.simulation.state.active.copy()

    @property
    def moved(self) -> dict[str, Bools]:
        """``learned`` (P,), a copy, where actions move a share of the people; else nothing."""
        return {} if self.walking.share is None else {"learned": np.array(self.learned)}

    @property
    def cohorts(self) -> dict[str, Bools]:
        """Name -> pedestrians (P,) of each cohort, the same in every episode.

        A cohort without a name is "pedestrian", of several the k-th "cohort k".
        """
        found: dict[str, Bools] = {}
        for begin, scenario in zip(self.env_start.tolist(), self.scenario_of_env, strict=False):
            parts = scenario.population.parts
            for k, part in enumerate(parts):
                name = part.name or (f"cohort {k}" if len(parts) > 1 else "pedestrian")
                found.setdefault(name, np.zeros(self.num_people, dtype=bool))[begin : begin + part.people] = True
                begin += part.people
        return found

    @property
    def action_mask(self) -> Masks | None:
        """Choices of each pedestrian (P, n) int8: 0 = of an exit or route that cannot be taken now; None without such choices.

        A choice with 0 does what it does along the current way.
        """
        return self.masked(self.active)

    def masked(self, inside: Bools) -> Masks | None:
        """Return the `action_mask` if these pedestrians (P,) are inside; the others choose no way."""
        return self._choice.mask(inside, self._transition.state, self.simulation.history.door_open)

    def people(self, e: int) -> slice:
        """Return the slots of environment ``e``, 0 to E - 1."""
        e = whole("environment", e, Range(0, self.num_envs - 1))
        return slice(int(self.env_start[e]), int(self.env_start[e + 1]))

    def cut_off(self, after: float) -> None:
        """Let every episode end after so long [s] at the latest, which may be another time limit than in the task."""
        self.time_limit[:] = after
        if self.task is not None and after != self.scenarios[0].time_limit and "time_limit" not in self.changed:
            self.changed = (*self.changed, "time_limit")

    def go_on_drawing(self, other: "CrowdEnv") -> None:
        """Draw the next episodes from the generators of another environment, so that one seed fixes a series over places."""
        self._generators, self._started = other._generators, other._started

    def reset(self, seed: int | Sequence[int | None] | None = None, mask: ArrayLike | None = None) -> Reset:
        """Start a new episode everywhere, or where ``mask`` (E,) is true.

        Parameters
        ----------
        seed : an int gives environment ``e`` the generator of (seed, e); a sequence gives each the generator of a batch of
            one with its seed; None continues the present generators, and the first time draws at random.

        Raises
        ------
        ValueError
            If a seed is negative or there are not as many as environments, or the mask is no array of booleans.
        """
        chosen = np.ones(self.num_envs, dtype=bool) if mask is None else array("mask", mask, (self.num_envs,), "b")
        for e, words in enumerate(seed_words(seed, self.num_envs)):
            if chosen[e] and (words is not None or not self._started):  # copies that have not begun share no draw
                if words is not None and self.task is not None:  # never one of the draws that are held out
                    words = [words[0] % HELD_OUT_SEED, words[1]]
                self._generators[e] = np.random.default_rng(words)
        if isinstance(seed, Sequence):
            self._seeds = seed if self.task is None else [s if s is None else s % HELD_OUT_SEED for s in seed]
        self._restart(np.flatnonzero(chosen).tolist())
        self._seeds = None
        self._started = True
        observation, transition = self.observer.observe(self.active), self._transition
        self._wait_for_the_first(chosen)
        fresh = chosen[self.env_of_person]
        transition.travel_time_before[fresh] = transition.travel_time_after[fresh]
        if chosen.all():
            self._agree()
            self._interrupted = False
        return observation, mask_info(self.action_mask)

    def step(self, action: ArrayLike | None = None, scripted: ArrayLike | None = None) -> Step:
        """Advance every unfinished environment by one decision step.

        Parameters
        ----------
        action : (P, 2) or, if discrete, (P,); rows of pedestrians outside are ignored.  None: all are scripted.
        scripted : (P,), true for pedestrians that walk at full speed along their route whatever their action.

        Raises
        ------
        ValueError
            If an action is malformed or not finite.
        """
        if not self._started:
            raise ValueError("call reset before the first step")
        simulation, state = self.simulation, self.simulation.state
        self._check_whole()
        command, relative, gives_way = self._command(action, scripted)
        transition = self._transition.fields
        if not self._interrupted:  # else this step continues the interrupted one, after some exits
            transition.inside[:], transition.step_start[:] = state.active, state.time
        self._interrupted = True
        observation, arriving = self.observer.begin(transition.inside), simulation.entrances.are_used
        look = partial(self._look if arriving else self.observer.look, observation)
        simulation.advance(command, relative=relative, n_substeps=self.n_substeps, gives_way=gives_way, then=look)
        # Before `update_episode` takes out truncated pedestrians: they are still observed, by themselves and by others.
        # The rest of their route is not yet 0, which would pay them as for an exit.
        self.observer.finish(observation)
        if arriving:
            self._count_entries()
        update_episode(self._transition, simulation.dt)
        self._interrupted = False
        left, truncated, ended = (array.copy() for array in (transition.left, transition.truncated, transition.ended))
        reward, terms = self._reward(self._transition)
        over = np.flatnonzero(ended)
        state.present[ended[self.env_of_person]] = False  # nothing happens after the end: on aprons neither
        for e in over.tolist() if arriving else ():
            simulation.entrances.close(e)
        info: dict[str, Any] = {**terms, "finished": ended}
        info["diagnostics"] = simulation.results.diagnostics.copy()
        info["metrics"] = {int(e): self.metrics(int(e)) for e in over}
        if self.autoreset and len(over):
            info["final_observation"] = observation.copy()
            self._restart(over.tolist())
            self.observer.observe(state.active, over, observation)
            self._wait_for_the_first(over)
        transition.travel_time_before[:] = transition.travel_time_after
        info |= mask_info(self.action_mask)
        return Step(observation, reward, left, truncated, info)

    def _look(self, rows: np.ndarray, first: int, stop: int) -> None:
        """Do as `Observer.look`, also for people that came in during the step."""
        people = slice(int(self.env_start[first]), int(self.env_start[stop]))
        self.observer.view.fields.seen[people] |= self.simulation.state.active[people]
        self.observer.look(rows, first, stop)

    def _count_entries(self) -> None:
        """Count the people still to come, and let the wait for blocked exits begin after entries too."""
        step, simulation = self._transition.fields, self.simulation
        state, set_out = simulation.state, simulation.bodies.response_time  # s, of the clock
        way = self.observer.view.potential
        free = np.maximum(simulation.entrances.entry_time, set_out) + np.where(np.isfinite(way), way, 0.0)
        entered = np.where(state.active & ~step.inside, free, -np.inf)
        step.coming[:] = simulation.entrances.coming
        idle = (simulation.inside == 0) & (step.coming > 0)
        soonest = np.where(idle, state.time, np.maximum.reduceat(entered, self.env_start[:-1]))
        np.maximum(step.last_exit, soonest, out=step.last_exit)

    def metrics(self, e: int) -> EpisodeMetrics:
        """Return the metrics of the episode of environment ``e`` so far."""
        return metrics_of(e, self.people(e), self._transition.fields, self.simulation)

    def pass_rest(self, e: int) -> None:
        """Skip ahead to the end of a blocked episode in environment ``e``, whose crowd has come to rest: no physics.

        The clock advances to two decisions before the exits count as blocked or the time limit.  Contact impulses are held
        constant.  ``mean_overlap`` is over the simulated steps.
        """
        step, simulation, people = self._transition.fields, self.simulation, self.people(e)
        until = min(step.time_limit[e], step.last_exit[e] + step.blocked_after[e])
        steps = max(int((until - simulation.state.time[e]) / self.decision_dt) - 1, 0)
        simulation.state.time[e] += steps * self.decision_dt
        step.impulse[people] += steps * simulation.results.impulse_magnitude[people]

    def _made_by(self) -> dict[str, Any]:
        return {**super()._made_by(), **self._decides}

    def _keep(self) -> dict[str, Any]:
        in_place = self._transition.fields, self._choice.known.chosen_at, self.observer.view.reached
        return {**super()._keep(), "step": copy_arrays(in_place[0]), "chosen_at": in_place[1], "reached": in_place[2]}

    def _take_back(self, kept: Mapping[str, Any]) -> None:
        write_arrays(self._transition, kept["step"])
        self._choice.known.chosen_at[:], self.observer.view.reached[:] = kept["chosen_at"], kept["reached"]
        super()._take_back({name: kept[name] for name in self._kept})

    def _draw_learned(self, e: int) -> None:
        """Draw the people of environment ``e`` that actions move, by the seed of a list alone."""
        people, word = self.people(e), None if self._seeds is None else self._seeds[e]
        rng = self._generators[e] if word is None else np.random.default_rng((word, MIXED))
        cast(Bools, self.learned)[people] = drawn_share(
            rng, people.stop - people.start, cast(float, self.walking.share)
        )

    def _restart(self, chosen: list[int]) -> None:
        """Begin new episodes in ``chosen`` environments, each with a crowd that its own generator draws."""
        if not chosen:
            return
        room, kinds = room_of(self.simulation.outline), [e % len(self.scenarios) for e in chosen]
        drawn = [
            self.scenarios[kind].population.draw(self._generators[e], self.scenarios[kind].geometry, room)
            for e, kind in zip(chosen, kinds, strict=True)
        ]
        bodies, position = zip(*drawn, strict=True)
        usual = [self._usual_route[kind] for kind in kinds]
        routes = [
            np.zeros(len(stand), int) if known is None else known for stand, known in zip(position, usual, strict=True)
        ]
        entries = self._draw_entries(chosen, kinds, room)
        for stand, come in zip(position, entries or (), strict=False):
            later = ~np.isnan(come.due)
            stand[later] = come.first_spots()[later]
        places = [self.scenarios[kind].geometry for kind in kinds]
        standing, sheet = zip(
            *(place.on_sheets(stand) for place, stand in zip(places, position, strict=True)), strict=True
        )
        for place, come in zip(places, entries or (), strict=False):
            come.spots[:], come.sheet[:] = place.on_sheets(come.spots)
        start: dict[str, Any] = {"route": np.concatenate(routes), "entries": entries, "sheet": np.concatenate(sheet)}
        self.simulation.restart(chosen, join_bodies(bodies), np.concatenate(standing), **start)
        for k in (k for k, known in enumerate(usual) if known is None):
            e, scenario, strategy = chosen[k], self.scenarios[kinds[k]], self.strategies[kinds[k]]
            route_set = self.simulation.planner.route_set(e)  # as the doors stand at the start
            assert route_set is not None
            route = scenario.choose(route_set, strategy, position[k], bodies[k].radius, bodies[k].group)
            self.simulation.send(e, route)
            if not scenario.depends_on_place(strategy):
                self._usual_route[kinds[k]] = route
        for e, kind in zip(chosen, kinds, strict=True):
            names = [route.name for route in self.route_set[kind].routes]
            taken = (
                [names[k] for k in self.simulation.state.route[self.people(e)].tolist()] if self._halts[kind] else []
            )
            if taken and (stays := self.scenarios[kind].draw_stays(self._generators[e], taken)) is not None:
                self.simulation.hold(e, stays[0], self.scenarios[kind].geometry.on_sheets(stays[1])[0])
        begun, transition = np.zeros(self.num_envs, dtype=bool), self._transition
        begun[chosen] = True
        people = begun[self.env_of_person]
        self._choice.known.chosen_at[people], transition.impulse[people] = -np.inf, 0.0
        transition.inside[people], transition.coming[:] = self.active[people], self.simulation.entrances.coming
        self.observer.view.reached[people] = np.inf, 0.0
        transition.step_start[chosen], transition.finished[chosen] = 0.0, False
        if self.walking.share is not None:
            for e in chosen:
                self._draw_learned(e)

    def _draw_entries(self, chosen: list[int], kinds: list[int], room: float) -> list[Entries] | None:
        """Draw the entries of episodes, after all else; None if all are there at the start, everywhere."""
        if not any(scenario.has_arrivals for scenario in self.scenarios):
            return None
        places = [self.scenarios[kind] for kind in kinds]
        return [
            place.population.draw_entries(self._generators[e], place.geometry, room)
            for e, place in zip(chosen, places, strict=True)
        ]

    def _wait_for_the_first(self, chosen: Bools | Ints) -> None:
        """Restart the wait for blocked exits at the time at which the first pedestrian could have got out."""
        first = self.observer.view.potential + self.simulation.bodies.response_time
        first = np.where(np.isfinite(first), first, 0.0)
        if self.simulation.entrances.are_used:
            first = np.where(self.simulation.state.active, first, np.inf)
        soonest = np.minimum.reduceat(first, self.env_start[:-1])
        self._transition.last_exit[chosen] = np.where(np.isfinite(soonest), soonest, 0.0)[chosen]

    def _command(
        self, action: ArrayLike | None, scripted: ArrayLike | None
    ) -> tuple[Floats | None, Bools | None, Bools | None]:
        if action is None:
            return None, None, None
        controlled = self.active & self.learned
        if scripted is not None:
            controlled &= ~array("scripted", scripted, (self.num_people,), "b")
        command, way = to_command(action, self.action_kind, controlled)
        if way is not None:
            self._choice.take(way, controlled, self._transition.state, self.simulation.history.door_open)
        others, in_world = ~controlled, self.action_kind.frame == "world"
        return command, (others if in_world else None), (others if self.walking.acts_on == "scripted" else None)


def require_same_spaces(env: CrowdEnv, before: CrowdEnv) -> None:
    """Raise ValueError if the observation or action space of a pedestrian differs from before."""
    for what in ("single_observation_space", "single_action_space"):
        one, other = getattr(env, what), getattr(before, what)
        if one != other:
            refuse("scenario", env.scenarios[0].name, f"a place in which a person's space stays {other}, not {one}")
