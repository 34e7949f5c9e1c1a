"""The command ``crowd-env forces``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.cli.console import check_picture
from crowd_env.cli.recorded import Source, place_of, read_recorded
from crowd_env.core.checks import POSITIVE, number
from crowd_env.core.console import friendly_errors, notes


def forces(
    source: Source,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Picture, .png; default forces.png there.")] = None,
    at: Annotated[
        float | None, typer.Option(help="Moment in s; default the end if the exits block, else the hardest push.")
    ] = None,
    around: Annotated[
        float | None, typer.Option(help="How far around the exit, in m; inf for all; default 3.5 in big places.")
    ] = None,
) -> None:
    """Draw who presses on whom in a recorded run, by lines as wide as the force.

    Examples: crowd-env run room-v0 --out room

    crowd-env forces room --at 3
    """
    with friendly_errors():
        if at is not None:
            number("--at", at, POSITIVE, "s")
        if around is not None and not around >= 0.5:
            raise ValueError(f"--around is {around:g}; it must be >= 0.5 m")
        recorded = read_recorded([source], 1, "the forces are those of one")
        path = place_of(out, recorded, "forces.png")
        check_picture("--out", path, (".png",))
        from crowd_env.rendering import forces_of, write_force_network

        (recording,) = recorded.recordings
        found = forces_of(recording, at)
        facts = recording.facts
        write_force_network(path, found, around=around, title=f"{facts.get('scenario', '')} {facts.get('scheme', '')}")
        mean = recording.frame_interval
        notes.print(f"forces: {path}, mean of {mean:g} s until {found.time:.1f} s", markup=False, soft_wrap=True)
