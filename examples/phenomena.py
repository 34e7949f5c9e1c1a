"""Measure and film what crowds are known for (from the checkout).

`python -m examples.phenomena measure` writes docs/tables/phenomena.csv: what no table holds yet is measured, the rest is taken
from `measured.csv` and `faster.csv`.  `python -m examples.phenomena films [NAME ...]` draws docs/images/phenomena/.
"""

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import PIL.Image

from crowd_env import Cohorts, Geometry, Scenario, make_scenario
from crowd_env.core.arrays.state import unit_vectors
from crowd_env.envs.metrics import share_interval, summarise
from crowd_env.geometry.geometry import box
from crowd_env.physics.pressure import INJURY, contact_pressure
from crowd_env.rendering import Renderer
from crowd_env.rendering.palette import BACKGROUND, INK, QUIET
from crowd_env.rendering.plan import fit
from crowd_env.rendering.text import put_text
from crowd_env.reproduce.helbing2000 import faster
from examples.loops import beside, write_loop
from validation.cases.case import COMPARED, Setting, adults
from validation.cases.counterflow import corridor
from validation.cases.crowds import Bools, Command, Crowds, Floats, Moment, Passages, crowds_at, draw_crowds, generator
from validation.cases.ring import around, onward, ring
from validation.pages import read_table, write_table

DRAWS, PATIENCE = 10, 20.0  # s without a passage: stuck
MANNERS = ("competitive", "hurried", "calm")
IMAGES = Path("docs/images/phenomena")
TEXT, BAND = 11.0, 22  # px, of the films
BESIDE = 220  # px, of each of two panels that stand beside each other
RESTLESS = 2.0  # noise of "freezing by heating", in desired speeds
RING_DENSITY = 1.9  # people on a meter of the ring
_RING_RADIUS = 27.0 / (2.0 * np.pi)  # m, of validation/cases/ring.py


# -------------------------------------------------------------------------------------------------------- places, crowds


def two_rooms(width: float = 1.2, people: int = 20) -> Scenario:
    """Return two crowds that change rooms through one door of ``width`` [m]."""
    half = 0.5 * width
    place = Geometry.from_polygon(
        [box(-6.0, -3.0, -0.1, 3.0), box(-0.2, -half, 0.2, half), box(0.1, -3.0, 6.0, 3.0)],
        exits={"west": [(-6.0, -3.0), (-6.0, 3.0)], "east": [(6.0, -3.0), (6.0, 3.0)]},
        regions={"left": box(-4.5, -3.0, -0.5, 3.0), "right": box(0.5, -3.0, 4.5, 3.0)},
    )
    east = adults(people, start_region="left", route="east", name="eastward")
    west = adults(people, start_region="right", route="west", name="westward")
    return Scenario("two rooms", place, Cohorts((east, west)), 180.0)


def streams() -> Scenario:
    """Return two streams of 30 that meet in a corridor of 2 m."""
    return make_scenario("counter-flow-v0", width=2.0, people=60)


