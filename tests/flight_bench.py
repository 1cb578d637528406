"""The process `flight_controller` on a bench, in a unit that stands still."""

import socket

from node_bench import DeviceThread, NodeBench

from husky_msgs.msg import FanCommand, FlightSensors
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

VOLTAGE = 24.5


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
        self.node.create_subscription(
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
        return stamps.to_ns(self.commands[-1].stamp) if self.commands else -1


class RunningFlightBench(FlightBench):
    """The same at about 500 Hz, by itself."""

    def __init__(self, domain, directory, **parameters):
        super().__init__(domain, directory, **parameters)
        self._thread = DeviceThread(graph.TICK_PERIOD, self._tick)
        self._thread.start()

    def _tick(self, number):
        self.time_ns = number * graph.TICK_PERIOD_NS
        self.say()

    def advance(self, seconds):
        """Wait until so much of its time has gone by."""
        end = self.time_ns + round(1e9 * seconds)
        self.wait(lambda: self.answered_ns >= end, f"{seconds} s of its time")

    def _give_back(self):
        self._thread.end()
        super()._give_back()


def free_port():
    """Return a UDP port that nobody uses just now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
