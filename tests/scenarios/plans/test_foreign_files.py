"""GeoJSON, JuPedSim's SQLite and Vadere's scenarios: what is told apart by content, and what becomes of it."""

import json
import sqlite3
import warnings

import numpy as np
import pytest
import shapely
from cases import looped
from commands import call
from plan_files import EAST, ROOM, feature, geojson, room_drawing

from crowd_env import CrowdEnv, Route, make_scenario
from crowd_env.scenarios.floor_plan import people_on
from crowd_env.scenarios.plans.floor_plan import Start
from crowd_env.scenarios.plans.reading import is_plan, read_plan

EXIT = shapely.LineString([(8, 2), (8, 3.2)])
ROOM_AND_EXIT = (feature(ROOM, kind="walkable"), feature(EXIT, kind="exit", name="east"))


def vadere(path, *, absorbs=None, sources=(), **topography):
    target = {
        "id": 3,
        "shape": {"type": "RECTANGLE", "x": 7.5, "y": 2.5, "width": 1.0, "height": 1.0},
        **(absorbs or {}),
    }
    places = {
        "attributes": {"bounds": {"x": 0, "y": 0, "width": 9, "height": 7}, "boundingBoxWidth": 0.5, "bounded": True},
        "obstacles": [
            {
                "id": 1,
                "shape": {"type": "POLYGON", "points": [{"x": x, "y": y} for x, y in ((2, 2), (3, 2), (3, 3), (2, 3))]},
            },
            {"id": 2, "shape": {"type": "RECTANGLE", "x": 4, "y": 4, "width": 1, "height": 2.5}},
        ],
        "targets": [target],
        "sources": list(sources),
        **topography,
    }
    path.write_text(
        json.dumps({"name": "a room", "release": "2.1", "scenario": {"mainModel": "OSM", "topography": places}})
    )
    return path


def source(number, x, people=None, **others):
    table = {"id": number, "shape": {"type": "RECTANGLE", "x": x, "y": 0.6, "width": 1.5, "height": 1.2}, **others}
    return table if people is None else table | {"spawnNumber": people, "startTime": 0.0, "endTime": 0.0}


def recording(path, texts, version):
    """Write the tables of JuPedSim's format of a version that the geometry is in."""
    with sqlite3.connect(path) as base:
        base.execute("CREATE TABLE metadata(key TEXT NOT NULL UNIQUE, value TEXT NOT NULL)")
        base.execute("INSERT INTO metadata VALUES('version', ?)", (version,))
        if version == 1:
            base.execute("CREATE TABLE geometry(wkt TEXT NOT NULL)")
            base.executemany("INSERT INTO geometry VALUES(?)", [(text,) for text in texts])
        else:
            base.execute("CREATE TABLE geometry(hash INTEGER NOT NULL, wkt TEXT NOT NULL)")
            base.executemany("INSERT INTO geometry VALUES(?, ?)", [(-k, text) for k, text in enumerate(texts)])
            base.execute("CREATE TABLE frame_data(frame INTEGER NOT NULL, geometry_hash INTEGER NOT NULL)")
            frames = [
                (k, -(len(texts) - 1 - k)) for k in range(len(texts))
            ]  # the last of the table is the first in time
            base.executemany("INSERT INTO frame_data VALUES(?, ?)", frames)
    base.close()
    return path


def test_features_say_what_they_are(tmp_path):
    path = geojson(
        tmp_path / "plan.geojson",
        *ROOM_AND_EXIT,
        feature(shapely.box(3, 3, 4, 4), type="column"),
        feature(shapely.box(1, 1, 2, 2), layer="jps-distributions-desk"),
        feature(shapely.box(0, 4, 0.2, 5), kind="exit"),
        feature(shapely.box(5, 4, 6, 5), role="zone", name="slow"),
        feature(shapely.Point(1, 1), name="a lamp"),
    )
    plan = read_plan(path)
    assert plan.walkable.area == pytest.approx(47.0)
    assert list(plan.exits) == ["east", "exit-0"] and plan.exits["east"].length == pytest.approx(1.2)
    assert list(plan.regions) == ["desk", "slow"] and plan.starts == {"desk": Start()}
    assert len(plan.notes) == 1 and plan.notes[0].startswith("left out: 1 feature without a word")


def test_a_bare_geometry_is_walkable(tmp_path):
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(shapely.geometry.mapping(ROOM)))
    assert read_plan(path, [EAST]).walkable.equals(ROOM)
    assert make_scenario(path, exits=[EAST]).exits == ("exit-0",)


