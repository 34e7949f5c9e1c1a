"""Action masks: what is masked is never taken, what is not masked is, and they follow doors, dwells and what people know."""

import warnings

import gymnasium
import numpy as np
import pytest
from crowds import every_scheme
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import vector as wrappers
from late import late
from pettingzoo.test import api_test, parallel_api_test

from crowd_env import (
    FULL_SPEED,
    TABLE_4,
    ActionKind,
    CrowdEnv,
    CrowdGymEnv,
    Geometry,
    Physics,
    Population,
    Route,
    Scenario,
    make_vec,
    parallel_env,
)
from crowd_env.envs.parallel import env as aec_env
from crowd_env.envs.routing.env import RoutingEnv, RoutingVectorEnv
from crowd_env.geometry.geometry import box
from crowd_env.routing.spec import DoorEvent
from crowd_env.scenarios.cohorts import Cohorts

CrowdVecEnv, VectorVecEnv = late("crowd_env.envs.adapters.sb3", "CrowdVecEnv", "VectorVecEnv")

SPEEDS = 5  # of "speeds-exits"
SHUT, OPENED = 0.5, 1.7  # s  of the door of the exit in the west
WEST, EAST, ROUND = range(3)  # ways


def place(people=8, **options):
    """Return a hall with two exits and a way by the middle to the west, whose exit shuts and opens again."""
    exits = {"west": [(0, 2), (0, 3)], "east": [(8, 2), (8, 3)]}
    geometry = Geometry.from_polygon(
        box(0, 0, 8, 5), exits=exits, doors={"gate": "west"}, regions={"middle": box(3, 0, 5, 5)}
    )
    events = tuple(DoorEvent("gate", opens, at=at) for opens, at in ((False, SHUT), (True, OPENED)))
    routes = (Route("round", ("west",), via="middle"),)
    crowd = Population(people, **TABLE_4) if isinstance(people, int) else people
    given = {"routes": routes, "door_events": events, **FULL_SPEED, **options}
    return Scenario("hall with a gate", geometry, crowd, 60.0, **given)


def hall(scenario=None, **options):
    given = {"action": "speeds-exits", "routing": "nearest", "physics": "dem", **options}
    return CrowdEnv(scenario or place(), **given)


def ways_of(mask):
    """Return which ways (P, 3) a mask leaves; the speed has no say, and the current way is always left."""
    speeds = mask.reshape(len(mask), -1, SPEEDS)
    assert (speeds == speeds[..., :1]).all() and speeds[:, 0].all()
    return speeds[:, 1:, 0] == 1


def way_of(env):
    """Return the way (P,) that each is on, whichever half of it."""
    known = env.route_set[0]
    numbers = [known.number(name) for name in env.scenarios[0].ways]
    ways = {number: k for k, number in enumerate(numbers)}
    ways |= {known.routes[number].following: k for number, k in ways.items()}
    return np.array([ways[number] for number in env.simulation.state.route.tolist()])


@every_scheme
def test_a_masked_choice_is_never_taken_and_any_other_is(name):
    """As many choices as there are, and a twin who has the speed of each that is masked, along the way that it is on."""
    physics = Physics(name, dt=None if name == "hertz-literal" else 0.01)
    env, twin = hall(physics=physics), hall(physics=physics)
    _, info = env.reset(seed=0)
    twin.reset(seed=0)
    rng, seen = np.random.default_rng(0), []
    for _ in range(30):
        mask, action = info["action_mask"], rng.integers(0, 4 * SPEEDS, 8)
        left = mask[np.arange(8), action] == 1
        way, before, inside = action // SPEEDS - 1, way_of(env), env.active
        step, other = env.step(action), twin.step(np.where(left, action, action % SPEEDS))
        info = step.info
        for one, same in zip(step[:4], other[:4], strict=True):
            np.testing.assert_array_equal(one, same)
        turns = inside & left & (way >= 0)
        np.testing.assert_array_equal(way_of(env)[inside], np.where(turns, way, before)[inside])
        seen.append([turns.sum(), (inside & ~left).sum()])
    assert (np.sum(seen, axis=0) > 20).all()


def test_a_door_that_shuts_in_mid_run_is_in_the_mask():
    """Also of an episode that starts by itself, at 2.2 s, with the door open."""
    env = hall(num_envs=2, autoreset=True, time_limit=2.2, action={"name": "speeds-exits", "dwell": 0.0})
    env.reset(seed=0)
    stand, restarts = np.ones(16, dtype=int), 0
    for _ in range(30):
        now = env.simulation.state.time[0]
        shut = SHUT < now - 1e-9 <= OPENED  # a door moves at the first physics step of its time
        assert shut != env.simulation.history.door_open[0, 0]
        expected = [not shut, True, not shut]
        mask = env.action_mask
        assert (ways_of(mask) == expected).all(), now
        step = env.step(stand)
        np.testing.assert_array_equal(step.info["action_mask"], env.action_mask)  # of the next decision
        restarts += step.info["finished"].sum()
    assert restarts == 2


