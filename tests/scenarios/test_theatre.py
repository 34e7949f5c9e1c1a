"""The synthetic movie theatre: its plan, who sits where, stairs and control rules, and Table 7 and Figure 6 on it."""

import csv
import json
from itertools import combinations

import numpy as np
import pytest
from typer.testing import CliRunner

from crowd_env.cli.reproduce import app
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.reproduce import REPRODUCTIONS, Settings, fig6, table7, theatre
from crowd_env.reproduce.pecol2011.theatre import SCHEME, Egress, evacuate
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.population import Population, Uniform
from crowd_env.scenarios.shipped.theatre import SEATS_A_ROW, plan, seats, taken_seats

THEATRE = make_scenario("theatre-v0")
WAYS = THEATRE.route_set()
STAND_STILL = Uniform(1e3, 1e3)


def nothing(count):
    """Report progress to nobody."""


def node(name, at):
    """Return the way of this name, and its node nearest to each of the places (K, 2)."""
    field = WAYS.routes[WAYS.number(name)].field
    j, i = np.rint((np.atleast_2d(at) - field.origin) / field.spacing).astype(int).T
    return field, (i, j)


def distance(name, at):
    field, there = node(name, at)
    return field.travel_time[there]


def leads_through(name, at, region):
    field, there = node(name, at)
    return (field.through[there] >> list(THEATRE.geometry.regions).index(region)) & 1 == 1


# ------------------------------------------------------------------------------------------------------------ the plan


def test_there_are_174_seats_and_101_people_on_seats_of_their_own():
    everything, starts = seats(), THEATRE.population.starts
    assert everything.shape == (174, 2) and len(np.unique(everything, axis=0)) == 174
    assert starts.shape == (101, 2) and len(np.unique(starts, axis=0)) == 101
    assert {tuple(place) for place in starts} <= {tuple(place) for place in everything}
    taken = taken_seats(101)
    assert min(taken) >= 4 * SEATS_A_ROW  # nobody in front
    assert max(np.diff(taken)) == 2  # no two empty seats side by side: spread evenly
    assert taken == taken_seats(101)


def test_other_numbers_of_people_have_seats_too():
    for count in (1, 40, 126, 127, 174):
        assert len(set(taken_seats(count))) == count == make_scenario("theatre-v0", count=count).population.count
    assert max(np.diff(taken_seats(150))) == 2 and min(taken_seats(150)) < SEATS_A_ROW  # over all rows
    for count in (0, 175):
        with pytest.raises(ValueError, match=rf"count is {count}; it must be 1 to 174: the number of seats"):
            make_scenario("theatre-v0", count=count)


def test_the_largest_bodies_fit_on_all_seats():
    everyone = Population(174, radius=Uniform(0.25, 0.25), starts=seats())
    everyone.draw(np.random.default_rng(0), plan())
    assert plan().clearance(seats()).min() >= 0.25
    gaps = [np.hypot(*(a - b)) for a, b in combinations(seats(), 2)]
    assert min(gaps) == pytest.approx(0.55)


def test_people_who_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="starts 0 and 1 overlap"):
        Population(174, radius=Uniform(0.28, 0.28), starts=seats()).draw(np.random.default_rng(0), plan())
    with pytest.raises(ValueError, match="from a wall"):
        Population(174, radius=Uniform(0.31, 0.31), starts=seats()).draw(np.random.default_rng(0), plan())


def test_every_seat_reaches_both_exits_by_the_end_of_its_row():
    x, y = seats().T
    a, b = distance("A", seats()), distance("B", seats())
    assert np.isfinite(a).all() and np.isfinite(b).all()
    # Nobody climbs: along the row to an aisle (its upper end is the nearer one for A at y = 4.5, the lower one for B).
    along = np.minimum(y - 1.2, 7.8 - y)
    assert (b > (y - 1.2) + (x - 4.0)).all()
    before_last = np.arange(174) < 168
    assert (a > along + (19.75 - x))[before_last].all()
    shortest = distance("out", seats())
    np.testing.assert_allclose(shortest, np.minimum(a, b), atol=0.05)


