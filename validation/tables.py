"""The cells, and the sentences below, of the tables that `validation.pages` writes: figures from commands and finished runs.

``source(LINE)`` is what ``python -m LINE --json`` prints; ``source.read(FILE)`` is a file of the folder that --from names.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from crowd_env import SCHEMES

if TYPE_CHECKING:
    from validation.pages import Sources

Cells = list[list[str]]

_PRINTED_FLOWS = {"dem": 3.04, "nsm1": 4.65, "nsm2-printed": 2.60}  # 1/s, Table 5 of Pécol et al. 2011
STRATEGY_SCHEMES = ("dem", "nsm1", "nsm2", "nsm2-printed", "hertz")
SCENARIO_SCHEMES = ("dem", "nsm1", "nsm2", "nsm2-printed")


def _spread(found: dict[str, Any] | None, digits: int) -> str:
    return "–" if not found or found["mean"] is None else f"{found['mean']:.{digits}f} ± {found['sd']:.{digits}f}"


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def _interval(found: dict[str, Any], digits: int) -> str:
    return f"{_signed(found['ci95'][0], digits)} to {_signed(found['ci95'][1], digits)}"


def _less(new: float, old: float) -> str:
    """Return the relative change in percent."""
    return f"{_signed(100.0 * (new / old - 1.0), 0)} %"


def _left(row: dict[str, Any]) -> str:
    if not row["unfinished"]:
        return "nobody"
    return f"{row['unfinished']} people in {row['unfinished_runs']} of {row['runs']} runs"


def _listed(parts: Iterable[str]) -> str:
    *most, last = parts
    return f"{', '.join(most)} and {last}" if most else last


# ------------------------------------------------------------------------------------------------------- contact schemes


def _room(source: "Sources", scheme: str, dt: float | None = None) -> dict[str, Any]:
    return source(f"crowd_env run room-v0 --scheme {scheme} --runs 50" + ("" if dt is None else f" --dt {dt:g}"))


def schemes(source: "Sources") -> Cells:
    """One row a scheme at its own step, and for three of them shorter steps."""
    shorter = {"dem": (0.001,), "nsm2": (0.005, 0.0025, 0.001), "nsm2-printed": (0.001,)}
    rows = []
    for scheme in SCHEMES:
        for dt in (None, *shorter.get(scheme, ())):
            found = _room(source, scheme, dt)
            overlap = found["overlap_mm"]
            rows.append(
                [
                    f"`{scheme}`",
                    f"{SCHEMES[scheme].info.default_dt if dt is None else dt:g}",
                    f"{overlap['mean']:.3g} / {overlap['max']:.3g}",
                    f"{found['outside_mm']:.3g}",
                    _spread(found["evacuation_time"], 2),
                    _spread(found["flow"], 2),
                    _left(found),
                    f"{found['max_speed']:.1f}",
                ]
            )
    return rows


def schemes_note(source: "Sources") -> str:
    """State the flows beside those of the paper."""
    beside = []
    for scheme, printed in _PRINTED_FLOWS.items():
        flow = _room(source, scheme)["flow"]["mean"]
        beside.append(f"{printed:.2f} for `{scheme}` (here {flow:.2f}, {_less(flow, printed)})")
    return f"Table 5 of the first paper prints flows of {_listed(beside)}."


def halls(source: "Sources") -> Cells:
    """One row a scheme: how many were outside of the plan, and the largest speed in the halls of each size."""
    found = [row for case in ("halls", "great-halls") for row in source.rows(case)]
    rows = []
    for scheme in dict.fromkeys(row["scheme"] for row in found):
        figures = [row["more"] for row in found if row["scheme"] == scheme]
        sizes = dict.fromkeys(figure["people"] for figure in figures)
        fastest = [max(one["fastest, m/s"] for one in figures if one["people"] == people) for people in sizes]
        outside = sum(figure["outside"] for figure in figures)
        overlap = max(figure["overlap, mm"] for figure in figures)
        speeds = (f"{speed:.1f}" for speed in fastest)
        rows.append([f"`{scheme}`", "nobody" if not outside else str(outside), *speeds, f"{overlap:.3g}"])
    return rows


def jambs(source: "Sources") -> Cells:
    """One row a scheme and manner: of how many draws the door was stuck, door by door and radius by radius."""
    rows: dict[tuple[str, str], list[str]] = {}
    for row in source.rows("jambs"):
        stuck = [str(value) for name, value in row["more"].items() if name.startswith("stuck")]
        rows.setdefault((row["scheme"], row["manner"]), []).append(", ".join(stuck))
    return [[f"`{scheme}`", manner, *cells] for (scheme, manner), cells in rows.items()]


# -------------------------------------------------------------------------------------------------------------- clogging

_CLOGGING_SPEEDS = ("1.0", "1.5", "1.8")


def _clogged(source: "Sources", speed: str) -> dict[str, Any]:
    (found,) = source(f"crowd_env clogging --speed {speed} --n 200 --runs 10")["sets"]
    return dict(found)


def clogging(source: "Sources") -> Cells:
    """One row a desired speed."""
    rows = []
    for speed in _CLOGGING_SPEEDS:
        found = _clogged(source, speed)
        gaps, tail = found["gaps"], found["tail"]
        cells = ["–"] * 3
        if tail is not None:
            later = tail["alpha_open"]
            cells = [
                f"{tail['alpha']:.2f} ± {tail['error']:.2f}",
                "–" if later is None else f"{later:.2f}",
                f"{_signed(tail['ratio'], 1)} (p = {tail['p']:.2g})",
            ]
        low, high = (100.0 * bound for bound in found["blocked_share"]["ci95"])
        blocked = f"{found['blocked_runs']} of {found['runs']} ({low:.0f} to {high:.0f} %)"
        rows.append([speed, str(gaps["count"]), f"{gaps['mean']:.2f}", f"{gaps['cv']:.2f}", *cells, blocked])
    return rows


def clogging_note(source: "Sources") -> str:
    """Say at which speeds the tail is told apart from an exponential."""
    tails = {speed: _clogged(source, speed)["tail"] for speed in _CLOGGING_SPEEDS}
    told = [
        f"{speed} m/s" for speed, tail in tails.items() if tail is not None and tail["p"] < 0.05 and tail["ratio"] > 0
    ]
    if not told:
        return "At none of these speeds is the tail told apart from an exponential (p < 0.05)."
    return f"The tail is told apart from an exponential (p < 0.05) at {_listed(told)}, at no other of these speeds."


def forces_note(source: "Sources") -> str:
    """Say since when the exit of the picture is blocked, and how many push."""
    (blocked,) = source("crowd_env run lin-room-v0 --scheme hertz --speed 2 --n 200 --runs 1")["blocked"]
    return f"The exit is blocked since {blocked['since']:.0f} s, with {blocked['left']} people inside."


# ---------------------------------------------------------------------------------------------------------------- routes


def _evaluated(source: "Sources") -> dict[tuple[str, str], dict[str, Any]]:
    """Return (strategy, scheme) -> its row."""
    names = ("shortest", "fastest", "comfortable", "nearest")
    found = source(
        f"crowd_env.cli.agents.evaluate --scenario two-exit-hall-v0 --policies {' '.join(names)} "
        f"--physics {' '.join(STRATEGY_SCHEMES)} --runs 20"
    )
    return {(row["policy"], row["scheme"]): row for row in found["rows"]}


def strategies(source: "Sources") -> Cells:
    """One row a strategy, one column a scheme."""
    by = _evaluated(source)
    names = dict.fromkeys(name for name, _ in by)
    return [[name, *(_beside_first(by[name, scheme]) for scheme in STRATEGY_SCHEMES)] for name in names]


def _beside_first(row: dict[str, Any]) -> str:
    """Return the time of the last person, who was left inside, and the interval of the difference to the first policy."""
    text = f"{'≥ ' if row['unfinished'] else ''}{row['unfinished_at_limit']['last']:.1f}"
    if row["minus_first"]["policy"] != row["policy"]:
        text += f" ({_interval(row['minus_first']['evacuation_time'], 1)})"
    return text if not row["unfinished"] else f"{text}; left inside: {_left(row)}"


def strategies_note(source: "Sources") -> str:
    """Say how the fastest way parts the crowd, how often it is faster, and what it costs."""
    fastest = {scheme: _evaluated(source)["fastest", scheme] for scheme in STRATEGY_SCHEMES}
    parted, faster = [], []
    for scheme, row in fastest.items():
        people = [exit["people"]["mean"] for exit in row["exits"].values()]
        shares = "/".join(f"{100.0 * count / sum(people):.0f}" for count in people)
        parted.append(f"{shares} under `{scheme}`")
        faster.append(f"{100.0 * row['minus_first']['evacuation_time']['faster']:.0f} % (`{scheme}`)")
    dem = fastest["dem"]
    return (
        f"The fastest way parts those who get out {_listed(parted)}. It lets the last person out sooner than the shortest way "
        f"in {_listed(faster)} of the draws. To find it takes {1e3 * dem['replanning_per_simulated_second']:.1f} ms of "
        "processor time per simulated second and environment, the physics of `dem` "
        f"{1e3 * dem['physics_per_simulated_second']:.1f} ms."
    )


def controller(source: "Sources") -> Cells:
    """One row a controller of Routing-v0, the learned one last."""
    rows = []
    for row in source.read("results.json")["rows"]:
        bound = "≥ " if row["unfinished"] else ""
        beside = row.get("learned_minus_this", {}).get("last")
        rows.append(
            [
                row["controller"],
                f"{bound}{row['last']['mean']:.1f}",
                "" if beside is None else f"{_signed(beside['mean'], 1)} ({_interval(beside, 1)})",
                f"{bound}{row['mean']['mean']:.1f}",
                _left(row),
            ]
        )
    return rows


def controller_note(source: "Sources") -> str:
    """Say how the controller was trained and chosen, and how much sooner the last person is out."""
    found = source.read("results.json")
    config, best = found["config"], found["best"]
    rows = {row["controller"]: row for row in found["rows"]}
    sooner = [
        f"{_less(rows['learned']['last']['mean'], row['last']['mean'])} beside {name}"
        for name, row in rows.items()
        if name != "learned"
    ]
    return (
        f"{rows['learned']['runs']} held-out draws of `{config['scenario']}` under `{config['scheme']}`; one seed, at most "
        f"{config['steps']} decisions. The time of the last person changes by {_listed(sooner)}. The controller that is kept "
        f"was the best after {best['steps']:.0f} decisions; in the {best['runs']:.0f} validation draws that it was chosen by "
        f"{best['unfinished']:.0f} people were left inside."
    )


# -------------------------------------------------------------------------------------------------------------- training


def tasks(source: "Sources") -> Cells:
    """One row a task, as it is registered."""
    from crowd_env.agents.tasks import TASKS

    rows = []
    for task in TASKS.values():
        options = ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in task.options.items())
        rows.append(
            [
                f"`{task.name}`{' (no harm)' if task.no_harm else ''}",
                task.about,
                f"`{task.scenario}`: {options}",
                str(task.people),
                f"`{task.scheme}`, {task.dt:g} s",
                f"{task.rule}, {task.manner}",
                f"{task.time_limit:g} / {task.blocked_after:g} s",
                str(task.runs),
                task.decides,
                str(task.version),
            ]
        )
    return rows


# ------------------------------------------------------------------------------------------------------------ scenarios


def scenarios(source: "Sources") -> Cells:
    """One row a scenario in which arches hold, one column a scheme: 100 runs each."""
    rows = []
    for name in ("two-exit-hall-v0", "pillar-v0"):
        found = [source(f"crowd_env run {name} --scheme {scheme} --runs 100") for scheme in SCENARIO_SCHEMES]
        rows.append([f"`{name}`", *("none" if not row["unfinished_runs"] else _left(row) for row in found)])
    return rows


def foyer_note(source: "Sources") -> str:
    """Say what the command that the page shows prints."""
    found = source("crowd_env run examples/foyer.wkt --exit 14,4.5,14,6 --n 40 --runs 20")
    return (
        f"The second command prints a table: the last person is out after {_spread(found['evacuation_time'], 2)} s (mean ± "
        f"standard deviation of the runs), {_spread(found['flow'], 2)} people a second leave, left inside: {_left(found)}, "
        f"bodies overlap by at most {found['overlap_mm']['max']:.1f} mm, nobody is faster than {found['max_speed']:.1f} m/s."
    )
