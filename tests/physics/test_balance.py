"""People who stand keep their balance: an inverted pendulum with a limited ankle, which steps where that is not enough."""

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box
from simulations import simulate

from crowd_env import SCHEMES, CrowdEnv, Geometry, Physics, Population, Scenario, make_scenario
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.core.behaviors.balance import Balance, places_of_feet, places_of_heads
from crowd_env.physics.balance import GRAVITY
from crowd_env.physics.helbing import Helbing

DRIVEN = [name for name, scheme in SCHEMES.items() if scheme.drives and "-" not in name.removesuffix("-inertial")]
HALL = Geometry.from_polygon(box(-5, -5, 5, 5))
RATE = np.sqrt(GRAVITY / Balance().height)  # 1/s
NEVER = Balance(gain=0.2, reaction=1e3)  # lifts a foot


def standing(position, velocity=None, *, balance="stepping", scheme="nsm2", environments=1, **options):
    """Return people of 80 kg who have stood for a step, and then get a velocity; command them by `stay`."""
    position = np.asarray(position, dtype=float)
    people = len(position)
    start = people // environments * np.arange(environments + 1)
    bodies = make_bodies(np.full(people, 0.15), np.full(people, 80.0), desired_speed=1.3, env_start=start)
    state = make_state(position, environments=environments)
    simulation = simulate(HALL, bodies, state, scheme=scheme, balance=balance, **options)
    if velocity is not None:
        stay(simulation, simulation.dt)
        simulation.state.velocity[:] = velocity
    return simulation


def stay(simulation, seconds, force=None, command=0.0):
    """Let so much time go by; commands are along x."""
    asked = np.zeros_like(simulation.state.position)
    asked[:, 0] = command
    world = np.zeros(len(asked), dtype=bool)
    simulation.advance(asked, relative=world, external_force=force, n_substeps=round(seconds / simulation.dt))


@looped("scheme", DRIVEN)
def test_beyond_the_ankle_the_body_falls_as_a_cosh(scheme):
    simulation = standing([(0.0, 0.0)], scheme=scheme, balance=NEVER, dt=0.001)
    stay(simulation, 0.001)
    simulation.history.memory.balance.feet[:] -= np.tile([0.3, 0.0], 2)  # the feet are now 0.3 m behind
    edge, before = NEVER.base - 0.3, simulation.state.position[0, 0] - NEVER.base + 0.3
    for k in range(1, 5):
        stay(simulation, 0.1)
        lean = simulation.state.position[0, 0] - edge
        speed = simulation.state.velocity[0, 0]
        np.testing.assert_allclose(lean, before * np.cosh(0.1 * k * RATE), rtol=0.01)
        # Energy of the inverted pendulum about the center of pressure, which does no work.
        np.testing.assert_allclose(speed**2 - (RATE * lean) ** 2, -((RATE * before) ** 2), rtol=0.03)
    assert places_of_heads(simulation)[0, 0] == pytest.approx(1.7 * (simulation.state.position[0, 0] + 0.3) - 0.3)


@looped("scheme", DRIVEN)
def test_a_capture_point_in_the_support_comes_back_and_one_beyond_does_not(scheme):
    least = NEVER.base * RATE  # m/s, whose capture point is at the edge
    simulation = standing(
        [(0.0, -1.0), (0.0, 1.0)], [(0.97 * least, 0.0), (1.03 * least, 0.0)], scheme=scheme, balance=NEVER
    )
    feet = np.repeat(simulation.state.position[:, None], 2, axis=1)
    stay(simulation, 2.0)
    assert simulation.state.position[1, 0] > 0.3
    stay(simulation, 8.0)
    np.testing.assert_allclose(places_of_feet(simulation)[0], feet[0], atol=1e-12)
    np.testing.assert_allclose(simulation.state.position[0], feet[0, 0], atol=1e-3)
    assert np.abs(simulation.state.velocity[0]).max() < 1e-3


@looped("scheme", DRIVEN)
def test_the_capture_point_decays_at_the_rate_of_the_gain(scheme):
    speed = 0.5 * Balance().base * RATE / (1.0 + Balance().gain)
    simulation = standing([(0.0, 0.0)], [(speed, 0.0)], scheme=scheme, dt=0.001)
    stay(simulation, 1.0)
    capture = simulation.state.position[0, 0] + simulation.state.velocity[0, 0] / RATE
    np.testing.assert_allclose(capture, speed / RATE * np.exp(-Balance().gain * RATE), rtol=0.02)