def eastward(crowds: Crowds) -> Bools:
    """Return who (P,) belongs to the first of the two streams of each crowd."""
    halves = [np.arange(n) < n // 2 for n in np.diff(crowds.simulation.bodies.env_start)]
    return np.concatenate(halves)


def restless(crowds: Crowds, noise: float) -> Command:
    """Return a command: along the corridor, plus normal noise in both axes, redrawn every 0.5 s."""
    rng, forward = np.random.default_rng(0), np.zeros((len(crowds.simulation.state.active), 2))
    forward[:, 0] = np.where(eastward(crowds), 1.0, -1.0)
    held = np.zeros_like(forward)

    def command(moment: Moment) -> Floats:
        if round(moment.time / 0.1) % 5 == 0:
            held[:] = noise * rng.standard_normal(held.shape)
        return forward + held

    return command


def file_of_people(setting: Setting) -> Crowds:
    """Return people at even distances around a ring."""
    count = round(RING_DENSITY * 27.0)
    position = _RING_RADIUS * unit_vectors(2.0 * np.pi / count * np.arange(count))
    drawn = [(adults(count).draw_bodies(generator(setting, d)), position) for d in range(setting.draws)]
    return crowds_at(ring(), drawn, setting, setting.draws)


def bare(place: Scenario) -> Scenario:
    """Return the room of `pillar-v0` without the pillar."""
    door, back = {"door": [(8.0, 3.5), (8.0, 4.5)]}, {"back": box(0.0, 0.0, 5.5, 8.0)}
    return replace(place, geometry=Geometry.from_polygon(box(0.0, 0.0, 8.0, 8.0), exits=door, regions=back))


def arch_room() -> Scenario:
    """Return the room of Lin, Ma, Lo, smaller: 70 people of 0.5 to 0.7 m who want 2.5 m/s, and a door of 1 m."""
    return make_scenario("lin-room-v0", side=8.0, people=70, desired_speed=2.5)


# --------------------------------------------------------------------------------------------------------------- measures


def verdict(shown: bool, figure: str) -> str:
    """Return the cell of a phenomenon."""
    return f"{'yes' if shown else '**no**'}: {figure}"


def interval(values: Sequence[float], digits: int, sign: str = "") -> tuple[float, float, str]:
    """Return the 95 % interval of the mean, and both as text."""
    mean, _, (low, high) = summarise(list(values))
    mean, low, high = (round(one, digits) + 0.0 for one in (mean, low, high))  # no -0
    return low, high, f"{mean:{sign}.{digits}f} ({low:{sign}.{digits}f} to {high:{sign}.{digits}f})"


def stuck_of(count: int, of: int) -> str:
    """Return how many draws got stuck, with Wilson's interval, if any."""
    low, high = share_interval(count, of)
    return f"; {count} of {of} stuck ({100 * low:.0f} to {100 * high:.0f} %)" if count else ""


def turns(setting: Setting) -> str:
    """People pass a door in groups of one direction that are longer than by chance (Wald, Wolfowitz)."""
    crowds = draw_crowds([two_rooms()], setting)
    east = eastward(crowds)
    line = Passages(crowds, 0, 0.0, np.where(east, 1, -1))
    stuck, ratios = line.watch(180.0, PATIENCE), []
    for e in range(crowds.count):
        times, ways = line.time[crowds.people(e)], east[crowds.people(e)]
        order = ways[np.argsort(times)][: np.isfinite(times).sum()]
        groups, there, back = 1 + (order[1:] != order[:-1]).sum(), order.sum(), (~order).sum()
        if there and back:
            ratios.append((1.0 + 2.0 * there * back / len(order)) / groups)
    low, _, figure = interval(ratios, 1)
    return verdict(low > 1.0, f"{figure} times chance{stuck_of(len(stuck), crowds.count)}")


def zipper(setting: Setting) -> str:
    """Who follows another in a neck of 1 m walks on the other side more often than not."""
    crowds = draw_crowds([make_scenario("bottleneck-v0")], setting)
    sides: list[list[float]] = [[] for _ in range(crowds.count)]
    line = Passages(crowds, 0, 1.4)
    for before, now in line.moments(180.0, PATIENCE):
        for e in range(crowds.count):
            people = crowds.people(e)
            new = np.flatnonzero(line.time[people] >= before.time)
            sides[e] += now.position[people][new[np.argsort(line.time[people][new])], 1].tolist()
    places = [np.array(each) for each in sides if len(each) > 10]
    low, _, figure = interval([100.0 * float((y[1:] * y[:-1] < 0.0).mean()) for y in places], 0)
    apart = np.mean([y[y > 0.0].mean() - y[y < 0.0].mean() for y in places])
    return verdict(low > 50.0, f"{figure} %, {apart:.2f} m apart{stuck_of(len(line.stuck), crowds.count)}")


def heating(setting: Setting) -> str:
    """Two streams that pass each other when calm block each other when all are restless."""
    times, stuck = [], []
    for noise in (0.0, RESTLESS):
        crowds = draw_crowds([streams()], setting)
        east = eastward(crowds)
        line = Passages(crowds, 0, np.where(east, 14.0, 6.0), np.where(east, 1, -1))
        for before, now in crowds.moments(150.0, restless(crowds, noise)):
            line.see(before, now)
            line.stop_the_stuck(now, PATIENCE)
        times.append(float(np.nanmean(line.time)))
        stuck.append(len(line.stuck))
    low, high = share_interval(stuck[1], setting.draws)
    frozen = f"{stuck[0]}, then {stuck[1]} of {setting.draws} frozen ({100 * low:.0f} to {100 * high:.0f} %)"
    return verdict(stuck[0] == 0 and 2 * stuck[1] > setting.draws, f"{frozen}; {times[0]:.0f} s, then {times[1]:.0f} s")


def waves(setting: Setting) -> str:
    """In a file that began evenly some people stand while others walk."""
    crowds = file_of_people(setting)
    seen = [around(before, now) / 0.1 for before, now in crowds.moments(60.0, onward) if before.time >= 40.0]
    speed = np.array(seen)
    standing = [100.0 * (speed[:, crowds.people(e)] < 0.05).mean() for e in range(crowds.count)]
    fast = float(np.quantile(speed, 0.9))
    low, high, figure = interval(standing, 0)
    return verdict(
        low > 10.0 and high < 90.0 and fast > 0.3, f"{figure} % stand, a tenth walks at {fast:.2f} m/s or more"
    )


def obstacle(setting: Setting) -> str:
    """A pillar before a door makes people leave sooner: paired differences of the last exit."""
    place = make_scenario("pillar-v0")
    crowds = draw_crowds([place, bare(place)], setting)
    line = Passages(crowds, 0, 7.95)
    stuck = line.watch(150.0, PATIENCE)
    last = np.array([np.nan if e in stuck else line.times(e)[-1] for e in range(crowds.count)])
    with_pillar, without = last[: setting.draws], last[setting.draws :]
    _, high, figure = interval((with_pillar - without).tolist(), 1, "+")
    left = f"; stuck {np.isnan(with_pillar).sum()} with, {np.isnan(without).sum()} without" if stuck else ""
    return verdict(high < 0.0, f"{figure} s{left}")


def known(case: str, manner: str) -> dict[str, str]:
    """Return scheme -> figures of a case in the table of all that is measured."""
    rows = read_table("measured")[1:]
    return {one[2].strip("`"): one[4] for one in rows if (one[0].strip("`"), one[1]) == (case, manner)}


def lanes(manner: str) -> dict[str, str]:
    """Return the cells of lanes: their order, and the speed both ways over that one way."""
    cells = {}
    for scheme, said in known("counterflow", manner).items():
        two, one, order, above = map(float, re.findall(r"\d+\.\d+|\d+(?= %)", said)[:4])
        cells[scheme] = verdict(above > 50.0, f"order {order:.2f}; {100 * (1 - two / one):.0f} % slower than one way")
    return cells


def arches(manner: str) -> dict[str, str]:
    """Return the cells of arches: how many draws block a door of 0.7 m, and the exponent; or get stuck at the gate."""
    cells = {}
    for scheme, said in known("clogging" if manner == "competitive" else "gate", manner).items():
        count, of, share = re.findall(r"(\d+) of (\d+) (\(.*?\))", said)[0]
        alpha = re.findall(r"exponent ([\d.]+ ± [\d.]+)", said)
        cells[scheme] = verdict(int(count) > 0, f"{count} of {of} {share}" + (f"; α = {alpha[0]}" if alpha else ""))
    return cells


def slower(manner: str) -> dict[str, str]:
    """Return the cells of faster-is-slower: the time to clear a door at 2 and at 4 m/s, and under helbing at 2 and 5 m/s."""
    if manner == "competitive":
        head, *rows = read_table("faster")
        soonest, late = (rows[0][head.index(f"{speed} m/s")] for speed in (2, 5))
        cells = {"helbing": f"yes: {soonest} s at 2 m/s, {late} s at 5 m/s"}
        push = "push 1"
    else:
        cells, push = {}, "push 0"
    for scheme, said in known("faster", "hurried" if manner == "competitive" else manner).items():
        last = [part.split(": ")[-1].split() for part in said.split(": ", 1)[1].split("; ") if part.startswith(push)][
            -1
        ]
        cells[scheme] = verdict(last[-1] == "stuck" or int(last[-1]) > int(last[2]), f"{last[2]} s, then {last[-1]} s")
    return cells


NEW: dict[str, Callable[[Setting], str]] = {
    "turns": turns,
    "heating": heating,
    "zipper": zipper,
    "waves": waves,
    "obstacle": obstacle,
}
KNOWN: dict[str, Callable[[str], dict[str, str]]] = {"arches": arches, "slower": slower, "lanes": lanes}


def measure() -> None:
    """Write the table, a row a phenomenon and manner."""
    schemes = (*COMPARED, "helbing")
    rows = []
    for name in (*KNOWN, *NEW):
        for manner in MANNERS:
            if name in KNOWN:
                cells = KNOWN[name](manner)
            else:
                cells = {scheme: NEW[name](Setting(scheme, manner, DRAWS)) for scheme in COMPARED}
            if cells:
                rows.append([name, manner, *(cells.get(scheme, "") for scheme in schemes)])
                print(*rows[-1], sep=" | ", flush=True)
    head = ["phenomenon", "manner", *(f"`{scheme}`" for scheme in schemes)]
    note = "arches, slower and lanes from the tables `measured` and `faster`"
    write_table("phenomena", [head, *rows], "python -m examples.phenomena measure", note)


# ------------------------------------------------------------------------------------------------------------------ films


class Panel(NamedTuple):
    """A crowd that is filmed: x from, y from, x to, y to [m] are seen."""

    title: str
    crowds: Crowds
    seen: tuple[float, float, float, float]
    width: int = BESIDE  # px
    command: Command | None = None
    by_stream: bool = False  # rims in the color of the stream


class Film(NamedTuple):
    """Panels beside or (``below``) under each other, from ``first`` to ``last`` [s], a frame every ``every`` [s].

    ``headings`` shows where people walk.
    """

    panels: Sequence[Panel]
    first: float
    last: float
    every: float = 0.4
    below: bool = False
    headings: bool = True


def one_of(place: Scenario, scheme: str, manner: str, seed: int = 0) -> Crowds:
    """Return one crowd of a place."""
    return draw_crowds([place], Setting(scheme, manner, 1, seed))


def pictures(panel: Panel, film: Film) -> Iterator[PIL.Image.Image]:
    """Yield the frames of one panel."""
    left, low, right, high = panel.seen
    simulation = panel.crowds.simulation
    geometry = simulation.geometries[0]
    wanted = panel.width / (right - left)
    width = round(1000 * wanted / fit(geometry, 1000, text=TEXT).scale)
    renderer = Renderer(geometry, width=width, text=TEXT, scale_bar=False)
    (x, bottom), (_, top) = renderer.layout.pixels([(left, low), (right, high)]).tolist()
    height = round(bottom - top) // 2 * 2
    radius, count = simulation.bodies.radius, len(simulation.bodies.radius)
    stream = np.where(eastward(panel.crowds), 0, 1) if panel.by_stream else None
    load, every = np.zeros(count), round(film.every / 0.1)
    moments = panel.crowds.moments(film.last, panel.command)
    for k in range(round(film.last / 0.1)):
        _, now = next(moments, (None, None))
        if now is not None:
            force = contact_pressure(simulation.results.impulse_magnitude, 0.1, radius)
            load += 0.4 * (force - load)
            active, position, velocity = now.active, now.position, simulation.state.velocity.copy()
        if k * 0.1 < film.first - 1e-9 or k % every:
            continue
        plan = renderer.draw(
            position,
            radius,
            active=active,
            color_value=load / INJURY,
            velocity=velocity if film.headings else 0.0 * velocity,
            cohort=stream,
            legend=False,
        )
        whole = PIL.Image.new("RGB", (panel.width, BAND + height), BACKGROUND)
        whole.paste(plan.crop((round(x), round(top), round(x) + panel.width, round(top) + height)), (0, BAND))
        put_text(whole, panel.title, (6.0, 0.5 * BAND), TEXT, INK, bold=True)
        inside = f"{int(active.sum())} inside, " if len(geometry.exits) else ""
        put_text(whole, f"{inside}{(k + 1) * 0.1:.0f} s", (panel.width - 6.0, 0.5 * BAND), TEXT, QUIET, side="right")
        yield whole


def frames(film: Film) -> Iterator[PIL.Image.Image]:
    """Yield the frames of all panels as one."""
    for parts in zip(*(pictures(panel, film) for panel in film.panels), strict=True):
        yield beside(parts, below=film.below, gap=8)


def hasty(speed: float) -> Scenario:
    """Return the room of Helbing, Farkas, Vicsek with people that want a speed [m/s]."""
    return faster.place(faster.HelbingSettings(), speed)


def _arches() -> Film:
    seen = (3.2, 1.6, 8.2, 6.4)
    return Film(
        [Panel(m, one_of(arch_room(), "hertz", m), seen) for m in ("competitive", "hurried")],
        0.0,
        24.0,
        0.6,
        headings=False,
    )


def _slower() -> Film:
    seen = (9.4, 4.6, 15.4, 10.4)
    panels = [Panel(f"want {v:g} m/s", one_of(hasty(v), "helbing", "competitive"), seen) for v in (2.0, 5.0)]
    return Film(panels, 0.0, 205.0, 5.0, headings=False)


def _lanes() -> Film:
    crowds = one_of(corridor(two_ways=True), "nsm2", "hurried")
    return Film([Panel("hurried", crowds, (4.0, -2.1, 16.0, 2.1), 480, by_stream=True)], 12.0, 34.0)


def _turns() -> Film:
    seen = (-2.9, -2.2, 2.9, 2.2)
    panels = [Panel(m, one_of(two_rooms(), "nsm2", m), seen, by_stream=True) for m in ("competitive", "hurried")]
    return Film(panels, 0.0, 20.0)


def _heating() -> Film:
    panels = []
    for title, noise in (("steady", 0.0), ("restless", RESTLESS)):
        crowds = one_of(streams(), "hertz", "hurried")
        panels.append(Panel(title, crowds, (3.0, -0.1, 17.0, 2.1), 480, restless(crowds, noise), by_stream=True))
    return Film(panels, 0.0, 48.0, 1.0, below=True)


def _zipper() -> Film:
    crowds = one_of(make_scenario("bottleneck-v0"), "nsm2", "hurried")
    return Film([Panel("hurried", crowds, (-3.4, -1.8, 3.0, 1.8), 420)], 6.0, 24.0)


def _waves() -> Film:
    side, panels = _RING_RADIUS + 0.5, []
    for manner in ("hurried", "calm"):
        crowds = file_of_people(Setting("nsm2", manner, 1))
        panels.append(Panel(manner, crowds, (-side, 1.6, side, side), 420, command=onward))
    return Film(panels, 30.0, 60.0, 0.6, below=True)


def _obstacle() -> Film:
    place, seen = make_scenario("pillar-v0"), (3.4, 1.7, 8.2, 6.3)
    rooms = {"with a pillar": place, "without": bare(place)}
    panels = [Panel(title, one_of(room, "hertz", "competitive"), seen) for title, room in rooms.items()]
    return Film(panels, 0.0, 24.0, 0.5, headings=False)


FILMS = {
    "arches": _arches,
    "slower": _slower,
    "lanes": _lanes,
    "turns": _turns,
    "heating": _heating,
    "zipper": _zipper,
    "waves": _waves,
    "obstacle": _obstacle,
}


def films(*names: str) -> None:
    """Write the films of phenomena, by default of all."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name in names or FILMS:
        drawn = list(frames(FILMS[name]()))
        write_loop(IMAGES / f"{name}.gif", drawn)


if __name__ == "__main__":
    {"measure": measure, "films": films}[sys.argv[1]](*sys.argv[2:])
