"""One big crowd that walks to one door: particle-steps per CPU second, everything a step needs included.

People of Lin, Ma, Lo (radius 0.25 to 0.35 m), at each scheme's default time step.  ``hertz`` and ``dem`` push with forces,
so a step is short; a step of ``nsm1`` and ``nsm2`` solves a system and is ten times longer.  Before anything is measured the
crowd walks for ``_SETTLE`` seconds and packs before the door.
"""

import time

import numpy as np

from benchmarks.measuring import Effort, Row, significant
from crowd_env import SCHEMES, Population, Simulation, Uniform, make_scenario, make_state

# Name -> people and side of the room [m]: 2 /m2 and 2.3 /m2; bodies cover 0.57 and 0.65 of the floor.
SIZES = {"200": (200, 10.0), "10000": (10_000, 66.0)}
_SETTLE = {"200": 4.0, "10000": 0.5}  # s


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme and size."""
    schemes = [name for name in SCHEMES if name != "hertz-literal"]
    return [row for size in SIZES for scheme in schemes for row in measure(effort, scheme, size)]


def measure(effort: Effort, scheme: str, size: str) -> list[Row]:
    """Return particle-steps per CPU second, of people who are inside."""
    count, side = SIZES[size]
    people = Population(
        count, Uniform(0.25, 0.35), Uniform(60.0, 80.0), Uniform(1.0, 1.0), relaxation_time=Uniform(0.5, 0.5)
    )
    place = make_scenario("lin-room-v0", side=side, population=people)
    bodies, position = people.draw(np.random.default_rng(0), place.geometry)
    simulation = Simulation(place.geometry, bodies, make_state(position), scheme=scheme, fields=[place.field()])
    simulation.advance(n_substeps=round(_SETTLE[size] / simulation.dt))
    per_call, best = round(1.0 / simulation.dt), 0.0  # a simulated second
    for _ in range(effort.blocks):
        begin, steps = time.process_time(), 0.0
        while time.process_time() - begin < effort.seconds and simulation.inside[0] > 0.8 * count:
            before = simulation.inside[0]
            simulation.advance(n_substeps=per_call)
            steps += 0.5 * per_call * float(before + simulation.inside[0])
        if steps:
            best = max(best, steps / (time.process_time() - begin))
    name, contacts = f"{scheme}, {count} people", len(simulation.contacts().gap) / count
    return [
        Row(f"{name}: particle-steps", significant(best, 3), "1/CPU s"),
        Row(f"{name}: simulated over CPU time", significant(best * simulation.dt / count, 3), "1"),
        Row(f"{name}: contacts per person", significant(contacts, 2), "1"),
    ]
