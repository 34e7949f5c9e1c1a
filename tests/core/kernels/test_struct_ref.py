"""References: what a kernel reads of a NamedTuple is what Python put there."""

import copy
import pickle
import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest
from cases import looped
from numba import config

from crowd_env import CrowdEnv
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.core.kernels.struct_ref import StructRef, struct_ref

pytestmark = pytest.mark.kernels
compiled = pytest.mark.skipif(config.DISABLE_JIT, reason="about compiled code")


class Inner(NamedTuple):
    position: Any  # (N, 2)
    wall: Any  # (W, 2, 2)
    key: Any  # (N,) uint32
    cell: Any  # (M,) int16
    active: Any  # (N,) bool


class Outer(NamedTuple):
    dt: float
    inner: Any
    steps: int
    driving: bool
    count: Any  # (N,) int64


@inner_kernel
def add(inner: Inner, i: int, value: float) -> float:
    inner.position[i, 1] += value
    return inner.position[i, 1]


@kernel
def read(outer: Outer) -> tuple[float, float, int, int, float, int]:
    inner, total = outer.inner, 0.0
    for i in range(len(inner.position)):
        if inner.active[i]:
            total += add(inner, i, outer.dt)
            outer.count[i] += outer.steps
    walls = inner.wall[1, 0, 1] + inner.wall.shape[0]
    return total, walls, inner.key[2] + inner.cell[1], outer.steps, outer.dt, 1 if outer.driving else 0


def make() -> Outer:
    inner = Inner(
        position=np.arange(6.0).reshape(3, 2),
        wall=np.arange(8.0).reshape(2, 2, 2),
        key=np.array([1, 2, 4_000_000_000], dtype=np.uint32),
        cell=np.array([5, -2], dtype=np.int16),
        active=np.array([True, False, True]),
    )
    return Outer(dt=0.5, inner=inner, steps=7, driving=True, count=np.zeros(3, dtype=np.int64))


@looped("by", [struct_ref, lambda tuple_: tuple_], ids=["reference", "tuple"])
def test_a_kernel_reads_and_writes_the_same_of_a_reference_as_of_the_tuple(by):
    outer = make()
    assert read(by(outer)) == (1.5 + 5.5, 5.0 + 2, 3_999_999_998, 7, 0.5, 1)
    np.testing.assert_array_equal(outer.inner.position[:, 1], [1.5, 3.0, 5.5])
    np.testing.assert_array_equal(outer.count, [7, 0, 7])


def test_a_reference_keeps_its_arrays_alive_and_nested_ones_are_taken_as_they_are():
    outer = make()
    inner = struct_ref(outer.inner)
    reference = struct_ref(outer._replace(inner=inner))
    del outer
    rubbish = [np.full((3, 2), np.nan) for _ in range(100)]  # would lie where freed arrays were
    assert read(reference)[0] == 7.0
    assert struct_ref(inner) is inner
    assert reference.fields.steps == 7
    del rubbish


def test_a_table_cannot_be_written_to():
    # The compiler was told that it never changes while a kernel runs, and may read it once for many uses.
    reference = struct_ref(make())
    reference.replace(count=np.zeros(3, dtype=np.int64))
    with pytest.raises(ValueError, match="read-only"):
        reference._table[0] = 0


def test_all_who_hold_a_reference_see_what_replaces_its_arrays():
    outer = make()
    reference = struct_ref(outer)
    other = struct_ref(outer._replace(inner=reference.inner, dt=0.25))  # shares the inner one
    longer = make().inner._replace(position=np.ones((5, 2)), active=np.ones(5, dtype=bool))
    reference.replace(inner=longer, count=np.zeros(5, dtype=np.int64), steps=3)
    other.replace(count=np.zeros(5, dtype=np.int64))
    assert read(reference)[:4] == (5 * 1.5, 7.0, 3_999_999_998, 3)
    assert read(other)[:4] == (5 * 1.75, 7.0, 3_999_999_998, 7)
    assert reference.inner.position is other.inner.position is longer.position
    assert reference.fields.steps == 3
    twin, inner = copy.deepcopy((reference, reference.inner))
    twin.replace(inner=make().inner)
    assert inner.position is twin.inner.position is not reference.inner.position  # still shared
    count = reference.count
    with pytest.raises(TypeError, match=r"^steps is float64; kernels are compiled for int64$"):
        reference.replace(count=np.ones(5, dtype=np.int64), steps=0.5)
    assert reference.count is count


def test_python_reads_the_same_attributes_as_a_kernel():
    outer = make()
    reference = struct_ref(outer._replace(inner=struct_ref(outer.inner)))
    assert reference.inner.position is outer.inner.position and reference.dt == outer.dt
    for absent in ("nothing", "_fields", "__len__"):
        with pytest.raises(AttributeError, match=absent):
            getattr(reference, absent)
    with pytest.raises(
        AttributeError, match="fields"
    ):  # as in a copy that is half made, instead of going round in circles
        assert StructRef.__new__(StructRef).dt


def test_empty_arrays_and_columns_of_one():
    empty = Inner(
        np.zeros((0, 2)), np.ones((2, 2, 2)), np.zeros(3, np.uint32), np.zeros(2, np.int16), np.zeros(0, bool)
    )
    assert read(struct_ref(make()._replace(inner=empty)))[0] == 0.0


@looped(
    ("field", "value", "word"),
    [
        ("count", np.zeros((4, 4))[:, 1], "count is ndarray"),
        ("count", [1, 2], "count is list"),
        ("dt", "0.1", "dt is str"),
        ("dt", None, "dt is NoneType"),
    ],
)
def test_what_no_kernel_could_read_is_named(field, value, word):
    with pytest.raises(TypeError, match=word):
        struct_ref(make()._replace(**{field: value}))


@looped("copied", [copy.deepcopy, lambda thing: pickle.loads(pickle.dumps(thing))], ids=["copy", "pickle"])
def test_a_copy_refers_to_arrays_of_its_own(copied):
    env = CrowdEnv("room-v0", physics="dem")
    env.reset(seed=0)
    env.step(None)
    other = copied(env)
    expected, before = env.simulation.state.position.copy(), other.simulation.state.position.copy()
    np.testing.assert_array_equal(before, expected)
    ours = other.step(None)
    np.testing.assert_array_equal(env.simulation.state.position, expected)
    assert (other.simulation.state.position != before).any()
    np.testing.assert_array_equal(env.step(None).observation, ours.observation)


def test_an_unknown_attribute_is_a_typing_error():
    @kernel
    def wrong(outer):
        return outer.nothing

    with pytest.raises(Exception, match="nothing"):
        wrong(struct_ref(make()))


@compiled
def test_equal_tuples_have_one_type_and_others_have_others():
    one, same = struct_ref(make()), struct_ref(make())
    other = struct_ref(make()._replace(count=np.zeros(3)))
    assert one._numba_type_ == same._numba_type_ != other._numba_type_
    assert isinstance(one, StructRef)
    before = len(read.signatures)
    read(one), read(same)
    assert len(read.signatures) <= before + 1


@pytest.mark.more
@compiled
def test_kernels_of_references_come_from_the_cache_in_another_process(tmp_path):
    program = (
        "import numpy as np\n"
        "from crowd_env import CrowdEnv\n"
        "from crowd_env.physics import dem\n"
        "env = CrowdEnv('room-v0', physics='dem'); env.reset(seed=0); env.step(None)\n"
        "print(sum(dem._advance_range.stats.cache_hits.values()), sum(dem._advance_range.stats.cache_misses.values()))\n"
    )
    runs = [
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
        for _ in range(2)
    ]
    assert runs[1] == ["1", "0"]
