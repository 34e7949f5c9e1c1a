"""Buildings: what stairs are made of, where floor is cut out, speeds of the handbook, refusals in a sentence, ways out."""

import math
import tomllib
import warnings
from dataclasses import replace

import numpy as np
import pytest
import shapely
from cases import looped
from repository import ROOT
from shapely.geometry import box

from crowd_env import Simulation, make_scenario
from crowd_env.core.arrays.state import make_state
from crowd_env.geometry.placement import sample_positions
from crowd_env.geometry.surface import heights
from crowd_env.scenarios.buildings import HEADROOM, SLAB, Level, Ramp, Stair, building, speed_on_stairs
from crowd_env.scenarios.project import project_text

OFFICE = ROOT / "examples" / "office-building.toml"
FLOOR = box(0, 0, 20, 10)
LOW = Level("low", 0.0, FLOOR, exits={"street": [[0, 4], [0, 6]]})
HIGH = Level("high", 3.15, FLOOR)
STAIR = Stair("stair", "low", "high", (8, 5), 0)
KINDS = {
    "straight": STAIR,
    "with a landing": replace(STAIR, landing=1.5),
    "u-left": replace(STAIR, turns="u-left"),
    "u-right": replace(STAIR, turns="u-right"),
    "with a wall": replace(STAIR, turns="u-left", core=0.0),
    "odd": replace(STAIR, turns="u-right", riser=0.185),
    "turned": replace(STAIR, foot=(8, 4), direction=33.0),
    "turned back": replace(STAIR, foot=(12, 6), direction=-120.0, turns="u-left", landing=1.0),
    "ramp": Ramp("ramp", "low", "high", (5, 5), 0, 12.0, 1.5),
}


def two_levels(way):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return building([LOW, HIGH], *([way], []) if isinstance(way, Stair) else ([], [way]))


@looped("kind", KINDS)
def test_a_stair_has_the_area_of_its_flights_and_landing(kind):
    way, (_, _, sheet) = KINDS[kind], two_levels(KINDS[kind]).building.sheets
    if isinstance(way, Ramp):
        assert sheet.area.area == pytest.approx(way.length * way.width)
        return
    steps = way.steps(3.15)
    assert sum(steps.flights) * steps.riser == pytest.approx(3.15) and abs(steps.riser - way.riser) < 0.01
    depth = (way.landing or 0.0) if way.turns == "straight" else way.landing or way.width
    across = way.width if way.turns == "straight" else 2 * way.width + (way.core or 0.02)
    assert sheet.area.area == pytest.approx(sum(steps.flights) * way.tread * way.width + depth * across)


@looped("kind", KINDS)
def test_seams_lie_at_the_heights_of_both_levels(kind):
    place = two_levels(KINDS[kind])
    surface, seams = place.surface, place.building.seams
    assert len(seams) == 2 and len(place.building.lines) == 4
    for seam, level in zip(seams, (0.0, 3.15), strict=True):
        assert np.hypot(*(seam.line[1] - seam.line[0])) == pytest.approx(KINDS[kind].width)
        for side in (seam.left, seam.right):
            assert heights(surface, np.full(2, side), seam.line) == pytest.approx(level)


@looped("kind", KINDS)
def test_floor_lies_where_there_is_headroom_and_nowhere_else(kind):
    place = two_levels(KINDS[kind])
    low, high, stair = place.building.sheets
    rng, surface = np.random.default_rng(0), place.surface
    points = rng.random((4000, 2)) * (20, 10)
    on = points[shapely.intersects_xy(stair.area, *points.T)]
    z = heights(surface, np.full(len(on), 2), on)
    for level in (low, high):
        apart = np.abs(z - level.level)
        floor = shapely.intersects_xy(level.area, *on.T)
        clear = np.abs(apart - HEADROOM - SLAB) > 1e-3
        assert (floor == (apart > HEADROOM + SLAB))[clear].all()
    off = points[shapely.distance(stair.area, shapely.points(points)) > 0.3]
    assert shapely.intersects_xy(low.area, *off.T).all() and shapely.intersects_xy(high.area, *off.T).all()


