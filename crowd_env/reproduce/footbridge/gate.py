"""A gatekeeper of the footbridge: what rules of ``crowd_env/footbridge-gate-v0`` earn that hold people back at the entrance."""

from collections.abc import Callable, Mapping

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.footbridge.env import FootbridgeEnv
from crowd_env.rendering.canvas import new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.footbridge.settings import FootbridgeSettings
from crowd_env.reproduce.result import RawTable, Result, mean_row

PEOPLE = 700
_MOST, _SWAY = 250, 0.25  # people on the deck, a sixth below the threshold; the term amplitude at 5 mm

Rule = Callable[[np.ndarray, FootbridgeEnv], bool]
RULES: Mapping[str, Rule] = {
    "open": lambda seen, env: True,
    "count": lambda seen, env: float(seen[env.layout["people"]][0]) * env.people < _MOST,
    "amplitude": lambda seen, env: float(seen[env.layout["amplitude"]][0]) < _SWAY,
}
COLUMNS = ("throughput", "discomfort", "reward", "amplitude", "people")


def keep(rule: Rule, env: FootbridgeEnv, seed: int) -> Floats:
    """Return the `COLUMNS` (T, 5) of every decision: people out, s, 1, m, people on the deck."""
    seen, _ = env.reset(seed=seed)
    moments, over = [], False
    while not over:
        seen, reward, _, over, info = env.step(int(rule(seen, env)))
        on_deck = float(seen[env.layout["people"]][0]) * env.people
        moments.append((info["reward/throughput"], -info["reward/discomfort"], reward, info["amplitude"], on_deck))
    return np.array(moments)


def reproduce(settings: FootbridgeSettings) -> Result:
    """Return what each rule earns."""
    env = FootbridgeEnv(settings.people, physics=settings.physics, time_limit=settings.duration)
    seeds = settings.seeds
    found = {name: np.array([keep(rule, env, seed) for seed in seeds]) for name, rule in RULES.items()}
    sections = []
    for name, moments in found.items():
        minutes, late = moments.shape[1] / 60.0, moments[:, -max(moments.shape[1] // 4, 1) :]
        per_minute = moments[..., :3].sum(axis=1) / minutes
        sway, most = 1000.0 * late[..., 3].mean(axis=1), 1000.0 * moments[..., 3].max(axis=1)
        figures = {
            "people across": (per_minute[:, 0], "1/min", "who reach the far end"),
            "discomfort": (per_minute[:, 1], "s/min", "time on the deck, 1 at 0.8 m/s2"),
            "reward": (per_minute[:, 2], "1/min", f"people across less {env.weight:g} /s of discomfort"),
            "amplitude": (sway, "mm", "last quarter"),
            "largest amplitude": (most, "mm", "of each run, mean of runs"),
            "people on the deck": (late[..., 4].mean(axis=1), "people", "last quarter"),
        }
        sections.append([mean_row(f"{name}: {what}", *of_runs, interval=False) for what, of_runs in figures.items()])
    table = RawTable(
        ("rule", "seed", "decision", "across", "discomfort_s", "reward", "amplitude_m", "on_deck"),
        [
            (name, seed, k, int(out), f"{bad:.4f}", f"{reward:.4f}", f"{sway:.6f}", round(people))
            for name, moments in found.items()
            for seed, run in zip(seeds, moments, strict=True)
            for k, (out, bad, reward, sway, people) in enumerate(run)
        ],
    )
    remarks = [
        f"{settings.people} people before and on the deck, who come back behind those who wait. count lets people on while "
        f"fewer than {_MOST} are on the deck, amplitude while the deck moves by less than 5 mm; open always.",
        "Who is let on stays for 50 s: amplitude closes too late, and the deck sways again and again.",
    ]
    return Result(sections, {"decisions": table}, lambda: draw(found), remarks)


def draw(found: Mapping[str, Floats]) -> Figure:
    """Return a drawing of the first run under each rule: amplitude above, people on the deck below."""
    figure = new_figure((9.0, 5.0))
    above, below = figure.subplots(2, 1, sharex=True)
    quiet_axes(above, "", "amplitude [mm]", grid=True)
    quiet_axes(below, "time [s]", "people on the deck", grid=True)
    for k, (name, moments) in enumerate(found.items()):
        above.plot(1000.0 * moments[0, :, 3], color=series(k), lw=1.4, label=name)
        below.plot(moments[0, :, 4], color=series(k), lw=1.4)
    above.legend(frameon=False, fontsize=9)
    return figure