def house(path):
    """Write a house of three levels: the ground floor is a room, the others are narrower; the stairs are on all."""
    return geojson(
        path,
        *(feature(shapely.box(0, 0, 8 - 2 * level, 6), kind="room", level=level) for level in (0, 1)),
        feature(shapely.box(0, 0, 3, 6), kind="room", level="2"),
        feature(shapely.box(1, 4, 2, 6), kind="zone", name="stairs", level="0-2"),
        feature(shapely.box(1, 1, 2, 2), kind="column", level="0;1"),
        feature(shapely.LineString([(0, 2), (0, 3.2)]), kind="exit"),
    )


def test_levels_are_no_one_floor(tmp_path, monkeypatch):
    """They were laid on top of each other without a word."""
    path = house(tmp_path / "house.geojson")
    with pytest.raises(
        ValueError, match=r"house.geojson: it has 3 levels \(0, 1, 2\).*choose one, such as house.geojson:0"
    ):
        read_plan(path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"^house.geojson: it has 3 levels"):  # the example holds the name too
        read_plan("house.geojson")
    for level, area in ((0, 47.0), ("1", 35.0), (2.0, 18.0)):
        plan = read_plan(path, level=level)
        assert plan.walkable.area == pytest.approx(area) and list(plan.exits) == ["exit-0"] and "stairs" in plan.regions
    assert read_plan(f"{path}:1").walkable.area == pytest.approx(35.0)
    place = make_scenario(path, level=2, people=3)
    assert (place.name, place.title) == ("house-2", "floor plan house.geojson, level 2") and place.geometry.area == 18.0
    assert make_scenario(f"{path}:2").geometry.area == 18.0
    for wrong in ({"path": path, "level": 3}, {"path": f"{path}:cellar"}):
        with pytest.raises(ValueError, match=r"has no level '(3|cellar)'; its levels are 0, 1, 2"):
            read_plan(**wrong)


def test_a_file_of_one_level_needs_no_choice(tmp_path):
    path = geojson(tmp_path / "plan.geojson", feature(ROOM, kind="walkable", level=4), ROOM_AND_EXIT[1])
    assert read_plan(path).walkable.equals(read_plan(path, level=4).walkable)
    (tmp_path / "room.wkt").write_text(ROOM.wkt)
    with pytest.raises(ValueError, match="no level '0'; it names no levels"):
        read_plan(tmp_path / "room.wkt:0")
    (tmp_path / "b:0").write_text(ROOM.wkt)  # a file of this name comes first
    assert read_plan(tmp_path / "b:0").level is None


@looped("version", [1, 2])
def test_the_geometry_of_a_recording_of_jupedsim(version, tmp_path):
    path = recording(tmp_path / f"run{version}.sqlite", [f"GEOMETRYCOLLECTION ({ROOM.wkt})"], version)
    assert read_plan(path, [EAST]).walkable.equals(ROOM)
    assert make_scenario(path, exits=[EAST]).geometry.area == 48.0
    with pytest.raises(ValueError, match="a floor plan needs at least one exit: --exit"):
        make_scenario(path)


def test_of_a_geometry_that_changes_the_first_in_time_is_read(tmp_path):
    path = recording(tmp_path / "run.sqlite", [shapely.box(0, 0, 3, 3).wkt, ROOM.wkt], 2)
    plan = read_plan(path, [EAST])
    assert plan.walkable.equals(ROOM)
    assert plan.notes == ("the geometry of the recording changes; this is the one that it begins with",)


def test_a_scenario_of_vadere(tmp_path):
    plan = read_plan(vadere(tmp_path / "room.scenario", sources=[source(1, 1.0, 4), source(2, 5.0, 2)]))
    assert plan.walkable.bounds == (0.5, 0.5, 8.5, 6.5)
    assert plan.walkable.area == pytest.approx(48.0 - 1.0 - 2.5)
    assert list(plan.exits) == ["target-3"] and {name: one.people for name, one in plan.starts.items()} == {
        "source-1": 4,
        "source-2": 2,
    }
    place = make_scenario(plan.path)
    assert [(part.people, part.start_region) for part in place.population.parts] == [(4, "source-1"), (2, "source-2")]
    assert make_scenario(plan.path, people=9).population.people == 9


@looped("absorbs", [{"absorbing": False}, {"absorber": {"enabled": False}}])
def test_targets_that_nobody_leaves_by_are_no_exits(absorbs, tmp_path):
    plan = read_plan(vadere(tmp_path / "room.scenario", absorbs=absorbs))
    assert not plan.exits and list(plan.regions) == ["target-3"]


