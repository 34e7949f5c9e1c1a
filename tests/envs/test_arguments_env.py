"""What `CrowdEnv` and its faces are given: refused in one sentence before anything is run, or taken as plain data."""

import json
import re

import gymnasium
import numpy as np
import pytest
from refusals import INF, NAN, NO_CHOICE, NO_FLAG, numeric, refuses, rows, table

import crowd_env
from crowd_env import (
    NSM2,
    SCENARIOS,
    CrowdEnv,
    CrowdGymEnv,
    CrowdVectorEnv,
    Geometry,
    ObservationLayout,
    Population,
    RewardWeights,
    Scenario,
    SocialForce,
    contact_pressure,
    crowd_pressure,
    make_scheme,
    make_vec,
    parallel_env,
)
from crowd_env.envs.action import ACTIONS


def of(name, make=CrowdEnv, **others):
    return lambda value: make(**{**others, name: value})


@pytest.fixture(scope="module")
def env():
    made = CrowdEnv("room-v0", num_envs=2, people=3, scheme="dem")
    made.reset([0, 1])
    return made


CONSTRUCTOR = [
    *rows("CrowdEnv.scenario", of("scenario"), (None, 7, 1.5, True, Scenario, {"a": 1}, [7], [None], b"x")),
    ("CrowdEnv of no scenario", lambda: CrowdEnv([]), ("no scenario",)),
    ("CrowdEnv unknown scenario", lambda: CrowdEnv("nowhere"), ("'nowhere'", "room-v0")),
    ("CrowdEnv unknown option", lambda: CrowdEnv(sides=3.0), ("'sides'", "side")),
    ("CrowdEnv option of a Scenario", lambda: CrowdEnv(crowd_env.make_scenario("room-v0"), side=3.0), ("side", "name")),
    *numeric("CrowdEnv.num_envs", of("num_envs"), "count"),
    *rows("CrowdEnv.num_envs", of("num_envs"), (10**9, 500_001)),
    *numeric("CrowdEnv.threads", of("threads"), "count"),
    *rows("CrowdEnv.threads", of("threads"), (10**6,)),
    *numeric("CrowdEnv.dt", of("dt"), "positive", or_none=True),
    *numeric("CrowdEnv.decision_dt", of("decision_dt"), "positive"),
    ("CrowdEnv.decision_dt and dt", lambda: CrowdEnv(decision_dt=0.1, dt=0.03), ("decision_dt", "whole number", "0.03")),
    ("CrowdEnv.dt tiny", lambda: CrowdEnv(decision_dt=1e300, dt=1e-300), ("decision_dt", "whole number")),
    ("CrowdEnv.decision_dt short", lambda: CrowdEnv(decision_dt=0.004), ("decision_dt", "whole number")),
    ("CrowdEnv.dt unstable", lambda: CrowdEnv(dt=1.0, decision_dt=1.0), ("dt = 1 s", "stable")),
    ("CrowdEnv.dt unstable for dem", lambda: CrowdEnv(dt=0.1, scheme="dem"), ("dem", "stable step")),
    ("CrowdEnv.door_width", lambda: CrowdEnv(door_width=0.3), ("0.30 m", "narrower", "0.40 m")),
    *numeric("CrowdEnv.time_limit", of("time_limit"), "positive", or_none=True),
    *rows("CrowdEnv.frame", of("frame"), (*NO_CHOICE, None)),
    ("CrowdEnv.frame unknown", lambda: CrowdEnv(frame="polar"), ("'polar'", "path", "world")),
    *rows("CrowdEnv.action", of("action"), (*NO_CHOICE, None)),
    *rows("CrowdEnv.strategy", of("strategy"), (*NO_CHOICE, None)),
    *rows("CrowdEnv.autoreset", of("autoreset"), NO_FLAG),
    *rows("CrowdEnv.rules", of("rules"), NO_FLAG),
    *rows("CrowdEnv.scheme", of("scheme"), (None, 3, NSM2, ["nsm2"], b"nsm2", ...)),
    ("CrowdEnv.scheme unknown", lambda: CrowdEnv(scheme="nsm3"), ("'nsm3'", "nsm2")),
    ("CrowdEnv.scheme key", lambda: CrowdEnv(scheme={"name": "nsm2", "tolerence": 1}), ("'tolerence'", "tolerance")),
    ("CrowdEnv.scheme social", lambda: CrowdEnv(scheme=NSM2(social="lim")), ("social", "'lim'", "lin", "helbing")),
    *rows("CrowdEnv.observation", of("observation"), ("velocity", ["velocity"], 3, True, ObservationLayout, RewardWeights())),
    ("CrowdEnv.observation key", lambda: CrowdEnv(observation={"term": ["push"]}), ("observation", "'term'", "terms")),
    ("CrowdEnv.observation terms", lambda: CrowdEnv(observation={"terms": "push"}), ("observation", "terms", "('push',)")),
    ("CrowdEnv.observation unknown", lambda: CrowdEnv(observation={"terms": ["smell"]}), ("'smell'", "velocity")),
    ("CrowdEnv.observation number", lambda: CrowdEnv(observation={"rays": 2.5}), ("observation", "rays", "2.5")),
    *rows("CrowdEnv.reward", of("reward"), ("time", ["time"], 3, True, RewardWeights, ObservationLayout())),
    ("CrowdEnv.reward unknown", lambda: CrowdEnv(reward={"joy": 1.0}), ("'joy'", "progress")),
    ("CrowdEnv.reward key", lambda: CrowdEnv(reward={"weights": {"time": 1.0}, "share": 1}), ("reward", "'share'", "weights")),
    ("CrowdEnv.reward weight", lambda: CrowdEnv(reward={"time": "1"}), ("'time'", "'1'")),
    *rows("CrowdEnv.population", of("population"), (20, "20", Population, [Population])),
    ("CrowdEnv.population key", lambda: CrowdEnv(population={"number": 3}), ("population", "'number'", "people")),
    ("CrowdEnv.population lacks", lambda: CrowdEnv(population={"radius": 0.2}), ("population", "'people' is missing")),
    ("CrowdEnv.people", lambda: CrowdEnv(people=10**9), ("people", "1000000000")),
    ("CrowdEnv.people too many", lambda: CrowdEnv(people=1000), ("1000 people do not fit",)),
    *rows("CrowdEnv.people", of("people"), (2.5, "20", None, True, NAN, 0, -1)),
]  # fmt: skip