@looped("scheme", DRIVEN)
def test_who_is_pushed_too_hard_steps_under_the_capture_point_and_comes_to_rest_between_the_feet(scheme):
    rules = Balance(base=0.12)
    simulation = standing([(0.0, 0.0)], [(0.6 * 0.8, 0.6 * 0.6)], scheme=scheme, balance=rules)
    stay(simulation, 5.0 * simulation.dt)
    assert not simulation.history.memory.balance.feet[0].any() and np.isfinite(
        simulation.history.memory.balance.lands_at[0]
    )
    ahead = places_of_feet(simulation)[0, 1]
    assert not ahead.any()  # not lifted yet
    while np.isfinite(simulation.history.memory.balance.lands_at[0]):
        state = simulation.state
        capture, before = state.position[0] + state.velocity[0] / RATE, ahead
        ahead = places_of_feet(simulation)[0, 1]
        assert np.linalg.norm(ahead) >= np.linalg.norm(before)
        stay(simulation, simulation.dt)
    np.testing.assert_allclose(simulation.history.memory.balance.feet[0, 2:], capture, atol=0.01)
    np.testing.assert_allclose(ahead, capture, atol=0.03)  # it went there without a jump
    np.testing.assert_allclose(capture[1] / capture[0], 0.75, rtol=1e-6)
    assert not simulation.history.memory.balance.feet[0, :2].any()
    stay(simulation, 15.0)
    np.testing.assert_allclose(simulation.state.position[0], 0.5 * capture, atol=0.01)


@looped("scheme", DRIVEN)
def test_no_step_is_longer_than_it_may_be_and_the_ground_gives_no_more_than_its_grip(scheme):
    rules = Balance(base=0.12, step=0.5)
    simulation = standing([(0.0, 0.0)], [(1.8, 0.0)], scheme=scheme, balance=rules)
    fastest, feet = 0.0, simulation.history.memory.balance.feet
    for _ in range(100):
        before = simulation.state.velocity.copy()
        stay(simulation, 0.01)
        fastest = max(fastest, float(np.abs(simulation.state.velocity - before).max() / 0.01))
        assert np.hypot(*(feet[0, 2:] - feet[0, :2])) <= rules.step + 1e-12
    assert fastest == pytest.approx(rules.grip * GRAVITY, rel=1e-6)


def test_the_first_step_of_a_pedestrian_that_begins_to_stand_at_speed_is_no_longer_than_a_step():
    rules = Balance(step=0.2)
    simulation = standing([(-2.0, 0.0)], balance=rules)
    stay(simulation, 2.0, command=1.0)
    here, speed = simulation.state.position[0, 0], simulation.state.velocity[0, 0]
    assert speed / RATE > 1.5 * rules.step  # the capture point is further away
    stay(simulation, simulation.dt)
    np.testing.assert_allclose(np.sort(places_of_feet(simulation)[0, :, 0]), [here, here + rules.step], atol=1e-9)


def test_the_foot_further_from_the_capture_point_is_lifted():
    """Four pedestrians with their feet 0.3 m to either side, in both orders, are pushed to either side."""
    side, first = np.array([1.0, 1.0, -1.0, -1.0]), np.array([0.3, -0.3, 0.3, -0.3])
    rules = Balance(base=0.215)  # one step is enough
    simulation = standing(np.column_stack([np.zeros(4), np.arange(-3.0, 5.0, 2.0)]), balance=rules)
    stay(simulation, simulation.dt)
    feet = simulation.history.memory.balance.feet
    feet[:, 0], feet[:, 2] = first, -first
    simulation.state.velocity[:, 0] = 2.0 * side
    stay(simulation, rules.reaction + 0.5 * rules.swing)
    np.testing.assert_allclose(places_of_feet(simulation)[:, 0, 0], 0.3 * side)  # the nearer one carries meanwhile
    stay(simulation, 0.5 * rules.swing + 0.05)
    np.testing.assert_allclose(places_of_feet(simulation)[:, 0, 0], 0.3 * side)
    assert (side * places_of_feet(simulation)[:, 1, 0] > 0.5).all()  # the other one has landed beyond it


