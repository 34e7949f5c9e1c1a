"""NIST 2.8: people of two rooms change places through a corridor; the more come against them, the longer it takes."""

import numpy as np

from crowd_env import Cohorts, Scenario
from validation.cases.case import Row, Setting, adults, number, row
from validation.cases.crowds import Passages, draw_crowds
from validation.cases.standards.places import place

AGAINST = (0, 10, 50, 100)

_PEOPLE = 100
_CORRIDOR = (10.0, 20.0)  # m, x of its ends
_PATIENCE = 20.0  # s in which nobody arrives: deadlock


def rooms(against: int) -> Scenario:
    """Return 100 people in the western room and ``against`` in the eastern one, who change places and leave at the far wall."""
    ground = place("crossing")
    people = adults(_PEOPLE, start_region="far west", route="east")
    if not against:
        return Scenario("crossing", ground, people, 240.0)
    return Scenario(
        "crossing", ground, Cohorts((people, adults(against, start_region="far east", route="west"))), 240.0
    )


def run(setting: Setting) -> list[Row]:
    """Return the row.  Everyone takes the shortest way: there is no other."""
    crowds = draw_crowds([rooms(against) for against in AGAINST], setting)
    slots = [crowds.people(e) for e in range(crowds.count)]
    eastward = np.concatenate([np.arange(people.stop - people.start) < _PEOPLE for people in slots])
    door = np.where(eastward, *_CORRIDOR[::-1])
    arrived = Passages(crowds, 0, door, np.where(eastward, 1, -1))
    arrived.watch(240.0, _PATIENCE)
    last = [float(np.max(arrived.time[people][:_PEOPLE])) for people in slots]  # nan if somebody did not arrive
    times = crowds.means(last)
    deadlocks = [arrived.count_stuck(k) for k in range(len(AGAINST))]
    rising = np.diff(np.nan_to_num(times, nan=np.inf)) > 0.0  # where all runs deadlock, it takes for ever
    passed = bool(rising.all()) and deadlocks[AGAINST.index(50)] <= setting.draws // 20
    figure = ", ".join(
        f"{n}: {number(time, 1)} s" + (f" ({jams} of {setting.draws} deadlocked)" if jams else "")
        for n, time, jams in zip(AGAINST, times, deadlocks, strict=True)
    )
    return [row("crossing", setting, passed, figure, against=AGAINST, last=times, deadlocks=deadlocks)]
