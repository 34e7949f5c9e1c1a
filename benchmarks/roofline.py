"""How much of what this machine can do a step of dem reaches, in the jam and in the hall, at a step of 0.001 s.

Ceilings are measured by the kernels of `benchmarks/probes.py`.  Two bounds on person-steps per second:

vector bound
    An ideal vector kernel works on the pairs that a neighbor list with a skin of 0.08 m holds, each once, and moves everyone:
    1 / (pairs per person x time of a pair + time of a person).
bandwidth bound
    Everything a step must read and write once, at the bandwidth of the cache that the crowd fits in: 144 bytes a person (ten
    numbers of body and way, position, velocity and force read and written) and 8 a pair.
"""

from benchmarks import probes
from benchmarks.crowds import Crowd
from benchmarks.measuring import Effort, Row, in_turn, significant
from benchmarks.scenes import Scene, hall, jam, overlaps

SCENES = (("jam", 10_000), ("jam", 100_000), ("hall", 10_000), ("hall", 100_000))
BYTES_PERSON, BYTES_PAIR = 144.0, 8.0
FLOPS_PERSON, FLOPS_PAIR = 20.0, 20.0
SKIN = 0.08  # m
_BUILD = {"jam": jam, "hall": hall}


def rows(effort: Effort, scenes: tuple[tuple[str, int], ...] = SCENES) -> list[Row]:
    """Return the ceilings, and the shares of them that dem reaches."""
    effort.tell("bandwidth and arithmetic")
    turns = 4 * effort.blocks
    level = {name: probes.bandwidth(size, turns) for name, size in probes.LEVELS.items()}
    flops, pair = probes.arithmetic(turns), probes.pair_time(turns)
    found = [Row(f"bandwidth in {name}", significant(speed / 1e9, 3), "GB/s") for name, speed in level.items()]
    found.append(Row("arithmetic, multiply-add", significant(flops / 1e9, 3), "GF/s"))
    found.append(Row("a pair in the ideal vector kernel", significant(pair * 1e9, 3), "ns"))
    for case, count in scenes:
        if count <= effort.max_people or count == min(size for _, size in scenes):
            found += measure(effort, case, _BUILD[case](count), level, pair)
    return found


def measure(effort: Effort, case: str, scene: Scene, level: dict[str, float], pair: float) -> list[Row]:
    """Return bounds and shares of one scene."""
    effort.tell(f"{case}, {scene.people} people")
    crowd = Crowd(scene, "dem", 0.001, effort, scene.scenario.field())
    (sample,) = in_turn([crowd], effort)
    bodies, position = crowd.now()
    pairs = len(overlaps(scene.geometry, bodies, position, near=SKIN)) / len(position)
    person = probes.person_time(scene.people, 4 * effort.blocks)
    moved = BYTES_PERSON + BYTES_PAIR * pairs
    home = next((name for name, size in probes.cache_sizes().items() if scene.people * moved <= size), "DRAM")
    bounds = {"vector bound": 1.0 / (pairs * pair + person), "bandwidth bound": level[home] / moved}
    words = {"vector bound": "vector bound", "bandwidth bound": f"bandwidth bound, {home}"}
    work = FLOPS_PERSON + FLOPS_PAIR * pairs
    name = f"{case}, {scene.people} people"
    found = [
        Row(f"{name}: person-steps", significant(sample.rate, 3), "1/CPU s"),
        Row(f"{name}: pairs", significant(pairs, 3), "per person"),
        Row(f"{name}: intensity", significant(work / moved, 3), "flop/byte"),
        Row(f"{name}: arithmetic", significant(work * sample.rate / 1e9, 3), "GF/s"),
    ]
    for bound, most in bounds.items():
        found.append(Row(f"{name}: {bound}", significant(most, 3), "1/s"))
        what = f"{name}: person-steps"
        found.append(
            Row(what, significant(sample.rate, 3), "1/CPU s", words[bound], significant(sample.rate / most, 3))
        )
    return found
