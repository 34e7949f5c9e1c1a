"""What `CrowdEnv` and its faces are given: refused in one sentence before anything is run, or taken as plain data."""

import inspect
import json
import re
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from cases import looped
from refusals import INF, NAN, NO_CHOICE, NO_FLAG, numeric, refuses, rows, table

import crowd_env
from crowd_env import (
    NSM2,
    SCENARIOS,
    CrowdEnv,
    CrowdGymEnv,
    CrowdParallelEnv,
    CrowdVectorEnv,
    Geometry,
    ObservationLayout,
    Physics,
    Population,
    RewardWeights,
    Routing,
    Scenario,
    SocialForce,
    Walking,
    contact_pressure,
    crowd_pressure,
    make_scenario,
    make_vec,
    parallel_env,
)
from crowd_env.envs.action import ACTIONS
from crowd_env.envs.parallel import env as aec_env
from crowd_env.envs.routing.env import RoutingEnv, RoutingVectorEnv
from crowd_env.envs.settings import EnvArguments

PARTS = {"dt": "physics", "threads": "physics", "acts_on": "walking", "signs": "routing"}


def of(name, make=CrowdEnv, **others):
    """Return what makes an environment of a value of an argument, or of a field of one of its parts."""
    if name in PARTS:
        return lambda value: make(**{**others, PARTS[name]: {name: value}})
    return lambda value: make(**{**others, name: value})


@pytest.fixture(scope="module")
def env():
    made = CrowdEnv("room-v0", num_envs=2, people=3, physics="dem")
    made.reset([0, 1])
    return made


