"""The page in a browser: it fits a phone, and asks for nothing.

It needs Playwright (``pip install playwright``; its own browsers are not needed) and Chromium (``apt install chromium``).
"""

import shutil
from pathlib import Path

import pytest
from late import late
from typer.testing import CliRunner

from crowd_env.cli.main import app

sync_api = late("playwright.sync_api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.more,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to show the page with"),
]


def test_the_page_fits_a_phone_and_asks_for_nothing(tmp_path: Path) -> None:
    words = [
        "run",
        "room-v0",
        "--people",
        "4",
        "--runs",
        "2",
        "--out",
        str(tmp_path / "a folder with a rather long name"),
    ]
    assert CliRunner().invoke(app, words).exit_code == 0
    page = tmp_path / "report.html"
    assert CliRunner().invoke(app, ["report", words[-1], "-o", str(page), "--no-maps"]).exit_code == 0
    asked: list[str] = []
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        for width in (375, 1280):
            shown = chromium.new_page(viewport={"width": width, "height": 800})
            shown.on("request", lambda request: asked.append(request.url.split(":")[0]))
            shown.on("console", lambda message: asked.append(message.text))
            shown.goto(page.as_uri())
            assert shown.evaluate("document.documentElement.scrollWidth") == width
            assert shown.evaluate("[...document.images].every(image => image.naturalWidth > 0)")
        printed = chromium.new_page()
        printed.goto(page.as_uri())
        printed.emulate_media(media="print")
        printed.set_viewport_size({"width": 680, "height": 1000})  # A4 within its margins, 180 mm x 265 mm
        answer, sign = (printed.locator(name).bounding_box() for name in (".answer", ".sign"))
        assert sign is not None and answer is not None and sign["y"] + sign["height"] < 1000.0  # on the first page
        letters = printed.evaluate(
            "getComputedStyle(document.querySelectorAll('.annex ~ section > h2')[1], '::before').content"
        )
        assert "annex" in letters  # sections of the annex have letters
        chromium.close()
    assert set(asked) <= {"file", "data"}