def test_sources_that_let_in_more_than_there_is_room_for_are_told(tmp_path):
    spawner = {"spawner": {"constraintsElementsMax": 5000, "constraintsTimeStart": 0.0, "constraintsTimeEnd": 600.0}}
    path = vadere(tmp_path / "room.scenario", sources=[source(1, 1.0, **spawner)])
    said = pytest.warns(UserWarning, match="the file says 5000 people; 5 start in the start areas of the plan")
    with pytest.warns(UserWarning, match="one after the other"), said:
        place = make_scenario(path)
    assert place.population.people == 5


def target(number, x, y, width, height, **more):
    return {"id": number, "shape": {"type": "RECTANGLE", "x": x, "y": y, "width": width, "height": height}, **more}


def wall(*points):
    return {"id": 9, "shape": {"type": "POLYGON", "points": [{"x": x, "y": y} for x, y in points]}}


def test_an_obstacle_that_crosses_itself_is_mended(tmp_path):
    path = vadere(tmp_path / "room.scenario", obstacles=[wall((2, 2), (4, 4), (4, 2), (2, 4))])
    plan = read_plan(path)
    assert plan.walkable.area == pytest.approx(48.0 - 2.0)
    assert [note.split(",")[0] for note in plan.notes] == ["obstacles: mended 1 outline that meets itself"]


def test_of_targets_that_overlap_the_first_has_what_they_share(tmp_path):
    corner = [target(3, 7.5, 0.5, 1, 2), target(4, 6, 0.5, 2, 1), target(5, 8, 1, 0.5, 0.5)]
    plan = read_plan(vadere(tmp_path / "room.scenario", targets=corner))
    assert {name: shape.area for name, shape in plan.exits.items()} == pytest.approx({"target-3": 2.0, "target-4": 1.5})
    assert len(plan.notes) == 2 and all("overlap at" in note for note in plan.notes)
    assert make_scenario(plan.path).exits == ("target-3", "target-4")


def test_a_target_that_no_exit_reaches_is_left_out(tmp_path):
    closet = [{"id": 1, "shape": {"type": "RECTANGLE", "x": 3, "y": 0.5, "width": 0.5, "height": 6}}]
    targets = [
        target(3, 7.5, 2.5, 1, 1),
        target(4, 1, 1, 1, 1, absorbing=False),
        target(5, 5, 5, 1, 1, absorbing=False),
    ]
    with pytest.warns(UserWarning, match="left out: 1 region that no exit reaches, target-4"):
        place = make_scenario(vadere(tmp_path / "room.scenario", obstacles=closet, targets=targets))
    assert list(place.geometry.regions) == ["target-5"]