def test_the_shortest_ways_part_the_audience_about_as_the_paper_implies():
    starts = THEATRE.population.starts
    by_a = int((distance("A", starts) < distance("B", starts)).sum())
    assert (by_a, 101 - by_a) == (44, 57)
    assert abs(by_a - theatre.IMPLIED["people by A"][0]) <= 2


def test_rectangles_lie_inside_and_on_the_ways_that_they_guard():
    geometry, starts = THEATRE.geometry, THEATRE.population.starts
    for rule in THEATRE.rules:
        region = geometry.regions[rule.region]
        assert geometry.walkable.buffer(1e-9).covers(region)
        assert rule.at_least / region.area == pytest.approx(2.0, abs=0.02)  # people per m2
    for one, other in combinations("123", 2):
        assert not geometry.regions[one].intersects(geometry.regions[other])
    for stairs, part in (("upper aisle", "1"), ("lower aisle", "2")):
        assert geometry.regions[stairs].buffer(1e-9).covers(geometry.regions[part])
    assert leads_through("B", starts, "3").all()
    by_a = starts[distance("A", starts) < distance("B", starts)]
    guarded = leads_through("A", by_a, "1") ^ leads_through("A", by_a, "2")
    last_row = by_a[:, 0] > 18.6
    assert guarded[~last_row].all() and not leads_through("A", by_a, "3").any()


def test_crowded_numbers_are_checked():
    with pytest.raises(ValueError, match=r"crowded is .* three numbers of people"):
        make_scenario("theatre-v0", crowded=(5, 5))
    with pytest.raises(ValueError, match=r"crowded\[0\] is 0; it must be at least 1"):
        make_scenario("theatre-v0", crowded=(0, 5, 15))


# -------------------------------------------------------------------------------------------------- stairs and rules


def people_at(starts, response_time):
    speed = Uniform(1.6, 1.6)
    return Population(len(starts), desired_speed=speed, starts=np.array(starts, float), response_time=response_time)


def test_stairs_slow_everybody_to_half_a_meter_per_second():
    places = [(15.0, 0.6), (15.0, 8.4), (8.0, -1.1), (3.0, 5.0), (15.0, 10.0), (10.6, 4.5)]
    place = make_scenario("theatre-v0", population=people_at(places, Uniform(0.0, 0.0)))
    env = CrowdEnv(place, rules=False)
    env.reset(seed=0)
    while env.simulation.state.time[0] < 1.2:
        env.step(None)
    speed = np.hypot(*env.simulation.state.velocity.T)
    np.testing.assert_allclose(speed[:3], 0.5, atol=0.03)
    np.testing.assert_allclose(speed[3:], 1.6, atol=0.1)


def followed_routes(starts, **options):
    """Return the name of the way that each of those who stand at ``starts`` would take now."""
    place = make_scenario("theatre-v0", population=people_at(starts, STAND_STILL), **options)
    env = CrowdEnv(place)
    env.reset(seed=0)
    env.step(None)
    return [env.route_set[0].routes[k].name for k in env.simulation.history.followed]


