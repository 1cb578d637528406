"""One input for a parameter: its kind, its step, what it accepts of what a browser sends."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from parameters_bench import HEIGHT, WALKER, parameter

from husky_bringup.console.parameter_inputs import ParameterInput, accepted, kind_of, slider_step
from husky_bringup.console.server import PageServer


@pytest.mark.parametrize(
    ("name", "given", "why"),
    [
        (HEIGHT, math.nan, "NaN is no number"),
        ("robot", "beta", "it is fixed at the start"),
        ("unset", "1", "it cannot be set here"),
        ("sensing", "odd", "'odd' is none of ideal, noisy"),
        ("sensing", ["ideal"], "['ideal'] is none of ideal, noisy"),
        ("frame", "x" * 10_001, "10001 characters, 10000 are allowed"),
        ("legs", "[a", "it is no list as [1.0, 2.0]"),
        ("legs", "[" * 9999, "it is no list"),
        ("legs", {"a": 1}, "it is no list"),
        ("gains", "[NaN]", "NaN is no number"),
        ("legs", '["\\ud800"]', "'\\ud800' has half a character"),
        ("gait.trot.steps", 3.5, "3.5 is no whole number of 53 bits"),
        ("gait.trot.steps", math.inf, "inf is no whole number"),
        ("gait.trot.steps", 1e300, "1e+300 is no whole number"),
        ("gains", "[[1.0]]", "it is no list of numbers, texts, or true and false"),
        ("gains", "1.0", "it is no list of numbers, texts, or true and false"),
    ],
)
def test_what_is_not_accepted(name: str, given: Any, why: str) -> None:
    found = next(each for each in WALKER if each.name == name)
    with pytest.raises(ValueError) as caught:
        accepted(found, given)
    assert str(caught.value).startswith(why)


# Kinds of numbers -----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("value", "lower", "upper", "kind"),
    [
        (0.0, -1.0, 1.0, "slider"),
        (0.5, 0.0, 10.0, "slider"),
        (0.001, 0.0, 10.0, "number"),  # four decades
        (1.0, 1e-6, 1e3, "number"),
        (0.0, -math.inf, math.inf, "number"),
        (0.0, 0.0, 1e-12, "number"),
        (3.0, 3.0, 3.0, "number"),
        (5.0, 0.0, 1.0, "number"),  # outside, which viser would refuse
        (0.5, 1.0, 0.0, "number"),
        (0.5, math.nan, math.nan, "number"),
        (5, 0, 1000, "slider"),
        (8080, 0, 65535, "number"),
        (2**60, 0, 2**62, "text"),
        (5, -(2**63), 2**63 - 1, "number"),
        (math.inf, None, None, "text"),
        (1e-12, None, None, "text"),
        (1e300, None, None, "text"),
    ],
)
def test_the_input_of_a_number(
    server: PageServer, value: float, lower: float | None, upper: float | None, kind: str
) -> None:
    made = parameter("n", value, lower, upper)
    assert kind_of(made) == kind
    handle = ParameterInput(server.gui, made, lambda given: None)._handle
    assert type(value)(handle.value) == value
    assert type(handle.value) is (str if kind == "text" else float)  # whatever a browser sends
    # viser would let nobody type more digits than the present value has.
    expected = None if kind == "text" else 0 if isinstance(value, int) else 12
    assert getattr(handle, "precision", None) == expected


@given(
    st.integers(-400, 400),
    st.integers(1, 2000),
    st.sampled_from([1e-3, 0.05, 1.0, 20.0]),
    st.data(),
)
def test_a_step_hits_the_value(low: int, count: int, unit: float, data: st.DataObject) -> None:
    lower, upper = low * unit, (low + count) * unit
    value = lower + data.draw(st.integers(0, count)) * unit
    step = slider_step(lower, upper, value)
    assert 0.0 < step <= (upper - lower) / 200 * (1 + 1e-6)
    steps = (value - lower) / step
    assert abs(steps - round(steps)) < 1e-3
    mantissa = f"{step:.3e}".partition("e")[0]
    assert mantissa in ("1.000", "2.000", "5.000")
