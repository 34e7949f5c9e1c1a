"""What people decide at one moment: how fast, for whom they step aside, and whom they see."""

import math

import numpy as np
import pytest
import shapely
from cases import looped
from shapely.geometry import box
from walking_crowds import NUMBERS, decided, decided_by, drawn_crowd, manner, standing

from crowd_env import Geometry
from crowd_env.core.arrays.state import make_bodies

pytestmark = pytest.mark.kernels
STRAIGHT = manner(strength=0.0)
V0 = 1.3  # m/s


def ahead(gap, keeps=STRAIGHT, **options):
    """Return what someone decides who walks along x, with someone at rest at this gap [m] in front."""
    return decided(*standing([[0, 0], [0.4 + gap, 0]], [[1, 0], [0, 0]], keeps, **options))[0]


@looped("time_gap", [0.4, 1.1])
@looped("push", [0.0, 0.3, 1.0])
@looped("gap", [-0.05, 0.0, 0.1, 0.5, 1.0, 1.9])
def test_behind_someone_who_goes_nowhere_the_speed_is_the_gap_over_the_time_gap(time_gap, push, gap):
    velocity = ahead(gap, manner(strength=0.0, gain=1.0, time_gap=time_gap, push=push))
    assert velocity == pytest.approx([np.clip(max(gap, 0.0) / time_gap, push * V0, V0), 0.0], abs=1e-12)


@looped(
    ("way", "walks", "speed"),
    [
        ([1, 0], [0.0, 0.0], (0.5 - 0.1) / 1.2),  # who stands on the same way is left the standing gap
        ([1, 0], [0.6, 0.3], (0.5 - 0.1 + 0.4 * 0.6) / 1.2),  # who walks on leaves more room in a moment
        ([0.6, 0.8], [0.6, 0.8], (0.5 - 0.06 + 0.24 * 0.6) / 1.04),
        ([0, 1], [0.0, 0.6], 0.5 / 0.8),  # who crosses does neither
        ([-1, 0], [-0.6, 0.0], 0.5 / 0.8),
    ],
)
def test_the_speed_depends_on_where_the_other_goes(way, walks, speed):
    keeps = manner(strength=0.0, standing=0.1, anticipation=0.4, time_gap=0.8, gain=1.0)
    two = standing([[0, 0], [0.9, 0]], [[1, 0], way], keeps, velocity=[[0.0, 0.0], walks])
    assert decided(*two)[0] == pytest.approx([speed, 0.0], abs=1e-12)


def test_time_gap_and_push_of_a_person_come_before_those_of_the_manner():
    bodies = make_bodies(
        [0.2] * 4, [70.0] * 4, desired_speed=V0, time_gap=[2.0, 0.5] * 2, push=[np.nan, np.nan, 0.6, 0.1]
    )
    pairs = [[0, 0], [1, 0], [0, 10], [1, 10]]  # with a gap of 0.6 m
    velocity = decided(*standing(pairs, [[1, 0], [-1, 0]] * 2, STRAIGHT, bodies=bodies))
    assert velocity[:, 0] == pytest.approx([0.6 / 2.0, -0.6 / 0.5, 0.6 * V0, -0.6 / 0.5], abs=1e-12)


def test_nobody_beyond_the_range_of_sight_counts_and_nobody_behind():
    assert ahead(0.5, manner(strength=0.0, sight=0.49)) == pytest.approx([V0, 0.0])
    behind = decided(*standing([[0, 0], [-0.45, 0]], [[1, 0], [0, 0]], STRAIGHT))[0]
    assert behind == pytest.approx([V0, 0.0])


@looped("width", [0.5, 0.86, 1.2])
def test_only_bodies_in_the_strip_count(width):
    for across, is_free in ((0.4 * width - 1e-6, False), (0.4 * width + 1e-6, True)):
        velocity = decided(*standing([[0, 0], [0.5, across]], [[1, 0], [0, 0]], manner(strength=0.0, width=width)))[0]
        assert (velocity[0] == pytest.approx(V0)) == is_free


def test_of_two_who_would_give_way_to_each_other_the_one_further_ahead_goes_first():
    # Their ways meet under 86 degrees; each is in the strip of the other.
    ways = [[math.cos(a), math.sin(a)] for a in (math.radians(43), math.radians(-43))]
    velocity = decided(*standing([[0.03, -0.21], [0.0, 0.21]], ways, STRAIGHT))
    speed = np.hypot(*velocity.T)
    assert speed[0] == pytest.approx(V0)
    room = math.hypot(0.03, 0.42) - 0.4 - 0.1 * math.cos(math.radians(86))
    assert speed[1] == pytest.approx(room / (0.8 + 0.5 * math.cos(math.radians(86))))


