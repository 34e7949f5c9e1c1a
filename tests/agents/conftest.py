"""Fixtures of the tests of agents."""

import pytest
from evaluations import SMALL

from agents import evaluate
from crowd_env import make_scenario


@pytest.fixture
def small(monkeypatch):
    """Let the name "hall" stand for the small hall."""
    monkeypatch.setattr(evaluate, "make_scenario", lambda name: SMALL if name == "hall" else make_scenario(name))