def test_a_lone_pushed_person_moves_alike_under_all_schemes():
    found = []
    for scheme in DRIVEN:
        simulation = standing([(0.0, 0.0)], scheme=scheme, dt=0.002)
        stay(simulation, 0.3, np.array([[150.0, 60.0]]))
        way = []
        for _ in range(15):
            stay(simulation, 0.1)
            way.append(places_of_heads(simulation)[0])
        found.append(way)
    assert np.max(found[0]) > 0.2
    np.testing.assert_allclose(found, np.broadcast_to(found[0], np.shape(found)), atol=0.004)


# Arms, of people whose ankles bear nothing: the pendulum is far too slow to matter.
LOOSE = {"height": 1e9, "reaction": 1e3}
# Without a force that acts at the same distance.
ALONE = {"hertz": {"name": "hertz", "social": "none"}, "helbing": Helbing(social=None)}


def approaching(scheme, gap=0.4, mass=(60.0, 90.0), speed=(0.5, -0.3), *, dt=None, **parameters):
    """Return two people of different mass who approach head-on, with their trunks ``gap`` apart."""
    simulation = standing(
        [(-0.15 - 0.5 * gap, 0.0), (0.15 + 0.5 * gap, 0.0)],
        balance=Balance(**LOOSE, **parameters),
        scheme=ALONE.get(scheme, scheme),
        dt=dt,
    )
    simulation.bodies.mass[:] = mass
    stay(simulation, simulation.dt)
    simulation.state.velocity[:, 0] = speed
    return simulation


@looped("scheme", DRIVEN)
def test_arms_brake_two_who_approach_by_a_factor_of_e_on_each_length_that_they_give(scheme):
    """The closing speed is w_0 up to the reach, then w_0 exp(-s / l) over the way s, or w_0 / (1 + w_0 t / l) over time."""
    arms, give, closing = 0.15, 0.05, 0.8
    simulation = approaching(scheme, arms=arms, give=give, dt=0.001)
    gaps, speeds = [], []
    for _ in range(90):
        stay(simulation, 0.01)
        gaps.append(np.diff(simulation.state.position[:, 0])[0] - 0.3)
        speeds.append(-np.diff(simulation.state.velocity[:, 0])[0])
    way = np.clip(arms - np.array(gaps), 0.0, None)
    assert way[5] == 0.0 and 0.1 < way[-1] < arms  # it ends before the trunks touch
    np.testing.assert_allclose(speeds, closing * np.exp(-way / give), rtol=0.02)
    np.testing.assert_allclose(way[-1], give * np.log1p(closing / give * (0.9 - (0.4 - arms) / closing)), rtol=0.02)


@looped("scheme", DRIVEN)
def test_arms_push_both_alike_whatever_their_masses(scheme):
    mass = np.array([60.0, 90.0])
    simulation = approaching(scheme, mass=mass)
    before = mass @ simulation.state.velocity
    stay(simulation, 0.8)
    assert np.abs(simulation.state.velocity[:, 0] - (0.5, -0.3)).max() > 0.3
    np.testing.assert_allclose(mass @ simulation.state.velocity, before, atol=1e-5)


@looped("scheme", DRIVEN)
def test_no_pair_gets_energy_from_arms_nor_is_turned_around_by_a_long_step(scheme):
    generator = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(8) * 0.42, np.arange(8) * 0.42)
    start = np.column_stack([x.ravel(), y.ravel()]) - 1.5
    fast = generator.uniform(-1.5, 1.5, start.shape)
    simulation = standing(start, fast, scheme=ALONE.get(scheme, scheme), balance=Balance(**LOOSE, arms=0.2, give=0.02))
    energy, momentum = [], []
    for _ in range(round(0.1 / simulation.dt)):
        assert not (simulation.contacts().gap < 0.0).any()  # arms alone act
        energy.append(float(np.sum(simulation.state.velocity**2)))
        momentum.append(simulation.state.velocity.sum(axis=0))
        stay(simulation, simulation.dt)
    assert all(np.diff(energy) < 0.0) and energy[-1] < 0.8 * energy[0]
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], np.shape(momentum)), atol=1e-5)
    hasty = approaching(scheme, gap=0.1, speed=(4.0, -4.0), arms=0.2, give=0.02, mass=(80.0, 80.0))
    stay(hasty, hasty.dt)
    assert 0.0 < -np.diff(hasty.state.velocity[:, 0])[0] < 6.0


