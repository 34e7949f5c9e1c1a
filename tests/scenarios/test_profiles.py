"""Profiles of people: what a cohort takes of them, and figures that their sources hold."""

import numpy as np
import pytest
from repository import ROOT

from crowd_env import Uniform, make_scenario
from crowd_env.scenarios.cohorts import as_people
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.profiles import PROFILES, speed_words

FILE = """
[geometry]
walkable = { box = [0, 0, 8, 8] }
exits = { out = [[8, 3], [8, 5]] }
[population]
profile = "weidmann"
desired_speed = 1.0
[[cohorts]]
people = 4
profile = "impaired-stick"
[[cohorts]]
people = 4
profile = "wheelchair"
desired_speed = [0.5, 0.6]
[[cohorts]]
people = 2
"""


def test_a_cohort_has_the_speed_of_its_profile_unless_it_has_its_own(tmp_path):
    (tmp_path / "hall.toml").write_text(FILE)
    stick, wheels, others = make_scenario(tmp_path / "hall.toml").population.parts
    assert stick.desired_speed == PROFILES["impaired-stick"].speed and stick.profile == "impaired-stick"
    assert wheels.desired_speed == Uniform(0.5, 0.6) and others.desired_speed == Uniform(1.0, 1.0)


def test_tables_in_python_take_profiles_too():
    assert as_people({"people": 3, "profile": "imo-male-over-50"}).desired_speed == Uniform(0.84, 1.4)
    with pytest.raises(ValueError, match="unknown profile 'pilots'; known: weidmann, "):
        as_people({"people": 3, "profile": "pilots"})
    with pytest.raises(ValueError, match="unknown profile"):
        Population(3, profile="pilots")


def test_the_default_people_are_a_profile():
    assert Population(1).desired_speed == PROFILES["weidmann"].speed


def test_speeds_of_the_imo_are_those_of_ando_within_a_quarter():
    """Annex 3: each group has a uniform range of its mean less and more a quarter; impaired people are slower."""
    found = {name: one.speed for name, one in PROFILES.items() if name.startswith("imo-")}
    assert len(found) == 12
    for name, law in found.items():
        mean = 0.5 * (law.low + law.high)
        assert law.low == pytest.approx(0.75 * mean, abs=0.011) and law.high == pytest.approx(1.25 * mean, abs=0.011), (
            name
        )
    for sex in ("male", "female"):
        slower = [
            found[f"imo-{sex}-{who}"].high for who in ("under-30", "30-to-50", "over-50", "impaired-1", "impaired-2")
        ]
        assert (np.diff(slower) < 0.0).all()


def test_the_page_has_every_profile():
    text = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    for name, one in PROFILES.items():
        assert f"| `{name}` | {one.people} | {speed_words(one)} | {one.source} |" in text


def test_speeds_on_stairs_lie_in_the_ranges_of_their_source():
    """IMO MSC.1/Circ.1533, annex 3, table 3.5: men below 30 years walk down at 0.76 to 1.26 m/s, and up at 0.5 to 0.84."""
    people = as_people({"people": 3, "profile": "imo-male-under-30"})
    for ratio, low, high in ((people.downstairs.low, 0.76, 1.26), (people.upstairs.low, 0.5, 0.84)):
        ends = np.array([1.11, 1.85]) * ratio
        np.testing.assert_allclose(ends, [low, high], rtol=0.02)
    assert as_people({"people": 3, "profile": "imo-male-under-30", "upstairs": 0.4}).upstairs == Uniform(0.4, 0.4)
    assert as_people({"people": 3, "profile": "wheelchair"}).upstairs is None