def test_people_wait_for_the_dwell_and_keep_to_exits_that_they_know():
    kinds = ({"exits": ("west",)}, {"route": "east"}, {})
    people = Cohorts(tuple(Population(2, **TABLE_4, **kind) for kind in kinds))
    env = hall(place(people, door_events=()), routing="east")
    _, info = env.reset(seed=0)
    left = ways_of(info["action_mask"])
    assert left[:2].tolist() == [[True, False, True]] * 2  # the way by the middle leads to the west too
    assert left[2:4].tolist() == [[False, True, False]] * 2
    assert left[4:].all()
    turn = np.full(6, (1 + WEST) * SPEEDS + 1)
    waits = []
    for k in range(12):
        left = ways_of(env.step(turn if k == 0 else np.ones(6, dtype=int)).info["action_mask"])
        waits.append(not left[4, EAST])
        assert left[4:, WEST].all()
    assert waits == [True] * 9 + [False] * 3  # it turned at 0 s and may turn again at 1 s


def test_a_mask_goes_back_with_a_checkpoint():
    env = hall(num_envs=2)
    env.reset(seed=0)
    for _ in range(8):
        env.step(np.full(16, (1 + EAST) * SPEEDS + 1))
    then, mask = env.checkpoint(), env.action_mask
    env.reset()
    assert not np.array_equal(env.action_mask, mask)
    env.restore(then)
    np.testing.assert_array_equal(env.action_mask, mask)
    other = hall(num_envs=2)
    other.restore(then)
    np.testing.assert_array_equal(other.action_mask, mask)


# --------------------------------------------------------------------------------------------------------- interfaces

CROWD = {"action": "speeds-exits", "physics": "dem", "time_limit": 2.0}


def test_every_interface_says_the_same():
    """Of a crowd that leaves in part: agents have what arrays have, and rooms of a batch what rooms alone have."""
    env, agents, alone = CrowdEnv(place(), **CROWD), parallel_env(place(), **CROWD), CrowdGymEnv(place(), **CROWD)
    masks = env.reset([3])[1]["action_mask"]
    infos, info = agents.reset(seed=3)[1], alone.reset(seed=3)[1]
    rng = np.random.default_rng(0)
    while True:
        np.testing.assert_array_equal(info["action_mask"], masks)
        np.testing.assert_array_equal(alone.action_masks(), masks)
        for agent in infos:
            np.testing.assert_array_equal(infos[agent]["action_mask"], masks[int(agent[-1])])
        assert masks.dtype == np.int8 and all(each["action_mask"].shape == (20,) for each in infos.values())
        if env.finished.all():
            break
        action = rng.integers(0, 20, 8)
        inside = agents.agents
        masks = env.step(action).info["action_mask"]
        *_, infos = agents.step({agent: action[int(agent[-1])] for agent in inside})
        *_, info = alone.step(action)
    assert infos and not agents.agents


@pytest.mark.parametrize("kind", ["crowd", "routing"])
@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_a_batch_says_what_gymnasiums_own_says(kind, mode):
    make, batch = {
        "crowd": (lambda: CrowdGymEnv(place(), **CROWD), lambda: make_vec(place(), 2, **CROWD, autoreset_mode=mode)),
        "routing": (
            lambda: RoutingEnv(place(), time_limit=2.0, interval=0.5, grid=(2, 1)),
            lambda: RoutingVectorEnv(place(), 2, time_limit=2.0, interval=0.5, grid=(2, 1), autoreset_mode=mode),
        ),
    }[kind]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own = SyncVectorEnv([make, make], autoreset_mode=mode)
    batch = batch()
    rng, told = np.random.default_rng(0), []
    for env in (own, batch):
        told.append([env.reset(seed=[4, 5])[1]["action_mask"]])
    ended = 0
    for _ in range(30):
        action = rng.integers(0, 20, (2, 8)) if kind == "crowd" else rng.integers(0, 3, (2, 2))
        action[1] = 1  # stands, or goes east
        one, other = (wrappers.DictInfoToList(env)._convert_info_to_list(env.step(action)[4]) for env in (own, batch))
        if ended:
            continue  # what the next episode draws differs
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a["action_mask"], b["action_mask"])
            assert ("final_info" in a) == ("final_info" in b)
            if "final_info" in a:
                np.testing.assert_array_equal(a["final_info"]["action_mask"], b["final_info"]["action_mask"])
        ended = "metrics" in str(one)
    assert ended


@pytest.mark.parametrize("action", ["continuous", "discrete", "speeds"])
def test_walking_alone_has_no_mask(action):
    env = CrowdEnv(place(), action=action, autoreset=True)
    assert env.action_mask is None and "action_mask" not in env.reset(seed=0)[1]
    assert "action_mask" not in env.step(None).info
    assert not hasattr(CrowdGymEnv(place(), action=action), "action_masks")
    assert "action_mask" not in make_vec(place(), 2, action=action).reset(seed=0)[1]
    assert not CrowdVecEnv(env).has_attr("action_masks")


