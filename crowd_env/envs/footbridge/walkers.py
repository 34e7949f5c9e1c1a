"""A crowd that walks along the deck at the speed of its strides, and returns to the start at the end."""

from dataclasses import replace

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, make_bodies, make_state
from crowd_env.envs.footbridge.deck import Deck
from crowd_env.envs.footbridge.gait import walking_speed
from crowd_env.envs.footbridge.synchrony import SPREAD
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.geometry.placement import sample_positions
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation

DECK, WIDTH = Deck(), 4.0  # m
_FASTEST = 3.0  # standard deviations of the stride at which the draw is cut off
_DRIVE = 300.0  # N
_BEHIND = 6.0  # m of floor behind the deck


def draw_strides(rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
    """Return angular frequencies [rad/s] of strides: normal about that of the deck."""
    far = rng.normal(0.0, 1.0, shape)
    while (out := np.abs(far) > _FASTEST).any():
        far[out] = rng.normal(0.0, 1.0, int(out.sum()))
    return DECK.frequency + SPREAD * far


def crowd(people: int, physics: Physics, seed: int, *, before: float = 1.0, region: str | None = "deck") -> Simulation:
    """Return a population in a region, None = everywhere, that walks along the deck and keeps a distance.

    ``before`` [m] is the length of floor in front of the deck.
    """
    rng = np.random.default_rng(seed)
    place = Geometry.from_polygon(
        box(-before, 0.0, DECK.length + _BEHIND, WIDTH), regions={"deck": box(0.0, 0.0, DECK.length, WIDTH)}
    )
    bodies = make_bodies(
        rng.uniform(0.15, 0.19, people),
        rng.uniform(60.0, 100.0, people),
        desired_speed=walking_speed(draw_strides(rng, (people,)) / np.pi),
        relaxation_time=rng.uniform(0.1, 0.5, people),
    )
    start = make_state(sample_positions(place, bodies.radius, rng, region))
    if physics.law.drives and physics.max_drive is None:
        physics = replace(physics, max_drive=_DRIVE)
    return Simulation(place, bodies, start, physics=physics, walking="hurried")


def come_round(simulation: Simulation, end: float, back: float) -> Bools:
    """Move pedestrians beyond ``end`` [m] ``back`` [m] where there is room, so that their number stays; return which (P,).

    It is for places without an exit that reach beyond both ends, with pedestrians that walk along x.
    """
    position, radius = simulation.state.position, simulation.bodies.radius
    moved = np.zeros(len(radius), dtype=bool)
    for k in np.flatnonzero(position[:, 0] >= end):
        there = position[k] - (back, 0.0)
        gap = np.hypot(*(position - there).T) - radius - radius[k]
        gap[k] = np.inf
        if gap.min() >= 0.0:
            position[k], moved[k] = there, True
    return moved
