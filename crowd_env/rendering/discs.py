"""Pedestrians put into a frame as discs, one or several each, from small pictures of discs that are kept."""

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd_env.core.arrays.state import Floats, Ints, unit_vectors
from crowd_env.core.behaviors.outline import Outline
from crowd_env.rendering.libraries import Image
from crowd_env.rendering.palette import INK, darker
from crowd_env.rendering.plan import Layout

Colors = NDArray[np.uint8]  # (K, 3)

_DOT = 3.0  # px, discs smaller than this are dots without rim and heading
_RIM, _RIM_WIDTH = 0.075, (0.8, 3.0)  # of the radius, and px
_WIDE = 2.0  # times as wide are rims that have a color of their own
_FOOT = 0.05  # m, radius of the dot of a foot
_SIZES, _PLACES, _TURNS = 8, 4, 48  # steps of a pixel, and of a full turn, in which pictures of discs are kept
_MOST = 2**26  # bytes of pictures that are kept
_ABOUT = 2**10  # bytes of a picture beside its pixels, about

_Picture: TypeAlias = tuple[int, Image, Image | None]


class Bodies(NamedTuple):
    """What is seen of N pedestrians from above."""

    position: Floats  # (N, 2)  m
    radius: Floats  # (N,)  m  of the disc of the same area
    center: Floats  # (N, K, 2)  m  the discs of each body
    size: Floats  # (N, K)  m  and their radii
    facing: Floats  # (N,)  rad  nan of a round body
    feet: Floats  # (N, F, 2)  m

    def rows(self, chosen: Ints) -> "Bodies":
        """Return some of the pedestrians."""
        return Bodies(*(column[chosen] for column in self))


def bodies_of(
    crowd: Any, position: ArrayLike, radius: ArrayLike, *, angle: ArrayLike | None = None, feet: ArrayLike | None = None
) -> Bodies:
    """Return the discs that are drawn of N pedestrians: all that painters have to know of the shape of a body.

    Parameters
    ----------
    crowd : what holds the shape of bodies: a simulation, a recording or contact forces; None = discs.
    position, radius, angle : (N, 2), (N,) or () m, (N,) rad.
    feet : (N, 2 F) m, drawn as dark dots on top of the body.
    """
    at = np.asarray(position, dtype=np.float64).reshape(-1, 2)
    size = np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(at),))
    dots = np.empty((len(at), 0, 2)) if feet is None else np.asarray(feet, dtype=np.float64).reshape(len(at), -1, 2)
    shape = Outline.of(getattr(crowd, "outline", None))
    if shape is None:
        return Bodies(at, size, at[:, None], size[:, None], np.full(len(at), np.nan), dots)
    facing = np.zeros(len(at)) if angle is None else np.asarray(angle, dtype=np.float64)
    return Bodies(at, size, *shape.place_discs(at, size, facing), facing, dots)


def unit_discs(crowd: Any) -> list[list[float]] | None:
    """Return the discs of a body as rows x, y, radius in units of its radius, forwards and to the left; None = round."""
    shape = Outline.of(crowd.outline)
    return None if shape is None else np.column_stack(shape.shape[:3]).tolist()


def put_bodies(
    image: Image,
    layout: Layout,
    bodies: Bodies,
    color: Colors,
    *,
    rim: Colors | None = None,
    edge: float | None = None,
    heading: Floats | None = None,
) -> None:
    """Draw pedestrians into ``image``; a body that is not round has a dot where it faces.

    Parameters
    ----------
    color, rim : (N, 3) of bodies and of rims, drawn wide; by default rims are a darker tone.
    edge : px, width of rims; by default it grows with the body.
    heading : (N,) rad, of ticks on round bodies; nan for none.
    """
    round_, scale = np.isnan(bodies.facing), layout.scale
    if edge is None and round_.all():
        put_discs(image, layout.pixels(bodies.position), scale * bodies.radius, color, heading, rim=rim)
    else:
        radius, count = scale * bodies.radius, bodies.size.shape[1]
        at, width = layout.pixels(bodies.center.reshape(-1, 2)), scale * bodies.size.ravel()
        wide = (_WIDE if rim is not None else 1.0) * np.clip(_RIM * radius, *_RIM_WIDTH)
        edges = np.repeat(wide if edge is None else np.full(len(radius), edge), count)
        around = np.repeat(darker(color) if rim is None else rim, count, axis=0)
        large = np.repeat(radius >= _DOT, count)
        put_discs(image, at[large], width[large], around[large], rim=False)  # all rims lie below all bodies
        put_discs(image, at, width - np.where(large, edges, 0.0), np.repeat(color, count, axis=0), rim=False)
        seen = (radius >= _DOT) & ~round_
        ahead = unit_vectors(bodies.facing)[seen]
        nose = layout.pixels(bodies.position[seen] + 0.35 * bodies.radius[seen, None] * ahead)
        put_discs(image, nose, 0.22 * radius[seen], darker(color[seen]), rim=False)
    feet = layout.pixels(bodies.feet.reshape(-1, 2))
    ink = np.tile(np.array(INK, dtype=np.uint8), (len(feet), 1))
    put_discs(image, feet, np.full(len(feet), _FOOT * scale), ink, rim=False)


