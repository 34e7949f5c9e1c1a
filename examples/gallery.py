"""Draw every scenario and task, and write docs/gallery.md: python -m examples.gallery (from the checkout).

A picture shows the moment of most pressure in the first ten seconds, everyone at full speed along the shortest route; where
something comes of it later, a loop shows the first 20 s at four times the speed.
"""

from pathlib import Path

from crowd_env import SCENARIOS, Scenario, make_scenario, record
from crowd_env.agents.tasks import TASKS
from crowd_env.rendering import write_still
from crowd_env.scenarios.scenario import changed_place
from examples.loops import frames_of, write_loop

DOCS = Path("docs")
IMAGES = Path("images") / "gallery"
_SECONDS, _WIDTH, _IN_A_ROW = 10.0, 320, 3
_LOOPED = (
    *("room-v0", "bottleneck-v0", "pillar-v0", "t-junction-v0", "counter-flow-v0", "crossing-v0", "classroom-v0"),
    *("competitive-door", "narrow-door", "hertz-room", "literal-room", "counter-flow", "two-narrow-exits"),
)
_LOOP, _FRAMES, _LOOP_WIDTH = 20.0, 30, 300  # s, frames in it, px
_HEAD = """# Gallery

Every scenario and every task, with everyone at full speed along the shortest route.
Each picture shows the moment of most pressure in the first ten seconds, each loop the first 20 s at four times the speed.
[Phenomena](phenomena.md) shows what comes of it one by one, with measures.
`python -m examples.gallery` draws this page anew.
"""


def file_of(name: str) -> str:
    """Return the name of the picture of a place."""
    return f"{name}.gif" if name in _LOOPED else f"{name}.png"


def draw(name: str, place: Scenario, scheme: str) -> None:
    """Draw one place."""
    if name in _LOOPED:
        film = record(changed_place(place, {"time_limit": _LOOP}), scheme=scheme, seed=0)
        end = min(film.end, _LOOP)
        frames = frames_of({name: film}, _LOOP_WIDTH, end, round(end / _LOOP * _FRAMES))
        write_loop(DOCS / IMAGES / file_of(name), list(frames))
        return
    limit = min(place.time_limit, _SECONDS)
    recording = record(changed_place(place, {"time_limit": limit}), scheme=scheme, seed=0)
    write_still(DOCS / IMAGES / file_of(name), recording, titles=[name], width=_WIDTH)


def table(names: list[str], about: dict[str, str]) -> str:
    """Return a table of pictures, each with its name and what it is."""
    rows = [names[k : k + _IN_A_ROW] for k in range(0, len(names), _IN_A_ROW)]
    lines = ["| " * _IN_A_ROW + "|", "|---" * _IN_A_ROW + "|"]
    for row in rows:
        cells = [f"![{name}]({(IMAGES / file_of(name)).as_posix()})<br>{about[name]}" for name in row]
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
