"""People who stand close, with balance and without: how a push travels, how hard it presses at a wall, whether a crowd sways.

Nothing is judged: what comes out is reported.  The push is the recorded one of the case `row` with nothing in front, as much
of it as reaches the trunk there, or half of that.  A queue of density rho has people 1 / sqrt(rho) apart.  In the plaza
everyone is pushed by a random force, normal and new every half second, as if shifting weight; ankles can bear it.

Gu et al. 2025 (Nature 638:112; figures second-hand, unchecked) report that 5000 people in a plaza of 50 x 20 m sway together
above about 4 /m2, with a period of about 18 s.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env import Physics, make_scheme
from crowd_env.core.behaviors.balance import BALANCES
from crowd_env.rendering.canvas import new_figure, quiet_axes, save_figure
from validation.cases.case import Row, Setting, number, row
from validation.cases.crowds import Floats
from validation.cases.panels import COLORS
from validation.cases.row import EVERY, PUSHES, REACHES, shoved, standing, travel

STRENGTHS = (0.5, 1.0)  # of the push
DENSITIES = (2.0, 3.0, 4.0, 5.0, 6.0)  # 1/m2
_QUEUE, _RADIUS, _MASS = 30, 0.15, 80.0  # people, m, kg
_UNTIL, _MEAN = 10.0, 10  # s, and steps of 0.01 s over which a force at the wall is a mean
_PLAZA, _DENSE = (12.0, 8.0), 6.0  # m, 1/m2
_WATCHED, _LOOK, _SHIFT = 120.0, 0.1, 40.0  # s, s, and N a person and direction


class Queues(NamedTuple):
    """What a push does to queues of each of `DENSITIES`."""

    reached: list[int]  # people
    speed: list[float]  # m/s
    force: list[float]  # N   greatest at the wall, mean of 0.1 s


def queues(setting: Setting, balance: str, strength: float) -> Queues:
    """Return what the push of the case `row` does to 30 people one behind the other, the first as far from a wall."""
    push, many = PUSHES["open"], len(DENSITIES)
    apart = 1.0 / np.sqrt(DENSITIES)
    place = (np.arange(_QUEUE) - _QUEUE) * apart[:, None]
    # With everyone's way to the wall the same, queues of all densities share a place; each is as far from it as people are.
    place += 0.5 * apart[:, None]
    start = np.column_stack([place.ravel(), np.zeros(place.size)])
    simulation = standing(
        (-30.0, -2.0, 0.0, 2.0), start, _RADIUS, _MASS, many, Physics(setting.scheme, balance=balance)
    )
    moved, wall = [], []

    def force_at(time: float) -> Floats | float:
        return strength * REACHES * np.interp(time, push.time, push.force) * push.mass[0]

    for heads in shoved(simulation, _QUEUE, force_at, _UNTIL):
        moved.append(heads.reshape(many, _QUEUE))
        wall.append(-simulation.results.wall_impulse[:, 0].reshape(many, _QUEUE).sum(axis=1) / EVERY)
    means = np.stack([np.convolve(one, np.full(_MEAN, 1.0 / _MEAN), "same") for one in np.transpose(wall)])
    found = [travel(np.array(moved)[:, e], tuple(place[e])) for e in range(many)]
    return Queues([reached for reached, _ in found], [speed for _, speed in found], means.max(axis=1).tolist())


def sway(setting: Setting, balance: str) -> tuple[Floats, Floats, float, float]:
    """Return what the velocity of a dense crowd does over two minutes.

    That is: frequencies [Hz]; the power of the mean over all people at each [m2/s2/Hz]; the root mean square of one person
    [m/s]; and how far people move together, N |mean v|^2 / mean |v|^2, which is 1 if each moves for himself.
    """
    generator = np.random.default_rng(setting.seed)
    apart = 1.0 / np.sqrt(_DENSE)
    columns, rows = (int(side / apart) for side in _PLAZA)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    room = apart - 2.0 * _RADIUS
    start = (grid + 0.5) * apart + generator.uniform(-0.45 * room, 0.45 * room, grid.shape)
    floor, how = (0.0, 0.0, columns * apart, rows * apart), Physics(setting.scheme, balance=balance)
    simulation = standing(floor, start, _RADIUS, _MASS, 1, how)
    world, steps, count = np.zeros(len(start), dtype=bool), round(_LOOK / simulation.dt), round(_WATCHED / _LOOK)
    mean, square, force = np.empty((count, 2)), np.empty(count), np.zeros_like(start)
    for k in range(count):
        if k % 5 == 0:
            force = generator.normal(0.0, _SHIFT, start.shape)
        simulation.advance(np.zeros_like(start), relative=world, external_force=force, n_substeps=steps)
        velocity = simulation.state.velocity
        mean[k], square[k] = velocity.mean(axis=0), (velocity**2).sum(axis=1).mean()
    late = slice(count // 6, None)
    window = np.hanning(len(mean[late]))[:, None]
    power = (np.abs(np.fft.rfft(window * mean[late], axis=0)) ** 2).sum(axis=1) * 2.0 * _LOOK / (window**2).sum()
    together = len(start) * float((mean[late] ** 2).sum(axis=1).mean() / square[late].mean())
    frequency = np.asarray(np.fft.rfftfreq(len(window), _LOOK), dtype=np.float64)
    return frequency, np.asarray(power, dtype=np.float64), float(np.sqrt(square[late].mean())), together


def _peak(frequency: Floats, power: Floats) -> tuple[float, float]:
    """Return the period [s] at which a spectrum is largest, and how far it is above its median below 1 Hz there."""
    low = (frequency > 0.0) & (frequency < 1.0)
    top = int(np.argmax(np.where(low, power, 0.0)))
    return 1.0 / frequency[top], float(power[top] / np.median(power[low]))


def run(setting: Setting) -> Iterator[Row]:
    """Yield the row of a scheme, of those under which people can keep a balance."""
    if not make_scheme(setting.scheme).drives:
        return
    told: list[str] = []
    more: dict[str, Any] = {}
    for balance in BALANCES:
        setting.notify(f"{setting.scheme}, balance {balance}")
        frequency, power, speed, together = sway(setting, balance)
        period, above = _peak(frequency, power)
        found = {strength: queues(setting, balance, strength) for strength in STRENGTHS}
        waves = "; ".join(
            f"push {strength:g}: "
            + ", ".join(
                f"{density:g} /m2 {reached} of {_QUEUE} at {number(pace, 1)} m/s, {force:.0f} N"
                for density, reached, pace, force in zip(DENSITIES, *one, strict=True)
            )
            for strength, one in found.items()
        )
        told.append(
            f"balance {balance}: {waves} at the wall; plaza: {number(speed, 3)} m/s each, together {number(together, 1)}, "
            f"spectrum largest at {number(period, 1)} s, {number(above, 1)} times its median"
        )
        more[balance] = {"frequency": frequency, "power": power, "together": together}
        more[balance] |= {f"push {strength:g}": one._asdict() for strength, one in found.items()}
    yield row("standing", setting, None, "; ".join(told), **more)


def draw(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``standing.png``: speeds of pushes and forces at the wall over the spacing, and spectra of the plaza."""
    figure = new_figure((12.0, 3.8), dpi=130)
    labels = (
        ("m apart", "m/s, speed of a push"),
        ("m apart", "N, greatest at the wall"),
        ("Hz", "m2/s2/Hz, mean velocity"),
    )
    panels = figure.subplots(1, 3)
    for axes, names in zip(panels, labels, strict=True):
        quiet_axes(axes, *names)
    apart = 1.0 / np.sqrt(DENSITIES)
    for one in rows:
        for balance, found in one.more.items():
            line: Any = {"linestyle": "-" if BALANCES[balance] else ":", "color": COLORS[one.scheme]}
            line["label"] = f"{one.scheme}, balance {balance}"
            panels[2].loglog(found["frequency"][1:], found["power"][1:], **line)
            for strength in STRENGTHS:
                waves = found[f"push {strength:g}"]
                line["label"], line["linewidth"] = f"{one.scheme}, {balance}, push {strength:g}", 2.4 * strength
                panels[0].plot(apart, [np.nan if pace is None else pace for pace in waves["speed"]], **line)
                panels[1].plot(apart, waves["force"], **line)
    panels[0].set_ylim(top=9.0)
    for axes in panels[::2] if rows else ():
        axes.legend(frameon=False, fontsize=6)
    save_figure(figure, folder / "standing.png")
