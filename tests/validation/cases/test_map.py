"""A part of the validation map in a few minutes: what people who keep a headway must show, a draw or two of each."""

import pytest

from validation.cases import CASES, Setting

MUST = (("ring", "calm"), ("corner", "calm"), ("doors", "hurried"), ("counterflow", "hurried"))


def passes(case, scheme, manner, draws):
    (row,) = CASES[case].run(Setting(scheme, manner, draws=draws))
    assert row.passed, row.figure


@pytest.mark.parametrize(("case", "manner"), MUST)
def test_a_headway_makes_dem_true_to_the_experiments(case, manner):
    passes(case, "dem", manner, draws=1)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "manner"), MUST)
@pytest.mark.parametrize("scheme", ["nsm1-inertial", "nsm2"])
def test_a_headway_makes_other_schemes_true_to_the_experiments(case, scheme, manner):
    passes(case, scheme, manner, draws=2)


@pytest.mark.parametrize("case", ["ring", "doors", "corner"])
def test_without_it_the_experiments_are_missed(case):
    (row,) = CASES[case].run(Setting("dem", "competitive", draws=1))
    assert not row.passed
