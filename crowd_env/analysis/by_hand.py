"""The hand calculation of fire engineers: pedestrians walk to the exits, and queue at the narrowest passages on the way.

The hydraulic model of first order (SFPE Handbook of Fire Protection Engineering, 5th edition 2016, chapter 59): a door passes
1.32 people a second and meter of effective width, which is 0.15 m less on each side than the clear width, and pedestrians
alone walk at 1.19 m/s.  The queue begins when half of the people have responded and the first have come; everybody uses the
exits in proportion to their widths.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from crowd_env.analysis.plan_check import PlanCheck, check_place, spot
from crowd_env.core.files.json_file import json_number
from crowd_env.geometry.parts import cut_off_by
from crowd_env.geometry.sheets import openings
from crowd_env.scenarios.distributions import Uniform
from crowd_env.scenarios.scenario import Scenario

FLOW = 1.32  # 1/(s m)  of effective width: k / (4 a) with k = 1.4 m/s and a = 0.266 m2
BOUNDARY = 0.15  # m  on each side of a door
SPEED = 1.19  # m/s  0.85 k


def by_hand(place: Scenario, check: PlanCheck | None = None) -> dict[str, Any]:
    """Return what an evacuation takes by hand, in ``words`` and ready for JSON: times in s, widths in m.

    ``check`` is that of the place, if it is known.

    ``response`` is the median and the latest, ``walk`` that of the first and of the last.  The queue is the longest of that at
    all exits together and of each at a passage that people have to pass, ``at`` which it is; it and ``time`` are None if that
    is no wider than its boundary layers.
    """
    people, check, field = place.population, check or check_place(place), place.field()
    steady = people.changed(desired_speed=Uniform(SPEED, SPEED), response_time=Uniform(0.0, 0.0))
    last, _ = replace(place, population=steady).longest_walk()
    ways = field.travel_time_for(check.position, 0.0) - field.behind
    first = float(ways.min(initial=SPEED * last)) / SPEED
    queues = [_queue(people.people, sum(map(_effective, place.geometry.exit_lengths.values())), "the exits")]
    for passage in check.passages.values():
        if passage is not None and not passage.is_exit:
            out = openings(check.geometry.exits, check.geometry.building)
            lost = cut_off_by(passage.gap.line, check.geometry.walkable, out, check.position)
            behind = lost.mean() if len(lost) else 0.0
            queues.append(_queue(round(behind * people.people), _effective(passage.gap.width), spot(passage.gap)))
    queue, effective, at = max(queues)
    rng = np.random.default_rng(0)
    responses = np.concatenate([part.draw_bodies(rng).response_time for part in people.parts])
    typical, latest = float(np.median(responses)), float(responses.max())
    time = max(latest + last, typical + first + queue)
    late = f"responses of {typical:.0f} to {latest:.0f} s, " if latest else ""
    line = f"{queue:.0f} s of queue at {at}, {effective:.2f} m of effective width"
    words = f"{time:.0f} s: {late}walks of {first:.0f} to {last:.0f} s, {line}"
    times = {
        "time": json_number(time),
        "response": [typical, latest],
        "walk": [first, last],
        "queue": json_number(queue),
    }
    return {"words": words, "people": people.people, **times, "effective_width": effective, "at": at}


def _effective(width: float) -> float:
    return max(width - 2.0 * BOUNDARY, 0.0)


def _queue(people: int, effective: float, at: str) -> tuple[float, float, str]:
    """Return for how long [s] people pass an effective width [m], and both."""
    return (people / (FLOW * effective) if effective > 0.0 else np.inf if people else 0.0), effective, at
