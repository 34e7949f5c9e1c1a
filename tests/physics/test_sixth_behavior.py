"""A behavior that the package does not know, in this file alone: it acts under every scheme, and is kept and recorded.

Pedestrians tire: the speed that they want falls by exp(-t / T) since they began to walk.  A lone pedestrian of relaxation time
tau then walks at v_0 exp(-t / T) / (1 - tau / T) once the start is forgotten, or without a drive at v_0 exp(-t / T).
"""

import re
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pytest
from cases import looped
from numba import config

from crowd_env import SCHEMES, CrowdEnv, Geometry, Population, Scenario, Simulation, Walking, make_bodies, make_state
from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.checks import Positive, check_fields
from crowd_env.core.kernels.jit import inner_kernel
from crowd_env.recording import load, record

pytestmark = [
    pytest.mark.kernels,
    pytest.mark.more,
]  # kernels with a behavior of one's own are compiled in every process

# All schemes as plain Python, in `make kernels`; compiled, two whose loops differ most.
UNDER = tuple(SCHEMES) if config.DISABLE_JIT else ("dem", "nsm2")
SPEED, TAU, LASTS = 1.5, 0.2, 4.0


class Began(NamedTuple):
    """Since when people walk."""

    time: Annotated[Floats, "P"]  # s
    walks: Annotated[Bools, "P"]
    asked: Annotated[Floats, "P 2"]  # m/s
    latest: Annotated[Floats, "E"]  # s


@inner_kernel
def tire(i, time, vx, vy, batch):
    memory, lasts = batch.history.memory.fatigue, batch.behaviors.fatigue.lasts
    if not memory.walks[i]:
        memory.walks[i], memory.time[i] = True, time
    memory.asked[i, 0], memory.asked[i, 1] = vx, vy
    memory.latest[np.searchsorted(batch.bodies.env_start, i, side="right") - 1] = time
    share = np.exp((memory.time[i] - time) / lasts)
    return share * vx, share * vy


@dataclass(frozen=True)
class Fatigue(Behavior):
    """People tire."""

    lasts: Positive = LASTS  # s

    NAME = "fatigue"
    MEMORY = Began
    RECORDED = ("time",)
    desire = tire

    def __post_init__(self):
        check_fields("fatigue", self)


def corridor():
    return Geometry.from_polygon([(0, 0), (12, 0), (12, 2), (0, 2)], exits={"east": [(12, 0), (12, 2)]})


def one_who_tires(scheme):
    bodies = make_bodies(np.array([0.2]), 80.0, desired_speed=SPEED, relaxation_time=TAU)
    walking = Walking(others=(Fatigue(),))
    return Simulation(corridor(), bodies, make_state(np.array([[0.5, 1.0]])), physics=scheme, walking=walking)


@looped("scheme", UNDER)
def test_people_tire_under_every_scheme(scheme):
    simulation = one_who_tires(scheme)
    spontaneous = scheme in ("nsm1", "nsm1-loose")
    factor = 1.0 if spontaneous else 1.0 / (1.0 - TAU / LASTS)
    for _ in range(3):
        simulation.advance(n_substeps=round(1.0 / simulation.dt))
        expected = SPEED * factor * np.exp(-simulation.state.time[0] / LASTS)
        start = 0.0 if spontaneous else SPEED * factor * np.exp(-simulation.state.time[0] / TAU)
        assert simulation.state.velocity[0, 0] == pytest.approx(expected - start, rel=6.0 * simulation.dt)


@looped("scheme", UNDER)
def test_a_checkpoint_holds_who_has_tired(scheme):
    simulation = one_who_tires(scheme)
    simulation.advance(n_substeps=40)
    kept = simulation.checkpoint()
    simulation.advance(n_substeps=40)
    then = simulation.state.position.copy()
    simulation.history.memory.fatigue.time[:] = 0.3  # of another evacuation
    simulation.restore(kept)
    simulation.advance(n_substeps=40)
    np.testing.assert_array_equal(simulation.state.position, then)
    assert simulation.history.memory.fatigue.latest[0] > 0.0
    simulation.restart(0, simulation.bodies, simulation.state.position.copy())
    assert simulation.history.memory.fatigue.latest.tolist() == [0.0]


