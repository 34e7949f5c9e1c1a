"""Figure 5 of Lin, Ma, Lo: how 100 people leave at 1 and 2 m/s, with and without rotation."""

from crowd_env.rendering.canvas import series
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.figures.clearance import Curve, leaving_curves
from crowd_env.reproduce.lin2016.sample import Samples, clearance_rows, result
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import Result

TITLE = "Lin, Ma, Lo, Figure 5: 100 people with and without rotation"

PEOPLE = 100
_REMARKS = {
    (1.0, True): "",
    (1.0, False): "paper: basically the same as with rotation",
    (2.0, True): "",
    (2.0, False): "paper: clogs more, barely recovers",
}


def cases(settings: LinSettings) -> dict[tuple[float, bool], Case]:
    """Return the draws for each speed [m/s], with and without rotation."""
    return {(speed, turning): settings.case(PEOPLE, speed, rotation=turning) for speed, turning in _REMARKS}


def reproduce(settings: LinSettings, found: Samples) -> Result:
    """Return the figure, made of a sample for each speed [m/s], with and without rotation."""
    rows = []
    for (speed, turning), draws in found.items():
        of = f"{speed:g} m/s, {'rotation' if turning else 'no rotation'}"
        rows += clearance_rows(of, draws, None, _REMARKS[speed, turning])
    kinds = ((True, "with rotation"), (False, "without"))
    panels = {
        f"{letter}. {PEOPLE} people who want {speed:g} m/s": [
            Curve(name, series(k), found[speed, turning]) for k, (turning, name) in enumerate(kinds)
        ]
        for letter, speed in (("a", 1.0), ("b", 2.0))
    }
    return result("lin-fig5", TITLE, settings, found, rows, lambda: leaving_curves(PEOPLE, panels))
