"""Table 7 and Figure 6 of Pécol et al. 2011 on the synthetic movie theatre."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from evacuations import evacuated
from reproductions import reported

from crowd_env.cli import reproduce as command
from crowd_env.core.executors import Serial
from crowd_env.core.files.store import Store
from crowd_env.reproduce import PAPERS
from crowd_env.reproduce.evacuations import evacuate
from crowd_env.reproduce.pecol2011 import theatre
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.pecol2011.theatre import SCHEME, Egress


def invented(runs, shift=0.0, by_a=42, lost=0, ruled=True):
    """Return evacuations in which A is left every second from 20 s on, and B every half second from 40 s on."""
    exits = theatre.theatre().geometry.exit_names
    times = np.concatenate([20.0 + np.arange(by_a), 40.0 + 0.5 * np.arange(101 - by_a)]) + shift
    index = np.repeat([exits.index("A"), exits.index("B")], [by_a, 101 - by_a])
    found = []
    for k in range(runs):
        time, by = times + 0.1 * k, index.copy()
        if k == 0:
            time[:lost], by[:lost] = np.nan, -1
        record = [[4.0, 2.0, 0.0], 30] if ruled else None
        found.append(SimpleNamespace(seed=k, exit_time=time, exit_index=by, record=record))
    return found


@pytest.fixture
def scripted(monkeypatch):
    """Let evacuations be invented: with rules everything is 2 s later and two people more take B."""

    def instead(cases, *_, **__):
        shift = {True: (2.0, 40), False: (0.0, 42)}
        return {key: invented(len(case.seeds), *shift[case.rules], ruled=case.rules) for key, case in cases.items()}

    monkeypatch.setattr(command, "evacuate", instead)


def test_quantities_of_an_evacuation():
    done = Egress(invented(2))
    found = done.quantities
    assert found["last, A"] == pytest.approx([61.0, 61.1]) and found["mean, A"] == pytest.approx([40.5, 40.6])
    assert found["last, B"] == pytest.approx([69.0, 69.1]) and found["mean, B"] == pytest.approx([54.5, 54.6])
    assert found["last, all"] == pytest.approx([69.0, 69.1])
    assert found["mean, all"] == pytest.approx((42 * np.array([40.5, 40.6]) + 59 * np.array([54.5, 54.6])) / 101)
    assert (found["people by A"] == 42).all() and (found["people by B"] == 59).all()


def test_whoever_is_left_inside_is_told_and_spoils_no_mean():
    done = Egress(invented(2, lost=3))
    assert theatre.unfinished_row("", done).here == 3
    assert np.isnan(done.quantities["last, all"][0]) and done.quantities["last, all"][1] == pytest.approx(69.1)
    assert done.quantities["mean, A"][0] == pytest.approx(np.mean(20.0 + np.arange(3, 42)))
    nobody = Egress(invented(2, lost=101)[:1])
    assert all(np.isnan(values).all() for name, values in nobody.quantities.items() if not name.startswith("people"))


def test_the_implied_split_follows_from_the_printed_means():
    for k in (0, 1):
        a, b, everyone = (float(theatre.PRINTED[f"mean, {name}"][k]) for name in ("A", "B", "all"))
        by_a, by_b = (theatre.IMPLIED[f"people by {name}"][k] for name in "AB")
        assert by_a + by_b == 101
        assert (by_a * a + by_b * b) / 101 == pytest.approx(everyone, abs=0.06)


@pytest.mark.more
def test_table_7_stands_beside_the_paper_and_says_what_rules_change(scripted, folder):
    object = reported("table7 --runs 4")
    rows = {row["quantity"]: row for row in object["rows"]}
    assert len(rows) == len(object["rows"]) and object["options"] == {}
    for name, (_, simulation) in theatre.PRINTED.items():
        assert rows[name]["paper"] == float(simulation) and rows[name]["n"] == 4
        assert rows[f"{name}, no rules"]["paper"] is None
    assert rows["last, B"]["here"] == pytest.approx(72.15) and "exercise 66 s (+9.3 %)" in rows["last, B"]["reading"]
    assert rows["people by A"]["paper"] is None and rows["people by A"]["reading"].startswith("implied: exercise 42")
    # Draw by draw: the runs of a condition differ, their differences do not.
    change = rows["last, B: rules change it by"]
    assert change["here"] == pytest.approx(3.0) and change["ci95"] == pytest.approx([3.0, 3.0])
    assert rows["people by A: rules change it by"]["here"] == -2.0
    assert rows["other route than without rules"]["here"] == 2.0
    assert (rows["rule 1 is on"]["here"], rows["rule 3 is on"]["here"]) == (4.0, 0.0)
    assert rows["turned away for a while"]["here"] == 30.0
    text = " ".join(object["remarks"])
    assert all(words in text for words in ("SYNTHETIC", "an illustration, not a validation", "Draws 0 to 3"))
    assert (folder / "reproduce/table7.png").read_bytes()[:4] == b"\x89PNG"
    with (folder / "reproduce/table7-exit-times.csv").open(newline="") as file:
        raw = list(csv.DictReader(file))
    assert len(raw) == 2 * 4 * 101 and {row["route"] for row in raw} == {"A", "B"}


@pytest.mark.more
def test_figure_6_draws_what_table_7_tells_of_the_exercise(scripted, folder):
    object = reported("fig6 --runs 3 --seed 2")
    rows = {row["quantity"]: row for row in object["rows"]}
    assert rows["first person out"]["here"] == pytest.approx(22.1)
    assert rows["51 people out"]["n"] == 3 and rows["last, all"]["paper"] == 62.0
    assert "curve is not printed" in " ".join(object["remarks"])
    assert (folder / "reproduce/fig6.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.more
def test_a_hundred_runs_are_the_default(scripted, folder):
    assert {row["n"] for row in reported("table7")["rows"] if row["unit"] == "s"} == {100}
    assert PAPERS["pecol"].settings_of("table5", {}).runs == 50


@pytest.mark.more
def test_both_rest_on_the_same_draws_which_are_those_of_the_run_command(tmp_path):
    settings, counts = PecolSettings(runs=1, seed=3), []
    cases = theatre.cases(settings, ["yes", "no"])
    runs = evacuate(cases, Store(tmp_path), Serial(), progress=counts.append)
    ruled, free = Egress(runs["yes"]), Egress(runs["no"])
    env = evacuated("theatre-v0", physics=SCHEME, seed=[3])
    np.testing.assert_array_equal(ruled.time.ravel(), env.simulation.state.exit_time)
    assert sum(counts) == 2 and free.ruled.sum() == 0 and free.turned.sum() == 0
    assert not np.array_equal(free.time, ruled.time)
    assert (ruled.turned > 5).all() and (ruled.ruled[:, 0] > 1.0).all()
    for done in (ruled, free):
        assert np.isfinite(done.time).all() and done.quantities["people by A"] == pytest.approx([43], abs=6)
    again = Egress(
        evacuate(theatre.cases(settings, ["yes"]), Store(tmp_path), Serial())["yes"]
    )  # of Figure 6: from the store
    np.testing.assert_array_equal(again.time, ruled.time)
    np.testing.assert_array_equal(again.ruled, ruled.ruled)


@pytest.mark.nightly
def test_table_7_comes_out_in_its_order_of_magnitude(folder):
    rows = {row["quantity"]: row for row in reported("table7 --runs 20")["rows"]}
    for name, (exercise, _) in theatre.PRINTED.items():
        assert rows[name]["here"] == pytest.approx(float(exercise), rel=0.2), name
    assert rows["left inside"]["here"] == rows["left inside, no rules"]["here"] == 0
    low, _ = rows["mean, all: rules change it by"]["ci95"]
    assert low > 0.0  # rules make people wait and walk further
