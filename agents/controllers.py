"""Controllers for ``crowd_env/Routing-v0`` that need no learning, and how controllers are judged: on the same draws."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from agents.evaluation.evaluation import Evaluation, Led, LedByPolicy, evacuate
from crowd_env import CrowdEnv, ObservationLayout, Scenario, Step
from crowd_env.envs.routing.batch import RoutingBatch

# What people do without a controller, by the strategy of `CrowdEnv`.
STRATEGIES = {"nearest exit": "nearest", "shortest path": "shortest", "fastest path": "fastest"}
SAMPLE = 0.1  # s  between two looks at a crowd


class Controller(Protocol):
    """Says where people go, in every evacuation of a batch at once."""

    @property
    def name(self) -> str:
        """What tables call it."""
        ...

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the actions (E, R + D) for observations (E, D)."""
        ...


class RandomController:
    """Draw every choice uniformly, every time."""

    name = "random"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return random choices."""
        return rng.integers(0, batch.choices, (len(observation), len(batch.choices)))


@dataclass(frozen=True)
class FixedSplit:
    """Send the regions with their center left of ``x`` [m] to the leftmost exit, the others to the rightmost; doors open."""

    x: float

    @property
    def name(self) -> str:
        """What tables call it."""
        return f"split at {self.x:g} m"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the same choices whatever is observed."""
        geometry, routes = batch.scenario.geometry, batch.layout.routes
        middle = geometry.exits.mean(axis=1)[:, 0]
        left, right = (routes.index(geometry.exit_names[k]) for k in (middle.argmin(), middle.argmax()))
        of_region = np.where(batch.regions.center[:, 0] < self.x, left, right)
        row = np.concatenate([of_region, np.ones(len(batch.layout.doors), dtype=np.int64)])
        return np.tile(row, (len(observation), 1))


class WayOut:
    """Everyone walks as a strategy of the environment says.

    Parameters
    ----------
    strategy : see `Scenario.ways`.
    rules : whether the control rules of the scenario are in force.
    """

    def __init__(self, strategy: str, *, rules: bool = False, name: str = "") -> None:
        self.name = name or strategy
        self.env_options: dict[str, Any] = {
            "strategy": strategy,
            "rules": rules,
            "observation": ObservationLayout(terms=("desired_speed",)),  # nobody reads it
        }

    def reset(self, env_mask: np.ndarray) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Leave everyone to the environment."""
        return None


class LedByController:
    """A batch whose people a controller of ``crowd_env/Routing-v0`` sends to exits, sampled between its decisions too.

    A sample is taken every `SAMPLE`, or at every decision where that does not fit into the interval.
    """

    def __init__(self, controller: Controller, batch: RoutingBatch) -> None:
        self.controller, self.batch, self.env = controller, batch, batch.env
        # The batch is made to let a whole interval pass in one step; here a step is a sample.
        fits = _divides(SAMPLE, batch.interval) and _divides(self.env.simulation.dt, SAMPLE)
        self.env.decision_dt = SAMPLE if fits else batch.interval
        self.env.n_substeps = round(self.env.decision_dt / self.env.simulation.dt)
        self._steps = round(batch.interval / self.env.decision_dt)

    def reset(self, seeds: list[int]) -> None:
        """Start new evacuations, each from its seed."""
        self._observation = self.batch.reset(seeds)
        self._rng = np.random.default_rng(seeds[0])
        self._left = np.zeros(self.env.num_people, dtype=np.bool_)
        self._count = 0

    def step(self) -> Step:
        """Tell people where to go if an interval has passed, and let them walk."""
        if self._count % self._steps == 0:
            action = self.controller.act(self._observation, self.batch, self._rng)
            self.batch.send(action)
            self._left[:] = False
        step = self.env.step(None)
        self._count += 1
        self._left |= step.terminated
        if self._count % self._steps == 0:
            self._observation = self.batch.observe(self.env.active, self._left)
        return step


def _divides(part: float, whole: float) -> bool:
    return abs(whole / part - round(whole / part)) < 1e-6 and whole > 0.5 * part


def judge(
    controller: Controller | str,
    scenario: str | Scenario,
    *,
    runs: int,
    first_seed: int,
    progress: Callable[[int], None] | None = None,
    **options: Any,
) -> Evaluation:
    """Run the draws ``first_seed`` ... ``first_seed + runs - 1`` under a controller or a name in ``STRATEGIES``.

    Parameters
    ----------
    progress : called with the number of evacuations that have just ended.
    options : of `crowd_env.envs.routing.env.RoutingEnv`.

    Raises
    ------
    ValueError
        If an option is unknown, out of range, or does not fit the others.
    """
    one = RoutingBatch(scenario, **options)
    place, scheme, dt = one.scenario, one.env.simulation.scheme, one.env.simulation.dt

    def lead(num_envs: int) -> Led:
        if not isinstance(controller, str):
            return LedByController(controller, RoutingBatch(scenario, num_envs=num_envs, **options))
        rules = WayOut(STRATEGIES[controller], rules=bool(options.get("rules", False)))
        options_of_env: dict[str, Any] = {
            "decision_dt": SAMPLE if _divides(dt, SAMPLE) else one.interval,
            "threads": one.env.simulation.threads,
            "time_limit": float(one.env.time_limit[0]),
            **rules.env_options,
        }
        return LedByPolicy(rules, CrowdEnv(place, num_envs=num_envs, scheme=scheme, dt=dt, **options_of_env))

    name = controller if isinstance(controller, str) else controller.name
    return evacuate(lead, place, name, scheme, runs=runs, first_seed=first_seed, progress=progress)