@looped(
    ("riser", "tread", "share"), [(0.165, 0.305, 1.17), (0.178, 0.279, 1.08), (0.18, 0.28, 1.08), (0.19, 0.254, 1.0)]
)
def test_speeds_on_stairs_are_those_of_the_handbook(riser, tread, share):
    assert speed_on_stairs(riser, tread) == pytest.approx(share / 1.40, rel=0.01)
    high = replace(HIGH, height=16 * riser)
    place = building([LOW, high], [replace(STAIR, riser=riser, tread=tread, turns="u-left")])
    surface = place.surface
    assert surface.up == pytest.approx(share / 1.40, rel=0.01) and (surface.up == surface.down).all()
    assert len(np.unique(np.round(surface.plane, 9), axis=0)) == 3  # the landing too
    assert math.atan(np.hypot(*surface.plane[:, :2].T).max()) == pytest.approx(math.atan(riser / tread))


def test_other_speeds_may_be_given_and_ramps_are_walked_as_level_floor():
    place = two_levels(replace(STAIR, up=0.4, down=0.6))
    assert (place.surface.up == 0.4).all() and (place.surface.down == 0.6).all()
    assert (two_levels(KINDS["ramp"]).surface.up == 1.0).all()
    assert speed_on_stairs(0.1, 0.5) == 1.0  # flat steps make no one faster


