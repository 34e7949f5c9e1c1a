"""Results where people come in during a run: of the ones that came."""

import numpy as np
import pytest

from crowd_env import Geometry, Scenario
from crowd_env.analysis.figures import cells, report
from crowd_env.analysis.results.folder import decode, egress, encode, write_tables
from crowd_env.envs.rollout import run_episodes
from crowd_env.geometry.geometry import box

HALL = Geometry.from_polygon(box(0, 0, 5, 3), exits={"east": [(5, 0.5), (5, 2.5)]})
COME = {"arrivals": {"rate": 2.0, "until": 4.0, "line": [(0, 0.5), (0, 2.5)]}}
PLACE = Scenario("hall", HALL, [{"people": 2}, COME], time_limit=60.0)


def test_figures_tables_and_curves_are_of_the_people_that_came(tmp_path):
    episodes = run_episodes(PLACE, 3)
    came = [int(one.came.sum()) for one in episodes]
    assert len(set(came)) > 1
    assert max(came) < PLACE.population.people
    figures = report(PLACE, "nsm2", episodes)
    assert figures["came"]["mean"] == pytest.approx(np.mean(came))
    assert figures["turned_away"] == [0, 0, 0]
    assert figures["t95"]["mean"] is not None
    assert "people who came" in cells(PLACE, figures)
    again = decode(1, encode(episodes[1]))
    np.testing.assert_array_equal(again.entry_time, episodes[1].entry_time)
    runs, exits = (path.read_text().splitlines() for path in write_tables(tmp_path, PLACE, episodes))
    assert [int(row.split(",")[2]) for row in runs[1:]] == came
    assert len(exits) == 1 + sum(came)
    curve = egress([one.exit_time[one.came] for one in episodes], [one.entries for one in episodes])
    assert curve.mean[0] == 2.0
    assert curve.mean[-1] == 0.0


def test_people_that_could_not_enter_are_named():
    shut = Geometry.from_polygon(
        box(0, 0, 2, 1), exits={"east": [(2, 0), (2, 1)]}, doors={"door": [(1.5, 0), (1.5, 1)]}
    )
    come = {"arrivals": {"timetable": [[1, 30]], "line": [(0, 0.2), (0, 0.8)]}}
    with pytest.warns(UserWarning, match="people wait there"):
        (episode,) = run_episodes(Scenario("shut", shut, come, time_limit=5.0, closed_doors=("door",)), 1)
    assert 0 < episode.turned_away < 30
    assert episode.metrics.unfinished == 30
    figures = report(Scenario("shut", shut, come, time_limit=5.0), "nsm2", [episode])
    assert f"{episode.turned_away} people" in cells(PLACE, figures)["  could not enter"]