MAKERS = {
    "make_vec": make_vec,
    "CrowdVectorEnv": CrowdVectorEnv,
    "CrowdGymEnv": CrowdGymEnv,
    "parallel_env": parallel_env,
    "gymnasium.make": lambda **options: gymnasium.make("crowd_env/room-v0", **options),
    "gymnasium.make_vec": lambda **options: gymnasium.make_vec("crowd_env/room-v0", **options),
}
FACES = [
    row
    for name, make in MAKERS.items()
    for row in (
        *rows(f"{name}.dt", of("dt", make), ("0.01", NAN, 0.0)),
        *rows(f"{name}.observation", of("observation", make), (["velocity"], 3)),
        *rows(f"{name}.reward", of("reward", make), ("time", ["time"])),
        *rows(f"{name}.scheme", of("scheme", make), (NSM2, None)),
        *rows(f"{name}.time_limit", of("time_limit", make), ("60", INF)),
        *rows(f"{name}.rules", of("rules", make), ("no",)),
        *rows(f"{name}.people", of("people", make), (2.5, None, 10**9)),
        (f"{name} option", lambda make=make: make(sides=3.0), ("'sides'",)),
    )
] + [
    row
    for name in ("make_vec", "CrowdVectorEnv")
    for row in rows(f"{name}.num_envs", of("num_envs", MAKERS[name]), (2.5, "2", 0, None, True, 10**9))
]


@table(CONSTRUCTOR, FACES)
def test_what_makes_no_sense_is_refused_in_one_sentence(call, words):
    refuses(call, words)


PEOPLE = 6
ARRAYS = [
    *[
        ("action", action)
        for action in ("no", 0.5, {"a": 1}, np.zeros((PEOPLE, 2), dtype=complex), [["a", "b"]] * PEOPLE)
    ],
    *[
        ("action", action)
        for action in ([[0.0, None]] * PEOPLE, [[0.0, 1.0]] * (PEOPLE - 1) + [[0.0]], np.zeros((2, PEOPLE)))
    ],
    ("action", np.zeros((PEOPLE, 2), dtype=bool)),
    *[
        (f"has the shape {shape}; it must be (6, 2)", np.zeros(shape))
        for shape in ((PEOPLE - 1, 2), (PEOPLE, 3), (PEOPLE,))
    ],
    ("pedestrian 0 is [nan, nan]; it must be finite", np.full((PEOPLE, 2), NAN)),
    ("pedestrian 2", np.where(np.arange(PEOPLE)[:, None] == 2, INF, np.zeros((PEOPLE, 2)))),
]


@pytest.mark.parametrize(("said", "action"), ARRAYS)
def test_actions_that_are_none_are_refused(env, said, action):
    before = env.simulation.state.copy()
    refuses(lambda: env.step(action), ("action", said))
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, env.simulation.state, strict=True))


