"""The far side of the bus "sim" in the drive bridge's process: motors that the plant moves."""

from __future__ import annotations

import numpy as np
from rclpy.lifecycle import LifecycleNode
from rosgraph_msgs.msg import Clock

from husky_drivers.nodes.pacer import BridgeCycle, StreamPacer
from husky_msgs.msg import ServoCommand, ServoState
from husky_msgs.srv import InjectFault
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_sim.devices.drives.segment import SERVO_COMMAND, SimulatedSegment


class PlantPacer(StreamPacer[ServoState]):
    """Begins a cycle when the plant's motors have moved on; tells it what the drives then do."""

    def __init__(self, node: LifecycleNode, cycle: BridgeCycle, bus: SimulatedSegment):
        """Subscribe to the plant and offer faults."""
        super().__init__(node, cycle, graph.SERVO_STATE, lambda state: stamps.to_ns(state.stamp))
        self._bus = bus
        self._command = ServoCommand()
        self._publisher = node.create_publisher(
            ServoCommand, graph.SERVO_COMMAND, qos.CONTROL_OFFERED
        )
        self.hot += [
            node.create_subscription(Clock, graph.CLOCK, self._on_clock, qos.CLOCK),
            node.create_subscription(ServoState, graph.SERVO_STATE, self._on_message, qos.CONTROL),
        ]
        node.create_service(InjectFault, graph.DRIVES_INJECT_FAULT, self._on_inject_fault)

    def _on_clock(self, clock: Clock) -> None:
        self._gate.hear_witness(stamps.to_ns(clock.clock))

    def _take(self, message: ServoState) -> None:
        self._bus.set_servo_state(
            message.encoder_count, message.velocity_count, message.current, message.bus_voltage
        )

    def _say_again(self) -> None:
        self._publisher.publish(self._command)

    def cycle_ended(self, time_ns: int) -> None:
        """Tell the plant what the power stages do next."""
        if time_ns < 0:
            return  # the plant has not spoken yet
        servos, message = self._bus.servo_command(), self._command
        stamps.fill(message.stamp, time_ns)
        stamps.fill(message.imu_stamp, self._cycle.imu_stamp_ns)
        for name in SERVO_COMMAND.names or ():
            setattr(message, name, np.ascontiguousarray(servos[name]))
        self._publisher.publish(message)

    def _on_inject_fault(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        try:
            if request.fault:
                self._bus.inject(request.target, request.fault)
            else:
                self._bus.clear(request.target or None)
        except ValueError as error:
            response.message = str(error)
        response.success = not response.message
        return response
