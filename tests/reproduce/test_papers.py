"""The protocol of papers: what every one of them declares, and that the command line follows from it."""

from dataclasses import dataclass, fields
from typing import Literal

import pytest
import typer
from typer.testing import CliRunner

from crowd_env.cli.paper_options import takes_settings
from crowd_env.reproduce import FIGURES, PAPERS, Figure, Paper, Settings, find
from crowd_env.reproduce.settings import option


@dataclass(frozen=True)
class Coins(Settings):
    """Settings of an invented paper."""

    bias: float | None = option(None, "How much heads is preferred")
    kind: Literal["cent", "dime"] = option("cent", "What is thrown: cent or dime")
    twice: bool = option(False, "Throw twice")


COINS = Paper("Throws", Coins, {"coin": Figure("Coins", lambda settings, work: None)}, cpu_time=1.0)


def call(line, papers):
    seen = {}
    app = typer.Typer(pretty_exceptions_enable=False)

    @app.command()
    @takes_settings(papers)
    def command(name: str, **options) -> None:
        seen.update(options)

    result = CliRunner().invoke(app, line.split())
    return result, seen


def test_every_setting_of_every_paper_is_an_option():
    papers = {**PAPERS, "coins": COINS}
    names = {one.name for paper in papers.values() for one in fields(paper.settings)}
    result, seen = call("x", papers)
    assert result.exit_code == 0 and set(seen) == names and set(seen.values()) <= {None, False}
    _, seen = call("x --bias 0.5 --kind dime --twice --no-rotation --runs 3 --door-width 1", papers)
    assert {name: value for name, value in seen.items() if value not in (None, False)} == {
        "bias": 0.5, "kind": "dime", "twice": True, "no_rotation": True, "runs": 3, "door_width": 1.0,
    }  # fmt: skip
    assert call("x --bias much", papers)[0].exit_code == 2


def test_help_says_what_each_setting_means_and_its_default(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    text = " ".join(call("--help", {**PAPERS, "coins": COINS})[0].output.replace("│", " ").split())
    assert "What is thrown: cent or dime; default cent." in text
    assert "How much heads is preferred." in text
    assert "Draw k has the seed SEED + k; default 0." in text  # the same in all papers: said once
    assert "default 50, of table7 100, of fig6 100; Lin, Ma, Lo: Draws of each point; default 10" in text
    assert "Throws" in text and "Lin, Ma, Lo" in text


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"kind": "euro"}, "unknown --kind 'euro'; known: cent, dime"),
        ({"runs": 0}, "--runs is 0; it must be at least 1"),
        ({"seed": -1}, "--seed is -1; it must be >= 0"),
        ({"bias": float("nan")}, "--bias is nan; it must be a finite number"),
        ({"dt": 0.0}, "--dt is 0 s; it must be > 0"),
    ],
)
def test_settings_of_any_paper_are_checked(given, words):
    with pytest.raises(ValueError, match=words):
        Coins(**given)


def test_what_differs_from_the_defaults_is_reported():
    assert Coins(runs=3, seed=4).changed() == {}
    assert Coins(bias=0.0, twice=True).changed() == {"bias": 0.0, "twice": True}


def test_a_figure_gets_the_settings_that_matter_to_it():
    paper = PAPERS["pecol"]
    given = {"runs": 3, "n": 5, "scheme": "dem", "fresh": True}
    assert paper.settings_of("fig3", given).changed() == {"scheme": "dem", "n": 5}
    assert paper.settings_of("table5", given).scheme == paper.settings.scheme
    assert paper.settings_of("table3", given) == paper.settings(runs=3)
    assert paper.settings_of("table7", {}).runs == 100


@pytest.mark.parametrize("key", list(PAPERS))
def test_a_paper_declares_what_its_figures_take(key):
    paper = PAPERS[key]
    known = {"ray", *(one.name for one in fields(paper.settings))}
    assert paper.figures and paper.cpu_time > 0
    for name, figure in paper.figures.items():
        assert figure.title and figure.options <= known and set(figure.defaults) <= known, name
        assert (figure.steps is None) != (figure.runs is None), name  # it simulates by itself, or is made of kept runs
        assert figure.takes("fresh") == (figure.runs is not None), name
    assert all(one.metadata["help"] and not one.metadata["help"].endswith(".") for one in fields(paper.settings))


def test_names_are_unique_and_found():
    assert len(FIGURES) == sum(len(paper.figures) for paper in PAPERS.values())
    assert not set(FIGURES) & {*PAPERS, "all", "list"}
    assert find("all") == {key: list(paper.figures) for key, paper in PAPERS.items()}
    assert find("lin") == {"lin": list(PAPERS["lin"].figures)} and find("fig2") == {"pecol": ["fig2"]}
