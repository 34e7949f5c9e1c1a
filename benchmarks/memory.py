"""Bytes that a simulation keeps, by kind: the sum over all its arrays.

People: one row a person.  Neighbors and contacts: lists of pairs, with what finds them, and what the solver needs for them.
Place: walls and travel-time fields, once whatever the crowd.  Of an environment of a batch: everything of the batch over its
environments.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.crowds import Crowd
from benchmarks.measuring import Effort, Row, significant
from benchmarks.scenes import jam
from crowd_env import CrowdEnv, Simulation
from crowd_env.core.kernels.struct_ref import StructRef

SIZE = 10_000
_SCHEMES = (("dem", 0.001), ("nsm1", 0.01), ("nsm2", 0.01), ("hertz", 0.001))
_PLACE = ("field", "way", "boundary", "geometr", "guidance", "place")


def rows(effort: Effort) -> list[Row]:
    """Return bytes a person of a jam under each scheme, and a room of a batch."""
    scene = jam(effort.sizes((1_000, SIZE))[-1])
    field = scene.scenario.field()
    found = []
    for scheme, dt in _SCHEMES:
        effort.tell(f"{scheme}, {scene.people} people")
        crowd = Crowd(scene, scheme, dt, effort, field)
        sums = by_kind(crowd.simulation, scene.people)
        for kind in ("people", "neighbors and contacts"):
            what = f"{scheme}, {scene.people} people: {kind}"
            found.append(Row(what, significant(sums[kind] / scene.people, 3), "bytes/person"))
        found.append(Row(f"{scheme}, {scene.people} people: place", significant(sums["place"] / 1e6, 3), "MB"))
    env = CrowdEnv("room-v0", num_envs=64, physics="nsm2", autoreset=True)
    env.reset(seed=0)
    env.step(None)
    total = sum(array.nbytes for _, array in arrays(env))
    found.append(Row("nsm2, room of 20 in a batch of 64: everything", significant(total / 64e3, 3), "kB"))
    return found


def by_kind(simulation: Simulation, people: int) -> dict[str, int]:
    """Return the bytes of people, of lists of pairs, and of the place."""
    sums = {"people": 0, "neighbors and contacts": 0, "place": 0}
    for path, array in arrays(simulation):
        if ".near." in path:
            sums["neighbors and contacts"] += array.nbytes
        elif len(array) in (people, people + 1):
            sums["people"] += array.nbytes
        elif any(word in path for word in _PLACE) or len(array) < people:
            sums["place"] += array.nbytes
        else:
            sums["neighbors and contacts"] += array.nbytes
    return sums


def arrays(root: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield every array that can be reached from an object, once, with the names on the way to it; views as their base."""
    seen: set[int] = set()
    waiting: list[tuple[str, Any]] = [("", root)]
    while waiting:
        path, thing = waiting.pop()
        while isinstance(thing, np.ndarray) and isinstance(thing.base, np.ndarray):
            thing = thing.base
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            if thing.ndim:
                yield path, thing
        elif isinstance(thing, tuple) and hasattr(thing, "_fields"):
            waiting += [(f"{path}.{name}", part) for name, part in zip(thing._fields, thing, strict=True)]
        elif isinstance(thing, list | tuple):
            waiting += [(path, part) for part in thing]
        elif isinstance(thing, StructRef):
            waiting.append((path, thing.fields))  # named as what it refers to
        elif isinstance(thing, dict):
            waiting += [(f"{path}.{name}", part) for name, part in thing.items()]
        elif type(thing).__module__.startswith("crowd_env"):
            names = [*getattr(thing, "__dict__", {}), *getattr(type(thing), "__slots__", ())]
            waiting += [(f"{path}.{name}", getattr(thing, name, None)) for name in names]
