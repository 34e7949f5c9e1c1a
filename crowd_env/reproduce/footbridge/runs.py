"""Walkers on the deck: at fixed places without contact, added in turn, or a crowd under a contact scheme."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.footbridge.crossing import Footbridge
from crowd_env.envs.footbridge.deck import State, order_parameter
from crowd_env.envs.footbridge.pendulum import Pendulum, advance_pendulum, start_walking
from crowd_env.envs.footbridge.synchrony import Synchrony, advance_synchrony
from crowd_env.envs.footbridge.walkers import DECK, come_round, draw_strides
from crowd_env.physics.simulation.simulation import Simulation

LOST = 0.5  # m, a motion at which the equations no longer hold, and a run ends
_STEP, _BEAT = 0.05, 0.5 / (0.9 * 28)  # s, steps of phases and of pendulums
_EVERY = 1.0  # s between two moments that are kept


class Trace(NamedTuple):
    """What the deck and the steps do, a moment a second; the last axis is the draws, if there are several."""

    time: Floats  # (T,) s
    people: Floats  # (T,) on the deck
    amplitude: Floats  # (T, ...) m
    order: Floats  # (T, ...)
    weight: Floats  # (T,) sum of psi squared

    def late(self) -> tuple[Floats, Floats]:
        """Return amplitude and order, means over the last quarter."""
        last = slice(-max(len(self.time) // 4, 1), None)
        return self.amplitude[last].mean(axis=0), self.order[last].mean(axis=0)


def half_sine(people: int) -> Floats:
    """Return psi (people,) of an evenly filled deck."""
    return np.sin(np.pi * (np.arange(people) + 0.5) / people)


def stay(psi: Floats, seeds: Sequence[int], duration: float) -> Trace:
    """Let walkers with ``psi`` (N,) walk on the spot without contact, in a draw a seed."""
    rngs = [np.random.default_rng(seed) for seed in seeds]
    omega = np.array([draw_strides(rng, psi.shape) for rng in rngs])
    turns = np.exp(2j * np.pi * np.array([rng.random(len(psi)) for rng in rngs]))
    zero, steps = np.zeros(len(rngs)), round(_EVERY / _STEP)
    state: State = (zero, zero, turns)
    coupling, moments = Synchrony(), []
    for _ in range(round(duration / _EVERY)):
        state = advance_synchrony(DECK, coupling, omega, psi, state, _STEP, steps)
        moments.append((DECK.amplitude(*state[:2]), order_parameter(np.angle(state[2]))))
    return _trace([(len(psi), *moment, float((psi**2).sum())) for moment in moments])


def step_up(coupling: Synchrony | Pendulum, numbers: Sequence[int], hold: float, seed: int) -> Trace:
    """Let the numbers of walkers at mid-span follow each other, each for ``hold`` [s]; a motion beyond `LOST` ends it."""
    rng, most = np.random.default_rng(seed), max(numbers)
    zero = np.zeros(())
    state: State
    if isinstance(coupling, Synchrony):
        omega = draw_strides(rng, (most,))
        state = (zero, zero, np.exp(2j * np.pi * rng.random(most)))

        def on(psi: Floats) -> State:
            return advance_synchrony(DECK, coupling, omega, psi, state, _STEP, round(_EVERY / _STEP))
    else:
        walkers, state = start_walking(coupling, np.full(most, coupling.frequency), _BEAT, rng)

        def on(psi: Floats) -> State:
            return advance_pendulum(DECK, coupling, walkers, psi, state, _BEAT, round(_EVERY / _BEAT))

    moments = []
    for people in numbers:
        psi = (np.arange(most) < people).astype(np.float64)
        for _ in range(round(hold / _EVERY)):
            state = on(psi)
            phase = np.angle(state[2]) if isinstance(coupling, Synchrony) else walkers.phase()
            moments.append((people, DECK.amplitude(*state[:2]), order_parameter(phase, psi), people))
            if moments[-1][1] > LOST:
                return _trace(moments)
    return _trace(moments)


def walk(
    simulation: Simulation,
    coupling: str | Synchrony | Pendulum,
    duration: float,
    seed: int,
    look: Callable[[Footbridge], object] = lambda bridge: None,
) -> Trace:
    """Let a crowd walk round and round over the deck; ``look`` is called after every 0.1 s."""
    bridge, substeps = Footbridge(simulation, coupling, seed=seed), round(0.1 / simulation.dt)
    moments = []
    for k in range(round(10 * duration)):
        bridge.advance(n_substeps=substeps, world=True)
        come_round(simulation, DECK.length, DECK.length)
        look(bridge)
        if k % 10 == 9:
            psi = bridge.psi
            moments.append(((psi > 0.0).sum(), bridge.amplitude, bridge.order, float((psi**2).sum())))
            if bridge.amplitude > LOST:
                break
    return _trace(moments)


def _trace(moments: Sequence[tuple[object, ...]]) -> Trace:
    people, amplitude, order, weight = (np.array(column, dtype=np.float64) for column in zip(*moments, strict=True))
    return Trace(_EVERY * np.arange(1.0, len(moments) + 1.0), people, amplitude, order, weight)


def onset(people: Sequence[float], amplitude: Sequence[float], large: float) -> float | None:
    """Return the number of people at which the amplitude passes ``large`` [m] for good, a straight line in between.

    None if it never does, or always is.
    """
    over = np.asarray(amplitude) >= large
    if over.all() or not over[-1]:
        return None
    k = int(np.flatnonzero(~over)[-1])
    share = (large - amplitude[k]) / (amplitude[k + 1] - amplitude[k])
    return float(people[k] + share * (people[k + 1] - people[k]))