UPPER = [(18.0 + 0.55 * (k // 2), 8.1 + 0.6 * (k % 2)) for k in range(6)]  # in rectangle 1
LOWER = [(x, 9.0 - y) for x, y in UPPER]  # in rectangle 2
FLOOR = [(0.4 + 0.55 * (k % 5), 0.4 + 0.6 * (k // 5)) for k in range(15)]  # in rectangle 3
ELSEWHERE = {
    "below 1": (15.0, 8.4),
    "below 2": (17.0, 0.6),
    "behind": (20.4, 6.5),
    "in front": (5.0, 0.6),
}


def with_others(crowd, **options):
    route_set = followed_routes([*crowd, *ELSEWHERE.values()], **options)
    return route_set[: len(crowd)], dict(zip(ELSEWHERE, route_set[len(crowd) :], strict=True))


@pytest.mark.parametrize(("crowd", "least", "turned", "to"), [
    (UPPER, 5, {"below 1"}, "B"),
    (LOWER, 5, {"below 2"}, "B"),
    (FLOOR, 15, {"in front"}, "A"),
])  # fmt: skip
def test_a_rule_turns_away_those_elsewhere_whose_way_leads_through(crowd, least, turned, to):
    for count in (least - 1, least):
        inside, others = with_others(crowd[:count])
        assert inside == ["out"] * count  # whoever is in there goes on
        expected = dict.fromkeys(ELSEWHERE, "out") | (dict.fromkeys(turned, to) if count >= least else {})
        assert others == expected, count


def test_other_thresholds():
    assert with_others(UPPER[:2], crowded=(2, 5, 15))[1]["below 1"] == "B"
    assert with_others(UPPER[:6], crowded=(7, 5, 15))[1]["below 1"] == "out"


def exits_of(options, rules=True):
    env = CrowdEnv("theatre-v0", scheme=SCHEME, rules=rules, time_limit=14.0, **options)
    env.reset(seed=0)
    while not env.finished.all():
        env.step(None)
    return env.simulation.state.exit_time.copy(), env.simulation.state.position.copy()


def test_rules_that_are_never_on_change_nothing():
    for one, other in zip(exits_of({"crowded": (500, 500, 500)}), exits_of({}, rules=False), strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(exits_of({})[1], exits_of({}, rules=False)[1])


@pytest.mark.parametrize("scheme", [SCHEME, "nsm2", "dem"], ids=["reproduction", "nsm2", "dem"])
def test_everybody_gets_out(scheme):
    env = CrowdEnv("theatre-v0", num_envs=2, scheme=scheme)
    env.reset([5, 6])
    while not env.finished.all():
        env.step(None)
    for e in range(2):
        metrics = env.metrics(e)
        assert metrics.unfinished == 0 and 40.0 < metrics.evacuation_time < 100.0
    names = np.array(THEATRE.geometry.exit_names)[env.simulation.state.exit_index]
    assert 30 * 2 < (names == "A").sum() < 55 * 2


# -------------------------------------------------------------------------------------- Table 7 and Figure 6


def invented(runs, shift=0.0, by_a=42, lost=0):
    """Return evacuations in which A is left every second from 20 s on, and B every half second from 40 s on."""
    times = np.concatenate([20.0 + np.arange(by_a), 40.0 + 0.5 * np.arange(101 - by_a)]) + shift
    time = np.tile(times, (runs, 1)) + 0.1 * np.arange(runs)[:, None]
    route = np.tile(np.repeat([0, 1], [by_a, 101 - by_a]), (runs, 1))
    time[0, :lost], route[0, :lost] = np.nan, -1
    return Egress(time, route, np.tile([4.0, 2.0, 0.0], (runs, 1)), np.full(runs, 30))


@pytest.fixture
def scripted(monkeypatch):
    """Let evacuations be invented: with rules everything is 2 s later and two people more take B."""

    def instead(settings, rules, progress):
        progress(settings.runs)
        return invented(settings.runs, 2.0, 40) if rules else invented(settings.runs)

    monkeypatch.setattr(table7, "evacuate", instead)
    monkeypatch.setattr(fig6, "evacuate", instead)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def told(line):
    result = CliRunner().invoke(app, line.split())
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_quantities_of_an_evacuation():
    done = invented(2)
    found = done.quantities
    assert found["last, A"] == pytest.approx([61.0, 61.1]) and found["mean, A"] == pytest.approx([40.5, 40.6])
    assert found["last, B"] == pytest.approx([69.0, 69.1]) and found["mean, B"] == pytest.approx([54.5, 54.6])
    assert found["last, all"] == pytest.approx([69.0, 69.1])
    assert found["mean, all"] == pytest.approx((42 * np.array([40.5, 40.6]) + 59 * np.array([54.5, 54.6])) / 101)
    assert (found["people by A"] == 42).all() and (found["people by B"] == 59).all()


def test_whoever_is_left_inside_is_told_and_spoils_no_mean():
    done = invented(2, lost=3)
    assert done.unfinished == 3
    assert np.isnan(done.quantities["last, all"][0]) and done.quantities["last, all"][1] == pytest.approx(69.1)
    assert done.quantities["mean, A"][0] == pytest.approx(np.mean(20.0 + np.arange(3, 42)))
    nobody = Egress(np.full((2, 5), np.nan), np.full((2, 5), -1), np.zeros((2, 3)), np.zeros(2, dtype=int))
    assert all(np.isnan(values).all() for name, values in nobody.quantities.items() if not name.startswith("people"))


def test_the_implied_split_follows_from_the_printed_means():
    for k in (0, 1):
        a, b, everyone = (float(theatre.PRINTED[f"mean, {name}"][k]) for name in ("A", "B", "all"))
        by_a, by_b = (theatre.IMPLIED[f"people by {name}"][k] for name in "AB")
        assert by_a + by_b == 101
        assert (by_a * a + by_b * b) / 101 == pytest.approx(everyone, abs=0.06)


def test_table_7_stands_beside_the_paper_and_says_what_rules_change(scripted, folder):
    object = told("table7 --runs 4 --json")
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
    for words in ("SYNTHETIC", "an illustration, not a validation", "last, B +3.00 s", "lengthen", "Draws 0 to 3"):
        assert words in text
    assert (folder / "reproduce/table7.png").read_bytes()[:4] == b"\x89PNG"
    with (folder / "reproduce/table7-exit-times.csv").open(newline="") as file:
        raw = list(csv.DictReader(file))
    assert len(raw) == 2 * 4 * 101 and {row["route"] for row in raw} == {"A", "B"}


def test_no_difference_is_a_result_too(monkeypatch, folder):
    monkeypatch.setattr(table7, "evacuate", lambda settings, rules, progress: invented(settings.runs))
    text = " ".join(table7.reproduce(Settings(runs=3), nothing).remarks)
    assert "change (mean of the draws, 95 % interval): nothing." in text and "do not shorten" in text
    text = " ".join(table7.reproduce(Settings(runs=1), nothing).remarks)
    assert "One draw says nothing" in text


def test_rules_that_help_are_said_to(monkeypatch):
    monkeypatch.setattr(table7, "evacuate", lambda s, rules, progress: invented(s.runs, -3.0 if rules else 0.0))
    assert "they shorten the evacuation" in " ".join(table7.reproduce(Settings(runs=3), nothing).remarks)


def test_figure_6_draws_what_table_7_tells_of_the_exercise(scripted, folder):
    object = told("fig6 --runs 3 --seed 2 --json")
    rows = {row["quantity"]: row for row in object["rows"]}
    assert rows["first person out"]["here"] == pytest.approx(22.1)
    assert rows["51 people out"]["n"] == 3 and rows["last, all"]["paper"] == 62.0
    assert "curve is not printed" in " ".join(object["remarks"])
    assert (folder / "reproduce/fig6.png").read_bytes()[:4] == b"\x89PNG"


def test_a_hundred_runs_are_the_default(scripted, folder):
    assert {row["n"] for row in told("table7 --json")["rows"] if row["unit"] == "s"} == {100}
    assert REPRODUCTIONS["table5"].runs == 50


def test_both_rest_on_the_same_draws_which_are_those_of_the_run_command(monkeypatch):
    monkeypatch.setattr(theatre, "_made", {})
    settings, counts = Settings(runs=1, seed=3), []
    ruled = evacuate(settings, True, counts.append)
    assert evacuate(settings, True, counts.append) is ruled and sum(counts) == 2
    env = CrowdEnv("theatre-v0", scheme=SCHEME)
    env.reset([3])
    while not env.finished.all():
        env.step(None)
    np.testing.assert_array_equal(ruled.time.ravel(), env.simulation.state.exit_time)
    free = evacuate(settings, False, counts.append)
    assert sum(counts) == 3 and free.ruled.sum() == 0 and free.turned.sum() == 0
    assert not np.array_equal(free.time, ruled.time)
    assert (ruled.turned > 5).all() and (ruled.ruled[:, 0] > 1.0).all()
    for done in (ruled, free):
        assert done.unfinished == 0 and done.quantities["people by A"] == pytest.approx([43], abs=6)


@pytest.mark.slow
def test_table_7_comes_out_in_its_order_of_magnitude(folder):
    rows = {row["quantity"]: row for row in told("table7 --runs 20 --json")["rows"]}
    for name, (exercise, _) in theatre.PRINTED.items():
        assert rows[name]["here"] == pytest.approx(float(exercise), rel=0.2), name
    assert rows["left inside"]["here"] == rows["left inside, no rules"]["here"] == 0
    low, _ = rows["mean, all: rules change it by"]["ci95"]
    assert low > 0.0  # rules make people wait and walk further