CONSTRUCTOR = [
    *rows("CrowdEnv.scenario", of("scenario"), (None, 7, 1.5, True, Scenario, {"a": 1}, [7], [None], b"x")),
    ("no scenario", lambda: CrowdEnv([]), ("no scenario",)),
    ("unknown scenario", lambda: CrowdEnv("nowhere"), ("'nowhere'", "room-v0")),
    ("two numbers", lambda: CrowdEnv({"name": "room-v0", "people": 5}, people=12), ("people=5", "people=12")),
    ("unknown option", lambda: CrowdEnv({"name": "room-v0", "sides": 3.0}), ("'sides'", "did you mean 'side'")),
    ("option of a Scenario", lambda: make_scenario(make_scenario("room-v0"), side=3.0), ("side", "name")),
    *numeric("CrowdEnv.num_envs", of("num_envs"), "count"),
    *rows("CrowdEnv.num_envs", of("num_envs"), (10**9, 500_001)),
    *numeric("CrowdEnv.threads", of("threads"), "count"),
    *rows("CrowdEnv.threads", of("threads"), (10**6,)),
    *numeric("CrowdEnv.dt", of("dt"), "positive", or_none=True),
    *numeric("CrowdEnv.decision_dt", of("decision_dt"), "positive", or_none=True),
    ("decision_dt and dt", lambda: CrowdEnv(decision_dt=0.1, physics=Physics(dt=0.03)), ("whole number", "0.03")),
    ("dt tiny", lambda: CrowdEnv(decision_dt=1e300, physics=Physics(dt=1e-300)), ("decision_dt", "at most 100000")),
    ("dt small", lambda: CrowdEnv(physics=Physics(dt=1e-9)), ("decision_dt", "1e+08 physics steps", "at most 100000")),
    ("decision_dt short", lambda: CrowdEnv(decision_dt=0.004), ("decision_dt", "whole number")),
    ("dt unstable", lambda: CrowdEnv(physics=Physics(dt=1.0), decision_dt=1.0), ("dt = 1 s", "stable")),
    ("dt unstable for dem", lambda: CrowdEnv(physics=Physics("dem", dt=0.1)), ("dem", "stable step")),
    ("door_width", lambda: CrowdEnv({"name": "room-v0", "door_width": 0.3}), ("0.30 m", "narrower", "0.40 m")),
    *numeric("CrowdEnv.time_limit", of("time_limit"), "positive", or_none=True),
    ("frame unknown", lambda: CrowdEnv(action={"name": "continuous", "frame": "polar"}), ("'polar'", "path", "world")),
    *rows("CrowdEnv.action", of("action"), NO_CHOICE),
    *rows("CrowdEnv.acts_on", of("acts_on"), (*NO_CHOICE, None)),
    *rows("CrowdEnv.autoreset", of("autoreset"), NO_FLAG),
    *rows("CrowdEnv.signs", of("signs"), NO_FLAG),
    *[(f"routing {value!r}", lambda value=value: CrowdEnv(routing=value), ("strategy",)) for value in (3, b"x", "slow")],
    *[(f"physics {value!r}", lambda value=value: CrowdEnv(physics=value), ("scheme",)) for value in (3, NSM2, ["nsm2"])],
    *[(f"walking {value!r}", lambda value=value: CrowdEnv(walking=value), ("manner",)) for value in (3, ["calm"], "slow")],
    ("scheme unknown", lambda: CrowdEnv(physics="nsm3"), ("'nsm3'", "nsm2")),
    ("scheme key", lambda: CrowdEnv(physics={"name": "nsm2", "tolerence": 1}), ("'tolerence'", "tolerance")),
    ("scheme social", lambda: CrowdEnv(physics=NSM2(social="lim")), ("social", "'lim'", "lin", "helbing")),
    *rows("CrowdEnv.observation", of("observation"), ("velocity", ["velocity"], 3, True, ObservationLayout, RewardWeights())),
    ("observation key", lambda: CrowdEnv(observation={"term": ["push"]}), ("observation", "'term'", "terms")),
    ("observation terms", lambda: CrowdEnv(observation={"terms": "push"}), ("observation", "terms", "('push',)")),
    ("observation unknown", lambda: CrowdEnv(observation={"terms": ["smell"]}), ("'smell'", "velocity")),
    ("observation number", lambda: CrowdEnv(observation={"rays": 2.5}), ("observation", "rays", "2.5")),
    *rows("CrowdEnv.reward", of("reward"), ("time", ["time"], 3, True, RewardWeights, ObservationLayout())),
    ("reward unknown", lambda: CrowdEnv(reward={"joy": 1.0}), ("'joy'", "progress")),
    ("reward key", lambda: CrowdEnv(reward={"weights": {"time": 1.0}, "share": 1}), ("reward", "'share'", "weights")),
    ("reward weight", lambda: CrowdEnv(reward={"time": "1"}), ("'time'", "'1'")),
    ("population key", lambda: CrowdEnv({"name": "room-v0", "population": {"number": 3}}), ("'number'", "people")),
    ("population lacks", lambda: CrowdEnv({"name": "room-v0", "population": {"radius": 0.2}}), ("'people' is missing",)),
    ("too many people", lambda: CrowdEnv(people=1000), ("1000 people do not fit",)),
    *rows("CrowdEnv.people", of("people"), (2.5, "20", True, NAN, 0, -1, 10**9)),
]  # fmt: skip

MAKERS = {
    "make_vec": make_vec,
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
        *rows(f"{name}.time_limit", of("time_limit", make), ("60", INF)),
        *rows(f"{name}.people", of("people", make), (2.5, 10**9)),
    )
] + list(rows("make_vec.num_envs", of("num_envs", make_vec), (2.5, "2", 0, None, True, 10**9)))


@looped("name,call,words", [*CONSTRUCTOR, *FACES])
def test_what_makes_no_sense_is_refused_in_one_sentence(name, call, words):
    refuses(call, words)


# An argument of a part of the settings, or misspelt -> the words that its answer must hold.
ELSEWHERE = {
    **dict.fromkeys(("scheme", "dt", "outline", "max_drive", "balance", "threads"), "say physics=Physics("),
    **dict.fromkeys(("manner", "acts_on", "pulls"), "say walking=Walking("),
    "strategy": "say routing=Routing(",
    "obsevation": "did you mean 'observation'?", "door_width": "make_scenario('room-v0', door_width=...)",
}  # fmt: skip


