"""Crowds that policies lead, in ``crowd-env run`` and ``crowd-env show``."""

from dataclasses import replace

from crowd_env.agents.evaluation.entries import Entry
from crowd_env.agents.trained import load_trained
from crowd_env.scenarios.scenario import Scenario


def suited(place: Scenario, entry: Entry) -> Scenario:
    """Return the place with people that keep the distance that a policy was trained with, if any."""
    if not entry.leads:
        return place
    return replace(place, manner=None if entry.source is None else load_trained(entry.source).trained.get("manner"))
