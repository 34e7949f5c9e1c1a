"""Fixtures of the tests of reproductions."""

import pytest
from lin_runs import invented
from reproductions import ALONE

from crowd_env.reproduce import PAPERS
from crowd_env.reproduce.lin2016.run import Run


@pytest.fixture(scope="module")
def results():
    """Return name -> its result with the defaults, made once."""
    paper, made = PAPERS["pecol"], {}

    def get(name):
        if name not in made:
            made[name] = paper.figures[name].reproduce(paper.settings_of(name, {}), ALONE)
        return made[name]

    return get


@pytest.fixture
def computed(monkeypatch):
    """Let nothing be simulated, and return the list of runs that would have been."""
    runs = []

    def instead(run, stopped=None):
        runs.append(run)
        return invented(run)

    monkeypatch.setattr(Run, "simulate", instead)
    return runs


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
