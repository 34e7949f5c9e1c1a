"""Flow at named places inside: at doors, at the narrowest passages, and at the lines of a scenario.

People are counted by their centers: a straight way between two decisions crosses a line.  A direction is named by the axes
of the plan, such as "to +x" or "to -x+y", so that nobody has to know from which end a line was drawn.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.analysis.figures import busiest_first, passing
from crowd_env.analysis.passages import distances
from crowd_env.analysis.plan_check import PlanCheck, spot
from crowd_env.core.arrays.state import Bools, Floats, Ints, segment_lengths
from crowd_env.core.checks import Plain
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Episode
from crowd_env.geometry.sheets import Building

_TO_AND_FRO = 2.0  # s; a crossing that is taken back within this time is none
_SAME_PLACE = 0.3  # m; a passage whose middle is so near to a door is that door
_AT_ONCE = 64  # looks
_SIDEWAYS = 0.38  # sine of 22.5 degrees; less of an axis does not name a direction


class Place(NamedTuple):
    """Where people are counted."""

    name: str
    lines: Floats  # (K, 2, 2) m, from one end to the other
    length: float  # m of floor
    sheets: tuple[int, ...] = ()  # two of a building that meet here
    onto: tuple[str, ...] = ()  # their names

    @property
    def directions(self) -> tuple[str, str]:
        """Names of the directions to the left and to the right of the way along the lines; where sheets meet, to each."""
        if self.sheets:
            return f"to {self.onto[0]}", f"to {self.onto[1]}"
        x, y = self.lines[-1, 1] - self.lines[0, 0]
        left = np.array([-y, x]) / max(float(np.hypot(x, y)), 1e-9)
        return _words(left), _words(-left)


def _words(way: Floats) -> str:
    return "to " + "".join(
        f"{part:+.0f}"[0] + axis for part, axis in zip(way, "xy", strict=True) if abs(part) > _SIDEWAYS
    )


def places_of(check: PlanCheck) -> list[Place]:
    """Return where people are counted: doors inside, the narrowest passages on the way out, seams, and the scenario's sections.

    An exit counts its people itself.
    """
    geometry = check.geometry
    found: dict[str, Place] = {}
    for k, (name, closes) in enumerate(zip(geometry.doors, geometry.exits_of_door, strict=True)):
        if closes is None:
            leaves = geometry.walls[geometry.door_of_wall == k]
            found[name] = Place(name, leaves, float(segment_lengths(leaves).sum()))
    for passage in check.passages.values():
        if passage is None or passage.is_exit:
            continue
        lines = passage.gap.line[None]
        known = np.concatenate([np.empty((0, 2, 2)), *(one.lines for one in found.values())])
        if distances(lines.mean(axis=1), known)[0] > _SAME_PLACE:
            name = f"passage at {spot(geometry, lines)}"
            found[name] = Place(name, lines, passage.gap.width)
    own = {one.name: Place(one.name, np.array([one.line]), one.length_on(geometry)) for one in check.sections}
    return list((found | {one.name: one for one in _seams(geometry.building)} | own).values())


def _seams(building: Building | None) -> Iterator[Place]:
    """Yield where the sheets of a building meet; two that meet at several lines do so at one place."""
    if building is None:
        return
    ends = np.sort([(seam.left, seam.right) for seam in building.seams], axis=1).reshape(-1, 2)
    for pair in dict.fromkeys(map(tuple, ends.tolist())):
        lines = building.lines[(ends[building.seam] == pair).all(axis=1)]
        onto = building.sheets[pair[0]].name, building.sheets[pair[1]].name
        yield Place(" – ".join(onto), lines, 0.5 * float(segment_lengths(lines).sum()), pair, onto)


class CrossingRecorder:
    """Keeps the crossings of places by people: a `crowd_env.envs.rollout.Recorder`.

    Of each evacuation it keeps (C, 4): time [s], person, place, and 1 for a way to the left of the line or -1.  Where there are
    seams each person has a row more, of place -1 - s, for the sheet s on which it came; its way is 0.
    """

    def __init__(self, places: Sequence[Place]) -> None:
        lines = [one.lines[: 0 if one.sheets else None] for one in places]
        self._lines = np.concatenate([np.empty((0, 2, 2)), *lines])
        self._place = np.repeat(np.arange(len(places)), list(map(len, lines)))
        self._meeting: dict[tuple[int, ...], tuple[int, int]] = {}  # sheets from and to -> place and way
        for k, one in enumerate(places):
            if one.sheets:
                self._meeting |= {one.sheets[::-1]: (k, 1), one.sheets: (k, -1)}
                self._meeting |= {(-1, s): (-1 - s, 0) for s in one.sheets}

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Forget the batch before, and look at the first moment of this one."""
        self._crossed: list[Floats] = []
        nobody = np.zeros(env.num_people, dtype=bool)
        self._seen = [self._look(env, there) for there in (nobody, env.active)]

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Look where people are; many looks are gone through at once."""
        self._seen.append(self._look(env, env.active | step.terminated | step.truncated))
        if len(self._seen) > _AT_ONCE:
            self._count(env)

    def record(self, env: CrowdEnv, e: int) -> Floats:
        """Return the crossings of the evacuation in environment ``e``, which has just ended."""
        self._count(env)
        people = env.people(e)
        every = np.concatenate([np.empty((0, 4)), *self._crossed])
        own = every[(every[:, 1] >= people.start) & (every[:, 1] < people.stop)]
        return np.asarray(own - [0.0, people.start, 0.0, 0.0])

    @staticmethod
    def _look(env: CrowdEnv, there: Bools) -> tuple[Floats, Floats, Ints, Bools]:
        state = env.simulation.state
        return env.simulation.laid_out.copy(), state.time.copy(), state.sheet.copy(), there

    def _count(self, env: CrowdEnv) -> None:
        """Go through all looks but the last, which the next ones begin with."""
        position, time, sheet, there = (np.array(column) for column in zip(*self._seen, strict=True))
        if len(self._lines):
            low, high = np.minimum(position[:-1], position[1:]), np.maximum(position[:-1], position[1:])
            near = (low <= self._lines.max(axis=(0, 1))) & (high >= self._lines.min(axis=(0, 1)))
            moves = near.all(axis=2) & (low < high).any(axis=2) & there[1:] & (sheet[:-1] == sheet[1:])
            look, moved = np.nonzero(moves)
            person, line, part, sign = crossings(position[look, moved], position[look + 1, moved], self._lines)
            look, moved = look[person], moved[person]
            since, until = (time[k, env.env_of_person[moved]] for k in (look, look + 1))
            self._crossed.append(np.column_stack([since + part * (until - since), moved, self._place[line], sign]))
        if self._meeting:
            self._count_on_sheets(env, time, sheet, there)
        self._seen = self._seen[-1:]

    def _count_on_sheets(self, env: CrowdEnv, time: Floats, sheet: Ints, there: Bools) -> None:
        """Note where people come in, and where they come from sheet to sheet: half-way between two looks."""
        sheet, of_env = np.where(there, sheet, -1), env.env_of_person
        look, moved = np.nonzero((sheet[:-1] != sheet[1:]) & there[1:])
        at = 0.5 * (time[look, of_env[moved]] + time[look + 1, of_env[moved]])
        rows = zip(
            at.tolist(), moved.tolist(), sheet[look, moved].tolist(), sheet[look + 1, moved].tolist(), strict=True
        )
        found = [(when, n, *self._meeting[off, onto]) for when, n, off, onto in rows if (off, onto) in self._meeting]
        self._crossed.append(np.array(found).reshape(-1, 4))


def crossings(before: Floats, after: Floats, lines: Floats) -> tuple[Ints, Ints, Floats, Ints]:
    """Return the crossings of lines by people: rows of both (C,), after which part of the way, and 1 = to the left or -1.

    A point on a line lies to its right, and one end of a line belongs to it: lines in a row count everybody once.

    Parameters
    ----------
    before, after : (P, 2) m.
    lines : (K, 2, 2) m.
    """
    start, along = lines[:, 0], lines[:, 1] - lines[:, 0]

    def left_of(points: Floats) -> Floats:
        x, y = np.moveaxis(points[:, None] - start, -1, 0)
        return along[:, 0] * y - along[:, 1] * x

    first, last = left_of(before), left_of(after)
    person, line = np.nonzero((first > 0.0) != (last > 0.0))
    first, last = first[person, line], last[person, line]
    part = first / (first - last)
    meets = before[person] + part[:, None] * (after - before)[person] - start[line]
    share = (meets * along[line]).sum(axis=1) / (along[line] ** 2).sum(axis=1)
    hits = (share >= 0.0) & (share < 1.0)
    sign = np.where(last > 0.0, 1, -1)
    return person[hits], line[hits], part[hits], sign[hits]


def for_good(crossed: Floats) -> Floats:
    """Return the crossings (C, 4) that are not taken back within 2 s, in the order of time: people in a queue step to and fro.

    A pedestrian that crosses several times, less than that apart, counts once at the last, or not at all.
    """
    time, person, place, _ = crossed.T
    crossed = crossed[np.lexsort([time, person, place])]
    time, person, place, sign = crossed.T
    fresh = np.ones(len(crossed), dtype=bool)
    fresh[1:] = (np.diff(place) != 0.0) | (np.diff(person) != 0.0) | (np.diff(time) > _TO_AND_FRO)
    spell = np.cumsum(fresh) - 1
    net = np.bincount(spell, weights=sign)
    last = np.flatnonzero(np.append(fresh[1:], True))[: len(net)]
    kept = crossed[last][net != 0.0]
    kept[:, 3] = np.sign(net[net != 0.0])
    return kept[np.argsort(kept[:, 0], kind="stable")]


def flows_at(places: Sequence[Place], episodes: Sequence[Episode]) -> Plain:
    """Return figures of each place, ready for JSON; of the runs in which people were counted.

    Each direction has the figures of an exit, see `crowd_env.analysis.figures.passing`.
    """
    every = [for_good(one.crossings) for one in episodes if one.crossings is not None]
    return {one.name: _flow_at(one, k, every) for k, one in enumerate(places)}


def _flow_at(place: Place, k: int, every: Sequence[Floats]) -> Plain:
    ways = zip(place.directions, (1.0, -1.0), strict=True)
    towards = {
        name: passing([one[(one[:, 2] == k) & (one[:, 3] == sign), 0] for one in every], place.length)
        for name, sign in ways
    }
    return {"length": place.length, "line": place.lines.tolist(), "runs": len(every), "towards": busiest_first(towards)}


def rows_of(places: Sequence[Place], episode: Episode) -> list[tuple[object, ...]]:
    """Return a row for each crossing of a run: run, place, direction, time [s] and person."""
    crossed = np.empty((0, 4)) if episode.crossings is None else for_good(episode.crossings)
    directions = [one.directions for one in places]
    return [
        (episode.run, places[int(place)].name, directions[int(place)][sign < 0], f"{time:.3f}", int(person))
        for time, person, place, sign in crossed.tolist()
    ]
