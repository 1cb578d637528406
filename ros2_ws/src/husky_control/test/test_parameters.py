"""Live parameters: ranges, refusals, the gait they make."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_control.gait.table import COLUMN_UNITS, GAITS
from husky_control.parameters import TABLE, Parameters, table_of
from husky_description.robot import load_robot

NAMES = sorted(TABLE)


@pytest.mark.parametrize("name", NAMES)
def test_every_row_has_a_default_in_its_range_a_unit_and_a_meaning(name):
    row = TABLE[name]
    if not name.endswith((".static_margin", ".hop_speed")):  # which not every gait has
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


@pytest.mark.parametrize("value", ["1.0", None, [1.0]])
def test_only_numbers_are_taken(value):
    parameters = Parameters()
    with pytest.raises(ValueError, match=r"safety\.max_tilt must be within .*, not"):
        parameters.set("safety.max_tilt", value)
    assert parameters["safety.max_tilt"] == TABLE["safety.max_tilt"].default


MISFITS = {
    "a swing too short for the leg": (
        {"gait.trot.period": 0.24, "gait.trot.duty": 0.65},
        "gait.trot.period (0.24 s) and gait.trot.duty (0.65) leave a leg 0.084 s for its swing, "
        "which must take 0.1 to 0.25 s",
    ),
    "a foot lifted too fast": (
        {"gait.trot.period": 0.24, "gait.trot.swing_height": 0.15},
        "gait.trot.swing_height (0.15 m) is too high for a swing of 0.12 s, which gait.trot.period "
        "(0.24 s) and gait.trot.duty (0.5) leave: it must be at most 0.0864 m",
    ),
    "a sway too far": (
        {"gait.crawl.static_margin": 0.06, "gait.crawl.lateral_spread": 0.08},
        "gait.crawl.static_margin (0.06 m) and gait.crawl.lateral_spread (0.08 m) make the body "
        "sway too far: their sum must be at most 0.13 m",
    ),
    "a swing too long for the hop": (
        {"gait.pronk.duty": 0.66, "gait.pronk.hop_speed": 0.5},
        "gait.pronk.hop_speed (0.5 m/s) keeps the body in the air for 0.102 s, but "
        "gait.pronk.period (0.4 s) and gait.pronk.duty (0.66) leave the legs 0.136 s",
    ),
    "contact that is lost as it is found": (
        {"contact.touchdown_force": 6.0, "contact.liftoff_force": 8.0},
        "contact.liftoff_force (8 N) must not be above contact.touchdown_force (6 N)",
    ),
    "more force needed late than early": (
        {"contact.touchdown_force": 20.0, "contact.early_force": 15.0},
        "contact.touchdown_force (20 N) must not be above contact.early_force (15 N)",
    ),
    "a load that nothing allows for": (
        {"wair.load_slope": 0.45, "wair.most_load_slope": 0.4},
        "wair.load_slope (0.45) must not be above wair.most_load_slope (0.4)",
    ),
}


@pytest.mark.parametrize("case", MISFITS)
def test_values_that_do_not_fit_each_other_are_refused_in_any_order(case):
    values, reason = MISFITS[case]
    with pytest.raises(ValueError, match=re.escape(reason)):
        Parameters(values)
    for names in (list(values), list(reversed(values))):
        parameters = Parameters()
        parameters.set(names[0], values[names[0]])  # alone it fits the defaults
        before = {name: parameters[name] for name in parameters}
        revision = parameters.revision
        with pytest.raises(ValueError, match=re.escape(reason)):
            parameters.set_all({"safety.max_tilt": 0.5, names[1]: values[names[1]]})
        assert {name: parameters[name] for name in parameters} == before, "all or none"
        assert parameters.revision == revision


def test_values_that_fit_together_are_taken_together():
    together = {"contact.liftoff_force": 9.0, "contact.touchdown_force": 12.0}
    parameters = Parameters({"contact.touchdown_force": 6.0})
    with pytest.raises(ValueError, match=r"contact\.liftoff_force"):
        parameters.set("contact.liftoff_force", 9.0)
    parameters.set_all(together)
    assert {name: parameters[name] for name in together} == together


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


def test_carbon_s_are_those_of_the_table_to_the_bit():
    assert table_of(load_robot()) == TABLE
    assert table_of(load_robot(payload_mass=3.0)) == TABLE
    own, plain = Parameters.of(load_robot()), Parameters()
    assert {name: own[name] for name in own} == {name: plain[name] for name in plain}


@pytest.mark.parametrize("name", NAMES)
def test_another_size_keeps_what_has_no_dimension(name):
    """Froude's number of a speed, weights of a force, and so on, to the three digits kept."""
    length, mass = 0.5, 0.2
    robot = load_robot(size__length=length, size__mass=mass)
    row, similar = TABLE[name], table_of(robot)[name]
    if name.startswith(("estimator.", "safety.", "command.timeout", "command.zero_")):
        assert similar == row
        return
    time = math.sqrt(length)
    units = {"m": length, "s": time, "N": mass, "rad": 1.0, "-": 1.0, "1": 1.0, "kg": mass}
    # "N m s/rad": what stands before the stroke over all that stands behind it.
    over, *under = row.unit.replace("s^2", "s s").split("/")
    factor = math.prod(units[unit] for unit in over.split())
    factor /= math.prod(units[unit] for part in under for unit in part.split())
    for key in ("default", "lower", "upper"):
        expected = getattr(row, key) * factor
        assert getattr(similar, key) == pytest.approx(expected, rel=0.006, abs=1e-12)


