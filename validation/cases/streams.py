"""Four streams: people of two corridors who cross, dense as at the end of an event; do they lock?"""

from crowd_env import Cohorts, Scenario
from validation.cases.case import Row, Setting, adults, number, row
from validation.cases.crowds import draw_crowds, mean_of
from validation.cases.standards.places import place

_PEOPLE = 60  # in each stream
_LIMIT = 240.0  # s
_TO = {"west": "east", "east": "west", "south": "north", "north": "south"}


def crossing() -> Scenario:
    """Return two corridors that cross, and a stream from each of the four ends to the other one."""
    streams = (adults(_PEOPLE, start_region=f"in {side}", route=to, name=side) for side, to in _TO.items())
    return Scenario("four streams", place("streams"), Cohorts(tuple(streams)), _LIMIT)


def run(setting: Setting) -> list[Row]:
    """Return the row.  Everyone takes the shortest way: there is no other."""
    crowds = draw_crowds([crossing()], setting)
    out = crowds.walk(_LIMIT).exit_time.reshape(setting.draws, -1)
    left, last = int(crowds.simulation.state.active.sum()), [float(times.max()) for times in out]
    figure = f"the last is out after {number(mean_of(last), 0)} s" + (f"; {left} left inside" if left else "")
    return [row("streams", setting, not left, figure, last=last, left=left)]
