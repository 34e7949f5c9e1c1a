"""One controller that sends people to exits: Gymnasium's Env, its batch, and stable-baselines3."""

import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from routing_places import corridor, hall

from crowd_env import FULL_SPEED, EpisodeMetrics, Geometry, Population, Route, Scenario
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.routing.env import RoutingEnv, RoutingVectorEnv
from crowd_env.geometry.geometry import box

WEST, EAST = 0, 1


SMALL = hall(count=12, time_limit=30.0)
FIVE = [(1.0, 2.0), (2.0, 3.0), (3.5, 0.5), (5.0, 1.0), (7.0, 2.5)]


# ------------------------------------------------------------------------------------------------------ the checkers


@pytest.mark.parametrize(
    "options",
    [
        {},
        *(
            pytest.param(one, marks=pytest.mark.more)
            for one in ({"grid": (1, 1), "interval": 0.5}, {"regions": ["start"], "physics": "dem"})
        ),
    ],
)
def test_gymnasium_accepts_it(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*render.*|.*unwrapped.*|.*spec.*")
        env = gymnasium.make("crowd_env/routing-v0", scenario=SMALL, **options)
        assert isinstance(env.unwrapped, RoutingEnv)
        check_env(env.unwrapped, skip_render_check=True)


def test_stable_baselines3_accepts_it():
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(RoutingEnv(SMALL))


def test_the_default_is_a_hall_with_two_exits():
    layout = gymnasium.make("crowd_env/routing-v0").unwrapped.layout
    assert len(layout.regions) == 8 and len(layout.routes) == len(layout.exits) == 2


# ------------------------------------------------------------------------------------------------------- observation


def test_the_first_observation_of_five_people_by_hand():
    env = RoutingEnv(corridor(FIVE), grid=(2, 1))
    layout = env.layout
    assert layout.regions == ("cell-0-0", "cell-1-0") and layout.exits == layout.routes == ("west", "east")
    observation, info = env.reset(seed=0)
    assert info["inside"] == 5
    expected = {
        "count": [3 / 5, 2 / 5],
        "density": [3 / 16 / 5, 2 / 16 / 5],  # 16 m2 each, 5 /m2 is 1
        "speed": [0, 0],
        "flow": [0, 0],
        "queue": [2 / 5, 1 / 5],  # the first two are 1.0 and 2.1 m from the west exit, the third 3.6 m
        "assigned": [3 / 5, 2 / 5],  # nobody was told anything yet: the nearest exit
        "door": [],
        "inside": [1],
        "time": [0],
    }
    assert list(expected) == list(layout.names)
    for part, values in expected.items():
        np.testing.assert_allclose(observation[layout[part]], values, rtol=1e-6, err_msg=part)
    assert observation.shape == (layout.size,) == (14,)
    with pytest.raises(KeyError, match="no term 'queues'; it has: count"):
        layout["queues"]


def test_what_is_observed_after_two_seconds_by_hand():
    env = RoutingEnv(corridor(FIVE), grid=(2, 1), interval=2.0)
    env.reset(seed=0)
    observation, _, _, _, info = env.step([WEST, EAST])
    state, layout = env.batch.env.simulation.state, env.layout
    # 1.5 m/s for 2 s: the first two of the left half are out, as is the last one, 1 m from the east exit.
    np.testing.assert_array_equal(state.active, [False, False, True, True, False])
    assert info["inside"] == 2
    speed = np.hypot(*state.velocity.T)
    expected = {
        "count": [1 / 5, 1 / 5],
        "speed": [speed[2] / 2.0, speed[3] / 2.0],
        "flow": [2 / 2.0 / 1.0 / 5.0, 1 / 2.0 / 2.0 / 5.0],  # 2 people in 2 s by 1 m, 1 by 2 m
        "queue": [1 / 5, 1 / 5],
        "assigned": [1 / 5, 1 / 5],
        "inside": [2 / 5],
        "time": [2 / 60],
    }
    for part, values in expected.items():
        np.testing.assert_allclose(observation[layout[part]], values, rtol=1e-6, err_msg=part)
    whole = RoutingEnv(corridor(FIVE), routes=["east", "west"], grid=(1, 1), interval=0.1)
    whole.reset(seed=0)
    observation, *_ = whole.step([0])
    speed = np.hypot(*whole.batch.env.simulation.state.velocity.T)
    assert whole.layout.routes == ("east", "west") and speed.min() > 0.05
    assert observation[whole.layout["speed"]] == pytest.approx(speed.mean() / 2.0)


def test_a_queue_does_not_reach_through_a_wall():
    def queue(thin_walls):
        scenario = corridor([(1.0, 2.0)])
        exits = {"west": [(0, 1.5), (0, 2.5)], "east": [(8, 1.5), (8, 3.5)]}
        geometry = Geometry.from_polygon(box(0, 0, 8, 4), exits=exits, thin_walls=thin_walls)
        env = RoutingEnv(replace(scenario, geometry=geometry))
        return env.reset(seed=0)[0][env.layout["queue"]].tolist()

    assert queue([]) == [1.0, 0.0]
    assert queue([[(0.5, 0), (0.5, 3.3)]]) == [0.0, 0.0]  # 1 m as the crow flies


def test_cells_without_floor_are_no_regions():
    exits = {"west": [(0, 1), (0, 2)], "east": [(4, 0.5), (4, 1.5)]}
    geometry = Geometry.from_polygon([(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)], exits=exits)
    env = RoutingEnv(Scenario("corner", geometry, Population(3), 20.0, **FULL_SPEED), grid=(2, 2))
    assert env.layout.regions == ("cell-0-0", "cell-1-0", "cell-0-1")
    np.testing.assert_allclose(env.batch.regions.area, 4.0)
    np.testing.assert_allclose(env.batch.regions.center, [(1, 1), (3, 1), (1, 3)])
    places = np.array([(0.5, 0.5), (3.9, 1.9), (1.0, 3.0), (3.0, 3.0), (-0.1, 4.1)])
    np.testing.assert_array_equal(env.batch.regions.locate(places), [0, 1, 2, -1, 2])


# ------------------------------------------------------------------------------------------------------------- action


def test_an_action_reaches_exactly_the_people_in_the_region():
    batch = RoutingBatch(hall(), num_envs=2, grid=(4, 2), interval=0.01)
    batch.reset(0)
    state = batch.env.simulation.state
    west, east = (batch.env.route_set[0].number(name) for name in ("west", "east"))
    state.route[:] = west
    x, y = state.position.T.copy()
    action = np.full((2, 8), WEST)
    action[1, batch.layout.regions.index("cell-1-1")] = EAST
    batch.step(action)
    there = (x >= 5) & (x < 10) & (y >= 6) & (batch.env.env_of_person == 1)
    assert 20 < there.sum() < 60
    np.testing.assert_array_equal(state.route, np.where(there, east, west))


def test_outside_of_the_named_regions_people_keep_to_what_they_were_told():
    regions = {"middle": box(3, 0, 5, 4), "wide": box(2.5, 0, 6, 4)}
    env = RoutingEnv(corridor(FIVE, regions=regions), regions=["middle", "wide"], interval=0.5)
    assert env.layout.regions == ("middle", "wide")
    env.reset(seed=0)
    route_set, state = env.batch.env.route_set[0], env.batch.env.simulation.state
    west, east = route_set.number("west"), route_set.number("east")
    np.testing.assert_array_equal(state.route, [west, west, west, east, east])
    env.step([EAST, WEST])  # the third stands in both regions: the first one counts; the fourth on the border of middle
    np.testing.assert_array_equal(state.route, [west, west, east, east, east])
    env.step([WEST, WEST])
    np.testing.assert_array_equal(state.route[2:], [west, west, east])


def test_people_walk_where_they_are_told():
    def exits(choice):
        env = RoutingEnv(corridor(FIVE), grid=(1, 1))
        env.reset(seed=0)
        while not (end := env.step([choice]))[2]:
            pass
        assert end[4]["metrics"]["unfinished"] == 0
        return env.batch.env.simulation.state.exit_index.tolist()

    assert exits(WEST) == [0] * 5
    assert exits(EAST) == [1] * 5


def test_whoever_has_passed_the_region_of_a_route_is_not_sent_back():
    scenario = corridor(
        [(3.0, 0.5)], regions={"lobby": box(3.5, 3, 4.5, 4)}, routes=(Route("round", ("east",), via="lobby"),)
    )
    env = RoutingEnv(scenario, grid=(1, 1), interval=0.5)
    assert env.layout.routes == ("west", "east", "round")
    env.reset(seed=0)
    seen = []
    while not (end := env.step([2]))[2] and not end[3]:
        assert end[0][env.layout["assigned"]].tolist() == [0, 0, 1]
        seen.append(env.batch.env.simulation.state.position[0].copy())
    assert end[2] and np.max(seen, axis=0)[1] > 3.0
    assert end[4]["metrics"]["evacuation_time"] < 8.0


def test_doors_are_opened_and_closed():
    doors = {"gate": "east"}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*people wait there.*")
        env = RoutingEnv(corridor(FIVE, doors=doors), grid=(1, 1), doors=["gate"], interval=1.0)
        assert env.action_space.nvec.tolist() == [2, 2]
        observation, _ = env.reset(seed=0)
        assert observation[env.layout["door"]] == 1
        for _ in range(6):
            observation, *_ = env.step([EAST, 0])
        state = env.batch.env.simulation.state
        assert observation[env.layout["door"]] == 0 and not (state.exit_index == 1).any()
        while not (end := env.step([EAST, 1]))[2]:
            assert not end[3]
    assert end[0][env.layout["door"]] == 1 and (state.exit_index == 1).any()


# ------------------------------------------------------------------------------------------------------------- reward


@pytest.mark.parametrize("weights", [None, {"mean": 1.0}, {"mean": 0.2, "last": 0.7}, {}])
def test_the_return_is_made_of_the_mean_and_the_last_exit_time(weights):
    env = RoutingEnv(SMALL, reward=weights)
    env.reset(seed=1)
    total, sums, done = 0.0, {"mean": 0.0, "last": 0.0}, False
    while not done:
        _, reward, done, truncated, info = env.step(np.zeros(8, dtype=int))
        assert not truncated
        total += reward
        sums = {name: value + info[f"reward/{name}"] for name, value in sums.items()}
    metrics, weights = info["metrics"], {"mean": 0.1, "last": 0.1} if weights is None else weights
    assert sums["mean"] == pytest.approx(-metrics["mean_exit_time"])
    assert sums["last"] == pytest.approx(-metrics["evacuation_time"])
    assert total == pytest.approx(sum(weights.get(name, 0.0) * value for name, value in sums.items()))
    exit_time = env.batch.env.simulation.state.exit_time
    assert sums["mean"] == pytest.approx(-exit_time.mean()) and sums["last"] == pytest.approx(-exit_time.max())


def test_whoever_stays_inside_counts_until_the_time_limit_and_is_still_seen():
    env = RoutingEnv(corridor([(1.0, 2.0), (4.0, 2.0)], speed=0.2, time_limit=4.0), interval=2.0)
    env.reset(seed=0)
    for _ in range(2):
        observation, reward, terminated, truncated, info = env.step(np.zeros(8, dtype=int))
        assert (info["reward/mean"], info["reward/last"]) == (pytest.approx(-2.0), pytest.approx(-2.0))
        assert reward == pytest.approx(-0.4) and info["inside"] == 2
    assert truncated and not terminated and info["metrics"]["unfinished"] == 2
    assert observation[env.layout["inside"]] == 1 and observation[env.layout["count"]].sum() == pytest.approx(1)
    assert observation[env.layout["time"]] == 1


# ------------------------------------------------------------------------------------------------ seeds and pictures


def test_one_seed_fixes_a_whole_series_of_episodes():
    def series(seed):
        env = RoutingEnv(SMALL)
        first = env.reset(seed=seed)[0]
        position = env.batch.env.simulation.state.position.copy()
        after = [env.step(np.ones(8, dtype=int))[0] for _ in range(3)]
        return [first, position, *after, env.reset()[0], env.batch.env.simulation.state.position.copy()]

    one, same, other = series(3), series(3), series(4)
    for a, b in zip(one, same, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(one[1], one[-1]) and not np.array_equal(one[-1], other[-1])


def test_a_frame_shows_the_hall():
    env = RoutingEnv(SMALL, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.ndim == 3 and frame.shape[2] == 3 and frame.dtype == np.uint8
    env.step(np.ones(8, dtype=int))
    assert not np.array_equal(env.render(), frame)


# ---------------------------------------------------------------------------------------------------- learning library


def test_stable_baselines3_sees_each_row_as_an_environment():
    sb3 = pytest.importorskip("crowd_env.envs.adapters.sb3")
    venv, twin = sb3.VectorVecEnv(RoutingVectorEnv(SMALL, num_envs=2)), RoutingVectorEnv(SMALL, num_envs=2)
    venv.seed(3)
    np.testing.assert_array_equal(venv.reset(), twin.reset(seed=3)[0])
    action, total, ended = np.tile([0, 0, 1, 1], (2, 2)), np.zeros(2), []
    while len(ended) < 5:
        observation, reward, done, infos = venv.step(action)
        expected, twin_reward, terminated, _, info = twin.step(action)
        np.testing.assert_array_equal(observation, expected)
        np.testing.assert_allclose(reward, twin_reward, rtol=1e-6)
        total += twin_reward
        for e in np.flatnonzero(done):
            assert terminated[e] and not infos[e]["TimeLimit.truncated"]
            np.testing.assert_array_equal(infos[e]["terminal_observation"], info["final_obs"][e])
            assert infos[e]["episode"]["r"] == pytest.approx(total[e])
            total[e] = 0.0
            ended.append({name: info["final_info"]["metrics"][name][e].item() for name in EpisodeMetrics._fields})
    finished = venv.take_finished()
    assert all(type(episode) is EpisodeMetrics for episode in finished) and venv.take_finished() == []
    assert repr([episode._asdict() for episode in finished]) == repr(ended)


def test_a_slot_cut_off_at_the_time_limit_says_so():
    sb3 = pytest.importorskip("crowd_env.envs.adapters.sb3")
    venv = sb3.VectorVecEnv(RoutingVectorEnv(SMALL, num_envs=2, time_limit=2.0))
    venv.reset()
    _, _, done, infos = venv.step(np.zeros((2, 8), dtype=int))
    assert done.all() and all(info["TimeLimit.truncated"] for info in infos)
    assert infos[0]["terminal_observation"][-2] > 0  # people inside, whose future is to be valued
