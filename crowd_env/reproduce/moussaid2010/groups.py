"""Figures 2 and 4: how fast groups of one to five walk, how far apart, and in which shape.

A group walks 45 m through an open corridor of 8 m.  It is looked at after 15 m, when it has found its shape.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.pulls import GroupCohesion, Pulls
from crowd_env.core.checks import COUNT, NOT_NEGATIVE
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.rendering.canvas import new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.paper import Settings, option
from crowd_env.reproduce.result import RawTable, Result, Row, mean_row
from crowd_env.scenarios.distributions import Uniform
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import Scenario

SIZES = (1, 2, 3, 4, 5)
# Speed [m/s] by size, as the caption of Figure 2 prints the two lines.
LINES = {"low density": (1.26, -0.04), "moderate density": (1.24, -0.08)}
_LENGTH, _WIDTH, _FROM, _TO = 45.0, 8.0, 15.0, 40.0  # m


@dataclass(frozen=True)
class MoussaidSettings(Settings):
    """Options of the paper's figures."""

    runs: int = option(40, "Groups of each size", COUNT)
    scheme: str = option("nsm2", "Contact scheme")
    manner: str = option("calm", "How people walk before they touch")
    gaze: float = option(GroupCohesion.gaze, "beta_1, 1/s; 0 = no slowing to see the others", NOT_NEGATIVE)


class Walk(NamedTuple):
    """Groups of N people between two lines, each looked at every 0.1 s."""

    speed: Floats  # (E,)  m/s   of the center of each
    spacing: Floats  # (E,)  m     mean distance of neighbors from left to right; nan for one
    shape: Floats  # (E, N, 2)  m  mean places from right to left, along and across the way, from the center


def corridor(size: int, settings: MoussaidSettings) -> Scenario:
    """Return the place: a group of this size at one end."""
    place = Geometry.from_polygon(
        box(0.0, 0.0, _LENGTH, _WIDTH),
        exits={"end": [(_LENGTH, 0.0), (_LENGTH, _WIDTH)]},
        regions={"start": box(0.5, 2.0, 3.5, 6.0)},
    )
    people = Population(size, start_region="start", group_size=Uniform(size, size))
    pulls = Pulls(GroupCohesion(gaze=settings.gaze))
    return Scenario("groups", place, people, 120.0, manner=settings.manner, strategy="shortest", pulls=pulls)


@cache
def walk(size: int, settings: MoussaidSettings) -> Walk:
    """Return how groups of this size walk."""
    env = CrowdEnv(corridor(size, settings), num_envs=settings.runs, physics=settings.scheme)
    env.reset(seed=list(settings.seeds))
    state, places = env.simulation.state, []
    while state.active.all() and state.time[0] < 100.0:
        env.step(None)
        places.append(state.position.reshape(settings.runs, size, 2).copy())
    position = np.array(places)  # (T, E, N, 2)
    center = position.mean(axis=2)
    between = (center[..., 0] > _FROM) & (center[..., 0] < _TO)
    speed, spacing, shape = np.zeros(settings.runs), np.full(settings.runs, np.nan), np.zeros((settings.runs, size, 2))
    for e in range(settings.runs):
        mine, at = position[between[:, e], e], center[between[:, e], e]
        speed[e] = (at[-1, 0] - at[0, 0]) / (env.decision_dt * (len(at) - 1))
        order = np.argsort(mine[..., 1], axis=1)
        sorted_ = np.take_along_axis(mine - at[:, None], order[..., None], axis=1)
        shape[e] = sorted_.mean(axis=0)
        if size > 1:
            spacing[e] = np.hypot(*np.diff(sorted_, axis=1).T).mean()
    return Walk(speed, spacing, shape)


def lag(shape: Floats) -> Floats:
    """Return how far (E,) [m] the middle of a group walks behind its two ends."""
    return shape[:, [0, -1], 0].mean(axis=1) - shape[:, 1:-1, 0].mean(axis=1)


