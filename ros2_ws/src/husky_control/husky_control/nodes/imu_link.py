"""The controller's side of the IMU: which of its samples a tick uses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu

from husky_control.estimation.imu_mount import ImuMount
from husky_control.nodes.imu_decoder import ImuSample, decode_imu
from husky_control.nodes.tick_input import TickInput
from husky_control.tick_data import Measurements
from husky_description.arrays import Array
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.message_guard import Refused
from husky_runtime.nodes.presence import make_peer

_PERIOD_NS = 1_250_000
"""The VN-200 sends at 800 Hz (thesis T4) [ns]."""
_NEVER = 1e6
"""Age of an IMU sample that has never come [s]."""
_UNKNOWN = 1.0
"""Variance where the IMU tells none, which it says by zeros or a -1 [rad^2], [rad^2/s^2]."""


class ImuLink(TickInput[ImuSample]):
    """Keeps samples until the tick that uses them: the newest that was due before it.

    Attributes:
        hot: subscription to the samples.
        time_ns: stamp of the sample that was used last [ns].
    """

    def __init__(
        self,
        node: Node,
        grace: float,
        mount: ImuMount,
        on_sample: Callable[[], None],
        *,
        lockstep: bool,
    ):
        """Open the subscription.

        Args:
            node: the controller's.
            grace: wall time a silent IMU is waited for in lockstep [s].
            mount: where the IMU sits.
            on_sample: called for each sample.
            lockstep: a tick takes the newest sample of before it; otherwise simply the newest.
        """
        peer = make_peer(node, graph.VN200_DRIVER, grace, start_grace=None)
        without = "going on without it"
        super().__init__(node, graph.IMU, peer, _PERIOD_NS, 16, without, from_start=lockstep)
        self.time_ns = 0
        self._mount = mount
        self._sample: ImuSample | None = None
        self._on_sample = on_sample
        self._lockstep = lockstep
        self.hot: Subscription = node.create_subscription(
            Imu, graph.IMU, self._on_imu, qos.CONTROL, raw=True
        )

    def _on_imu(self, data: bytes) -> None:
        try:
            sample = decode_imu(data)
        except ValueError as error:
            raise Refused(str(error)) from None
        if self._keep(sample.time_ns, sample):
            self._on_sample()

    def fill(self, time_ns: int, measurements: Measurements) -> None:
        """Write the sample that a tick of this time uses, and its age."""
        samples = self._messages
        entry = samples.known(time_ns - 1) if self._lockstep else samples.newest()
        if entry is None:
            measurements.imu_age = _NEVER
            return
        self.time_ns, sample = entry
        self._sample = sample
        self._mount.tell(
            sample.orientation, sample.angular_velocity, sample.specific_force, measurements
        )
        measurements.imu_age = (time_ns - self.time_ns) / 1e9

    @property
    def attitude_variance(self) -> Array:
        """About the axes of the world, of the sample that was used last [rad^2] (3,)."""
        return _variances(self._sample and self._sample.orientation_covariance)

    @property
    def rate_variance(self) -> Array:
        """Of base's angular velocity, of the sample that was used last [rad^2/s^2] (3,)."""
        sample = self._sample
        return self._mount.variance(_variances(sample and sample.angular_velocity_covariance))

    def restart(self, time_ns: int) -> None:
        """The world starts again at an earlier time: nothing of before counts."""
        super().restart(time_ns)
        self._mount.restart()


def _variances(covariance: Array | None) -> Array:
    """Return the diagonal of a covariance (9,) as an IMU tells it."""
    if covariance is None:
        return np.full(3, _UNKNOWN)
    diagonal = covariance[::4]
    return np.where(diagonal > 0.0, diagonal, _UNKNOWN)
