"""Figures of storeys and stairs: against the sheets that people are on, moment by moment, and none is lost between."""

import numpy as np
import pytest
from storeys import with_stair

from crowd_env import Scenario
from crowd_env.analysis.figures import report
from crowd_env.analysis.plan_check import check_place
from crowd_env.analysis.sections import CrossingRecorder, flows_at, places_of
from crowd_env.analysis.storeys import storeys_of
from crowd_env.envs.rollout import Recorders, run_episodes
from crowd_env.recording import RunRecorder


@pytest.fixture(scope="module", params=[60.0, 9.0])
def house(request):
    """A house of two storeys, all out or cut: its places, the runs with their crossings, and a recording of the first."""
    place = Scenario("house", with_stair(), [{"people": 24, "desired_speed": 1.4}], request.param)
    places = places_of(check_place(place))
    seen = {"sections": CrossingRecorder(places), "recording": RunRecorder()}
    episodes = run_episodes(place, 2, seed=5, recorder=Recorders(**seen))
    recording = episodes[0].record["recording"]
    episodes = [one._replace(crossings=one.record["sections"]) for one in episodes]
    figures = report(place, "nsm2", episodes) | {"sections": flows_at(places, episodes)}
    return place.geometry, places, episodes, recording, figures


def found_in(house):
    geometry, places, episodes, _, figures = house
    return storeys_of(geometry, places, episodes, figures)


def test_counts_are_those_of_the_sheets_that_people_are_on(house):
    geometry, _, episodes, recording, _ = house
    _, _, sheet = recording.places()
    inside = ~recording.beyond
    names = [one.name for one in geometry.building.sheets]
    for stay in found_in(house):
        on = sheet[inside] == names.index(stay.sheet.name)
        count = np.bincount(recording.frame[inside][on], minlength=len(recording.times))
        times, found = stay.counts[0].T
        known = np.append(0, found)[np.searchsorted(times, recording.times, side="right")]
        late = np.append(0, found)[np.searchsorted(times, recording.times - recording.frame_interval, side="right")]
        between = (np.minimum(known, late) <= count) & (count <= np.maximum(known, late))
        assert between[recording.times <= episodes[0].end].mean() > 0.97  # steps to and fro at a seam count once
        assert stay.counts[0][: count[0], 0].max(initial=0.0) == 0.0 < stay.counts[0][count[0], 0]


def test_none_is_lost_between_storeys(house):
    _, _, episodes, _, _ = house
    found = found_in(house)
    assert [one.sheet.name for one in found] == ["upper", "stair", "ground"] and found[1].sheet.middle == pytest.approx(
        1.5
    )
    upper, stair, ground = (one.figures for one in found)
    out = [int(np.isfinite(run.exit_time).sum()) for run in episodes]
    assert sum(one["started"]["mean"] for one in (upper, stair, ground)) == pytest.approx(24)
    assert [sum(one.counts[k][-1, 1] for one in found) for k in (0, 1)] == [24 - number for number in out]
    assert all((count[:, 1] >= 0).all() for one in found for count in one.counts)
    assert set(ground["left"]) == {"exit door", "stair"} and set(upper["left"]) == {"stair"}
    assert ground["left"]["exit door"]["people"] == sum(out)
    for one, onto in ((upper, "stair"), (stair, "ground")):
        stayed = sum(count[-1, 1] for storey in found if storey.figures is one for count in storey.counts)
        came = 2 * one["started"]["mean"] + (upper["left"]["stair"]["people"] if one is stair else 0)
        assert came - one["left"][onto]["people"] == stayed, onto  # nobody goes up
    whole = out == [24, 24]
    assert (ground["empty"]["mean"] is None) == (not whole)
    if whole:
        assert ground["empty"]["mean"] == pytest.approx(np.mean([run.exit_time.max() for run in episodes]))
        assert upper["empty"]["mean"] < stair["empty"]["mean"] < ground["empty"]["mean"]


def test_seams_are_sections_with_the_flow_of_both_ways(house):
    _, _, _, _, figures = house
    flows = figures["sections"]
    assert {"ground – stair", "upper – stair"} <= set(flows)
    assert flows["ground – stair"]["length"] == pytest.approx(1.25)
    assert flows["upper – stair"]["towards"]["to stair"]["people"] > 0
