"""The process `flight_controller` on a bench, in a unit that stands still."""

import socket

from node_bench import DeviceThread, NodeBench
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from husky_msgs.msg import FanCommand, FlightSensors
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

VOLTAGE = 24.5
_ANSWER_TIME = 0.05
"""Wall time after which a sample without an answer is sent again [s]."""
_SAMPLES = 2
"""Of each tick: a thread that sleeps for 2 ms is back after 4."""
_AHEAD_NS = 8 * graph.TICK_PERIOD_NS
"""How far samples are ahead of answers at most [ns]; the flight controller's queue holds 16."""


class FlightBench(NodeBench):
    """Level and at rest, heading north: publishes its sensors and keeps the answers.

    Attributes:
        udp_port: where the flight controller listens.
        commands: every command of the fans that has come.
        time_ns: of the newest state.
    """

    def __init__(self, domain, directory, **parameters):
        super().__init__(domain, directory, "husky_pu.nodes.flight_controller")
        self.udp_port = free_port()
        self.pixhawk, self.sbus = str(directory / "pixhawk"), str(directory / "sbus")
        self.publisher = self.node.create_publisher(
            FlightSensors, graph.FLIGHT_SENSORS, qos.CONTROL
        )
        self.commands = []
        self._listener().create_subscription(
            FanCommand, graph.FAN_COMMAND, self.commands.append, qos.CONTROL
        )
        self.time_ns = -graph.TICK_PERIOD_NS
        values = {
            "udp_port": self.udp_port,
            "serial_port": self.pixhawk,
            "sbus_port": self.sbus,
            "time": "realtime",
            **parameters,
        }
        self.start(**values)

    def _listener(self):
        """Return the node that hears the commands."""
        return self.node

    def say(self):
        """Publish what the sensors measure now."""
        message = FlightSensors()
        stamps.fill(message.stamp, self.time_ns)
        message.specific_force = [0.0, 0.0, -9.81]
        message.magnetic_field = [0.21, 0.0, 0.43]
        message.pressure = 101325.0
        message.battery_voltage, message.battery_current = VOLTAGE, 2.0
        message.fan_speed = message.fan_current = [0.0] * 4
        self.publisher.publish(message)

    @property
    def answered_ns(self):
        """Stamp of the last command of the fans [ns]."""
        return stamps.to_ns(self.commands[-1].stamp) if self.commands else -graph.TICK_PERIOD_NS


class RunningFlightBench(FlightBench):
    """The same by itself, at about real time, few samples ahead of the answers.

    A flight controller that stands still for long would otherwise lose samples in its queue, and
    find that its sensors are lost.
    """

    def __init__(self, domain, directory, **parameters):
        super().__init__(domain, directory, **parameters)
        self._thread = DeviceThread(graph.TICK_PERIOD, self._tick)
        self._thread.start()

    def _listener(self):
        self._ear = Node("plant", context=self.context)
        self._ears = SingleThreadedExecutor(context=self.context)
        self._ears.add_node(self._ear)
        return self._ear

    def _tick(self, _):
        answered_ns = self.answered_ns
        if self.time_ns > answered_ns + _AHEAD_NS:
            self._ears.spin_once(timeout_sec=_ANSWER_TIME)
            if self.answered_ns == answered_ns:
                self.say()  # it may be lost
            return
        for _ in range(_SAMPLES):
            self.time_ns += graph.TICK_PERIOD_NS
            self.say()
            self._ears.spin_once(timeout_sec=0.0)

    def advance(self, seconds):
        """Wait until so much of its time has gone by."""
        end = self.time_ns + round(1e9 * seconds)
        self.wait(lambda: self.answered_ns >= end, f"{seconds} s of its time")

    def _give_back(self):
        self._thread.end()
        self._ears.shutdown()
        self._ear.destroy_node()
        super()._give_back()


def free_port():
    """Return a UDP port that nobody uses just now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
