"""Four streams: people of two corridors who cross, dense as at the end of an event; do they lock?"""

from crowd_env import Cohorts, Geometry, Scenario
from crowd_env.geometry.geometry import box
from validation.cases.case import Row, Setting, adults, number, row
from validation.cases.crowds import draw_crowds, mean_of

_PEOPLE, _DENSITY = 60, 5.0  # in each stream; 1/m2 at the start, up to the crossing
_HALF, _SPARE = 2.0, 5.0  # m, half width of the corridors; floor behind the last of a stream
_LIMIT = 240.0  # s
_TO = {"west": "east", "east": "west", "south": "north", "north": "south"}


def crossing() -> Scenario:
    """Return two corridors that cross, and a stream from each of the four ends to the other one."""
    far = _HALF + _PEOPLE / (_DENSITY * 2.0 * _HALF)
    end = far + _SPARE
    place = Geometry.from_polygon(
        [box(-end, -_HALF, end, _HALF), box(-_HALF, -end, _HALF, end)],
        exits={
            "east": [(end, -_HALF), (end, _HALF)],
            "west": [(-end, -_HALF), (-end, _HALF)],
            "north": [(-_HALF, end), (_HALF, end)],
            "south": [(-_HALF, -end), (_HALF, -end)],
        },
        regions={
            "in west": box(-far, -_HALF, -_HALF, _HALF),
            "in east": box(_HALF, -_HALF, far, _HALF),
            "in south": box(-_HALF, -far, _HALF, -_HALF),
            "in north": box(-_HALF, _HALF, _HALF, far),
        },
    )
    streams = (adults(_PEOPLE, start_region=f"in {side}", route=to, name=side) for side, to in _TO.items())
    return Scenario("four streams", place, Cohorts(tuple(streams)), _LIMIT)


def run(setting: Setting) -> list[Row]:
    """Return the row.  Everyone takes the shortest way: there is no other."""
    crowds = draw_crowds([crossing()], setting)
    out = crowds.walk(_LIMIT).exit_time.reshape(setting.draws, -1)
    left, last = int(crowds.simulation.state.active.sum()), [float(times.max()) for times in out]
    figure = f"the last is out after {number(mean_of(last), 0)} s" + (f"; {left} left inside" if left else "")
    return [row("streams", setting, not left, figure, last=last, left=left)]
