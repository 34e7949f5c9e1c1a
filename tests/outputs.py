"""Outputs as the pages show them, beside those that the commands print."""

import re

from shown import Command

WIDTH = "100"  # characters of a line in the pages
# Words of commands whose figures hang on how many runs were drawn, and tests draw few.
DRAWN = ("fig3", "table5", "lin-fig4")


def compare(command: Command, printed: str) -> None:
    """Check that a command prints what is shown below it: each line, "..." standing for some that are left out.

    Of figures from many draws only what does not hang on them: title, head, and what stands in which row of which paper.
    """
    if set(DRAWN) & set(command.words):
        shown, found = _fixed(command.output), _fixed(printed)
        assert shown["head"] == found["head"]
        assert shown["rows"], "a table without a row"
        assert set(shown["rows"]) <= set(found["rows"])
        return
    lines = [line.rstrip() for line in printed.splitlines()]
    at = 0
    for part in re.split(r"^ *\.\.\. *\n", command.output, flags=re.MULTILINE):
        block = [line.rstrip() for line in part.strip("\n").splitlines()]
        starts = [k for k in range(at, len(lines)) if lines[k : k + len(block)] == block]
        assert starts, f"{command.line} does not print\n" + "\n".join(block) + "\nbut\n" + printed
        at = starts[0] + len(block)


def _fixed(text: str) -> dict[str, list]:
    """Return the title with the names of the columns, and of each row its quantity and the figure of the paper."""
    lines = text.splitlines()
    rule = next(k for k, line in enumerate(lines) if line.strip().startswith("──"))
    notes = next(k for k, line in enumerate(lines) if line.startswith("*"))
    rows = [re.split(r"\s{2,}", line.strip()) for line in lines[rule + 1 : notes]]
    head = [word for line in lines[:rule] for word in line.split()]
    return {"head": head, "rows": [tuple(row[:2]) for row in rows if len(row) > 3]}
