"""What carries joint commands to a wire and joint states back: all but the wire itself.

A bridge is the graph's heart beat at 500 Hz. Its pacer begins a cycle; in lockstep the cycle waits
for the command that answers the joint states of the one before. `drive_bridge` and `servo_bridge`
are made of it.
"""

from __future__ import annotations

import array
import time
from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from husky_description.urdf import build_urdf
from husky_drivers.joint_master.commanded_master import CommandedMaster
from husky_drivers.joint_master.phase import Phase
from husky_drivers.nodes.bridge_options import declare_bridge
from husky_drivers.nodes.joint_report import JointReport, joint_status
from husky_drivers.nodes.pacer import Pacer
from husky_drivers.nodes.robot_state import RobotState
from husky_msgs.msg import DriveStatusArray, JointCommand
from husky_runtime import graph
from husky_runtime.lockstep import Exchange, Heard
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.executor import executor_of
from husky_runtime.nodes.message_guard import Refused
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.presence import make_peer
from husky_runtime.nodes.transitions import stay_active_under_load

_START_PATIENCE = 10.0
"""Wall time that a request to enable the joints waits for a first command, torque off [s]."""
_STATUS_EVERY = 50
"""Ticks between two messages of status: 10 Hz; a change of phase is told at once."""

_RETRY_PERIOD = 0.5
"""Wall time between two attempts to start [s]."""

MasterT = TypeVar("MasterT", bound=CommandedMaster)