@looped("name,word", ELSEWHERE.items())
def test_an_argument_that_there_is_not_is_answered_by_how_it_is_said(name, word):
    for make in (CrowdEnv, *MAKERS.values(), RoutingEnv, RoutingVectorEnv):
        with pytest.raises(TypeError) as caught:
            make(**{name: 1})
        assert repr(name) in str(caught.value) and word in str(caught.value).partition("has no argument")[2]


@looped("make", (CrowdGymEnv, CrowdParallelEnv, RoutingEnv))
def test_one_environment_has_nothing_of_a_batch(make):
    for name in ("num_envs", "autoreset"):
        with pytest.raises(TypeError, match=f"has no argument '{name}'; it belongs to a batch, .*make_vec"):
            make(**{name: 2})


def test_every_face_shows_the_same_arguments():
    of_batch = {name: one for name, one in inspect.signature(CrowdEnv).parameters.items()}
    assert len(of_batch) == 12
    shared = {name: one for name, one in of_batch.items() if name not in ("num_envs", "autoreset")}
    for make in (CrowdParallelEnv, parallel_env, aec_env, CrowdGymEnv, CrowdVectorEnv, make_vec):
        theirs = inspect.signature(make).parameters
        assert all(theirs[name].default == one.default for name, one in shared.items()), make
    assert set(EnvArguments.__annotations__) == set(shared) - {"scenario"}


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


@looped(("said", "action"), ARRAYS)
def test_actions_that_are_none_are_refused(env, said, action):
    before = env.simulation.state.copy()
    refuses(lambda: env.step(action), ("action", said))
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, env.simulation.state, strict=True))


@looped(
    ("action", "said"),
    [
        *[(action, "action") for action in ("no", 1.5, [1j] * PEOPLE, [0])],
        ([9] * PEOPLE, "pedestrian 0 is 9; it must be 0 to 8"),
        *[([value] * PEOPLE, "0 to 8") for value in (-1, 0.5, NAN)],
        (np.zeros((PEOPLE, 2)), "has the shape (6, 2); it must be (6,)"),
    ],
)
def test_discrete_actions_that_are_none_are_refused(action, said):
    discrete = CrowdEnv("room-v0", num_envs=2, people=3, physics="dem", action="discrete")
    discrete.reset([0, 1])
    refuses(lambda: discrete.step(action), ("action", said))
    assert not discrete.simulation.state.time.any()


@looped("scripted", ["no", True, 1.0, np.zeros(PEOPLE), np.zeros(PEOPLE - 1, bool), ["no"] * PEOPLE, {}])
def test_who_is_scripted_is_said_by_flags(env, scripted):
    refuses(lambda: env.step(np.zeros((PEOPLE, 2)), scripted), ("scripted",))


@looped("mask", ["no", True, [1, 0], np.zeros(3, bool), [0.5, 0.5], {}, [[True], [True]]])
def test_masks_that_are_no_flags_are_refused(env, mask):
    refuses(lambda: env.reset(mask=mask), ("mask",))


@looped(
    ("seed", "said"),
    [
        *[(seed, "seed") for seed in (1.5, "0", True, NAN, [0, 1, 2], [0, "1"], [0, True], {}, 1j)],
        *[(-1, "at least 0"), ([0, -1], "at least 0"), ([0], "1 seeds for 2")],
    ],
)
def test_seeds_that_are_none_are_refused(env, seed, said):
    refuses(lambda: env.reset(seed), ("seed", said))


@looped("e", [-1, 2, 0.5, "0", None, NAN, True, [0]])
def test_environments_that_are_not_there_have_no_metrics_and_no_people(env, e):
    refuses(lambda: env.metrics(e), ("environment", "0 to 1"))
    refuses(lambda: env.people(e), ("environment", "0 to 1"))
    assert env.metrics(np.int64(1)).unfinished == 3 and env.people(1) == slice(3, 6)