@looped("radius", [0.15, 0.19, 0.25])
def test_a_number_of_people_that_the_reader_chooses_fits(radius, tmp_path):
    """One of the sources lies between two walls, and one in another source."""
    bars = [target(k, 1 + 0.6 * k, 3, 0.2, 3) for k in range(2)]
    areas = [(1.2, 3.5, 0.4, 1.0), (3, 3, 0.6, 2.5), (0.5, 0.5, 1, 1), (3.1, 3.1, 0.4, 0.4)]
    shapes = [{"type": "RECTANGLE", "x": x, "y": y, "width": w, "height": h} for x, y, w, h in areas]
    path = vadere(
        tmp_path / "room.scenario",
        obstacles=bars,
        sources=[{**source(k, 1.0, 400), "shape": shape} for k, shape in enumerate(shapes)],
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        place = make_scenario(path, population=people_on(read_plan(path), radius=radius))
    lost = (
        "2 start areas that bodies do not fit into beside the others, source-0, " if radius > 0.2 else "1 start area "
    )
    assert any(f"left out: {lost}" in str(one.message) and "source-3" in str(one.message) for one in said)
    for seed in range(10):
        place.population.draw(np.random.default_rng(seed), place.geometry)


@looped("name", ["room.json", "room.scenario"])
def test_a_json_file_is_told_by_what_it_holds(name, tmp_path):
    assert make_scenario(vadere(tmp_path / name)).title == f"floor plan {name}"


def test_files_without_a_suffix_that_is_known_are_told_by_their_content(tmp_path):
    (tmp_path / "a.txt").write_text(ROOM.wkt)
    recording(tmp_path / "b.db", [ROOM.wkt], 1)
    geojson(tmp_path / "c", *ROOM_AND_EXIT)
    room_drawing(tmp_path / "d.plan")
    for name in ("a.txt", "b.db", "c", "d.plan"):
        assert is_plan(tmp_path / name)
        assert read_plan(tmp_path / name, [EAST]).walkable.area == pytest.approx(48.0)


def test_names_and_scenario_files_are_no_plans(tmp_path):
    (tmp_path / "a.json").write_text('{"geometry": {}}')
    (tmp_path / "b.json").write_text("{")
    assert not any(is_plan(tmp_path / name) for name in ("a.json", "b.json", "c.json", "d.toml", "room-v0"))


def test_python_takes_what_the_command_line_takes(tmp_path):
    path = room_drawing(tmp_path / "room.dxf", 0, 100.0)
    env = CrowdEnv(make_scenario(str(path), unit="cm"), people=4, physics="dem")
    env.reset(seed=0)
    assert env.num_people == 4 and env.scenarios[0].geometry.area == pytest.approx(48.0)
    others = ["0,100,0,220"]
    with pytest.warns(UserWarning, match="left out for those that are given"):
        place = make_scenario(path, unit="cm", exits=others, population={"people": 7, "radius": 0.2})
    assert place.population.people == 7 and place.geometry.exits[0, 0, 0] == 0.0
    with pytest.warns(UserWarning, match="left out for those that are given"):
        assert make_scenario(path, exits=others, people=7, unit="cm").exits == ("exit-0",)
    with pytest.raises(
        ValueError,
        match=r"has no option 'side'; known: exits, unit, level, layers, origin, people, population, time_limit",
    ):
        make_scenario(path, side=3.0)


@looped(
    ("changes", "note"),
    [
        ({"targetIds": [3]}, ""),
        ({"targetIds": []}, ""),
        ({"targetIds": [4]}, "to which targets the people of a source walk"),
        ({"endTime": 60.0}, r"source-1 (no law) come one after the other"),
    ],
)
def test_what_a_source_says_of_its_people_and_is_not_modeled_is_told(changes, note, tmp_path):
    plan = read_plan(vadere(tmp_path / "room.scenario", sources=[source(1, 1.0, 4) | changes]))
    assert len(plan.notes) == bool(note) and note in " ".join(plan.notes)


@looped(
    "own",
    [
        {"interSpawnTimeDistribution": "org.vadere.state.scenario.ConstantDistribution", "distributionParameters": [2.0]},
        {"interSpawnTimeDistribution": "poisson", "distributionParameters": [0.5]},
        {"spawner": {"distribution": {"type": "org.vadere.state.attributes.distributions.AttributesPoissonDistribution",
                                      "numberPedsPerSecond": 0.5}}},
        {"spawner": {"distribution": {"type": "negativeExponential", "mean": 2.0}}},
    ],
)  # fmt: skip
def test_people_of_a_source_come_at_the_mean_of_its_times(own, tmp_path):
    people = {"spawnNumber": 1, "startTime": 1.0, "endTime": 7.0}
    plan = read_plan(vadere(tmp_path / "room.scenario", sources=[source(1, 1.0, **people, **own)]))
    assert plan.starts["source-1"].arrivals == [(1.0, 1), (3.0, 1), (5.0, 1), (7.0, 1)]
    assert any("people come every 2 s" in note for note in plan.notes) == ("Constant" not in str(own))


def test_attributes_of_a_thing_may_lie_in_a_table_of_their_own(tmp_path):
    path = vadere(tmp_path / "room.scenario", sources=[source(1, 1.0, 4)], absorbs={"absorbing": False})
    content = json.loads(path.read_text())
    places = content["scenario"]["topography"]
    for kind in ("obstacles", "targets", "sources"):
        places[kind] = [{"attributes": one} for one in places[kind]]
    (tmp_path / "nested.scenario").write_text(json.dumps(content))
    flat, nested = (read_plan(one) for one in (path, tmp_path / "nested.scenario"))
    assert not flat.exits and list(nested.regions) == list(flat.regions) == ["target-3", "source-1"]
    assert nested.starts == flat.starts == {"source-1": Start(4, (), [])} and nested.walkable.equals(flat.walkable)


def test_people_of_a_source_walk_to_their_own_target(tmp_path):
    """The own target is far, another is near; one lies on the way; exits that are given take the place of all."""
    targets = [target(3, 7.5, 1, 0.5, 1), target(4, 0, 1, 0.5, 1), target(5, 5.5, 4, 1, 1, absorbing=False)]
    sources = [source(1, 1.0, 4) | {"targetIds": [3]}, source(2, 5.0, 4) | {"targetIds": [5, 4, 3]}, source(6, 3.0, 2)]
    path = vadere(tmp_path / "room.scenario", targets=targets, sources=sources)
    place = make_scenario(path)
    assert [(part.exits, part.route) for part in place.population.parts] == [
        (("target-3",), None),
        ((), "target-5 then target-4"),
        ((), None),
    ]
    assert place.routes == (Route("target-5 then target-4", ("target-4",), ("target-5",)),)
    project = tmp_path / "room.toml"
    project.write_text('[geometry]\nfile = "room.scenario"\n[geometry.exits]\nfar = "target-3"\nnear = "target-4"\n')
    renamed = make_scenario(project)
    assert [part.exits for part in renamed.population.parts] == [("far",), (), ()]
    assert renamed.routes == (Route("target-5 then near", ("near",), ("target-5",)),)
    saved = tmp_path / "saved.toml"
    assert call(f"plan {path} --save {saved} --out {tmp_path / 'plan.png'}").exit_code == 0
    again = make_scenario(saved)
    assert again.routes == place.routes and [p.route for p in again.population.parts] == [
        p.route for p in place.population.parts
    ]
    with pytest.warns(UserWarning, match="left out for those that are given"):
        other = make_scenario(path, exits=["0.5,3,0.5,4"])
    assert not any(part.exits for part in other.population.parts)


def test_stairs_of_vadere_slow_people_down(tmp_path):
    """Ten treads of 0.3 m turned by 45 degrees: 2 risers + tread = 0.63 m, 51.8 (tread / riser)^0.5 m/min along the slope."""
    turned = shapely.affinity.rotate(shapely.box(4.5, 2, 5.5, 5), -45.0)
    points = [{"x": x, "y": y} for x, y in turned.exterior.coords[:-1]]
    flight = {
        "id": 6,
        "shape": {"type": "POLYGON", "points": points},
        "treadCount": 10,
        "upwardDirection": {"x": 1, "y": 1},
    }
    level = {"id": 6, "shape": flight["shape"], "treadCount": 6, "upwardDirection": {"x": 1, "y": -1}}
    path = vadere(tmp_path / "room.scenario", obstacles=[], stairs=[flight, level], sources=[source(1, 1.0, 4)])
    with pytest.warns(UserWarning, match=r"stairs-6: people walk at 0\.7\d of their speed, .*treads of 0\.300 m"):
        place = make_scenario(path)
    first, second = place.zones
    assert (first.region, second.region) == ("stairs-6", "stairs-6-1")
    expected = 51.8 / 84.0 * np.sqrt(0.3 / 0.165) * 0.3 / np.hypot(0.3, 0.165)
    assert first.factor == pytest.approx(expected, abs=5e-4) and second.factor < first.factor
    saved = tmp_path / "saved.toml"
    assert call(f"plan {path} --save {saved} --out {tmp_path / 'plan.png'}").exit_code == 0
    assert make_scenario(saved).zones == place.zones


def test_people_of_vadere_come_as_its_spawner_says(tmp_path):
    constant = {
        "type": "org.vadere.state.attributes.distributions.AttributesConstantDistribution",
        "updateFrequency": 2.0,
    }
    spawner = {"constraintsTimeStart": 1.0, "constraintsTimeEnd": 5.0, "eventElementCount": 3, "distribution": constant}
    older = {"spawnNumber": 2, "maxSpawnNumberTotal": 5, "startTime": 0.0, "endTime": 10.0}
    older |= {"interSpawnTimeDistribution": "ConstantDistribution", "distributionParameters": [4.0]}
    once = {"spawnNumber": 4, "startTime": 7.0, "endTime": 7.0}
    sources = [source(1, 1.0, spawner={**spawner, "constraintsElementsMax": -1}), source(2, 3.0, **older)]
    path = vadere(tmp_path / "room.scenario", sources=[*sources, source(3, 1.0, **once)])
    assert {name: one.arrivals for name, one in read_plan(path).starts.items()} == {
        "source-1": [(1.0, 3), (3.0, 3), (5.0, 3)],
        "source-2": [(0.0, 2), (4.0, 2), (8.0, 1)],
        "source-3": [(7.0, 4)],
    }
    place = make_scenario(path)
    assert [part.people for part in place.population.parts] == [9, 5, 4] and place.population.parts[
        0
    ].arrivals is not None
    assert (
        make_scenario(path, people=6).population.parts[0].arrivals is None
    )  # the user's number are there at the start
