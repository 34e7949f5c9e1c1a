"""A crowd of the contact schemes on a deck that sways: bodies and deck are advanced in turn.

Between two calls pedestrians stand where the crowd has left them: psi is constant over a call of 0.1 s, in which a walker
moves by a thousandth of the deck.  The deck acts on the crowd through the step frequency alone: faster steps mean faster
walking, by `crowd_env.envs.footbridge.gait`.  Under ``off`` and ``pendulum`` no bit of the crowd changes.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import known, refuse, whole
from crowd_env.envs.footbridge.deck import Deck, State, order_parameter
from crowd_env.envs.footbridge.gait import stride_rate, walking_speed
from crowd_env.envs.footbridge.pendulum import Pendulum, advance_pendulum, start_walking
from crowd_env.envs.footbridge.synchrony import Synchrony, advance_synchrony
from crowd_env.envs.restorable import Restorable
from crowd_env.physics.simulation.simulation import Simulation

# Name -> how walkers and deck act on each other, with the numbers of its file.
COUPLINGS: Mapping[str, Synchrony | Pendulum | None] = {"synchrony": Synchrony(), "pendulum": Pendulum(), "off": None}

_LONGEST = 0.05  # s, a step of the phases, at most: a third of a radian
_PENDULUM = 0.02  # s, the step of pendulums, of which a call is a multiple
_STABLE = 2.0  # times the step: a rate above 2.8 over it grows without limit
_CALL = 0.4  # s, of one call at most: a longer one could not resolve the rate of a phase


class Footbridge(Restorable):
    """One crowd on one deck; the x axis runs along the deck from its first support.

    Parameters
    ----------
    simulation : of one environment; active pedestrians on the deck count.
    coupling : a name in `COUPLINGS`, a `Synchrony`, a `Pendulum`, or None.
    deck : the deck.
    seed : of the phases at the start, which are even around the circle.

    Raises
    ------
    ValueError
        If the simulation holds several environments, the coupling is unknown, or deck or pendulums move too fast for steps.
    """

    _behind = "simulation"
    _kept = ("omega", "_state", "_pace", "_walkers")

    def __init__(
        self,
        simulation: Simulation,
        coupling: str | Synchrony | Pendulum | None = "synchrony",
        *,
        deck: Deck | None = None,
        seed: int = 0,
    ) -> None:
        if len(simulation.state.time) != 1:
            raise ValueError(f"the simulation holds {len(simulation.state.time)} environments; a footbridge takes one")
        self.simulation, self.coupling = simulation, coupling_of(coupling)
        coupling, self.deck = self.coupling, Deck() if deck is None else deck
        _check_rates(self.deck, coupling)
        self._agree()
        self.omega = stride_rate(simulation.bodies.desired_speed)
        rng = np.random.default_rng(seed)
        zero, people = np.zeros(()), len(self.omega)
        turns = np.exp(2j * np.pi * rng.random(people))
        self._state: State = (zero, zero, turns)
        self._pace = np.ones(people)
        self._walkers: Any = None  # of pendulums
        if isinstance(coupling, Pendulum):
            strides = np.full(people, coupling.frequency)
            self._walkers, self._state = start_walking(coupling, strides, _PENDULUM, rng)

    @property
    def psi(self) -> Floats:
        """Share of the motion that each pedestrian feels (P,); 0 off the deck."""
        state = self.simulation.state
        return self.deck.shape(state.position[:, 0]) * state.active

    @property
    def amplitude(self) -> float:
        """A [m]."""
        return float(self.deck.amplitude(*self._state[:2]))

    @property
    def phase(self) -> float:
        """Psi [rad]."""
        return float(self.deck.phase(*self._state[:2]))

    @property
    def displacement(self) -> float:
        """X [m], that of mid-span."""
        return float(self._state[0])

    @property
    def walkers_phase(self) -> Floats:
        """Phase of each pedestrian's stride (P,) [rad]."""
        if isinstance(self.coupling, Pendulum):
            return self._walkers.phase()
        return np.angle(self._state[2])

    @property
    def order(self) -> float:
        """R of the pedestrians on the deck."""
        return float(order_parameter(self.walkers_phase, self.psi > 0.0))

    def _made_by(self) -> dict[str, Any]:
        return {**super()._made_by(), "coupling": self.coupling, "deck": self.deck}

    def advance(self, command: Floats | None = None, *, n_substeps: int = 10, world: bool = False) -> None:
        """Advance crowd and deck by ``n_substeps`` physics steps.

        Parameters
        ----------
        command : (P, 2), as in `Simulation.advance`: multiples of the desired speed, to which the pace of steps is added;
            0 stops a pedestrian.
        world : the command has the axes of the world.

        Raises
        ------
        ValueError
            If that is longer than 0.4 s or, with pendulums, no multiple of 0.02 s; or if the simulation was restored alone.
        FloatingPointError
            If the motion of the deck is not finite any more.
        """
        n_substeps = whole("n_substeps", n_substeps)
        self._check_whole()
        duration, people = n_substeps * self.simulation.dt, len(self.omega)
        divides = not isinstance(self.coupling, Pendulum) or abs(duration / _PENDULUM % 1.0 - 0.5) > 0.5 - 1e-6
        if duration > _CALL or not divides:
            raise ValueError(f"n_substeps: {duration:g} s; at most {_CALL:g} s, pendulums multiples of {_PENDULUM:g} s")
        relative = np.full(people, not world)
        if isinstance(self.coupling, Synchrony):
            asked = np.tile([1.0, 0.0], (people, 1)) if command is None else np.asarray(command, dtype=np.float64)
            command = asked * self._pace[:, None]
        self.simulation.advance(command, relative=relative, n_substeps=n_substeps)
        self._sway(duration)

    def _sway(self, duration: float) -> None:
        coupling, psi = self.coupling, self.psi
        if isinstance(coupling, Synchrony):
            steps = int(np.ceil(duration / _LONGEST - 1e-9))
            before = self._state[2]
            self._state = advance_synchrony(self.deck, coupling, self.omega, psi, self._state, duration / steps, steps)
            rate = np.angle(self._state[2] * before.conj()) / duration
            speed = self.simulation.bodies.desired_speed
            self._pace = np.where(speed > 0.0, walking_speed(rate / np.pi) / np.where(speed > 0.0, speed, 1.0), 1.0)
        elif isinstance(coupling, Pendulum):
            steps = round(duration / _PENDULUM)
            self._state = advance_pendulum(self.deck, coupling, self._walkers, psi, self._state, _PENDULUM, steps)
        if not np.isfinite([self._state[0], *self._pace]).all():
            raise FloatingPointError(
                "the motion of the deck is not finite any more; take a heavier or less damped deck"
            )


def coupling_of(coupling: Any) -> Synchrony | Pendulum | None:
    """Return a coupling, given as such, by a name in `COUPLINGS`, or as None.

    Raises
    ------
    ValueError
        If it is unknown, or of another type.
    """
    if isinstance(coupling, str):
        return COUPLINGS[known("coupling", coupling, COUPLINGS)]
    if coupling is not None and not isinstance(coupling, Synchrony | Pendulum):
        refuse("coupling", coupling, f"None, a Synchrony, a Pendulum, or one of {', '.join(COUPLINGS)}")
    return coupling


def _check_rates(deck: Deck, coupling: Synchrony | Pendulum | None) -> None:
    """Raise ValueError if the method of Runge and Kutta would not be stable at its step."""
    step = _PENDULUM if isinstance(coupling, Pendulum) else _LONGEST
    rates = {"frequency": deck.frequency, "damping over mass": deck.damping / deck.mass}
    for name, rate in rates.items():
        if coupling is not None and rate * step > _STABLE:
            raise ValueError(
                f"deck: its {name} is {rate:g} 1/s; steps of {step:g} s allow at most {_STABLE / step:g} 1/s"
            )
