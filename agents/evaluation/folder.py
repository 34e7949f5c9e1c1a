"""The folder of an evaluation: the result of each policy and scheme is kept as soon as it is known."""

import functools
import inspect
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from urllib.parse import quote

import numpy as np

import crowd_env
from crowd_env import EpisodeMetrics, Physics, Scenario
from crowd_env.analysis.results.measurements import CELL, Grid, Maps, Measured, RunMeasurements
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.files.csv_table import write_csv
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.files.store import Store
from crowd_env.envs.tasks.task import Task
from crowd_env.physics import ContactScheme
from crowd_env.physics.settings import AsPhysics

from .. import PRETRAINED
from ..networks import network_digest
from ..plain import Plain
from ..runs import versions
from ..trained import names_file
from .comparison import by_scheme, clearing_times
from .entries import Entry
from .evaluation import Evaluation, pressure_is_force

_KEPT = "kept"  # folder below
_SETTINGS = "evaluation.json"
# What the folder comes to hold, and what says that it is one of ``crowd-env run`` or of a training.
_OWNED = ("rows.json", "runs.csv", "egress-*.png", "heat-*.png", _KEPT, "config.json")
_SHOWN = {"density": ("Density", "people / m²", 1.0), "pressure": ("Contact pressure", "kN / m", 1e-3)}
_PRESSURE = {
    True: "Pressure: contact force on the person there over circumference, 0 while nobody is there.",
    False: "This scheme knows no forces: its pressure is what keeps bodies apart.",
}
_CURVES = 5  # in one figure, as many as there are colors
_ARRAYS = RunMeasurements._fields
_NUMBERS = ("simulated", "computing", "replanning")


def settings_of(
    scenario: Scenario, runs: int, seed: int, task: Task | None = None, learned_share: float | None = None
) -> Plain:
    """Return the settings that all results of a folder share; the digest is of everything in a scenario that can matter."""
    held = {field.name: getattr(scenario, field.name) for field in fields(scenario)}
    for name in ("name", "title", "reference", *([] if scenario.apron else ["apron"])):
        del held[name]
    headway, outline = scenario.behavior(Headway), scenario.behavior(Outline)
    held |= {"manner": headway, "outline": outline}
    facts: dict[str, object] = {} if task is None else {"task": task.identity()}
    facts |= {"scenario": scenario.name, "manner": Headway.plain_of(headway), "outline": Outline.plain_of(outline)}
    if learned_share is not None:
        facts["learned_share"] = learned_share
    return {**facts, "digest": fingerprint(held), "runs": runs, "seed": seed}


def _made_by(entry: Entry, physics: Physics) -> Plain:
    """Return what else a result depends on: the network, the physics with its parameters, and the code."""
    law = physics.law
    source = Path(inspect.getfile(type(law))).read_bytes()  # of the user's own scheme too
    facts = {"network": entry.digest, "scheme": fingerprint(law, source), "dt": law.info.default_dt}
    own = (one for one in fields(physics) if one.name not in ("scheme", "threads"))
    changed = {one.name: value for one in own if (value := getattr(physics, one.name)) != one.default}
    facts |= {"physics": fingerprint(changed)} if changed else {}
    return {**facts, "code": source_stamp(), "fields": list(EpisodeMetrics._fields)}


def _name(entry: Entry, law: ContactScheme) -> str:
    return f"{_KEPT}/{_plain(entry.name)}-{_plain(law.info.name)}"


def digest_of(policy: str) -> str | None:
    """Return the digest of the network that a policy of this name has, if it has one."""
    path = PRETRAINED.get(policy, Path(policy) if names_file(policy) else None)
    return None if path is None else network_digest(path)


@functools.cache
def source_stamp() -> str:
    """Return a hash of every source file of ``crowd_env`` and ``agents``, and of the versions of what they calculate with."""
    folders = Path(crowd_env.__file__).parent, Path(__file__).parents[1]
    sources = {
        path.relative_to(folder.parent).as_posix(): path.read_bytes()
        for folder in folders
        for path in folder.rglob("*.py")
    }
    return fingerprint(sources, versions())


