"""What tests of recordings, films and figures share."""

import numpy as np

from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.pressure import INJURY
from crowd_env.recording import Recording

ROOM = Geometry.from_polygon([(0, 0), (5, 0), (5, 5), (0, 5)], exits={"door": [(5, 2.09), (5, 2.91)]})


PILLAR = [(2, 2), (3, 2), (3, 3), (2, 3)]


PLANS = {
    "room": ROOM,
    "two exits and a pillar": Geometry.from_polygon(
        [(0, 0), (8, 0), (8, 5), (0, 5)], exits=[[(0, 1), (0, 2)], [(8, 3), (8, 4)]], obstacles=[PILLAR]
    ),
    "away from the origin": Geometry.from_polygon(
        [(-40, 100), (-36, 100), (-36, 104), (-40, 104)], exits={"north": [(-39, 104), (-38, 104)]}
    ),
    "corridor": Geometry.from_polygon([(0, 0), (40, 0), (40, 3), (0, 3)], exits={"end": [(40, 0), (40, 3)]}),
    "tall": Geometry.from_polygon([(0, 0), (3, 0), (3, 40), (0, 40)], exits={"end": [(0, 40), (3, 40)]}),
    "courtyard": Geometry.from_polygon(
        [[(0, 0), (9, 0), (9, 9), (0, 9)]],
        exits={"out": [(9, 4), (9, 5)]},
        obstacles=[[(3, 3), (6, 3), (6, 6), (3, 6)]],
    ),
}


def recording(end=4.0, people=20, *, finish=True, geometry=ROOM, pressure=None, cohorts=("",), times=None):
    """People who cross the room to the door one after the other; times as they are called, not as they walk."""
    time = np.arange(0.0, end + 1e-9, 0.1)
    rng = np.random.default_rng(3)
    start = rng.uniform(0.5, 4.0, (people, 2))
    leaves = np.linspace(0.3, 1.0, people) * end if finish else np.full(people, np.inf)
    frame, person = np.nonzero(time[:, None] < leaves)
    part = np.clip(time[frame] / np.minimum(leaves, end)[person], 0.0, 1.0)[:, None]
    drawn = rng.uniform(0.0, INJURY, (len(time), people)) * (time > 1.0)[:, None]
    return Recording(
        facts={"every": 0.1, "finished": True},
        walkable=geometry.walkable.wkt,
        thin_walls=np.zeros((0, 2, 2)),
        doors=(),
        exits=tuple(zip(geometry.exit_names, geometry.exits, strict=True)),
        cohorts=cohorts,
        times=time if times is None else times,
        frame_start=np.concatenate([[0], np.cumsum(np.bincount(frame, minlength=len(time)))]),
        radius=np.full(people, 0.22),
        desired_speed=np.full(people, 1.3),
        cohort=np.arange(people) % len(cohorts),
        exit_time=np.where(np.isfinite(leaves), leaves, np.nan),
        exit_index=np.where(np.isfinite(leaves), 0, -1),
        person=person,
        position=(1.0 - part) * start[person] + part * (5.0, 2.5),
        velocity=((5.0, 2.5) - start)[person] / end,
        pressure=(drawn if pressure is None else pressure)[frame, person],
    )
