"""The page in a browser: it is clicked, dragged and typed at, and what it then shows is what the recording says.

It needs Playwright (``pip install playwright``; its own browsers are not needed) and Chromium (``apt install chromium``).
"""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from late import late
from replayed_pages import walk_out
from storeys import with_stair

from crowd_env import Scenario
from crowd_env.recording import Recording, record
from crowd_env.rendering.palette import pressure_color
from crowd_env.rendering.replay import write_page

sync_api = late("playwright.sync_api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.more,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to show the page with"),
]

RECORDING = walk_out(12, stays=2, contacts=True)
EVIL = '</script><img src="x" onerror="window.evil = 1"><b>'


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


def _cut_short(recording: Recording) -> Recording:
    """Return a recording whose last frame holds only those who got out just before it, as those of time limits do."""
    last = int(np.searchsorted(recording.times, 2.0)) + 1
    gone = (recording.frame > last) | ((recording.frame == last) & ~(recording.exit_time[recording.person] <= 2.0))
    rows = {name: getattr(recording, name)[~gone] for name in ("person", "position", "velocity", "pressure")}
    starts = np.concatenate([[0], np.cumsum(~gone)])[recording.frame_start[: last + 2]]
    out = recording.exit_time <= 2.0
    left = {
        "exit_time": np.where(out, recording.exit_time, np.nan),
        "exit_index": np.where(out, recording.exit_index, -1),
    }
    return replace(recording, times=recording.times[: last + 1], frame_start=starts, **left, **rows)


@cache
def house() -> Recording:
    return record(Scenario("house", with_stair(), [{"people": 12, "desired_speed": 1.4}], 60.0), seed=5, contacts=True)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    evil = walk_out(scenario=EVIL, **{EVIL: EVIL})
    recordings = {
        "one": [RECORDING],
        "two": [RECORDING, walk_out(5, strategy="nearest")],
        "cut": [_cut_short(walk_out(12, stays=2, end=2.0)), RECORDING],
        "torso": [walk_out(outline="torso")],
        "evil": [evil],
        "house": [house()],
    }
    return {name: write_page(folder / f"{name}.html", several).path for name, several in recordings.items()}


class Tab:
    """A page that is open, and what went wrong on it."""

    def __init__(self, browser: Any, path: Path, width: int = 1280, height: int = 800, **options: Any) -> None:
        self.context = browser.new_context(viewport={"width": width, "height": height}, offline=True, **options)
        self.page = self.context.new_page()
        self.wrong: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda said: self.wrong.append(said.text) if said.type == "error" else None)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("body.ready")

    def get(self, expression: str) -> Any:
        return self.page.evaluate(expression)

    def wait(self, condition: str) -> None:
        """Wait until a condition holds; the page allows no code from strings, so Playwright's own waiting cannot."""
        while not self.get(condition):
            self.page.wait_for_timeout(20)

    def view(self, pane: int = 0) -> list[float]:
        return list(self.get(f"(({{scale, left, top}}) => [scale, left, top])(replay.panes[{pane}].view)"))

    def close(self) -> None:
        assert not self.wrong
        self.context.close()


@pytest.fixture
def tab(browser: Any, pages: dict[str, Path], request: pytest.FixtureRequest) -> Iterator[Tab]:
    opened = Tab(browser, pages[getattr(request, "param", "one")])
    yield opened
    opened.close()


def test_it_asks_nobody_for_anything(tab: Tab) -> None:
    assert all(url.startswith(("file:", "data:", "blob:")) for url in tab.requests)


def test_people_are_where_the_recording_says_also_between_frames(tab: Tab) -> None:
    for time in (0.0, 0.55, 1.0, 2.37):
        tab.get(f"replay.seek({time})")
        shown = tab.get(
            "(({who, shown, px, py}) => Array.from(who.slice(0, shown), n => [n, px[n], py[n]]))(replay.recordings[0])"
        )
        seen = {int(n): (x, y) for n, x, y in shown}
        for n, (x, y) in seen.items():
            rows = RECORDING.person == n
            times, ways = RECORDING.times[RECORDING.frame[rows]], RECORDING.position[rows]
            assert x == pytest.approx(np.interp(time, times, ways[:, 0]), abs=1e-3)
            assert y == pytest.approx(np.interp(time, times, ways[:, 1]), abs=1e-3)
        assert {n for n in range(12) if not RECORDING.exit_time[n] <= time} <= set(seen)
        assert tab.page.inner_text(".count strong") == str(RECORDING.inside(time))