def test_people_step_aside_away_from_where_the_other_will_be_and_to_the_right_if_that_is_straight_ahead():
    for across, walks, expected in ((0.1, 0.0, -1), (-0.1, 0.0, 1), (0.0, 0.0, -1), (0.1, -1.0, 1)):
        velocity = decided(
            *standing([[0, 0], [0.6, across]], [[1, 0], [0, 0]], manner(), velocity=[[0.0, 0.0], [0.0, walks]])
        )
        assert np.sign(velocity[0, 1]) == expected


@looped("keep_right", [0.15, 0.0, -0.15])
def test_oncoming_people_are_passed_on_the_right_unless_they_are_well_there(keep_right):
    for across in (-0.2, -0.1, -0.01, 0.01, 0.1, 0.2):
        two = standing([[0, 0], [0.6, across]], [[1, 0], [-1, 0]], manner(keep_right=keep_right))
        assert np.sign(decided(*two)[0, 1]) == (1 if across < -keep_right else -1)


def test_nobody_turns_back_and_who_pushes_fully_does_not_turn():
    crowd = drawn_crowd(np.random.default_rng(0), count=80)
    timid, headlong = (decided_by(crowd, manner(strength=5.0, push=push)) for push in (0.0, 1.0))
    along = np.einsum("ij,ij->i", timid, crowd["ways"])
    assert (along >= np.hypot(*timid.T) / math.sqrt(5.0) - 1e-9).all()  # atan 2 at most
    np.testing.assert_allclose(headlong, crowd["speed"][:, None] * crowd["ways"], rtol=0, atol=1e-12)


def test_who_does_not_give_way_walks_as_asked_and_others_see_that_person():
    simulation, asked = standing([[0, 0], [0.6, 0]], [[1, 0], [-1, 0]], STRAIGHT)
    velocity = decided(simulation, asked | {"gives_way": np.array([False, True])})
    assert velocity == pytest.approx(np.array([[V0, 0.0], [-0.2 / 0.8, 0.0]]))


def test_the_push_grows_with_the_time_that_one_stands_and_falls_back_when_one_walks():
    keeps = manner(strength=0.0, patience=1.0, impatience=0.25, interval=0.05, oncoming=8.0)
    for waited, velocity, other, push, then in (
        (0.5, 0.0, [1, 0], 0.0, 0.55),
        (1.5, 0.0, [1, 0], 0.25 * 0.5, 1.55),
        (1.5, 0.0, [-1, 0], 0.25 * 0.5, 1.95),  # against someone who comes the other way, nine times as fast
        (9.0, 0.0, [1, 0], 0.2, 9.05),
        (1.5, 0.1 * V0, [1, 0], 0.25 * 0.5, 1.5),  # who creeps
        (1.5, 1.0, [1, 0], 0.25 * 0.5, 1.45),
        (9.0, 1.0, [1, 0], 0.2, 1.75),
    ):
        simulation, asked = standing([[0, 0], [0.4, 0]], [[1, 0], other], keeps, velocity=[[velocity, 0.0], [0.0, 0.0]])
        simulation.history.memory.manner.waited[0] = waited
        assert decided(simulation, asked)[0] == pytest.approx([push * V0, 0.0], abs=1e-9)
        assert simulation.history.memory.manner.waited[0] == pytest.approx(then)


def test_who_has_not_responded_yet_does_not_wait_for_anyone():
    bodies = make_bodies([0.2] * 2, [70.0] * 2, desired_speed=V0, response_time=[30.0, 0.0])
    simulation, asked = standing(
        [[0, 0], [0.45, 0]], [[1, 0], [1, 0]], manner(patience=0.1, impatience=1.0), bodies=bodies
    )
    simulation.advance(**asked, n_substeps=40)
    assert simulation.history.memory.manner.waited[0] == 0.0
    assert not simulation.state.velocity[0].any()


# ------------------------------------------------------------------------------------------------------------ who is seen

WALL = [(1.0, -1.0), (1.0, 1.0)]


def seen_through(place, closed=()):
    """Return whether someone in front of a place at x = 1 slows down for someone behind it."""
    simulation, asked = standing([[0.7, 0], [1.3, 0]], [[1, 0], [0, 0]], STRAIGHT, place=place)
    simulation.close_doors(0, closed)
    return decided(simulation, asked)[0, 0] < V0 - 1e-9


