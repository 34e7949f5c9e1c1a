"""``python -m benchmarks.report DIR``: put what ``python -m benchmarks --out DIR`` has written into docs/performance.md.

Between ``<!-- case: NAME -->`` and ``<!-- end -->`` stand the tables of a case, and nothing that is written by hand; plots go
to docs/images.  Cases without a file in DIR stay as they are, and so does the summary if one of its cases has none.
"""

import shutil
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.cli import CASES
from benchmarks.tables import Grid, Result, grids, number
from crowd_env.core.console import friendly_errors, notes
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import read_json
from validation.pages import markdown as markdown_table
from validation.pages import replaced

PAGE = Path(__file__).resolve().parent.parent / "docs" / "performance.md"


def run(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that --out named.")],
    page: Annotated[Path, typer.Option(help="Page to write the tables into.")] = PAGE,
) -> None:
    """Write the tables of docs/performance.md, and its plots, from measured figures."""
    with friendly_errors():
        done = fill(folder, page)
    notes.print(f"{page.name}: {', '.join(done)}", markup=False, soft_wrap=True)


def fill(folder: Path, page: Path) -> list[str]:
    """Write the cases of a folder into a page; return their names.

    Raises
    ------
    ValueError
        If there is nothing to write, a file is not what --out writes, or the page has no place for a case.
    """
    found = {name: folder / f"{name}.json" for name in CASES if (folder / f"{name}.json").exists()}
    if not found:
        raise ValueError(f"{folder} holds no figures; write some with: python -m benchmarks --out {folder}")
    tables = {name: markdown(read(path)) for name, path in found.items()}
    text = page.read_text(encoding="utf-8")
    for name, lines in tables.items():
        text = replaced(text, f"case: {name}", f"\n{lines}\n", page.name)
    if set(_SHORT) <= set(found):
        figures = {name: read(found[name]) for name in _SHORT}
        text = replaced(text, "case: short", in_short(figures), page.name)
    for name in found:
        if (folder / f"{name}.png").exists():
            images = page.parent / "images"
            images.mkdir(exist_ok=True)
            shutil.copyfile(folder / f"{name}.png", images / f"performance-{name}.png")
    write_text(page, text)
    return list(found)


_SHORT = ("batch", "train", "jam", "cold")


def in_short(results: dict[str, Result]) -> str:
    """Return the summary: agent-steps of batches, samples of training, a large jam, and the first step."""
    # Rows of other programs, and ratios to them, name a peer.
    ours = {row["what"]: row["value"] for case in _SHORT for row in results[case]["rows"] if row["peer"] is None}
    batches = [what.removesuffix(": agent-steps").split(", ") for what in ours if what.endswith(": agent-steps")]
    schemes, sizes = (list(dict.fromkeys(names)) for names in zip(*batches, strict=True))
    cells = [
        [f"batch of {size}", *(number(ours[f"{scheme}, {size}: agent-steps"]) for scheme in schemes)] for size in sizes
    ]
    training = next(row for row in results["train"]["rows"] if row["ratio"] is not None)
    who = training["what"].partition(":")[0]
    jams = [what for what in ours if what.startswith("dem ") and what.endswith(" people: CPU time")]
    people = max(int(what.split(", ")[1].split()[0]) for what in jams)
    costs = [f"{number(ours[what])} with steps of {what.split()[1]} s" for what in jams if f" {people} people" in what]
    scheme = results["cold"]["rows"][0]["what"].partition(":")[0]
    return markdown_table(["agent-steps per CPU s", *(f"`{name}`" for name in schemes)], cells) + (
        f"\nTraining with stable-baselines3 ({who}): {number(training['value'])} samples of people who were inside per CPU "
        f"second, {100.0 * training['ratio']:.0f} % of what the same PPO reaches on an environment that does nothing; "
        f"{100.0 * ours[f'{who}: environment']:.0f} % of the time goes to the environment. {people} people in a jam under "
        f"`dem`, CPU seconds per simulated second: {', '.join(costs)}. From nothing to the first step of `{scheme}`: "
        f"{ours[f'{scheme}: whole process, empty cache']:.0f} CPU s with an empty kernel cache, "
        f"{ours[f'{scheme}: whole process, filled cache']:.1f} CPU s afterwards, import included.\n"
    )


def read(path: Path) -> dict[str, Any]:
    """Return the figures of a file.

    Raises
    ------
    ValueError
        If it does not hold what --out writes.
    """
    try:
        result = read_json(path)
        for row in result["rows"]:
            if set(row) != {"what", "value", "unit", "peer", "ratio"}:
                raise ValueError(f"row {row}")
        return dict(result)
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} does not hold the figures of a case ({error})") from None


def markdown(result: dict[str, Any]) -> str:
    """Return the tables of a case, and under them the machine and its load."""
    return "\n".join(_table(grid) if any(grid.head) else _list(grid) for grid in grids(result))


def _table(grid: Grid) -> str:
    head = [cell.removesuffix(", 1").replace(", ", "<br>") for cell in grid.head]
    return markdown_table(head, grid.lines, numbers=True) + "".join(f"\n{line}\n" for line in grid.legend)


def _list(grid: Grid) -> str:
    return "; ".join(" ".join(line) for line in grid.lines) + ".\n"


if __name__ == "__main__":
    typer.run(run)
