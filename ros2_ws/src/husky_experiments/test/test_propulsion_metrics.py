"""The propulsion unit's tables and measures, against the flight that was made up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_experiments.metrics import propulsion as propulsion_metrics
from husky_experiments.recordings.recording import Recording
from husky_sim.propulsion.battery import open_circuit_voltage

ROBOT = load_robot()


@pytest.fixture(scope="module")
def recording(unit_bag: Path) -> Recording:
    return Recording(unit_bag)


def test_tables_hold_what_was_recorded(recording: Recording, unit_flight: Any) -> None:
    fans, state = recording.fans, recording.propulsion
    assert len(fans) == 601
    assert len(state) == 301
    assert np.allclose(fans.thrust[300], unit_flight.thrust)
    assert np.allclose(fans.force[300], unit_flight.force)
    assert np.allclose(fans.moment[300], [0.1, 0.2, 0.3])
    assert fans.rope_taut.shape == (601, 2)
    assert fans.rope_taut.dtype == np.bool_
    assert fans.battery_current[0] == unit_flight.current_idle
    assert state.pwm[-1].tolist() == [1300] * 4
    assert set(state.mode) == {"STABILIZED"}
    assert not state.armed[0]
    assert state.armed[-1]
    assert np.allclose(
        state.rpy_desired[:, 2], unit_flight.yaw * np.sin(state.time) + unit_flight.compass
    )


def test_attitude_while_slack_and_taut(recording: Recording, unit_flight: Any) -> None:
    """Only roll is wrong; over three axes its error counts as one over the root of three."""
    result = propulsion_metrics.attitude_summary(recording, 0.0, unit_flight.duration)
    slack, taut = np.degrees((unit_flight.roll_slack, unit_flight.roll_taut))
    assert result["attitude_rms_deg"] == pytest.approx(slack / np.sqrt(3.0), rel=1e-6)
    assert result["attitude_rms_taut_deg"] == pytest.approx(taut / np.sqrt(3.0), rel=1e-6)
    assert result["attitude_measured_rms_deg"] == pytest.approx(slack / np.sqrt(3.0), rel=1e-6)
    assert result["roll_rms_deg"] == pytest.approx(slack, rel=1e-6)
    assert result["yaw_rms_deg"] == pytest.approx(0.0, abs=1e-5)
    assert result["heading_offset_deg"] == pytest.approx(np.degrees(unit_flight.compass), rel=1e-6)
    both = np.hypot(slack, np.degrees(unit_flight.compass)) / np.sqrt(3.0)
    assert result["attitude_to_true_north_rms_deg"] == pytest.approx(both, rel=1e-3)
    # 1 s to 6 s is flown, 1 s of it at a rope: 50 samples a second, both ends counted
    assert result["duration_slack_s"] == pytest.approx(4.02, abs=0.021)
    assert result["duration_taut_s"] == pytest.approx(1.0, abs=0.021)


def test_nothing_is_flown_on_the_ground(recording: Recording, unit_flight: Any) -> None:
    result = propulsion_metrics.attitude_summary(recording, 0.0, unit_flight.spin_up - 0.1)
    assert result["duration_slack_s"] == result["duration_taut_s"] == 0.0
    assert np.isnan(result["attitude_rms_deg"])


def test_ropes(recording: Recording, unit_flight: Any) -> None:
    spans = propulsion_metrics.taut_spans(recording.fans)
    assert np.allclose(spans, unit_flight.taut)
    times = np.array([0.5, 1.6, 4.2, 5.0])
    assert propulsion_metrics.taut(recording.fans, times).tolist() == [True, False, True, False]


def test_open_circuit_voltage_is_the_plants() -> None:
    curve = ROBOT.battery.cells * np.array(ROBOT.battery.cell_voltage)
    charge = np.linspace(-0.1, 1.1, 61)
    expected = [open_circuit_voltage(float(share), curve) for share in charge]
    assert np.allclose(propulsion_metrics.open_circuit_voltage(ROBOT, charge), expected)


def test_battery_by_its_resistance(recording: Recording, unit_flight: Any) -> None:
    before, after = (0.0, 0.9), (5.0, 6.0)
    result = propulsion_metrics.battery_summary(recording, ROBOT, before, after)
    rise = unit_flight.current_flying - unit_flight.current_idle
    assert result["current_rise_a"] == pytest.approx(rise)
    # Momentum theory of four ducts, rho A v^2 each: a jet's power is T^1.5 / (2 sqrt(rho A)).
    fans, thrust = ROBOT.fans, recording.fans.between(*after).thrust.mean(axis=0)
    jets = np.sum(thrust**1.5) / (2.0 * np.sqrt(fans.air_density * fans.flow_area))
    least = jets / result["voltage_after_v"]
    assert result["current_rise_least_a"] == pytest.approx(least, rel=1e-3)
    assert result["resistance_mohm"] == pytest.approx(12.0)
    # the curve's slope is 5.4 V over the charge; the middles of the two spans are 5.05 s apart
    lost = 5.4 * -unit_flight.charge_rate * 5.05
    assert result["voltage_drop_expected_v"] == pytest.approx(0.012 * rise + lost, rel=1e-3)
    # means over some 50 samples of alternating noise: 4 mV / 46 at most
    assert result["voltage_drop_v"] == pytest.approx(0.012 * rise + lost, abs=3e-4)
    assert result["voltage_drop_ratio"] == pytest.approx(1.0, abs=2e-3)
    assert result["resistance_measured_mohm"] == pytest.approx(12.0, abs=0.05)
    assert result["voltage_before_v"] > result["voltage_after_v"]


def test_another_resistance_is_seen(recording: Recording) -> None:
    """What was measured does not hide a pack that is worse than the configured one."""
    worse = load_robot(battery__wiring_resistance=0.009)
    result = propulsion_metrics.battery_summary(recording, worse, (0.0, 0.9), (5.0, 6.0))
    assert result["resistance_mohm"] == pytest.approx(18.0)
    assert result["resistance_measured_mohm"] == pytest.approx(12.0, abs=0.05)
    assert result["voltage_drop_ratio"] < 0.8


def test_the_camera_finds_the_base(recording: Recording, unit_flight: Any) -> None:
    seen = propulsion_metrics.base_by_t265(recording, ROBOT)
    expected = [unit_flight.position(time) for time in seen.time]
    assert np.allclose(seen.position, expected, atol=1e-9)
    turn = Rotation.from_quat(seen.orientation)
    truth = Rotation.from_quat([unit_flight.attitude(time).as_quat() for time in seen.time])
    assert np.allclose((turn.inv() * truth).magnitude(), 0.0, atol=1e-9)