@pytest.mark.parametrize("suffix", ["sqlite", "h5"])
def test_a_recording_holds_it(tmp_path, suffix):
    people = Population(3, radius=0.2, desired_speed=SPEED, response_time=(0.0, 0.5))
    place = Scenario("corridor", corridor(), people, time_limit=1.0)
    env = CrowdEnv(place, physics="nsm2", walking=Walking(others=(Fatigue(),)))
    recording = record(env, seed=1)
    path = recording.save(tmp_path / f"a.{suffix}")
    for found in (recording, load(path)):
        assert found.memory["time"].shape == found.person.shape
        np.testing.assert_array_equal(found.memory["time"], recording.memory["time"])
        assert found.facts["fatigue"] == {"lasts": LASTS}


def test_a_kernel_knows_the_environment_of_a_pedestrian():
    place = Scenario("corridor", corridor(), Population(3, radius=0.2, desired_speed=SPEED), time_limit=9.0)
    env = CrowdEnv(place, num_envs=3, physics="nsm2", walking=Walking(others=(Fatigue(),)))
    env.reset(seed=1)
    env.step(None)
    env.reset(mask=np.array([False, True, False]))
    env.step(None)
    memory, time = env.simulation.history.memory.fatigue, env.simulation.state.time
    np.testing.assert_allclose(time, [0.2, 0.1, 0.2])
    np.testing.assert_allclose(memory.latest, time, atol=0.02)
    assert (np.hypot(*memory.asked.T) > 0.1 * SPEED).all()


class NoShape(NamedTuple):
    time: Floats


class Odd(NamedTuple):
    time: Annotated[Floats, "2 P"]


def test_a_checkpoint_with_a_behavior_fits_no_simulation_without_it():
    kept = one_who_tires("nsm2").checkpoint()
    bodies = make_bodies(np.array([0.2]), 80.0, desired_speed=SPEED, relaxation_time=TAU)
    plain = Simulation(corridor(), bodies, make_state(np.array([[0.5, 1.0]])), physics="nsm2")
    with pytest.raises(ValueError, match="its fatigue differs"):
        plain.restore(kept)


WRONG = {
    "not compiled": ({"NAME": "limp", "desire": 3}, "desire is 3; it must be a function under @inner_kernel"),
    "no shape": ({"NAME": "limp", "MEMORY": NoShape}, "array 'time' of its MEMORY has the shape 'none'; write such as"),
    "odd shape": ({"NAME": "limp", "MEMORY": Odd}, "array 'time' of its MEMORY has the shape '2 P'; write such as"),
    "taken": ({"NAME": "balance"}, "behavior 'balance': the name is taken; taken are manner, "),
    "no identifier": ({"NAME": "my limp"}, "a NAME that is an identifier"),
    "unknown need": ({"NAME": "limp", "NEEDS": "drivess"}, "NEEDS is 'drivess'; it must be None, or 'drives' or"),
    "a need without words": ({"NAME": "limp", "NEEDS": "drives"}, "with a text in LACKS"),
    "not in memory": (
        {"NAME": "limp", "RECORDED": ("tim",)},
        "RECORDED names 'tim', which is not in its memory: time, walks, asked, latest",
    ),
    "feet": ({"NAME": "limp", "RECORDED": ("feet",)}, "RECORDED names 'feet', which is"),
}


@looped("case", WRONG)
def test_what_a_behavior_declares_wrongly_is_refused_in_one_sentence(case):
    declares, words = WRONG[case]
    with pytest.raises(ValueError, match=re.escape(words)):
        Walking(others=(type("Limp", (Fatigue,), declares)(),))


def test_two_behaviors_of_one_name_are_refused():
    with pytest.raises(ValueError, match="'fatigue': the name is taken"):
        Walking(others=(Fatigue(), Fatigue(2.0)))
    with pytest.raises(ValueError, match="Behavior"):
        Walking(others=(1,))
