"""Buildings as environments: what is seen of slopes, where a controller decides, and the shipped and drawn buildings."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from storeys import laid, ramp

from crowd_env import CrowdEnv
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.routing.env import RoutingEnv
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.generated import KINDS, kind_of
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import Scenario


@pytest.mark.kernels
def test_a_slope_is_seen_here_and_one_meter_ahead():
    """On a ramp of 0.6 m over 1.6 m that people walk down at half speed: the sine of its angle, and the speed along it."""
    sheets, seams = ramp(0.6, 1.6, 2.0, down=0.5)
    geometry = laid(sheets, seams, {"out": (0, np.array([[-2.0, 2.0], [-2.0, 0.0]]))})
    at, sheet = np.array([[3.3, 1.0], [2.3, 1.0], [1.2, 1.0], [0.5, 1.0], [-1.0, 1.0]]), np.array([2, 2, 1, 1, 0])
    people = Population(5, radius=(0.2, 0.2), starts=geometry.laid_out(at, sheet))
    env = CrowdEnv(
        Scenario("ramp", geometry, people, 60.0), physics="dem", observation=ObservationLayout(terms=("slope",))
    )
    seen, _ = env.reset(seed=0)
    order = np.argsort(-env.simulation.state.position[:, 0])
    assert_allclose(env.simulation.state.position[order], at, atol=1e-9)
    level, down = [0.0, 0.0], [-0.6 / np.hypot(0.6, 1.6), -0.5]
    assert_allclose(seen[order], [level + level, level + down, down + down, down + level, level + level], atol=1e-6)


@pytest.mark.more
def test_a_controller_decides_storey_by_storey_and_stair_by_stair():
    env = RoutingEnv("building-v0", people=24, physics="dem", interval=4.0)
    stairs = [f"{end} stair {k}" for end in ("west", "east") for k in (1, 2)]
    assert list(env.layout.regions) == ["ground", "storey 1", "storey 2", *stairs]
    assert RoutingEnv("building-v0", people=24, grid=(2, 1)).layout.regions[0].startswith("cell-")
    observation, _ = env.reset(seed=0)
    layout, over, seen = env.layout, False, np.zeros(len(env.layout.regions))
    assert observation[layout["count"]].sum() == pytest.approx(1.0)
    while not over:
        observation, _, terminated, truncated, info = env.step([layout.routes.index("east")] * len(layout.regions))
        assert observation[layout["count"]].sum() == pytest.approx(observation[layout["inside"]][0], abs=1e-6)
        seen, over = seen + observation[layout["count"]], terminated or truncated
    assert info["inside"] == 0 and (env.batch.env.simulation.state.exit_index == layout.exits.index("east")).all()
    assert (seen[[0, 1, 2, 5, 6]] > 0.0).all() and seen[3:5].tolist() == [
        0.0,
        0.0,
    ]  # nobody took the stairs in the west


def test_kinds_on_request_change_no_other_place():
    assert "building" not in KINDS and kind_of(3) in KINDS
    place = make_scenario("generated-v0", seed=3, kind="building")
    assert place.geometry.building is not None and len(place.geometry.building.sheets) == 10
    again = make_scenario("generated-v0", seed=3, kind="building")
    assert again.geometry.exits.tobytes() == place.geometry.exits.tobytes()
