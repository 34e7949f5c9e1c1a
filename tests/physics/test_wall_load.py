"""What walls bear: the push of all who lean on them, by contact and by social force, whatever the scheme."""

from typing import NamedTuple

import numpy as np
import pytest
import shapely
from crowds import crowd_in, half_plane, tight

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import SCHEMES, make_scheme
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.physics.social_force import SocialForce

WIDTH = 4.0  # m, of the pen
TO_THE_WALL = np.array([-1.0, 0.0])
every_scheme = pytest.mark.parametrize("name", SCHEMES)


@every_scheme
def test_what_people_get_of_each_other_cancels_and_the_rest_is_of_walls(name):
    geometry = Geometry.from_polygon(shapely.box(0, 0, 3, 3))
    bodies, state, command = crowd_in(np.random.default_rng(2), geometry, 22)
    simulation = Simulation(geometry, bodies, state, physics=SCHEMES[name])
    simulation.advance(2.0 * command, relative=np.zeros(22, bool), n_substeps=round(1.0 / simulation.dt))
    found = simulation.results
    assert np.abs(found.wall_impulse).sum() > 10.0
    np.testing.assert_allclose(found.wall_impulse.sum(axis=0), found.impulse.sum(axis=0), atol=1e-8)


@every_scheme
def test_the_share_of_walls_is_that_of_the_contacts_with_walls(name):
    geometry = Geometry.from_polygon(shapely.box(0, 0, 3, 3))
    bodies, state, command = crowd_in(np.random.default_rng(5), geometry, 22)
    simulation = Simulation(geometry, bodies, state, physics=tight(SCHEMES[name]))
    ends = simulation.scheme.info.contacts_at == "end"
    seen = 0
    for _ in range(round(0.5 / simulation.dt)):
        before = simulation.contacts()
        simulation.advance(2.0 * command, relative=np.zeros(22, bool))
        expected = np.zeros((22, 2))
        for found, share in ((before, 0.5), (simulation.contacts(), 0.5)) if ends else ((simulation.contacts(), 1.0),):
            of_wall = found.j < 0
            nx, ny = found.normal[of_wall].T
            along, across = share * found.impulse[of_wall].T
            np.add.at(
                expected, found.i[of_wall], np.stack([along * nx - across * ny, along * ny + across * nx], axis=1)
            )
        seen += int(np.abs(expected).max() > 0.1)
        np.testing.assert_allclose(simulation.results.wall_impulse, expected, atol=1e-9)
    assert seen > 10


@pytest.mark.parametrize(("heading", "share"), [((-1.0, 0.0), 1.3), ((0.0, 1.0), 1.0), ((1.0, 0.0), 0.7)])
def test_the_social_force_of_a_wall_is_that_of_the_formula(heading, share):
    bodies = make_bodies(np.array([0.25]), np.array([80.0]), desired_speed=0.5)
    social = SocialForce(strength=300.0, length=0.05, anisotropy=0.3, wall_strength=300.0)
    state = make_state(np.array([[0.25 + 0.1, 0.0]]))
    simulation = Simulation(half_plane(), bodies, state, physics=make_scheme("hertz", social))
    assert not simulation.social_forces_of_walls().any()  # nobody has looked around yet
    simulation.advance(np.array([heading]), relative=np.zeros(1, bool))
    gap = simulation.state.position[0, 0] - 0.25
    np.testing.assert_allclose(
        simulation.social_forces_of_walls(), [[share * 300.0 * np.exp(-gap / 0.05), 0.0]], rtol=1e-9
    )
    literal = Simulation(half_plane(), *(bodies, state), physics="hertz-literal")
    literal.advance(np.array([heading]), relative=np.zeros(1, bool))
    assert not literal.social_forces_of_walls().any()


# ------------------------------------------------------------------------------------------------------------ the pen


class Pen(NamedTuple):
    """Means of 4 s in a pen in which everyone wants to the wall in front [N]; what moves is left out."""

    contact: float
    social: float  # of the wall
    drive: float  # of all people
    between: float  # that the social force between people, which is not reciprocal, makes of nothing; < 0 takes
    change: float  # of the momentum
    largest: float  # mean of 0.1 s of a contact force of walls on one person

    @property
    def wall(self) -> float:
        """What the wall bears."""
        return self.contact + self.social


