"""Scenario files that the pages show are read and hold the people that they name."""

import tomllib

import pytest
from cases import looped
from shown import blocks, called

from crowd_env import CrowdEnv, make_scenario

pytestmark = pytest.mark.more


@looped("block", blocks("toml"), ids=called)
def test_scenarios_are_read_and_placed(block, tmp_path):
    path = tmp_path / "foyer.toml"
    path.write_text(block.text, encoding="utf-8")
    told = tomllib.loads(block.text)
    place = make_scenario(path)
    assert place.name == told["name"]
    assert place.population.people == sum(cohort["people"] for cohort in told["cohorts"])
    env = CrowdEnv(place)
    env.reset(seed=0)
    env.step(None)
    assert env.num_people == place.population.people
