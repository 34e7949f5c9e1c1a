"""Contact forces as a picture: as wide as they are large, and in balance with what pushes."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from late import late

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import DEM, NSM1, NSM2, Hertz
from crowd_env.physics.pressure import ContactForces, contact_forces, mean_contact_forces
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.recording import record
from crowd_env.rendering import force_network, forces_of, save_figure
from crowd_env.rendering.palette import WALL
from crowd_env.scenarios import make_scenario

late("matplotlib")

HALL = Geometry.from_polygon([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
ROOM = Geometry.from_polygon([(0, 0), (5, 0), (5, 5), (0, 5)], exits={"door": [(5, 2), (5, 3)]})
LONG = Geometry.from_polygon([(0, 0), (40, 0), (40, 20), (0, 20)], exits=[[(40, 9), (40, 10)], [(0, 2), (0, 3)]])
# Whoever wants to stand still comes to rest within tau, also under schemes whose contacts do not damp.
AT_REST = {
    "dem": DEM(),
    "hertz": Hertz(social=None),
    "hertz, critical damping": Hertz(damping_unit="critical", social=None),
    "nsm1, inertial": NSM1("inertial", tolerance=1e-10),
    "nsm2": NSM2(tolerance=1e-10),
}


def forces_in(geometry=ROOM, position=((1.0, 1.0), (1.5, 1.0), (2.0, 1.0)), force=(100.0, 300.0, -50.0), active=None):
    """Three people in a row, the first of whom touches the wall below; a pull comes last."""
    position = np.array(position, dtype=float)
    return ContactForces(
        geometry=geometry,
        time=3.0,
        position=position,
        radius=np.full(len(position), 0.25),
        active=np.ones(len(position), dtype=bool) if active is None else np.array(active),
        i=np.array([0, 1, 0]),
        j=np.array([1, 2, -1]),
        at=np.array([position[1], position[2], position[0] - (0.0, 0.25)]),
        force=np.array(force),
    )


def drawn_lines(figure):
    (lines,) = (c for axes in figure.axes for c in axes.collections if c.get_label() == "forces")
    return lines


# ------------------------------------------------------------------------------------------------------------- forces


@pytest.mark.parametrize("scheme", AT_REST)
def test_a_wall_answers_with_the_force_that_pushes_someone_into_it(scheme):
    bodies = make_bodies([0.25], [80.0], desired_speed=0.0)
    simulation = Simulation(ROOM, bodies, make_state([[0.25, 2.0]]), physics=AT_REST[scheme])
    simulation.advance(n_substeps=round(15.0 / simulation.dt), external_force=np.array([[-500.0, 0.0]]))
    told = contact_forces(simulation)
    assert (told.i.tolist(), told.force) == ([0], pytest.approx([500.0], rel=1e-4))
    assert told.j[0] < 0
    assert told.at[0] == pytest.approx((0.0, 2.0), abs=1e-6)
    assert told.time == pytest.approx(15.0)


def test_a_row_of_people_hands_on_what_each_adds():
    state = make_state([[0.25, 5.0], [0.75, 5.0], [1.25, 5.0]])
    simulation = Simulation(
        HALL, make_bodies([0.25] * 3, [60.0, 80.0, 100.0]), state, physics=AT_REST["nsm1, inertial"], driving=False
    )
    simulation.advance(n_substeps=20, external_force=np.tile([-300.0, 0.0], (3, 1)))
    told = contact_forces(simulation)
    found = {
        (int(i), min(int(j), 9) if j >= 0 else "wall"): force
        for i, j, force in zip(told.i, told.j, told.force, strict=True)
    }
    assert found == {(0, 1): pytest.approx(600.0), (1, 2): pytest.approx(300.0), (0, "wall"): pytest.approx(900.0)}


def test_forces_are_those_of_one_environment_in_its_own_numbers():
    env = CrowdEnv("room-v0", num_envs=2, physics="dem")
    env.reset(seed=3)
    for _ in range(20):
        env.step(None)
    told, listed = contact_forces(env.simulation, 1), env.simulation.contacts(1)
    here = env.people(1)
    inside = env.active[here]
    kept = inside[listed.i] & ((listed.j < 0) | inside[listed.j])
    assert kept.any() and told.i.max() < len(told.radius) == 20
    assert told.force == pytest.approx(listed.impulse[kept, 0] / 0.01)
    between = told.j >= 0
    assert (told.at[between] == env.simulation.state.position[here][told.j[between]]).all()


def test_the_mean_takes_a_missing_contact_for_no_force_and_forgets_who_left():
    one = forces_in(force=(100.0, 200.0, 40.0))
    two = one._replace(i=one.i[:2], j=one.j[:2], at=one.at[:2], force=np.array([300.0, 0.0]), time=3.1)
    mean = mean_contact_forces([one, two])
    found = dict(zip(zip(mean.i.tolist(), mean.j.tolist(), strict=True), mean.force, strict=True))
    assert found == {(0, 1): 200.0, (1, 2): 100.0, (0, -1): 20.0}
    assert mean.time == 3.1
    assert mean.at[mean.j < 0].tolist() == [[1.0, 0.75]]
    left = mean_contact_forces([one, two._replace(active=np.array([True, True, False]))])
    assert sorted(zip(left.i.tolist(), left.j.tolist(), strict=True)) == [(0, -1), (0, 1)]
    with pytest.raises(ValueError, match="at least one"):
        mean_contact_forces([])


# ------------------------------------------------------------------------------------------------------------ picture


def test_widths_are_proportional_to_forces_and_pulls_are_not_drawn():
    force = np.array([100.0, 300.0, 20.0])
    lines = drawn_lines(force_network(forces_in(force=force)))
    order = np.argsort(force)
    assert lines.get_linewidths() / lines.get_linewidths()[-1] == pytest.approx(force[order] / 300.0)
    assert len(drawn_lines(force_network(forces_in())).get_linewidths()) == 2


def test_lines_join_centers_and_the_point_of_the_wall():
    forces = forces_in(force=(100.0, 300.0, 200.0))
    figure = force_network(forces)
    first, wall, second = (np.array(segment) for segment in drawn_lines(figure).get_segments())
    meter = np.linalg.norm(first[1] - first[0]) / 0.5
    assert (first[1] == second[0]).all() and (first[0] == wall[0]).all()
    assert (wall[1] - wall[0]) / meter == pytest.approx((0.0, 0.25))  # y of pixels points down
    width, height = figure.get_size_inches() * figure.dpi
    assert ((first > 0) & (first < (width, height))).all()


@pytest.mark.more
def test_the_picture_shows_walls_and_the_widths_of_its_legend_are_those_of_the_lines(tmp_path):
    from PIL import Image

    path = save_figure(force_network(forces_in(force=(100.0, 500.0, 10.0)), title="three"), tmp_path / "a.png")
    assert (np.asarray(Image.open(path).convert("RGB")) == WALL).all(axis=-1).mean() > 0.01
    figure = force_network(forces_in(force=(100.0, 500.0, 10.0)))
    (legend,) = figure.legends
    told = {float(text.get_text().removesuffix(" N")) for text in legend.get_texts()[1:]}
    assert told == {100.0, 200.0, 500.0}
    widths = sorted(line.get_linewidth() for line in legend.get_lines()[1:])
    assert widths == pytest.approx(max(drawn_lines(figure).get_linewidths()) * np.array([0.2, 0.4, 1.0]))


@pytest.mark.more
def test_a_big_place_is_cut_to_the_exit_at_which_people_press():
    people = np.array([(38.0, 9.0), (38.5, 9.0), (39.0, 9.0)])
    segments = np.array(drawn_lines(force_network(forces_in(LONG, people))).get_segments())
    whole = np.array(drawn_lines(force_network(forces_in(LONG, people), around=np.inf)).get_segments())

    def meter(lines):
        return np.linalg.norm(lines[0, 1] - lines[0, 0]) / 0.5

    assert meter(segments) > 5.0 * meter(whole)
    figure = force_network(forces_in(LONG, people - (37.0, 7.0)))
    x, y = np.array(drawn_lines(figure).get_segments()).reshape(-1, 2).T
    width, height = figure.get_size_inches() * figure.dpi
    assert (x > 0).all() and (x < width).all() and (y > 0).all() and (y < height).all()


@pytest.mark.more
@looped("geometry", [HALL, ROOM, LONG])
def test_nobody_who_presses_is_a_picture_too(geometry, tmp_path):
    nothing = forces_in(geometry, force=(0.0, 0.0, 0.0), active=[False] * 3)
    path = save_figure(force_network(nothing), tmp_path / "a.png")
    assert path.stat().st_size > 1000 and [file.name for file in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.more
@looped("around", [0.0, np.nan])
def test_nonsense_is_refused(around, tmp_path):
    with pytest.raises(ValueError, match="must be > 0"):
        force_network(forces_in(), around=around)
    with pytest.raises(ValueError, match=r"must end in \.png"):
        save_figure(force_network(forces_in()), tmp_path / "a.svg")


# -------------------------------------------------------------------------------------------------------- which moment


def test_the_forces_of_a_recording_are_the_mean_since_the_frame_before():
    told = forces_of(record("room-v0", scheme="nsm2", seed=2, contacts=True), at=1.95)
    env = CrowdEnv("room-v0", physics="nsm2")
    env.reset([2])
    for _ in range(19):
        env.step(None)
    samples = []
    for _ in range(env.n_substeps):
        env.simulation.advance()
        samples.append(contact_forces(env.simulation))
    mean, stays = mean_contact_forces(samples), env.simulation.state.active
    assert told.time == pytest.approx(2.0)
    assert (told.position == env.simulation.state.position)[stays].all() and (told.active == stays).all()

    def by_pair(forces):
        found = zip(forces.i.tolist(), forces.j.tolist(), forces.force.tolist(), strict=True)
        return {(i, j): force for i, j, force in found if abs(force) > 1e-9}

    # The recording adds up impulses as vectors; normals turn a little meanwhile.
    assert by_pair(told) == pytest.approx(by_pair(mean), rel=0.02) and len(by_pair(told)) > 5


def test_without_a_moment_it_is_that_of_the_hardest_push_or_the_end_of_a_blocked_run():
    env = CrowdEnv("room-v0", physics="dem")
    env.reset([4])
    borne = []
    while not env.finished.all():
        env.step(None)
        borne.append(env.simulation.results.impulse_magnitude.sum())
    kept = record("room-v0", scheme="dem", seed=4, contacts=True)
    assert forces_of(kept).time == pytest.approx(0.1 * (np.argmax(borne) + 1))
    # Whoever begins at rest is not out as soon as a free walk would be over.
    blocked = record(replace(make_scenario("room-v0"), blocked_after=0.01), scheme="dem", seed=4, contacts=True)
    told = forces_of(blocked)
    assert told.time == pytest.approx(blocked.times[-1]) and told.time < kept.times[-1] and told.active.all()
    with pytest.raises(ValueError, match=r"over after .* s; there are no forces at 50 s"):
        forces_of(kept, at=50.0)
    with pytest.raises(ValueError, match="the recording holds no contacts"):
        forces_of(replace(kept, contacts=None))