def test_who_is_active_is_an_array_of_ones_own(env):
    env.reset([0, 1])
    before = env.active
    before[0] = False
    assert env.active.all()
    one = CrowdEnv(make_scenario("room-v0", side=2.0), people=2, physics="dem")
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
        make_scenario("room-v0", population={"people": 4, "radius": (0.2, 0.22), "mass": 70}),
        physics={"name": "nsm2", "tolerance": 1e-3, "social": "lin"},
        observation={"terms": ["velocity", "walls"], "rays": 4},
        reward={"time": 1},
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


TEXT = """{
    "scenario": {"name": "room-v0", "population": {"people": 4, "radius": [0.2, 0.22], "mass": 70}},
    "physics": {"scheme": {"name": "nsm2", "tolerance": 1e-3, "social": "lin"}, "threads": 1},
    "walking": {"manner": "calm", "acts_on": "scripted"},
    "routing": {"strategy": "nearest", "signs": false},
    "observation": {"terms": ["velocity", "walls"], "rays": 4},
    "reward": {"weights": {"time": 1, "contact": 0.05}, "team_share": 0.5},
    "action": {"name": "discrete", "frame": "world"}, "time_limit": 3
}"""


@pytest.mark.parametrize("name", MAKERS)
def test_a_json_text_configures_every_interface_as_objects_do(name):
    inner = MAKERS[name](**json.loads(TEXT)).unwrapped.env
    objects = CrowdEnv(
        make_scenario("room-v0", population=Population(4, radius=(0.2, 0.22), mass=70.0)),
        physics=NSM2(tolerance=1e-3, social=SocialForce()),
        walking=Walking("calm", acts_on="scripted"),
        routing=Routing("nearest", signs=False),
        observation=ObservationLayout(("velocity", "walls"), rays=4),
        reward=RewardWeights({"time": 1.0, "contact": 0.05}, 0.5),
        action=replace(ACTIONS["discrete"], frame="world"),
        time_limit=3.0,
    )
    assert inner.layout == objects.layout and inner.reward_weights == objects.reward_weights
    assert inner.simulation.scheme == objects.simulation.scheme and inner.action_kind == objects.action_kind
    seen = [env.reset([3])[0] for env in (inner, objects)]
    np.testing.assert_array_equal(*seen)
    for action in ([0, 1, 2, 8], [7, 0, 0, 0]):
        here, there = inner.step(action), objects.step(action)
        np.testing.assert_array_equal(here.observation, there.observation)
        np.testing.assert_array_equal(here.reward, there.reward)


@looped(
    "text,words",
    [
        ('{"observation": {"terms": "velocity"}}', ("terms", "'velocity'", "tuple of names")),
        ('{"observation": {"terms": ["velocity", 3]}}', ("observation terms", "3", "name")),
        ('{"observation": {"terms": []}}', ("observation", "at least one")),
        ('{"observation": {"terms": ["smell"]}}', ("'smell'", "known: velocity")),
        ('{"observation": {"rays": "8"}}', ("rays", "'8'", "whole number")),
        ('{"reward": {"time": null}}', ("'time'", "None", "number")),
        ('{"reward": {"weights": null}}', ("weights", "None")),
        ('{"reward": {"tme": 1}}', ("'tme'", "known: progress")),
        ('{"physics": {"tolerance": 1e-3}}', ("contact scheme", "known: ")),
        ('{"physics": {"name": "nsm2", "tolerance": "1e-3"}}', ("tolerance", "'1e-3'")),
        ('{"action": {"name": "discreet"}}', ("action kind", "known: continuous, discrete")),
        ('{"action": {"name": "speeds", "speeds": [0, 0.5]}}', ("speeds", "rule")),
        ('{"scenario": {"name": "room-v0", "population": {"radius": 0.2}}}', ("population", "'people' is missing")),
    ],
)
def test_each_mistake_in_a_json_text_is_one_sentence(text, words):
    for make in MAKERS.values():
        refuses(lambda make=make: make(**json.loads(text)), words)


def test_every_scenario_says_which_options_it_has():
    for name in SCENARIOS:
        with pytest.raises(ValueError, match=rf"{re.escape(name.removesuffix('-v0'))}.* no option 'color'"):
            crowd_env.make_scenario(name, color=1)
