"""Simulations from flat words: which of them belong to the physics, and which to the walking."""

from dataclasses import fields

from crowd_env import Physics, Simulation, Walking


def simulate(geometry, bodies, state, **words):
    """Return a `Simulation`; the fields of `Physics` and `Walking` may be given one by one."""
    of_physics, of_walking = (
        {name: words.pop(name) for name in [field.name for field in fields(kind)] if name in words}
        for kind in (Physics, Walking)
    )
    return Simulation(geometry, bodies, state, physics=Physics(**of_physics), walking=Walking(**of_walking), **words)
