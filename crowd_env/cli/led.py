"""A crowd that a policy leads, in ``crowd-env run``."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from crowd_env.agents.evaluation.entries import Entry, make_entries
from crowd_env.agents.trained import load_trained
from crowd_env.envs.rollout import Driver
from crowd_env.envs.settings import EnvArguments, Routing
from crowd_env.physics.settings import Physics
from crowd_env.scenarios.scenario import Scenario


class Led(NamedTuple):
    """Who leads, and where."""

    entry: Entry
    place: Scenario  # with people who walk as the policy was made for

    @property
    def name(self) -> str:
        """What tables call it."""
        return self.entry.name

    @property
    def facts(self) -> dict[str, Any]:
        """Its name and what identifies its network, ready for JSON."""
        source = self.entry.source
        digest = {} if source is None else {"sha256": hashlib.sha256(source.read_bytes()).hexdigest()}
        return {"name": self.name, **digest}

    def driver(self, physics: Physics, routing: Routing | None = None) -> Callable[[int], Driver]:
        """Return a maker of batches; without routing the policy says it."""
        arguments = EnvArguments(physics=physics) if routing is None else EnvArguments(physics=physics, routing=routing)
        return self.entry.driver(self.place, **arguments).settled()

    @classmethod
    def of(cls, entry: Entry, place: Scenario) -> "Led":
        """Return the crowd of a place whose people keep the distance that the policy was trained with, if any."""
        if entry.leads:
            trained = {} if entry.source is None else load_trained(entry.source).trained
            place = replace(place, manner=trained.get("manner"))
        return cls(entry, place)


def led_by(policy: str, place: Scenario, walking: str | None) -> Led:
    """Return the crowd of a place under a policy; with ``walking`` its people walk as that says.

    Raises
    ------
    ValueError
        If the policy is unknown, or does not fit the place.
    """
    (entry,) = make_entries([policy], place)
    return Led.of(entry, place) if walking is None else Led(entry, place)
