"""One crowd on the swaying deck: time traces, and a film."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.footbridge.crossing import Footbridge
from crowd_env.envs.footbridge.walkers import DECK, WIDTH, crowd
from crowd_env.rendering.canvas import draw_bodies, hex_of, new_figure, quiet_axes, series
from crowd_env.rendering.encoding import write_gif
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import INK, QUIET
from crowd_env.reproduce.footbridge.onset import THRESHOLD
from crowd_env.reproduce.footbridge.runs import Trace, walk
from crowd_env.reproduce.footbridge.settings import FootbridgeSettings
from crowd_env.reproduce.result import RawTable, Result, Row

_FILMED, _FPS = 12.0, 10  # s at the end of the run, frames a second
_TIMES = 20.0  # the film shows the motion to the side so many times as large


class Frame(NamedTuple):
    """The deck at a moment."""

    position: Floats  # (P, 2) m
    phase: Floats  # (P,) rad
    sway: float  # m, at mid-span


def reproduce(settings: FootbridgeSettings) -> Result:
    """Return the figure."""
    simulation = crowd(settings.people, settings.physics, settings.seed)
    frames: list[Frame] = []

    def look(bridge: Footbridge) -> None:
        state = bridge.simulation.state
        if state.time[0] >= settings.duration - _FILMED:
            frames.append(Frame(state.position.copy(), bridge.walkers_phase.copy(), bridge.displacement))

    trace = walk(simulation, "synchrony", settings.duration, settings.seed, look)
    amplitude, order = trace.late()
    weight = float(trace.weight.mean())
    rows = [
        Row("people on the deck", None, float(trace.people.mean()), "people", len(trace.time), "mean over time"),
        Row("sum of psi squared", None, weight, "1", len(trace.time), f"threshold {THRESHOLD:.1f}"),
        Row("amplitude in the end", None, 1000.0 * float(amplitude), "mm", 1, "last quarter"),
        Row("order of steps in the end", None, float(order), "1", 1, "last quarter"),
    ]
    remarks = [
        f"A crowd under {settings.scheme} that walks round and round; whose steps the deck hurries walks faster.",
        f"In the film the motion to the side is {_TIMES:g} times as large as it is; colors are phases of strides.",
    ]
    table = RawTable(
        ("time_s", "people", "amplitude_m", "order", "sum_psi_squared"),
        [
            (f"{t:g}", int(n), f"{a:.6f}", f"{r:.4f}", f"{w:.2f}")
            for t, n, a, r, w in zip(*trace[:4], trace.weight, strict=True)
        ],
    )
    radius = simulation.bodies.radius
    return Result(
        [rows],
        {"trace": table},
        lambda: draw(trace, frames[-1], radius),
        remarks,
        film=lambda path: film(path, frames, radius),
    )


def draw(trace: Trace, last: Frame, radius: Floats) -> Figure:
    """Return a drawing of the traces, above the deck at the last moment."""
    figure = new_figure((9.0, 5.0))
    above, middle, below = figure.subplots(3, 1, height_ratios=[1.6, 1.2, 1.0])
    quiet_axes(above, "", "amplitude [mm]", grid=True)
    above.plot(trace.time, 1000.0 * trace.amplitude, color=series(0), lw=1.4)
    quiet_axes(middle, "time [s]", "order R", grid=True)
    middle.plot(trace.time, trace.order, color=series(1), lw=1.4)
    middle.set(ylim=(0.0, 1.0))
    _draw_deck(below, last, radius, 1.0)
    return figure


def _draw_deck(axes: Axes, frame: Frame, radius: Floats, times: float) -> None:
    """Draw people on a deck that bends to the side, in the colors of their strides."""
    from matplotlib import colormaps

    x = np.linspace(0.0, DECK.length, 100)
    bend = times * frame.sway * DECK.shape(x)
    axes.fill_between(x, bend, WIDTH + bend, color="#f3f1ec", zorder=0)
    for side in (0.0, WIDTH):
        axes.plot(x, side + bend, color=hex_of(INK), lw=1.2)
    own = times * frame.sway * DECK.shape(frame.position[:, 0])
    colors = colormaps["twilight_shifted"](np.mod(frame.phase, 2.0 * np.pi) / (2.0 * np.pi))
    draw_bodies(axes, frame.position + np.column_stack([np.zeros(len(own)), own]), radius, facecolors=colors)
    axes.set(aspect="equal", xlim=(-2.0, DECK.length + 7.0), ylim=(-2.5, WIDTH + 2.5))
    axes.set_axis_off()


def film(path: Path, frames: list[Frame], radius: Floats) -> Path:
    """Write the film of the deck to ``path``, a GIF, and return it."""
    from PIL import Image

    pictures = []
    for frame in frames[:: max(10 // _FPS, 1)]:
        figure = new_figure((9.0, 1.2), dpi=100, constrained=False)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        _draw_deck(axes, frame, radius, _TIMES)
        axes.text(0.0, WIDTH + 1.4, f"X = {1000 * frame.sway:+.0f} mm", fontsize=8, color=hex_of(QUIET))
        figure.canvas.draw()
        pictures.append(Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()))  # type: ignore[attr-defined]
    return write_gif(path, pictures, 1.0 / _FPS, pictures[:1])