def test_nobody_is_seen_through_a_wall_or_a_closed_door():
    hall = box(-3, -3, 5, 3)
    assert seen_through(Geometry.from_polygon(hall))
    assert not seen_through(Geometry.from_polygon(hall, thin_walls=[WALL]))
    assert not seen_through(Geometry.from_polygon(hall, obstacles=[box(0.95, -1, 1.05, 1)]))
    sides = [[(1, -3), (1, -1)], [(1, 1), (1, 3)]]
    gate = Geometry.from_polygon(hall, thin_walls=sides, doors={"gate": WALL})
    assert seen_through(gate)
    assert not seen_through(gate, closed=["gate"])


def test_a_door_that_opens_shows_who_is_behind_it_at_the_next_decision():
    sides = [[(1, -3), (1, -1)], [(1, 1), (1, 3)]]
    place = Geometry.from_polygon(box(-3, -3, 5, 3), thin_walls=sides, doors={"gate": WALL})
    simulation, asked = standing([[0.6, 0], [1.4, 0]], [[1, 0], [0, 0]], STRAIGHT, place=place)
    simulation.close_doors(0, ["gate"])
    simulation.advance(**asked)
    assert simulation.history.walking_velocity[0, 0] == pytest.approx(V0)
    simulation.close_doors(0, [])
    simulation.advance(**asked, n_substeps=5)
    assert simulation.history.walking_velocity[0, 0] < 0.5


# --------------------------------------------------------------------------------------------------------------- symmetry

PILLARS = [box(0.5, 0.5, 1.0, 1.1), box(-2.0, -1.2, -1.5, -1.1), box(-1.0, 1.3, -0.2, 1.5)]


def turned(crowd, matrix):
    """Return the crowd in other axes."""
    return crowd | {name: crowd[name] @ np.transpose(matrix) for name in ("position", "velocity", "ways")}


@pytest.mark.parametrize("name", ["turn by 45 degrees", "mirror image"])
def test_decisions_turn_with_the_place_and_are_mirrored_with_it(name):
    half = math.sqrt(0.5)
    matrix = np.array(
        {"turn by 45 degrees": [[half, -half], [half, half]], "mirror image": [[1.0, 0.0], [0.0, -1.0]]}[name]
    )
    numbers = [*matrix.ravel(), 0.0, 0.0]
    here = Geometry.from_polygon(box(-9, -9, 9, 9), obstacles=PILLARS)
    there = Geometry.from_polygon(
        shapely.affinity.affine_transform(box(-9, -9, 9, 9), numbers),
        obstacles=[shapely.affinity.affine_transform(pillar, numbers) for pillar in PILLARS],
    )
    for seed in range(3):
        crowd = drawn_crowd(np.random.default_rng(seed))
        expected = decided_by(crowd, manner(), here) @ matrix.T
        # In a mirror people keep to the other side.
        keeps = manner(keep_right=NUMBERS["keep_right"] * np.linalg.det(matrix))
        np.testing.assert_allclose(decided_by(turned(crowd, matrix), keeps, there), expected, rtol=0, atol=1e-9)


def test_two_who_meet_exactly_head_on_both_go_right_in_the_mirror_too():
    for sign in (1.0, -1.0):
        velocity = decided(*standing([[0, 0], [1.2, 0]], [[1, 0], [-1, sign * 0.0]], manner()))
        assert velocity[0, 1] < 0.0 < velocity[1, 1]


def test_decisions_do_not_depend_on_the_order_of_people():
    rng = np.random.default_rng(4)
    crowd = drawn_crowd(rng, count=120, side=8.0)
    order = rng.permutation(120)
    expected = decided_by(crowd, manner())[order]
    shuffled = {name: values[order] for name, values in crowd.items()}
    np.testing.assert_allclose(decided_by(shuffled, manner()), expected, rtol=0, atol=1e-12)


def test_decisions_do_not_depend_on_where_the_others_make_cells_begin():
    # Someone far away moves the cells and, in a crowd as sparse as that, makes them larger.
    crowd = drawn_crowd(np.random.default_rng(5), count=60)
    wide = Geometry.from_polygon(box(-100, -100, 100, 100))
    far = {"position": [[-80.3, 91.7]], "velocity": [[0, 0]], "ways": [[1, 0]], "radius": [0.4], "speed": [1.0]}
    more = {name: np.concatenate([values, far[name]]) for name, values in crowd.items()}
    np.testing.assert_allclose(decided_by(more, manner(), wide)[:-1], decided_by(crowd, manner()), rtol=0, atol=1e-12)


