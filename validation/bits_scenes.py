"""The scenes whose bits are compared; a program of its own, run once in each of two source trees.

    PYTHONPATH=TREE python validation/bits_scenes.py NAME ...

It prints one JSON object a line: first what the tree knows, then each scene with a digest of every field at every step.  The
tree may be an old commit, laid out in another way, so only public names of crowd_env are used here, and they are looked up
when a scene needs them: a name that a tree lacks fails the scenes that use it, not the others.
"""

import copy
import dataclasses
import functools
import hashlib
import json
import pickle
import sys
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import crowd_env

Record = dict[str, Any]  # name of a field -> value at one step
Scene = Iterator[Record]


# ------------------------------------------------------------------------------------------------------------ digests


def digests(record: Record) -> dict[str, str]:
    """Return a digest of every array and number in nested records, by name."""
    return {name: _digest(value) for name, value in _flat("", record)}


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _flat(f"{name}.{key}" if name else str(key), part)
    elif value is not None:
        yield name, value


def _digest(value: Any) -> str:
    array = np.ascontiguousarray(value)
    if array.dtype == object:  # arrays of different lengths, or of dictionaries
        data = b"".join(_digest(part).encode() for part in array.ravel() if part is not None)
    else:
        data = array.tobytes()
    return hashlib.sha256(f"{array.dtype} {array.shape} ".encode() + data).hexdigest()[:12]


def _agreeing(what: str, one: Scene, other: Scene) -> Scene:
    """Yield the first of two runs that must not differ; RuntimeError where they do."""
    for step, (record, same) in enumerate(zip_longest(one, other)):
        if record is None or same is None or digests(record) != digests(same):
            raise RuntimeError(f"{what} changes the bits at step {step}")
        yield record


# --------------------------------------------------------------------------------------------------------------- runs


def _seen(simulation: Any) -> Record:
    """Return what a simulation shows: state, contacts with their impulses, diagnostics."""
    found: Record = {"state": simulation.state, "diagnostics": simulation.diagnostics, "escaped": simulation.escaped}
    return {**copy.deepcopy(found), "contacts": simulation.contacts(0)}


