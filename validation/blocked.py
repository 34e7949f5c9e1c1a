"""The table of faster is frozen in docs/clogging.md: shares of blocked draws with their intervals, and the onset."""

from typing import TYPE_CHECKING

from validation.cases.frozen import SPEEDS

if TYPE_CHECKING:
    from validation.pages import Sources

Cells = list[list[str]]

HEAD = (
    "friction of people",
    "A, N",
    "φ",
    "v*, m/s",
    *(f"blocked at {times:g} v*" for times in SPEEDS),
    "half block at",
)


def _share(count: float, of: float, low: float, high: float) -> str:
    """Return "2 of 10 (6 to 51 %)"."""
    return f"{count:.0f} of {of:.0f} ({100 * low:.0f} to {100 * high:.0f} %)"


def frozen(source: "Sources") -> Cells:
    """One row a variant of Lin's room: how many draws block at each multiple of v*, and where half of them do."""
    rows = []
    for row in source.rows("frozen"):
        figure, cells = row["more"], []
        for times in SPEEDS:
            name = f"blocked at {times:g} v*"
            cells.append(_share(figure[name], figure["draws"], figure[f"{name}, least share"], figure[f"{name}, most"]))
        half, speed = figure["half block at, v*"], figure["half block at, m/s"]
        onset = "–" if half is None else f"{half:.2f} v* = {speed:.2f} m/s"
        varied = [f"{figure[name]:g}" for name in ("friction", "A, N", "phi")]
        rows.append([*varied, f"{figure['v*, m/s']:.2f}", *cells, onset])
    return rows


def frozen_note(source: "Sources") -> str:
    """Say within which band the onset lies, over frictions and over social forces."""
    figures = [row["more"] for row in source.rows("frozen")]
    usual = figures[0]
    bands = []
    for what, some in (
        (
            "frictions from 0 to 1",
            [one for one in figures if (one["A, N"], one["phi"]) == (usual["A, N"], usual["phi"])],
        ),
        ("social forces", [one for one in figures if one["friction"] == usual["friction"]]),
    ):
        known = [one["half block at, v*"] for one in some if one["half block at, v*"] is not None]
        missing = len(some) - len(known)
        band = f"{min(known):.2f} to {max(known):.2f} v*" if known else "none found"
        bands.append(f"{band} over all {what}" + (f" ({missing} beyond the speeds of the table)" if missing else ""))
    return f"Half of the draws block at {' and '.join(bands)}; shares of blocked draws with Wilson's 95 % interval."
