"""Bodies of several discs in frames, films and force networks: drawn as they are turned."""

from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from cases import looped
from outlined_crowds import TORSO, bodies_as_shapes, grains
from shapely.geometry import box

from crowd_env import CrowdEnv, Geometry, Physics
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.physics.hertz import Hertz
from crowd_env.physics.pressure import contact_forces
from crowd_env.recording import record
from crowd_env.rendering.discs import bodies_of
from crowd_env.rendering.forces import force_network
from crowd_env.rendering.frames import Renderer, draw_env
from crowd_env.scenarios import make_scenario

pytestmark = pytest.mark.more

SHOULDERS = SimpleNamespace(outline="torso")
BODY = [[2, 1.5]], [0.2]
ROOM = Geometry.from_polygon(box(0, 0, 4, 3))


@looped("angle", [0.0, 0.5 * np.pi, -2.0])
def test_a_frame_shows_the_outline_as_it_is_turned(angle):
    renderer = Renderer(ROOM, width=900)
    body = {"position": [[1.7, 1.4]], "radius": [0.3]}
    empty = renderer.frame(**body, active=[False], inside=1)
    image = renderer.frame(**body, bodies=bodies_of(SHOULDERS, **body, angle=[angle]))
    drawn = (image != empty).any(axis=-1)
    bodies, state = make_bodies([0.3], [80.0]), make_state([[1.7, 1.4]])
    state.angle[:] = angle
    (shape,) = bodies_as_shapes(TORSO, bodies, state)
    rows, columns = np.indices(drawn.shape)
    scale, (x, y) = renderer.layout.scale, renderer.layout.origin
    points = (columns + 0.5 - x) / scale, (y - rows - 0.5) / scale
    inside = shapely.contains_xy(shape, *points)
    near = shapely.dwithin(shapely.points(*points), shape.boundary, 1.5 / scale)
    assert inside.sum() > 2000
    np.testing.assert_array_equal(drawn[~near], inside[~near])


def test_feet_are_dots_where_they_are_and_without_them_nothing_changes():
    renderer = Renderer(ROOM, width=900)
    plain, seen = (
        renderer.frame(*BODY, bodies=bodies_of(None, *BODY, feet=feet)) for feet in (None, [[2.1, 1.5, 2.6, 1.4]])
    )
    np.testing.assert_array_equal(plain, renderer.frame(*BODY))
    changed = (plain != seen).any(axis=-1)
    for foot in ([2.1, 1.5], [2.6, 1.4]):
        column, row = renderer.layout.pixels(np.array(foot)).astype(int)
        assert changed[row, column] and seen[row, column].sum() < 200
    area = 2.0 * np.pi * (0.05 * renderer.layout.scale) ** 2
    assert changed.sum() == pytest.approx(area, rel=0.2)


def test_a_dot_shows_where_a_body_faces_and_discs_are_drawn_as_before():
    renderer = Renderer(ROOM, width=900)
    ahead, back = (renderer.frame(*BODY, bodies=bodies_of(SHOULDERS, *BODY, angle=[angle])) for angle in (0.0, np.pi))
    column, row = renderer.layout.pixels([2 + 0.35 * 0.2, 1.5]).astype(int)
    assert ahead[row, column].sum() < back[row, column].sum()
    disc = renderer.frame(*BODY, bodies=bodies_of(None, *BODY, angle=[1.0]))
    np.testing.assert_array_equal(disc, renderer.frame(*BODY))


def test_environments_and_recordings_show_shoulders():
    env = CrowdEnv(make_scenario("room-v0", side=6.0), physics=Physics("hertz", outline="torso"))
    env.reset(seed=0)
    for _ in range(8):
        env.step(None)
    renderers: list[Renderer] = []
    frame = draw_env(env, renderers)
    [renderer] = renderers
    state, radius = env.simulation.state, env.simulation.bodies.radius
    shown = {"active": state.active, "color_value": np.zeros(20), "clock": float(state.time[0])}
    expected = renderer.frame(
        state.position, radius, bodies=bodies_of(SHOULDERS, state.position, radius, angle=state.angle), **shown
    )
    discs = renderer.frame(state.position, radius, velocity=state.velocity, **shown)
    differs = [(frame != other).any(axis=-1).mean() for other in (expected, discs)]
    assert differs[0] < 0.3 * differs[1]
    place = make_scenario("room-v0", side=6.0, people=5)
    film = record(place, seed=1, scheme="hertz", outline="torso")
    assert film.outline == "torso" and film.angle.shape == film.person.shape
    np.testing.assert_array_equal(film.at(0.0).angle, film.angle[film.frame == 1])
    half = film.at(0.5 * (film.times[3] + film.times[4]))
    before, after = (film.angle[(film.frame == k) & np.isin(film.person, half.person)] for k in (3, 4))
    np.testing.assert_allclose(half.angle, 0.5 * (before + after))
    assert record(place, seed=1, scheme="hertz").at(0.2).angle is None


def test_forces_between_bodies_are_the_sum_over_their_discs():
    place = Geometry.from_polygon(box(0, 0, 3, 3))
    scheme = Hertz(friction=0.0, wall_friction=0.0, normal_damping=0.0, social=None)
    # Chest to back, and one with the back against the left wall, facing +x.
    simulation = grains([[1.5, 1.5], [1.72, 1.5], [0.1, 0.6]], 0.0, TORSO, place=place, scheme=scheme, dt=1e-6)
    simulation.advance()
    listed, forces = simulation.contacts(), contact_forces(simulation)
    assert (listed.i == 0).sum() > 1 and (listed.i == 2).sum() > 1
    assert list(zip(forces.i, forces.j < 0, strict=True)) == [(0, False), (2, True)]
    for i, force in zip(forces.i, forces.force, strict=True):
        assert force == pytest.approx(listed.impulse[listed.i == i, 0].sum() / 1e-6)
    assert forces.at[1, 0] == pytest.approx(0.0, abs=1e-9)
    figure = force_network(forces)
    (lines,) = figure.axes[0].collections
    assert len(lines.get_segments()) == 2
