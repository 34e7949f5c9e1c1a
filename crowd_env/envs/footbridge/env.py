"""Gymnasium: a gatekeeper of a footbridge that sways, ``crowd_env/footbridge-gate-v0``."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium
import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import COUNT, NOT_NEGATIVE, POSITIVE, Range, number, whole
from crowd_env.envs.arguments import check_options, parts_of
from crowd_env.envs.controlled import Row
from crowd_env.envs.crowd import Reset
from crowd_env.envs.footbridge.crossing import Footbridge, coupling_of
from crowd_env.envs.footbridge.pendulum import Pendulum
from crowd_env.envs.footbridge.synchrony import Synchrony
from crowd_env.envs.footbridge.walkers import DECK, come_round, crowd
from crowd_env.envs.restorable import EnvCheckpoint, Restorable
from crowd_env.envs.settings import answers_unknown
from crowd_env.envs.terms import Layout
from crowd_env.physics.settings import AsPhysics, Physics

# m/s2: accelerations to the side up to the first are comfortable, beyond the second they are not to be borne (HIVOSS
# guideline, from memory; the table 7.2 of CSA S7, seen in a program, has the same two).
COMFORT = 0.1, 0.8
_PHYSICS = Physics("dem", dt=0.01)
_APPROACH = 60.0  # m of floor before the deck, where pedestrians wait
_GATE = 1.0  # m before the deck, where the gate stands
_CALL = 0.1  # s between two exchanges of bodies and deck
_QUEUE = 0.3  # m/s, below which a pedestrian before the deck counts as waiting
_SWAY, _LOAD = 0.015, 150.0  # m and people that are observed as 1/2


class DeckLayout(Layout):
    """Where the terms of an observation are: ``layout["phase"]`` is a slice of columns; all values lie in [-1, 1]."""

    WIDTHS: ClassVar[Mapping[str, int]] = {
        "amplitude": 1,  # A of the deck, as A / (A + 15 mm)
        "phase": 2,  # sine and cosine of Psi
        "people": 1,  # on the deck / all
        "load": 1,  # sum of psi squared, n as n / (n + 150)
        "queue": 1,  # pedestrians waiting before the deck / all
        "open": 1,  # 1 = people were let through last
    }

    def _widths(self) -> dict[str, int]:
        return dict(self.WIDTHS)


class FootbridgeEnv(Restorable, gymnasium.Env):
    """A crowd that crosses the north span of the London Millennium Bridge again and again, and a gatekeeper.

    It is the task ``footbridge``: the most crossings with the least sway.

    Observation
        (7,) float32, see `DeckLayout`.
    Action
        1 lets pedestrians onto the deck, 0 stops them at its entrance; pedestrians on the deck walk on.
    Reward
        ``throughput`` + ``weight`` ``discomfort``, each in ``info["reward/<name>"]``.  ``throughput`` counts arrivals at the
        far end.  ``discomfort`` is minus the time of each pedestrian on the deck [s], times the local acceleration
        psi A omega_0^2, scaled to 0 at the first and 1 at the second value of `COMFORT`; it may exceed 1.
    Termination
        Truncated at the time limit.

    Parameters
    ----------
    people : number of pedestrians; arrivals at the far end rejoin the back of the queue.
    coupling : as `Footbridge` takes it.
    physics : as `CrowdEnv` takes it; its step is a part of 0.1 s, and people drive with 300 N at most if it does not say so.
    interval : s between decisions, a multiple of 0.1 s.
    weight : 1/s, of discomfort: with 0.02 a crossing of 50 s at the limit of the intolerable is worth nothing.
    time_limit : s.
    render_mode : None: a footbridge is not drawn.

    Raises
    ------
    ValueError
        If one of them is unknown or out of range, or the people do not fit.
    """

    metadata = {"render_modes": []}
    _behind = "bridge"
    _kept = ("_np_random", "_np_random_seed")

    @answers_unknown()
    def __init__(
        self,
        people: int = 700,
        *,
        coupling: str | Synchrony | Pendulum | None = "synchrony",
        physics: AsPhysics = _PHYSICS,
        interval: float = 1.0,
        weight: float = 0.02,
        time_limit: float = 400.0,
        render_mode: None = None,
    ) -> None:
        if render_mode is not None:
            raise ValueError(f"unknown render_mode {render_mode!r}; known: None: a footbridge is not drawn")
        self.people, self.coupling, physics = whole("people", people, COUNT), coupling_of(coupling), Physics.of(physics)
        self.bridge: Any = None
        self.dt, self.layout = physics.dt or physics.law.info.default_dt, DeckLayout()
        self.physics = replace(physics, dt=self.dt)
        self.weight = number("weight", weight, NOT_NEGATIVE, "1/s")
        self.time_limit = number("time_limit", time_limit, POSITIVE, "s")
        self._substeps = parts_of("a call", _CALL, "physics steps of dt", self.dt)
        self._calls = parts_of("interval", number("interval", interval, POSITIVE, "s"), "calls of", _CALL)
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)
        self.action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Reset:
        """Start with a deck at rest and people everywhere; the same seed gives the same people."""
        check_options(options)
        super().reset(seed=seed)
        draw = int(self.np_random.integers(2**31)) if seed is None else seed
        simulation = crowd(self.people, self.physics, draw, before=_APPROACH, region=None)
        self.bridge = Footbridge(simulation, self.coupling, seed=draw)
        self._agree()
        return self._observe(opened=True), {"amplitude": 0.0}

    def step(self, action: Any) -> Row:
        """Let ``interval`` seconds pass.

        Raises
        ------
        ValueError
            If the action is neither 0 nor 1, or before the first `reset`.
        """
        self._check_whole()
        opened, bridge = bool(whole("the action", action, Range(0, 1))), self.bridge
        state, passed, discomfort = bridge.simulation.state, 0, 0.0
        for _ in range(self._calls):
            x = state.position[:, 0].copy()
            command = np.tile([1.0, 0.0], (self.people, 1))
            at_gate = (x >= -_GATE) & (x < 0.0)
            command[at_gate & (not opened)] = 0.0
            bridge.advance(command, n_substeps=self._substeps, world=True)
            passed += int(((x < DECK.length) & (state.position[:, 0] >= DECK.length)).sum())
            come_round(bridge.simulation, DECK.length, DECK.length + _APPROACH)
            discomfort += _CALL * float(self._discomfort(bridge.psi).sum())
        info = {"reward/throughput": float(passed), "reward/discomfort": -discomfort, "amplitude": bridge.amplitude}
        over = bool(state.time[0] > self.time_limit - 0.5 * self.dt)
        return self._observe(opened), passed - self.weight * discomfort, False, over, info

    def restore(self, checkpoint: EnvCheckpoint) -> None:
        """Restore a checkpoint, as `Restorable.restore` does."""
        if self.bridge is None:
            self.reset()  # it then has a deck
        super().restore(checkpoint)

    def _made_by(self) -> dict[str, Any]:
        return {**super()._made_by(), "interval": self._calls, "weight": self.weight, "time_limit": self.time_limit}

    def _check_whole(self) -> None:
        if self.bridge is None:
            raise ValueError("call reset before the first step")
        super()._check_whole()

    def _discomfort(self, psi: Floats) -> Floats:
        low, high = COMFORT
        return np.maximum(psi * self.bridge.amplitude * self.bridge.deck.frequency**2 - low, 0.0) / (high - low)

    def _observe(self, opened: bool) -> np.ndarray:
        bridge, psi = self.bridge, self.bridge.psi
        state, load = bridge.simulation.state, float((psi**2).sum())
        waits = (state.position[:, 0] < 0.0) & (np.hypot(*state.velocity.T) < _QUEUE)
        swaying = bridge.amplitude / (bridge.amplitude + _SWAY)
        found = [swaying, np.sin(bridge.phase), np.cos(bridge.phase), (psi > 0.0).mean(), load / (load + _LOAD)]
        return np.array([*found, waits.mean(), opened], dtype=np.float32)
