"""Figure 6 of Lin, Ma, Lo: the room at four moments of one evacuation."""

from typing import Any

from crowd_env.reproduce.lin2016.figures.room import draw_rooms
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.lin2016.sample import foot
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.result import RawTable, Result, Row

TITLE = "Lin, Ma, Lo, Figure 6: 200 people at 0, 30, 60 and 120 s"

PEOPLE, SPEED = 200, 1.0  # m/s, Table 1
MOMENTS = (0.0, 30.0, 60.0, 120.0)  # s


def runs(settings: LinSettings) -> list[Run]:
    """Return the run that the figure shows: the first draw."""
    return list(settings.draws(PEOPLE, SPEED, moments=MOMENTS)[:1])


def reproduce(settings: LinSettings, work: Work) -> Result:
    """Return the figure, made of the record of its run."""
    (run,) = runs(settings)
    record = work.records[run]
    shown = [s for s in record.snapshots if any(abs(s.time - moment) <= run.dt for moment in MOMENTS)]
    rows = [
        Row(f"inside, t = {s.time:g} s", None, len(s.x), "people", 1, "one draw; the paper shows it only")
        for s in shown
    ]
    raw = RawTable(
        ("time_s", "x_m", "y_m", "radius_m", "angle_rad"),
        [
            (f"{s.time:g}", *(f"{value:.6f}" for value in row))
            for s in shown
            for row in zip(s.x, s.y, s.radius, s.angle, strict=True)
        ],
    )
    remarks = [
        f"Draw {run.seed} at {SPEED:g} m/s, the speed of Table 1; the paper does not say which run it shows. The line in each "
        "body turns with it.",
        *settings.remarks()[:1],
    ]
    if record.blocked_since is not None:
        remarks.insert(0, f"The exit is blocked since {record.blocked_since:.0f} s.")

    def draw() -> Any:
        figure = draw_rooms(shown, run.scenario().geometry)
        foot(figure, f"{SPEED:g} m/s, draw {run.seed}; {settings.readings().partition('; ')[2]}")
        return figure

    return Result("lin-fig6", TITLE, rows, {"positions": raw}, draw, remarks, settings.changed(), "people")
