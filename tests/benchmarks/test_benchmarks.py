"""Benchmarks yield well-formed figures; how fast it is, is never asked here."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from benchmarks import (
    batch,
    big,
    cli,
    cold,
    crowds,
    dictionaries,
    headway,
    memory,
    plots,
    probes,
    roofline,
    room20,
    scaling,
    scenes,
    tables,
    train,
)
from benchmarks.measuring import Effort, Row, Sample, Stopwatch, fastest, in_turn, significant, times_better
from crowd_env import SCHEMES, parallel_env

TINY = Effort(seconds=0.001, blocks=1)
# What stands in for a new process with an empty cache, which takes half a minute.
QUICK_PROGRAM = "import json; print(json.dumps({{'import': 0.5, 'first step': 2.0, 'CPU': 2.5}}))  # {scheme}"


def check(rows):
    assert rows
    for row in rows:
        assert isinstance(row, Row)
        assert row.what and row.unit
        assert math.isfinite(row.value) and (row.value >= 0 or row.what.endswith(": exponent"))
        assert row.ratio is None or (row.peer and math.isfinite(row.ratio) and row.ratio > 0)
    assert len({(row.what, row.peer) for row in rows}) == len(rows)


def small_jam():
    return scenes.jam(40)._replace(settle=0.02, horizon=0.02)


# ------------------------------------------------------------------------------------------------------------- cases


def test_room20():
    rows = room20.rows(TINY)
    check(rows)
    who = {row.what.partition(" ")[0] for row in rows}
    assert who == set(SCHEMES) - {"hertz-literal"}
    assert all(f"{scheme} environment, 20 people: CPU time" in {row.what for row in rows} for scheme in who)


def test_big(monkeypatch):
    monkeypatch.setattr(big, "SIZES", (30,))
    check(big.rows(TINY))


@pytest.mark.parametrize("scene", [scenes.hall(30)._replace(horizon=0.02), small_jam()], ids=["hall", "jam"])
def test_crowds(scene):
    rows = crowds.measure(scene, TINY, crowds.PAIRS)
    check(rows)
    names = {row.what.partition(",")[0] for row in rows}
    assert names == {f"{name} {dt:g} s" for name, dt in crowds.PAIRS}


def test_headway(monkeypatch):
    monkeypatch.setattr(headway, "SIZES", (30,))
    monkeypatch.setattr(headway, "SCENES", {"jam": lambda count: scenes.jam(count)._replace(settle=0.0, horizon=0.02)})
    rows = headway.rows(TINY, pairs=(("dem", 0.01), ("nsm2", 0.01)))
    check(rows)
    for without, calm, times in zip(*[iter(rows)] * 3, strict=True):
        assert times.value == pytest.approx(calm.value / without.value, rel=0.02)


def test_batch():
    rows = batch.rows(TINY, sizes=((2, 20),), settle=1)
    check(rows)
    assert len(rows) == 3 * (len(SCHEMES) - 1)
    assert all(row.value > 0 for row in rows if row.unit == "1/CPU s")
    assert all(row.value <= 1 for row in rows if row.unit.startswith("of "))


def test_dictionaries():
    rows = dictionaries.rows(TINY, agents=10)
    check(rows)
    *ours, empty = rows[:4]
    ratios = rows[4:]
    assert [row.what for row in ratios] == [row.what for row in ours]
    for row, ratio in zip(ours, ratios, strict=True):
        assert ratio.value == row.value
        assert ratio.ratio == pytest.approx(row.value / empty.value, rel=0.02)


def test_the_interface_alone_has_no_physics():
    env = dictionaries.without_physics(parallel_env("room-v0", people=5))
    first, _ = env.reset(seed=0)
    expected = parallel_env("room-v0", people=5)
    expected.reset(seed=0)
    moved, *rest = expected.step({})
    seen = [env.step({agent: np.zeros(2) for agent in env.agents}) for _ in range(3)]
    for observations, *others in seen:
        assert all(np.array_equal(observations[agent], moved[agent]) for agent in first)
        assert others == rest
    assert not np.shares_memory(seen[0][0]["pedestrian_0"], seen[1][0]["pedestrian_0"])
    assert env.env.simulation.state.time[0] == 0.0
    with pytest.raises(ValueError, match=r"pedestrian_1 .*\(3,\)"):  # actions are read
        env.step({"pedestrian_1": np.zeros(3)})


def test_the_empty_environment_is_a_parallel_env():
    env = dictionaries.EmptyParallelEnv(["a", "b"], np.zeros((2, 3), dtype=np.float32))
    observations, infos = env.reset()
    assert set(observations) == set(infos) == {"a", "b"}
    assert [set(part) for part in env.step({})] == [{"a", "b"}] * 5


def test_train_shares_add_up():
    pytest.importorskip("stable_baselines3")
    rows = train.rows(TINY, rooms=2, n_steps=8)
    check(rows)
    shares = [row.value for row in rows if row.unit == "of CPU time"]
    assert len(shares) == 3
    assert sum(shares) == pytest.approx(1, abs=0.02)
    value = {row.what: row.value for row in rows if row.ratio is None}
    active, slots = value["2 x 20, nsm2: samples that count"], value["2 x 20, nsm2: slots"]
    assert active / slots == pytest.approx(value["2 x 20, nsm2: inside"], abs=0.02)


@pytest.fixture
def quick_probes(monkeypatch):
    """Ceilings without compiling and measuring them."""
    monkeypatch.setattr(probes, "bandwidth", lambda elements, blocks: 1e12 / elements)
    monkeypatch.setattr(probes, "arithmetic", lambda blocks: 5e10)
    monkeypatch.setattr(probes, "pair_time", lambda blocks: 1e-9)
    monkeypatch.setattr(probes, "person_time", lambda people, blocks: 1e-9)


def test_roofline(quick_probes, tmp_path):
    rows = roofline.rows(TINY, scenes=(("jam", 40), ("hall", 40)))
    check(rows)
    value = {row.what: row.value for row in rows if row.ratio is None}
    share = {(row.what, row.peer): row.ratio for row in rows if row.ratio is not None}
    reached = value["jam, 40 people: person-steps"] / value["jam, 40 people: vector bound"]
    assert share["jam, 40 people: person-steps", "vector bound"] == pytest.approx(reached, rel=0.02)
    drawn(rows, "roofline", tmp_path)


@pytest.mark.nightly
def test_probes():
    assert probes.bandwidth(1000, 1) > 0
    assert probes.arithmetic(1) > 0
    assert 0 < probes.pair_time(1) < 1e-6
    assert 0 < probes.person_time(1000, 1) < 1e-6


def test_scaling(monkeypatch, tmp_path):
    monkeypatch.setattr(scaling, "SIZES", (30, 60))
    monkeypatch.setattr(scaling, "jam", lambda count: scenes.jam(count)._replace(settle=0.01))
    rows = scaling.against_people(Effort(seconds=0.02, blocks=1))
    check(rows)
    costs = [row for row in rows if row.what.endswith(": a person-step")]
    assert len(costs) == 8
    assert any(row.what.endswith(": exponent") for row in rows)
    drawn(rows, "scaling", tmp_path)


def test_threads(monkeypatch):
    monkeypatch.setattr(scaling, "_THREAD_CROWD", 30)
    rows = scaling.against_threads(TINY, rooms=2, settle=1)
    check(rows)
    assert {row.value for row in rows if ", 1 threads" in row.what and row.unit == "of one thread"} == {1.0}


def test_memory():
    rows = memory.rows(Effort(seconds=0.001, blocks=1, max_people=1000))
    check(rows)
    # Position, velocity and what else everyone has: some hundreds of bytes, not kilobytes.
    people = next(row for row in rows if row.what == "dem, 1000 people: people")
    assert 100 < people.value < 2000


def test_memory_counts_every_array_once():
    big_one = np.zeros((10, 2))
    found = [array for _, array in memory.arrays([big_one, big_one[:5], {"x": big_one}, (np.ones(3), 4)])]
    assert sum(array.nbytes for array in found) == 160 + 24


def test_cold(monkeypatch):
    monkeypatch.setattr(cold, "PROGRAM", QUICK_PROGRAM)
    rows = cold.rows(TINY)
    check(rows)
    assert rows[0] == Row("nsm2: import", 0.5, "s")


def test_cold_says_what_went_wrong(monkeypatch):
    monkeypatch.setattr(cold, "PROGRAM", "raise SystemExit('no {scheme} today')")
    with pytest.raises(ValueError, match="no nsm2 today"):
        cold.rows(TINY)


@pytest.mark.nightly
def test_cold_with_a_real_process():
    check(cold.rows(TINY))


# ------------------------------------------------------------------------------------------------------------ scenes


def test_a_jam_stands_close_and_does_not_overlap():
    scene = scenes.jam(200)
    assert scene.people == 200
    density = scene.people / (scene.side - 0.4) ** 2
    assert density == pytest.approx(scenes.JAM_DENSITY, rel=1e-6)
    assert scenes.overlaps(scene.geometry, scene.bodies, scene.position).max() < 1e-6
    assert scene.bodies.radius.min() > 0.18
    again = scenes.jam(200)
    assert (again.position == scene.position).all()


def test_overlaps_are_those_of_the_bodies():
    scene = scenes.hall(10)
    bodies = scene.bodies._replace(radius=np.full(10, 0.2))
    position = np.stack([1.0 + 0.5 * (np.arange(10) % 5), 1.0 + 1.0 * (np.arange(10) // 5)], axis=1)
    position[1, 0] = 1.37
    assert scenes.overlaps(scene.geometry, bodies, position) == pytest.approx([0.03])


# --------------------------------------------------------------------------------------------------------- measuring


class Runner:
    peer = None

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


def test_ratios_above_one_are_in_favour_of_crowd_env():
    assert times_better(0.5, 2.0, "CPU s per s") == 4.0
    assert times_better(200.0, 100.0, "1/CPU s") == 2.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"seconds": 0.0}, "--seconds is 0.0; it must be > 0"),
        ({"blocks": 0}, "--blocks"),
        ({"peer_seconds": -1.0}, "--peer-seconds"),
        ({"max_people": 0}, "--max-people"),
    ],
)
def test_efforts_that_make_no_sense_are_refused(options, said):
    with pytest.raises(ValueError, match=said):
        Effort(**options)


def test_large_crowds_can_be_left_out():
    assert Effort(max_people=5000).sizes((1000, 5000, 20_000)) == [1000, 5000]
    assert Effort(max_people=5).sizes((1000, 5000)) == [1000]


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


# ------------------------------------------------------------------------------------------------- command and tables


def run(*words):
    app = typer.Typer()
    app.command()(cli.run)
    return CliRunner().invoke(app, list(words))


def test_one_json_object_a_case(monkeypatch, tmp_path):
    rows = [Row("a, 1 person: speed", 2.0, "1/s"), Row("a, 1 person: speed", 2.0, "1/s", "b", 4.0)]
    monkeypatch.setattr(cli, "CASES", {name: lambda effort: rows for name in ("one", "two")})
    result = run("--json", "--out", str(tmp_path / "new"))
    assert result.exit_code == 0
    objects = [json.loads(line) for line in result.stdout.splitlines()]
    assert [found["case"] for found in objects] == ["one", "two"]
    assert objects[0]["rows"][1] == {
        "what": "a, 1 person: speed",
        "value": 2.0,
        "unit": "1/s",
        "peer": "b",
        "ratio": 4.0,
    }
    assert set(objects[0]) == {"case", "rows"}
    assert any(row["what"].startswith("processor ") for row in objects[0]["rows"])
    assert json.loads((tmp_path / "new" / "two.json").read_text()) == objects[1]
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"one.json", "two.json"}


def test_a_table_for_people_fits_into_80_columns(monkeypatch):
    rows = [
        *(Row(f"scheme {k}, 100000 people: CPU time", 0.5, crowds.COST) for k in range(2)),
        *(Row(f"scheme {k}, 100000 people: person-steps", 12_345_678.0, "1/CPU s") for k in range(2)),
        *(Row(f"scheme {k}, 100000 people: overlap p99", 0.5, "mm") for k in range(2)),
        *(Row(f"scheme {k}, 100000 people: CPU time", 0.5, crowds.COST, f"a peer (name 1.{k})", 7.5) for k in range(2)),
    ]
    monkeypatch.setattr(cli, "CASES", {"one": lambda effort: rows})
    text = run("one").stdout
    assert "12.3 M" in text
    assert "A = a peer (name 1.0)" in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 80


def test_figures_of_the_same_quantities_share_a_table():
    rows = [Row("a: x", 1.0, "m"), Row("a: y", 2.0, "s"), Row("b: x", 3.0, "m"), Row("load", 4.0, "1")]
    figures, rest = tables.grids({"case": "c", "rows": [row._asdict() for row in rows]})
    assert figures == tables.Grid(["", "x, m", "y, s"], [["a", "1", "2"], ["b", "3", ""]])
    assert rest.lines == [["load", "4"]]


def test_ratios_say_once_what_they_have_in_common():
    rows = [Row(f"{name}, {n} people: cost", 1.0, "s", f"p{n}", 2.0) for n in (5, 9) for name in "ab"]
    grids = tables.grids({"case": "c", "rows": [row._asdict() for row in rows]})
    assert [grid.head for grid in grids] == [[f"{n} people: cost, ratio to", "A"] for n in (5, 9)]
    assert grids[0].lines == [["a", "2"], ["b", "2"]]
    assert grids[1].legend == ["A = p9"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nothing"], "known: room20"),
        (["--seconds", "0"], "--seconds"),
        (["--blocks", "0"], "--blocks"),
        (["--max-people", "0"], "--max-people"),
        (["room20", "--out", __file__], "is not a folder"),
    ],
)
def test_bad_input_is_said_plainly(words, said):
    result = run(*words)
    assert result.exit_code == 2
    assert said in result.output


def drawn(rows, case, folder):
    pytest.importorskip("matplotlib")
    path = plots.draw({"case": case, "rows": [row._asdict() for row in rows]}, folder)
    assert path == folder / f"{case}.png"
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [Path(found).name for found in folder.iterdir()] == [f"{case}.png"]


def test_cases_without_a_plot_write_none(tmp_path):
    assert plots.draw({"case": "cold", "rows": []}, tmp_path) is None
    assert not list(tmp_path.iterdir())