def test_play_pause_and_the_end(tab: Tab) -> None:
    tab.page.click("#play")
    tab.wait("replay.time > 0.2")
    assert tab.page.get_attribute("#play", "aria-label") == "Pause"
    tab.page.click("#play")
    assert not tab.get("replay.playing")
    tab.page.select_option("#speed", "16")
    tab.page.locator("canvas.moving").focus()
    tab.page.keyboard.press("Space")
    tab.wait("!replay.playing && replay.time === replay.end")
    assert tab.page.get_attribute("#play", "aria-label") == "Play"
    assert tab.page.inner_text("#clock").startswith(f"{RECORDING.times[-1]:.1f} /")
    tab.get("replay.rate = 0")
    tab.page.keyboard.press("Space")  # from the beginning
    assert tab.get("[replay.time, replay.playing]") == [0, True]


def test_keys_step_by_frames_and_seconds(tab: Tab) -> None:
    for key, time in [
        ("ArrowRight", 0.1),
        ("ArrowRight", 0.2),
        ("ArrowLeft", 0.1),
        ("Shift+ArrowRight", 1.1),
        ("End", RECORDING.times[-1]),
        ("Home", 0.0),
    ]:
        tab.page.keyboard.press(key)
        assert tab.get("replay.time") == pytest.approx(time, abs=1e-3), key
    tab.get("replay.seek(0.25)")
    tab.page.keyboard.press("ArrowLeft")
    assert tab.get("replay.time") == pytest.approx(0.2, abs=1e-3)
    tab.page.keyboard.press(">")
    assert tab.get("replay.rate") == 2
    assert tab.page.input_value("#speed") == "2"


def test_scrubbing_by_the_slider_and_by_the_curves(tab: Tab) -> None:
    box = tab.page.locator("#scrub").bounding_box()
    tab.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    middle = RECORDING.times[-1] / 2
    assert tab.get("replay.time") == pytest.approx(middle, rel=0.02)
    box = tab.page.locator("#curves").bounding_box()
    tab.page.mouse.move(box["x"] + 60, box["y"] + 30)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + tab.get("replay.charts.x(1.5)"), box["y"] + 30)
    tab.page.mouse.up()
    assert tab.get("replay.time") == pytest.approx(1.5, abs=0.01)
    assert float(tab.page.input_value("#scrub")) == pytest.approx(1.5, abs=0.01)
    assert tab.page.get_attribute("#scrub", "aria-valuetext").startswith("1.5 /")


def test_wheel_drag_and_double_click(tab: Tab) -> None:
    box = tab.page.locator("canvas.moving").bounding_box()
    x, y = round(box["x"]) + 500, round(box["y"]) + 200  # mice know whole pixels
    px, py = x - box["x"], y - box["y"]
    scale, left, top = tab.view()
    tab.page.mouse.move(x, y)
    tab.page.mouse.wheel(0, -300)
    tab.wait(f"replay.panes[0].view.scale > {scale}")
    nearer, left2, top2 = tab.view()
    assert (px - left2) / nearer == pytest.approx((px - left) / scale)  # what is below the mouse stays there
    assert (top2 - py) / nearer == pytest.approx((top - py) / scale)
    tab.page.mouse.down()
    tab.page.mouse.move(x + 80, y - 40, steps=4)
    tab.page.mouse.up()
    assert tab.view() == pytest.approx([nearer, left2 + 80, top2 - 40])
    assert tab.page.is_visible("text=Show all")
    tab.page.mouse.dblclick(x, y)
    assert tab.view() == pytest.approx([scale, left, top])
    tab.page.locator("canvas.moving").focus()
    tab.page.keyboard.press("+")
    assert tab.view()[0] == pytest.approx(1.4 * scale)
    tab.page.click("text=Show all")
    assert tab.view() == pytest.approx([scale, left, top])


