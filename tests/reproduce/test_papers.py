"""What every paper declares, and that the command line follows from it."""

from dataclasses import dataclass, fields
from typing import Literal

import pytest

from crowd_env.reproduce import FIGURES, PAPERS, Settings, find
from crowd_env.reproduce.paper import option


@dataclass(frozen=True)
class Coins(Settings):
    """Settings of an invented paper."""

    bias: float | None = option(None, "How much heads is preferred")
    kind: Literal["cent", "dime"] = option("cent", "What is thrown: cent or dime")
    twice: bool = option(False, "Throw twice")


def test_settings_are_read_as_what_they_are():
    told = {"bias": "0.5", "kind": "dime", "twice": "true", "runs": "3"}
    values = {name: Coins.read(name, text) for name, text in told.items()}
    assert values == {"bias": 0.5, "kind": "dime", "twice": True, "runs": 3}
    for name, text in (("bias", "much"), ("twice", "maybe"), ("runs", "1.5")):
        with pytest.raises(ValueError, match=f"--set {name}={text}"):
            Coins.read(name, text)


def test_settings_of_any_paper_are_checked():
    for given, words in (
        ({"kind": "euro"}, "unknown --set kind 'euro'; known: cent, dime"),
        ({"runs": 0}, "--runs is 0; it must be at least 1"),
        ({"seed": -1}, "--seed is -1; it must be at least 0"),
        ({"bias": float("nan")}, "--set bias is nan; it must be finite"),
        ({"dt": 0.0}, "--set dt is 0.0; it must be > 0"),
    ):
        with pytest.raises(ValueError, match=words):
            Coins(**given)


def test_what_differs_from_the_defaults_is_reported():
    assert Coins(runs=3, seed=4).changed() == {}
    assert Coins(bias=0.0, twice=True).changed() == {"bias": 0.0, "twice": True}


def test_a_figure_gets_the_settings_that_matter_to_it():
    paper = PAPERS["pecol"]
    given = {"runs": 3, "people": 5, "scheme": "dem", "fresh": True}
    assert paper.settings_of("fig3", given).changed() == {"scheme": "dem", "people": 5}
    assert paper.settings_of("table5", given).scheme == paper.settings.scheme
    assert paper.settings_of("table3", given) == paper.settings(runs=3)
    assert paper.settings_of("table7", {}).runs == 100


@pytest.mark.more
def test_a_paper_declares_what_its_figures_take():
    for paper in PAPERS.values():
        known = {one.name for one in fields(paper.settings)}
        assert paper.figures and paper.cpu_time > 0
        for name, figure in paper.figures.items():
            assert figure.title and figure.options <= known and set(figure.defaults) <= known, name
            assert figure.takes("fresh") == figure.takes("ray") == (figure.cases is not None), name
        assert all(one.metadata["help"] and not one.metadata["help"].endswith(".") for one in fields(paper.settings))


def test_names_are_unique_and_found():
    assert len(FIGURES) == sum(len(paper.figures) for paper in PAPERS.values())
    assert not set(FIGURES) & {*PAPERS, "all", "list"}
    assert find("all") == {key: list(paper.figures) for key, paper in PAPERS.items()}
    assert find("lin") == {"lin": list(PAPERS["lin"].figures)} and find("fig2") == {"pecol": ["fig2"]}
