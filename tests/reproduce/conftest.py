"""Fixtures of the tests of reproductions."""

import pytest
from lin_runs import invented
from reproductions import nothing

from crowd_env.reproduce import REPRODUCTIONS, Settings, pool


@pytest.fixture(scope="module")
def results():
    """Return name -> its result with the defaults, made once."""
    made = {}

    def get(name):
        if name not in made:
            made[name] = REPRODUCTIONS[name].run(Settings(), nothing)
        return made[name]

    return get


@pytest.fixture
def computed(monkeypatch):
    """Let nothing be simulated, and return the list of runs that would have been."""
    runs = []

    def instead(run, stopped=None):
        runs.append(run)
        return invented(run)

    monkeypatch.setattr(pool, "simulate", instead)
    return runs
