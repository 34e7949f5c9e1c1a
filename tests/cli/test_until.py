"""``run --until``: as many runs as the mean needs, whatever was computed at once or before."""

import json
from pathlib import Path

import numpy as np
import pytest
from cases import looped
from reported_pages import command

from crowd_env.analysis.figures import FEWEST, runs_enough
from crowd_env.envs.metrics import summarise

ROOM = ("run", "room-v0", "--people", 4, "--scheme", "dem")


def half(times):
    """Return half of the 95 % interval of the mean, over the mean."""
    found = summarise(times)
    return (found.ci95[1] - found.mean) / found.mean


def test_so_many_runs_are_enough_as_make_the_interval_short_and_one_less_is_not():
    times = np.random.default_rng(3).normal(50.0, 5.0, 400)
    enough = runs_enough(times, 0.02)
    assert enough is not None and half(times[:enough]) <= 0.02
    assert all(half(times[:runs]) > 0.02 for runs in range(FEWEST, enough))
    assert runs_enough(times[: enough - 1], 0.02) is None
    assert runs_enough(np.full(30, 7.0), 0.02) == FEWEST
    unfinished = np.where(np.arange(400) % 2, np.nan, times)  # of runs in which someone stayed nothing is known
    later = runs_enough(unfinished, 0.02)
    assert later is not None and np.isfinite(unfinished[:later]).sum() >= FEWEST and later > FEWEST


def test_stopping_makes_the_interval_hardly_too_short():
    rng, inside, trials = np.random.default_rng(1), 0, 400
    for _ in range(trials):
        times = rng.normal(50.0, 5.0, 300)
        found = summarise(times[: runs_enough(times, 0.03)])
        inside += found.ci95[0] <= 50.0 <= found.ci95[1]
    assert (
        0.88 < inside / trials < 0.98
    )  # measured 0.92 to 0.94: who stops at a lucky moment is right a little less often


@pytest.mark.more
def test_a_command_stops_there_and_its_folder_is_of_these_runs(tmp_path: Path):
    asked = (*ROOM, "--runs", 60, "--until", "5%")
    code, out, said = command(*asked, "--workers", 1, "--out", tmp_path / "one", "--json")
    found = json.loads(out)
    assert code == 0 and found["enough"] and FEWEST <= found["runs"] < 60, said
    mean, (_, high) = (found["evacuation_time"][name] for name in ("mean", "ci95"))
    assert high - mean <= 0.05 * mean
    config = json.loads((tmp_path / "one" / "config.json").read_text("utf-8"))
    assert config["runs"] == found["runs"] and config["arguments"]["until"] == "5%"
    exact = json.loads(command(*ROOM, "--runs", found["runs"], "--json")[1])
    assert exact["evacuation_time"] == found["evacuation_time"] and exact["exits"] == found["exits"]
    # Going on with the folder, or with more runs in it than are needed, comes to the same.
    more = command(*ROOM, "--runs", found["runs"] + 3, "--out", tmp_path / "one", "--json")
    assert json.loads(more[1])["runs"] == found["runs"] + 3
    again = command(*asked, "--out", tmp_path / "one", "--json")
    assert json.loads(again[1])["evacuation_time"] == found["evacuation_time"]


@pytest.mark.more
def test_too_few_runs_are_said_to_be_that():
    code, out, _ = command(*ROOM, "--runs", 12, "--until", "0.1%", "--json")
    found = json.loads(out)
    assert code == 0 and found["runs"] == 12 and not found["enough"]
    assert "not known to 0.1 % yet" in found["doubts"]


@pytest.mark.more
@looped("until", ["2", "0%", "-1%", "100%", "two%", "%"])
def test_what_is_no_percentage_is_refused(until: str):
    code, _, said = command(*ROOM, "--until", until)
    assert code == 2 and "must be a percentage such as 2%" in said
