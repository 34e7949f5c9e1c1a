"""The command ``python -m validation``."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.status import Status
from rich.table import Table

from crowd_env import SCHEMES, Uniform, make_scheme
from crowd_env.files.atomic import write_text
from validation.bits import ROOT, chosen, report
from validation.bits_scenes import scenes
from validation.gate import REFERENCE, export, gate_scenario, recorded, recorded_speed, simulated
from validation.halls import HALLS, empty, holds, told
from validation.pages import TABLES, fill, run
from validation.positions import STORED, write
from validation.trajectories import find_recording, read_trajectories

app = typer.Typer(
    help="Is it true: simulations beside recorded experiments, crowded halls, and another commit.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_notes = Console(stderr=True, highlight=False)


@app.callback()
def _about() -> None:
    """Is it true: simulations beside recorded experiments, crowded halls, and another commit."""


@contextmanager
def _said_plainly() -> Iterator[None]:
    """Turn a user's mistake into one line and exit code 2."""
    try:
        yield
    except (ValueError, FloatingPointError) as error:
        _notes.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(2) from None


def _speeds(text: str | None) -> Uniform | None:
    if text is None:
        return None
    try:
        bounds = [float(part) for part in text.split(",")]
    except ValueError:
        bounds = []
    if len(bounds) not in (1, 2):
        raise ValueError(f"--speed is {text!r}; it must be one number or two separated by a comma, such as 1.2,2")
    return Uniform(bounds[0], bounds[-1])


@app.command()
def gate(
    data: Annotated[Path, typer.Option(help="Folder with the trajectory file of run 040_c_56_h- (.txt or .txt.gz).")],
    scheme: Annotated[
        list[str] | None, typer.Option(help="Contact scheme; may be repeated; default dem, nsm1, nsm2.")
    ] = None,
    runs: Annotated[
        int, typer.Option(help="Runs per scheme, each with other masses, speeds and relaxation times.", min=1)
    ] = 10,
    seed: Annotated[int, typer.Option(help="Run k draws from seed + k.", min=0)] = 0,
    radius: Annotated[
        float | None, typer.Option(help="Body radius in m; default the largest that the positions allow.")
    ] = None,
    speed: Annotated[
        str | None, typer.Option(help="Desired speed in m/s, one number or a range; default 1.2,2.")
    ] = None,
    time_limit: Annotated[float, typer.Option(help="Whoever is inside after so many seconds is unfinished.")] = 300.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for gate.json and gate.png.")] = None,
    export_to: Annotated[
        Path | None, typer.Option("--export", help="Only write gate.wkt and starts.csv there, and print the command.")
    ] = None,
) -> None:
    """75 students leave through a gate of 0.5 m: N(t) recorded and simulated.

    Data: DOI 10.34735/ped.2018.1, run 040_c_56_h-.
    """
    with _said_plainly():
        trajectories = read_trajectories(find_recording(data))
        starts = trajectories.starts
        place = gate_scenario(starts, radius, _speeds(speed), time_limit)
        size = place.population.radius.high
        if export_to is not None:
            typer.echo(export(export_to, starts, size))
            return
        names = scheme or ["dem", "nsm1", "nsm2"]
        for name in names:
            make_scheme(name)
        measured, results = recorded(trajectories), []
        for name in names:
            with _notes.status(f"{name} ..."):
                results.append(simulated(place, name, runs, seed))
    rows = [counts.row() for counts in [measured, *results]]
    speeds = place.population.desired_speed
    report: dict[str, Any] = {
        "case": "gate",
        "reference": REFERENCE,
        "people": len(starts),
        "radius_m": size,
        "desired_speed": [speeds.low, speeds.high],
        "recorded_gate_speed": recorded_speed(trajectories),
        "rows": rows,
    }
    if out is not None:
        from validation.gate_figure import draw

        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "gate.json", json.dumps(report, indent=2) + "\n")
        draw(out / "gate.png", measured, results, starts, size, f"desired speed {speeds.low:g} to {speeds.high:g} m/s")
        _notes.print(f"figures: {out}/", markup=False)
    if as_json:
        typer.echo(json.dumps(report))
        return
    Console().print(_table(report))


