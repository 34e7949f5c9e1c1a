"""One moment of an evacuation as an image."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.balance import places_of_feet
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.pressure import INJURY, contact_pressure
from crowd_env.rendering.discs import Bodies, bodies_of, put_bodies
from crowd_env.rendering.libraries import Image
from crowd_env.rendering.palette import EXIT, INK, QUIET, RAMP, cohort_color, pressure_color
from crowd_env.rendering.plan import MAT, Layout, draw_plan, exit_places, fit, round_length
from crowd_env.rendering.text import put_text, shortened, text_width

_STANDING = 0.1  # m/s, slower than this a pedestrian has no heading


class Renderer:
    """Draws frames of one geometry, whose floor, walls and exits are drawn once and kept.

    Parameters
    ----------
    geometry : floor, walls, obstacles and exits.
    width : px of a frame; the height follows from the geometry.
    text : px, size of letters; default by the width.
    scale_bar : show how long a meter is.

    Raises
    ------
    ValueError
        If ``width`` is not positive.

    Examples
    --------
    >>> renderer = Renderer(geometry)
    >>> image = renderer.frame(state.position, bodies.radius, active=state.active, clock=3.0)
    """

    def __init__(
        self,
        geometry: Geometry,
        *,
        width: int = 640,
        text: float | None = None,
        scale_bar: bool = True,
    ) -> None:
        if not width > 0:
            raise ValueError(f"width is {width} px; it must be at least 1")
        self.geometry = geometry
        self.layout: Layout = fit(geometry, width, text=text)
        self._empty = draw_plan(geometry, self.layout)
        _put_exit_names(self._empty, geometry, self.layout)
        if scale_bar:
            _put_scale_bar(self._empty, self.layout)
        self._with_legend = self._empty.copy()
        _put_legend(self._with_legend, self.layout)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame [px], both even."""
        return self.layout.width, self.layout.height

    def frame(self, position: ArrayLike, radius: ArrayLike, **seen: Any) -> NDArray[np.uint8]:
        """Return `draw` as an array (H, W, 3)."""
        return np.asarray(self.draw(position, radius, **seen))

    def draw(
        self,
        position: ArrayLike,
        radius: ArrayLike,
        *,
        active: ArrayLike | None = None,
        color_value: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        bodies: Bodies | None = None,
        cohort: ArrayLike | None = None,
        title: str = "",
        clock: float | None = None,
        inside: int | None = None,
        status: str | None = None,
        legend: bool = True,
    ) -> Image:
        """Return an image of people.

        Parameters
        ----------
        position, radius : (N, 2), (N,) m.
        active : (N,), only these are drawn; default everyone.
        color_value : (N,), how hard everyone is pressed: 0 to 1 is up to `INJURY`.  Without it all are calm.
        velocity : (N, 2) m/s, gives each round body that moves a heading.
        bodies : what is seen of each body, of `crowd_env.rendering.discs.bodies_of`; default a disc.
        cohort : (N,), which cohort everyone belongs to; rims are in its color.
        title : what is seen.
        clock : s.
        inside : number of people inside; default the number of active ones.
        status : replaces "17 of 20 inside".
        legend : explain the colors, if there are any.
        """
        position = np.asarray(position, dtype=np.float64).reshape(-1, 2)
        count = len(position)
        shown = np.ones(count, dtype=bool) if active is None else np.asarray(active, dtype=bool)
        drawn = np.flatnonzero(shown & np.isfinite(position).all(axis=1))
        value = np.zeros(count) if color_value is None else np.asarray(color_value, dtype=np.float64)
        image = (self._empty if color_value is None or not legend else self._with_legend).copy()
        put_bodies(
            image,
            self.layout,
            (bodies or bodies_of(None, position, radius)).rows(drawn),
            pressure_color(value[drawn]),
            rim=None if cohort is None else cohort_color(np.asarray(cohort)[drawn]),
            heading=None if velocity is None else _headings(np.asarray(velocity, dtype=np.float64)[drawn]),
        )
        left = int(shown.sum()) if inside is None else inside
        self._put_header(image, title, clock, status or f"{left} of {count} inside", finished=left == 0)
        return image

    def _put_header(self, image: Image, title: str, clock: float | None, status: str, *, finished: bool) -> None:
        layout = self.layout
        x, end, y, size = float(layout.margin), float(layout.width - layout.margin), 0.5 * layout.header, layout.text
        if clock is not None:
            end -= put_text(image, f"{clock:.1f} s", (end, y), size, INK, side="right", bold=True) + size
        small = 0.86 * size
        if title:
            room = end - x - size - text_width(status, small)
            if text := shortened(title, room, size):
                x += put_text(image, text, (x, y), size, INK, bold=True) + 0.8 * size
        put_text(image, status, (x, y), small, EXIT if finished else QUIET)


