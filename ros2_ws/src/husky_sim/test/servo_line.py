"""Emulated servos on a pseudo-terminal, and ROBOTIS's SDK at its other end."""

import threading

from dynamixel_sdk import Protocol2PacketHandler

from husky_description.robot import load_robot
from husky_drivers.dynamixel.port import DynamixelPort
from husky_runtime.ports.pty_port import PtyPort
from husky_sim.devices.bus_servos.bus import EmulatedServoBus
from husky_sim.devices.bus_servos.motors import BusServoMotors

ROBOT = load_robot("beta")
SERVO = ROBOT.bus_servo


class Line:
    """Servos on a line that is served all the time, and the SDK at its other end."""

    def __init__(self, directory):
        self.motors = BusServoMotors(SERVO, 12, 0.0005)
        self.bus = EmulatedServoBus(SERVO, ROBOT.joint_names, self.motors)
        self.far = PtyPort(directory / "line")
        self.ended, self.held = threading.Event(), threading.Lock()
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()
        self.port = DynamixelPort(str(self.far.path), SERVO.baud_rate, 5.0)
        self.port.open()
        self.sdk = Protocol2PacketHandler()

    def _serve(self):
        while not self.ended.wait(0.0003):
            with self.held:
                self.far.service(self.bus)

    def impatient(self):
        """A port that waits for no missing answer."""
        self.port._patience = 0.05
        return self.port

    def close(self):
        self.ended.set()
        self.thread.join()
        self.port.close()
        self.far.close()