@looped("scheme", DRIVEN)
@pytest.mark.parametrize(
    "gap, speed", [(0.4, (0.05, -0.05)), (0.1, (-0.2, 0.2)), (-0.002, (0.0, 0.0))], ids=["beyond", "apart", "touching"]
)
def test_arms_do_nothing_beyond_their_reach_nor_to_who_moves_apart_or_rests_at_a_trunk(scheme, gap, speed):
    ways = []
    for arms in (0.0, 0.2):
        simulation = approaching(scheme, gap, speed=speed, arms=arms)
        stay(simulation, 0.5)
        ways.append(simulation.state.position.tobytes() + simulation.state.velocity.tobytes())
    assert ways[0] == ways[1]


@looped("scheme", DRIVEN)
def test_arms_are_of_two_who_stand(scheme):
    """Who walks into a standing pedestrian does so as without arms, up to the touch."""
    ways = []
    for arms in (0.0, 0.2):
        simulation = standing([(-0.6, 0.0), (0.0, 0.0)], scheme=ALONE.get(scheme, scheme), balance=Balance(arms=arms))
        stay(simulation, 0.8, command=np.array([0.5, 0.0]))
        assert -0.48 < simulation.state.position[0, 0] < -0.3
        ways.append(simulation.state.position.tobytes())
    assert ways[0] == ways[1]


def crowd(threads=1, scheme="nsm2", people=12, rows=6):
    """Return a batch of crowds that are pushed together, after two seconds."""
    x, y = np.meshgrid(np.arange(people) * 0.32, np.arange(rows) * 0.8)
    position = np.column_stack([x.ravel() - 2.0, y.ravel() - 2.0])
    simulation = standing(position, scheme=scheme, environments=rows, threads=threads)
    force = np.zeros_like(position)
    force[::people, 0] = 250.0 * (1.0 + np.arange(rows))
    stay(simulation, 0.6, force)
    stay(simulation, 1.4)
    return simulation


@looped("scheme", DRIVEN)
def test_bits_depend_on_no_thread_and_no_neighbor_in_the_batch(scheme):
    one, two, last = crowd(1, scheme), crowd(2, scheme), crowd(1, scheme)
    assert (
        one.history.memory.balance.feet.any()
        and (one.history.memory.balance.feet[:, :2] != one.history.memory.balance.feet[:, 2:]).any()
    )
    for simulation in (two, last):
        assert simulation.state.position.tobytes() == one.state.position.tobytes()
        assert simulation.history.memory.balance.feet.tobytes() == one.history.memory.balance.feet.tobytes()
    x = np.arange(12) * 0.32
    alone = standing(np.column_stack([x - 2.0, np.full(12, 2.0)]), scheme=scheme)
    force = np.zeros((12, 2))
    force[0, 0] = 1500.0
    stay(alone, 0.6, force)
    stay(alone, 1.4)
    assert alone.state.position.tobytes() == one.state.position[60:].tobytes()


@pytest.mark.more
@looped("scheme", ["dem", "nsm2"])
def test_a_large_crowd_is_the_same_on_any_number_of_threads_and_has_its_feet_in_its_slots(scheme):
    found = []
    for threads in (1, 2):
        x, y = np.meshgrid(np.linspace(-4.5, 4.5, 36), np.linspace(-4.5, 4.5, 36))
        generator = np.random.default_rng(3)
        start = generator.permutation(np.column_stack([x.ravel(), y.ravel()]))
        velocity = generator.uniform(-1.0, 1.0, start.shape)  # so that the order of space changes
        simulation = standing(start, velocity, scheme=scheme, threads=threads)
        stay(simulation, 0.3)
        stay(simulation, 0.4)
        found.append(places_of_feet(simulation))
        assert np.hypot(*(found[-1][:, 0] - start).T).max() < 2.0  # a wrong slot is further off
        assert np.abs(found[-1][:, 1] - found[-1][:, 0]).max() > 0.1
    assert found[0].tobytes() == found[1].tobytes()


@looped("scheme", DRIVEN)
def test_who_walks_does_so_bit_by_bit_as_without_balance(scheme):
    ways = []
    for balance in (None, "stepping"):
        simulation = standing([(-2.0, 0.0), (-1.5, 0.0), (1.0, 0.1)], scheme=scheme, balance=balance)
        for k in range(10):
            stay(simulation, 0.1, command=np.array([1.0, 1.0, -0.5 - 0.05 * k]))
        ways.append(simulation.state.position.tobytes())
    assert ways[0] == ways[1]


