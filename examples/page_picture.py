"""Show a page in Chromium and keep a picture: python -m examples.page_picture PAGE.html FILE.png WIDTH HEIGHT [SECONDS].

It needs Playwright (pip install playwright) and Chromium (apt install chromium).  SECONDS is where a replay is stopped.
"""

import shutil
import sys
from pathlib import Path

import matplotlib
from playwright.sync_api import sync_playwright

FONTS = Path(matplotlib.get_data_path()) / "fonts/ttf"
# The fonts of matplotlib, which every machine has; what differs from day to day is left out.
STYLE = "".join(
    f"@font-face {{ font-family: Page; src: url('{(FONTS / file).as_uri()}'); font-weight: {weight}; }}"
    for file, weight in (("DejaVuSans.ttf", "400"), ("DejaVuSans-Bold.ttf", "600 900"))
)
STYLE += "body, button, select, svg, text { font-family: Page !important; } .made { visibility: hidden; }"


def main(page: str, path: str, width: str, height: str, seconds: str = "") -> None:
    """Write the picture."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        raise SystemExit("there is no chromium to show the page with: apt install chromium")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-gpu"])
        shown = chromium.new_page(viewport={"width": int(width), "height": int(height)}, bypass_csp=True)
        shown.goto(Path(page).resolve().as_uri())
        shown.add_style_tag(content=STYLE)
        shown.evaluate("document.fonts.ready")
        if seconds:
            shown.evaluate(
                "at => { const scrub = document.getElementById('scrub');"
                " scrub.value = at; scrub.dispatchEvent(new Event('input')); }",
                seconds,
            )
            shown.wait_for_timeout(500)
        shown.screenshot(path=path)
        chromium.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