def _headings(velocity: Floats) -> Floats:
    """Return headings (N,) [rad] on the image, whose y points down; nan for pedestrians that stand."""
    return np.where(np.hypot(*velocity.T) > _STANDING, np.arctan2(-velocity[:, 1], velocity[:, 0]), np.nan)


def _put_exit_names(image: Image, geometry: Geometry, layout: Layout) -> None:
    """Write the names of exits, if there are several, outside of them along the wall."""
    places = exit_places(geometry)
    if len(places) < 2:
        return
    size = 0.72 * layout.text
    for name, (middle, out) in places.items():
        outward = out * (1.0, -1.0)  # y of pixels points down
        at = layout.pixels(middle) + (layout.wall + MAT * layout.margin + 0.7 * size) * outward
        upward = abs(outward[0]) > abs(outward[1])
        half = 0.5 * np.array([size, text_width(name, size)] if upward else [text_width(name, size), size])
        x, y = np.clip(at, half + 1, (layout.width, layout.height) - half - 1).tolist()
        put_text(image, name, (x, y), size, EXIT, side="center", upward=bool(upward))


def _put_legend(image: Image, layout: Layout) -> None:
    import PIL.Image

    size, y = 0.78 * layout.text, layout.height - 0.5 * layout.footer
    x = float(layout.margin)
    for text in ("contact pressure", "0"):
        x += put_text(image, text, (x, y), size, QUIET) + 0.7 * size
    length, thick = round(0.15 * layout.width), max(round(0.5 * size), 4)
    left, top = round(x), round(y - 0.5 * thick)
    columns = np.rint(np.linspace(0.0, len(RAMP) - 1.0, length)).astype(int)
    image.paste(PIL.Image.fromarray(np.broadcast_to(RAMP[columns], (thick, length, 3)).copy()), (left, top))
    put_text(image, f"{INJURY:g} N/m", (left + length + 0.7 * size, y), size, QUIET)


def _put_scale_bar(image: Image, layout: Layout) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten meters, at most a fifth of the width."""
    meters = round_length(0.2 * layout.width / layout.scale)
    size, y = 0.78 * layout.text, layout.height - 0.5 * layout.footer
    right = layout.width - layout.margin
    right -= round(put_text(image, f"{meters:g} m", (right, y), size, QUIET, side="right") + 0.6 * size)
    left, thick, row = right - round(meters * layout.scale), max(round(0.09 * size), 1), round(y)
    tall = round(0.3 * size)
    image.paste(QUIET, (left, row, right, row + thick))
    for column in (left, right - thick):
        image.paste(QUIET, (column, row - tall, column + thick, row + thick + tall))


def draw_env(env: CrowdEnv, kept: list[Renderer], e: int = 0) -> np.ndarray:
    """Return a frame (H, W, 3) uint8 of environment ``e``.

    Parameters
    ----------
    kept : renderers of earlier frames; environments of one geometry share one.  The latest stay.
    """
    geometry = env.scenario_of_env[e].geometry
    renderer = next((one for one in kept if one.geometry is geometry), None)
    if renderer is None:
        renderer = Renderer(geometry)
        kept[:] = [*kept, renderer][-env.num_envs :]
    people, simulation = env.people(e), env.simulation
    radius, state = simulation.bodies.radius[people], simulation.state
    impulse = simulation.results.impulse_magnitude[people]
    position, angle = simulation.laid_out[people], state.angle[people]
    feet = places_of_feet(simulation)[people] if simulation.behaviors["balance"] else None
    return renderer.frame(
        position,
        radius,
        active=state.active[people],
        color_value=contact_pressure(impulse, env.decision_dt, radius) / INJURY,
        velocity=state.velocity[people],
        bodies=bodies_of(simulation, position, radius, angle=angle, feet=feet),
        clock=float(state.time[e]),
    )


def draw_envs(env: CrowdEnv, kept: list[Renderer]) -> list[np.ndarray]:
    """Return a frame of each environment as `draw_env` does, all of one size: smaller ones have an empty margin below."""
    frames = [draw_env(env, kept, e) for e in range(env.num_envs)]
    height, width, _ = np.max([frame.shape for frame in frames], axis=0)
    return [
        np.pad(frame, ((0, height - len(frame)), (0, width - frame.shape[1]), (0, 0)), constant_values=255)
        for frame in frames
    ]
