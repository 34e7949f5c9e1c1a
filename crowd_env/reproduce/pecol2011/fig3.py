"""Figure 3: fifty simulated evacuations of the room, and one regression line through all of them."""

from collections.abc import Mapping, Sequence

from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.pecol2011.evacuations import PRINTED, flow_rows, of_schemes, raw_times, room_remarks
from crowd_env.reproduce.pecol2011.figures.room import exits_against_time
from crowd_env.reproduce.pecol2011.flow import pooled_line
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Result

TITLE = "Figure 3: pedestrians out of the room against time; flows in persons/s"


def cases(settings: PecolSettings) -> dict[str, Case]:
    """Return the draws under the scheme of the settings; the paper draws NSM2."""
    return settings.cases([settings.scheme])


def reproduce(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Figure 3."""
    done = of_schemes(runs)
    ((scheme, one),) = done.items()
    slope, start, exits = pooled_line(one.exit_times)
    remarks = [
        f"The line drawn is {slope:.2f} /s · t {start:+.2f}, least squares through {exits} exits; the paper does not say which "
        "exits its regression uses, and draws this figure for NSM2 only.",
        *room_remarks(settings, done),
    ]
    title = f"{scheme.upper()}, door {100 * settings.door_width:g} cm, {len(one.exit_times)} runs of {settings.people}"
    return Result(
        "fig3",
        f"{TITLE} ({scheme})",
        flow_rows(one),
        {"exit-times": raw_times(done)},
        lambda: exits_against_time(one.exit_times, slope, start, title, f"paper {PRINTED[scheme]}"),
        remarks,
        settings.changed(),
        "1/s",
    )