def test_two_fingers_zoom(browser: Any, pages: dict[str, Path]) -> None:
    tab = Tab(browser, pages["one"], 375, 812, has_touch=True, is_mobile=True, device_scale_factor=2)
    box = tab.page.locator("canvas.moving").bounding_box()
    touch = tab.context.new_cdp_session(tab.page)

    def fingers(kind: str, apart: float | None) -> None:
        places = [] if apart is None else [-apart, apart]
        points = [{"x": box["x"] + 180 + side, "y": box["y"] + 150, "id": k} for k, side in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    before = tab.view()[0]
    fingers("touchStart", 30)
    for apart in (40, 50, 60):
        fingers("touchMove", apart)
    fingers("touchEnd", None)
    assert tab.view()[0] == pytest.approx(2.0 * before, rel=0.02)
    tab.close()


def pixel(tab: Tab, n: int, dx: float = 0.0, dy: float = 0.0) -> tuple[int, ...]:
    """Return the color (r, g, b, a) drawn over person n of the first recording, or beside by so many radii."""
    return tuple(
        tab.get(f"""(() => {{
            const {{ view, moving, recording }} = replay.panes[0], n = {n}, r = view.scale * recording.radius[n];
            const x = view.px(recording.px[n]) + {dx} * r, y = view.py(recording.py[n]) + {dy} * r;
            return [...moving.getContext("2d").getImageData(x * view.ratio, y * view.ratio, 1, 1).data];
        }})()""")
    )


def test_colors_say_what_the_legend_says(tab: Tab) -> None:
    tab.page.select_option("#color", "pressure")
    tab.get("replay.seek(1)")
    ramp = pressure_color(np.linspace(0.0, 1.0, 32))
    for n in (0, 4, 8):
        level = min((200.0 * n + 100.0) / 1600.0, 1.0)
        assert pixel(tab, n, 0.0, 0.4)[:3] == pytest.approx(tuple(ramp[round(31 * level)]), abs=3)
    assert "1600 N/m" in tab.page.inner_text("#legend")
    tab.page.select_option("#color", "cohort")
    assert pixel(tab, 0, 0.0, 0.4) == pixel(tab, 2, 0.0, 0.4) != pixel(tab, 1, 0.0, 0.4)
    assert tab.page.inner_text("#legend").split() == ["slow", "fast"]
    tab.page.select_option("#color", "time")
    assert "inside to the end" in tab.page.inner_text("#legend")
    assert pixel(tab, 10, 0.0, 0.4)[:3] == (158, 165, 172)  # stays
    tab.page.select_option("#color", "speed")
    assert "m/s" in tab.page.inner_text("#legend")
    tab.page.locator("canvas.moving").focus()
    tab.page.keyboard.press("c")
    assert tab.page.input_value("#color") == "time"


def test_forces_are_lines_between_bodies(tab: Tab) -> None:
    tab.get("replay.seek(0.5)")
    without = pixel(tab, 8, 0.45)
    tab.page.check("#forces")
    assert pixel(tab, 8, 0.45) != without
    assert tab.page.inner_text("#legend").endswith("N")
    tab.page.uncheck("#forces")
    assert pixel(tab, 8, 0.45) == without


@pytest.mark.parametrize("tab", ["torso"], indirect=True)
def test_bodies_turn_and_without_contacts_there_are_no_forces(tab: Tab) -> None:
    assert not tab.page.is_visible("#forces-field")
    away = [-1.2 * np.sin(-3.0), -1.2 * np.cos(-3.0)]  # the right shoulder; down is up
    along = [1.2 * np.cos(-3.0), -1.2 * np.sin(-3.0)]
    assert pixel(tab, 0, *away)[3] == 255 and pixel(tab, 0, *along)[3] == 0


@pytest.mark.parametrize("tab", ["two"], indirect=True)
def test_two_recordings_in_step(tab: Tab) -> None:
    tab.get("replay.seek(1.7)")
    assert tab.get("replay.recordings.map(one => one.time)") == pytest.approx([1.7, 1.7])
    counts = tab.page.locator(".count strong").all_inner_texts()
    assert counts == [str(RECORDING.inside(1.7)), str(walk_out(5).inside(1.7))]
    assert [text.split(" –")[0] for text in tab.page.locator(".head > span:first-of-type").all_inner_texts()] == [
        "shortest · 12 people",
        "nearest · 5 people",
    ]
    box = tab.page.locator("canvas.moving").first.bounding_box()
    tab.page.mouse.move(box["x"] + 300, box["y"] + 200)
    tab.page.mouse.wheel(0, -200)
    tab.wait("!replay.panes[0].view.fitted")
    assert tab.view(1) == pytest.approx(tab.view(0), rel=0.01)  # of one place: they move together


def test_a_click_on_a_person_tells_of_it(tab: Tab) -> None:
    tab.get("replay.seek(0.5)")
    box = tab.page.locator("canvas.moving").bounding_box()
    x, y = tab.get(
        "[replay.panes[0].view.px(replay.recordings[0].px[3]), replay.panes[0].view.py(replay.recordings[0].py[3])]"
    )
    tab.page.mouse.click(box["x"] + x, box["y"] + y)
    left = RECORDING.exit_time[3] - 0.5
    text = tab.page.inner_text(".readout")
    assert text.startswith("Person 3 · fast · 1.00 m/s · ") and text.endswith(f"out in {left:.1f} s by right")


def test_facts_open_and_close(tab: Tab) -> None:
    tab.page.click("#facts-button")
    assert tab.page.get_attribute("#facts-button", "aria-expanded") == "true"
    rows = tab.page.locator("#facts tr").all_inner_texts()
    assert "seed\t3" in rows and "strategy\tshortest" in rows
    tab.page.keyboard.press("Escape")
    assert not tab.page.is_visible("#facts")
    assert tab.get("document.activeElement.id") == "facts-button"


@pytest.mark.parametrize("tab", ["evil"], indirect=True)
def test_markup_in_names_is_text(tab: Tab) -> None:
    tab.page.click("#facts-button")
    assert EVIL in tab.page.inner_text("h1") and EVIL in tab.page.inner_text("#facts")
    assert tab.get("document.querySelectorAll('img, b').length") == 0
    assert tab.get("window.evil") is None


@pytest.mark.parametrize("name", ["one", "two", "house"])
@pytest.mark.parametrize("width", [375, 1280])
def test_nothing_overflows_and_fingers_find_what_they_press(
    browser: Any, pages: dict[str, Path], name: str, width: int
) -> None:
    tab = Tab(browser, pages[name], width, 812)
    tab.page.check("#forces")
    assert tab.get("document.documentElement.scrollWidth") == width
    for control in tab.page.locator("button, select, input, label.field, canvas, #legend").all():
        if not control.is_visible():
            continue
        box = control.bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width
        assert box["y"] >= 0 and box["y"] + box["height"] <= 812
    small = tab.page.locator("button, select, label.field, #scrub").all()
    heights = [one.bounding_box()["height"] for one in small if one.is_visible()]
    assert min(heights) >= (44 if width < 600 else 28)
    tab.close()


def contrast(one: str, other: str) -> float:
    """Return the ratio of two colors "rgb(1, 2, 3)", as WCAG 2.1 defines it."""

    def luminance(color: str) -> float:
        channels = np.array([float(part) for part in color[color.index("(") + 1 : -1].split(",")[:3]]) / 255.0
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_can_be_read(browser: Any, pages: dict[str, Path], scheme: str) -> None:
    tab = Tab(browser, pages["one"], color_scheme=scheme)
    style = "(selector, name) => getComputedStyle(document.querySelector(selector))[name]"

    def color(selector: str, name: str) -> str:
        return str(tab.get(f"({style})('{selector}', '{name}')"))

    page, panel = color("body", "backgroundColor"), color("footer", "backgroundColor")
    for letters, ground in (("#summary", page), ("h1", page), (".count", page), ("#legend", panel), ("#clock", panel)):
        assert contrast(color(letters, "color"), ground) >= 4.5, letters
    assert (contrast(page, "rgb(0, 0, 0)") < 2.0) == (scheme == "dark")
    tab.close()


def test_who_is_counted_inside_is_drawn_to_the_end_of_the_page(browser: Any, pages: dict[str, Path]) -> None:
    tab = Tab(browser, pages["cut"])
    tab.page.keyboard.press("End")
    shown = tab.page.evaluate("replay.recordings.map((one) => [one.shown, one.inside(replay.time)])")
    assert shown[0] == [shown[0][1]] * 2 and 2 < shown[0][0] < 12
    assert f"{shown[0][0]} still inside after 2.0 s" in tab.page.inner_text("#plans")
    tab.page.evaluate("replay.seek(replay.recordings[0].end)")
    drawn = tab.page.evaluate("[replay.recordings[0].shown, replay.recordings[0].inside(replay.time)]")
    assert drawn[0] >= drawn[1] == shown[0][0]  # and those who have just stepped out
    tab.close()


# ------------------------------------------------------------------------------------------------- of several storeys


def shown_people(tab: Tab) -> dict[int, tuple[float, float]]:
    """Return where people are drawn [m]."""
    found = tab.get(
        "(({who, shown, px, py}) => Array.from(who.slice(0, shown), n => [n, px[n], py[n]]))(replay.recordings[0])"
    )
    return {int(n): (x, y) for n, x, y in found}


@pytest.mark.parametrize("tab", ["house"], indirect=True)
def test_between_two_sheets_of_the_layout_nobody_flies(tab: Tab) -> None:
    geometry, known = house().geometry, 0
    sheet = house().places()[2]
    for n in range(12):
        rows = np.flatnonzero(house().person == n)
        for a, b in pairwise(rows):
            if sheet[a] != sheet[b]:
                time = 0.5 * (house().times[house().frame[a]] + house().times[house().frame[b]])
                tab.get(f"replay.seek({time})")
                at = np.array(shown_people(tab)[n]) + tab.get("replay.recordings[0].layout.origin")
                assert np.hypot(*(at - house().position[a])) < 2e-3
                known += 1
    assert known > 4 and geometry.building is not None


@pytest.mark.parametrize("tab", ["house"], indirect=True)
def test_one_above_another_ways_are_joined_and_higher_is_above(tab: Tab) -> None:
    tab.page.select_option("#storey", "one above another")
    x, y, first = tab.get("(({x, y, start}) => [[...x], [...y], [...start]])(replay.recordings[0])")
    for n in range(12):
        ways = np.column_stack([x, y])[first[n] : first[n + 1]]
        assert np.hypot(*np.diff(ways, axis=0).T).max() < 1.0  # over the seams too
    lowest = "({name, shells}) => [name, Math.min(...shells.flat().map((at) => at[1]))]"
    parts = tab.get(f"replay.recordings[0].plan.parts.map({lowest})")
    assert [name.split(" ")[0] for name, _ in parts] == ["ground", "", "upper"] and parts[0][1] < parts[2][1]
    tab.get("replay.seek(0)")
    shown, true = shown_people(tab), house().places()
    for n, (_, v) in shown.items():
        assert (v >= parts[2][1]) == (true[1][n] > 2.9), n


@pytest.mark.parametrize("tab", ["house"], indirect=True)
def test_the_storey_follows_the_person_that_was_chosen(tab: Tab) -> None:
    sheet = house().places()[2]
    n = int(house().person[sheet == 1][0])
    tab.page.locator("canvas.moving").focus()
    for view in ("one above another", "upper  +3.00 m"):
        tab.page.keyboard.press("PageDown")
        assert tab.page.input_value("#storey") == view
    upstairs = int((sheet[house().frame == 0] == 1).sum())
    assert tab.page.inner_text(".count") == f"{upstairs} of 12 inside"
    tab.get(f"replay.panes[0].chosen = {n}")
    storeys = []
    for time in house().times[house().times < house().exit_time[n]]:
        tab.get(f"replay.seek({time})")
        storeys.append(tab.get("replay.shown.split(' ')[0]"))
    assert [one for one, _ in groupby(storeys)] == ["upper", "stair", "ground"]
    tab.page.keyboard.press("n")
    assert tab.get("replay.panes[0].chosen") != n


@pytest.mark.parametrize("tab", ["house"], indirect=True)
def test_print_shows_the_layout(tab: Tab) -> None:
    tab.page.select_option("#storey", "stair")
    tab.get("window.printed = []; addEventListener('beforeprint', () => printed.push(replay.shown))")
    tab.page.pdf()
    assert tab.get("[printed, replay.shown]") == [["side by side"], "stair"]


def test_a_place_of_one_storey_has_no_control_of_storeys(tab: Tab) -> None:
    assert not tab.page.is_visible("#storey-field")
    tab.page.keyboard.press("PageDown")
    assert tab.get("replay.shown") == "side by side"