def test_feet_are_under_the_body_of_who_walks_and_stay_where_he_stops():
    simulation = standing([(0.0, 0.0)])
    stay(simulation, 2.0, command=1.0)
    np.testing.assert_array_equal(places_of_feet(simulation)[0], np.tile(simulation.state.position, (2, 1)))
    here, speed = simulation.state.position[0, 0], simulation.state.velocity[0, 0]
    stay(simulation, 10.0)
    feet = places_of_feet(simulation)[0, :, 0]
    np.testing.assert_allclose(feet, [here, here + speed / RATE], atol=0.02)  # one more step, under the capture point
    assert simulation.state.position[0, 0] == pytest.approx(feet.mean(), abs=0.01)
    simulation.restart(0, simulation.bodies, np.array([(1.0, 0.0)]))
    stay(simulation, 0.1)
    np.testing.assert_allclose(places_of_feet(simulation)[0, :, 0], 1.0)


@looped("scheme", DRIVEN)
def test_a_checkpoint_holds_the_feet(scheme):
    simulation = standing([(0.0, 0.0), (0.32, 0.0)], [(0.9, 0.0), (0.0, 0.0)], scheme=scheme)
    stay(simulation, 0.8)
    kept, feet, push = (
        simulation.checkpoint(),
        simulation.history.memory.balance.feet.copy(),
        np.array([[0.0, 0.0], [0.0, 300.0]]),
    )
    stay(simulation, 0.4, push)
    stay(simulation, 1.0)
    expected = places_of_heads(simulation).tobytes()
    assert (simulation.history.memory.balance.feet != feet).any()
    simulation.restore(kept)
    stay(simulation, 0.4, push)
    stay(simulation, 1.0)
    assert places_of_heads(simulation).tobytes() == expected
    with pytest.raises(ValueError, match="its balance differs"):
        standing([(0.0, 0.0), (0.32, 0.0)], balance=None, scheme=scheme).restore(kept)


def place(**options):
    """Return a room with a few people who stand at first."""
    geometry = Geometry.from_polygon(box(0, 0, 6, 4), exits={"east": [(6, 1), (6, 3)]})
    return Scenario("hall", geometry, Population(6, response_time=2.0), 20.0, **options)


def test_scenario_physics_and_files_say_how_people_keep_upright(tmp_path):
    assert CrowdEnv(place()).simulation.behaviors["balance"] is None
    assert CrowdEnv(place(balance="stepping")).simulation.behaviors["balance"] == Balance()
    assert CrowdEnv(place(balance="stepping"), physics=Physics(balance="none")).simulation.behaviors["balance"] is None
    assert CrowdEnv(place(), physics={"balance": {"base": 0.12}}).simulation.behaviors["balance"] == Balance(base=0.12)
    path = tmp_path / "hall.toml"
    path.write_text(
        "balance = {base = 0.12}\n[geometry]\nwalkable = [[0, 0], [6, 0], [6, 4], [0, 4]]\n"
        "exits = {east = [[6, 1], [6, 3]]}\n[population]\npeople = 3\n"
    )
    assert make_scenario(path).balance == Balance(base=0.12)
    assert Balance.plain_of(Balance()) == "stepping" and Balance.plain_of(None) == "none"
    assert Balance.of(Balance.plain_of(Balance(base=0.12))) == Balance(base=0.12)


def test_what_cannot_be_balanced_is_refused():
    with pytest.raises(ValueError, match="nsm1 has no force of the ground"):
        Physics("nsm1", balance="stepping")
    with pytest.raises(ValueError, match="passive grains"):
        standing([(0.0, 0.0)], driving=False)
    with pytest.raises(ValueError, match="unknown balance 'leaning'; known: none, stepping"):
        place(balance="leaning")
    with pytest.raises(ValueError, match="base"):
        Balance(base=0.0)
    with pytest.raises(ValueError, match="arms"):
        Balance(arms=-0.1)
    with pytest.raises(ValueError, match=r"have one balance, not none in .*, stepping in"):
        CrowdEnv([place(), place(balance="stepping")], num_envs=2)
    with pytest.raises(ValueError, match="have no feet here"):
        places_of_feet(standing([(0.0, 0.0)], balance=None))
