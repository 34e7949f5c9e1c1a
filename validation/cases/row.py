"""A push through a row of five people who stand: how many does it move, and how fast does it travel?

Two of the recorded pushes of Feldmann, Adrian 2023 (Safety Science 164:106173, doi 10.1016/j.ssci.2023.106173): a punching bag
pushes the last of five people in a row.  Places and depths of the bodies, masses and the force over time are those that LEMONS
gives for its own tutorial on them (Dufour, Stapelle, Nicolas 2026; repository Crowd-Mechanics/LEMONS, folder
data/tutorial_mechanical_layer/push_Feldmann).  Of the push with nothing in front the heads of the five are known too, from the
same folder.  What is judged is what the abstract says of all pushes, and, of people who keep their balance
(`crowd_env.core.behaviors.balance`), how far and how fast these heads moved.

How much of the force reached the trunk is not known: 972 N s would give 395 kg 2.5 m/s, and no head was faster than 1.13 m/s.
It is fitted together with the balance and its arms, on this one push, under `nsm2`, `dem` and
`nsm1-inertial`.

Discs stand exactly one behind the other, as deep as the bodies: the sideways distances of the heads, up to 0.1 m, would let
discs slide past each other where shoulders do not.  People stand by wanting no velocity: their drive brakes them,
at the rate 1 / tau = 2 /s of the package's slowest; LEMONS takes 4.5 /s for the first of the pushes and 2 /s for the second.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from shapely.geometry import box

from crowd_env import Geometry, Physics, Simulation, make_bodies, make_scheme, make_state
from crowd_env.core.behaviors.balance import Balancing, places_of_heads
from crowd_env.rendering.canvas import new_figure, quiet_axes, save_figure
from validation.cases.case import RECORDED, Row, Setting, number, row
from validation.cases.crowds import Floats


class Push(NamedTuple):
    """A recorded push; five people from the pushed one on."""

    place: tuple[float, ...]  # m, along the row
    depth: tuple[float, ...]  # m, half the depth of the body
    mass: tuple[float, ...]  # kg
    time: tuple[float, ...]  # s
    force: tuple[float, ...]  # m/s2 at these times, per mass of the pushed person; linear in between
    wall: float | None = None  # m, where a wall is in front of the row

    def force_at(self, time: float) -> float:
        """Return the force [N] on the pushed person at a time [s]."""
        return float(np.interp(time, self.time, self.force) * self.mass[0])


PUSHES = {name: Push(**recorded) for name, recorded in RECORDED["row"].items()}
STRENGTHS = (0.25, 0.5, 1.0)  # times the recorded force
MOVED = 0.05  # m, forward: who moves further has been reached by the push

REACHES = 0.227  # of the recorded force, that reaches the trunk; fitted
# The recorded heads of the push with nothing in front, read off their curves: from person to person, m/s; person by person, m.
FRONT, FURTHEST, LAST = 2.43, (0.463, 0.502, 0.649, 0.701, 0.533), (0.245, 0.342, 0.439, 0.509, 0.488)
FASTEST = (0.72, 0.89, 0.91, 1.10, 1.13)  # m/s
NEAR_FRONT, NEAR_FURTHEST, NEAR_LAST, NEAR_FASTEST = 0.3, 0.1, 0.15, 0.4  # share; m; m; share

EVERY, _UNTIL = 0.01, 3.0  # s
_FRAME = 4  # of these to one of the camera, 25 a second
_VARIED = 8  # rows that hardly differ from the recorded one
_HALF = 2.0  # m, half the width of the floor: side walls are far away


def displacements(
    setting: Setting, push: Push, strengths: tuple[float, ...] = STRENGTHS, balance: Balancing | None = None
) -> Floats:
    """Return how far forward (S, K, 5) [m] a push of each strength has moved the five people after every 0.01 s.

    With a balance these are the heads, else the discs.  What people do without a push, such as stepping back from each other,
    does not count: it is taken off.
    """
    people, strong = len(push.place), np.array([0.0, *strengths])
    floor = (-_HALF, -_HALF, 10.0 if push.wall is None else push.wall, _HALF)
    start = np.column_stack([np.tile(push.place, len(strong)), np.zeros(people * len(strong))])
    how = Physics(setting.scheme, balance=balance)
    simulation = standing(floor, start, push.depth, push.mass, len(strong), how, walking=setting.manner)
    moved = np.array([
        heads.reshape(len(strong), people)
        for heads in shoved(simulation, people, lambda time: push.force_at(time) * strong, _UNTIL)
    ])  # fmt: skip
    return np.moveaxis(moved[:, 1:] - moved[:, :1], 0, 1)


def standing(
    floor: Sequence[float],
    start: Floats,
    radius: float | Sequence[float],
    mass: float | Sequence[float],
    rows: int,
    physics: Physics,
    **options: Any,
) -> Simulation:
    """Return people who stand at ``start`` (P, 2) [m] in a rectangle, in ``rows`` environments of as many and the same bodies.

    Radius [m] and mass [kg] are those of everyone, or of each pedestrian of a row.
    """
    each, people = len(start) // rows * np.arange(rows + 1), len(start)
    bodies = make_bodies(np.resize(radius, people), np.resize(mass, people), desired_speed=1.34, env_start=each)
    place, state = Geometry.from_polygon(box(*floor)), make_state(start, environments=rows)
    return Simulation(place, bodies, state, physics=physics, **options)


def shoved(
    simulation: Simulation, people: int, force_at: Callable[[float], Floats | float], until: float
) -> Iterator[Floats]:
    """Yield how far forward (P,) [m] the heads are after every 0.01 s of people who stand in rows of ``people``.

    ``force_at`` says with which force [N] the first of each row is pushed at a time [s].
    """
    start, steps = simulation.state.position.copy(), round(EVERY / simulation.dt)
    stand, force, world = np.zeros_like(start), np.zeros_like(start), np.zeros(len(start), dtype=bool)
    for k in range(round(until / EVERY)):
        force[::people, 0] = force_at((k + 0.5) * EVERY)
        simulation.advance(stand, relative=world, external_force=force, n_substeps=steps)
        yield (places_of_heads(simulation) - start)[:, 0]


def travel(moved: Floats, place: tuple[float, ...]) -> tuple[int, float]:
    """Return how many people a push reaches without a break, and its speed [m/s] from person to person.

    Parameters
    ----------
    moved : (K, 5) m, forward, after every 0.01 s.
    place : m, along the row.
    """
    beyond = moved > MOVED
    reached = int(np.cumprod(beyond.any(axis=0)).sum())
    if reached < 2:
        return reached, float("nan")
    when = EVERY * (1.0 + beyond[:, :reached].argmax(axis=0))
    apart = when - when.mean()
    # Least squares of times over places: steps of 0.01 s may give two people the same time.
    slowness = float(apart @ np.array(place[:reached])) / float(np.var(place[:reached]) * reached)
    return reached, 1.0 / slowness if slowness > 0.0 else float("inf")


def met(reached: list[int], speed: list[float]) -> bool:
    """Whether pushes of growing strength move no fewer people and travel faster, and the last one moves more than one."""
    fast = [one for one in speed if not np.isnan(one)]
    return bool(all(np.diff(reached) >= 0) and reached[-1] > 1 and all(np.diff(fast) > 0.0))


def fastest(heads: Floats) -> Floats:
    """Return the greatest speed (5,) [m/s] of heads (K, 5) [m] as the camera sees it: over two of its frames."""
    seen = heads[_FRAME - 1 :: _FRAME]
    return (seen[2:] - seen[:-2]).max(axis=0) / (2.0 * _FRAME * EVERY)


def as_recorded(heads: Floats, place: tuple[float, ...]) -> bool:
    """Whether heads (K, 5) [m] move as recorded: front, furthest and last places, and greatest speeds."""
    reached, speed = travel(heads, place)
    return bool(
        reached == len(place)
        and abs(speed / FRONT - 1.0) <= NEAR_FRONT
        and np.abs(fastest(heads) / FASTEST - 1.0).max() <= NEAR_FASTEST
        and np.abs(heads.max(axis=0) - FURTHEST).max() <= NEAR_FURTHEST
        and np.abs(heads[-1] - LAST).max() <= NEAR_LAST
    )


def varied(push: Push, generator: np.random.Generator) -> Push:
    """Return a push nearly the same: force and masses differ by 3 % (one standard deviation), places by 6 mm."""
    place, reach = np.array(push.place) + generator.normal(0.0, 0.006, len(push.place)), np.array(push.depth)
    for k in range(1, len(place)):
        place[k] = max(place[k], place[k - 1] + reach[k - 1] + reach[k] + 0.004)
    mass = np.array(push.mass) * generator.normal(1.0, 0.03, len(push.mass))
    force = np.array(push.force) * generator.normal(1.0, 0.03)
    return push._replace(place=tuple(place), mass=tuple(mass), force=tuple(force))


def _of_heads(setting: Setting, push: Push) -> tuple[bool, str, dict[str, Any]]:
    """Return whether the heads of people who keep their balance move as recorded, the figures, and the numbers behind them."""
    heads = displacements(setting, push, (REACHES,), "stepping")[0]
    _, speed = travel(heads, push.place)
    found = (fastest(heads), FASTEST, heads.max(axis=0), heads[-1])
    quick, recorded, furthest, last = (", ".join(number(one) for one in each) for each in found)
    others = [varied(push, np.random.default_rng([setting.seed, k])) for k in range(_VARIED)]
    near = sum(as_recorded(displacements(setting, one, (REACHES,), "stepping")[0], one.place) for one in others)
    figure = (
        f"heads of people who keep their balance: front {number(speed, 1)} m/s (recorded {FRONT}), fastest {quick} m/s "
        f"(recorded {recorded}), furthest {furthest} m, after 3 s {last} m; "
        f"as recorded in {near} of {_VARIED} rows that hardly differ"
    )
    return as_recorded(heads, push.place), figure, {"speed": speed, "heads": heads[::4], "near": near}


def run(setting: Setting) -> list[Row]:
    """Return the row.  People stand: how they would walk has no part in it."""
    grows, figure, more = pushes(setting)
    if make_scheme(setting.scheme).drives:
        good, heads, more["balance"] = _of_heads(setting, PUSHES["open"])
    else:
        good, heads = False, "nobody can keep a balance: no force of the ground acts on these people"
    return [row("row", setting, good and grows, f"{figure}; {heads}", **more)]


def pushes(setting: Setting) -> tuple[bool, str, dict[str, Any]]:
    """Return whether stronger pushes go further and faster through discs, the figures, and the numbers behind them."""
    told, verdicts = [], []
    more: dict[str, Any] = {"strength": STRENGTHS}
    for name, push in PUSHES.items():
        setting.notify(f"{setting.scheme}: {name}")
        moved = displacements(setting, push)
        reached, speed = zip(*(travel(one, push.place) for one in moved), strict=True)
        verdicts.append(met(list(reached), list(speed)))
        most = moved[-1].max(axis=0)
        by_strength = ", ".join(
            f"{strength:g}: {count} at {number(pace, 1)} m/s"
            for strength, count, pace in zip(STRENGTHS, reached, speed, strict=True)
        )
        where = "nothing in front" if push.wall is None else "wall in front"
        told.append(f"{where}, by strength: {by_strength}; furthest {', '.join(number(one) for one in most)} m")
        more[name] = {"reached": reached, "speed": speed, "furthest": moved.max(axis=1)}
    return all(verdicts), "; ".join(told), more


def draw(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``row.png``: the heads of people who keep their balance over time, beside how far recorded ones went."""
    shown = [one for one in rows if "balance" in one.more]
    if not shown:
        return
    figure = new_figure((0.6 + 3.6 * len(shown), 3.8), dpi=130)
    for axes, one in zip(figure.subplots(1, len(shown), squeeze=False, sharey=True)[0], shown, strict=True):
        quiet_axes(axes, "s since the push begins", "m, forward", title=one.scheme)
        heads = np.array(one.more["balance"]["heads"])
        for k, (head, most, last) in enumerate(zip(heads.T, FURTHEST, LAST, strict=True)):
            (line,) = axes.plot(EVERY * np.arange(1, 4 * len(head), 4), head, label=f"person {k + 1}")
            color: Any = line.get_color()
            axes.errorbar(_UNTIL + 0.3 + 0.06 * k, most, NEAR_FURTHEST, color=color, marker="_", capsize=2)
            axes.errorbar(_UNTIL + 0.8 + 0.06 * k, last, NEAR_LAST, color=color, marker="_", capsize=2)
        ticks = [0.0, 1.0, 2.0, 3.0, _UNTIL + 0.42, _UNTIL + 0.92]
        axes.set_xticks(ticks, ["0", "1", "2", "3", "furthest\nrecorded", "\n\nafter 3 s"], fontsize=8)
        axes.legend(frameon=False, fontsize=7, loc="upper left")
    save_figure(figure, folder / "row.png")
