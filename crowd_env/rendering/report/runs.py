"""The folders of ``crowd-env run --out``, read for a report: what was run, what came out, and what is wrong with it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from crowd_env.analysis.by_hand import by_hand
from crowd_env.analysis.figures import listed, report
from crowd_env.analysis.plan_check import check_place
from crowd_env.analysis.results.config import read_config
from crowd_env.analysis.results.crowding import Crowding
from crowd_env.analysis.results.folder import CONFIG, KEPT, ResultsFolder
from crowd_env.analysis.sections import flows_at, places_of
from crowd_env.analysis.storeys import Storey, storeys_of
from crowd_env.core.behaviors import IN_WORDS
from crowd_env.core.checks import Plain, counted
from crowd_env.core.files.atomic import legible
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.version import __version__
from crowd_env.envs.rollout import Episode
from crowd_env.physics import ContactScheme
from crowd_env.rendering.words import told_apart
from crowd_env.scenarios.scenario import Scenario

T = TypeVar("T")

# Returns the place and the contact scheme that a config names.
PlaceOf = Callable[[Plain], tuple[Scenario, ContactScheme]]


class Runs(NamedTuple):
    """The finished runs of one folder."""

    name: str  # in the report
    folder: Path
    config: Plain
    scenario: Scenario
    scheme: ContactScheme
    episodes: list[Episode]
    figures: Plain  # of `crowd_env.analysis.figures.report`
    crowding: list[Crowding]  # of the runs that have it
    storeys: list[Storey]  # of a building

    @property
    def draw(self) -> str:
        """A text that is equal for folders whose runs of one seed begin with the same people in the same places."""
        return fingerprint(self.scenario.geometry, self.scenario.population, self.scenario.room)


def load_runs(folders: Sequence[Path], place_of: PlaceOf) -> list[Runs]:
    """Return the runs of folders, each with a name that tells it from the others.

    Raises
    ------
    ValueError
        If a folder is not one of ``crowd-env run --out``, holds no finished run, or its plan is not there any more as it was,
        or if one is given twice.
    """
    where = [folder.resolve() for folder in folders]
    twice = next((folder for k, folder in enumerate(folders) if where[k] in where[:k]), None)
    if twice is not None:
        raise ValueError(f"{twice} is given twice; a report compares different folders")
    found = [_load(folder, place_of) for folder in folders]
    return [runs._replace(name=name) for runs, name in zip(found, _names(found), strict=True)]


def remarks_on(runs: Sequence[Runs]) -> list[str]:
    """Return a sentence each on what a reader must know of the runs before any figure."""
    said = [f"{one.name}: {remark}." for one in runs for remark in _remarks(one)]
    if len({one.config["sources"] for one in runs}) > 1:
        said.append("The folders were computed by different versions of the simulator; differences may come from that.")
    return said


def _remarks(one: Runs) -> Iterator[str]:
    finished, asked, figures, version = len(one.episodes), one.config["runs"], one.figures, one.config["version"]
    if finished < asked:
        yield (
            f"{finished} of {asked} runs were finished when this page was made; the figures are of these, and lean to short "
            "evacuations"
        )
    if figures["unfinished_runs"]:
        yield (
            f"in {figures['unfinished_runs']} of {counted(finished, 'run', 'runs')} people were left inside, "
            f"{figures['unfinished']} in all: "
            "mean exit times, flows and shares of the exits are of those who got out, and times so found are too short"
        )
    if version != __version__:
        yield f"the runs were made by version {version}, this page by {__version__}"
    if len(one.crowding) < finished:
        yield (
            f"maps, queues and levels of service are of {len(one.crowding)} of {finished} runs: files of the others are "
            "damaged, or of an older version, which took walls for floor; run them again"
        )
    if figures["escaped"]:
        yield "people were found outside of the plan: its figures are void"
    if figures["unconverged_steps"]:
        yield f"the contact solver ended above its tolerance in {counted(figures['unconverged_steps'], 'step', 'steps')}"


def _load(folder: Path, place_of: PlaceOf) -> Runs:
    if not folder.is_dir():
        raise ValueError(f"{folder}: there is no such folder; name folders that crowd-env run --out has written")
    if not (folder / CONFIG).exists():
        raise ValueError(f"{folder} has no {CONFIG}; name folders that crowd-env run --out has written")
    config = read_config(folder / CONFIG)
    try:
        scenario, scheme = place_of(config)
    except ValueError as error:
        raise ValueError(f"{folder}: the place of these runs cannot be read again: {error}") from None
    if fingerprint(scenario) != config["fingerprint"]:
        other = config["version"] != __version__
        what = "its file" if config.get("files") else f"{CONFIG} or crowd-env"
        why = f"they were made by version {config['version']}" if other else f"{what} has changed since"
        raise ValueError(f"{folder}: {scenario.name} is not what these runs were made of: {why}; run them again")
    kept = ResultsFolder(folder, config, scenario)
    episodes = kept.finished()
    if not episodes:
        raise ValueError(f"{folder / KEPT} holds no finished run; the command that began it goes on with it")
    figures = report(scenario, scheme, episodes, dt=config["dt"], strategy=config["strategy"])
    check = check_place(scenario)
    places = places_of(check)
    figures["sections"] = flows_at(places, episodes)
    storeys = storeys_of(scenario.geometry, places, episodes, figures)
    figures["storeys"] = {one.sheet.name: one.figures for one in storeys}
    if not scenario.goes_on:
        figures["by_hand"] = by_hand(scenario, check, config["strategy"])
    return Runs("", folder, config, scenario, scheme, episodes, figures, kept.crowding(episodes), storeys)


def _names(runs: Sequence[Runs]) -> list[str]:
    """Return what tells folders apart in words; where nothing does, their names."""
    if len(runs) == 1:
        return [str(runs[0].config["strategy"])]
    names = told_apart([_told(one) for one in runs], ", ")
    for told in ([legible(one.folder.absolute().name) for one in runs], [legible(one.folder) for one in runs]):
        again = [names.count(name) > 1 for name in names]
        names = [
            ", ".join(filter(None, (name, more))) if twice else name
            for name, more, twice in zip(names, told, again, strict=True)
        ]
    return names


def _told(runs: Runs) -> dict[str, str]:
    """Return what may tell runs from others, most telling first."""
    config = runs.config
    return {
        **{name: described(config[name]) for name in ("scenario", "strategy")},
        "scheme": config["scheme"]["name"],
        **{name: described(config[name]) for name in IN_WORDS},
        "rules": "with rules" if config["rules"] else "without rules",
        "people": counted(runs.figures["people"], "person", "people"),
        "seed": f"seed {config['seed']}",
    }


def table(rows: Mapping[str, Callable[[T], str]], columns: Sequence[T]) -> list[tuple[str, ...]]:
    """Return the rows of a table, label -> what writes a cell, with a column for each of ``columns``."""
    return [(label, *map(words, columns)) for label, words in rows.items()]


def described(value: Any) -> str:
    """Return a plain value of a config in words, such as "uniform, low 1.2, high 2"."""
    if isinstance(value, Mapping):
        heads = ("" if key in ("distribution", "name") else f"{key.replace('_', ' ')} " for key in value)
        return ", ".join(head + described(one) for head, one in zip(heads, value.values(), strict=True))
    if isinstance(value, list | tuple):
        return listed([described(one) for one in value], 5)
    return f"{value:g}" if isinstance(value, float) else "none" if value is None else str(value)
