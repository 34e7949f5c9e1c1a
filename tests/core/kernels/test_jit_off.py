"""Kernels as plain Python: NUMBA_DISABLE_JIT=1 changes how fast they are, and nothing else.

Run as a program, this file writes what every kernel of a decision step made of small crowds to the file that it is given.
"""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numba import config
from repository import ROOT
from shapely.geometry import box
from simulations import simulate

from crowd_env import (
    FULL_SPEED,
    ControlRule,
    CrowdEnv,
    Geometry,
    ObservationLayout,
    Physics,
    Population,
    Route,
    Scenario,
    SpeedZone,
)
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.physics import DEM, SCHEMES, SOCIAL_FORCES
from crowd_env.physics.dem_lanes import partition

pytestmark = [pytest.mark.kernels, pytest.mark.more]
KINDS = {**SCHEMES, **{f"dem-{name}": DEM(social=social) for name, social in SOCIAL_FORCES.items()}}
PLACE = Geometry.from_polygon(
    box(0, 0, 6, 4),
    exits={"west": [(0, 1.5), (0, 2.5)], "east": [(6, 1.5), (6, 2.5)]},
    regions={"left": box(0, 0, 3, 4), "right": box(3, 0, 6, 4)},
    obstacles=[box(2.8, 0, 3.2, 1.0)],
    doors={"west door": "west"},
)
HALL = Scenario(
    "hall",
    PLACE,
    Population(8, start_region="left"),
    60.0,
    routes=(Route("quick", strategy="fastest"),),
    zones=(SpeedZone("right", factor=0.5),),
    rules=(ControlRule("left", 3, "east"),),
    **FULL_SPEED,
)


def walked(env):
    """Return where people are after some steps, and what they see and get."""
    env.reset(seed=3)
    for _ in range(4):
        step = env.step(None)
    state = env.simulation.state
    return {"position": state.position, "velocity": state.velocity, "seen": step.observation, "reward": step.reward}


def guided():
    """Return the same of people with routes, rules and zones, in two environments; in one of them a door is closed."""
    scenes = [HALL, replace(HALL, closed_doors=("west door",))]
    return walked(CrowdEnv(scenes, num_envs=2, observation=ObservationLayout(rays=8), routing="quick"))


def lattice(**options):
    """Return a crowd, large enough to be sorted and cut into slabs, that presses into a corner."""
    rng, count = np.random.default_rng(0), 66
    position = np.stack(np.meshgrid(np.arange(count), np.arange(count)), -1).reshape(-1, 2) * 0.4 + 0.3
    position = rng.permutation(position + rng.uniform(-0.05, 0.05, position.shape))
    bodies = make_bodies(rng.uniform(0.19, 0.23, len(position)), 70.0, desired_speed=1.4)
    place = Geometry.from_polygon(box(0, 0, 27, 27))
    simulation = simulate(place, bodies, make_state(position), scheme="dem", fields=[None], **options)
    towards = np.full((len(position), 2), np.sqrt(0.5))
    simulation.advance(towards, relative=np.zeros(len(position), bool), n_substeps=3)
    return simulation.state.position


def measure():
    """Return all that plain Python and compiled code have to agree on."""
    found = {name: walked(CrowdEnv("room-v0", physics=scheme)) for name, scheme in KINDS.items()}
    found |= {"guided": guided(), "large": {"position": lattice(threads=2)}}
    return {f"{name}: {kind}": value for name, kinds in found.items() for kind, value in kinds.items()}


def test_plain_python_and_compiled_code_agree(tmp_path):
    other = "0" if config.DISABLE_JIT else "1"
    settings = os.environ | {
        "NUMBA_DISABLE_JIT": other,
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")]),
    }
    program = [sys.executable, "-W", "error::RuntimeWarning:crowd_env", __file__, str(tmp_path / "there.npz")]
    done = subprocess.run(program, env=settings, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    here = measure()
    with np.load(tmp_path / "there.npz") as there:
        assert set(there.files) == set(here)
        for name, value in here.items():
            np.testing.assert_allclose(there[name], value, rtol=1e-12, atol=1e-12, err_msg=name)


def test_threads_that_share_a_crowd_wait_for_each_other_in_plain_python_too(monkeypatch):
    if not config.DISABLE_JIT:
        pytest.skip("compiled code holds its constants; `make kernels` runs this")
    monkeypatch.setattr(partition, "_MANY", 8)
    seen = []
    for threads in (1, 2, 5):
        env = CrowdEnv("room-v0", physics=Physics("dem", threads=threads))
        env.reset(seed=0)
        for _ in range(2):
            env.step(None)
        seen.append(env.simulation.state.position.copy())
    np.testing.assert_array_equal(seen[1], seen[0])
    np.testing.assert_array_equal(seen[2], seen[0])


if __name__ == "__main__":
    np.savez(sys.argv[1], **measure())
