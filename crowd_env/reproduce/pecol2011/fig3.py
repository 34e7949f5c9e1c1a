"""Figure 3: fifty simulated evacuations of the room, and one regression line through all of them."""

from functools import partial
from pathlib import Path

from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.pecol2011.evacuations import PRINTED, Evacuations, evacuate, flow_rows, raw_times, room_remarks
from crowd_env.reproduce.pecol2011.flow import pooled_line
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Result

TITLE = "Figure 3: pedestrians out of the room against time; flows in persons/s"


def steps(settings: PecolSettings) -> int:
    """Return how much there is to do, in what ``work.progress`` counts."""
    return settings.runs


def schemes(settings: PecolSettings) -> tuple[str, ...]:
    """Return the schemes that are run in the room."""
    return (settings.scheme,)


def reproduce(settings: PecolSettings, work: Work) -> Result:
    """Return Figure 3 for the scheme of the settings; the paper draws NSM2."""
    done = evacuate(settings, settings.scheme, work.progress)
    slope, start, exits = pooled_line(done.exit_times)
    mean = done.estimates["per run"].value
    remarks = [
        f"The line drawn is {slope:.2f} /s · t {start:+.2f}, least squares through {exits} exits; the flow that Table 5 prints "
        f"for this scheme is {PRINTED[done.scheme]} /s, the mean slope of the single runs is "
        f"{'-' if mean is None else f'{mean:.2f}'} /s. The paper does not say which exits its regression uses.",
        *room_remarks(settings, [done]),
    ]
    if settings.scheme != "nsm2-printed":
        remarks.insert(0, f"The paper draws this figure for NSM2 only; here it is {settings.scheme}.")
    options = settings.changed()
    return Result(
        "fig3",
        f"{TITLE} ({done.scheme})",
        flow_rows(done),
        {"exit-times": raw_times(settings, [done])},
        partial(_draw, settings, done),
        remarks,
        options if settings.scheme == "nsm2-printed" else {"scheme": settings.scheme, **options},
        "1/s",
    )


def _draw(settings: PecolSettings, done: Evacuations, path: Path) -> Path:
    from crowd_env.reproduce.pecol2011.figures.room import exits_against_time

    slope, start, _ = pooled_line(done.exit_times)
    printed = f"paper {PRINTED[done.scheme]}"
    title = f"{done.scheme.upper()}, door {100 * settings.door_width:g} cm, {len(done.exit_times)} runs of {settings.n}"
    return exits_against_time(path, done.exit_times, slope, start, title, printed)