@pytest.mark.parametrize(
    ("action", "said"),
    [
        *[(action, "action") for action in ("no", 1.5, [1j] * PEOPLE, [0])],
        ([9] * PEOPLE, "pedestrian 0 is 9; it must be 0 to 8"),
        *[([value] * PEOPLE, "0 to 8") for value in (-1, 0.5, NAN)],
        (np.zeros((PEOPLE, 2)), "has the shape (6, 2); it must be (6,)"),
    ],
)
def test_discrete_actions_that_are_none_are_refused(action, said):
    discrete = CrowdEnv("room-v0", num_envs=2, people=3, scheme="dem", action="discrete")
    discrete.reset([0, 1])
    refuses(lambda: discrete.step(action), ("action", said))
    assert not discrete.simulation.state.time.any()


@pytest.mark.parametrize("rule", ["no", True, 1.0, np.zeros(PEOPLE), np.zeros(PEOPLE - 1, bool), ["no"] * PEOPLE, {}])
def test_rules_that_are_no_flags_are_refused(env, rule):
    refuses(lambda: env.step(np.zeros((PEOPLE, 2)), rule), ("rule",))


@pytest.mark.parametrize("mask", ["no", True, [1, 0], np.zeros(3, bool), [0.5, 0.5], {}, [[True], [True]]])
def test_masks_that_are_no_flags_are_refused(env, mask):
    refuses(lambda: env.reset(mask=mask), ("mask",))


@pytest.mark.parametrize(
    ("seed", "said"),
    [
        *[(seed, "seed") for seed in (1.5, "0", True, NAN, [0, 1, 2], [0, "1"], [0, True], {}, 1j)],
        *[(-1, "at least 0"), ([0, -1], "at least 0"), ([0], "1 seeds for 2")],
    ],
)
def test_seeds_that_are_none_are_refused(env, seed, said):
    refuses(lambda: env.reset(seed), ("seed", said))


@pytest.mark.parametrize("e", [-1, 2, 0.5, "0", None, NAN, True, [0]])
def test_environments_that_are_not_there_have_no_metrics_and_no_people(env, e):
    refuses(lambda: env.metrics(e), ("environment", "0 to 1"))
    refuses(lambda: env.people(e), ("environment", "0 to 1"))
    assert env.metrics(np.int64(1)).unfinished == 3 and env.people(1) == slice(3, 6)


def test_who_is_active_is_an_array_of_ones_own(env):
    env.reset([0, 1])
    before = env.active
    before[0] = False
    assert env.active.all()
    one = CrowdEnv("room-v0", people=2, side=2.0, scheme="dem")
    one.reset(seed=0)
    inside = one.active
    while not one.finished.all():
        one.step(None)
    assert inside.all() and not one.active.any()


PRESSURES = [
    *rows("contact_pressure.duration", lambda x: contact_pressure(np.ones(3), x, np.ones(3)), (0.0, -1.0, NAN, INF, "1", None)),
    *rows("contact_pressure.radius", lambda x: contact_pressure(np.ones(3), 1.0, x), ("a", None, 3.0)),
    ("contact_pressure radius 0", lambda: contact_pressure(np.ones(3), 1.0, np.zeros(3)), ("radius", "> 0")),
    ("contact_pressure impulse", lambda: contact_pressure(["a"], 1.0, np.ones(1)), ("impulse", "real numbers")),
    ("contact_pressure impulse shape", lambda: contact_pressure(np.ones(2), 1.0, np.ones(3)), ("impulse", "(2,)", "3")),
]  # fmt: skip


@table(PRESSURES)
def test_pressures_of_nothing_are_refused(call, words):
    refuses(call, words)


@pytest.mark.parametrize("radius", [0.0, -1.0, NAN, INF, "1", None, True])
def test_crowd_pressure_needs_a_radius(env, radius):
    refuses(lambda: crowd_pressure(env.simulation, radius), ("radius",))


NO_AREA = (
    None,
    3,
    "room",
    [],
    [(0, 0)],
    [(0, 0), (1, 1)],
    [(0, 0), (1, "a"), (1, 1)],
    {"a": 1},
    [(0, 0), (1, NAN), (1, 1)],
)
NO_WKT = (None, 3, "room", b"x", ["a"])
CORNERS = [(0, 0), (5, 0), (5, 5)]
PLANS = [
    *[(f"from_polygon({what!r})", lambda what=what: Geometry.from_polygon(what), ("walkable area",))
      for what in NO_AREA],
    *[(f"from_wkt({what!r})", lambda what=what: Geometry.from_wkt(what), ("walkable area",)) for what in NO_WKT],
    *[(f"{name}={what!r}", lambda name=name, what=what: Geometry.from_polygon(CORNERS, **{name: what}), (name[:4],))
      for name in ("exits", "obstacles", "thin_walls", "regions", "doors") for what in (3, "nowhere", [3], {"a": 3})],
]  # fmt: skip


@table(PLANS)
def test_plans_that_are_none_are_refused(call, words):
    refuses(call, words)


