"""Figure 3: fifty simulated evacuations of the room, and one regression line through all of them."""

from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.pecol2011.evacuations import PRINTED, evacuate, flow_rows, raw_times, room_remarks
from crowd_env.reproduce.pecol2011.figures.room import exits_against_time
from crowd_env.reproduce.pecol2011.flow import pooled_line
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Result

TITLE = "Figure 3: pedestrians out of the room against time; flows in persons/s"


def reproduce(settings: PecolSettings, work: Work) -> Result:
    """Return Figure 3 for the scheme of the settings; the paper draws NSM2."""
    done = evacuate(settings, settings.scheme, work.progress, work.executor)
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
    title = f"{done.scheme.upper()}, door {100 * settings.door_width:g} cm, {len(done.exit_times)} runs of {settings.n}"
    return Result(
        "fig3",
        f"{TITLE} ({done.scheme})",
        flow_rows(done),
        {"exit-times": raw_times(settings, [done])},
        lambda: exits_against_time(done.exit_times, slope, start, title, f"paper {PRINTED[done.scheme]}"),
        remarks,
        settings.changed(),
        "1/s",
    )