def test_the_checkers_of_the_frameworks_sample_by_it():
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=UserWarning)
        parallel_api_test(parallel_env(place(), **CROWD), num_cycles=40)
        api_test(aec_env(place(), **CROWD), num_cycles=40)
    env = gymnasium.make("crowd_env/routing-v0", scenario=place(), grid=(2, 1))
    _, info = env.reset(seed=0)
    split = tuple(np.split(info["action_mask"], np.cumsum(env.action_space.nvec)[:-1]))
    assert env.action_space.contains(env.action_space.sample(split))


def test_rows_of_stable_baselines3_have_their_own():
    venv = CrowdVecEnv(CrowdEnv(place(), num_envs=2, autoreset=True, **CROWD))
    venv.seed(0)
    venv.reset()
    venv.step(np.arange(16) % 20)
    assert venv.has_attr("action_masks")
    np.testing.assert_array_equal(np.stack(venv.env_method("action_masks")), venv.env.action_mask)
    np.testing.assert_array_equal(venv.env_method("action_masks", indices=[3, 9]), venv.env.action_mask[[3, 9]])
    rooms = VectorVecEnv(make_vec(place(), 2, **CROWD))
    rooms.reset()
    assert np.stack(rooms.env_method("action_masks")).shape == (2, 8 * 20)
    controllers = VectorVecEnv(RoutingVectorEnv(place(), 2, grid=(2, 1)))
    controllers.reset()
    assert np.stack(controllers.env_method("action_masks")).shape == (2, 6)
    assert not VectorVecEnv(RoutingVectorEnv(num_envs=2)).has_attr("action_masks")


# ------------------------------------------------------------------------------------------------------------ routing


def test_a_controller_sends_nobody_to_an_exit_that_is_closed():
    env = RoutingEnv(place(), grid=(1, 1), interval=0.5, physics="dem")
    _, info = env.reset(seed=0)
    masks = []
    for k in range(6):
        mask, before, way = info["action_mask"], way_of(env.env), (EAST, WEST, ROUND)[k % 3]
        masks.append(mask.tolist())
        *_, info = env.step([way])
        inside = env.env.active
        assert (way_of(env.env) == (way if mask[way] else before))[inside].all()
    assert masks[0] == [1, 1, 1] and masks[2] == masks[3] == [0, 1, 0] and masks[5] == [1, 1, 1]


def test_a_door_that_the_controller_moves_bars_nothing():
    env = RoutingEnv(place(), grid=(1, 1), interval=0.5, doors=["gate"])
    assert "action_mask" not in env.reset(seed=0)[1]
    env.step([EAST, 0])
    env.step([WEST, 1])
    assert (way_of(env.env) == WEST)[env.env.active].all()


@pytest.mark.filterwarnings("ignore:with .* closed people wait there")
def test_where_every_exit_is_closed_all_are_left():
    doors = {"gate": "west", "other": "east"}
    whole = place()
    geometry = Geometry.from_polygon(
        box(0, 0, 8, 5),
        exits={"west": [(0, 2), (0, 3)], "east": [(8, 2), (8, 3)]},
        doors=doors,
        regions={"middle": box(3, 0, 5, 5)},
    )
    closed = Scenario("locked", geometry, whole.population, 60.0, closed_doors=("gate", "other"), **FULL_SPEED)
    env = RoutingEnv(closed, grid=(1, 1), interval=0.5)
    assert env.reset(seed=0)[1]["action_mask"].tolist() == [1, 1]
    _, info = CrowdEnv(closed, action="speeds-exits").reset(seed=0)
    assert (ways_of(info["action_mask"]) == [False, False]).all()  # to keep the way is left


def test_a_kind_of_ones_own_has_a_mask_if_its_choices_can_be_counted():
    def decode(action):
        return np.tile([1.0, 0.0], (len(action), 1)), np.asarray(action).astype(int).reshape(len(action), -1)[:, 0] - 6

    counted = gymnasium.spaces.Discrete(4, start=5)  # 5 keeps the way
    kind = ActionKind("a way", counted, decode, 5, routes=3, dwell=1.0)
    env = hall(action=kind, routing="west")
    env.reset(seed=0)
    mask = env.step(np.full(8, 6 + EAST)).info["action_mask"]
    assert mask.tolist() == [[1, 0, 1, 0]] * 8 and counted.sample(mask[0]) in (5, 7)
    pair = ActionKind("a pair", gymnasium.spaces.MultiDiscrete([2, 2], start=[5, 5]), decode, [5, 5], routes=3)
    assert hall(action=pair).action_mask is None


def test_places_of_a_batch_have_their_own_doors():
    plain = place(5, door_events=())
    shut = place(8, door_events=(), closed_doors=("gate",))
    env = hall([shut, plain], num_envs=2)
    left = ways_of(env.reset(seed=0)[1]["action_mask"])
    assert (left[:8] == [False, True, False]).all() and left[8:].all()
    env.simulation.close_doors(1, ["gate"])
    assert (ways_of(env.action_mask)[8:] == [False, True, False]).all()
