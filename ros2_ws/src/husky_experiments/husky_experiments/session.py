"""A running graph, as an experiment sees it: advance, command, push, break, restart, wait.

In lockstep the world is paused whenever this class does not advance it, a command is at its node
before the next tick, and what nodes report of the ticks gone by is here before a script looks at
it. So a script gives the same trajectory however fast anything ran.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from geometry_msgs.msg import Twist
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import Joy
from std_srvs.srv import SetBool, Trigger

from husky_bringup.processes import Nodes
from husky_bringup.system import NodeSpec, ParameterValue, simulated_robot
from husky_experiments.discovery import subscribers
from husky_experiments.hearing import HeardGraph
from husky_experiments.link import ANSWER_PERIOD, SessionError
from husky_msgs.srv import (
    ApplyWrench,
    InjectFault,
    ResetWorld,
    SetFlightMode,
    SetGait,
    SetMode,
    StepWorld,
)
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

__all__ = ["Session", "SessionError"]

_CHUNK_TICKS = 100
"""Ticks between two messages on /cmd_vel, well below the 0.5 s after which it counts as silent."""
_CLOCK_PERIOD = 0.01
"""Of /clock [s]."""


_PLANT_SERVICES = {
    graph.PLANT_STEP: StepWorld,
    graph.PLANT_PAUSE: SetBool,
    graph.PLANT_RESET: ResetWorld,
    graph.PLANT_APPLY_WRENCH: ApplyWrench,
    graph.PLANT_HOLD: SetBool,
    graph.PLANT_INJECT_FAULT: InjectFault,
}
_LEG_SERVICES = {
    graph.DRIVES_ENABLE: Trigger,
    graph.DRIVES_DISABLE: Trigger,
    graph.DRIVES_RESET_FAULTS: Trigger,
    graph.DRIVES_EMERGENCY_STOP: Trigger,
    graph.DRIVES_CUT: Trigger,
    graph.SET_MODE: SetMode,
    graph.SET_GAIT: SetGait,
}
_DRIVE_SERVICES = {graph.DRIVES_INJECT_FAULT: InjectFault}
_FAN_SERVICES = {
    graph.PROPULSION_ARM: SetBool,
    graph.PROPULSION_KILL: Trigger,
    graph.PROPULSION_SET_MODE: SetFlightMode,
}
_PROBES = {
    graph.PLANT_INJECT_FAULT: InjectFault.Request(target="nothing"),
    graph.DRIVES_INJECT_FAULT: InjectFault.Request(target="nothing"),
    graph.SET_GAIT: SetGait.Request(gait="nothing"),
    graph.PROPULSION_SET_MODE: SetFlightMode.Request(mode="nothing"),
}
"""For the last service of each node above, a request that it refuses."""


def _services_of(specs: tuple[NodeSpec, ...]) -> dict[str, type]:
    """Return the services of the nodes that there are, by name."""
    names = {spec.name for spec in specs}
    return {
        **_PLANT_SERVICES,
        **(_LEG_SERVICES if not names.isdisjoint(graph.JOINT_BRIDGES) else {}),
        **(_DRIVE_SERVICES if graph.DRIVE_BRIDGE in names else {}),
        **(_FAN_SERVICES if graph.PIXHAWK_BRIDGE in names else {}),
    }


class Session(HeardGraph):
    """Starts the graph, and drives it tick by tick (lockstep) or beside the wall clock (realtime).

    What the graph refuses raises SessionError, with the reason.

    Attributes:
        trajectory_sha256: digest of every state of the world so far.
    """

    def __init__(
        self,
        output: Path,
        settings: Mapping[str, Mapping[str, ParameterValue]] | None = None,
        *,
        record: bool = True,
        on_advance: Callable[[float], None] | None = None,
        clock: str = "lockstep",
        remote: bool = False,
        nodes: Nodes | None = None,
    ):
        """Start every node and wait until the graph is complete.

        Args:
            output: directory for logs and, when recording, `bag`.
            settings: parameters by node name.
            record: whether a recorder takes part.
            on_advance: called with the simulated time [s] now and then.
            clock: one of `husky_bringup.system.TIMES`.
            remote: whether the remote control takes part.
            nodes: who starts, kills and ends them; by default they are processes of ours.

        Raises:
            SessionError: a node ended or did not come up.
        """
        chosen = {name: dict(values) for name, values in (settings or {}).items()}
        chosen.setdefault(graph.PLANT, {})["start_paused"] = True
        specs = simulated_robot(clock, chosen, str(output / "bag") if record else None, remote)
        self.trajectory_sha256 = ""
        self._on_advance = on_advance
        self._appointment: tuple[float, Callable[[], None]] | None = None
        self._velocity = (0.0, 0.0, 0.0)
        self._send_velocity = False
        self._lockstep, self._remote = clock == "lockstep", remote
        super().__init__("experiment", specs, output, _services_of(specs), _PROBES, nodes)
        self._joy = self._node.create_publisher(Joy, graph.JOY, qos.COMMAND)
        self._cmd_vel = self._node.create_publisher(Twist, graph.CMD_VEL, qos.COMMAND)
        self._or_close(self._meet)

    def _meet(self) -> None:
        """Wait until everybody is heard; let the world go on, or the radio begin."""
        self.wait_for(self._is_heard, "those who report and those who take commands")
        if not self._lockstep:
            self.pause(False)
        elif self._remote:
            self._begin_radio()

    def _is_heard(self) -> bool:
        """Whether this side's own topics have found their other ends."""
        if self._remote and self._joy.get_subscription_count() < 1:
            return False
        listeners = len(subscribers(self._node, graph.CMD_VEL))
        return self._cmd_vel.get_subscription_count() >= listeners and self._hears_reports()

    def _begin_radio(self) -> None:
        """Step to the radio's first frame and wait until the autopilot has it.

        The autopilot counts frames from the first one on, so that one must come at the same tick in
        every run.
        """
        self.advance(_CLOCK_PERIOD)
        self.wait_for(lambda: self._radio_frames > 0, "the radio's first frame at the autopilot")

    # Time -----------------------------------------------------------------------------------
    def pause(self, paused: bool = True) -> None:
        """Pause the world, or let it go on by itself."""
        self._expect(graph.PLANT_PAUSE, SetBool.Request(data=paused))

    def advance(self, duration: float, until: Callable[[], bool] | None = None) -> bool:
        """Let simulated time pass.

        Args:
            duration: how long [s].
            until: looked at every 0.2 s of simulated time (lockstep) or all the time (realtime);
                ends the wait early.

        Returns:
            Whether `until` came true; True without one.
        """
        if not self._lockstep:
            return self._wait(duration, until)
        ticks = round(duration / graph.TICK_PERIOD)
        while ticks > 0:
            if until is not None and until():
                return True
            chunk = min(ticks, _CHUNK_TICKS, self._keep_appointment())
            if self._send_velocity:
                self._publish_velocity()
            response = self.call(graph.PLANT_STEP, StepWorld.Request(ticks=chunk))
            if not response.success:
                raise SessionError(f"{graph.absolute(graph.PLANT_STEP)}: {response.message}")
            ticks -= chunk
            self.time = stamps.to_ns(response.stamp) / 1e9
            self.trajectory_sha256 = response.trajectory_sha256
            self._check_processes()
            self._catch_up()
            if self._on_advance is not None:
                self._on_advance(self.time)
        return until is None or until()

    def at(self, time: float, act: Callable[[], None]) -> None:
        """Have something done once, by whatever `advance` gets to a time [s] first (lockstep).

        What it raises ends the passage that is under way.
        """
        self._appointment = (time, act)

    def _keep_appointment(self) -> int:
        """Do what is due; return the ticks until then, when it is not [1 or more]."""
        if self._appointment is None:
            return _CHUNK_TICKS
        time, act = self._appointment
        ticks = round((time - self.time) / graph.TICK_PERIOD)
        if ticks > 0:
            return ticks
        self._appointment = None
        act()
        return _CHUNK_TICKS

    def _wait(self, duration: float, until: Callable[[], bool] | None) -> bool:
        """Realtime: watch simulated time go by.

        Raises:
            SessionError: it does not.
        """
        end = self.time + duration
        deadline = self.now() + ANSWER_PERIOD + 5.0 * duration
        next_velocity = 0.0
        while self.time < end:
            if until is not None and until():
                return True
            now = self.now()
            if now > deadline:
                raise SessionError(f"simulated time stands still at {self.time:.3f} s")
            if self._send_velocity and now > next_velocity:
                next_velocity = now + _CHUNK_TICKS * graph.TICK_PERIOD
                self._publish_velocity()
            self._check_processes()
            self.serve(0.01)
            if self.truth is not None:
                self.time = stamps.to_ns(self.truth.header.stamp) / 1e9
        return until is None or until()

    # Breaking -------------------------------------------------------------------------------
    def reset(self, keyframe: str = "", seed: int = -1) -> None:
        """Put the world back to time zero.

        Args:
            keyframe: posture, empty for the one of the start.
            seed: of all noise, negative for the one in use.
        """
        self._expect(graph.PLANT_RESET, ResetWorld.Request(keyframe=keyframe, seed=seed))
        self._forget()
        self._send_velocity = False

    def start(self, node: str) -> None:
        """Start a node that has been killed or ended, and wait until it can be spoken to.

        In lockstep a plant that has given it up has heard it again.

        Raises:
            SessionError: it ended or did not come up.
        """
        super().start(node)
        if self._lockstep and node != graph.PLANT and self.time > 0.0:
            self._lost_peers = None
            self.wait_for(
                lambda: self._lost_peers is not None and node not in self._lost_peers,
                f"the plant to hear the new {node}",
            )
        if node == graph.LOW_LEVEL_CONTROLLER:
            self._reported[graph.CONTROLLER_STATE] = round(self.time * 1e9)
        elif node == graph.PLANT:
            self._forget()
            self._send_velocity = False

    # Commands -------------------------------------------------------------------------------
    def enable_drives(self) -> None:
        """Enable all drives and wait until they are.

        Raises:
            SessionError: they are not enabled within 3 s.
        """
        self.advance(0.1)  # the controller must be heard before
        self._expect(graph.DRIVES_ENABLE, Trigger.Request())
        end = self.time + 3.0
        while True:
            # Asked, not read from /drives/status: an answer is of this very tick.
            self.advance(0.1)
            answer = self.call(graph.DRIVES_ENABLE, Trigger.Request())
            if answer.success and answer.message == "enabled":
                break
            if self.time > end or not (answer.success or "enabling" in answer.message):
                raise SessionError(f"the drives are not enabled: {answer.message}")
        self.advance(0.02)  # the controller must have seen it too

    def stop_drives(self) -> None:
        """Press the emergency stop of the drives."""
        self._expect(graph.DRIVES_EMERGENCY_STOP, Trigger.Request())

    def set_mode(
        self, mode: str, reached: str | None = None, within: float = 0.0, patience: float = 0.0
    ) -> None:
        """Ask for a mode and wait until it (or the one that follows it) is reached.

        Args:
            mode: name of the mode.
            reached: name of the mode to wait for; the same by default.
            within: simulated time to wait [s], 0 for not waiting.
            patience: simulated time for which a refused request is made again [s].

        Raises:
            SessionError: refused or not reached.
        """
        end = self.time + patience
        while self.time < end and not self.call(graph.SET_MODE, SetMode.Request(mode=mode)).success:
            self.advance(0.1)
        if self.time >= end:
            self._expect(graph.SET_MODE, SetMode.Request(mode=mode))
        wanted = reached or mode
        if within > 0.0 and not self.advance(
            within, lambda: self.state is not None and self.state.mode == wanted
        ):
            mode_now = self.state.mode if self.state is not None else "unknown"
            reason = self.state.reason if self.state is not None else ""
            raise SessionError(
                f"mode {wanted} is not reached within {within} s: {mode_now}, {reason}"
            )

    def start_again(self) -> None:
        """Take the torque off and put the robot back to where it started, passive."""
        self._expect(graph.DRIVES_DISABLE, Trigger.Request())
        self.advance(0.2)
        self.reset()
        if not self.advance(1.0, lambda: self.state is not None):
            raise SessionError("the controller is silent after the reset")
        if self.state is not None and self.state.mode != "passive":
            self._expect(graph.SET_MODE, SetMode.Request(mode="passive"))
        self._expect(graph.DRIVES_RESET_FAULTS, Trigger.Request())
        self.advance(0.2)

    def set_gait(self, gait: str) -> None:
        """Choose the gait of the next walk."""
        self._expect(graph.SET_GAIT, SetGait.Request(gait=gait))

    def set_velocity(self, vx: float, vy: float = 0.0, yaw_rate: float = 0.0) -> None:
        """Command a velocity from now on, sent again every 0.2 s [m/s, m/s, rad/s]."""
        self._velocity = (float(vx), float(vy), float(yaw_rate))
        self._send_velocity = True

    def release_velocity(self) -> None:
        """Stop sending velocity commands: the operator has gone."""
        self._send_velocity = False

    def _publish_velocity(self) -> None:
        twist = Twist()
        twist.linear.x, twist.linear.y, twist.angular.z = self._velocity
        self.publish_twist(twist)

    def publish_twist(self, twist: Twist) -> None:
        """Send one velocity command as it is.

        It is in the controller's queue before the world is asked to step, behind the joint states
        of the last tick, and the controller serves what comes in that order.
        """
        self._cmd_vel.publish(twist)

    def joystick(self, axes: Sequence[float], buttons: Sequence[int]) -> None:
        """Move the sticks of the remote control now: axes -1 to 1, buttons 0 or 1."""
        joy = Joy(axes=[float(a) for a in axes], buttons=[int(b) for b in buttons])
        stamps.fill(joy.header.stamp, round(1e9 * self.time))
        self._joy.publish(joy)

    def arm(self, armed: bool = True) -> None:
        """Arm or disarm the propulsion unit."""
        self._expect(graph.PROPULSION_ARM, SetBool.Request(data=armed))

    def set_flight_mode(self, mode: str) -> None:
        """Choose the autopilot's mode, STABILIZED or OFFBOARD."""
        self._expect(graph.PROPULSION_SET_MODE, SetFlightMode.Request(mode=mode))

    def push(self, force: tuple[float, float, float], duration: float, body: str = "") -> None:
        """Push a body (the base by default) with a force in world [N] for a while [s]."""
        request = ApplyWrench.Request(body=body, duration=float(duration))
        request.wrench.force.x, request.wrench.force.y, request.wrench.force.z = map(float, force)
        self._expect(graph.PLANT_APPLY_WRENCH, request)

    def hold(self, held: bool) -> None:
        """Hold the base in place, as strong hands would, or release it."""
        self._expect(graph.PLANT_HOLD, SetBool.Request(data=held))

    def inject(self, service: str, target: str, fault: str) -> None:
        """Make a device fail, or heal it with an empty fault."""
        self._expect(service, InjectFault.Request(target=target, fault=fault))

    def set_parameter(self, node: str, name: str, value: ParameterValue) -> None:
        """Set a live parameter of a node."""
        service = f"/{node}/set_parameters"
        if service not in self._services:
            self._services[service] = self._node.create_client(SetParameters, service)
            self.wait_for(self._services[service].service_is_ready, service)
        parameter = Parameter(name, value=value).to_parameter_msg()
        result = self.call(service, SetParameters.Request(parameters=[parameter])).results[0]
        if not result.successful:
            raise SessionError(f"{node} refused {name} = {value}: {result.reason}")
