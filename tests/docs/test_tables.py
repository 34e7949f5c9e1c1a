"""Tables of names in the pages are complete, and numbers in sentences are those of the code."""

import re

import pytest
from repository import ROOT

from crowd_env.core.behaviors.headway import MANNERS
from crowd_env.envs.action import DISCRETE
from crowd_env.envs.global_state import StateLayout
from crowd_env.envs.observation.layout import TERMS, ObservationLayout
from crowd_env.envs.reward import REWARDS, RewardWeights
from crowd_env.physics import SCHEMES

pytestmark = pytest.mark.more


def table(page, first_column):
    """Return the rows, as lists of cells, of the table of a page whose head begins with a cell."""
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(f"| {first_column} |"))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip().replace("`", "") for cell in line.strip("|").split("|")])
    return rows


def test_the_table_of_observation_terms_is_complete():
    layout = ObservationLayout(tuple(TERMS), routes=3)
    rows = table("docs/environments.md", "term")
    found = {row[0]: row[1] for row in rows}
    widths = {name: layout.width(name) for name in TERMS}
    of_ways = {name: f"{term.width} W".removeprefix("1 ") for name, term in TERMS.items() if term.of_each == "routes"}
    assert found == {name: of_ways.get(name, str(width)) for name, width in widths.items()}
    assert all(widths[name] == 3 * TERMS[name].width for name in of_ways)


def test_the_table_of_the_global_state_is_complete():
    rows = table("docs/environments/pettingzoo.md", "column of a person")
    widths = {name: "X" if name == "exit" else str(width) for name, width in StateLayout(1, 7).of_person.items()}
    assert {row[0]: row[2] for row in rows} == widths
    text = (ROOT / "docs/environments/pettingzoo.md").read_text(encoding="utf-8")
    assert f"a row of {StateLayout(1, 0).width} + X numbers for each of N people" in text


def test_the_table_of_rewards_is_complete():
    lines = (ROOT / "docs/environments.md").read_text(encoding="utf-8")
    part = lines[lines.index("## Rewards") :]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", part, re.MULTILINE))
    weights = RewardWeights().weights
    assert {name: float(weight) for name, weight in rows.items()} == {name: weights.get(name, 0.0) for name in REWARDS}


def test_the_table_of_schemes_is_complete():
    assert [row[0] for row in table("docs/physics.md", "name")] == list(SCHEMES)


def test_the_table_of_manners_is_complete():
    assert {row[0] for row in table("docs/walking.md", "manner")} == set(MANNERS)


def test_numbers_in_the_text_are_those_of_the_code():
    text = (ROOT / "docs/environments.md").read_text(encoding="utf-8")
    assert f"{ObservationLayout().size} numbers by default" in text
    assert f"Discrete({len(DISCRETE)})" in text