class JointBridge(OneClock, LifecycleNode, ABC, Generic[MasterT]):
    """Carries joint commands to a master and joint states back, and stops the joints when in doubt.

    Implements `husky_drivers.nodes.pacer.BridgeCycle`. A bridge declares what else its wire needs,
    makes its master and its pacer, and calls `_serve`.

    Attributes:
        options: parameters that both bridges have.
    """

    def __init__(self, name: str, actuation: str, master: type[CommandedMaster]) -> None:
        """Make the node; arguments as of `declare_bridge`."""
        super().__init__(name)
        self.options = declare_bridge(self, actuation, master)
        self.lockstep = self.options.lockstep
        self.imu_stamp_ns = 0
        controller = make_peer(self, graph.LOW_LEVEL_CONTROLLER, self.options.grace)
        self._controller = Exchange(controller)
        self._active = self._waiting = self._is_starting = False
        self._tick_ns = -1
        self._last_command = JointCommand()
        self._told: tuple[Phase, str] | None = None
        self._ticks = self._restarts = 0

    def _serve(self, master: MasterT, pacer: Pacer, device: str) -> None:
        """Make publishers, subscriptions and services, and start if that is wanted.

        Args:
            master: of the joints.
            pacer: begins the cycles.
            device: what stands at a joint, for diagnostics.
        """
        self._master, self._pacer = master, pacer
        robot, offer = self.options.robot, self.create_publisher
        self._joints = JointState(name=list(robot.joint_names))
        self._joints.header.frame_id = graph.FRAME_BASE
        self._joint_publisher = offer(JointState, graph.JOINT_STATES, qos.CONTROL_OFFERED)
        self._status_publisher = offer(DriveStatusArray, graph.DRIVES_STATUS, qos.STATUS)
        self._robot_state = RobotState(self, build_urdf(robot), robot.joint_names)
        self._commands = self.create_subscription(
            JointCommand, graph.JOINT_COMMAND, self._on_joint_command, qos.CONTROL
        )
        self.hot = [self._commands, *pacer.hot]
        self.hot_timers = pacer.hot_timers
        self.create_service(Trigger, graph.DRIVES_ENABLE, self._on_enable)
        self.create_service(Trigger, graph.DRIVES_DISABLE, self._on_disable)
        self.create_service(Trigger, graph.DRIVES_RESET_FAULTS, self._on_reset_faults)
        self.create_service(Trigger, graph.DRIVES_EMERGENCY_STOP, self._on_emergency_stop)
        self.create_service(Trigger, graph.DRIVES_CUT, self._on_cut)
        report = JointReport(master, self._controller.peer)
        self._diagnostics = diagnostics.Diagnostics(
            self, f"{device} x {len(robot.joint_names)}", lambda: report.make(self._ticks)
        )
        stay_active_under_load(self, self._load, f"{master.devices} are enabled")
        if self.options.autostart:
            self._is_starting = True
            self._start_timer = self.create_timer(_RETRY_PERIOD, self._start)
            self._start()

    # Life cycle -----------------------------------------------------------------------------
    def _start(self) -> None:
        """Configure and activate; when that fails, as devices are not there yet, try again."""
        done = TransitionCallbackReturn.SUCCESS
        if self._state_machine.current_state[1] != "unconfigured":
            self._is_starting = False  # somebody else has configured it
        elif self.trigger_configure() is done:
            self._is_starting = self.trigger_activate() is not done
            if self._is_starting:
                self.trigger_cleanup()
        if not self._is_starting:
            self._start_timer.cancel()

    def _load(self) -> str:
        """Return what hangs on this node's activity now, "" for nothing."""
        if self._master.phase is not Phase.ENABLED:
            return ""
        disable = self.resolve_service_name(graph.DRIVES_DISABLE)
        devices = self._master.devices
        return f"the {devices} are enabled and carry the robot; sit down, call {disable} first"

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take torque off and close the wire."""
        self.close()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take torque off."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Leave nothing moving, and tell the controller that no joint states will come."""
        if self._active:
            self._active = False
            self._master.stop()
            self._publish_status()
            self._pacer.cycle_ended(self._tick_ns)

    # The cycle ------------------------------------------------------------------------------
    def begin(self, time_ns: int, renewed: bool = False) -> bool:
        """Begin the cycle of a tick as soon as it has its command; return whether it has ended."""
        if renewed:
            self._told = None  # the controller believes a new time that is told twice
        self._tick_ns = time_ns
        self._waiting = True
        self._cycle_when_complete()
        return not self._waiting

    def restart(self, reason: str) -> None:
        """Forget what was before; nothing may move."""
        self._restarts += 1
        self._controller.restart()
        self._master.restart(reason)
        self.get_logger().warning(f"time has gone back: the {self._master.devices} are off")

    def tell_again(self) -> None:
        """Tell the joints of the last cycle again."""
        if self._active and self._controller.peer.owes(self._controller.asked):
            self._publish_status()  # without it the controller does not believe a new time
        if self._controller.asked >= 0:
            self._controller.ask_again()
            self._joint_publisher.publish(self._joints)

    def quiet(self) -> None:
        """Go on without the controller when it is lost."""
        self._watch_controller()
        if self._waiting:
            self._cycle_when_complete()

    def _watch_controller(self) -> None:
        if self._controller.has_expired(time.monotonic()):
            name = self._controller.peer.name
            self.get_logger().warning(f"{name} is silent: going on without it")

    def _cycle_when_complete(self) -> None:
        if not self.lockstep or self._controller.complete:
            self._waiting = False
            self._cycle()

    def _cycle(self) -> None:
        """Speak on the wire; tell the joints to the controller, and the pacer that it is done."""
        self._watch_controller()
        if self._active and self._master.is_connected:
            self._ticks += 1
            self._exchange()
        self._pacer.cycle_ended(self._tick_ns)
        if self._active and self._controller.asked == self._tick_ns:
            self._robot_state.tell(self._tick_ns, self._master.position)

    @abstractmethod
    def _exchange(self) -> None:
        """Exchange what a tick calls for with the devices; call `_tell` when the joints are known.

        A wire that breaks is no exception here.
        """

    def _tell(self, *, known: bool) -> None:
        """Tell joints, if they are known, and status, if it is time to or something has changed."""
        told = (self._master.phase, self._master.reason)
        if told != self._told or self._ticks % _STATUS_EVERY == 0:
            before, self._told = self._told, told
            if before is not None and before[0] is Phase.ENABLED and told[0] is not Phase.ENABLED:
                self.get_logger().warning(f"{self._master.devices} have stopped: {told[1]}")
            self._publish_status()
        if known:
            self._publish_joints()

    def _publish_joints(self) -> None:
        joints, master = self._joints, self._master
        stamps.fill(joints.header.stamp, self._tick_ns)
        joints.position = array.array("d", master.position.tobytes())
        joints.velocity = array.array("d", master.velocity.tobytes())
        joints.effort = array.array("d", master.effort.tobytes())
        self._controller.ask(self._tick_ns)
        self._joint_publisher.publish(joints)

    def _publish_status(self) -> None:
        stamp = max(0, self._tick_ns)  # before the first cycle it is 0
        self._status_publisher.publish(
            joint_status(self._master, stamp, active=self._active, restarts=self._restarts)
        )

    # The controller -------------------------------------------------------------------------
    def _on_joint_command(self, command: JointCommand) -> None:
        stamp = stamps.to_ns(command.stamp)
        heard = self._controller.hear(stamp, self._tick_ns)
        if heard is Heard.COPY:
            self._doubt(command)
        if heard is not Heard.NEW:
            return
        self._last_command = command
        refusal = self._master.set_command(
            command.mode_of_operation, command.position, command.velocity, command.effort
        )
        if refusal:
            self.get_logger().warning(
                f"joint command refused: {refusal}", throttle_duration_sec=1.0
            )
        self.imu_stamp_ns = stamps.to_ns(command.imu_stamp)
        self._controller.peer.answer(stamp)
        if self._waiting:
            self._cycle_when_complete()

    def _doubt(self, command: JointCommand) -> None:
        """Somebody else answers too: harmless if he says the same, else nobody is believed."""
        if command == self._last_command:
            raise Refused("a copy of the last command")
        self._stop_all("two sources command the joints")
        self.get_logger().error(
            "two nodes answer the same joint states: emergency stop", throttle_duration_sec=1.0
        )

    # Services -------------------------------------------------------------------------------
    def _settle(self) -> None:
        """Let the cycle at hand be answered, so that a request falls between two ticks."""
        executor = executor_of(self)
        if self.lockstep and executor is not None:
            executor.drain_hot()
            executor.spin_hot_until(lambda: not self._waiting and self._controller.complete)

    def _await_controller(self) -> None:
        """Go on with the bus until the controller commands: it starts more slowly than we do."""
        executor, commands = executor_of(self), self._controller
        assert executor is not None
        end = time.monotonic() + _START_PATIENCE
        executor.spin_hot_until(lambda: commands.answered >= 0 or time.monotonic() > end)

    def _on_enable(self, request: object, response: Trigger.Response) -> Trigger.Response:
        if self._active and self._controller.answered < 0:
            self._await_controller()
        self._settle()
        sources = self._commands.get_publisher_count()
        if self._master.phase is Phase.ENABLED:
            response.success, response.message = True, "enabled"
            return response
        if not self._active:
            response.message = "the node is not active"
        elif sources != 1:
            topic = self.resolve_topic_name(graph.JOINT_COMMAND)
            response.message = f"{sources} nodes publish {topic}, it must be 1"
        else:
            response.message = self._master.enable()
        response.success = not response.message
        return response

    def _on_disable(self, request: object, response: Trigger.Response) -> Trigger.Response:
        self._settle()
        self._master.disable()
        response.success = True
        return response

    def _on_reset_faults(self, request: object, response: Trigger.Response) -> Trigger.Response:
        self._settle()
        response.message = self._reset_faults()
        response.success = not response.message
        return response

    def _reset_faults(self) -> str:
        return self._master.reset_faults()

    def _on_emergency_stop(self, request: object, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, self._stop_all("emergency stop")
        return response

    def _stop_all(self, reason: str) -> str:
        """Stop by the category that is set; return what the joints do."""
        if self.options.stop_category == 0:
            self._master.cut(reason)
            return f"{self._master.devices} lose torque at once"
        self._master.emergency_stop(reason)
        return f"{self._master.devices} {self._master.stopping} and lose torque"

    def _on_cut(self, request: object, response: Trigger.Response) -> Trigger.Response:
        self._master.cut("cut")
        response.success = True
        response.message = f"{self._master.devices} lose torque at once"
        return response
