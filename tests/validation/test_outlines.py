"""The map with bodies that have shoulders: who is refused, where people start, what is kept apart, and the tables."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from typer.testing import CliRunner

from crowd_env import OUTLINES, Physics, Simulation
from crowd_env.core.behaviors.outline import Outline, room_of
from validation.cases import CASES, Case, Setting, doors, gate
from validation.cases.case import row
from validation.cases.crowds import draw_crowds
from validation.cases.standards import TESTS
from validation.cli import app
from validation.finished import Finished, complete_rows
from validation.sources import Source
from validation.tables import MAKERS

TORSOS = Setting("hertz", "hurried", draws=1, outline="torso")
ROOM = room_of(OUTLINES["torso"])


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def nearest(position):
    between = np.hypot(*np.moveaxis(position[:, None] - position, -1, 0))
    return (between + np.diag(np.full(len(position), np.inf))).min()


# ------------------------------------------------------------------------------------------------------------ crowds


class Begun(Exception):
    pass


@pytest.fixture
def begun(monkeypatch):
    """Return the outlines of all simulations, none of which goes on."""
    outlines = []

    def begin(self, *args, physics="nsm2", **options):
        outlines.append(Outline.of(Physics.of(physics).outline))
        raise Begun

    monkeypatch.setattr(Simulation, "__init__", begin)
    return outlines


@pytest.mark.more
@looped("name", [name for name, case in CASES.items() if not case.discs_because])
def test_every_case_that_can_has_bodies_of_the_outline(begun, name):
    with pytest.raises(Begun):
        list(CASES[name].run(TORSOS))
    assert begun.pop() == OUTLINES["torso"] and not begun


# Crowds that begin where torsos have no room to turn, and a dose of gas without a simulation.
DISCS_ALONE = {"rimea-15", "imo-11", "iso-19"}


@pytest.mark.more
@looped("name", TESTS.keys() - DISCS_ALONE)
def test_so_has_every_test_of_the_standards(begun, name):
    with pytest.raises(Begun):
        TESTS[name](TORSOS)
    assert begun.pop() == OUTLINES["torso"] and not begun


def test_shoulders_start_with_room_to_turn():
    crowds = draw_crowds([gate.gate(None)], TORSOS)
    assert crowds.simulation.outline == OUTLINES["torso"]
    assert nearest(crowds.simulation.state.position) >= 2.0 * ROOM * gate.RADIUS


def test_recorded_shoulders_are_pushed_apart_until_they_can_turn():
    starts = np.random.default_rng(0).uniform((-2.5, 0.3), (2.5, 6.0), (75, 2))
    scenario = gate.gate(starts, TORSOS.room)
    crowds = draw_crowds([scenario], TORSOS)
    assert nearest(crowds.simulation.state.position) >= 2.0 * ROOM * gate.RADIUS
    assert nearest(gate.gate(starts).population.starts) == pytest.approx(2.0 * gate.RADIUS, abs=1e-4)


@pytest.mark.more
def test_shoulders_that_do_not_fit_are_refused():
    door = doors.door(0.8, 24)
    crowded = replace(door, population=door.population.changed(people=44))
    draw_crowds([crowded], Setting("hertz", draws=1))
    with pytest.raises(ValueError, match="44 people do not fit"):
        draw_crowds([crowded], TORSOS)


# ------------------------------------------------------------------------------------------------------- the command


@pytest.fixture
def asked(monkeypatch):
    """Return what two cases, made up, are asked for; the second is of discs alone."""
    settings = []

    def run_case(setting):
        settings.append((setting.scheme, setting.outline))
        return [row("made-up", setting, True, f"of {setting.outline}", "c", "s")]

    cases = {
        "made-up": Case("t", run_case, "none", draws=7, manners=("calm",)),
        "round": Case("t", run_case, "none", manners=("calm",), discs_because="it is round"),
    }
    monkeypatch.setattr("validation.cli.CASES", cases)
    return settings


@looped(
    ("words", "said"),
    [
        (["--outline", "torso", "--schemes", "hertz", "--schemes", "dem"], "dem does not turn bodies"),
        (["--outline", "torso", "round"], "round has no bodies of outline 'torso': it is round"),
        (["--outline", "rhino"], "unknown outline 'rhino'; known: disc, torso"),
    ],
)
def test_what_cannot_have_shoulders_is_refused_before_anything_is_run(asked, words, said):
    result = run(*words)
    assert result.exit_code == 2 and said in result.stderr and asked == []


def test_by_default_shoulders_are_run_where_they_can_be(asked):
    assert run("--outline", "torso").exit_code == 0
    assert asked == [("hertz", "torso")]


def test_discs_and_shoulders_never_mix(asked, tmp_path):
    words = ("made-up", "--schemes", "hertz", "--out", tmp_path, "--json")
    found = [json.loads(run(*words, "--outline", outline).stdout)["rows"][0] for outline in ("disc", "torso")]
    assert [one["outline"] for one in found] == ["disc", "torso"]
    assert [one.figure for one in complete_rows(tmp_path, "made-up")] == ["of disc"]
    assert [one.figure for one in complete_rows(tmp_path / "torso", "made-up")] == ["of torso"]
    run(*words, "--outline", "torso")
    assert len(asked) == 2  # what is finished is not run again
    assert "bodies: torso" in run(*words[:-1], "--outline", "torso").stdout


def test_rows_of_other_shoulders_are_not_taken(asked, tmp_path, monkeypatch):
    words = ("made-up", "--schemes", "hertz", "--out", tmp_path, "--outline", "torso")
    run(*words)
    monkeypatch.setitem(OUTLINES, "torso", Outline.of({"discs": [[0.0, 0.1, 0.2], [0.0, -0.1, 0.2]]}))
    assert "was made by another command: outline" in run(*words).stderr


# -------------------------------------------------------------------------------------------------------- the tables


def keep(folder, case, outline, manner, draws=5, **more):
    setting = Setting("hertz", manner, draws=draws, outline=outline)
    Finished(folder).keep_rows(case, setting, [row(case, setting, None, "", "", "", **more)], True, 1.0)


def made(tmp_path, name):
    return MAKERS[name](Source(lambda _: {}, tmp_path / "run"))


def at_the_gate(flow, error, stuck):
    return {
        "flow": flow, "flow_error": error, "variation": flow / 4.0, "stuck": stuck, "starts": "random",
        "passages": [[1.0, 2.0]] * 5,
    }  # fmt: skip


def test_the_gate_is_told_shape_by_shape(tmp_path):
    keep(tmp_path / "run", "gate", "disc", "hurried", **at_the_gate(1.0, 0.02, 0))
    with pytest.raises(ValueError, match="torso holds no finished rows of gate"):
        made(tmp_path, "bodies-gate")
    keep(tmp_path / "run", "gate", "torso", "competitive", **at_the_gate(float("nan"), float("nan"), 5))
    assert made(tmp_path, "bodies-gate")[1:] == [
        ["discs of 0.17 m", "hurried", "1.00 ± 0.02", "0.25", "0 of 5 (0 to 43 %)"],
        ["torsos of 0.17 m", "competitive", "–", "–", "5 of 5 (57 to 100 %)"],
    ]


def test_the_doors_are_told_shape_by_shape(tmp_path):
    for outline, stuck in (("disc", 0), ("torso", 2)):
        widths = {f"{width:g}": {"flow": 2.0, "runs": [2.0] * 5, "stuck": stuck} for width in doors.WIDTHS}
        keep(tmp_path / "run", "doors", outline, "hurried", widths=widths)
    _, discs, torsos = made(tmp_path, "bodies-doors")
    assert discs[:3] == ["discs", "hurried", "2.00"] and torsos[:3] == ["torsos", "hurried", "2.00, 2 of 5 stuck"]
