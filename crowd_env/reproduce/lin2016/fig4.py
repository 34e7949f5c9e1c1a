"""Figure 4 of Lin, Ma, Lo: how 100 people leave at 1 m/s, for several strengths A of the social force."""

from crowd_env.rendering.canvas import series
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.figures.clearance import Curve, leaving_curves
from crowd_env.reproduce.lin2016.sample import Samples, clearance_rows, result
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import Result

TITLE = "Lin, Ma, Lo, Figure 4: 100 people at 1 m/s, by the strength A of the social force"

PEOPLE, SPEED = 100, 1.0  # m/s
PRINTED = {200.0: "170", 300.0: "120"}  # A [N] -> s
STRENGTHS = (200.0, 300.0, 400.0, 500.0)  # N
_REMARK = "paper: barely differs from 300 N"


def cases(settings: LinSettings) -> dict[float, Case]:
    """Return the draws for each strength [N]."""
    return {strength: settings.case(PEOPLE, SPEED, strength) for strength in STRENGTHS}


def reproduce(settings: LinSettings, found: Samples) -> Result:
    """Return the figure, made of a sample for each strength [N]."""
    rows = []
    for strength, draws in found.items():
        paper = PRINTED.get(strength)
        rows += clearance_rows(f"A = {strength:g} N", draws, paper, "" if paper else _REMARK)
    curves = [Curve(f"A = {a:g} N", series(k), draws, PRINTED.get(a)) for k, (a, draws) in enumerate(found.items())]
    title = f"{PEOPLE} people who want {SPEED:g} m/s, by the strength A of the social force"
    return result("lin-fig4", TITLE, settings, found, rows, lambda: leaving_curves(PEOPLE, {title: curves}))
