"""Bytes that a simulation keeps in arrays: those with a row for each pedestrian, and all; and an environment of a batch."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.crowds import Crowd
from benchmarks.measuring import Effort, Row
from benchmarks.scaling import WAYS
from benchmarks.scenes import jam
from crowd_env import CrowdEnv
from crowd_env.core.kernels.struct_ref import StructRef


def rows(effort: Effort) -> list[Row]:
    """Return bytes a pedestrian of a jam under each scheme, and a room of a batch."""
    scene = jam(effort.sizes((1_000, 10_000))[-1])
    field, found = scene.scenario.field(), []
    for way in WAYS:
        every = list(arrays(Crowd(scene, way, field).simulation))
        mine = sum(array.nbytes for array in every if len(array) in (scene.people, scene.people + 1))
        who = f"{way.scheme}, {scene.people} people"
        found.append(Row(who, "a row for each, bytes per person", mine / scene.people))
        found.append(Row(who, "everything, MB", sum(array.nbytes for array in every) / 1e6))
    env = CrowdEnv("room-v0", num_envs=64, physics="nsm2", autoreset=True)
    env.reset(seed=0)
    env.step(None)
    total = sum(array.nbytes for array in arrays(env)) / 64e6
    return [*found, Row("nsm2, room of 20 in a batch of 64", "everything, MB", total)]


def arrays(root: Any) -> Iterator[np.ndarray]:
    """Yield every array that can be reached from an object, once; views as their base."""
    seen: set[int] = set()
    waiting: list[Any] = [root]
    while waiting:
        thing = waiting.pop()
        while isinstance(thing, np.ndarray) and isinstance(thing.base, np.ndarray):
            thing = thing.base
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            if thing.ndim:
                yield thing
        elif isinstance(thing, StructRef):
            waiting.append(thing.fields)
        elif isinstance(thing, list | tuple):
            waiting += thing
        elif isinstance(thing, dict):
            waiting += thing.values()
        elif type(thing).__module__.startswith("crowd_env"):
            names = [*getattr(thing, "__dict__", {}), *getattr(type(thing), "__slots__", ())]
            waiting += [getattr(thing, name, None) for name in names]