def test_beta_s_fit_each_other_and_carry_its_file_s():
    robot = load_robot("beta")
    parameters = Parameters.of(robot)
    for name, value in robot.gains.items():
        assert parameters[name] == value
    for name in parameters:
        parameters.set(name, parameters[name])
    words = "gait.trot.period must be within 0.36 to 0.5 s, not 0.6"
    with pytest.raises(ValueError, match=re.escape(words)):
        parameters.set("gait.trot.period", 0.6)


def test_a_file_s_gain_that_there_is_not_is_refused(tmp_path):
    path = tmp_path / "robot.yaml"
    for gain, words in (
        ("walk.speed: 1.0", "there is no parameter 'walk.speed'"),
        ("gait.trot.period: 9.0", "gait.trot.period must be within 0.24 to 0.42 s, not 9.0"),
    ):
        path.write_text(load_robot().parameters.replace("gains: {}", f"gains:\n  {gain}"))
        with pytest.raises(ValueError, match=re.escape(words)):
            Parameters.of(load_robot(path))
    path.write_text(load_robot().parameters.replace("gains: {}", "gains:\n  walk.speed: fast"))
    with pytest.raises(ValueError, match=r"^gains\.walk\.speed: 'fast' is not a number"):
        load_robot(path)
    path.write_text(load_robot().parameters.replace("gains: {}", "gains:\n  walk.speed: [1, 2, 3]"))
    with pytest.raises(ValueError, match=r"^gains\.walk\.speed: .* nor \[number, lower, upper\]"):
        load_robot(path)


def test_of_a_node_s_parameters_the_robot_s_own_are_taken():
    """Those of Husky-beta alone are among them; of Husky Carbon they are somebody else's."""
    news = {"quadrotor.height": 1.2, "use_sim_time": True, "walk.position_gain": 0.7}
    beta, carbon = Parameters.of(load_robot("beta")), Parameters.of(load_robot())
    beta.set_own(news)
    carbon.set_own(news)
    assert (beta["quadrotor.height"], beta["walk.position_gain"]) == (1.2, 0.7)
    assert carbon["walk.position_gain"] == 0.7 and "quadrotor.height" not in carbon
    with pytest.raises(ValueError, match=r"quadrotor\.height"):
        beta.set_own({"quadrotor.height": 50.0})
