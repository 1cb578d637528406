"""The simulated Pixhawk's sockets: MAVLink by UDP and on a serial line, the radio's SBUS."""

from __future__ import annotations

from rclpy.node import Node

from husky_pu.autopilot.autopilot import Autopilot
from husky_pu.autopilot.mavlink_ports import UdpPort, default_port
from husky_pu.autopilot.mavlink_server import MavlinkServer
from husky_pu.radio import sbus
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.ports.pty_port import PtyPort

_SERIAL = "serial"
"""Name of the serial line's link, which is there while somebody has the port open."""


class FlightControllerPorts:
    """Ports that the parameters ask for, each may be missing; `radio` has what SBUS brought."""

    def __init__(self, node: Node, server: MavlinkServer):
        """Declare parameters, open the ports, speak to the ground station.

        Raises:
            OSError: a port is taken.
            ValueError: an address that is none.
        """
        what = (
            "local UDP port of MAVLink; 0 for PX4's 18570 plus ROS_DOMAIN_ID, plus 233 n for a "
            "robot whose namespace ends with the number n; -1 for none"
        )
        udp_port = declare(node, "udp_port", 0, what, -1, 65535)
        udp_host = declare(node, "udp_host", "127.0.0.1", "address to listen at")
        what = "host:port of a ground station to speak to first"
        station = declare(node, "ground_station", "", what)
        what = "where the serial line with MAVLink appears, empty for none"
        serial_port = declare(node, "serial_port", default_serial_port(node, "pixhawk"), what)
        self._baud = declare(node, "baud", 921600, "of that line [baud]", 9600, 3000000)
        what = "where the radio receiver's line appears, empty for none"
        sbus_port = declare(node, "sbus_port", default_serial_port(node, "sbus"), what)
        udp_port = udp_port or default_port(node.context.get_domain_id(), node.get_namespace())
        self._udp = UdpPort(udp_port, station, udp_host) if udp_port > 0 else None
        self._serial = PtyPort(serial_port) if serial_port else None
        self._sbus = PtyPort(sbus_port) if sbus_port else None
        self.radio = sbus.SbusParser()
        if self._udp is not None and self._udp.station is not None:
            server.open_link(self._udp.station)

    @property
    def dropped(self) -> int:
        """Bytes of the serial line that nobody read."""
        return self._serial.dropped if self._serial is not None else 0

    def receive(self, autopilot: Autopilot) -> list[sbus.Frame]:
        """Give the autopilot what has come by MAVLink; return the radio's frames."""
        server = autopilot.server
        if self._udp is not None:
            for link, data in self._udp.read():
                autopilot.receive(data, link)
        if self._serial is not None:
            connected = self._serial.connected
            data = self._serial.read(self._baud)
            if data:
                autopilot.receive(data, _SERIAL)
            if self._serial.connected and not connected:
                server.open_link(_SERIAL)
            elif connected and not self._serial.connected:
                server.links.close(_SERIAL)
        data = self._sbus.read(sbus.BAUD) if self._sbus is not None else b""
        return list(self.radio.feed(data)) if data else []

    def send(self, server: MavlinkServer) -> None:
        """Put on every link what waits for it."""
        for link in server.links.addressees:
            data = server.links.take_output(link)
            if not data:
                continue
            if self._serial is not None and link == _SERIAL:
                self._serial.write(data, self._baud)
            elif self._udp is not None:
                self._udp.write(link, data)

    def close(self) -> None:
        """Give the ports back."""
        for port in (self._udp, self._serial, self._sbus):
            if port is not None:
                port.close()
