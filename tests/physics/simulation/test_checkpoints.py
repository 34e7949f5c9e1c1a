"""A checkpoint put back: what follows is, bit by bit, what followed it then."""

import copy
import pickle
from functools import partial

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box

import crowd_env.physics.simulation.simulation
import crowd_env.physics.spatial_order
from crowd_env import FULL_SPEED, CrowdEnv, Geometry, Physics, Population, Scenario, make_scenario
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.physics import DEM, SCHEMES, SOCIAL_FORCES, make_scheme
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.physics.workspace import allocate_workspace
from crowd_env.routing.spec import ControlRule, DoorEvent, Route

every_scheme = pytest.mark.parametrize("scheme", SCHEMES)


def hall(**options):
    """Return a place with a rule, a door that closes and opens, and a long way round."""
    return Scenario(
        "hall",
        Geometry.from_polygon(
            box(0, 0, 8, 6),
            exits={"west": [(0, 3.6), (0, 2.4)], "east": [(8, 2.4), (8, 3.6)]},
            regions={"middle": [(3, 0), (5, 0), (5, 6), (3, 6)]},
            doors={"west": "west"},
        ),
        Population(40),
        options.pop("time_limit", 1e3),
        routes=(Route("by-west", ("west",)), Route("by-east", ("east",))),
        rules=(ControlRule("middle", 8, "by-east", below=5, hold=0.3),),
        door_events=(DoorEvent("west", False, at=0.55), DoorEvent("west", True, at=1.25)),
        **{**FULL_SPEED, **options},
    )


def seen(env, steps, rng):
    """Return the bytes of all that so many steps show; most people follow the rule."""
    found = []
    for _ in range(steps):
        step = env.step(rng.uniform(-1, 1, (env.num_people, 2)), np.arange(env.num_people) % 4 > 0)
        simulation, episode = env.simulation, env._transition
        arrays = (
            *step[:4],
            *simulation.state,
            simulation.results.impulse,
            simulation.results.impulse_magnitude,
            episode.impulse,
        )
        terms = [values for name, values in step.info.items() if name.startswith("reward/")]
        found.append(b"".join(np.ascontiguousarray(a).tobytes() for a in (*arrays, *terms, *simulation.diagnostics)))
        contacts = simulation.contacts(0)
        found.append(b"".join(a.tobytes() for a in contacts[:5]))
        found.append(repr([env.metrics(e) for e in range(env.num_envs)]))
    return found


def goes_on(make, before=7, after=7):
    """Check that a run that goes back goes on as it did, in the same environment and in another, from a pickle too."""
    env = make()
    env.reset(list(range(env.num_envs)))
    seen(env, before, np.random.default_rng(1))
    checkpoint = env.checkpoint()
    expected = seen(env, after, np.random.default_rng(2))
    seen(env, 3, np.random.default_rng(3))
    env.restore(checkpoint)
    assert seen(env, after, np.random.default_rng(2)) == expected
    other = make()
    other.restore(pickle.loads(pickle.dumps(checkpoint)))
    assert seen(other, after, np.random.default_rng(2)) == expected
    used = make()
    used.reset([9] * used.num_envs)
    seen(used, 2, np.random.default_rng(3))
    used.restore(checkpoint)
    assert seen(used, after, np.random.default_rng(2)) == expected
    return env


@every_scheme
def test_a_run_goes_on_as_if_nothing_had_been_in_between(scheme):
    goes_on(lambda: CrowdEnv("room-v0", num_envs=2, physics=scheme, action={"name": "continuous", "frame": "world"}))


@every_scheme
@pytest.mark.parametrize("strategy", [pytest.param("shortest", marks=pytest.mark.more), "fastest"])
def test_doors_rules_and_fields_too(scheme, strategy):
    place = hall()
    env = goes_on(lambda: CrowdEnv(place, num_envs=2, people=20, physics=scheme, routing=strategy))
    assert env.simulation.state.time[0] > 1.3  # both doors have moved since then
    assert env.simulation.history.rule_on.shape == (2, 1)


@every_scheme
def test_large_crowds_beside_small_ones_too(scheme, monkeypatch):
    monkeypatch.setattr(crowd_env.physics.spatial_order, "MANY", 40)
    places = [make_scenario("room-v0", people=count, side=6.0) for count in (60, 12)]
    goes_on(lambda: CrowdEnv(places, num_envs=2, physics=scheme, action={"name": "continuous", "frame": "world"}))