def test_every_number_of_a_manner_matters():
    # A field that the kernels do not read would be a promise without anything behind it.
    rng = np.random.default_rng(6)
    crowd, waited = drawn_crowd(rng, count=160, side=12.0), rng.uniform(0.0, 10.0, 160)
    crowd["velocity"][::2] = 0.0
    crowd["ways"][1::2] = crowd["velocity"][1::2] / np.hypot(*crowd["velocity"][1::2].T)[:, None]
    crowd["ways"][:, 0] = np.abs(crowd["ways"][:, 0])  # the same half of the world: there is someone to overtake

    def decisions(**changed: float) -> np.ndarray:
        return decided_by(crowd, manner(**({"push": 0.1} | changed)), waited=waited)

    plain = decisions()
    for name, value in NUMBERS.items():
        if name == "interval":
            continue  # counts for how long people wait: see above
        other = 0.9 if name == "gain" else 0.3 * value
        assert np.abs(decisions(**{name: other}) - plain).max() > 1e-6, name


# --------------------------------------------------------------------------------------------------------------- overtaking


@looped(
    ("wants", "walks", "others", "overtakes"),
    [
        (0.6, 0.6, [], True),
        (1.3, 0.7, [], False),  # held up itself
        (1.3, 0.7, [[1.5, 1.5, -1.0]], True),  # by someone who comes from the other side
        (1.3, 0.6, [[1.5, 1.5, -1.0]], False),  # and hardly walks
        (1.3, 0.7, [[1.5, 1.5, 1.0]], False),
        (0.0, 0.0, [], True),  # stands and wants to: no queue
    ],
)
def test_someone_slower_is_overtaken_but_not_in_a_queue(wants, walks, others, overtakes):
    count = 2 + len(others)
    bodies = make_bodies([0.2] * count, [70.0] * count, desired_speed=[V0, wants or V0, *[V0] * len(others)])
    place = [[0, 0], [0.9, 0.25], *([x, y] for x, y, _ in others)]
    ways = [[1, 0], [1.0 if wants else 0.0, 0], *([way, 0] for *_, way in others)]
    velocity = [[1.0, 0.0], [walks, 0.0], *([way, 0.0] for *_, way in others)]
    velocity = decided(*standing(place, ways, STRAIGHT, velocity=velocity, bodies=bodies))
    assert (velocity[0, 1] < 0.0) == overtakes  # on the side with more room
    assert (np.hypot(*velocity[0]) > 0.7) == overtakes


@looped(("wants", "speed"), [(0.8, V0), (V0, 0.8 * 0.8)])
def test_people_beside_are_waited_for_unless_they_are_overtaken(wants, speed):
    bodies = make_bodies([0.2] * 2, [70.0] * 2, desired_speed=[V0, wants])
    keeps = manner(strength=0.0, berth=1.0, beside=0.12, keep_up=0.8)
    two = standing([[0, 0], [0.6, 0.45]], [[1, 0]] * 2, keeps, velocity=[[V0, 0.0], [0.8, 0.0]], bodies=bodies)
    assert decided(*two)[0] == pytest.approx([speed, 0.0])


@looped("time_gap", [0.2, 0.5, 0.6, 0.8])
@looped("own", [False, True])
def test_the_hurry_of_a_person_shortens_the_time_gap_to_the_side_by_its_square(time_gap, own):
    # Beside, 0.1 m off the strip, stands someone on the same way; the gap along the line of centers allows less.
    keeps = manner(strength=0.0, width=1.0, gain=1.0, beside=0.12, time_gap=2.0 if own else time_gap)
    bodies = make_bodies([0.2] * 2, [70.0] * 2, desired_speed=V0, time_gap=time_gap if own else np.nan)
    velocity = decided(*standing([[0, 0], [0.2, 0.5]], [[1, 0]] * 2, keeps, bodies=bodies))
    assert velocity[0] == pytest.approx([min(0.1 / (0.12 * (time_gap / 0.5) ** 2), V0), 0.0])


def test_nobody_overtakes_into_a_wall():
    place = Geometry.from_polygon(box(-3, -0.3, 5, 0.3))
    bodies = make_bodies([0.2] * 2, [70.0] * 2, desired_speed=[V0, 0.6])
    crowd = [[0, 0], [0.9, 0.15]], [[1, 0], [1, 0]], STRAIGHT
    velocity = decided(*standing(*crowd, velocity=[[1.0, 0.0], [0.6, 0.0]], place=place, bodies=bodies))
    assert velocity[0, 1] == 0.0