@app.command()
def halls(
    scheme: Annotated[
        list[str] | None, typer.Option(help="Contact scheme; may be repeated; default all but nsm2-printed.")
    ] = None,
    people: Annotated[int | None, typer.Option(help="Only the halls of so many people.")] = None,
    time_limit: Annotated[float, typer.Option(help="A run ends after so many simulated seconds.", min=0.1)] = 3600.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """Crowded halls emptied by one door: nobody is ever through a wall, or faster than a person can be.

    500 to 5000 people at 2 to 4 /m2, doors of 0.8 to 4 m, until all are out or the door is blocked; exit code 1 if it does
    not hold.
    """
    with _said_plainly():
        names = scheme or [name for name in SCHEMES if name != "nsm2-printed"]
        for name in names:
            make_scheme(name)
        chosen = [hall for hall in HALLS if people in (None, hall.people)]
        if not chosen:
            known = sorted({hall.people for hall in HALLS})
            raise ValueError(f"there is no hall of {people} people; there are halls of {', '.join(map(str, known))}")
        rows = []
        for name in names:
            for hall in chosen:
                title = f"{name}, {hall.people} people, {hall.density:g} /m2, door {hall.door:g} m"
                with _notes.status(f"{title} ...") as status:

                    def show(time: float, title: str = title, status: Status = status) -> None:
                        status.update(f"{title}: {time:.1f} s simulated")

                    rows.append(empty(hall, name, time_limit, show))
                _notes.print(f"{title}: {told(rows[-1])}", markup=False, soft_wrap=True)
    sound = all(holds(row) for row in rows)
    if as_json:
        typer.echo(json.dumps({"case": "halls", "holds": sound, "rows": rows}))
    else:
        Console().print(_hall_table(rows))
    raise typer.Exit(0 if sound else 1)


@app.command()
def bits(
    against: Annotated[str, typer.Option(help="Commit, branch or tag to compare the working tree with.")] = "HEAD",
    case: Annotated[
        list[str] | None, typer.Option(help="Scene such as doors/nsm2, or a group such as doors; may be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    write_positions: Annotated[
        bool,
        typer.Option("--write-positions", help=f"Only store {STORED.relative_to(ROOT)} anew, and compare nothing."),
    ] = False,
) -> None:
    """Does a change of the program change a bit of what it computes?  Exit code 1 if it does.

    Every contact scheme in rooms, crowds, doors and batches, and all interfaces, run in the working tree (with what is not
    committed) and as another commit has them.  Both run on this machine, since bits differ between processors.  About a minute,
    and a few more while kernels are compiled.

    What other machines can check are positions after a few steps, to 1e-9 m, against those that --write-positions stores: write
    them anew where a change of the physics is meant.

    Examples:  python -m validation bits;  python -m validation bits --against main --case room --case doors/nsm2
    """
    if write_positions:
        write(STORED)
        _notes.print(f"positions: {STORED}", markup=False, soft_wrap=True)
        return
    with _said_plainly():
        names = chosen(list(scenes()), case or [])
        at = {"here": "starting", against: "starting"}
        with _notes.status("compiling kernels ...") as status:

            def show(side: str, count: int, name: str) -> None:
                at[side] = f"{count} of {len(names)} scenes ({name})"
                status.update("; ".join(f"{side}: {reached}" for side, reached in at.items()))

            found = report(against, names, show)
    if as_json:
        typer.echo(json.dumps(found))
    else:
        Console().print(_bits_table(found))
    raise typer.Exit(0 if found["equal"] else 1)


def _bits_table(found: dict[str, Any]) -> Table:
    count = sum(row["equal"] is False for row in found["rows"])
    caption = f"{count} of {len(found['rows'])} scenes differ" if count else "no scene differs"
    table = Table(
        title=f"working tree and commit {found['against'][:12]}",
        caption=caption,
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for name in ("scene", "bits", "digest", ""):
        table.add_column(name)
    for row in found["rows"]:
        result = {True: "equal", False: "DIFFERENT", None: "not compared"}[row["equal"]]
        table.add_row(row["scene"], result, row["digest"] or "", escape(_bits_note(row)))
    return table


def _bits_note(row: dict[str, Any]) -> str:
    parts = [row["note"]] if row["note"] else []
    if row["first_step"] is not None:
        more = f" and {len(row['fields']) - 3} more" if len(row["fields"]) > 3 else ""
        parts.append(f"from step {row['first_step']}: {', '.join(row['fields'][:3])}{more}")
    for text, fields in (("only here", row["only_here"]), ("only there", row["only_there"])):
        if fields:
            parts.append(f"{text}: {', '.join(fields)}")
    if row["renamed"]:
        parts.append("renamed: " + ", ".join(f"{old} to {new}" for old, new in row["renamed"].items()))
    return "; ".join(parts)


def _hall_table(rows: list[dict[str, Any]]) -> Table:
    caption = (
        "outside: most people outside of the plan at once, by position; fastest: after any step; deepest overlap of two "
        "bodies, and of a body with a wall; left: at the end, when all are out or nobody was for 30 s"
    )
    table = Table(title="halls emptied by one door", caption=caption, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    names = ("people", "1/m2", "door\nm", "outside", "fastest\nm/s", "overlap\nmm", "wall\nmm", "left", "until\ns")
    table.add_column("")
    for name in names:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            row["scheme"],
            str(row["people"]),
            f"{row['density']:g}",
            f"{row['door']:g}",
            str(max(row["outside_at_once"], row["escaped"])),
            f"{row['max_speed']:.2f}" + ("*" if row["stopped"] else ""),
            f"{row['overlap_mm']:.0f}",
            f"{row['wall_mm']:.0f}",
            str(row["left"]),
            f"{row['until']:.0f}",
        )
    for row in rows:
        if row["stopped"]:
            table.caption = f"{table.caption}. * {row['stopped']}"
    return table


def _table(report: dict[str, Any]) -> Table:
    speeds = report["desired_speed"]
    table = Table(
        title=f"gate: {report['people']} people, radius {report['radius_m']:g} m, "
        f"desired speed {speeds[0]:g} to {speeds[1]:g} m/s",
        caption="when the k-th person passes the end of the gate, mean over runs; flow: least-squares slope, "
        f"mean ± sd over the runs that did not get stuck; recorded speed in the gate {report['recorded_gate_speed']:.2f} m/s",
    )
    table.add_column("")
    rows = report["rows"]
    counted = list(rows[0]["time_of_person"])
    for k in counted:
        table.add_column(f"{k}th\ns", justify="right")
    for name in ("flow\n1/s", "stuck\nruns", "left\ninside", "overlap\nmm", "fastest\nm/s", "outside\nplan"):
        table.add_column(name, justify="right")
    for row in rows:
        times = [row["time_of_person"][k]["mean"] for k in counted]
        table.add_row(
            row["name"],
            *("-" if time is None else f"{time:.1f}" for time in times),
            _with_sd(row["flow"]),
            f"{row['unfinished_runs']} of {row['runs']}",
            str(row["unfinished"]),
            *(
                ("-", "-", "-")
                if row["name"] == "recorded"
                else (f"{row['overlap_mm']:.1f}", f"{row['max_speed']:.2f}", str(row["escaped"]))
            ),
        )
    return table


def _with_sd(value: dict[str, float | None]) -> str:
    if value["mean"] is None:
        return "-"
    return f"{value['mean']:.2f}" + ("" if value["sd"] is None else f" ± {value['sd']:.2f}")


@app.command()
def pages(
    names: Annotated[list[str] | None, typer.Argument(help=f"Tables: {', '.join(TABLES)}; default all.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print which pages were written, as JSON.")] = False,
) -> None:
    """Make the tables of measured figures in docs/ anew: half an hour for all, the text around them is yours to mend.

    Example: python -m validation pages clogging strategies
    """
    with _said_plainly():
        for name in names or ():
            if name not in TABLES:
                raise ValueError(f"unknown table {name!r}; known: {', '.join(TABLES)}")
        written: dict[str, str] = {}
        for name in names or TABLES:
            with _notes.status(f"{name} ...") as status:

                def command(line: str, name: str = name, status: Status = status) -> dict[str, Any]:
                    status.update(f"{name}: python -m {line}")
                    return run(line)

                written[name] = fill(name, command).name
        typer.echo(json.dumps(written) if as_json else "\n".join(f"{name}: {page}" for name, page in written.items()))


def main() -> None:
    """Run the command line."""
    app()
