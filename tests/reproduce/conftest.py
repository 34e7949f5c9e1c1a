"""Fixtures of the tests of reproductions."""

import pytest
from lin_runs import invented

from crowd_env.cli import reproduce as command
from crowd_env.reproduce import PAPERS


@pytest.fixture(scope="module")
def results():
    """Return name -> its result with the defaults, made once; of what simulates something small by itself."""
    paper, made = PAPERS["pecol"], {}

    def get(name):
        if name not in made:
            made[name] = paper.figures[name].redo(name, paper.settings_of(name, {}), {})
        return made[name]

    return get


@pytest.fixture
def computed(monkeypatch):
    """Let nothing be simulated, and return the runs, case and seed, that were asked for."""
    asked = []

    def instead(cases, *_, **__):
        asked.extend((case.label, seed) for case in cases.values() for seed in case.seeds)
        return {key: [invented(case, seed) for seed in case.seeds] for key, case in cases.items()}

    monkeypatch.setattr(command, "evacuate", instead)
    return asked


@pytest.fixture
def undrawn(monkeypatch):
    """Write no files of results: drawing takes most of the time."""
    monkeypatch.setattr(command, "_write", lambda result, out: [out / f"{result.name}.csv"])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
