"""Evacuations side by side, each in a generated place of its own: when one is over, another place takes its turn."""

from collections import deque
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Ints
from crowd_env.core.checks import COUNT, Range, number, whole
from crowd_env.envs.crowd import CrowdEnv, Reset, Step, require_same_spaces
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.restorable import Restorable
from crowd_env.envs.settings import Routing, physics_step
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import Physics
from crowd_env.scenarios.generated import Conditions, conditions_of, draw_place
from crowd_env.scenarios.scenario import Scenario

_OPTIONS = ("routing", "action", "observation", "reward", "decision_dt")  # of `CrowdEnv`
TRIES = 1000  # places drawn until one has few enough people


class _Drawn(NamedTuple):
    """A place whose turn comes."""

    place: Scenario
    conditions: Conditions
    number: int  # seed of a generated place, -1 - k of a place of one's own


class _Turn(NamedTuple):
    """What an environment goes on in: one environment of a batch of places that share law and manner."""

    crowd: CrowdEnv
    e: int  # in the crowd
    noise: float
    late: int  # decisions until one takes effect
    number: int

    @property
    def slots(self) -> slice:
        """Slots in the crowd."""
        return self.crowd.people(self.e)


class _Part(NamedTuple):
    """A batch and which of its environments are under way."""

    crowd: CrowdEnv
    here: Ints  # slots of `GeneratedCrowds` that are taken
    there: Ints  # the same people in the crowd
    environments: list[tuple[int, int]]  # of `GeneratedCrowds`, and of the crowd


