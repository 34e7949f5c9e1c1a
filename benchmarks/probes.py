"""What this machine can do at best, measured by small kernels: bandwidth, arithmetic, pairs of discs, and the step of a person.

Compiled when first called; fast-math on, unlike in crowd_env, since they set the ceiling.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Level -> elements of each of three arrays of float64: 24 kB, 400 kB, 6 MB, 192 MB in all.
LEVELS = {"L1": 1_000, "L2": 16_000, "L3": 250_000, "DRAM": 8_000_000}
DEGREE = 32  # of the polynomial of the multiply-add loop

_fast = numba.njit(fastmath=True, error_model="numpy", cache=False)


@_fast
def triad(a: Floats, b: Floats, c: Floats, scalar: float, repeats: int) -> None:
    """a = b + scalar c, so many times."""
    for k in range(repeats):
        factor = scalar + 1e-9 * k
        for i in range(len(a)):
            a[i] = b[i] + factor * c[i]


@_fast
def multiply_add(x: Floats, slope: float, repeats: int) -> float:
    """Horner's rule with one coefficient: two operations a degree, no memory to speak of."""
    total = 0.0
    for k in range(repeats):
        offset = 1e-9 * k
        for i in range(len(x)):
            value = x[i]
            for _ in range(32):
                value = value * slope + offset
            total += value
    return total


@_fast
def all_pairs(x: Floats, y: Floats, radius: Floats, stiffness: float, out: Floats) -> None:
    """Springs between all discs: the inner loop only sums, so that it becomes vector instructions."""
    for i in range(len(x)):
        xi, yi, ri, fx, fy = x[i], y[i], radius[i], 0.0, 0.0
        for j in range(len(x)):
            dx, dy = xi - x[j], yi - y[j]
            distance = np.sqrt(dx * dx + dy * dy + 1e-12)
            push = stiffness * max(0.0, ri + radius[j] - distance) / distance
            fx += push * dx
            fy += push * dy
        out[i, 0], out[i, 1] = fx, fy


@_fast
def drive_and_move(
    position: Floats,
    velocity: Floats,
    desired: Floats,
    force: Floats,
    mass: Floats,
    rate: Floats,
    dt: float,
    steps: int,
) -> None:
    """The step of a person without contacts: driving force, kick, drift."""
    for _ in range(steps):
        for i in range(len(mass)):
            for m in range(2):
                push = force[i, m] + mass[i] * rate[i] * (desired[i, m] - velocity[i, m])
                velocity[i, m] += dt * push / mass[i]
                position[i, m] += dt * velocity[i, m]


def seconds_each(call: Callable[[int], Any], blocks: int, block: float = 0.03) -> float:
    """Return the CPU time of one repeat of ``call(repeats)``, the best of so many blocks."""
    repeats = 1
    call(1)
    while True:
        begin = time.process_time()
        call(repeats)
        spent = time.process_time() - begin
        if spent > 0.3 * block:
            break
        repeats *= 4
    best = spent / repeats
    for _ in range(blocks):
        begin = time.process_time()
        call(repeats)
        best = min(best, (time.process_time() - begin) / repeats)
    return best


def cache_sizes() -> dict[str, float]:
    """Return bytes of data caches by level, as Linux tells; else those of a common processor."""
    sizes = {"L1": 32e3, "L2": 1e6, "L3": 16e6}
    for folder in Path("/sys/devices/system/cpu/cpu0/cache").glob("index*"):
        try:
            kind, level, size = ((folder / name).read_text().strip() for name in ("type", "level", "size"))
        except OSError:
            continue
        if kind != "Instruction" and size.endswith("K"):
            sizes[f"L{level}"] = 1024.0 * float(size[:-1])
    return sizes


def bandwidth(elements: int, blocks: int) -> float:
    """Return bytes per CPU second of a triad; two arrays are read and one is written, 24 bytes an element."""
    a, b, c = np.zeros(elements), np.ones(elements), np.ones(elements)
    return 24.0 * elements / seconds_each(lambda repeats: triad(a, b, c, 0.5, repeats), blocks)


def arithmetic(blocks: int) -> float:
    """Return floating-point operations per CPU second of the multiply-add loop."""
    x = np.linspace(0.0, 1.0, 1024)
    return 2.0 * DEGREE * len(x) / seconds_each(lambda repeats: multiply_add(x, 0.5, repeats), blocks)


def pair_time(blocks: int, people: int = 512) -> float:
    """Return CPU seconds of one pair of the all-pairs kernel."""
    rng = np.random.default_rng(0)
    side = np.sqrt(people / 6.0)
    x, y, radius = rng.uniform(0, side, people), rng.uniform(0, side, people), rng.uniform(0.19, 0.23, people)
    out = np.zeros((people, 2))

    def call(repeats: int) -> None:
        for _ in range(repeats):
            all_pairs(x, y, radius, 1.2e5, out)

    return seconds_each(call, blocks) / people**2


def person_time(people: int, blocks: int) -> float:
    """Return CPU seconds of the step of one person without contacts."""
    position, velocity, desired, force = (np.ones((people, 2)) for _ in range(4))
    mass, rate = np.full(people, 80.0), np.full(people, 2.0)

    def call(repeats: int) -> None:
        drive_and_move(position, velocity, desired, force, mass, rate, 1e-6, repeats)

    return seconds_each(call, blocks) / people
