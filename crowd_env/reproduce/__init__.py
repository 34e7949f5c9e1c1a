"""Every table and figure of Pécol et al. 2011 that can be redone, the paper's number beside ours.

One file each; ``crowd-env reproduce NAME``.  Section 4.3 (the theatre: Table 7, Figures 4 to 6) cannot: its plan is not given.
"""

from collections.abc import Callable
from typing import NamedTuple

from crowd_env.reproduce import fig1, fig2, fig3, table3, table5
from crowd_env.reproduce.result import Progress, RawTable, Result, Row
from crowd_env.reproduce.settings import Settings

__all__ = ["REPRODUCTIONS", "Progress", "RawTable", "Reproduction", "Result", "Row", "Settings", "find"]


class Reproduction(NamedTuple):
    """How one table or figure is redone."""

    title: str
    run: Callable[[Settings, Progress], Result]
    steps: Callable[[Settings], int]  # length of the progress bar
    schemes: Callable[[Settings], tuple[str, ...]] | None = (
        None  # that run in the room; None: no room, none of its options
    )


REPRODUCTIONS: dict[str, Reproduction] = {
    "table3": Reproduction(table3.TITLE, table3.reproduce, table3.steps),
    "fig1": Reproduction(fig1.TITLE, fig1.reproduce, fig1.steps),
    "fig2": Reproduction(fig2.TITLE, fig2.reproduce, fig2.steps),
    "fig3": Reproduction(fig3.TITLE, fig3.reproduce, fig3.steps, fig3.schemes),
    "table5": Reproduction(table5.TITLE, table5.reproduce, table5.steps, table5.schemes),
}


def find(name: str) -> Reproduction:
    """Return a reproduction by name.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the known ones.
    """
    if name not in REPRODUCTIONS:
        raise ValueError(f"unknown name {name!r}; known: {', '.join(REPRODUCTIONS)}, or list, or all")
    return REPRODUCTIONS[name]
