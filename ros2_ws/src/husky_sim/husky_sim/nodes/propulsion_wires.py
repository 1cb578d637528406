"""The plant's side of the propulsion unit and of the T265: their wires, their faults."""

from __future__ import annotations

import math
from collections.abc import Callable

from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_msgs.msg import FanCommand, FanState, FlightSensors
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.message_guard import check_count
from husky_runtime.nodes.presence import make_peer
from husky_sim.devices.t265.device import T265Device
from husky_sim.nodes.answered_wire import AnsweredWire
from husky_sim.nodes.sensor_line import SensorLine
from husky_sim.world import World

_PULSE_TIMEOUT_NS = 20_000_000
"""Realtime: a pulse train that is not renewed for so long has ended [ns]."""
FAN_SUFFIX = "_fan"
"""Fault targets are `<fan>_fan`, by the names of `robot.rotor_names`."""


class PropulsionWires(AnsweredWire):
    """Speaks for the sensors of the flight controller, the fans and the T265.

    Attributes:
        peer: the flight controller, which answers the sensors.
        hot: the subscription that a tick waits for.
    """

    def __init__(
        self, node: Node, world: World, seed: int, grace: float, advance: Callable[[], None]
    ):
        """Open the wires.

        Args:
            node: the plant.
            world: one with fans.
            seed: of the T265.
            grace: wall time a silent flight controller is waited for [s].
            advance: called when the flight controller has answered.
        """
        assert world.fans is not None
        super().__init__(node, world, make_peer(node, graph.FLIGHT_CONTROLLER, grace))
        self._fans, self._advance = world.fans, advance
        self._command_ns = -1
        self._sensors, self._state = FlightSensors(), FanState()
        self._fan_targets = [name + FAN_SUFFIX for name in world.robot.rotor_names]
        self._telemetry = bool(world.robot.esc.telemetry)
        unknown = [math.nan] * len(world.robot.rotor_names)
        self._sensors.fan_speed = self._sensors.fan_current = unknown
        self._sensors_publisher = node.create_publisher(
            FlightSensors, graph.FLIGHT_SENSORS, qos.CONTROL_OFFERED
        )
        self._state_publisher = node.create_publisher(FanState, graph.FAN_STATE, qos.STATUS)
        self.hot: Subscription = node.create_subscription(
            FanCommand, graph.FAN_COMMAND, self._on_command, qos.CONTROL
        )
        self._t265 = SensorLine(
            node,
            T265Device(world.robot.t265, seed),
            "t265_port",
            "the T265's wire",
            make_peer(node, graph.T265_DRIVER, grace),
        )

    # The tick -------------------------------------------------------------------------------
    def _on_command(self, command: FanCommand) -> None:
        check_count("pwm", command.pwm, len(self._fan_targets))
        stamp = stamps.to_ns(command.stamp)
        if stamp > self._world.time_ns:
            return  # of a time before a reset
        self.peer.answer(stamp)
        if stamp < self._command_ns:
            return
        self._command_ns = stamp
        self._fans.pwm[:] = command.pwm
        self._fans.tilt_pwm[:] = command.tilt
        self._advance()

    def driver_is_set_up(self) -> bool:
        """Return whether the T265's driver listens, so that no run misses a pose."""
        return self._t265.is_set_up()

    def watch(self, now: float) -> None:
        """Realtime: as every wire; pulses end when they are not renewed."""
        if self._world.time_ns - self._command_ns > _PULSE_TIMEOUT_NS:
            self._end_pulses()
        super().watch(now)

    def _lose_peer(self) -> None:
        """A dead autopilot gives no pulses."""
        self._end_pulses()
        super()._lose_peer()

    def _end_pulses(self) -> None:
        self._fans.pwm[:] = self._fans.tilt_pwm[:] = 0.0

    def publish(self) -> None:
        """Tell what the flight controller's sensors measure now."""
        sensors, unit, sample = self._sensors, self._fans.unit, self._fans.sample()
        stamps.fill(sensors.stamp, self._world.time_ns)
        sensors.angular_velocity = sample.angular_velocity
        sensors.specific_force = sample.specific_force
        sensors.magnetic_field = sample.magnetic_field
        sensors.pressure = sample.pressure
        sensors.battery_voltage = unit.battery_voltage
        sensors.battery_current = unit.battery_current
        if self._telemetry:
            sensors.fan_speed, sensors.fan_current = unit.speed.tolist(), unit.current.tolist()
        self._send()

    def _say(self) -> None:
        self._sensors_publisher.publish(self._sensors)

    def serve(self) -> None:
        """Carry the T265's poses of this tick, and what is on its wire."""
        for pose in self._world.poses:
            self._t265.device.sample(*pose)
        self._world.poses.clear()
        self._t265.service()

    def publish_state(self) -> None:
        """Tell the truth about the fans."""
        state, unit = self._state, self._fans.unit
        stamps.fill(state.stamp, self._world.time_ns)
        state.speed, state.thrust = unit.speed.tolist(), unit.thrust.tolist()
        state.current = unit.current.tolist()
        state.battery_voltage = unit.battery_voltage
        state.battery_current = unit.battery_current
        state.battery_charge = unit.battery_charge
        force, torque = state.wrench.force, state.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = self._fans.wrench_in_base.tolist()
        state.tilt = self._fans.tilt
        if self._world.gantry is not None:
            state.rope_taut = list(self._world.gantry.taut())
        self._state_publisher.publish(state)

    # Rest -----------------------------------------------------------------------------------
    def restart(self, seed: int) -> None:
        """The world is back at time 0."""
        self._t265.device.restart(seed)
        self.peer.restart()
        self._command_ns = -1

    def inject(self, target: str, fault: str) -> bool:
        """Make a fan, the battery or the T265 fail; return False for another target.

        Raises:
            ValueError: no such fault.
        """
        unit = self._fans.unit
        if target in self._fan_targets:
            if fault not in ("", "fail"):
                raise ValueError(f"fault of a fan is {fault!r}, it must be fail or empty")
            (unit.fail_fan if fault else unit.heal)(self._fan_targets.index(target))
        elif target == "battery":
            unit.set_charge(float(fault) if fault else 1.0)
        elif target == "t265":
            self._t265.inject(fault)
        else:
            return False
        return True

    def targets(self) -> list[str]:
        """Return the names that `inject` knows."""
        return [*self._fan_targets, "battery", "t265"]

    def close(self) -> None:
        """Give the wire back."""
        self._t265.close()
