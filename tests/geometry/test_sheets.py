"""Buildings as sheets: which are refused, what turns with them, and the ways over their seams."""

import time
from dataclasses import replace

import numpy as np
import pytest
import shapely
from cases import looped
from shapely.geometry import Polygon, box
from storeys import RISE, RUN, laid, ramp, stacked, with_stair

from crowd_env.geometry.geometry import Geometry, turning
from crowd_env.geometry.sheets import Seam, Sheet, as_plain, from_plain, united
from crowd_env.geometry.surface import Slope
from crowd_env.routing.fields.field import travel_time_field

OUT = {"out": (2, np.array([[8.0, 0.0], [8.0, 2.0]]))}
NAN = float("nan")


def changed(number=None, seam=None, **fields):
    """Return the corridor with a ramp with one sheet, or one seam, changed."""
    sheets, seams = ramp(1.0, 4.0, 4.0)
    if number is not None:
        sheets[number] = replace(sheets[number], **fields)
    if seam is not None:
        seams[seam] = replace(seams[seam], **fields)
    return sheets, seams


def slope(x0, x1, plane=(0.25, 0.0, 0.0), **speeds):
    return Slope(box(x0, 0, x1, 2), plane, **speeds)


REFUSED = {
    "seam off the border": (changed(seam=0, line=np.array([[0.0, 0.0], [0.0, 2.5]])), "it is 0.5 m off the border of 'low'"),
    "seam inside": (changed(seam=0, line=np.array([[-1.0, 0.0], [-1.0, 2.0]])), "off the border of 'low'"),
    "seam turned round": (changed(seam=0, line=np.array([[0.0, 2.0], [0.0, 0.0]])), "'low' does not begin there"),
    "seam of a point": (changed(seam=0, line=np.array([[0.0, 1.0], [0.0, 1.0]])), "is 0 m long; it must be at least"),
    "seam to itself": (changed(seam=0, right=0), "^seam 0 joins 'low' to itself"),
    "seam to nothing": (changed(seam=1, right=3), "^seam 1 names sheet 3; there are 0 to 2"),
    "seam nowhere": (changed(seam=1, line=np.array([[4.0, NAN], [4.0, 2.0]])), "^seam 1: its line is .* finite numbers"),
    "heights apart": (changed(2, level=1.5), "one is at 1.00 m, the other at 1.50 m; they must meet"),
    "no height": (changed(0, level=NAN), "^sheet 'low': level is nan m; a sheet without slopes needs a height"),
    "slope of nan": (changed(1, slopes=(slope(0, 4, (NAN, 0.0, 0.0)),)), "^slope 0 of sheet 'ramp': plane is"),
    "slope without speed": (changed(1, slopes=(slope(0, 4, up=0.0),)), "speeds are 0 and 1; they must be above 0"),
    "above itself": (changed(1, slopes=(slope(0, 3), slope(2, 4))), "^sheet 'ramp': two of its slopes overlap at"),
    "crossing itself": (changed(0, area=Polygon([(-4, 0), (0, 0), (-4, 2), (0, 2)])), "^sheet 'low' is not a valid polygon"),
    "bare": (changed(1, slopes=(slope(0, 2),)), "^sheet 'ramp': no slope covers .*, and it has no level"),
    "nan": (changed(0, area=Polygon([(-4, 0), (0, NAN), (0, 2)])), "^sheet 'low'"),
    "no way out": ((ramp(1.0, 4.0, 4.0)[0], ramp(1.0, 4.0, 4.0)[1][1:]), "^no exit can be reached from 'low'; a stair"),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:no exit can be reached")
@looped("name", REFUSED)
def test_absurd_buildings_are_refused_in_a_sentence(name):
    (sheets, seams), text = REFUSED[name]
    with pytest.raises(ValueError, match=text) as refused:
        laid(sheets, seams, OUT) if name not in ("nan", "crossing itself") else Geometry.from_sheets(sheets, seams)
    assert "\n" not in str(refused.value)


def test_sheets_that_are_not_laid_out_are_refused():
    with pytest.raises(ValueError, match=r"^'a' and 'b' overlap in the layout; set them apart by lay_out$"):
        Geometry.from_sheets([Sheet("a", box(0, 0, 4, 4), 0.0), Sheet("b", box(0, 0, 4, 4), 3.0)], [])


def test_level_sheets_that_meet_are_one():
    sheets, seams, number = united(*ramp(0.0, 4.0, 4.0))
    assert [sheet.name for sheet in sheets] == ["low"] and not seams
    assert (number == 0).all() and sheets[0].area.equals(box(-4, 0, 8, 2)) and sheets[0].level == 0.0
    sheets, seams, number = united(*ramp(1.0, 4.0, 4.0))
    assert len(sheets) == 3 and len(seams) == 2 and number.tolist() == [0, 1, 2]
    # Two levels at one height, and a stair from the second: numbers follow.
    parts = [
        Sheet("a", box(0, 0, 2, 2), 1.0),
        Sheet("b", box(2, 0, 4, 2), 1.0),
        Sheet("c", box(4, 0, 8, 2), slopes=(slope(4, 8),)),
    ]
    lines = [Seam(np.array([[x, 0.0], [x, 2.0]]), k, k + 1) for k, x in enumerate((2.0, 4.0))]
    sheets, seams, number = united(parts, lines)
    assert [sheet.name for sheet in sheets] == ["a", "c"] and number.tolist() == [0, 0, 1]
    assert [(seam.left, seam.right) for seam in seams] == [(0, 1)]
    escalator = replace(parts[1], level=NAN, slopes=(Slope(parts[1].area, (0.0, 0.0, 1.0), 0.5, 0.5),))
    assert len(united([parts[0], escalator], lines[:1])[0]) == 2  # it has a speed of its own


@looped(("angle", "mirrored"), [(0.5 * np.pi, False), (0.7, False), (0.0, True), (2.4, True)])
def test_a_turned_building_is_the_same_building(angle, mirrored):
    place, turn = with_stair(), turning(angle, mirrored)
    moved, points = place.turned(angle, mirrored), np.random.default_rng(0).uniform((4, 0), (8.5, 1.25), (50, 2))
    stair = np.full(50, 2)
    np.testing.assert_allclose(moved.heights(turn(points), stair), place.heights(points, stair), atol=1e-9)
    at = place.laid_out(points, stair)
    np.testing.assert_allclose(moved.laid_out(turn(points), stair), turn(at), atol=1e-9)
    np.testing.assert_array_equal(moved.on_sheets(turn(at))[1], stair)
    np.testing.assert_allclose(moved.on_sheets(turn(at))[0], turn(points), atol=1e-9)
    for name in ("wall_height", "corner_height", "seam_from", "seam_to", "exit_sheet", "wall_start"):
        before, after = getattr(place.surface, name), getattr(moved.surface, name)
        np.testing.assert_allclose(np.sort(after, axis=None), np.sort(before, axis=None), atol=1e-9, err_msg=name)
    np.testing.assert_allclose(np.sort(moved.boundary.depth), np.sort(place.boundary.depth), atol=1e-6)
    sheets, seams = from_plain(as_plain(moved.building))
    again = Geometry.from_sheets(
        sheets, seams
    )  # every seam still lies on both borders, with its sheets on the same sides
    assert len(again.building.lines) == 4


# ---------------------------------------------------------------------------------------------------------------------- ways


@looped("climbs", [True, False])
def test_ways_over_seams_take_level_and_slope_by_their_speeds(climbs):
    up, down, along = 0.6, 0.7, float(np.hypot(3.0, 4.0))
    x = 8.0 if climbs else -4.0
    line = np.array([[x, 0.0], [x, 2.0]] if climbs else [[x, 2.0], [x, 0.0]])
    place = laid(*ramp(3.0, 4.0, 4.0, up=up, down=down), {"out": (2 if climbs else 0, line)})
    field = travel_time_field(place, 0.2)
    points, sheets = np.array([[-2.0, 1.0], [1.0, 1.0], [6.0, 1.0]]), np.array([0, 1, 2])
    speed = up if climbs else down
    level = np.array([2.0 + 4.0, 4.0, 2.0]) if climbs else np.array([2.0, 4.0, 2.0 + 4.0])
    sloped = np.array([1.0, 0.75, 0.0]) if climbs else np.array([0.0, 0.25, 1.0])
    found = field.travel_time_for(place.laid_out(points, sheets), 0.2) - field.behind
    np.testing.assert_allclose(found, level + sloped * along / speed, rtol=0.02)


def test_the_way_down_a_stair_is_the_shortest_over_all_sheets():
    place = with_stair()
    field = travel_time_field(place, 0.2)
    start = np.array([[10.0, 0.625]])
    found = field.travel_time_for(place.laid_out(start, np.array([1])), 0.2) - field.behind
    # 1.5 m to the stair, along it, and on from its foot to the door.
    ahead = np.hypot(4.0 - 0.0, 2.5 + 0.2 - 0.625)
    assert found[0] == pytest.approx(1.5 + np.hypot(RISE, RUN) / 0.7 + ahead, rel=0.02)


@pytest.mark.more
def test_ways_of_a_large_building_are_found(capsys):
    floors, wide, deep = 10, 40.0, 20.0
    holes = [box(4, 0, 8.5, 1.25), box(30, 0, 34.5, 1.25)]
    area = box(0, 0, wide, deep).difference(shapely.union_all(holes))
    sheets = [Sheet(f"level {k}", area, 3.0 * k) for k in range(floors)]
    seams = []
    for k in range(floors - 1):
        for number, hole in enumerate(holes):
            x0, _, x1, _ = hole.bounds
            sheets.append(
                Sheet(
                    f"stair {number} of {k}",
                    hole,
                    slopes=(Slope(hole, (3 / 4.5, 0.0, 3.0 * k - x0 * 3 / 4.5), 0.6, 0.7),),
                )
            )
            lines = (np.array([[x, 0.0], [x, 1.25]]) for x in (x0, x1))
            ends = ((k, len(sheets) - 1), (len(sheets) - 1, k + 1))
            seams += [Seam(line, *pair) for line, pair in zip(lines, ends, strict=True)]
    begin = time.process_time()
    place = laid(
        sheets,
        seams,
        {"west": (0, np.array([[0.0, 12.0], [0.0, 8.0]])), "east": (0, np.array([[wide, 8.0], [wide, 12.0]]))},
    )
    made = time.process_time()
    field = travel_time_field(place, 0.25, min_radius=0.2)
    with capsys.disabled():
        print(
            f"\n10 levels, 18 stairs: {made - begin:.1f} s CPU to make, {time.process_time() - made:.1f} s for the ways"
        )
    points = np.tile([[20.0, 10.0]], (floors, 1))
    times = field.travel_time_for(place.laid_out(points, np.arange(floors)), 0.2)
    assert (np.diff(times) > np.hypot(3.0, 4.5) / 0.7).all()


def test_storeys_have_their_own_ways():
    place = stacked([box(0, 0, 12, 8)] * 3)
    assert (np.bincount(place.surface.exit_sheet) == 2).all()
    field = travel_time_field(place, 0.2)
    times = [field.travel_time_for(place.laid_out(np.array([[6.0, 4.0]]), np.array([s])), 0.2)[0] for s in range(3)]
    np.testing.assert_allclose(times, times[0], atol=0.05)
