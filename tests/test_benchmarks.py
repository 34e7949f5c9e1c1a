"""Benchmarks yield well-formed figures; how fast it is, is never asked here."""

import json
import math

import pytest
from typer.testing import CliRunner

from benchmarks import batch, cli, cold, room20, train
from benchmarks.measuring import Effort, Row, Stopwatch, significant
from crowd_env.physics import SCHEMES

TINY = Effort(seconds=0.001, blocks=1)
# What stands in for a new process with an empty cache, which takes half a minute.
QUICK_PROGRAM = "import json; print(json.dumps({{'import': 0.5, 'first step': 2.0, 'CPU': 2.5}}))  # {scheme}"


def check(rows):
    assert rows
    for row in rows:
        assert isinstance(row, Row)
        assert row.what and row.unit
        assert math.isfinite(row.value) and row.value >= 0
        if row.unit == "1" and "load" not in row.what:
            assert row.value <= 1
    assert len({row.what for row in rows}) == len(rows)


def test_batch():
    rows = batch.rows(TINY, sizes=(2,), settle=1)
    check(rows)
    assert len(rows) == 3 * len(SCHEMES)
    assert all(row.value > 0 for row in rows if row.unit == "1/CPU s")


def test_train_shares_add_up():
    pytest.importorskip("stable_baselines3")
    rows = train.rows(TINY, rooms=2, n_steps=8)
    check(rows)
    shares = [row.value for row in rows if row.what.startswith("CPU time")]
    assert len(shares) == 3
    assert sum(shares) == pytest.approx(1, abs=0.02)
    value = {row.what: row.value for row in rows}
    active, slots = value["samples that count"], value["slots, as stable-baselines3 counts"]
    assert active / slots == pytest.approx(value["slots with someone inside"], abs=0.02)


def test_room20():
    rows = room20.rows(TINY)
    check(rows)
    value = {row.what: row.value for row in rows}
    for scheme in SCHEMES:
        assert 0 < value[f"{scheme}: physics"] < value[f"{scheme}: environment"]


def test_cold(monkeypatch):
    monkeypatch.setattr(cold, "PROGRAM", QUICK_PROGRAM)
    rows = cold.rows(TINY)
    check(rows)
    assert rows[0] == Row("nsm2: import", 0.5, "s")


def test_cold_says_what_went_wrong(monkeypatch):
    monkeypatch.setattr(cold, "PROGRAM", "raise SystemExit('no {scheme} today')")
    with pytest.raises(ValueError, match="no nsm2 today"):
        cold.rows(TINY)


@pytest.mark.slow
def test_cold_with_a_real_process():
    check(cold.rows(TINY))


def test_one_json_object_a_case(monkeypatch, tmp_path):
    monkeypatch.setattr(cli, "CASES", {name: lambda effort: [Row("speed", 2.0, "1/s")] for name in ("one", "two")})
    result = run("--json", "--out", str(tmp_path))
    assert result.exit_code == 0
    objects = [json.loads(line) for line in result.stdout.splitlines()]
    assert [found["case"] for found in objects] == ["one", "two"]
    assert objects[0]["rows"][0] == {"what": "speed", "value": 2.0, "unit": "1/s"}
    assert json.loads((tmp_path / "two.json").read_text()) == objects[1]


def test_a_table_for_people(monkeypatch):
    monkeypatch.setattr(cli, "CASES", {"one": lambda effort: [Row("speed", 123456.0, "1/s")]})
    assert "123,456" in run("one").stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [(["nothing"], "known: batch"), (["--seconds", "0"], "--seconds"), (["--blocks", "0"], "--blocks")],
)
def test_bad_input_is_said_plainly(words, said):
    result = run(*words)
    assert result.exit_code == 2
    assert said in result.output


def run(*words):
    import typer

    app = typer.Typer()
    app.command()(cli.run)
    return CliRunner().invoke(app, list(words))


def test_stopwatch_passes_on_what_it_times():
    class Door:
        def knock(self, times, loud=False):
            return times, loud

    door = Door()
    watch = Stopwatch(door, "knock")
    assert door.knock(3, loud=True) == (3, True)
    assert watch.calls == 1
    watch.restart()
    assert (watch.calls, watch.seconds) == (0, 0.0)


def test_digits_that_mean_nothing_are_dropped():
    assert significant(123456.7, 3) == 123000.0
    assert significant(0.0004567, 2) == 0.00046
