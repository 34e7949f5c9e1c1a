"""The benchmark in tiers: its settings, the runs that are kept of them, and what they amount to."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from cases import looped

from crowd_env.agents.evaluation import tiers
from crowd_env.agents.evaluation.tiers import judge, standing, usual
from crowd_env.agents.tasks import TASKS, Task
from crowd_env.agents.tasks.lower_bounds import bound_time, capacity_time, exit_widths, free_walk_time
from crowd_env.agents.tasks.tiers import SETTINGS, TIERS, Setting
from crowd_env.agents.tasks.variations import AS_IT_STANDS, Variation

ROOM = {"scenario": "room-v0", "options": {"side": 4.0, "door_width": 1.2}, "people": 4, "scheme": "nsm2", "dt": 0.01}
SMALL = Setting(
    "hard", Task("small", "four people", **ROOM, time_limit=20.0, blocked_after=5.0, frozen=""), AS_IT_STANDS, 4
)


def test_settings_are_tasks_each_once_and_every_tier_has_some():
    titles = [one.title for one in SETTINGS]
    assert len(set(titles)) == len(titles) and {one.tier for one in SETTINGS} == set(TIERS)
    assert all(TASKS[one.task.name] is one.task and one.runs >= 10 for one in SETTINGS)
    assert all("rule" in usual(one) and "evolution" in usual(one) for one in SETTINGS)


@pytest.mark.more
@looped("setting", SETTINGS, ids=[one.title for one in SETTINGS])
def test_every_setting_can_be_drawn(setting):
    place = setting.variation.place(setting.task)
    bodies, _ = place.population.draw(np.random.default_rng(0), place.geometry)
    assert len(bodies.radius) == place.population.people
    assert bound_time(setting.task, setting.variation) >= capacity_time(place) > 0.0


def test_a_bound_is_of_the_door_or_of_the_walk_whichever_is_later(monkeypatch):
    monkeypatch.setattr("crowd_env.agents.tasks.lower_bounds._ALONE", 20)
    assert capacity_time(TASKS["competitive-door"].place()) == pytest.approx(100 / 2.8)
    task = TASKS["room"]
    wide, narrow = (Variation("w", "", options={"door_width": width}) for width in (4.0, 0.5))
    assert exit_widths(wide.place(task)).sum() == pytest.approx(4.0)
    at_the_wide_one = bound_time(task, wide)
    assert at_the_wide_one == pytest.approx(max(free_walk_time(task, wide), 20 / (2.8 * 4.0)))
    assert bound_time(task, narrow) == pytest.approx(20 / (2.8 * 0.5))
    slow, fast = (free_walk_time(task, Variation("s", "", population={"desired_speed": speed})) for speed in (1.0, 2.0))
    assert slow == pytest.approx(2.0 * fast, rel=0.1)  # half the speed


def results(**times):
    """Return what stands in for `compare`: a policy's times of all runs, nan = somebody is left."""

    def compare(entries, place, schemes, *, runs):
        (entry,) = entries
        compare.asked.append(entry.name)
        exits = [np.full(4, value) for value in times[entry.name]]
        assert len(exits) == runs
        left = int(np.isnan(times[entry.name]).sum())
        row = {"policy": entry.name, "scheme": "nsm2", "runs": runs, "unfinished_runs": left, "escaped": 0}
        row |= {"max_overlap": 0.01, "max_speed": 1.0, "flow": {"mean": 1.0}, "hurry": {"max": 1.0}}
        return [SimpleNamespace(exit_times=exits, row=lambda: row | compare.other.get(entry.name, {}))]

    compare.asked, compare.other = [], {}
    return compare


@pytest.fixture
def tried(monkeypatch, tmp_path):
    nan = float("nan")
    compare = results(
        rule=[9.0, 9.0, 9.0, nan], follow=[5.0, 6.0, 7.0, 8.0], evolution=[6.0, 5.0, 4.0, 9.0], zipper=[4.0] * 4
    )
    monkeypatch.setattr(tiers, "compare", compare)
    return compare, tmp_path


def test_a_policy_that_is_finished_is_not_run_again_and_others_are_added(tried):
    compare, folder = tried
    assert standing(SMALL, folder) is None
    judge(SMALL, ["rule", "evolution"], folder)
    found = judge(SMALL, ["rule", "evolution", "follow"], folder)
    assert compare.asked == ["rule", "evolution", "follow"] and list(found) == compare.asked
    assert found["rule"]["last_time"] == [9.0, 9.0, 9.0, None]
    other = SMALL._replace(runs=4, variation=Variation("noisy", "", noise=0.1))
    (folder / f"{other.title}.json").write_text((folder / "small.json").read_text())
    assert list(judge(other, ["follow"], folder)) == ["follow"]  # what another setting has made is none of its own
    with pytest.raises(ValueError, match="made by another command"):
        standing(SMALL._replace(task=TASKS["room"], variation=Variation("x", "")), copied(folder, "room-x"))


def copied(folder, title):
    (folder / f"{title}.json").write_text((folder / "small.json").read_text())
    return folder


def test_a_standing_is_of_the_best_and_of_what_can_be_believed(tried):
    compare, folder = tried
    judge(SMALL, ["rule", "evolution", "follow"], folder)
    one = standing(SMALL, folder)
    assert (one.best, one.best_left, one.best_time) == ("evolution", 0, 5.0)
    assert (one.rule, one.rule_left, one.rule_time) == ("follow", 0, 6.0)
    assert one.hindsight == 5.0 <= min(one.best_time, one.rule_time)
    compare.other["zipper"] = {"escaped": 1}
    judge(SMALL, ["zipper"], folder)
    assert standing(SMALL, folder) == one  # people who walked through walls are no best rule


def test_tiers_follow_from_the_figures(tried):
    _, folder = tried
    judge(SMALL, ["rule", "evolution", "follow"], folder)
    one = standing(SMALL, folder)
    cases = {(0, 5.0, False): "solved", (0, 6.2, False): "solved", (0, 6.3, False): "hard", (0, 8.8, False): "open"}
    cases |= {(1, 5.0, False): "open", (0, 5.0, True): "open"}
    for (left, time, later), tier in cases.items():
        assert one._replace(bound=5.0, best_left=left, best_time=time, later=later).tier == tier


def test_a_policy_is_later_than_a_rule_beyond_the_spread_of_draws_alone(monkeypatch, tmp_path):
    """A tenth of a second is nothing where draws differ by more, and something where they do not."""
    spread, even = [5.0, 6.0, 7.0, 8.0], [5.1, 6.1, 7.1, 8.1]
    for learned, later in ((even, True), ([5.5, 5.8, 7.3, 7.8], False)):
        folder = tmp_path / str(later)
        monkeypatch.setattr(tiers, "compare", results(rule=spread, evolution=learned))
        judge(SMALL, ["rule", "evolution"], folder)
        assert standing(SMALL, folder).later is later


@pytest.mark.more
def test_the_table_of_tiers_is_what_was_measured():
    for one in SETTINGS:
        found = standing(one, tiers.FOLDER)
        if found is not None:
            rows = json.loads((tiers.FOLDER / f"{one.title}.json").read_text())["rows"]
            assert set(usual(one)) <= set(rows), one.title
            assert found.tier == one.tier, f"{one.title}: {json.dumps(found[1:])}"