def reproduce(settings: MoussaidSettings) -> Result:
    """Return speed, spacing and shape by size."""
    walks = {size: walk(size, settings) for size in SIZES}
    start, slope = LINES["low density"]
    reading = "line of Figure 2, low density"
    speeds = [
        mean_row(f"speed, {n} together", one.speed, "m/s", reading, f"{start + slope * n:.2f}", interval=False)
        for n, one in walks.items()
    ]
    fitted = float(np.polyfit(SIZES, [one.speed.mean() for one in walks.values()], 1)[0])
    reading = "least squares over the sizes; moderate density: -0.08"
    speeds.append(Row("speed by size", f"{slope:.2f}", fitted, "m/s", len(SIZES), reading))
    shapes = [
        mean_row(f"spacing, {n} together", one.spacing, "m", "of neighbors from left to right", interval=False)
        for n, one in walks.items()
        if n > 1
    ]
    shapes += [
        mean_row(f"lag of the middle, {n} together", lag(one.shape), "m", "> 0: a V, or a U", interval=False)
        for n, one in walks.items()
        if n > 2
    ]
    remarks = [
        f"{settings.draws_are} of people of the package, 1.34 ± 0.26 m/s; under {settings.scheme}, {settings.manner}.",
        "The lines of Figure 2 are as its caption prints them; the distances of Table 1 are unchecked, and left out.",
        "Nothing is fitted: the forces have the numbers of the paper.",
    ]
    raw = [
        (n, e, one.speed[e], one.spacing[e], k, *place)
        for n, one in walks.items()
        for e in range(settings.runs)
        for k, place in enumerate(one.shape[e].tolist())
    ]
    table = RawTable(("size", "draw", "speed_m_s", "spacing_m", "from_right", "ahead_m", "left_m"), raw)
    return Result([speeds, shapes], {"places": table}, lambda: _draw(walks), remarks)


def _draw(walks: Mapping[int, Walk]) -> Figure:
    """Draw two to five people from above, walking upwards, and speed and spacing by size."""
    figure = new_figure((9.6, 5.6))
    for column, n in enumerate(SIZES[1:]):
        axes = quiet_axes(figure.add_subplot(2, 4, column + 1), "to the right [m]", "ahead [m]" if n == 2 else "")
        shape = walks[n].shape
        axes.plot(-shape[..., 1].ravel(), shape[..., 0].ravel(), ".", color="#bcbab5", markersize=3)
        mean = shape.mean(axis=0)
        axes.plot(-mean[:, 1], mean[:, 0], "o-", color=series(0), markersize=9)
        axes.set(xlim=(-2.5, 2.5), ylim=(-2.0, 1.6), aspect="equal", title=f"{n} together")
    sizes = np.array(SIZES)
    axes = quiet_axes(figure.add_subplot(2, 2, 3), "people who walk together", "speed [m/s]", grid=True)
    axes.errorbar(sizes, *_mean_and_error([walks[n].speed for n in SIZES]), fmt="o", color=series(0), label="here")
    for k, (name, (start, slope)) in enumerate(LINES.items()):
        axes.plot(sizes, start + slope * sizes, "-" if k == 0 else "--", color="black", label=f"paper, {name}")
    axes.legend(frameon=False, fontsize=9.5)
    axes.set(xticks=SIZES, ylim=(0.7, 1.5))
    axes = quiet_axes(figure.add_subplot(2, 2, 4), "people who walk together", "spacing [m]", grid=True)
    axes.errorbar(sizes[1:], *_mean_and_error([walks[n].spacing for n in SIZES[1:]]), fmt="o", color=series(0))
    axes.set(xticks=SIZES[1:], ylim=(0.0, 1.6))
    return figure


def _mean_and_error(samples: list[Floats]) -> tuple[list[float], list[float]]:
    """Return means and standard errors."""
    return [float(one.mean()) for one in samples], [float(one.std() / np.sqrt(len(one))) for one in samples]