class GeneratedCrowds(Restorable):
    """A batch of places that `crowd_env.scenarios.generated` draws, to train in: a `CrowdEnv` with ``autoreset`` to a learner.

    Each environment has ``people`` slots; those that a place leaves empty are never inside.  An environment that is over goes
    on in another place, under the law and manner of its seed, with the noise of its seed on everything that is seen, and with
    its delay of actions; before the first one takes effect people follow the rule.  Places of one law and one manner share a
    `CrowdEnv` and step in one compiled call.  They are drawn ahead, as many as environments at once, so that each is built
    once.  What happens to the people of a place is bit by bit what happens in a `CrowdEnv` of that place.  ``info`` of a step
    holds ``reward/<name>`` (P,), ``finished`` (E,), and where one is, its ``metrics`` and the ``final_observation`` (P, D)
    before another took its turn.

    Parameters
    ----------
    num_envs : places side by side, E.
    people : slots of each, 10 to 400; places of more people are passed over.
    seeds : of the places that are drawn from, 0 to ``seeds`` - 1.
    beside : places and conditions of one's own, of which one takes its turn with a probability of ``share``.
    threads : of each compiled call; results do not depend on it.
    options : of `CrowdEnv`: routing, action, observation, reward, decision_dt; no term or action counts exits or routes.

    Attributes
    ----------
    layout, action_kind, reward_weights, single_observation_space, single_action_space : as those of a `CrowdEnv`.
    env_of_person : (P,) environment of each slot.
    place_of_env : what each environment holds: the seed of a generated place, -1 - k of ``beside[k]``.

    Raises
    ------
    ValueError
        If an argument is out of range, no place has so few people, or what one sees or does is not everywhere of the same size.

    Examples
    --------
    >>> env = GeneratedCrowds(4, people=40, seeds=1000, routing="fastest")
    >>> observation, info = env.reset(seed=0)
    >>> env.step(None).reward.shape   # everyone at full speed
    (160,)
    """

    decides: Literal["walking"] = "walking"
    autoreset = True
    learned = True  # all are moved by actions
    action_mask = None  # none chooses an exit
    _behind = "_first"
    _kept = ("_rng", "_ahead", "_turns", "_parts", "_decided", "finished")  # whole places: they come and go

    def __init__(
        self,
        num_envs: int,
        *,
        people: int = 200,
        seeds: int = 1_000_000,
        beside: Sequence[tuple[Scenario, Conditions]] = (),
        share: float = 0.5,
        threads: int = 1,
        **options: Any,
    ) -> None:
        self.num_envs, self.slots = whole("num_envs", num_envs, COUNT), whole("people", people, Range(10, 400))
        self.seeds, self._threads, self._options = whole("seeds", seeds, COUNT), threads, options
        self.env_of_person = np.repeat(np.arange(self.num_envs), self.slots)
        self.finished = np.ones(self.num_envs, dtype=np.bool_)  # until the first reset
        self._beside, self._share = tuple(beside), number("share", share, Range(0.0, 1.0))
        for name in options:
            if name not in _OPTIONS:
                raise TypeError(f"GeneratedCrowds has no argument {name!r}; of CrowdEnv it takes {', '.join(_OPTIONS)}")
        self._spare: dict[int, list[_Turn]] = {}  # of places of one's own whose turn is over
        self._rng = np.random.default_rng()
        self._ahead: deque[_Turn] = deque()
        self._turns: list[_Turn] = []
        self._parts: list[_Part] = []
        self._decided: list[list[np.ndarray]] = [[] for _ in range(self.num_envs)]  # actions before their effect
        self._first: CrowdEnv | None = None
        self._first = first = self._built([self._draw(np.random.default_rng(0))])[0].crowd
        if first.action_kind.routes is not None or first.layout.tells_of_routes:
            raise ValueError(
                "generated places have different numbers of exits; no action or observation may count them"
            )
        self.layout, self.action_kind, self.reward_weights = first.layout, first.action_kind, first.reward_weights
        self.single_observation_space = first.single_observation_space
        self.single_action_space = first.single_action_space
        self.decision_dt = first.decision_dt

    @property
    def num_people(self) -> int:
        """Number of slots P."""
        return self.num_envs * self.slots

    @property
    def active(self) -> Bools:
        """Pedestrians who are still inside (P,)."""
        found = np.zeros(self.num_people, dtype=np.bool_)
        for part in self._parts:
            found[part.here] = part.crowd.active[part.there]
        return found

    @property
    def scenario_of_env(self) -> list[Scenario]:
        """The place of each environment."""
        return [turn.crowd.scenario_of_env[turn.e] for turn in self._turns]

    @property
    def place_of_env(self) -> list[int]:
        """The number of the place of each environment."""
        return [turn.number for turn in self._turns]

    def people(self, e: int) -> slice:
        """Return the slots of environment ``e``, those that its place leaves empty among them."""
        return slice(e * self.slots, (e + 1) * self.slots)

    def metrics(self, e: int) -> EpisodeMetrics:
        """Return the metrics of the episode of environment ``e`` so far."""
        return self._turns[e].crowd.metrics(self._turns[e].e)

    def reset(self, seed: int | None = None) -> Reset:
        """Draw new places everywhere; a seed says which."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self._ahead.clear()
        self._turns = [self._next() for _ in range(self.num_envs)]
        self._agree()
        observation = np.zeros((self.num_people, self.layout.size), dtype=np.float32)
        self._enter(range(self.num_envs), observation)
        self.finished[:] = False
        return observation, {}

    def step(self, action: np.ndarray | None = None) -> Step:
        """Advance every place by one decision step; see `CrowdEnv.step`."""
        if not self._turns:
            raise ValueError("call reset before the first step")
        self._check_whole()
        observation = np.zeros((self.num_people, self.layout.size), dtype=np.float32)
        reward, flags = np.zeros(self.num_people), np.zeros((2, self.num_people), dtype=np.bool_)
        finished, metrics = np.zeros(self.num_envs, dtype=np.bool_), dict[int, EpisodeMetrics]()
        terms: dict[str, Any] = {}
        action = None if action is None else self._delayed(action)
        for crowd, here, there, environments in self._parts:
            acts = None
            if action is not None:
                acts = np.zeros((crowd.num_people, *action.shape[1:]), dtype=action.dtype)
                acts[there] = action[here]
            step = crowd.step(acts)
            observation[here], reward[here] = step.observation[there], step.reward[there]
            flags[0, here], flags[1, here] = step.terminated[there], step.truncated[there]
            for name in (name for name in step.info if name.startswith("reward/")):
                terms.setdefault(name, np.zeros(self.num_people))[here] = step.info[name][there]
            for e, k in environments:
                if step.info["finished"][k]:
                    finished[e], metrics[e] = True, step.info["metrics"][k]
        self._disturb(range(self.num_envs), observation)
        info: dict[str, Any] = {**terms, "metrics": dict(sorted(metrics.items())), "finished": finished}
        if finished.any():
            info["final_observation"] = observation.copy()
            over = np.flatnonzero(finished).tolist()
            for e in over:
                if self._turns[e].number < 0:
                    self._spare.setdefault(self._turns[e].number, []).append(self._turns[e])
                observation[self.people(e)] = 0.0
                self._turns[e] = self._next()
            self._enter(over, observation)
        return Step(observation, reward, flags[0], flags[1], info)

    @property
    def times_restored(self) -> int:
        """How often a place alone went back to a moment."""
        crowds = {id(crowd): crowd for crowd in (self._first, *(turn.crowd for turn in self._turns))}
        return sum(crowd.times_restored for crowd in crowds.values() if crowd is not None)

    def _made_by(self) -> dict[str, Any]:
        drawn: dict[str, Any] = {"people": self.slots, "seeds": self.seeds, "share": self._share}
        drawn |= {"beside": [(place.name, conditions) for place, conditions in self._beside]}
        others = {"routing": Routing.of(self._options.get("routing")), "observation": self.layout}
        return {**super()._made_by(), "num_envs": self.num_envs, **drawn, **others}

    def _enter(self, environments: Sequence[int], observation: np.ndarray) -> None:
        """Begin the turns of some environments, and write what their people see into their rows of all (P, D)."""
        seeds = {e: int(self._rng.integers(2**62)) for e in environments}
        under_way: dict[int, list[int]] = {}
        for e, turn in enumerate(self._turns):
            under_way.setdefault(id(turn.crowd), []).append(e)
        self._parts = [self._part(those) for those in under_way.values()]
        for part in self._parts:
            fresh = [(e, k) for e, k in part.environments if e in seeds]
            if not fresh:
                continue
            of_crowd, mask = [0] * part.crowd.num_envs, np.zeros(part.crowd.num_envs, dtype=np.bool_)
            for e, k in fresh:
                of_crowd[k], mask[k] = seeds[e], True
            seen, _ = part.crowd.reset(of_crowd, mask)
            chosen = mask[part.crowd.env_of_person[part.there]]
            observation[part.here[chosen]] = seen[part.there[chosen]]
        self._disturb(environments, observation)
        rule = np.asarray(self.action_kind.neutral)
        for e in environments:
            self._decided[e] = [np.broadcast_to(rule, (self.slots, *rule.shape))] * self._turns[e].late

    def _delayed(self, action: np.ndarray) -> np.ndarray:
        """Return the actions that take effect now."""
        action = action.copy()
        for e, decided in enumerate(self._decided):
            if decided:
                decided.append(action[self.people(e)].copy())
                action[self.people(e)] = decided.pop(0)
        return action

    def _part(self, environments: Sequence[int]) -> _Part:
        """Return the part that some environments make, whose turns are in one crowd."""
        turns = [self._turns[e] for e in environments]
        there = [np.arange(turn.slots.start, turn.slots.stop) for turn in turns]
        here = [e * self.slots + np.arange(len(those)) for e, those in zip(environments, there, strict=True)]
        pairs = [(e, turn.e) for e, turn in zip(environments, turns, strict=True)]
        return _Part(turns[0].crowd, np.concatenate(here), np.concatenate(there), pairs)

    def _next(self) -> _Turn:
        """Return the next turn; where none is left, as many places as environments are drawn and built."""
        if not self._ahead:
            self._ahead.extend(self._built([self._draw(self._rng) for _ in range(self.num_envs)]))
        return self._ahead.popleft()

    def _draw(self, rng: np.random.Generator) -> _Drawn:
        """Return another place."""
        if self._beside and rng.random() < self._share:
            k = int(rng.integers(len(self._beside)))
            return _Drawn(*self._beside[k], -1 - k)
        for _ in range(TRIES):
            seed = int(rng.integers(self.seeds))
            place = draw_place(seed=seed)
            if place.population.people <= self.slots:
                return _Drawn(place, conditions_of(seed), seed)
        raise ValueError(f"of {TRIES} generated places none has at most {self.slots} people; give more of them")

    def _built(self, drawn: Sequence[_Drawn]) -> list[_Turn]:
        """Return the turns of places, in their order: those that one simulation can hold share a crowd."""
        turns: dict[int, _Turn] = {}
        together: dict[tuple[str, str, float, str], list[int]] = {}
        for k, (place, (law, manner, *_), which) in enumerate(drawn):
            if spare := self._spare.get(which):
                turns[k] = spare.pop()
                continue
            dt = physics_step(Physics(law), place, within=self._options.get("decision_dt", DECISION_DT))
            of_place = repr((place.outline, place.max_drive, place.balance))
            together.setdefault((law, manner, dt, of_place), []).append(k)
        for (law, manner, dt, _), those in together.items():
            crowd = CrowdEnv(
                [drawn[k].place for k in those],
                num_envs=len(those),
                physics=Physics(law, dt=dt, threads=self._threads),
                walking=manner,
                **self._options,
            )
            require_same_spaces(crowd, self._first or crowd)
            for e, k in enumerate(those):
                conditions, late = drawn[k].conditions, round(drawn[k].conditions.delay / crowd.decision_dt)
                turns[k] = _Turn(crowd, e, conditions.noise, late, drawn[k].number)
        return [turns[k] for k in range(len(drawn))]

    def _disturb(self, environments: Sequence[int], observation: np.ndarray) -> None:
        """Add the noise of the places of some environments to what is seen there."""
        for e in environments:
            turn = self._turns[e]
            if turn.noise > 0.0:
                people = turn.slots.stop - turn.slots.start
                seen = observation[e * self.slots : e * self.slots + people]
                drawn = self._rng.standard_normal(seen.shape, np.float32)
                seen += (seen != 0.0) * np.float32(turn.noise) * drawn
                np.clip(seen, -1.0, 1.0, out=seen)