def test_a_crowd_of_more_than_a_thousand_too():
    goes_on(lambda: CrowdEnv(make_scenario("room-v0", side=26.0), people=1050, physics="dem"), before=4, after=4)


def test_the_episodes_that_follow_too():
    options = {"num_envs": 2, "time_limit": 1.0, "autoreset": True, "physics": "dem"}
    goes_on(lambda: CrowdEnv("two-exit-hall-v0", routing="fastest", **options), before=5, after=15)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_a_copy_of_an_environment_goes_on_alike_when_doors_and_growth_replace_arrays(copied, monkeypatch):
    few = partial(allocate_workspace, per_person=1)
    monkeypatch.setattr(crowd_env.physics.simulation.simulation, "allocate_workspace", few)
    env = CrowdEnv(hall(), num_envs=2, physics=DEM(social=SOCIAL_FORCES["lin"]), routing="fastest")
    env.reset([0, 1])
    other = copied(env)
    before = len(other.simulation.workspace.neighbors.owner)
    expected = seen(env, 14, np.random.default_rng(2))
    assert env.simulation.state.time[0] > 1.3  # both doors have moved since then
    assert seen(other, 14, np.random.default_rng(2)) == expected
    assert len(other.simulation.workspace.neighbors.owner) > before


def spoil(fields, rng):
    """Fill arrays with rubbish, but for where entries lie, whether there is a list, and how long one should last."""
    for name, values in fields._asdict().items():
        values = getattr(values, "fields", values)  # of a part that is held by reference
        if hasattr(values, "_fields"):
            spoil(values, rng)
        elif name not in ("entry_start", "is_valid", "horizon"):
            values[...] = (
                rng.normal(size=values.shape) if values.dtype.kind == "f" else rng.integers(0, 2, values.shape)
            )


@every_scheme
def test_what_is_to_come_depends_on_nothing_in_the_workspace(scheme):
    env = CrowdEnv(hall(), num_envs=2, physics=scheme)
    env.reset([0, 1])
    seen(env, 4, np.random.default_rng(1))
    checkpoint = env.checkpoint()
    expected = seen(env, 4, np.random.default_rng(2))
    env.restore(checkpoint)
    spoil(env.simulation.workspace, np.random.default_rng(3))
    assert seen(env, 4, np.random.default_rng(2)) == expected


def test_an_environment_that_goes_back_comes_to_its_end():
    env = CrowdEnv("room-v0", physics="dem")
    env.reset([0])
    for _ in range(5):
        env.step(None)
    saved, ends = env.checkpoint(), []
    for _ in range(2):
        env.restore(saved)
        steps = 0
        while not env.finished.all():
            env.step(None)
            steps += 1
            assert steps < 200
        ends.append((steps, env.metrics(0)))
    assert repr(ends[0]) == repr(ends[1])


def test_whoever_holds_an_array_sees_that_moment():
    env = CrowdEnv("room-v0", physics="dem")
    env.reset([0])
    position, crush, radius = (
        env.simulation.state.position,
        env.simulation.results.impulse_magnitude,
        env.simulation.bodies.radius,
    )
    saved, there = env.checkpoint(), position.copy()
    env.step(None)
    assert (position != there).any()
    env.restore(saved)
    np.testing.assert_array_equal(position, there)
    assert env.simulation.state.position is position
    assert env.simulation.results.impulse_magnitude is crush
    assert env.simulation.bodies.radius is radius
    env.step(None)
    assert (saved.behind.state.position == there).all()  # the checkpoint is a copy


@pytest.mark.parametrize("name", ["world", "state", "bodies", "results", "history", "workspace"])
def test_nothing_can_be_replaced_behind_the_back_of_those_who_look(name):
    env = CrowdEnv("room-v0")
    env.reset([0])
    before = getattr(env.simulation, name)
    with pytest.raises(AttributeError, match=rf"^{name} cannot be replaced, .*checkpoint\(\) and restore\(\)$"):
        setattr(env.simulation, name, copy.deepcopy(before))
    assert getattr(env.simulation, name) is before


