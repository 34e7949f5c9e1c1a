"""A movie theatre in the manner of Pécol et al. 2011, section 4.3: 174 seats, 101 people, routes A and B, control rules.

The plan is SYNTHETIC.  The paper draws its theatre in a figure that is in no printed text, and no other plan was found.
Known are the numbers of seats and people, two routes (A above, B below), three rectangles where people are counted, and
the parameters of Table 6.  All else is assumed here, from common cinemas; so results can be compared with the paper's in
their order of magnitude only.

Seen from above, the screen is at x = 0, on the left, and the floor rises to the right:

* Seats: 15 rows of 12, every 1.05 m, seats 0.55 m wide.  A row is an obstacle, 0.45 m deep (backs, seats tipped up);
  before it 0.60 m are free, where its people sit and walk.  In half of the last row two wheelchairs have their place, so
  that it has 6 seats: 174 in all.  4 m of level floor before the first row, 1.2 m behind the last: 9.0 by 20.95 m, 1.1 m2 a
  seat.
* Stairs: the floor rises between the seats, so that the aisles on both sides (1.2 m wide, the least that German rules allow)
  are stairs as far as there are rows; rows themselves are level.
* Route A: the usual way in, a door of 1.2 m in the middle of the back wall; behind it a level corridor 1.8 m wide that turns
  round the corner of the hall and along it to the foyer; A is where the foyer begins.
* Route B: the emergency exit, a door of 1.2 m beside the screen; behind it a landing and a straight flight of stairs 1.8 m
  wide, 12 m long seen from above, down to the open; B is its foot.  In the exercise the first person came out at B at about
  40 s (inferred from the mean and the last time): that needs a path of 10 to 15 m on stairs behind the front rows.
* People: the first four rows are empty, the rows behind are filled evenly: 101 of 126 seats, every fifth is free.
* The corridor of A ends, in whole meters, where the shortest paths divide the audience about as Table 7 implies (42 by A,
  59 by B; here 44 and 57): that split is put in, not found.
* Rectangles: 1 and 2 are the ends of both aisles towards A, two rows long; 3 is the floor before the door to B, 3.0 by 2.5 m.
  Their thresholds 5, 5 and 15 are about 2 people per square meter in each.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE, Plain, Range, flag, number, refuse, whole
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.routing.spec import ControlRule
from crowd_env.routing.speed_map import SpeedZone
from crowd_env.scenarios.cohorts import People, as_people
from crowd_env.scenarios.population import TABLE_4, Population, Uniform
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario

REFERENCE = "synthetic plan; people and rules of Pécol, Dal Pont, Erlicher, Argoul 2011, section 4.3 and Table 6"

ROWS, SEATS_A_ROW, SEATS_IN_LAST = 15, 12, 6
EMPTY_ROWS = 4  # at the front
_PITCH, _DEPTH, _SEAT = 1.05, 0.45, 0.55  # m    from row to row; backs and seats; width of a seat
_FRONT, _AISLE, _BACK = 4.0, 1.2, 1.2  # m    free before the first row, on both sides, behind the last row
_LENGTH = _FRONT + ROWS * _PITCH + _BACK  # m    of the hall, along x
_WIDTH = 2 * _AISLE + SEATS_A_ROW * _SEAT  # m
_DOOR, _PASSAGE, _WALL = 1.2, 1.8, 0.2  # m
_DOOR_B = 0.6  # m    where the door to B begins
_FLIGHT = 2.0, 14.0  # m    where the stairs behind it begin and end
_FOYER = 8.0  # m    where the corridor of A ends
_REAR = _FRONT + ROWS * _PITCH  # m    where the last row ends


def theatre(
    *,
    people: int = 101,
    crowded: tuple[int, int, int] = (5, 5, 15),
    hold: float = 0.0,
    commits: bool = False,
    stair_speed: float = 0.5,
    time_limit: float = 180.0,
    population: People | Plain | None = None,
) -> Scenario:
    """Return the theatre; people take the shortest route, unless a control rule sends them on the other.

    Parameters
    ----------
    people : number of people, on seats that are always the same; ignored if a ``population`` is given.
    crowded : this many people in rectangle 1, 2 or 3 turn the others away: from A to B (1 and 2), or from B to A (3).
    hold : s, a rule stays on at least for this time; 0 is the literal reading of the paper.
    commits : people that have been turned away do not come back when the rule is off.  In an aisle they meet the others
        head-on, and two may stop each other for good: people here do not step aside.
    stair_speed : m/s, of all people on stairs.
    time_limit : s.

    Raises
    ------
    ValueError
        If there are more people than seats, or a number is out of range.
    """
    if isinstance(crowded, str) or not isinstance(crowded, Sequence) or len(crowded) != 3:
        refuse("theatre: crowded", crowded, "three numbers of people, one for each rectangle")
    most = [whole(f"theatre: crowded[{k}]", many) for k, many in enumerate(crowded)]
    hold, commits = number("theatre: hold", hold, NOT_NEGATIVE, "s"), flag("theatre: commits", commits)
    stair_speed = number("theatre: stair_speed", stair_speed, POSITIVE, "m/s")
    late = Uniform(0.0, 4.0)
    bodies: dict[str, Any] = {**TABLE_4, "response_time": late}  # Table 6 has the bodies of Table 4
    crowd = as_people(population) or Population(people, **bodies, starts=seats()[taken_seats(people)])
    turned = zip(("1", "2", "3"), most, ("B", "B", "A"), strict=True)
    rules = tuple(ControlRule(where, many, way, hold=hold, commits=commits) for where, many, way in turned)
    zones = tuple(SpeedZone(stairs, stair_speed) for stairs in ("upper aisle", "lower aisle", "flight"))
    title = f"movie theatre (synthetic), {len(seats())} seats, {crowd.people} people, routes A and B"
    return Scenario("theatre-v0", plan(), crowd, time_limit, title, REFERENCE, zones=zones, rules=rules, **FULL_SPEED)


def seats() -> Floats:
    """Return the standing place before each seat (174, 2) [m], row by row from the screen."""
    row, number = np.divmod(np.arange((ROWS - 1) * SEATS_A_ROW + SEATS_IN_LAST), SEATS_A_ROW)
    return np.column_stack([_FRONT + row * _PITCH + 0.5 * (_PITCH - _DEPTH), _AISLE + (number + 0.5) * _SEAT])


def taken_seats(people: int) -> list[int]:
    """Return which seats are taken: evenly spread behind the empty rows or, if there are too few, over all rows.

    Raises
    ------
    ValueError
        If there are more people than seats.
    """
    everything = len(seats())
    people = whole("theatre: people", people, Range(1, everything).because("the number of seats"))
    first = EMPTY_ROWS * SEATS_A_ROW
    first = first if people <= everything - first else 0
    there = everything - first
    return [first + n for n in range(there) if (n + 1) * people // there > n * people // there]


def plan() -> Geometry:
    """Return walls, rows of seats, exits A and B, rectangles 1 to 3 and stairs."""
    middle, outer = 0.5 * _WIDTH, _WIDTH + _WALL
    corner, below = _LENGTH + _WALL + _PASSAGE, -_WALL - _PASSAGE
    widths = [SEATS_A_ROW * _SEAT] * (ROWS - 1) + [SEATS_IN_LAST * _SEAT]
    backs = [(_FRONT + (k + 1) * _PITCH, width) for k, width in enumerate(widths)]
    area = [
        box(0.0, 0.0, _LENGTH, _WIDTH),
        box(_LENGTH, middle - 0.5 * _DOOR, _LENGTH + _WALL, middle + 0.5 * _DOOR),
        box(_LENGTH + _WALL, middle - 0.5 * _PASSAGE, corner, outer + _PASSAGE),
        box(_FOYER, outer, corner, outer + _PASSAGE),
        box(_DOOR_B, -_WALL, _DOOR_B + _DOOR, 0.0),
        box(0.0, below, _FLIGHT[1], -_WALL),
    ]
    return Geometry.from_polygon(
        area,
        obstacles=[box(end - _DEPTH, _AISLE, end, _AISLE + width) for end, width in backs],
        exits={"A": [(_FOYER, outer), (_FOYER, outer + _PASSAGE)], "B": [(_FLIGHT[1], below), (_FLIGHT[1], -_WALL)]},
        regions={
            "1": box(_REAR - 2 * _PITCH, _WIDTH - _AISLE, _REAR, _WIDTH),
            "2": box(_REAR - 2 * _PITCH, 0.0, _REAR, _AISLE),
            "3": box(0.0, 0.0, 3.0, 2.5),
            "upper aisle": box(_FRONT, _WIDTH - _AISLE, _REAR, _WIDTH),
            "lower aisle": box(_FRONT, 0.0, _REAR, _AISLE),
            "flight": box(_FLIGHT[0], below, _FLIGHT[1], -_WALL),
        },
    )