class EvaluationFolder(Store):
    """Results of one scenario, one number of runs and one seed; policies and schemes may be added.

    Parameters
    ----------
    settings : of `settings_of`.

    Raises
    ------
    ValueError
        If the folder holds results with other settings, or of something else.
    """

    def __init__(self, folder: Path, settings: Plain) -> None:
        super().__init__(folder, settings, about=_SETTINGS, owned=_OWNED)

    def load_result(self, entry: Entry, physics: AsPhysics) -> Evaluation | None:
        """Return the kept result of a policy under some physics.

        None if there is nothing, if the result was made by another network, physics or code, or if the file is damaged.
        """
        part = Physics.of(physics)
        kept = self.load(_name(entry, part.law), _made_by(entry, part), redo=True)
        try:
            return None if kept is None else evaluation_of(entry.name, part.law.info.name, kept)
        except Exception:  # arrays of a damaged file, of other shapes
            return None

    def keep_result(self, entry: Entry, physics: AsPhysics, result: Evaluation) -> None:
        """Keep a result, whole or not at all."""
        part = Physics.of(physics)
        self.keep(_name(entry, part.law), content_of(result), _made_by(entry, part))

    def write_runs(self, results: Sequence[Evaluation], seed: int) -> None:
        """Write ``runs.csv``, one line a run."""
        exits = list(dict.fromkeys(results[0].exit_names))
        columns = ["last_time", "exit_time_95", *EpisodeMetrics._fields]
        columns += ["walked", "max_density", "max_pressure", "crushed", "crushed_time"]
        rows: list[list[object]] = []
        for result in results:
            assert result.measured is not None
            runs = result.columns() | {"last_time": clearing_times(result), "exit_time_95": result.exit_time_95()}
            names = np.array([*result.exit_names, ""])[result.measured.exit_index]
            for k, numbers in enumerate(zip(*(runs[name] for name in columns), strict=True)):
                by_exit = [int((names[k] == name).sum()) for name in exits]
                rows.append([result.policy, result.scheme, k, seed + k, *map(_text, numbers), *by_exit])
        head = ["policy", "scheme", "run", "seed", *columns, *(f"out by {name}" for name in exits)]
        write_csv(self.folder / "runs.csv", head, rows)

    def draw(self, results: Sequence[Evaluation], scenario: Scenario) -> list[Path]:
        """Draw the egress curves of each scheme and the maps of each policy under it; return the paths."""
        from crowd_env.rendering import egress_curves, save_figure

        made = []
        for scheme, those in by_scheme(results).items():
            title = f"{scenario.name}, {scheme}, {those[0].runs} runs"
            for k in range(1, max(len(those), 2), _CURVES - 1):  # the first policy in every figure
                curves = _curves([those[0], *those[k : k + _CURVES - 1]])
                number = "" if k == 1 else f"-{1 + k // (_CURVES - 1)}"
                path = self.folder / f"egress-{_plain(scheme)}{number}.png"
                made.append(save_figure(egress_curves(curves, title=title), path))
            made += [self._draw_maps(result, those, scenario) for result in those]
        return made

    def _draw_maps(self, result: Evaluation, beside: Sequence[Evaluation], scenario: Scenario) -> Path:
        """Draw the maps of a policy with the colors of all that are to be compared with it."""
        from crowd_env.rendering import save_figure
        from crowd_env.rendering.heat import HeatMap, heat_maps

        maps = []
        for name in Maps._fields:
            kind, which = name.split("_")
            every = [getattr(one.measured.maps, name) for one in beside if one.measured is not None]
            most = np.concatenate([values[values > 0.0] for values in every])
            # A single hard blow would leave everything else pale.
            full = float(np.percentile(most, 99.5)) if len(most) else None
            said = "mean over time" if which == "mean" else "greatest"
            assert result.measured is not None
            values, origin = getattr(result.measured.maps, name), result.measured.grid.origin
            title, unit, scale = _SHOWN[kind]
            full = full and scale * full
            maps.append(HeatMap(f"{title}, {said}", scale * values, origin, CELL, unit, kind, full))  # type: ignore[arg-type]
        note = f"Density: one over the floor of the person there.  {_PRESSURE[pressure_is_force(result.scheme)]}"
        name = f"heat-{_plain(result.policy)}-{_plain(result.scheme)}.png"
        title = f"{result.policy}, {scenario.name}, {result.scheme}, {result.runs} runs"
        return save_figure(heat_maps(scenario.geometry, maps, title=title, note=note), self.folder / name)


def content_of(result: Evaluation) -> Plain:
    """Return what a file holds of a measured evaluation: plain data and arrays."""
    measured = result.measured
    assert measured is not None
    content = {name: getattr(measured, name) for name in (*_NUMBERS, *_ARRAYS)} | {
        "time_limit": result.time_limit,
        "exit_names": result.exit_names,
        "origin": measured.grid.origin,
        "constants": result.constants,
        "episodes": np.array(result.episodes, dtype=np.float64),
        "exit_times": np.array(result.exit_times),
        "ended": result.ended,
        "maps": np.stack(measured.maps),
    }
    return content if result.learned is None else content | {"learned": result.learned}


def evaluation_of(policy: str, scheme: str, kept: Plain) -> Evaluation:
    """Return the evaluation that a file holds, see `content_of`."""
    kinds = EpisodeMetrics.__annotations__.values()  # int or float
    rows = ([kind(one) for kind, one in zip(kinds, row, strict=True)] for row in kept["episodes"].tolist())
    episodes = list(map(EpisodeMetrics._make, rows))
    measured = Measured(
        maps=Maps(*kept["maps"]),
        grid=Grid(tuple(kept["origin"]), kept["maps"].shape[1:]),
        **{name: kept[name] for name in (*_ARRAYS, *_NUMBERS)},
    )
    return Evaluation(
        policy,
        scheme,
        episodes,
        list(kept["exit_times"]),
        kept["ended"],
        kept["time_limit"],
        tuple(kept["exit_names"]),
        measured,
        kept["constants"],
        kept.get("learned"),
    )


def _curves(results: Sequence[Evaluation]) -> dict[str, list[np.ndarray]]:
    """Return the exit times by policy; policies with the very same ones share a curve."""
    found: dict[str, list[np.ndarray]] = {}
    for result in results:
        for label, times in found.items():
            if np.array_equal(times, result.exit_times, equal_nan=True):
                found = {f"{k} = {result.policy}" if k == label else k: v for k, v in found.items()}
                break
        else:
            found[result.policy] = result.exit_times
    return found


def _plain(name: str) -> str:
    """Return a name as part of a file name; other names give other parts."""
    return quote(name, safe=" ")


def _text(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.6g}"
