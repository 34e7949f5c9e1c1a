"""Benchmarks yield well-formed figures; how fast it is, is never asked here."""

import importlib
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from benchmarks import batch, cli, cold, crowds, memory, peers, pictures, scaling, scenes, train
from benchmarks.measuring import Effort, Row, Sample, Stopwatch, fastest, grid, in_turn, number
from validation import pages

TINY = Effort(seconds=0.001, blocks=1)


def check(rows):
    assert rows and len({row[:2] for row in rows}) == len(rows)
    for row in rows:
        assert (
            row.who and row.quantity and math.isfinite(row.value) and (row.value >= 0 or row.quantity == "exponent")
        ), row
    return {(row.who, row.quantity): row.value for row in rows}


def small_jam(people=40):
    return scenes.jam(people)._replace(settle=0.02, horizon=0.02)


# ------------------------------------------------------------------------------------------------------------- cases


@pytest.mark.more
def test_crowds(monkeypatch):
    """Two schemes in a jam, one at the step that it takes by default, and people who keep a distance."""
    ways = [way for way in crowds.PAIRS if way.scheme in ("dem", "nsm2")]
    monkeypatch.setitem(
        crowds.CASES, "jam", [(small_jam, (40,), [*ways, crowds.Way("hertz"), crowds.Way("dem", 0.01, "calm")])]
    )
    found = check(crowds.rows("jam", TINY))
    assert {who.partition(", ")[0] for who, _ in found} == {
        *(f"{way.scheme} {way.dt:g} s" for way in ways),
        "hertz 0.005 s",
        "dem 0.01 s calm",
    }
    assert found["dem 0.01 s, jam, 40 people", "contacts per person"] > 0


@pytest.mark.more
def test_batches():
    found = check(batch.rows(TINY, sizes=((2, 20), (2, 5)), settle=1, schemes=("dem", "nsm2")))
    assert len(found) == 3 * 2 * 2
    assert all(value <= 1 for (_, quantity), value in found.items() if quantity.endswith(("slots", "CPU time")))


@pytest.mark.more
def test_dictionaries_are_held_against_arrays():
    found = check(batch.dictionaries(TINY, agents=10))
    both = found["nsm2, dictionaries of 10", batch.RATE] / found["nsm2, 1 x 10", batch.RATE]
    assert found["nsm2, dictionaries of 10", "times arrays"] == pytest.approx(both)


@pytest.mark.more
def test_train_shares_add_up():
    pytest.importorskip("stable_baselines3")
    found = check(train.rows(TINY, envs=2, people=6, start="rule"))
    assert sum(value for (_, quantity), value in found.items() if quantity.endswith("CPU time")) == pytest.approx(1)


@pytest.mark.more
def test_scaling(monkeypatch):
    monkeypatch.setattr(scaling, "SIZES", (30, 60))
    monkeypatch.setattr(scaling, "jam", small_jam)
    found = check(scaling.against_people(TINY))
    assert len(found) == 3 * len(scaling.WAYS)
    alone = check(scaling.against_threads(TINY, rooms=2, people=30))
    assert {value for (who, _), value in alone.items() if who.endswith(", 1 threads")} == {1.0}
    people = [who for who, _ in alone if who.endswith("processes with a share each") and "30 people" in who]
    assert len(people) == 2 * 2  # two figures of two steps of dem


def test_memory_counts_every_array_once():
    big = np.zeros((10, 2))
    assert sum(array.nbytes for array in memory.arrays([big, big[:5], {"x": big}, (np.ones(3), 4)])) == 160 + 24


@pytest.mark.more
def test_memory(monkeypatch):
    monkeypatch.setattr(memory, "WAYS", scaling.WAYS[:1])
    monkeypatch.setattr(memory, "jam", lambda people: small_jam())
    found = check(memory.rows(Effort(0.001, 1, max_people=1000)))
    # Position, velocity and what else everyone has: some hundreds of bytes, not kilobytes.
    assert 100 < found["dem, 40 people", "a row for each, bytes per person"] < 2000


def test_cold_is_a_new_process(monkeypatch):
    monkeypatch.setattr(cold, "PROGRAM", "print('{\"import, s\": 0.5}')")
    assert cold.rows(TINY) == [Row("nsm2, empty cache", "import, s", 0.5), Row("nsm2, filled cache", "import, s", 0.5)]
    monkeypatch.setattr(cold, "PROGRAM", "raise SystemExit('not today')")
    with pytest.raises(ValueError, match="not today"):
        cold.rows(TINY)


