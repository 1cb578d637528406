"""Live parameters: ranges, refusals, the gait they make."""

import importlib
import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_control import parameters as parameters_module
from husky_control.gait import COLUMN_UNITS, GAITS
from husky_control.parameters import TABLE, Parameters

NAMES = sorted(TABLE)


@pytest.mark.parametrize("name", NAMES)
def test_every_row_has_a_default_in_its_range_a_unit_and_a_meaning(name):
    row = TABLE[name]
    assert row.lower < row.upper
    assert row.lower <= row.default <= row.upper
    assert row.unit and row.description and not row.description.endswith(".")


@pytest.mark.parametrize("name", NAMES)
def test_the_ends_of_a_range_are_allowed_and_beyond_is_refused_with_the_range(name):
    parameters, row = Parameters(), TABLE[name]
    for value in (row.lower, row.upper):
        parameters.set(name, value)
        assert parameters[name] == value
    revision = parameters.revision
    for value in (row.lower - 1e-6, row.upper + 1e-6, math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError) as refusal:
            parameters.set(name, value)
        message = str(refusal.value)
        assert name in message and row.unit in message
        assert f"{row.lower:g} to {row.upper:g}" in message
    assert parameters[name] == row.upper, "a refused value must not be taken"
    assert parameters.revision == revision, "a refused value is no change"


@given(st.sampled_from(NAMES), st.floats(allow_nan=True, allow_infinity=True))
def test_a_value_is_taken_if_and_only_if_it_is_in_range(name, value):
    parameters, row = Parameters(), TABLE[name]
    try:
        parameters.set(name, value)
    except ValueError:
        assert not row.lower <= value <= row.upper
        assert parameters[name] == row.default
    else:
        assert row.lower <= value <= row.upper
        assert parameters[name] == value


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match=r"there is no parameter 'walk\.speed'"):
        Parameters().set("walk.speed", 1.0)
    with pytest.raises(ValueError, match="there is no gait 'gallop'; there are crawl"):
        Parameters().gait("gallop")


def test_values_of_the_constructor_are_checked_too():
    assert Parameters({"safety.max_tilt": 0.5})["safety.max_tilt"] == 0.5
    with pytest.raises(ValueError, match=r"safety\.max_tilt"):
        Parameters({"safety.max_tilt": 5.0})


def test_each_change_is_seen_in_the_revision():
    parameters = Parameters()
    before = parameters.revision
    parameters.set("safety.max_tilt", 0.5)
    assert parameters.revision == before + 1


@pytest.mark.parametrize("name", sorted(GAITS))
def test_gaits_are_made_of_their_parameters(name):
    parameters = Parameters()
    assert parameters.gait(name) == GAITS[name]
    for column in COLUMN_UNITS:
        row = TABLE[f"gait.{name}.{column}"]
        assert row.unit == COLUMN_UNITS[column]
        value = 0.5 * (row.lower + row.upper)
        parameters.set(f"gait.{name}.{column}", value)
        assert getattr(parameters.gait(name), column) == value
    others = set(GAITS) - {name}
    assert all(parameters.gait(other) == GAITS[other] for other in others)


def test_iteration_is_the_table():
    assert list(Parameters()) == list(TABLE)


# -------------------------------------------------------- the document about walking

DOCUMENT = Path(__file__).resolve().parents[4] / "docs/locomotion.md"


def names_in_document():
    return re.findall(r"`([a-z_]+(?:\.[a-z_]+)+)`", DOCUMENT.read_text())


def test_parameters_named_in_the_document_exist():
    groups = {name.partition(".")[0] for name in TABLE}
    named = [name for name in names_in_document() if name.partition(".")[0] in groups]
    modules = {path.stem for path in Path(parameters_module.__file__).parent.glob("*.py")}
    named = [name for name in named if name.partition(".")[0] not in modules or name in TABLE]
    assert len(named) > 10
    for name in named:
        assert name in TABLE, f"{name} is in {DOCUMENT.name}"


def test_functions_named_in_the_document_exist():
    package = Path(parameters_module.__file__).parent
    modules = {path.stem for path in package.glob("*.py")}
    named = [name for name in names_in_document() if name not in TABLE]
    named = [name.split(".") for name in named if name.partition(".")[0] in modules]
    assert len(named) > 8
    for module, *attributes in named:
        found = importlib.import_module(f"husky_control.{module}")
        for attribute in attributes:
            found = getattr(found, attribute)
