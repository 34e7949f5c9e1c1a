"""Figure 4 of Lin, Ma, Lo: how 100 people leave at 1 m/s, for several strengths A of the social force."""

from collections.abc import Mapping

from crowd_env.rendering.canvas import series
from crowd_env.reproduce.lin2016.figures.clearance import Curve, Panel, leaving_curves
from crowd_env.reproduce.lin2016.sample import Sample, clearance_rows, result, verdict
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import Result

TITLE = "Lin, Ma, Lo, Figure 4: 100 people at 1 m/s, by the strength A of the social force"

PEOPLE, SPEED = 100, 1.0  # m/s
PRINTED = {200.0: "170", 300.0: "120"}  # A [N] -> s
CASES = {a: {"count": PEOPLE, "desired_speed": SPEED, "strength": a} for a in (200.0, 300.0, 400.0, 500.0)}
_REMARK = "paper: barely differs from 300 N"


def reproduce(settings: LinSettings, found: Mapping[float, Sample]) -> Result:
    """Return the figure, made of a sample for each strength [N]."""
    rows = []
    for strength, draws in found.items():
        paper = PRINTED.get(strength)
        rows += clearance_rows(f"A = {strength:g} N", draws, paper, "" if paper else _REMARK)
    curves = [Curve(f"A = {a:g} N", series(k), draws, PRINTED.get(a)) for k, (a, draws) in enumerate(found.items())]
    title = f"{PEOPLE} people who want {SPEED:g} m/s, by the strength A of the social force"
    return result(
        "lin-fig4",
        TITLE,
        settings,
        found.values(),
        rows,
        [*verdict(rows), *_plateau(found)],
        lambda: leaving_curves([Panel(title, PEOPLE, curves)]),
    )


def _plateau(found: Mapping[float, Sample]) -> list[str]:
    """Return whether more than 300 N changes anything, and whether less does."""
    base, strongest, weakest = (found[strength].median for strength in (300.0, 500.0, 200.0))
    remarks = []
    if base is not None and strongest is not None:
        change = 100 * (strongest / base - 1)
        agrees = "as the paper says: barely" if abs(change) <= 10 else "NOT barely, as the paper says"
        remarks.append(f"From 300 to 500 N the median changes by {change:+.1f} % ({agrees}).")
    if base is not None and weakest is not None:
        paper = 100 * (float(PRINTED[200.0]) / float(PRINTED[300.0]) - 1)
        change = 100 * (weakest / base - 1)
        remarks.append(
            f"With 200 N instead of 300 N the median is {change:+.1f} % here, {paper:+.0f} % in the paper; "
            f"{found[200.0].count_blocked()} with 200 N, {found[300.0].count_blocked()} with 300 N."
        )
    return remarks
