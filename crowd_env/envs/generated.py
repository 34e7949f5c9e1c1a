"""Evacuations side by side, each in a generated place of its own: when one is over, another place takes its turn."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, cast

import numpy as np

from crowd_env.core.arrays.state import Bools
from crowd_env.core.checks import COUNT, Range, number, whole
from crowd_env.envs.crowd import CrowdEnv, Step, require_same_spaces
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.scenarios.generated import Conditions, conditions_of, draw_place
from crowd_env.scenarios.scenario import Scenario

TRIES = 1000  # places drawn until one has few enough people


class _Turn(NamedTuple):
    """What an environment goes on in."""

    room: CrowdEnv
    noise: float
    place: int


class GeneratedCrowds:
    """A batch of places that `crowd_env.scenarios.generated` draws, to train in: a `CrowdEnv` with ``autoreset`` to a learner.

    Each environment has ``people`` slots; those that a place leaves empty are never inside.  An environment that is over goes
    on in another place, under the law and manner of its seed, and with the noise of its seed on everything that is seen.
    What happens to the people of a place is bit by bit what happens in a `CrowdEnv` of that place.  ``info`` of a step holds
    ``finished`` (E,), and where one is, its ``metrics`` and the ``final_observation`` (P, D) before another took its turn.

    Parameters
    ----------
    num_envs : places side by side, E.
    people : slots of each, 10 to 400; places of more people are passed over.
    seeds : of the places that are drawn from, 0 to ``seeds`` - 1.
    beside : places and conditions of one's own, of which one takes its turn with a probability of ``share``.
    level : 0 to 1, see `draw_place`; what is written into the attribute counts from the next place on: a curriculum.
    options : of `CrowdEnv`: routing, action, observation, reward, decision_dt; no term or action counts exits or routes.

    Attributes
    ----------
    layout, action_kind, reward_weights, single_observation_space, single_action_space : as those of a `CrowdEnv`.
    env_of_person : (P,) environment of each slot.
    finished : (E,) which ended in the last step.
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

    def __init__(
        self,
        num_envs: int,
        *,
        people: int = 200,
        seeds: int = 1_000_000,
        level: float = 1.0,
        beside: Sequence[tuple[Scenario, Conditions]] = (),
        share: float = 0.5,
        **options: Any,
    ) -> None:
        self.num_envs, self.slots = whole("num_envs", num_envs, COUNT), whole("people", people, Range(10, 400))
        self.seeds, self.level, self._options = whole("seeds", seeds, COUNT), level, options
        self.env_of_person = np.repeat(np.arange(self.num_envs), self.slots)
        self.finished = np.ones(self.num_envs, dtype=np.bool_)
        self._beside, self._share = tuple(beside), number("share", share, Range(0.0, 1.0))
        self._spare: dict[int, list[CrowdEnv]] = {}  # rooms of places of one's own whose turn is over
        self.place_of_env = [0] * self.num_envs
        self._rng = np.random.default_rng()
        self._rooms: list[CrowdEnv] = []
        self._noise = np.zeros(self.num_envs)
        self._first: CrowdEnv | None = None
        self._first = first = self._next(np.random.default_rng(0)).room
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
        """Who is still inside (P,)."""
        found = np.zeros((self.num_envs, self.slots), dtype=np.bool_)
        for row, room in zip(found, self._rooms, strict=True):
            row[: room.num_people] = room.active
        return found.ravel()

    @property
    def scenario_of_env(self) -> list[Scenario]:
        """The place of each environment."""
        return [room.scenarios[0] for room in self._rooms]

    def people(self, e: int) -> slice:
        """Return the slots of environment ``e``, those that its place leaves empty among them."""
        return slice(e * self.slots, (e + 1) * self.slots)

    def metrics(self, e: int) -> EpisodeMetrics:
        """Return the metrics of the episode of environment ``e`` so far."""
        return self._rooms[e].metrics(0)

    def reset(self, seed: int | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw new places everywhere; a seed says which."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self._rooms = [cast(CrowdEnv, self._first)] * self.num_envs
        observation = np.zeros((self.num_envs, self.slots, self.layout.size), dtype=np.float32)
        for e in range(self.num_envs):
            self._enter(e, observation[e])
        self.finished[:] = False
        return observation.reshape(self.num_people, -1), {}

    def step(self, action: np.ndarray | None = None) -> Step:
        """Advance every place by one decision step; see `CrowdEnv.step`."""
        rows = (self.num_envs, self.slots)
        observation = np.zeros((*rows, self.layout.size), dtype=np.float32)
        reward, flags = np.zeros(rows), np.zeros((2, *rows), dtype=np.bool_)
        info: dict[str, Any] = {"metrics": {}}
        for e, room in enumerate(self._rooms):
            people = slice(0, room.num_people)
            step = room.step(None if action is None else action[self.people(e)][people])
            reward[e, people], flags[0, e, people], flags[1, e, people] = step.reward, step.terminated, step.truncated
            self._look(observation[e], e, step.observation)
            self.finished[e] = room.finished[0]
        info["finished"] = self.finished.copy()
        if self.finished.any():
            info["final_observation"] = observation.reshape(self.num_people, -1).copy()
            for e in np.flatnonzero(self.finished).tolist():
                info["metrics"][e] = self.metrics(e)
                if self.place_of_env[e] < 0:
                    self._spare.setdefault(self.place_of_env[e], []).append(self._rooms[e])
                observation[e] = 0.0
                self._enter(e, observation[e])
        seen = observation.reshape(self.num_people, -1)
        return Step(seen, reward.ravel(), flags[0].ravel(), flags[1].ravel(), info)

    def _enter(self, e: int, rows: np.ndarray) -> None:
        """Let environment ``e`` go on in another place, and write what its people see into its ``rows``."""
        self._rooms[e], self._noise[e], self.place_of_env[e] = self._next(self._rng)
        self._look(rows, e, self._rooms[e].reset(int(self._rng.integers(2**62)))[0])

    def _next(self, rng: np.random.Generator) -> _Turn:
        """Return another place."""
        if self._beside and rng.random() < self._share:
            k = int(rng.integers(len(self._beside)))
            place, conditions = self._beside[k]
            spare = self._spare.get(-1 - k)
            return _Turn(spare.pop() if spare else self._made(place, conditions), conditions.noise, -1 - k)
        for _ in range(TRIES):
            seed = int(rng.integers(self.seeds))
            place = draw_place(seed=seed, level=self.level)
            if place.population.people <= self.slots:
                conditions = conditions_of(seed)
                return _Turn(self._made(place, conditions), conditions.noise, seed)
        raise ValueError(f"of {TRIES} generated places none has at most {self.slots} people; give more of them")

    def _made(self, place: Scenario, conditions: Conditions) -> CrowdEnv:
        """Return an environment of a place."""
        room = CrowdEnv(place, physics=conditions.law, walking=conditions.manner, **self._options)
        require_same_spaces(room, self._first or room)
        return room

    def _look(self, rows: np.ndarray, e: int, observation: np.ndarray) -> None:
        """Write what the people of environment ``e`` see into its rows (slots, D)."""
        seen = rows[: len(observation)]
        seen[:] = observation
        if self._noise[e] > 0.0:
            drawn = self._rng.standard_normal(seen.shape, np.float32)
            seen += (seen != 0.0) * np.float32(self._noise[e]) * drawn
            np.clip(seen, -1.0, 1.0, out=seen)
