"""Laws of the pictures: things are where they are, whoever left is not seen, films last as long as the evacuation."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest
from cases import looped
from drawn_rooms import PLANS, ROOM, recording
from repository import ROOT as CHECKOUT
from shapely import box

from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.pressure import INJURY
from crowd_env.rendering import Renderer, Window, discs
from crowd_env.rendering.palette import (
    BACKGROUND,
    EXIT,
    EXIT_MAT,
    FLOOR,
    OBSTACLE,
    RAMP,
    WALL,
    pressure_color,
    to_oklab,
)

pytest.importorskip("PIL")


def color_at(renderer, image, point):
    x, y = renderer.layout.pixels(point)
    return tuple(int(channel) for channel in image[int(y), int(x)])


# ------------------------------------------------------------------------------------------------------------- frames


@looped("plan", PLANS)
def test_a_disc_is_drawn_where_the_person_is_and_nowhere_else(plan):
    geometry = PLANS[plan]
    renderer = Renderer(geometry, width=500)
    min_x, min_y, max_x, max_y = geometry.bounds
    person = np.array([0.3 * min_x + 0.7 * max_x, 0.4 * min_y + 0.6 * max_y])
    assert geometry.contains(person)
    image = renderer.frame([person], [0.25])
    assert color_at(renderer, image, person) == tuple(RAMP[0])
    changed = np.argwhere((image != renderer.frame([person], [0.25], active=[False], inside=1)).any(axis=-1))
    middle = changed[:, ::-1] + 0.5
    away = np.linalg.norm(middle - renderer.layout.pixels(person), axis=1)
    assert away.max() < 0.25 * renderer.layout.scale + 1.0
    np.testing.assert_allclose(
        middle.mean(axis=0), renderer.layout.pixels(person), atol=0.3
    )  # drawn to a quarter of a pixel
    area = np.pi * (0.25 * renderer.layout.scale) ** 2
    assert area < len(changed) < area + 4.0 * np.pi * 0.25 * renderer.layout.scale + 8.0


@looped("plan", PLANS)
def test_walls_lie_outside_of_the_walkable_area_and_exits_are_open(plan):
    geometry = PLANS[plan]
    renderer = Renderer(geometry, width=500)
    image = renderer.frame(np.empty((0, 2)), [])
    pixel = 1.0 / renderer.layout.scale
    for rows, color in ((geometry.walls, WALL), (geometry.exits, EXIT)):
        for a, b in rows:
            outward = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
            middle = 0.5 * (a + b)
            assert color_at(renderer, image, middle + 1.1 * pixel * outward) == color
            assert color_at(renderer, image, middle - 1.6 * pixel * outward) == FLOOR
    for a, b in geometry.exits:
        outward = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
        doorstep = 0.5 * (a + b) + (renderer.layout.wall + 1.5) * pixel * outward
        assert color_at(renderer, image, doorstep) == EXIT_MAT


def test_a_disc_that_touches_a_wall_is_seen_to_touch_it():
    renderer = Renderer(ROOM, width=600)
    image = renderer.frame([[0.3, 1.0]], [0.3])
    x, y = renderer.layout.pixels([0.0, 1.0])
    row = image[int(y)].astype(int)
    assert np.abs(row[int(x) - 3] - WALL).max() <= 1
    assert (row[int(x) : int(x) + 3] != FLOOR).any(axis=1).all()  # rim and wall, no light between them
    free = renderer.frame([[0.34, 1.0]], [0.3])
    assert (free[int(y), int(x) + 1 : int(x) + 3] == FLOOR).all()


@pytest.mark.more
def test_obstacles_are_shaded_and_courtyards_are_not_floor():
    renderer = Renderer(PLANS["courtyard"], width=500)
    image = renderer.frame(np.empty((0, 2)), [])
    assert color_at(renderer, image, (4.5, 4.5)) == OBSTACLE
    assert tuple(image[0, 0]) == BACKGROUND


@pytest.mark.more
def test_an_exit_that_people_walk_into_is_green_all_over():
    geometry = Geometry.from_polygon([(0, 0), (9, 0), (9, 9), (0, 9)], exits={"lift": box(4, 4, 6, 6)})
    renderer = Renderer(geometry, width=400)
    assert color_at(renderer, renderer.frame(np.empty((0, 2)), []), (5, 5)) == EXIT_MAT


@pytest.mark.more
def test_thin_walls_are_seen_from_both_sides():
    geometry = Geometry.from_polygon(
        [(0, 0), (5, 0), (5, 5), (0, 5)], exits={"door": [(5, 2), (5, 3)]}, thin_walls=[[(1, 2.5), (3, 2.5)]]
    )
    renderer = Renderer(geometry, width=500)
    image = renderer.frame(np.empty((0, 2)), [])
    assert color_at(renderer, image, (2, 2.5)) == WALL
    assert color_at(renderer, image, (2, 2.6)) == FLOOR
    assert color_at(renderer, image, (2, 2.4)) == FLOOR


def test_whoever_left_is_not_drawn():
    renderer = Renderer(ROOM, width=300)
    empty = renderer.frame([[1.0, 1.0]], [0.2], active=[False])
    assert color_at(renderer, empty, (1.0, 1.0)) == FLOOR
    elsewhere = renderer.frame([[4.0, 3.0]], [0.2], active=[False])
    np.testing.assert_array_equal(empty, elsewhere)


@pytest.mark.more
def test_nan_positions_and_people_beyond_the_image_do_no_harm():
    renderer = Renderer(ROOM, width=300)
    image = renderer.frame([[np.nan, 1.0], [90.0, 1.0], [5.3, 2.5], [-0.4, -0.4]], 0.3, color_value=[0, np.nan, 2, -1])
    assert image.dtype == np.uint8


@pytest.mark.more
def test_the_same_moment_gives_the_same_image_and_leaves_the_next_alone():
    seen = recording().at(2.0)
    kwargs = {"velocity": seen.velocity, "color_value": seen.pressure / INJURY}
    renderer = Renderer(ROOM, width=320)
    first = renderer.frame(seen.position, 0.22, title="room", clock=2.0, **kwargs)
    renderer.frame(seen.position + 0.3, 0.22, title="another", clock=3.0, **kwargs)
    np.testing.assert_array_equal(first, renderer.frame(seen.position, 0.22, title="room", clock=2.0, **kwargs))
    again = Renderer(ROOM, width=320)
    np.testing.assert_array_equal(first, again.frame(seen.position, 0.22, title="room", clock=2.0, **kwargs))


@pytest.mark.more
def test_text_tells_time_people_and_title():
    renderer = Renderer(ROOM, width=400)
    header = renderer.layout.header
    position = [[1.0, 1.0], [2.0, 2.0]]

    def top(**kwargs):
        return renderer.frame(position, 0.2, **kwargs)[:header]

    plain = top()
    assert (plain != BACKGROUND).any()
    for other in ({"clock": 1.0}, {"title": "room"}, {"inside": 1}, {"status": "all out"}, {"active": [True, False]}):
        assert (top(**other) != plain).any(), other
    long = top(title="a title that is far too long for a frame as small as this one is", clock=12.3)
    np.testing.assert_array_equal(long[:, -50:], top(clock=12.3)[:, -50:])


def test_heading_points_where_someone_walks():
    renderer = Renderer(ROOM, width=500)
    still = renderer.frame([[2.5, 2.5]], [0.3], velocity=[[0.0, 0.0]])
    for direction in np.array([[1, 0], [0, 1], [-0.6, 0.8]]):
        moving = renderer.frame([[2.5, 2.5]], [0.3], velocity=[1.3 * direction])
        at = np.argwhere((moving != still).any(axis=-1))[:, ::-1] + 0.5 - renderer.layout.pixels([2.5, 2.5])
        towards = at.mean(axis=0) * (1, -1)
        np.testing.assert_allclose(towards / np.linalg.norm(towards), direction, atol=0.1)


def test_harder_pressed_is_redder_in_even_steps():
    colors = pressure_color(np.linspace(0.0, 1.0, 12)).astype(float)
    redness = colors[:, 0] - 0.5 * (colors[:, 1] + colors[:, 2])
    assert (np.diff(redness[:8]) > 5.0).all()  # then darker rather than redder
    assert redness[-1] > redness[0] + 100.0
    steps = np.linalg.norm(np.diff(to_oklab(RAMP[::15]), axis=0), axis=1)
    assert steps.max() < 1.3 * steps.min()
    renderer = Renderer(ROOM, width=300)
    image = renderer.frame([[1.0, 1.0], [3.0, 3.0]], 0.3, color_value=[0.0, 1.0])
    assert color_at(renderer, image, (1.0, 1.0)) == tuple(RAMP[0])
    assert color_at(renderer, image, (3.0, 3.0)) == tuple(RAMP[-1])


@looped(("plan", "width"), [(plan, width) for plan in PLANS for width in (161, 640)])
def test_frames_have_even_sides_and_are_not_much_taller_than_wide(plan, width):
    renderer = Renderer(PLANS[plan], width=width)
    image = renderer.frame(np.empty((0, 2)), [])
    assert image.shape == (renderer.size[1], renderer.size[0], 3)
    assert image.shape[0] % 2 == 0 and image.shape[1] % 2 == 0
    assert image.shape[0] < 1.5 * image.shape[1]


def test_small_people_are_dots_and_every_one_of_a_thousand_is_seen():
    hall = Geometry.from_polygon([(0, 0), (50, 0), (50, 50), (0, 50)], exits={"door": [(50, 20), (50, 25)]})
    renderer = Renderer(hall, width=640)
    x, y = np.meshgrid(np.linspace(1, 49, 40), np.linspace(1, 49, 25))
    position = np.stack([x.ravel(), y.ravel()], axis=1)
    image = renderer.frame(position, 0.2, velocity=np.ones_like(position))
    at = renderer.layout.pixels(position).astype(int)
    assert (image[at[:, 1], at[:, 0]] == RAMP[0]).all()


# ------------------------------------------------------------------------------------------------------------- window


@pytest.mark.more
def test_window_shows_frames_paces_them_and_closes():
    pygame = pytest.importorskip("pygame")
    frame = Renderer(ROOM, width=200).frame([[1.0, 1.0]], 0.2)
    with Window("test", fps=50.0) as window:
        assert window.show(frame)
        start = time.monotonic()
        for _ in range(5):
            assert window.show(frame)
        assert time.monotonic() - start > 0.08
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
        np.testing.assert_array_equal(shown, frame)
        assert window.show(frame[:100])  # another size
    assert not window.is_open
    assert not window.show(frame)
    window.close()


# ----------------------------------------------------------------------------------------------------------- libraries


@pytest.mark.more
def test_importing_loads_no_drawing_library_and_frames_need_pillow_alone():
    program = """
