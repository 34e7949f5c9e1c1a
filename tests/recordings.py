"""Small evacuations to be recorded, and how recordings are compared."""

from dataclasses import fields

import numpy as np
from shapely.geometry import box

from crowd_env import FULL_SPEED, Cohorts, Geometry, Population, Scenario
from crowd_env.recording import Recording


def two_doors(*, people=12, time_limit=30.0, outline=None, **others):
    """Return a hall of two cohorts and two exits, one of which has two lines, with a thin wall and a door inside."""
    place = Geometry.from_polygon(
        box(0, 0, 8, 5),
        exits={"left": [(0, 2.2), (0, 3.0)], "right": box(7.5, 0, 8, 1.2)},
        thin_walls=[[(4, 3), (4, 5)]],
        doors={"lock": [(4, 0), (4, 0.5)]},
        regions={"west": box(0.5, 0, 3.5, 5), "east": box(4.5, 0, 7, 5)},
    )
    half = people // 2
    parts = (
        Population(half, name="quick", start_region="west", desired_speed=1.8, radius=(0.18, 0.22)),
        Population(people - half, name="slow", start_region="east", desired_speed=(0.5, 0.8), radius=0.2),
    )
    return Scenario(
        "two-doors", place, Cohorts(parts), time_limit=time_limit, outline=outline, **{**FULL_SPEED, **others}
    )


# How evacuations differ in what a recording has to hold: name -> scenario, options of the run, options of the recorder.
CASES = {
    "cohorts": (two_doors(people=40), {"scheme": "nsm2", "strategy": "nearest"}, {"contacts": True}),
    "left inside": (two_doors(time_limit=2.5), {"scheme": "dem"}, {"every": 0.3}),
    "torso": (two_doors(time_limit=1.5, outline="torso"), {"scheme": "hertz"}, {"contacts": True}),
    "feet": (two_doors(time_limit=1.5, balance="stepping"), {"scheme": "nsm2"}, {}),
}


def arrays_of(recording):
    """Return name -> array of all that is one, of contacts too."""
    found = {one.name: getattr(recording, one.name) for one in fields(Recording)}
    found |= dict(recording.memory) | ({} if recording.contacts is None else recording.contacts._asdict())
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


def assert_equal(one, other):
    """Two recordings hold the same, to the last bit and in the same types."""
    arrays, others = arrays_of(one), arrays_of(other)
    assert list(arrays) == list(others)
    for name, array in arrays.items():
        assert array.dtype == others[name].dtype, name
        np.testing.assert_array_equal(array, others[name], err_msg=name)
    for name in ("facts", "walkable", "cohorts", "outline"):
        assert getattr(one, name) == getattr(other, name), name
    for name in ("exits", "doors"):
        (names, lines), (same, places) = (zip(*getattr(each, name), strict=True) for each in (one, other))
        assert names == same
        np.testing.assert_array_equal(lines, places)