def pen(name, manner=None, max_drive=None, people=100):
    """Return the means of 4 s, after 8 s in which people come to rest."""
    rng = np.random.default_rng(1)
    columns = -(-people // 7)
    grid = np.stack(np.meshgrid(0.4 + 0.55 * np.arange(columns), 0.3 + 0.56 * np.arange(7)), axis=-1)
    position = np.sort(grid.reshape(-1, 2).view("f8,f8"), axis=0).view("f8").reshape(-1, 2)[:people]
    geometry = Geometry.from_polygon(shapely.box(0, 0, 0.55 * columns + 2.0, WIDTH))
    drawn = {"desired_speed": rng.uniform(1.2, 2.0, people), "relaxation_time": rng.uniform(0.1, 0.5, people)}
    bodies = make_bodies(rng.uniform(0.2, 0.25, people), rng.uniform(60, 100, people), **drawn)
    simulation = Simulation(
        geometry, bodies, make_state(position), physics=Physics(name, max_drive=max_drive), walking=manner
    )
    command = (np.tile(TO_THE_WALL, (people, 1)), np.zeros(people, bool))
    simulation.advance(command[0], relative=command[1], n_substeps=round(8.0 / simulation.dt))
    momentum, steps = bodies.mass @ simulation.state.velocity, round(4.0 / simulation.dt)
    contact, social, drive, between, largest, wall = 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(people)
    for k in range(steps):
        drive += drives(simulation, manner, max_drive) @ -TO_THE_WALL
        simulation.advance(command[0], relative=command[1])
        contact += float(simulation.results.wall_impulse[:, 0].sum())
        social += float(simulation.social_forces_of_walls()[:, 0].sum())
        between += float(made_between(simulation)[0])
        wall += np.hypot(*simulation.results.wall_impulse.T)
        if (k + 1) % round(0.1 / simulation.dt) == 0:
            largest, wall = max(largest, float(wall.max()) / 0.1), np.zeros(people)
    change = float((bodies.mass @ simulation.state.velocity - momentum)[0])
    return Pen(contact / 4.0, social / steps, -drive / steps, between / steps, change / 4.0, largest)


def drives(simulation, manner, max_drive):
    """Return the driving force [N] of all people together, by eq 11."""
    bodies, state = simulation.bodies, simulation.state
    wanted = bodies.desired_speed[:, None] * TO_THE_WALL if manner is None else simulation.history.walking_velocity
    force = (bodies.mass / bodies.relaxation_time)[:, None] * (wanted - state.velocity)
    size = np.hypot(*force.T)
    return (
        force * np.minimum(1.0, (np.inf if max_drive is None else max_drive) / np.maximum(size, 1e-12))[:, None]
    ).sum(0)


def made_between(simulation):
    """Return the sum of the social forces of people on each other [N], over all pairs."""
    social = simulation.scheme.social
    if social is None:
        return np.zeros(2)
    position, radius = simulation.state.position, simulation.bodies.radius
    apart = position[:, None] - position[None]
    distance = np.hypot(*np.moveaxis(apart, -1, 0))
    np.fill_diagonal(distance, np.inf)
    gap, normal = distance - radius[:, None] - radius, apart / distance[..., None]
    wanted = simulation.workspace.desired_velocity
    ahead = social.anisotropy * wanted / np.maximum(np.hypot(*wanted.T), 1e-12)[:, None]
    size = np.where(gap < social.cutoff, social.strength * np.exp(-gap / social.length), 0.0)
    size = size * (1.0 - np.einsum("ijk,ik->ij", normal, ahead))
    return (size[..., None] * normal).sum(axis=(0, 1))


# One of each scheme is a law; all of them are the table of docs/forces.md.
PENS = [
    pytest.param(name, manner, limit, marks=() if limit == 100.0 else pytest.mark.more)
    for name in ("dem", "nsm2", "hertz")
    for manner, limit in ((None, None), (None, 300.0), (None, 100.0), ("hurried", None))
]


@pytest.mark.parametrize(("name", "manner", "limit"), PENS)
def test_a_wall_bears_the_drive_of_all_who_press(name, manner, limit):
    found = pen(name, manner, limit)
    print(
        f"{name:6s} {manner or 'competitive':12s} {limit or '-':>6} wall {found.wall / WIDTH / 1e3:5.2f} kN/m (contact "
        f"{found.contact / WIDTH / 1e3:5.2f}), drive {found.drive / WIDTH / 1e3:5.2f}, taken between people "
        f"{found.between / WIDTH / 1e3:5.2f}, largest on one {found.largest / 1e3:4.1f} kN"
    )
    assert found.wall - found.change == pytest.approx(found.drive - found.between, rel=0.01, abs=20.0)