def test_a_note_gives_risers_that_are_not_as_given():
    with pytest.warns(
        UserWarning, match=r"stair 'stair': 17 risers of 185.3 mm, treads of 280 mm, 33.5 degrees, for a hei"
    ):
        building([LOW, HIGH], [replace(STAIR, riser=0.19)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        building([LOW, HIGH], [STAIR])


def test_a_ramp_that_does_not_rise_makes_one_floor_of_two_wings():
    place = building(
        [LOW, Level("wing", 0.0, box(24, 0, 40, 10))], ramps=[Ramp("bridge", "low", "wing", (20, 5), 0, 4.0)]
    )
    (floor,) = place.building.sheets
    assert floor.level == 0.0 and not floor.slopes and floor.area.area == pytest.approx(200.0 + 160.0 + 8.0)
    assert place.regions["wing"].area == pytest.approx(160.0) and place.regions["bridge"].area == pytest.approx(8.0)
    with pytest.raises(ValueError, match="the upper level must be higher"):
        building([LOW, Level("wing", 0.0, box(24, 0, 40, 10))], [Stair("steps", "low", "wing", (20, 5), 0)])


def test_names_of_levels_and_stairs_are_regions_unless_taken():
    low = replace(LOW, regions={"high": box(1, 1, 3, 3)}, obstacles=[box(15, 8, 16, 9)])
    place = building([low, HIGH], [STAIR])
    assert set(place.regions) == {"low", "high", "stair"}
    assert place.area_of("high") == pytest.approx(4.0)
    assert place.area_of("low") == pytest.approx(place.building.sheets[0].area.area)
    assert place.building.sheets[0].area.area == pytest.approx(200.0 - 1.0 - 1.2 * 2.3 / 0.625, abs=1e-3)


def test_each_level_keeps_its_exits_doors_walls_and_regions():
    high = replace(
        HIGH,
        exits={"terrace": box(19, 0, 20, 2)},
        regions={"desk": box(1, 1, 3, 3)},
        doors={"gate": [[4, 0], [4, 2]], "terrace door": "terrace"},
        thin_walls=[[[4, 2], [4, 10]]],
    )
    place = building([LOW, high], [STAIR])
    assert dict.fromkeys(place.exit_names) == dict.fromkeys(["street", "terrace"])
    assert place.exit_lengths == pytest.approx({"street": 2.0, "terrace": 3.0})
    assert place.doors == ("gate", "terrace door") and place.exits_of_door == (None, "terrace")
    true, sheet = place.on_sheets(np.asarray(place.regions["desk"].centroid.coords[0]))
    assert sheet == 1 and true == pytest.approx((2.0, 2.0))
    assert place.building.sheets[1].area.area == pytest.approx(198.0 - 1.2 * 2.3 / 0.625, abs=1e-3)
    thin, sheet = place.on_sheets(place.walls[place.two_sided & (place.door_of_wall < 0)])
    assert (sheet == 1).all() and thin.reshape(-1, 2) == pytest.approx(np.array([[4, 2], [4, 10]]))


def test_a_stair_may_stand_outside_of_its_levels_and_pass_others():
    half = Level("half", 3.0, box(8, 0, 20, 10))
    top = Level("top", 6.3, box(0, 0, 20, 10))
    outside = Stair("escape", "low", "top", (20, 5), 0, turns="u-right")
    inner = Stair("inner", "low", "half", (9, 5), 0, riser=0.1765)
    place = building([LOW, half, top], [outside, replace(inner, riser=3.0 / 17)])
    assert [sheet.area.area for sheet in place.building.sheets[:3]][2] == pytest.approx(200.0)
    with_stair = building(
        [LOW, half, top], [replace(outside, foot=(9, 5)), replace(inner, foot=(9, 9), riser=3.0 / 17)]
    )
    cut = box(8, 0, 20, 10).difference(with_stair.building.sheets[1].area).area
    assert cut > 10.0  # where the stair passes the level


REFUSED = {
    "no level": (lambda: building([]), "needs at least one level"),
    "height": (lambda: replace(LOW, height=float("nan")), r"level 'low': height is nan; it must be finite"),
    "name": (lambda: replace(LOW, name=""), "level: name is ''"),
    "exits": (lambda: replace(LOW, exits=[[[0, 4], [0, 6]]]), "level 'low': exits is .* a table of names and shapes"),
    "unknown level": (
        lambda: two_levels(replace(STAIR, upper="roof")),
        "unknown level 'roof'; known: low, high",
    ),
    "upside down": (
        lambda: two_levels(replace(STAIR, lower="high", upper="low")),
        r"climbs from 'high' at 3.15 m to 'low' at 0 m; the upper level must be higher",
    ),
    "equal": (
        lambda: two_levels(replace(STAIR, upper="low")),
        "at 0 m to 'low' at 0 m; the upper level must be higher",
    ),
    "foot": (
        lambda: two_levels(replace(STAIR, foot=(30, 5))),
        "level 'low': the foot of stair 'stair' misses its floor",
    ),
    "foot in a corner": (
        lambda: two_levels(replace(STAIR, foot=(8, 9.9))),
        "the foot of stair 'stair' misses its floor",
    ),
    "head": (
        lambda: two_levels(replace(STAIR, foot=(16, 5))),
        "level 'high': the head of stair 'stair' misses its floor",
    ),
    "point": (lambda: replace(STAIR, foot=(1.0,)), r"stair 'stair': foot is \(1.0,\); it must be \[x, y\] in m"),
    "no way out": (lambda: building([LOW, HIGH]), "level 'high' has no way out: it has no exit, and no stair or ramp"),
    "no exit": (
        lambda: building([replace(LOW, exits={}), HIGH], [STAIR]),
        "level 'low' has no way out",
    ),
    "riser": (lambda: replace(STAIR, riser=0.3), r"stair 'stair': riser is 0.3; it must be in \[0.1, 0.25\]"),
    "tread": (lambda: replace(STAIR, tread=0.1), r"stair 'stair': tread is 0.1; it must be in \[0.2, 0.5\]"),
    "rise": (
        lambda: building([LOW, replace(HIGH, height=0.05, walkable=box(13, 0, 20, 10))], [STAIR]),
        r"climbs 0.05 m by 1 risers of 0.05 m; they must be in \[0.1, 0.25\] m",
    ),
    "width": (lambda: replace(STAIR, width=0.2), r"stair 'stair': width is 0.2; it must be in \[0.5, 50\]"),
    "turns": (lambda: replace(STAIR, turns="left"), "unknown turns 'left'; known: straight, u-left, u-right"),
    "landing": (lambda: replace(STAIR, turns="u-left", landing=0.1), "landing is 0.1 m; people turn on 0.5 m or more"),
    "core": (lambda: replace(STAIR, core=-1.0), "stair 'stair': core is -1.0"),
    "speed": (lambda: replace(STAIR, up=0.0), "stair 'stair': up is 0.0"),
    "steep": (
        lambda: two_levels(replace(KINDS["ramp"], length=4.0)),
        "ramp 'ramp' climbs 3.15 m over 4 m; .* 6.3 m long",
    ),
    "overlap": (
        lambda: building([LOW, HIGH], [STAIR, replace(STAIR, name="other", foot=(8, 5.5))]),
        r"stair 'stair' and stair 'other' overlap at \(.*\); they must lie beside each other, or 2.3 m one above",
    ),
    "levels": (
        lambda: building([LOW, replace(HIGH, height=1.0)], [replace(STAIR, riser=0.2)]),
        r"levels 'low' and 'high' overlap at \(.*\) with 1 m between them",
    ),
    "same name": (lambda: building([LOW, LOW]), "level 'low': a level, stair or ramp before has this name"),
    "name of a level": (
        lambda: two_levels(replace(STAIR, name="low")),
        "stair or ramp 'low': a level, stair or ramp before",
    ),
    "same exit": (
        lambda: building([LOW, replace(HIGH, exits=LOW.exits)], [STAIR]),
        "levels 'low' and 'high' both have 'street' among their exits; names must be unique in a building",
    ),
    "exit of a level": (
        lambda: building([LOW, replace(HIGH, exits={"away": [[50, 0], [50, 1]]})], [STAIR]),
        "level 'high': exit 'away' is not on the boundary",
    ),
}


@looped("what", REFUSED)
def test_what_makes_no_building_is_refused_in_a_sentence(what):
    make, words = REFUSED[what]
    with pytest.raises(ValueError, match=words) as found:
        make()
    assert "\n" not in str(found.value)


PLAIN = {
    "levels": [
        {"name": "low", "height": 0, "walkable": {"box": [0, 0, 20, 10]}, "exits": {"street": [[0, 4], [0, 6]]}},
        {"name": "high", "height": 3.15, "walkable": {"box": [0, 0, 20, 10]}},
    ],
    "stairs": [{"name": "stair", "lower": "low", "upper": "high", "foot": [8, 5], "direction": 0}],
    "population": {"people": 5, "start_region": "high"},
}


def lines_of(place):
    return shapely.multilinestrings(list(np.concatenate([place.walls, place.exits, place.building.lines])))


def read(tmp_path, **changes):
    (tmp_path / "house.toml").write_text(project_text({**PLAIN, **changes}))
    return make_scenario(tmp_path / "house.toml")


def test_a_file_makes_the_same_building_as_python(tmp_path):
    place = read(tmp_path).geometry
    other = building([LOW, HIGH], [STAIR])
    assert shapely.equals(place.walkable, other.walkable) and shapely.equals(*map(lines_of, (place, other)))
    assert [sheet.name for sheet in place.building.sheets] == ["low", "high", "stair"]


def test_the_text_of_a_building_makes_it_again():
    content = tomllib.loads(OFFICE.read_text())
    assert tomllib.loads(project_text(content)) == content


def test_a_level_may_be_a_drawing(tmp_path):
    (tmp_path / "high.wkt").write_text("POLYGON ((0 0, 20 0, 20 10, 0 10, 0 0))")
    levels = [PLAIN["levels"][0], {"name": "high", "height": 3.15, "file": "high.wkt"}]
    assert shapely.equals(read(tmp_path, levels=levels).geometry.walkable, building([LOW, HIGH], [STAIR]).walkable)


def test_places_in_a_file_name_their_level(tmp_path):
    people = {"starts": [[2, 2], [4, 2]], "level": "high"}
    lines = [{"name": "line", "line": [[5, 0], [5, 10]], "level": "high"}]
    pulls = {"attractions": [{"x": 3, "y": 3, "strength": 1, "level": "high"}]}
    place = read(tmp_path, population=people, sections=lines, pulls=pulls)
    _, position = place.population.draw(np.random.default_rng(0), place.geometry)
    true, sheet = place.geometry.on_sheets(position)
    assert (sheet == 1).all() and true == pytest.approx(np.array([[2, 2], [4, 2]]))
    true, sheet = place.geometry.on_sheets(np.array(place.sections[0].line))
    assert (sheet == 1).all() and true == pytest.approx(np.array([[5, 0], [5, 10]]))
    (there,) = place.pulls.attractions
    assert place.geometry.on_sheets(np.array([there.x, there.y]))[0] == pytest.approx((3, 3))


@looped(
    ("changes", "words"),
    [
        ({"geometry": {}}, "geometry and levels: the plan of a building stands in its levels"),
        ({"levels": None}, "key 'levels' is missing"),
        ({"levels": {"name": "low"}}, r"levels must be a list of tables: \[\[levels\]\]"),
        ({"levels": [{"name": "low", "height": 0}]}, "level 'low': key 'walkable' is missing"),
        ({"levels": [{"height": 0}]}, r"levels\[0\]: key 'name' is missing"),
        ({"levels": [{**PLAIN["levels"][0], "jamb_radius": 0.1}]}, "level 'low': jamb_radius is 0.1; .* sharp: 0"),
        ({"stairs": [{**PLAIN["stairs"][0], "treads": 3}]}, r"stairs\[0\]: unknown key 'treads'; known: name, lower"),
        ({"levels": [{**PLAIN["levels"][0], "walkable": {"box": [0, 0]}}]}, "level 'low'.walkable: it must be a box"),
        ({"population": {"starts": [[2, 2]]}}, "key 'level' is missing; in a building it names the level"),
        ({"population": {"starts": [[2, 2]], "level": "roof"}}, "unknown level 'roof'; known: low, high, stair"),
        (
            {"population": {"people": 2, "level": "high"}},
            "level is for starts and lines of arrivals; start_region names",
        ),
        ({"sections": [{"name": "a", "line": [[5, 0], [5, 10]]}]}, r"sections\[0\]: key 'level' is missing"),
    ],
)
def test_mistakes_in_a_file_are_named_by_their_place(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words) as found:
        read(tmp_path, **changes)
    assert "house.toml: " in str(found.value) and "\n" not in str(found.value)


@pytest.mark.more
def test_all_people_of_the_office_get_out_over_its_stairs():
    place = make_scenario(OFFICE)
    bodies, position = place.population.draw(np.random.default_rng(0), place.geometry, place.room)
    start, sheet = place.geometry.on_sheets(position)
    assert np.bincount(sheet, minlength=7).tolist() == [40, 80, 80, 0, 0, 0, 0]
    state = make_state(start, sheet=sheet)
    run = Simulation(place.geometry, bodies, state, physics="nsm2", walking="hurried")
    passed = np.zeros(7, dtype=int)
    while state.active.any() and state.time < place.time_limit:
        run.advance(n_substeps=round(1.0 / run.dt))
        passed = np.maximum(passed, np.bincount(state.sheet[state.active], minlength=7))
    assert not state.active.any() and not run.escaped.any()
    assert (passed[3:] > 0).all()  # each stair was used


def test_seams_lie_apart_from_people_at_the_start():
    place = two_levels(STAIR)
    radius = np.full(150, 0.2)
    position = sample_positions(place, radius, np.random.default_rng(0))
    assert place.contains(position).all()
    away = shapely.distance(shapely.multilinestrings(list(place.building.lines)), shapely.points(position))
    assert away.min() >= 0.2 - 1e-9 and (place.on_sheets(position)[1] == 2).any()


def test_no_note_tells_of_floor_behind_an_exit_that_shuts():
    place = make_scenario("building-v0", people=10, shuts=5.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        place.route_set().when(frozenset({"east"}))
