"""No run of a shipped submission contradicts itself, and each does as soon as a column no longer fits the others."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cases import looped
from repository import ROOT

from crowd_env.agents.evaluation import submission
from crowd_env.agents.evaluation.contradictions import RULES, contradiction, crowd_of, least_way
from crowd_env.agents.tasks import TASKS
from crowd_env.envs.metrics import flow_slope

SUBMISSIONS = ROOT / "docs/tasks/submissions"
DOOR = SUBMISSIONS / "competitive-door/competitive-door-ppo.json"


@pytest.fixture(scope="module")
def whole():
    """Return the columns of the runs of a shipped submission, and of another with a mixed crowd; and their crowds."""
    content, task = json.loads(DOOR.read_text()), TASKS["competitive-door"]
    found = {}
    for trial in content["trials"]:
        if trial["variation"] in ("task", "unfollowing"):
            (of,) = trial["of"].values()
            place = submission._now(task.name, repr(task)).places[trial["variation"]]
            crowd = crowd_of(task, place, trial["learned_share"])
            found[trial["variation"]] = submission._runs_of(of["runs"]), crowd
    return found


def times(share):
    return lambda values: values * share


EDITS = [
    ({"last_time": np.nan}, "a last time, a mean exit time and a flow"),
    ({"unfinished": 5.0}, "a run that someone has not left has no last time"),
    ({"blocked": 1.0}, "blocked must be 0 where all have left"),
    ({"last_time": times(100.0)}, "last_time must not be beyond the time limit"),
    ({"mean_exit": times(10.0)}, "mean_exit must not be above last_time"),
    ({"mean_exit": 0.001}, "mean_exit must not be below last_time over the people"),
    ({"mean_exit": times(0.1)}, "must not be below walked over mean_exit"),
    ({"last_time": times(0.5), "mean_exit": times(0.5)}, "hurry must not be below walked over mean_exit"),
    ({"flow": times(0.3)}, "flow must not be below half of the people"),
    ({"flow": times(50.0)}, "last_time must not be so far above mean_exit at this flow"),
    ({"mean_exit_learned": 1.0}, "must amount to mean_exit"),
    ({"mean_exit_others": 1.0}, "must amount to mean_exit"),
    ({"crushed_time": 0.0}, "crushed must be 0 where crushed_time is 0"),
    ({"crushed": 0.0}, "crushed must be 0 where crushed_time is 0"),
    ({"crushed": 0.0, "crushed_time": 0.0}, "crushed must be 0 where max_pressure is below 1600"),
    ({"max_pressure": 0.0}, "crushed must be 0 where max_pressure is below 1600"),
    ({"crushed": 1.0, "crushed_time": 1e6}, "crushed_time must not be below a decision step, or above the time"),
    ({"crushed": 1.0, "crushed_time": 0.01}, "crushed_time must not be below a decision step, or above the time"),
    ({"contact_impulse": times(1e4)}, "contact_impulse must not be above max_pressure on all"),
    ({"contact_impulse": 0.0}, "contact_impulse must not be below that of max_pressure on one"),
    ({"max_speed": 0.0}, "max_speed must not be below walked over mean_exit"),
    ({"walked": 1e9}, "max_speed must not be below walked over mean_exit"),
    ({"hurry": 9.0}, "max_speed must not be below hurry times the least desired speed"),
    ({"hurry": 0.0}, "hurry must not be below walked over mean_exit"),
    ({"walked": 0.0}, "walked must not be below the way of people who start as near"),
    ({"walked": times(0.01)}, "walked must not be below the way of people who start as near"),
    ({"max_density": 0.0}, "max_density must not be below that of someone alone"),
    ({"max_density": 1e6}, "max_density must not be above what leaves each body"),
    ({"flow": np.inf}, "flow must be finite"),
]


def edited(runs, changes):
    """Return runs of which the one with most people crushed is changed."""
    which = np.arange(len(runs["crushed"])) == runs["crushed"].argmax()
    new = {name: change(runs[name]) if callable(change) else change for name, change in changes.items()}
    return runs | {name: np.where(which, values, runs[name]) for name, values in new.items()}


@looped(("changes", "rule"), EDITS)
def test_an_edited_column_no_longer_fits_the_others(whole, changes, rule):
    runs, crowd = whole["task"]
    assert contradiction(runs, crowd) == ""
    assert rule in contradiction(edited(runs, changes), crowd)


@looped("column", ["last_time", "mean_exit", "flow", "walked"])
def test_runs_that_are_all_alike_are_none(whole, column):
    runs, crowd = whole["task"]
    same = {**runs, column: np.full_like(runs[column], runs[column][0])}
    assert f"{column} must not be the same in all runs" in contradiction(same, crowd)


def test_every_rule_is_broken_by_one_of_the_edits(whole):
    runs, crowd = whole["task"]
    broken = {contradiction(edited(runs, changes), crowd) for changes, _ in EDITS}
    assert {*RULES} <= broken


@looped("column", ["mean_exit_learned", "mean_exit_others", "mean_exit"])
def test_the_two_parts_of_a_mixed_crowd_amount_to_its_mean(whole, column):
    runs, crowd = whole["unfollowing"]
    assert contradiction(runs, crowd) == "" and 0 < crowd.learned < crowd.people
    assert "must amount to mean_exit" in contradiction(edited(runs, {column: times(1.1)}), crowd)


def test_bounds_of_flow_hold_for_any_exit_times():
    rng = np.random.default_rng(0)
    for people in (3, 8, 40):
        runs = [np.sort(rng.uniform(0.0, 100.0, people) ** power) for power in (0.1, 1.0, 5.0) for _ in range(50)]
        runs += [
            np.append(np.linspace(1.0, 1.1, people - 1), 50.0),
            np.repeat([0.0, 9.0], [people // 2, people - people // 2]),
        ]
        for exits in runs:
            flow, last, mean = flow_slope(exits), exits[-1], exits.mean()
            assert flow * last >= 0.5 * people * (1.0 - 1e-9)
            assert flow * (last - mean) <= np.sqrt((people**2 - 1) * (people - 1) / 12.0)


def test_nobody_starts_nearer_to_the_exits_than_bodies_fit():
    for name in ("room", "competitive-door", "two-narrow-exits"):
        place = TASKS[name].place()
        geometry = place.geometry
        _, position = place.population.draw(np.random.default_rng(0), geometry, place.room)
        a, b = geometry.exits[:, 0], geometry.exits[:, 1]
        along = np.einsum("pxk,xk->px", position[:, None] - a, b - a) / ((b - a) ** 2).sum(axis=1)
        nearest = a + np.clip(along, 0.0, 1.0)[..., None] * (b - a)
        away = np.linalg.norm(position[:, None] - nearest, axis=2).min(axis=1).mean()
        assert 0.0 < least_way(place) < away


@looped(
    ("change", "message"),
    [
        (lambda runs: runs.__setitem__(0, runs[0].rsplit(",", 1)[0]), "is damaged: a run has 16 columns, not 17"),
        (lambda runs: runs.__setitem__(0, f"{runs[0]},1"), "is damaged: a run has 18 columns, not 17"),
        (lambda runs: runs.__setitem__(0, f"x{runs[0]}"), "is damaged: could not convert string to float: 'x'"),
        (lambda runs: runs.__setitem__(0, 5), "is damaged: AttributeError"),
    ],
)
def test_a_line_that_is_no_run_is_said(tmp_path: Path, change, message):
    path = tmp_path / "competitive-door" / DOOR.name
    path.parent.mkdir(exist_ok=True)
    shutil.copy(SUBMISSIONS / "competitive-door.json", tmp_path)
    content = json.loads(DOOR.read_text())
    (of,) = content["trials"][0]["of"].values()
    change(of["runs"])
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message) as said:
        submission.read_submission(path)
    assert str(said.value).startswith(str(path))


@looped("content", [5, [], {"format": 3}, "task", "trials"])
def test_a_file_of_another_form_is_said(tmp_path: Path, content):
    path = tmp_path / "competitive-door" / DOOR.name
    path.parent.mkdir(exist_ok=True)
    shutil.copy(SUBMISSIONS / "competitive-door.json", tmp_path)
    whole = json.loads(DOOR.read_text())
    path.write_text(json.dumps({**whole, content: 5} if isinstance(content, str) else content))
    with pytest.raises(ValueError, match=r"competitive-door-ppo\.json is (damaged|no submission)"):
        submission.read_submission(path)


@pytest.mark.more
@looped("path", sorted(SUBMISSIONS.glob("*/*.json")), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_no_shipped_submission_contradicts_itself(path: Path):
    assert submission.read_submission(path)["rows"]
