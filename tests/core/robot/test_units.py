# SPDX-License-Identifier: Apache-2.0
"""Quantities with units become SI; what is no quantity is refused with what would have worked."""

from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import ConfigError
from comcal.robot.units import LARGEST, UNITS, Dimension, parse_quantity

D = Dimension


@pytest.mark.parametrize(
    ("text", "dimension", "si"),
    [
        ("26.32 mm", D.LENGTH, 0.02632),
        ("5 deg", D.ANGLE, math.radians(5)),
        ("-5°", D.ANGLE, math.radians(-5)),
        ("0.5 kg", D.MASS, 0.5),
        ("100 g", D.MASS, 0.1),
        ("12 N", D.FORCE, 12.0),
        ("3 N cm", D.MOMENT, 0.03),
        ("3 N*m", D.MOMENT, 3.0),
        ("3 N·m", D.MOMENT, 3.0),
        ("3Nm", D.MOMENT, 3.0),
        ("3 mN m", D.MOMENT, 0.003),
        ("20 mA", D.CURRENT, 0.02),
        ("9.81 m/s²", D.ACCELERATION, 9.81),
        ("1 g", D.ACCELERATION, 9.80665),
        ("0.5 %", D.RATIO, 0.005),
        ("1e-3", D.LENGTH, 0.001),
        (3, D.LENGTH, 3.0),
        (0.25, D.MASS, 0.25),
    ],
)
def test_quantities_are_brought_to_si(text, dimension, si):
    assert parse_quantity(text, dimension) == pytest.approx(si, rel=1e-15)


def test_decimal_units_round_only_once():
    assert parse_quantity("26.32 mm", D.LENGTH) == 0.02632
    assert parse_quantity("0.3 g", D.MASS) == 0.0003


@pytest.mark.parametrize(
    ("value", "dimension", "message"),
    [
        ("3 N", D.LENGTH, "possible are m, cm, mm, um"),
        ("3 nm", D.MOMENT, "did you mean 'N m'"),
        ("3 KG", D.MASS, "did you mean 'kg'"),
        ("1,5 mm", D.LENGTH, "decimal comma"),
        ("five", D.LENGTH, "such as '0.5 m'"),
        ("", D.LENGTH, "such as '0.5 m'"),
        ("1_000 mm", D.LENGTH, "not a unit"),
        (True, D.MASS, "got True"),
        (None, D.MASS, "got None"),
        ([1.0], D.MASS, r"got \[1.0\]"),
        (float("nan"), D.MASS, "finite"),
        ("nan", D.MASS, "such as"),
        (10**400, D.MASS, "finite"),
        ("1e999999999999 mm", D.LENGTH, "finite"),
        (2 * LARGEST, D.MASS, "limit 1e\\+09 kg"),
    ],
)
def test_what_is_no_quantity_is_refused_with_what_would_have_worked(value, dimension, message):
    with pytest.raises(ConfigError, match=message):
        parse_quantity(value, dimension)


def test_the_si_unit_of_every_dimension_comes_first_and_has_factor_one():
    for dimension in Dimension:
        assert next(iter(UNITS[dimension].values())) == 1.0


@settings(deadline=None, max_examples=60)
@given(st.floats(-1e3, 1e3), st.sampled_from(list(Dimension)), st.data())
def test_every_unit_scales_by_its_factor(number, dimension, data):
    unit, factor = data.draw(st.sampled_from(list(UNITS[dimension].items())))
    value = parse_quantity(f"{number!r} {unit}", dimension)
    assert value == pytest.approx(number * factor, rel=1e-14)


@settings(deadline=None, max_examples=200)
@given(st.one_of(st.text(max_size=20), st.integers(), st.floats(), st.none()))
def test_rubbish_is_refused_or_is_a_finite_number(value):
    for dimension in (D.LENGTH, D.MOMENT):
        with contextlib.suppress(ConfigError):
            assert math.isfinite(parse_quantity(value, dimension))