def _run(env: Any, steps: int, seed: int, ruled: float = 0.5) -> Scene:
    """Yield what follows from seeded random actions; a share ``ruled`` of the people walks by the rule."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        if env.single_action_space.shape:
            action = rng.uniform(-1.0, 1.0, (env.num_people, 2))
        else:
            action = rng.integers(0, env.single_action_space.n, env.num_people)
        rule = rng.random(env.num_people) < ruled
        try:
            step = env.step(action, rule)
        except FloatingPointError:  # a crowd that diverges must do so in both trees at the same step
            yield {"stopped": True, "state": env.simulation.state.copy()}
            return
        yield {**step._asdict(), **_seen(env.simulation)}


def _said(scenario: Any, *, people: int | None = None, side: float | None = None, **settings: Any) -> dict[str, Any]:
    """Return the arguments of an environment as this tree has them: it may be one from before they came in parts."""
    options = {} if side is None else {"side": side}
    try:
        from crowd_env.envs.settings import arguments_of
    except ImportError:
        number = {} if people is None else {"count": people}
        return {"scenario": scenario, **number, **options, **settings}
    place = {"name": scenario, **options} if options else scenario
    return {"scenario": place, "people": people, **arguments_of(settings)}


def _episode(steps: int, *where: Any, ruled: float = 0.5, **options: Any) -> Scene:
    """Yield the start and the steps of a batch."""
    env = crowd_env.CrowdEnv(**_said(*where, **options))
    observation, _ = env.reset(7)
    yield {"observation": observation, "bodies": env.simulation.bodies, "state": env.simulation.state.copy()}
    yield from _run(env, steps, 11, ruled)


# ------------------------------------------------------------------------------------------- scenes of every scheme


def room(scheme: str) -> Scene:
    """A small room until most are out."""
    return _episode(60, "room-v0", num_envs=2, scheme=scheme, ruled=0.9)


def crowd(scheme: str) -> Scene:
    """More than a thousand people, whose arrays are sorted by place, and more than four thousand, cut into slabs."""
    for count, side, steps in ((1100, 24.0, 15), (4200, 42.0, 4)):
        options: dict[str, Any] = {"people": count, "side": side, "scheme": scheme, "ruled": 0.95}
        one, other = (_episode(steps, "room-v0", threads=threads, **options) for threads in (1, 3))
        yield from _agreeing("the number of threads", one, other)


def threads(scheme: str) -> Scene:
    """Environments of different places on several threads."""
    several = ["room-v0", "pillar-v0", "bottleneck-v0"]
    one, other = (_episode(20, several, num_envs=5, scheme=scheme, threads=count) for count in (1, 3))
    return _agreeing("the number of threads", one, other)


def batch(scheme: str) -> Scene:
    """Environments that begin anew when their short time is over."""
    return _episode(40, "room-v0", num_envs=4, scheme=scheme, time_limit=1.3, autoreset=True)


def theatre(scheme: str) -> Scene:
    """Control rules, stairs, and the fastest way through the crowd as it is."""
    for strategy in ("shortest", "fastest"):
        yield from _episode(40, "theatre-v0", scheme=scheme, strategy=strategy, ruled=1.0)


def doors(scheme: str) -> Scene:
    """Doors that open and close, a rule, a route through a region, a slow zone; found anew as the crowd moves."""
    return _episode(60, _two_halls(), num_envs=2, scheme=scheme, strategy="fastest", ruled=0.95)


def _two_halls() -> Any:
    geometry = crowd_env.Geometry.from_polygon(
        [(0.0, 0.0), (12.0, 0.0), (12.0, 6.0), (0.0, 6.0)],
        exits={"west": [(0.0, 2.5), (0.0, 3.5)], "east": [(12.0, 2.4), (12.0, 3.6)]},
        thin_walls=[[(6.0, 0.0), (6.0, 2.3)], [(6.0, 3.7), (6.0, 4.5)], [(6.0, 5.7), (6.0, 6.0)]],
        regions={
            "left": [(0.0, 0.0), (5.5, 0.0), (5.5, 6.0), (0.0, 6.0)],
            "right": [(7.0, 1.0), (11.0, 1.0), (11.0, 5.0), (7.0, 5.0)],
        },
        doors={"middle": [(6.0, 2.3), (6.0, 3.7)], "side": [(6.0, 4.5), (6.0, 5.7)]},
    )
    return crowd_env.Scenario(
        "two halls",
        geometry,
        crowd_env.Population(40, desired_speed=crowd_env.Uniform(1.0, 2.0), start_region="left"),
        time_limit=20.0,
        routes=(crowd_env.Route("across", ("east",), via="right"),),
        zones=(crowd_env.SpeedZone("right", factor=0.7),),
        rules=(crowd_env.ControlRule("left", 25, "across", hold=1.0),),
        closed_doors=("middle",),
        door_events=(
            crowd_env.DoorEvent("middle", opens=True, at=1.0),
            crowd_env.DoorEvent("side", opens=False, at_least=5, region="right"),
        ),
    )


def social(scheme: str) -> Scene:
    """Every preset of the social force."""
    for name, force in crowd_env.SOCIAL_FORCES.items():
        if force is not None:
            yield {"preset": name.encode()}
            yield from _episode(25, "room-v0", num_envs=2, scheme=crowd_env.make_scheme(scheme, name))


def checkpoint(scheme: str) -> Scene:
    """A run that goes back to a moment in its middle, and another environment that takes it up there."""
    return _taken_up("room-v0", num_envs=2, scheme=scheme, time_limit=2.0, autoreset=True)


def _taken_up(*where: Any, **options: Any) -> Scene:
    first, second = (crowd_env.CrowdEnv(**_said(*where, **options)) for _ in range(2))
    first.reset(3)
    yield from _run(first, 15, 5)
    then = first.checkpoint()
    onward = list(_run(first, 10, 6))
    first.restore(then)
    second.restore(pickle.loads(pickle.dumps(then)))
    yield from _agreeing("to restore", iter(onward), _run(first, 10, 6))
    yield from _agreeing("to take up in another environment", iter(onward), _run(second, 10, 6))


def grains(scheme: str) -> Scene:
    """Discs without a will, thrown at each other and at walls, pushed and spinning."""
    rng, geometry = np.random.default_rng(2), crowd_env.make_scenario("room-v0", side=4.0).geometry
    radius = rng.uniform(0.15, 0.25, 36)
    position = 0.5 + 0.58 * np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    state = crowd_env.make_state(position, rng.normal(0.0, 1.0, (36, 2)))
    state.spin[:] = rng.normal(0.0, 3.0, 36)
    bodies = crowd_env.make_bodies(radius, 1000.0 * radius**2)
    try:
        simulation = crowd_env.Simulation(geometry, bodies, state, scheme=scheme, driving=False)
    except ValueError:  # a scheme for people alone
        yield {"refused": True}
        return
    push = rng.normal(0.0, 50.0, (36, 2))
    for _ in range(30):
        simulation.advance(n_substeps=5, external_force=push)
        yield _seen(simulation)


# ------------------------------------------------------------------------------------ scenes of the scheme by default


def moment() -> Scene:
    """A checkpoint amid doors, rules and ways that follow the crowd."""
    return _taken_up(_two_halls(), strategy="fastest")


def views() -> Scene:
    """Rays and many neighbors, in both frames, with each kind of action and reward."""
    known = {field.name for field in dataclasses.fields(crowd_env.ObservationLayout)}
    seen: dict[str, Any] = {"rays": 16, "neighbors" if "neighbors" in known else "neighbours": 8}
    yield from _episode(20, "pillar-v0", observation=seen, frame="world")
    yield from _episode(20, "pillar-v0", observation=seen, action="discrete", reward=_every_reward())
    yield from _episode(8, "stadium-sector-v0", observation=seen)


def _every_reward() -> Any:
    return crowd_env.RewardWeights({"progress": 1.0, "exit": 0.7, "time": 0.5, "contact": 0.1}, team_share=0.3)


def variants() -> Scene:
    """Schemes with parameters that none in the registry has."""
    nsm2, social = crowd_env.NSM2, crowd_env.SOCIAL_FORCES["helbing"]
    for scheme in (
        nsm2(position_correction=0.3),
        nsm2(relative_tolerance=1e-6),
        crowd_env.DEM(stiffness=5e4),
    ):
        yield from _episode(25, "room-v0", num_envs=2, scheme=scheme)
    yield from _episode(4, "room-v0", people=1100, side=24.0, scheme=crowd_env.DEM(social=social))


def scenarios() -> Scene:
    """Every scenario that ships, by every strategy, whatever the route."""
    for name in crowd_env.SCENARIOS:
        for strategy in ("shortest", "fastest", "comfortable", "nearest"):
            yield {"scenario": f"{name} {strategy}".encode()}
            yield from _episode(4, name, scheme="dem", strategy=strategy)


def parallel() -> Scene:
    """PettingZoo: one agent per pedestrian, some without an action."""
    env = crowd_env.parallel_env(**_said("two-exit-hall-v0", people=40, max_cycles=25, scheme="dem"))
    for agent in env.possible_agents:
        env.action_space(agent).seed(int(agent.rpartition("_")[2]))
    observations, _ = env.reset(seed=4)
    yield {"observations": observations}
    while env.agents:
        actions = {agent: env.action_space(agent).sample() for agent in env.agents[::2]}
        names = ("observations", "rewards", "terminations", "truncations", "infos")
        found: Record = dict(zip(names, env.step(actions), strict=True))
        found["infos"] = {agent: dict(info) for agent, info in found["infos"].items()}
        columns = {name: list(values.values()) for name, values in found.items() if name != "infos"}
        yield {
            **columns,
            "infos": _columns(found["infos"]),
            "agents": " ".join(env.agents).encode(),
            "all": env.state(),
        }


def _columns(rows: dict[str, dict[str, Any]]) -> dict[str, list[bytes]]:
    """Return what the agents are told by name, not by agent: a digest each."""
    told: dict[str, list[bytes]] = {}
    for agent, info in rows.items():
        for name, digest in digests(info).items():
            told.setdefault(name, []).append(f"{agent} {digest}".encode())
    return told


def gym() -> Scene:
    """Gymnasium: one room, and a batch of them that begin anew."""
    yield from _gymnasium(gymnasium.make("crowd_env/room-v0", time_limit=2.0, disable_env_checker=True), 30)
    batch = gymnasium.make_vec("crowd_env/room-v0", num_envs=3, time_limit=1.5, action="discrete")
    yield from _gymnasium(batch, 40)


def routing() -> Scene:
    """One controller that sends people to exits and works the doors, alone and in a batch."""
    options = _said("two-exit-hall-v0", interval=1.0, time_limit=8.0, scheme="dem")
    yield from _gymnasium(gymnasium.make("crowd_env/Routing-v0", disable_env_checker=True, **options), 12)
    options |= {"scenario": _two_halls(), "doors": ("middle", "side"), "regions": ("left", "right")}
    yield from _gymnasium(gymnasium.make_vec("crowd_env/Routing-v0", num_envs=3, **options), 20)


def _gymnasium(env: Any, steps: int) -> Scene:
    env.action_space.seed(9)
    observation, info = env.reset(seed=8)
    yield {"observation": observation, "info": info}
    for _ in range(steps):
        names = ("observation", "reward", "terminated", "truncated", "info")
        found: Record = dict(zip(names, env.step(env.action_space.sample()), strict=True))
        yield found
        if np.ndim(found["reward"]) == 0 and (found["terminated"] or found["truncated"]):
            observation, info = env.reset()
            yield {"observation": observation, "info": info}
    env.close()


OF_SCHEMES = (room, crowd, threads, batch, theatre, doors, social, checkpoint, grains)
OF_ONE = (moment, views, variants, scenarios, parallel, gym, routing)


def scenes() -> dict[str, Callable[[], Scene]]:
    """Return name -> scene: ``room/dem``, ``room/nsm1``, ..., ``views``, ... with all schemes that this tree knows."""
    known: dict[str, Callable[[], Scene]] = {}
    for scene in OF_SCHEMES:
        known |= {f"{scene.__name__}/{name}": functools.partial(scene, name) for name in crowd_env.SCHEMES}
    return known | {scene.__name__: scene for scene in OF_ONE}


def main(names: list[str]) -> None:
    """Print what this tree knows, and the digests of the scenes asked for."""
    known = scenes()
    package = Path(crowd_env.__file__).parent
    print(json.dumps({"package": str(package), "scenes": list(known)}), flush=True)
    for name in names:
        line: dict[str, Any] = {"scene": name, "steps": []}
        try:
            if name in known:
                line["steps"] = [digests(record) for record in known[name]()]
            else:
                line["absent"] = True
        except Exception as error:  # whatever goes wrong in a scene is told, and the next one is run
            line["error"] = f"{type(error).__name__}: {error}"
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
