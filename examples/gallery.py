"""Draw every scenario and task, and write docs/gallery.md: python -m examples.gallery (from the checkout).

A picture shows the moment of most pressure in the first ten seconds, everyone at full speed along the shortest route.
"""

from pathlib import Path

from crowd_env import SCENARIOS, Scenario, make_scenario, record
from crowd_env.agents.tasks import TASKS
from crowd_env.rendering import write_still
from crowd_env.scenarios.scenario import changed_place

DOCS = Path("docs")
IMAGES = Path("images") / "gallery"
_SECONDS, _WIDTH, _IN_A_ROW = 10.0, 320, 3
_HEAD = """# Gallery

Every scenario and every task, with everyone at full speed along the shortest route.
Each picture shows the moment of most pressure in the first ten seconds.
`python -m examples.gallery` draws this page anew.
"""


def draw(name: str, place: Scenario, scheme: str) -> None:
    """Draw one place."""
    limit = min(place.time_limit, _SECONDS)
    recording = record(changed_place(place, {"time_limit": limit}), scheme=scheme, seed=0)
    write_still(DOCS / IMAGES / f"{name}.png", recording, titles=[name], width=_WIDTH)


def table(names: list[str], about: dict[str, str]) -> str:
    """Return a table of pictures, each with its name and what it is."""
    rows = [names[k : k + _IN_A_ROW] for k in range(0, len(names), _IN_A_ROW)]
    lines = ["| " * _IN_A_ROW + "|", "|---" * _IN_A_ROW + "|"]
    for row in rows:
        cells = [f"![{name}]({(IMAGES / name).as_posix()}.png)<br>{about[name]}" for name in row]
        lines.append("| " + " | ".join(cells + [""] * (_IN_A_ROW - len(row))) + " |")
    return "\n".join(lines)


def page() -> str:
    """Return the text of the page."""
    about = {name: f"[{name}](scenarios.md): {make_scenario(name).title}" for name in SCENARIOS}
    about |= {name: f"[{name}](tasks/{name}.md): {task.about}" for name, task in TASKS.items()}
    parts = [_HEAD, "## Scenarios\n", table(list(SCENARIOS), about), "\n## Tasks\n", table(list(TASKS), about)]
    return "\n".join(parts) + "\n"


def main() -> None:
    """Draw all places and write the page."""
    (DOCS / IMAGES).mkdir(parents=True, exist_ok=True)
    for name in SCENARIOS:
        draw(name, make_scenario(name), "nsm2")
    for name, task in TASKS.items():
        draw(name, task.place(), task.scheme)
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
