"""Fixtures of the tests of agents."""

import pytest
from evaluations import SMALL

from crowd_env.cli.agents import evaluate
from crowd_env.cli.place import read_place


@pytest.fixture
def small(monkeypatch):
    """Let the name "hall" stand for the small hall."""
    monkeypatch.setattr(
        evaluate, "read_place", lambda options: SMALL if options.scenario == "hall" else read_place(options)
    )
