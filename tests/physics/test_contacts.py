"""Who touches what, and from which side: against brute force over all pairs and walls, and at the awkward places."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import looped
from crowds import GRAIN_SCHEMES, PLANS, every_scheme, half_plane, people, plain, scatter, tight, touches
from shapely.geometry import box

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import NSM1, SCHEMES, Hertz
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation

pytestmark = pytest.mark.kernels

INERTIAL = tight(NSM1(trial="inertial"))


def tight_grain(name):
    """Return the scheme, or for one without inertia its granular twin: it finds contacts in the same way."""
    return tight(SCHEMES[name]) if name in GRAIN_SCHEMES else INERTIAL


def stand(geometry, position, *, scheme, radius=0.2, mass=80.0, dt=0.01):
    """Return a simulation of people at rest who have made one step; its contacts are those of ``position``."""
    position = np.atleast_2d(position)
    bodies = make_bodies(np.full(len(position), radius), mass)
    state = make_state(position)
    simulation = Simulation(geometry, bodies, state, physics=Physics(scheme, dt=dt), fields=[None], driving=False)
    if scheme.info.contacts_at == "end":
        simulation.dt = 1e-9
    simulation.advance()
    simulation.dt = dt
    return simulation


# ------------------------------------------------------------------------------------------------------- brute force


@cache
def pressed(plan, seed):
    """Return a plan, and a crowd in it that overlaps; four have left."""
    geometry, rng = PLANS[plan](), np.random.default_rng(seed)
    count = round(geometry.area * 2.2)
    bodies = people(rng, count)
    start = make_state(scatter(rng, geometry, bodies.radius, gap=-0.1), rng.normal(0, 1, (count, 2)))
    start.active[rng.permutation(count)[:4]] = False
    return geometry, bodies, start


@every_scheme
@looped("plan", PLANS)
@looped("seed", range(2), quick=1)
def test_contacts_are_those_of_brute_force(name, plan, seed):
    geometry, bodies, start = pressed(plan, seed)
    state = start.copy()
    simulation = Simulation(geometry, bodies, state, physics=SCHEMES[name], fields=[None])
    simulation.advance()
    found = simulation.contacts()
    margin = max(1e-9, found.gap.max())  # NSM1 looks ahead, the others list overlaps
    at = start if SCHEMES[name].info.contacts_at == "start" else state
    expected = touches(geometry, bodies, at, margin + 1e-3)
    assert sum(t.gap < 0 for t in expected if t.j >= 0) >= 7
    assert sum(t.gap < 0 for t in expected if t.j < 0) >= 2

    def key(i, j, normal):  # wall contacts of one person differ by their direction
        return (i, j) if j >= 0 else (i, -1, *np.round(normal, 6) + 0.0)

    rows = zip(*(array.tolist() for array in found[:3]), found.normal, strict=True)
    listed = {key(i, j, normal): (gap, normal) for i, j, gap, normal in rows}
    assert len(listed) == len(found.gap), "a touch is listed twice"
    reference = {key(t.i, t.j, t.normal): (t.gap, t.normal) for t in expected}
    assert listed.keys() <= reference.keys()
    assert {k for k, (gap, _) in reference.items() if gap < margin - 1e-9} <= listed.keys()
    for k, (gap, normal) in listed.items():
        assert gap == pytest.approx(reference[k][0], abs=1e-9)
        np.testing.assert_allclose(normal, reference[k][1], atol=1e-9)
    order = [(i, j < 0, j if j >= 0 else -j) for i, j in zip(found.i.tolist(), found.j.tolist(), strict=True)]
    assert order == sorted(order)  # by (i, j), walls last


# ------------------------------------------------------------------------------------------------------------- walls

DOOR = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2), (5, 3)]])
BLOCK = Geometry.from_polygon(box(0, 0, 6, 6), obstacles=[box(2, 2, 4, 4)])
THIN = Geometry.from_polygon(box(0, 0, 6, 6), thin_walls=[[(1, 3), (3, 3), (5, 3)]])


@every_scheme
@looped("y", [1.7, 1.9, 1.9999999, 2.0, 2.0000001, 2.03, 2.05])
def test_a_door_jamb_is_touched_once_by_who_comes_along_the_wall(name, y):
    contacts = stand(DOOR, [4.81, y], scheme=tight_grain(name)).contacts()
    touching = contacts.gap < 0
    corner = np.array([5, min(y, 2.0)])
    apart = [4.81, y] - corner
    assert touching.sum() == 1
    assert contacts.gap[touching] == pytest.approx(np.hypot(*apart) - 0.2, abs=1e-9)
    np.testing.assert_allclose(contacts.normal[touching][0], apart / np.hypot(*apart), atol=1e-7)


@every_scheme
@looped("angle", np.linspace(-30, 120, 16))
def test_the_corner_of_an_obstacle_is_touched_once_from_all_around(name, angle):
    # Around the corner (4, 4): the walls end at angle 0 (its right side) and 90 degrees (its top).
    angle = np.radians(angle)
    x = 4.19 if angle < 0 else 4 + 0.19 * np.cos(angle)
    y = 4.19 if angle > np.pi / 2 else 4 + 0.19 * np.sin(angle)
    at = np.array([x, y])
    contacts = stand(BLOCK, at, scheme=tight_grain(name)).contacts()
    touching = contacts.gap < 0
    assert touching.sum() == 1
    assert contacts.gap[touching] == pytest.approx(-0.01, abs=1e-9)
    nearest = np.clip(at, 2, 4)
    np.testing.assert_allclose(contacts.normal[touching][0], (at - nearest) / 0.19, atol=1e-7)


@every_scheme
@looped("x", [2.5, 2.95, 3.0, 3.0000001, 3.05, 3.5])
@looped("side", [1, -1])
def test_a_straight_wall_of_two_pieces_is_touched_once_from_either_side(name, x, side):
    for height in (0.19, 0.05):  # however deep the touch, the center's own side counts
        contacts = stand(THIN, [x, 3 + height * side], scheme=tight_grain(name)).contacts()
        touching = contacts.gap < 0
        assert touching.sum() == 1
        assert contacts.gap[touching] == pytest.approx(height - 0.2, abs=1e-9)
        np.testing.assert_allclose(contacts.normal[touching][0], [0, side], atol=1e-5)


@every_scheme
def test_a_concave_corner_touches_with_both_its_walls(name):
    contacts = stand(DOOR, [0.19, 0.18], scheme=tight_grain(name)).contacts()
    touching = contacts.gap < 0
    order = np.argsort(contacts.gap[touching])
    np.testing.assert_allclose(contacts.gap[touching][order], [-0.02, -0.01], atol=1e-9)
    np.testing.assert_allclose(contacts.normal[touching][order], [[0, 1], [1, 0]], atol=1e-9)


@every_scheme
def test_people_slide_along_a_wall_of_pieces_without_catching(name):
    # Thin wall of two pieces, pressed on while walking along it: no seam to be felt.
    pieces = Geometry.from_polygon(box(0, 0, 6, 6), thin_walls=[[(1, 3), (3, 3), (5, 3)]])
    whole = Geometry.from_polygon(box(0, 0, 6, 6), thin_walls=[[(1, 3), (5, 3)]])
    ends = []
    for geometry in (pieces, whole):
        bodies = make_bodies([0.2], 80.0, desired_speed=1.5, relaxation_time=0.3)
        state = make_state([[2.2, 2.9 - 0.11]], [[1.0, 0.0]])
        command = np.array([[0.8, 0.6]])
        scheme = tight(SCHEMES[name])
        if isinstance(scheme, Hertz):  # friction remembers every piece by itself
            scheme = replace(scheme, wall_friction=0.0)
        simulation = Simulation(geometry, bodies, state, physics=Physics(scheme, dt=0.01))
        simulation.advance(command, relative=np.array([False]), n_substeps=120)
        ends.append(state.position[0])
    assert ends[0][0] > 3.2
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


@every_scheme
@looped("side", [1, -1])
def test_a_thin_wall_pushes_to_the_side_one_stands_on(name, side):
    simulation = stand(THIN, [2.0, 3 + 0.2 * side], scheme=tight_grain(name))
    simulation.advance(external_force=np.array([[0.0, -200.0 * side]]), n_substeps=50)
    assert simulation.results.impulse[0, 1] * side > 0
    assert side * (simulation.state.position[0, 1] - 3) > 0.15


@looped("geometry", [half_plane(), plain()], ids=["wall", "person"])
def test_who_is_thrown_farther_than_anyone_was_fast_does_not_end_in_what_is_there(geometry):
    # All are at rest.  An overlap of 5 cm throws the light one over a gap of 3 cm to the wall, or to the third.
    bodies = make_bodies([0.2] * 3, [4000.0, 40.0, 4000.0])
    state = make_state([[0.58, 0.0], [0.23, 0.0], [-0.2 if geometry.contains([[-0.2, 0.0]]).all() else 5.0, 0.0]])
    Simulation(geometry, bodies, state, physics=INERTIAL, driving=False, fields=[None]).advance()
    heavy, light, third = state.position[:, 0]
    assert heavy - light > 0.4 - 1e-9
    assert (light - third if third < 0 else light + 0.2) > 0.4 - 1e-9


@every_scheme
@looped("height", [0.15, 0.05, 0.0, -0.05, -0.09])
def test_a_center_pressed_through_the_wall_is_pushed_back_inside(name, height):
    if height < 0 and name.startswith("nsm1"):  # would have no overlap left at the end of the step
        with pytest.raises(FloatingPointError, match=r"would move 0.2\d m in one step near .*its radius of 0.2 m"):
            stand(half_plane(), [height, 0.0], scheme=tight_grain(name), dt=0.001)
        return
    simulation = stand(half_plane(), [height, 0.0], scheme=tight_grain(name), dt=0.001)
    contacts = simulation.contacts()
    assert contacts.gap == pytest.approx([height - 0.2], abs=1e-12)
    np.testing.assert_allclose(contacts.normal, [[1, 0]])
    simulation.advance(external_force=np.array([[-300.0, 0.0]]), n_substeps=300)
    if name.startswith("nsm2"):  # acts on velocities alone: goes no deeper
        assert simulation.state.position[0, 0] == pytest.approx(height, abs=1e-3)
    else:
        assert simulation.state.position[0, 0] > 0.15


@every_scheme
def test_a_door_jamb_between_two_rooms_holds_from_both_sides(name):
    # The wall between two rooms, 0.3 m thick: nobody on one side feels the other side of it.
    rooms = Geometry.from_polygon(
        [box(0, 0, 3, 4), box(3.3, 0, 6, 4), box(3, 1.5, 3.3, 2.5)],
    )
    left = stand(rooms, [2.82, 0.8], scheme=tight_grain(name)).contacts()
    right = stand(rooms, [3.48, 0.8], scheme=tight_grain(name)).contacts()
    for contacts, normal in ((left, [-1, 0]), (right, [1, 0])):
        touching = contacts.gap < 0
        np.testing.assert_allclose(contacts.gap[touching], [-0.02], atol=1e-9)
        np.testing.assert_allclose(contacts.normal[touching], [normal], atol=1e-9)


@every_scheme
def test_a_slim_partition_is_one_touch_and_keeps_its_side(name):
    # 6 cm of wall: a deep touch on the left must not feel the right face, neither as a second push nor as a pull through.
    rooms = Geometry.from_polygon([box(0, 0, 3, 4), box(3.06, 0, 6, 4), box(3, 1.5, 3.06, 2.5)])
    for depth in (0.02, 0.1, 0.17):
        contacts = stand(rooms, [3.0 - 0.2 + depth, 0.8], scheme=tight_grain(name), dt=0.001).contacts()
        touching = contacts.gap < 0
        np.testing.assert_allclose(contacts.gap[touching], [-depth], atol=1e-9)
        np.testing.assert_allclose(contacts.normal[touching], [[-1, 0]], atol=1e-9)


# ----------------------------------------------------------------------------------------------------- odd positions


@every_scheme
def test_coincident_centers_part_without_nan(name):
    simulation = stand(plain(), [[1.0, 1.0], [1.0, 1.0]], scheme=tight_grain(name), dt=0.001)
    simulation.advance(n_substeps=100)
    assert np.isfinite(simulation.state.position).all()
    assert np.isfinite(simulation.state.velocity).all()
    assert simulation.contacts().normal.shape[1] == 2


@every_scheme
def test_a_center_on_a_corner_gives_no_nan(name):
    simulation = stand(BLOCK, [4.0, 4.0], scheme=tight_grain(name), dt=0.001)
    simulation.advance(n_substeps=100)
    assert np.isfinite(simulation.state.position).all()