def put_discs(
    image: Image,
    center: Floats,
    radius: Floats,
    color: Colors,
    heading: Floats | None = None,
    *,
    rim: Colors | bool | None = None,
) -> None:
    """Draw discs into ``image``.

    Parameters
    ----------
    center, radius : (K, 2), (K,) px; a pixel's middle lies at (column + 0.5, row + 0.5).
    color : (K, 3).
    heading : (K,) rad, of a tick on the image; nan for none.
    rim : (K, 3) colors of rims, drawn wide; None draws them in a darker tone, False draws none.  Small discs have none.
    """
    around = rim if isinstance(rim, np.ndarray) else darker(color)
    wide = 0.0 if rim is False else _WIDE if isinstance(rim, np.ndarray) else 1.0
    edge = wide * np.clip(_RIM * radius, *_RIM_WIDTH) * (radius >= _DOT)
    turn = np.full(len(radius), -1) if heading is None else np.nan_to_num(heading * _TURNS / (2.0 * np.pi), nan=-1e9)
    turn = np.where((edge > 0.0) & (turn > -1e8), np.rint(turn) % _TURNS, -1).astype(int)
    place = np.rint(_PLACES * center).astype(int)
    size = np.rint(_SIZES * np.maximum(radius, 1.0)).astype(int)
    sharp = np.rint(_SIZES * edge).astype(int)
    inner, outer = ([tuple(one) for one in paint.tolist()] for paint in (color, around))
    columns = (column.tolist() for column in (place // _PLACES, place % _PLACES, size, sharp, turn))
    for fill, ink, (x, y), part, width, line, way in zip(inner, outer, *columns, strict=True):
        half, cover, lines = _PICTURES[width, line, part[0], part[1], way]
        if -half <= x <= image.width + half and -half <= y <= image.height + half:
            image.paste(fill, (x - half, y - half), cover)
            if lines is not None:
                image.paste(ink, (x - half, y - half), lines)


def _disc(size: int, line: int, x: int, y: int, turn: int) -> _Picture:
    """Return half the width of the picture of a disc [px], what the disc covers, and what its rim and its tick do."""
    import PIL.Image
    import PIL.ImageDraw

    radius, edge = size / _SIZES, line / _SIZES
    half = int(radius) + 2
    fine = 8 if radius < 40.0 else 2
    center = fine * (half + np.array([x, y]) / _PLACES) - 0.5

    def covered(*rings: tuple[float, int]) -> PIL.Image.Image:
        mask = PIL.Image.new("L", (fine * 2 * half, fine * 2 * half))
        draw = PIL.ImageDraw.Draw(mask)
        for reach, value in rings:
            corners = (*(center - fine * reach), *(center + fine * reach))
            draw.ellipse(corners, fill=value)
        if turn >= 0 and len(rings) > 1:
            angle = 2.0 * np.pi * turn / _TURNS
            way = np.array([np.cos(angle), np.sin(angle)])
            ends = [tuple(center + fine * part * radius * way) for part in (0.38, 0.95)]
            draw.line(ends, fill=255, width=max(round(1.5 * fine * edge), 1))
        return mask.reduce(fine)

    return half, covered((radius, 255)), covered((radius, 255), (radius - edge, 0)) if edge else None


class _Pictures(dict[tuple[int, int, int, int, int], _Picture]):
    """Pictures of discs, each drawn when it is first asked for; all are dropped where they take more than `_MOST` bytes."""

    held = 0  # bytes

    def __missing__(self, key: tuple[int, int, int, int, int]) -> _Picture:
        half, _, lines = picture = _disc(*key)
        size = (1 if lines is None else 2) * ((2 * half) ** 2 + _ABOUT)
        if self.held + size > _MOST:
            self.clear()
            self.held = 0
        self.held += size
        self[key] = picture
        return picture


_PICTURES = _Pictures()
