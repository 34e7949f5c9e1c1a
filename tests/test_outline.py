"""Shapes of bodies: area, centroid and moments of a union of discs, the torso of LEMONS, and what is refused."""

import numpy as np
import pytest
import shapely
from cases import looped

from crowd_env.core.behaviors.outline import OUTLINES, Outline, room_of

TORSO = OUTLINES["torso"]

# Moments of inertia [kg m2] that LEMONS gives to people of these masses [kg] and discs [m], for comparison with a plate of even
# weight (repository Crowd-Mechanics/LEMONS, push_Feldmann, Tue_15, Agents.xml, people 0, 1 and 3).
LEMONS = [
    (81.0, 1.48, TORSO.discs),
    (105.0, 2.67, [(-0.017, 0.168, 0.10643), (0.010, 0.074, 0.14636), (0.015, 0.0, 0.153)]),
    (63.0, 1.02, [(-0.013, 0.144, 0.07826), (0.007, 0.063, 0.10762), (0.011, 0.0, 0.1125)]),
]


def moments(discs):
    """Return area, centroid and polar moment about it of a union of discs, on a fine grid."""
    discs = np.asarray(discs)
    low, high = (discs[:, :2] - discs[:, 2:]).min(axis=0), (discs[:, :2] + discs[:, 2:]).max(axis=0)
    step = (high - low).max() / 800
    x, y = np.meshgrid(*(np.arange(a, b, step) + 0.5 * step for a, b in zip(low, high, strict=True)))
    inside = np.zeros(x.shape, dtype=bool)
    for cx, cy, radius in discs:
        inside |= np.hypot(x - cx, y - cy) < radius
    x, y = x[inside], y[inside]
    center = x.mean(), y.mean()
    return len(x) * step**2, center, ((x - center[0]) ** 2 + (y - center[1]) ** 2).sum() * step**2


def drawn(rng, count):
    return tuple((*rng.normal(0, 0.15, 2), rng.uniform(0.03, 0.2)) for _ in range(count))


@looped("seed", range(8))
def test_area_centroid_and_inertia_are_those_of_a_fine_grid(seed):
    discs = TORSO.discs if seed == 0 else drawn(np.random.default_rng(seed), 1 + seed % 7)
    area, center, polar = moments(discs)
    unit = np.sqrt(area / np.pi)
    shape = Outline(discs).shape
    assert shape.inertia == pytest.approx(polar / (area * unit**2), rel=2e-3)
    np.testing.assert_allclose(shape.radius * unit, np.array(discs)[:, 2], rtol=1e-3)
    np.testing.assert_allclose(shape.x * unit + center[0], np.array(discs)[:, 0], atol=5e-4)
    np.testing.assert_allclose(shape.y * unit + center[1], np.array(discs)[:, 1], atol=5e-4)


def test_the_area_of_an_outline_is_that_of_its_nominal_disc():
    for discs in (TORSO.discs, [(0, 0.12, 0.15), (0, -0.12, 0.15)], [(0, 1, 0.1), (0, -1, 0.1), (0.5, 0, 0.2)]):
        shape = Outline(discs).shape
        union = shapely.union_all(shapely.buffer(shapely.points(shape.x, shape.y), shape.radius, quad_segs=500))
        assert union.area == pytest.approx(np.pi, rel=1e-5)
        assert shape.reach == pytest.approx(shapely.minimum_bounding_radius(union), rel=0.05)
        corners = shapely.get_coordinates(union)
        assert np.hypot(*corners.T).max() == pytest.approx(shape.reach, rel=1e-5)


def test_one_disc_is_a_disc_wherever_it_is_given():
    for discs in ([(0, 0, 0.25)], [(0.4, -0.3, 0.1)], [(0, 0, 0.2), (0, 0, 0.2)], [(0, 0, 0.2), (0.05, 0, 0.1)]):
        shape = Outline(discs).shape
        assert (shape.x[0], shape.y[0], shape.radius[0], shape.reach, shape.inertia) == (0.0, 0.0, 1.0, 1.0, 0.5)


@looped(("mass", "inertia", "discs"), LEMONS)
def test_the_moment_of_inertia_of_lemons(mass, inertia, discs):
    discs = [*discs, *((x, -y, r) for x, y, r in discs if y > 0 and (x, -y, r) not in list(map(tuple, discs)))]
    area, _, _ = moments(discs)
    of_plate = Outline(discs).inertia(np.array([mass]), np.array([np.sqrt(area / np.pi)]))
    assert of_plate[0] == pytest.approx(inertia, rel=0.025)


def test_the_torso_is_as_broad_and_deep_as_the_person_it_is_of():
    shape, unit = TORSO.shape, 0.1705
    assert unit * 2 * (shape.y + shape.radius).max() == pytest.approx(0.471, abs=5e-4)
    depth = (shape.x + shape.radius).max() - (shape.x - shape.radius).min()
    assert unit * depth == pytest.approx(0.246, abs=5e-4)
    assert room_of(TORSO) == pytest.approx(1.387, abs=1e-3)
    assert room_of(None) == 1.0


def test_names_and_plain_data_lead_to_the_same_outline():
    assert Outline.of("torso") is TORSO
    assert Outline.of("disc") is None is Outline.of(None)
    assert (Outline.plain_of(TORSO), Outline.plain_of(None)) == ("torso", "disc")
    table = {"discs": [[0, 0.1, 0.1], [0, -0.1, 0.1]], "turning_time": 0.3}
    given = Outline.of(table)
    assert given.turning_time == 0.3
    assert Outline.of(Outline.plain_of(given)) == given
    assert hash(given) == hash(Outline.of(table))


@looped(
    ("wrong", "says"),
    [
        ("square", "unknown outline 'square'; known: disc, torso"),
        (3, "outline is 3; it must be an Outline, a table of its parameters, None or one of disc, torso"),
        ({"disks": []}, "unknown key 'disks'; known: discs, turning_time, max_torque"),
        ({"discs": []}, "discs are 0; there must be 1 to 16|discs has the shape"),
        ({"discs": [[0, 0, 0.1]] * 17}, "discs are 17; there must be 1 to 16"),
        ({"discs": [[0, 0.1]]}, r"discs has the shape \(1, 2\); it must be \(K, 3\)"),
        ({"discs": "torso"}, "outline: discs is 'torso'"),
        ({"discs": [[0, 0, -0.1]]}, r"radius of discs\[0\] is -0.1; it must be > 0"),
        ({"discs": [[0, np.nan, 0.1]]}, r"discs\[0, 1\] is nan"),
        ({"discs": [[0, 0, 0.1]], "turning_time": 0}, "turning_time is 0; it must be a number, > 0|turning_time is 0"),
        ({"discs": [[0, 0, 0.1]], "max_torque": -1.0}, "max_torque is -1.0"),
    ],
)
def test_what_is_no_outline_is_refused_in_a_sentence(wrong, says):
    with pytest.raises(ValueError, match=says) as refusal:
        Outline.of(wrong)
    assert "\n" not in str(refusal.value)
