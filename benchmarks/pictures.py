"""The pictures of docs/performance.md, drawn from the tables that ``python -m benchmarks --csv`` writes.

``python -m benchmarks.pictures`` draws them here.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from validation.pages import TABLES, read_table

IMAGES = TABLES.parent / "images"
_COLORS = {"dem": "#c2410c", "nsm1": "#0f766e", "nsm1-loose": "#5eead4", "nsm2": "#1d4ed8", "hertz": "#7c3aed"}
# What is compared: table, scene as its rows end, words of the column of the other program, and what the picture calls it.
_OTHERS = (
    ("batch", "256 x 20", "vmas navigation", "VMAS navigation\n256 rooms of 20"),
    ("batch", "256 x 20", "magent2 battle", "MAgent2 battle\n256 rooms of 20"),
    ("room20", "20 people", "jupedsim collision-free speed", "JuPedSim\na room of 20"),
    ("hall", " 20000 people", "jupedsim collision-free speed", "JuPedSim\na hall of 20,000"),
    ("hall", " 20000 people", "cromosim granular, uzawa", "cromosim\na hall of 20,000"),
    ("jam", " 5000 people", "pymunk", "pymunk\na jam of 5,000"),
)
_SIZES = {" k": 1e3, " M": 1e6, " G": 1e9}


def draw_pictures(folder: Path = TABLES, images: Path = IMAGES) -> list[Path]:
    """Draw how fast we are beside others, and what a person-step and a second thread bring; return the files."""
    from matplotlib.figure import Figure

    beside, alone = Figure((8.0, 4.2), layout="constrained"), Figure((8.0, 4.2), layout="constrained")
    _beside_others(beside.subplots(), folder)
    people, threads = alone.subplots(1, 2, width_ratios=(3, 2))
    _with_people(people, folder)
    _with_threads(threads, folder)
    found = [images / "speed-others.png", images / "speed-people.png"]
    for figure, path in zip((beside, alone), found, strict=True):
        figure.savefig(path, dpi=120)
    return found


def cells(folder: Path, table: str, column: str) -> Iterator[tuple[str, str, float]]:
    """Yield scheme, scene and figure of the rows of a table that have one in the first column with these words."""
    head, *rows = read_table(f"benchmark-{table}", folder)
    for k in [k for k, name in enumerate(head) if set(column.split()) <= set(name.split())][:1]:
        for row in rows:
            way, _, scene = row[0].partition(", ")
            if way.partition(" ")[0] in _COLORS and "1e-3" not in way and row[k]:
                yield way, scene, float(row[k].split()[0]) * _SIZES.get(row[k][-2:], 1.0)


def _beside_others(axes: Any, folder: Path) -> None:
    for line, (table, scene, other, _) in enumerate(reversed(_OTHERS)):
        for way, where, times in cells(folder, table, f"times {other}"):
            if where.endswith(scene) and not way.endswith(" 0.001 s"):
                axes.plot(times, line, "o", color=_COLORS[way.partition(" ")[0]], markersize=9, alpha=0.85)
    axes.axvline(1.0, color="0.4", linewidth=1.0)
    axes.set(xscale="log", xlabel="times as fast as the other program, per CPU second", ylim=(-0.6, len(_OTHERS) - 0.4))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_yticks(range(len(_OTHERS)), [label for *_, label in reversed(_OTHERS)])
    axes.grid(axis="x", alpha=0.3)
    _legend(axes)


def _with_people(axes: Any, folder: Path) -> None:
    for table, style in (("hall", "o-"), ("jam", "s--")):
        lines: dict[str, list[tuple[int, float]]] = {}
        for way, scene, rate in cells(folder, table, "person-steps"):
            if not way.endswith(" 0.001 s"):
                lines.setdefault(way.partition(" ")[0], []).append((int(scene.split()[-2]), 1e9 / rate))
        for name, points in lines.items():
            axes.plot(*zip(*points, strict=True), style, color=_COLORS[name], markersize=4)
    axes.set(xscale="log", yscale="log", xlabel="people", ylabel="ns of a core, a person and step")
    axes.set_title("hall (solid) and jam (dashed)", fontsize="medium")
    axes.grid(alpha=0.3)
    _legend(axes)


def _with_threads(axes: Any, folder: Path) -> None:
    lines: dict[str, int] = {}
    for way, scene, speed in reversed([*cells(folder, "scaling", "speed on")]):
        place, _, by = scene.rpartition(", ")
        line, processes = lines.setdefault(f"{way}\n{place}", len(lines)), "processes" in by
        if not by.startswith("1 "):
            axes.plot(speed, line, "|" if processes else "o", color=_COLORS[way.partition(" ")[0]], markersize=9)
    axes.set_yticks(range(len(lines)), lines)
    axes.tick_params(axis="y", labelsize="small")
    axes.set(xlabel="speed on the clock, of one thread:\n2 threads (dot), 2 processes (line)", xlim=(0.9, 2.3))
    axes.grid(axis="x", alpha=0.3)


def _legend(axes: Any) -> None:
    for name, color in _COLORS.items():
        axes.plot([], [], "o", color=color, label=name)
    axes.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=len(_COLORS), frameon=False)


if __name__ == "__main__":
    draw_pictures(images=Path())