@pytest.mark.nightly
def test_cold_with_a_real_process():
    check(cold.rows(TINY))


# ------------------------------------------------------------------------------------------------------------ scenes


def test_a_jam_stands_close_and_does_not_overlap():
    scene = scenes.jam(50)
    assert scene.people / (scene.side - 0.4) ** 2 == pytest.approx(scenes.JAM_DENSITY, rel=1e-6)
    assert scenes.overlaps(scene.geometry, scene.bodies, scene.position).max() < 1e-6
    assert scene.bodies.radius.min() > 0.18 and (scenes.jam(50).position == scene.position).all()


def test_overlaps_are_those_of_the_bodies():
    scene = scenes.hall(10)
    bodies = scene.bodies._replace(radius=np.full(10, 0.2))
    position = np.stack([1.0 + 0.5 * (np.arange(10) % 5), 1.0 + 1.0 * (np.arange(10) // 5)], axis=1)
    position[1, 0] = 1.37
    assert scenes.overlaps(scene.geometry, bodies, position) == pytest.approx([0.03])


# --------------------------------------------------------------------------------------------------------- measuring


class Runner:
    def __init__(self, name, blocks, whole, log):
        self.name, self.whole, self._blocks, self._log = name, whole, list(blocks), log

    def block(self, effort):
        self._log.append(self.name)
        return self._blocks.pop(0)


def test_contenders_take_turns_and_the_fastest_block_counts():
    log = []
    slow, quick = Sample(2.0, 2.0, 5.0, 10.0), Sample(1.0, 1.0, 5.0, 10.0)
    runners = [Runner("a", [slow, quick, slow], 5.0, log), Runner("b", [slow] * 3, 5.0, log)]
    assert in_turn(runners, Effort(blocks=3)) == [quick, slow]
    assert log == ["a", "b"] * 3


def test_parts_of_a_run_count_together():
    easy, hard = Sample(1.0, 1.0, 2.0, 100.0), Sample(1.0, 1.0, 3.0, 10.0)
    assert fastest([easy, hard], whole=5.0) == Sample(2.0, 2.0, 5.0, 110.0)
    assert fastest([easy, hard], whole=2.0) == easy


def test_a_stopwatch_passes_on_what_it_times():
    door = type("Door", (), {"knock": lambda self, times, loud=False: (times, loud)})()
    watch = Stopwatch(door, "knock")
    assert door.knock(3, loud=True) == (3, True) and watch.seconds >= 0.0


def test_figures_are_a_table_with_digits_that_mean_something():
    rows = [Row("a", "x, m", 1.0), Row("a", "y, s", 12_345_678.0), Row("b", "x, m", 0.00045678)]
    assert grid(rows) == [["", "x, m", "y, s"], ["a", "1", "12.3 M"], ["b", "0.000457", ""]]
    assert [number(value) for value in (123.456, 12_345.0, 2e9)] == ["123", "12.3 k", "2 G"]


# -------------------------------------------------------------------------------------------------- command and peers


def run(*words):
    app = typer.Typer()
    app.command()(cli.run)
    return CliRunner().invoke(app, list(words))


def test_one_json_object_a_case_and_one_table_of_the_pages(monkeypatch, tmp_path):
    rows = [Row("a", "steps per CPU s", 2.0), Row("a", "times b 1.0", 4.0)]
    monkeypatch.setattr(cli, "CASES", {name: lambda effort: rows for name in ("one", "two")})
    monkeypatch.setattr(cli, "TABLES", tmp_path)
    monkeypatch.setattr(cli, "fill_pages", lambda: [])
    monkeypatch.setattr(cli, "draw_pictures", lambda: [])
    (tmp_path / "made_by.csv").write_text("table,command,note\n")
    result = run("--json", "--csv")
    assert result.exit_code == 0
    found = [json.loads(line) for line in result.stdout.splitlines()]
    assert [one["case"] for one in found] == ["one", "two"] and found[0]["rows"][1]["value"] == 4.0
    assert pages.read_table("benchmark-one", tmp_path) == [["", "steps per CPU s", "times b 1.0"], ["a", "2", "4"]]
    assert pages.read_table("made_by", tmp_path)[1][1:2] == ["python -m benchmarks one --csv"]
    assert "times b 1.0" in run("one").stdout


@pytest.mark.more
def test_pictures_are_of_the_tables(tmp_path):
    read = {
        name: list(pictures.cells(pages.TABLES, *name))
        for name in (("batch", "times magent2"), ("hall", "person-steps"))
    }
    assert all(read.values())
    for (table, column), found in read.items():
        head, *rows = pages.read_table(f"benchmark-{table}", pages.TABLES)
        k = next(k for k, name in enumerate(head) if set(column.split()) <= set(name.split()))
        shown = {row[0]: row[k] for row in rows}
        assert all(number(figure) == shown[f"{way}, {scene}"] for way, scene, figure in found)
    assert all(path.stat().st_size > 10_000 for path in pictures.draw_pictures(images=tmp_path))


def test_bad_input_is_said_plainly():
    for words, said in ((["nothing"], "known: room20"), (["--seconds", "0"], "--seconds"), (["--blocks", "0"], "--blocks"),
                        (["--max-people", "0"], "--max-people"), (["--peer-seconds", "-1"], "--peer-seconds")):  # fmt: skip
        result = run(*words)
        assert result.exit_code == 2 and said in result.output, words
    assert Effort(max_people=5000).sizes((1000, 5000, 20_000)) == [1000, 5000]
    assert Effort(max_people=5).sizes((1000, 5000)) == [1000]


def test_no_peer_is_loaded_unless_asked_for_and_an_absent_one_is_a_line(monkeypatch, capsys):
    assert peers.rivals("room20", small_jam(), TINY) == peers.batch_rivals(2, 20, TINY) == []
    real = importlib.import_module
    names = {"cromosim", "jupedsim", "magent2", "mpe2", "pymunk", "vmas"}

    def import_module(name):
        if name.partition(".")[0] in names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name)

    monkeypatch.setattr(importlib, "import_module", import_module)
    for function in (peers.installed, peers.say):
        function.cache_clear()
    asked = replace(TINY, peers=True)
    for _ in range(2):
        assert peers.rivals("jam", small_jam(), asked) == peers.rivals("big", small_jam(), asked) == []
        assert peers.batch_rivals(2, 20, asked) == []
    lines = capsys.readouterr().err.splitlines()
    assert sorted(line.split()[0] for line in lines) == sorted(names)
    assert all("is not installed and is left out: pip install -e '.[train,bench]'" in line for line in lines)
    peers.installed.cache_clear()


class Other:
    name, whole = "other 1.0", 0.02

    def block(self, effort):
        return Sample(3.0, 3.0, 0.02, 80.0)

    def now(self):
        return None, np.empty((0, 2))


@pytest.mark.more
def test_ratios_to_a_peer_are_of_its_cost_and_ours(monkeypatch):
    monkeypatch.setattr(crowds, "rivals", lambda *_: [Other()])
    found = check(crowds.measure(small_jam(), TINY, [crowds.Way("dem", 0.01)]))
    who = "dem 0.01 s, jam, 40 people"
    assert found[who, "times other 1.0"] == pytest.approx(3.0 / 0.02 / found[who, crowds.COST])


@pytest.mark.nightly
@pytest.mark.parametrize("package", ["cromosim", "jupedsim", "pymunk", *peers.BATCHES])
def test_peers_that_are_installed_are_measured(package):
    pytest.importorskip(package)
    asked = replace(TINY, peers=True, peer_seconds=0.2)
    if package in peers.BATCHES:
        found = [one for one in peers.batch_rivals(2, 4, asked) if one.name.startswith(package)]
        assert found and all(one.block(TINY).rate > 0 for one in found)
        return
    scene = (small_jam() if package == "pymunk" else scenes.room20())._replace(horizon=0.05)
    for rival in importlib.import_module(f"benchmarks.peers.{package}").crowds(scene, asked):
        sample = rival.block(asked)
        assert sample.cpu > 0 and sample.simulated > 0 and sample.steps > 0 and rival.name.startswith(package)
        bodies, position = rival.now()
        assert len(bodies.radius) == len(position) == rival.inside
