"""Faster is slower, of Helbing, Farkas, Vicsek 2000: its rows from runs that are made up, and the law from 20 draws."""

from types import SimpleNamespace

import numpy as np
import pytest
from lin_runs import episode

from crowd_env import CrowdEnv, Physics
from crowd_env.core.executors import Serial
from crowd_env.core.files.store import Store
from crowd_env.reproduce.evacuations import evacuate
from crowd_env.reproduce.helbing2000 import faster
from crowd_env.reproduce.helbing2000.faster import LAWS, SPEEDS, HelbingSettings, median_of


def made_up(key, case):
    """Return runs of four people: the paper's two times, `hertz` blocked above 1 m/s, one in four pressed."""
    name, speed = key
    last = {1.5: 150.0, 5.0: 200.0}.get(speed, 250.0) if name == "helbing" else 100.0 / speed
    of, runs = SimpleNamespace(facts={"people": 4}, seeds=case.seeds), []
    for seed in case.seeds:
        blocked = name == "hertz" and speed > 1.0
        times = [1.0, 2.0] if blocked else [1.0, 2.0, 3.0, last + 0.1 * seed]
        record = [10.0, 1600.0, 1600.1, 9.0] if LAWS[name].is_helbing else None
        runs.append(episode(of, seed, times, 2.0 if blocked else None)._replace(record=record))
    return runs


def test_rows_say_when_all_are_out_what_hurry_costs_and_how_many_are_pressed():
    settings = HelbingSettings(runs=9, people=4)
    runs = {key: made_up(key, case) for key, case in faster.cases(settings).items()}
    result = faster.reproduce(settings, runs)
    rows = {row.quantity: row for row in result.rows}
    first = rows["time, helbing, 1.5 m/s"]
    assert first.here == pytest.approx(150.4) and first.paper == "150" and first.n == 9
    assert first.ci95 == pytest.approx((150.1, 150.7))  # of nine, the second and the eighth
    assert rows["time, helbing, no friction, 5 m/s"].paper is None
    assert rows["time, hertz, 1 m/s"].n == 5
    blocked = rows["time, hertz, 2 m/s"]
    assert blocked.here is None and blocked.ci95 is None and "5 blocked" in blocked.reading
    assert rows["soonest out"].here == 1.5
    assert rows["5 m/s over the soonest"].here == pytest.approx(200.4 / 150.4, abs=1e-3)
    assert rows["pressed, helbing, 8 m/s"].here == 1.0
    table = list(result.raw["runs"].rows)
    assert len(table) == len(SPEEDS) * (9 + 9 + 5 + 5)
    assert ("hertz", 8.0, 4, "", 2, "") in table and ("helbing", 1.5, 0, "150.000", 0, "1600") in table
    assert [len(axes.get_lines()) > 0 for axes in result.draw().axes] == [True, True]


def test_a_median_counts_blocked_draws_as_the_longest():
    assert median_of(np.array([3.0, 1.0, np.inf])) == (3.0, None)
    assert median_of(np.array([np.inf, 1.0, np.inf]))[0] == np.inf


def test_pressure_is_the_force_of_bodies_over_their_circumference():
    crush = faster.Crush()
    env = CrowdEnv(faster.place(HelbingSettings(people=2), 2.0), physics=Physics("helbing", dt=1e-3), decision_dt=1e-3)
    env.reset(seed=0)
    env.simulation.state.position[:] = [[5.0, 5.0], [5.0 + env.simulation.bodies.radius.sum() - 0.02, 5.0]]
    crush.begin(env, [0])
    crush.add(env, env.step(None))
    expected = 1.2e5 * 0.02 / (2.0 * np.pi * env.simulation.bodies.radius)
    np.testing.assert_allclose(crush.record(env, 0), expected, atol=0.1)


@pytest.mark.nightly
def test_people_in_a_greater_hurry_leave_later_and_friction_is_why(tmp_path):
    cases = {key: case for key, case in faster.cases(HelbingSettings()).items() if LAWS[key[0]].is_helbing}
    found = evacuate(cases, Store(tmp_path), Serial())
    times = {key: np.median(faster.leaving_times(runs)) for key, runs in found.items()}
    rubbing, smooth = (np.array([times[name, v] for v in SPEEDS]) for name in ("helbing", "helbing, no friction"))
    soonest = rubbing.argmin()
    assert 1.2 <= SPEEDS[soonest] <= 2.5
    assert times["helbing", 5.0] >= 1.2 * rubbing[soonest]
    assert smooth[-3:].max() < smooth[:-3].min()  # 3 m/s and more against 2 m/s and less
