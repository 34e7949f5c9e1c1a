"""Where people stand after a few steps of each scheme: stored, so that a change of the physics is seen on any machine.

Bits differ between processors; positions this early, before a crowd has amplified them, agree to far less than 1e-9 m.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env import SCHEMES, Simulation, make_bodies, make_scenario, make_state
from crowd_env.core.files.atomic import write_text

STORED = Path(__file__).resolve().parent.parent / "tests" / "data" / "positions.json"
STEPS = 5  # decisions of 0.1 s

Positions = dict[str, list[list[list[float]]]]  # scheme -> after each decision -> (x, y) of each person [m]


def positions() -> Positions:
    """Return where sixteen people who press towards a door are after each of the first decisions, by scheme."""
    return {name: walked(name) for name in SCHEMES}


def walked(scheme: str) -> list[list[list[float]]]:
    """Return where a staggered crowd, at rest at first, is after each decision; no generator draws anything of it."""
    people: Any = np.arange(16)
    row, column = people // 4, people % 4
    position = np.column_stack([1.3 + 0.47 * column + 0.03 * (row % 2), 0.75 + 0.49 * row + 0.02 * (column % 3)])
    radius = 0.2 + 0.004 * (7 * people % 11)
    speed = 1.2 + 0.1 * (5 * people % 9)
    bodies = make_bodies(radius, 60.0 + 2.5 * people, desired_speed=speed, relaxation_time=0.2)
    geometry = make_scenario("room-v0", side=3.2).geometry
    simulation = Simulation(geometry, bodies, make_state(position), scheme=scheme)
    steps = round(0.1 / simulation.dt)
    found = []
    for _ in range(STEPS):
        simulation.advance(n_substeps=steps)
        found.append(simulation.state.position.tolist())
    return found


def write(path: Path) -> None:
    """Store the positions of this machine; the file is whole or as it was."""
    found = positions()
    lines = [
        f"{json.dumps(name)}: [\n" + ",\n".join(json.dumps(places) for places in steps) + "\n]"
        for name, steps in found.items()
    ]
    write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")