import sys
import crowd_env.rendering as rendering
heavy = {"pygame", "matplotlib", "imageio", "imageio_ffmpeg", "PIL"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
from crowd_env.geometry.geometry import Geometry
room = Geometry.from_polygon([(0, 0), (5, 0), (5, 5), (0, 5)], exits=[[(5, 2), (5, 3)]])
image = rendering.Renderer(room, width=200).frame([[1, 1]], [0.2], clock=1.0)
assert not {"pygame", "matplotlib"} & set(sys.modules)
print(image.shape)
"""
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")}
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=CHECKOUT, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.endswith("200, 3)\n")


@pytest.mark.more
def test_a_missing_library_is_named_with_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ModuleNotFoundError, match=r"pygame.*: pip install pygame-ce matplotlib pillow imageio-ffmpeg"):
        Window().show(np.zeros((60, 80, 3), dtype=np.uint8))


@pytest.mark.more
def test_several_exits_have_their_names_beside_them_and_a_single_one_has_none():
    room, door = box(0, 0, 8, 5), [(8, 2), (8, 3)]
    frames = {}
    for names in (("west", "east"), ("out", "out")):
        exits = dict.fromkeys(names)
        exits[names[0]] = [(0, 3), (0, 2)]
        exits[names[1]] = door if names[0] != names[1] else exits[names[0]]
        geometry = Geometry.from_polygon(room, exits=exits)
        renderer = Renderer(geometry, width=480)
        image = renderer.frame(np.zeros((0, 2)), [], inside=1).astype(int)
        left, top = renderer.layout.pixels((0.0, 3.5)).astype(int)
        beside = image[top : top + round(2 * renderer.layout.scale), 2 : left - 10]
        frames[names[0]] = (np.abs(beside - EXIT).sum(axis=-1) < 60).any()
    assert frames == {"west": True, "out": False}


def test_pictures_of_discs_that_are_kept_hold_no_more_than_they_may(monkeypatch):
    """Long films of large discs: each size, place and heading is another picture."""
    monkeypatch.setattr(discs, "_MOST", 400_000)
    renderer, rng = Renderer(ROOM, width=300), np.random.default_rng(0)
    low, high = np.array(ROOM.bounds[:2]) + 0.4, np.array(ROOM.bounds[2:]) - 0.4
    spots, radius, way = rng.uniform(low, high, (200, 2)), rng.uniform(0.15, 0.35, 200), rng.normal(size=(200, 2))
    most, frames = 0, []
    for _ in range(2):
        for k in range(200):
            frames.append(renderer.frame(spots[k : k + 1], radius[k : k + 1], velocity=way[k : k + 1]))
            pictures = [one for _, *both in discs._PICTURES.values() for one in both if one is not None]
            most = max(most, sum(one.width * one.height for one in pictures))
    assert 100_000 < most <= 400_000
    for one, again in zip(frames[:200], frames[200:], strict=True):
        np.testing.assert_array_equal(one, again)
