"""Figure 5 of Lin, Ma, Lo: how 100 people leave at 1 and 2 m/s, with and without rotation."""

from collections.abc import Mapping

from crowd_env.rendering.canvas import series
from crowd_env.reproduce.lin2016.figures.clearance import Curve, Panel, leaving_curves
from crowd_env.reproduce.lin2016.sample import Sample, clearance_rows, result
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
CASES = {(v, turning): {"count": PEOPLE, "desired_speed": v, "rotation": turning} for v, turning in _REMARKS}

Found = Mapping[tuple[float, bool], Sample]


def reproduce(settings: LinSettings, found: Found) -> Result:
    """Return the figure, made of a sample for each speed [m/s], with and without rotation."""
    rows = []
    for (speed, turning), draws in found.items():
        of = f"{speed:g} m/s, {'rotation' if turning else 'no rotation'}"
        rows += clearance_rows(of, draws, None, _REMARKS[speed, turning])
    panels = []
    for letter, speed in (("a", 1.0), ("b", 2.0)):
        kinds = ((True, "with rotation"), (False, "without"))
        curves = [Curve(name, series(k), found[speed, turning]) for k, (turning, name) in enumerate(kinds)]
        panels.append(Panel(f"{letter}. {PEOPLE} people who want {speed:g} m/s", PEOPLE, curves))
    remarks = [_slow(found), _fast(found)]
    return result("lin-fig5", TITLE, settings, found.values(), rows, remarks, lambda: leaving_curves(panels))


def _slow(found: Found) -> str:
    turning, rigid = found[1.0, True], found[1.0, False]
    counts = f"{turning.count_blocked()} with rotation, {rigid.count_blocked()} without"
    if turning.median is None or rigid.median is None:
        return f"At 1 m/s there is no clearance time to compare; {counts}. The paper finds basically the same: NOT reproduced."
    change = rigid.median / turning.median - 1
    verdict = "reproduced" if abs(change) <= 0.1 else "NOT reproduced"
    if rigid.blocked > turning.blocked:
        verdict += " in the times; but more draws block"
    return (
        f"At 1 m/s the median without rotation is {100 * change:+.1f} % off that with it; {counts}. The paper finds basically "
        f"the same: {verdict}."
    )


def _fast(found: Found) -> str:
    turning, rigid = found[2.0, True], found[2.0, False]
    more = rigid.blocked > turning.blocked
    return (
        f"At 2 m/s, {rigid.count_blocked()} without rotation, {turning.count_blocked()} with it. The paper finds clogging more "
        f"likely without: {'reproduced' if more else 'NOT reproduced'}."
    )