# ------------------------------------------------------------------------------------------------------- plain data


def test_plain_data_configure_an_environment():
    plain = CrowdEnv(
        "room-v0",
        scheme={"name": "nsm2", "tolerance": 1e-3, "social": "lin"},
        observation={"terms": ["velocity", "walls"], "rays": 4},
        reward={"time": 1},
        population={"people": 4, "radius": (0.2, 0.22), "mass": 70},
        num_envs=np.int64(2),
    )
    assert plain.simulation.scheme == NSM2(tolerance=1e-3, social=SocialForce())
    assert plain.layout == ObservationLayout(("velocity", "walls"), rays=4)
    assert plain.reward_weights == RewardWeights({"time": 1.0})
    assert (plain.simulation.bodies.mass == 70).all() and plain.num_people == 8
    plain.reset(seed=0)
    assert plain.step(None).observation.shape == (8, 6)
    whole = CrowdEnv(reward={"weights": {"exit": 2.0}})
    assert whole.reward_weights == RewardWeights({"exit": 2.0})


@pytest.mark.parametrize("name", MAKERS)
def test_plain_data_configure_every_face(name):
    made = MAKERS[name](people=2, scheme={"name": "dem"}, observation={"terms": ["velocity"]}, reward={"time": 1})
    inner = made.unwrapped.env
    assert inner.layout == ObservationLayout(("velocity",)) and inner.simulation.scheme == make_scheme("dem")


TEXT = """{
    "scheme": {"name": "nsm2", "tolerance": 1e-3, "social": "lin"},
    "observation": {"terms": ["velocity", "walls"], "rays": 4},
    "reward": {"weights": {"time": 1, "contact": 0.05}, "team_share": 0.5},
    "population": {"count": 4, "radius": [0.2, 0.22], "mass": 70},
    "action": "discrete", "frame": "world", "time_limit": 3, "strategy": "nearest"
}"""


@pytest.mark.parametrize("name", MAKERS)
def test_a_json_text_configures_every_interface_as_objects_do(name):
    inner = MAKERS[name](**json.loads(TEXT)).unwrapped.env
    objects = CrowdEnv(
        "room-v0",
        scheme=NSM2(tolerance=1e-3, social=SocialForce()),
        observation=ObservationLayout(("velocity", "walls"), rays=4),
        reward=RewardWeights({"time": 1.0, "contact": 0.05}, 0.5),
        population=Population(4, radius=(0.2, 0.22), mass=70.0),
        action=ACTIONS["discrete"],
        frame="world",
        time_limit=3.0,
        strategy="nearest",
    )
    assert inner.layout == objects.layout and inner.reward_weights == objects.reward_weights
    assert inner.simulation.scheme == objects.simulation.scheme and inner.action_kind is objects.action_kind
    seen = [env.reset([3])[0] for env in (inner, objects)]
    np.testing.assert_array_equal(*seen)
    for action in ([0, 1, 2, 8], [7, 0, 0, 0]):
        here, there = inner.step(action), objects.step(action)
        np.testing.assert_array_equal(here.observation, there.observation)
        np.testing.assert_array_equal(here.reward, there.reward)


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"observation": {"terms": "velocity"}}', ("terms", "'velocity'", "tuple of names")),
        ('{"observation": {"terms": ["velocity", 3]}}', ("observation terms", "3", "name")),
        ('{"observation": {"terms": []}}', ("observation", "at least one")),
        ('{"observation": {"terms": ["smell"]}}', ("'smell'", "known: velocity")),
        ('{"observation": {"rays": "8"}}', ("rays", "'8'", "whole number")),
        ('{"reward": {"time": null}}', ("'time'", "None", "number")),
        ('{"reward": {"weights": null}}', ("weights", "None")),
        ('{"reward": {"tme": 1}}', ("'tme'", "known: progress")),
        ('{"scheme": {"tolerance": 1e-3}}', ("contact scheme", "known: ")),
        ('{"scheme": {"name": "nsm2", "tolerance": "1e-3"}}', ("tolerance", "'1e-3'")),
        ('{"action": {"name": "discreet"}}', ("action kind", "known: continuous, discrete")),
        ('{"action": {"name": "speeds", "speeds": [0, 0.5]}}', ("speeds", "rule")),
        ('{"population": {"radius": 0.2}}', ("population", "'people' is missing")),
    ],
)
def test_each_mistake_in_a_json_text_is_one_sentence(name, text, words):
    refuses(lambda: MAKERS[name](**json.loads(text)), words)


def test_every_scenario_says_which_options_it_has():
    for name in SCENARIOS:
        with pytest.raises(ValueError, match=rf"{re.escape(name.removesuffix('-v0'))}.* no option 'color'"):
            crowd_env.make_scenario(name, color=1)
