"""The clogging case: gaps of every draw, blocked ones too, and a tail that is judged for people who press on alone."""

import numpy as np
import pytest

from crowd_env.analysis.clogging import clogging, exits_of_run
from validation.cases import Setting
from validation.cases import clogging as case
from validation.cases.crowds import Moment


def of_gaps(gaps):
    return clogging([exits_of_run(np.cumsum(gaps))])


def test_a_power_law_is_told_from_an_exponential():
    rng = np.random.default_rng(0)
    found = of_gaps(0.2 * (1.0 - rng.random(400)) ** (-1.0 / 2.0))  # p ~ gap^-3
    assert case.met(found)
    assert not case.met(found._replace(tail=found.tail._replace(ratio=-found.tail.ratio)))
    assert not case.met(of_gaps(rng.exponential(0.4, 400)))
    assert not case.met(of_gaps(np.full(20, 0.3)))


@pytest.mark.more
def test_draws_are_watched_until_nobody_gets_out_any_more(monkeypatch):
    """In the first draw half of the people pass, in the second all do."""

    def moments(crowds, limit):
        people, half = crowds.people(1).stop, crowds.people(0).stop // 2
        x = np.full((people, 2), -1.0)
        for k in range(400):
            before, x = x.copy(), x.copy()
            if k < half:
                x[k] = 1.0
                x[crowds.people(1)][2 * k : 2 * k + 2] = 1.0
            here = crowds.simulation.state.active
            yield Moment(0.1 * k, before, here.copy()), Moment(0.1 * (k + 1), x, here.copy())

    monkeypatch.setattr("validation.cases.crowds.Crowds.moments", moments)
    blocked, through = case.exits(Setting("dem", "competitive", draws=2))
    assert len(blocked.time) == 50 and blocked.until == pytest.approx(35.1, abs=0.2)
    assert len(through.time) == 100 and np.isnan(through.until)
    found = clogging([blocked, through], blocked_after=29.0)
    assert found.blocked == 1 and "1 of 2 (9 to 91 %) blocked" in case.told(found, 2)


@pytest.mark.more
def test_only_people_who_press_on_are_judged(monkeypatch, tmp_path):
    rng = np.random.default_rng(0)
    runs = [exits_of_run(np.cumsum(rng.pareto(2.0, 100) + 0.2)), exits_of_run([1.0, 2.0, np.nan], 40.0)]
    monkeypatch.setattr(case, "exits", lambda setting: runs)
    (pressing,), (calm,) = (case.run(Setting("dem", manner)) for manner in ("competitive", "calm"))
    assert pressing.passed is not None and calm.passed is None
    assert "1 of 2 (9 to 91 %) blocked" in pressing.figure and pressing.more["until"] == [None, 40.0]
    case.draw(tmp_path, [pressing, calm])
    for manner in ("competitive", "calm"):
        assert (tmp_path / f"clogging-{manner}.png").read_bytes().startswith(b"\x89PNG")