@looped(
    ("change", "what"),
    [
        ({"physics": "nsm1"}, "scheme"),
        ({"physics": Physics("dem", dt=0.005)}, "dt"),
        ({"num_envs": 2}, "env_start"),
        ({"people": 19}, "env_start"),
        ({"scenario": {"name": "room-v0", "side": 7.0}}, "place"),
        ({"routing": "comfortable"}, "routing"),
        ({"physics": Physics("dem", max_drive=200.0)}, "max_drive"),
        ({"decision_dt": 0.2}, "decision_dt"),
        ({"action": {"name": "continuous", "frame": "world"}}, "frame"),
        ({"time_limit": 9.0}, "time_limit"),
    ],
)
def test_a_checkpoint_of_another_environment_is_refused_before_anything_changes(change, what):
    options = {"scenario": "room-v0", "physics": "dem", "num_envs": 1}
    other = CrowdEnv(**{**options, **change})
    other.reset([1] * other.num_envs)
    here = CrowdEnv(**options)
    here.reset([0])
    before = here.simulation.state.copy()
    with pytest.raises(ValueError, match=f"^the checkpoint fits another (simulation|environment): its {what} differs"):
        here.restore(other.checkpoint())
    for ours, then in zip(here.simulation.state, before, strict=True):
        np.testing.assert_array_equal(ours, then)


def test_a_checkpoint_of_people_who_keep_longer_to_an_exit_is_refused():
    env, other = (
        CrowdEnv("two-exit-hall-v0", physics="dem", action={"name": "speeds-exits", "dwell": dwell})
        for dwell in (1.0, 5.0)
    )
    other.reset(0)
    with pytest.raises(ValueError, match=r"fits another environment: its dwell differs: 5\.0, here 1\.0$"):
        env.restore(other.checkpoint())


def test_what_is_no_checkpoint_is_refused():
    env = CrowdEnv("room-v0", physics="dem")
    env.reset([0])
    with pytest.raises(TypeError, match=r"^restore takes a checkpoint\(\) of a simulation, not CrowdState$"):
        env.simulation.restore(env.simulation.state.copy())
    with pytest.raises(TypeError, match=r"^restore takes a checkpoint\(\) of an environment, not Checkpoint$"):
        env.restore(env.simulation.checkpoint())


def test_an_environment_does_not_go_on_when_the_simulation_alone_was_restored():
    env = CrowdEnv("room-v0", physics="dem")
    env.reset([0])
    saved, whole = env.simulation.checkpoint(), env.checkpoint()
    env.step(None)
    env.simulation.restore(saved)
    with pytest.raises(
        ValueError, match=r"^the Simulation alone was restored, the CrowdEnv was not; restore or reset that$"
    ):
        env.step(None)
    env.restore(whole)
    env.step(None)
    env.simulation.restore(saved)
    env.reset([0])
    env.step(None)


@every_scheme
def test_a_simulation_by_itself_goes_back_to_any_of_its_steps(scheme):
    place = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2), (5, 3)]])
    spots = np.random.default_rng(0).permutation(
        np.stack(np.meshgrid(*[np.linspace(0.5, 4.5, 8)] * 2), -1).reshape(-1, 2)
    )
    bodies = make_bodies(np.full(40, 0.25), 80.0, desired_speed=1.5)
    simulation = Simulation(place, bodies, make_state(spots[:40]), physics=make_scheme(scheme))
    steps = round(0.1 / simulation.dt)
    for _ in range(8):
        simulation.advance(n_substeps=steps)
    simulation.advance(n_substeps=3)
    saved = simulation.checkpoint()
    simulation.advance(n_substeps=5 * steps)
    expected = simulation.state.copy()
    for _ in range(2):
        simulation.restore(saved)
        simulation.advance(n_substeps=5 * steps)
        for ours, then in zip(simulation.state, expected, strict=True):
            np.testing.assert_array_equal(ours, then)


@pytest.mark.parametrize("name", SCHEMES)
def test_whoever_is_let_in_by_hand_is_touched_at_once(name):
    place = Geometry.from_polygon([(0, 0), (6, 0), (6, 4), (0, 4)], exits={"e": [(6, 1.5), (6, 2.5)]})
    state = make_state([[1.4, 2.0], [1.91, 2.0]], [[1.2, 0.0], [0.0, 0.0]])
    state.active[1] = False
    bodies = make_bodies([0.25, 0.25], 80.0, desired_speed=1.2)
    simulation = Simulation(place, bodies, state, physics=name)
    steps = round(0.01 / simulation.dt)
    simulation.advance(n_substeps=steps)
    state.active[1] = True  # nobody has moved further than the list allows for
    overlap = 0.0
    for _ in range(30):
        simulation.advance(np.array([[1.0, 0.0], [0.0, 0.0]]), n_substeps=steps)
        overlap = max(overlap, 0.5 - np.hypot(*(state.position[1] - state.position[0])))
    assert overlap < 0.03
