"""Positions after a few steps of every scheme, beside stored ones: a change of the physics is seen on any machine.

To 1e-9 m: bits differ between processors, and this early nothing has amplified them (a shift of the starts by 1e-13 m grows
to about 1e-12 m).  Where a change is meant, ``python tests/physics/test_stored_positions.py`` stores them anew.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from crowd_env import SCHEMES, Simulation, make_bodies, make_scenario, make_state

STORED = Path(__file__).resolve().parent.parent / "data" / "positions.json"
STEPS = 5  # decisions of 0.1 s


def walked(scheme):
    """Return where sixteen people who press towards a door are after each decision [m]; no generator draws anything of it."""
    people = np.arange(16)
    row, column = people // 4, people % 4
    position = np.column_stack([1.3 + 0.47 * column + 0.03 * (row % 2), 0.75 + 0.49 * row + 0.02 * (column % 3)])
    radius, speed = 0.2 + 0.004 * (7 * people % 11), 1.2 + 0.1 * (5 * people % 9)
    bodies = make_bodies(radius, 60.0 + 2.5 * people, desired_speed=speed, relaxation_time=0.2)
    geometry = make_scenario("room-v0", side=3.2).geometry
    simulation = Simulation(geometry, bodies, make_state(position), physics=scheme)
    found = []
    for _ in range(STEPS):
        simulation.advance(n_substeps=round(0.1 / simulation.dt))
        found.append(simulation.state.position.tolist())
    return found


def stored():
    return json.loads(STORED.read_text(encoding="utf-8"))


def test_every_scheme_has_stored_positions():
    assert set(stored()) == set(SCHEMES)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_people_stand_where_they_stood(scheme):
    np.testing.assert_allclose(walked(scheme), stored()[scheme], rtol=0.0, atol=1e-9)


def test_the_schemes_have_parted_by_then():
    """In contact: before the first touch the schemes with inertia would all give the same."""
    last = {name: np.array(steps)[-1] for name, steps in stored().items()}
    for name in ("dem", "nsm1-inertial", "nsm2", "hertz"):
        others = [np.abs(last[name] - last[other]).max() for other in last if other != name]
        assert min(others) > 1e-3


if __name__ == "__main__":
    STORED.write_text(json.dumps({name: walked(name) for name in SCHEMES}) + "\n", encoding="utf-8")
