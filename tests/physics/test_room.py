"""Fifty evacuations of the room of Pécol et al. 2011 (section 4.2): flow through the door, and nobody in the walls.

Expected flows are the mean slopes per run of an independent prototype of the same reading of the paper (six batches of 50
draws; batches differ by 1 to 2 %).  The paper prints 3.04, 4.65 and 2.60 for DEM, NSM1 and NSM2 without saying which exits
it regresses over.
"""

import numpy as np
import pytest
from crowds import joined

from crowd_env.core.arrays.state import make_state
from crowd_env.envs.metrics import flow_slope
from crowd_env.physics import SCHEMES
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.scenarios import make_scenario

DRAWS = 50
FLOW = {"dem": 2.80, "nsm1": 4.81, "nsm1-inertial": 2.70, "nsm2": 2.39}  # 1/s
ROOM = make_scenario("room-v0")


@pytest.fixture(scope="module")
def evacuated():
    """Return name -> the finished batch, checked every 0.1 s on the way."""
    field = ROOM.field()
    done = {}

    def get(name):
        if name not in done:
            rngs = [np.random.default_rng(seed) for seed in range(DRAWS)]
            draws = [ROOM.population.draw(rng, ROOM.geometry) for rng in rngs]
            bodies, state = joined([(bodies, make_state(position)) for bodies, position in draws])
            simulation = Simulation(ROOM.geometry, bodies, state, physics=Physics(name, dt=0.01), fields=[field])
            strays = 0
            while simulation.inside.any() and state.time.max() < ROOM.time_limit:
                simulation.advance(n_substeps=10)
                strays += (~ROOM.geometry.contains(state.position[state.active])).sum()
            done[name] = simulation, strays
        return done[name]

    return get


@pytest.mark.parametrize("name", SCHEMES)
def test_nobody_is_ever_in_a_wall(name, evacuated):
    simulation, strays = evacuated(name)
    assert strays == 0
    bound = simulation.scheme.overlap_bound(simulation.bodies, simulation.dt)
    assert simulation.diagnostics.max_outside.max() <= bound
    assert simulation.diagnostics.unconverged.sum() == 0


@pytest.mark.parametrize("name", SCHEMES)
def test_nearly_everyone_gets_out_through_the_door(name, evacuated):
    simulation, _ = evacuated(name)
    state = simulation.state
    # NSM1 gets stuck for good in about one draw of fifty: a static arch.  The literal Hertz rubs on the jambs and freezes.
    stuck = {"nsm1": 4, "nsm1-inertial": 4, "nsm1-loose": 4, "hertz-literal": DRAWS}.get(name, 0)
    assert (simulation.inside > 0).sum() <= stuck
    out = ~state.active
    assert (state.exit_index[out] == 0).all()
    assert (np.abs(state.position[out, 1] - 2.5) <= 0.41).all()
    assert (state.exit_time[out] > 0).all()
    assert np.isnan(state.exit_time[~out]).all()


@pytest.mark.parametrize("name", FLOW)
def test_flow_through_the_door(name, evacuated):
    simulation, _ = evacuated(name)
    flow = [flow_slope(times) for times in simulation.state.exit_time.reshape(DRAWS, -1)]
    assert np.mean(flow) == pytest.approx(FLOW[name], rel=0.15)


def test_order_of_the_schemes_in_table_5(evacuated):
    flow = {
        name: np.mean([flow_slope(t) for t in evacuated(name)[0].state.exit_time.reshape(DRAWS, -1)]) for name in FLOW
    }
    assert flow["nsm1"] > flow["dem"] > flow["nsm2"]
