"""Faults on the EtherCAT wire, each with its reaction: SOEM, the robot's master, simulated drives.

The drives stand in a process of their own behind a virtual cable; their time passes when a test
says so, so a drive's watchdog of 50 ms is 25 ticks on any machine.
"""

import socket
import struct
import threading

import numpy as np
import pytest
from ethercat_line import AL_CONTROL, B_READ, B_WRITE, L_BOTH, frame_of

from husky_description.robot import load_robot
from husky_drivers.cia402 import DriveState, OperationMode
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.bus import AL_ERROR, AlState, BusOptions
from husky_drivers.ethercat.commissioning import DriveError
from husky_drivers.ethercat.interface import ETHERTYPE
from husky_drivers.ethercat.master import Master
from husky_drivers.ethercat.soem_bus import SoemBus
from husky_drivers.joint_master.phase import Phase
from husky_drivers.probes import probe_drives

ROBOT = load_robot()
NAMES = ROBOT.joint_names
COUNT = len(NAMES)
KNEE = NAMES[5]
PATIENCE = 0.2
"""Wall time after which a frame counts as lost [s]."""
SETTLING, QUICK_STOP = 10, 30
"""Ticks of a stop in these tests, shorter than the robot's, and until torque is gone after it."""
WATCHDOG = 25
"""Ticks of a drive's process data watchdog."""
PLACES = ((0x0010, 2), (0x0400, 34), (0x0600, 64))
"""Registers and their bytes: station address, watchdog, FMMUs."""
LIMIT = 3
"""Incomplete cycles in a row that stop all drives."""


class Rig:
    """The master at OP, and the drives."""

    def __init__(self, drives):
        self.drives = drives
        self.bus = SoemBus(ROBOT, BusOptions("ecat0", PATIENCE))
        settings = settings_of(ROBOT, settle_ticks=SETTLING, hold_ticks=SETTLING, confirm_ticks=3)
        self.master = Master(self.bus, settings, ROBOT)
        self.told = {}
        self.runs = False

    def start(self):
        """Bring the drives to OP, unless they are."""
        if not self.runs:
            self.master.configure()
            self.master.start()
        self.runs = True

    def stop_master(self):
        """Let go of the interface."""
        if self.runs:
            self.master.stop()
        self.runs = False

    def tick(self, times=1, *, command=True):
        """Let ticks pass, with a command each, until the master is off or they are over."""
        for _ in range(times):
            self.told = self.drives.ask("tick", 1)
            if command:
                position = self.master.position.copy()
                mode = OperationMode.CYCLIC_SYNCHRONOUS_POSITION
                assert not self.master.set_command(mode, position, np.zeros(COUNT), np.zeros(COUNT))
            self.master.exchange()

    def until(self, phase, most):
        """Tick until a phase is reached; return after how many ticks."""
        for ticks in range(most):
            if self.master.phase is phase:
                return ticks
            self.tick()
        raise AssertionError(f"{self.master.phase} after {most} ticks: {self.master.reason}")

    def enable(self):
        self.tick(12)
        refusal = self.master.enable()
        assert not refusal, refusal
        self.until(Phase.ENABLED, 60)
        self.tick()
        assert self.told["torque"] == COUNT

    def inject(self, target, fault):
        self.drives.ask("inject", target, fault)

    def stop(self):
        """Tick until the stop is over; return why it was."""
        reason = self.master.reason
        self.until(Phase.OFF, SETTLING + QUICK_STOP + 5)
        self.tick(2)
        assert self.told["torque"] == 0
        return reason

    def recover(self):
        """End all faults and take everything back."""
        self.drives.ask("clear")
        self.master.cut("the end of a test")
        self.tick(2)
        refusal = self.master.reset_faults()
        assert not refusal, refusal
        self.until(Phase.OFF, 300)
        self.tick()
        assert self.master.exchange(), self.master.reason


@pytest.fixture(scope="module")
def shared(drives):
    rig = Rig(drives)
    yield rig
    rig.stop_master()


@pytest.fixture
def rig(shared):
    """Enabled; whatever a test does to it, the next one gets it back enabled or fails."""
    shared.drives.ask("clear")
    shared.start()
    shared.recover()
    shared.enable()
    return shared


@pytest.fixture
def alone(shared):
    """The drives while the interface is free."""
    shared.stop_master()
    shared.drives.ask("clear")
    yield shared.drives
    shared.drives.ask("clear")


def send_as_another(*parts):
    """Send a frame as another master does, and await its answer."""
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE)) as other:
        other.bind(("ecat0", ETHERTYPE))
        other.send(bytes(frame_of(*parts)).ljust(60, b"\0"))
        while other.recvfrom(2048)[1][2] == socket.PACKET_OUTGOING:
            pass


@pytest.mark.parametrize(
    "fault",
    ["lost", "late", "truncated", "corrupted", "replayed", "counter"],
)
def test_answers_that_do_not_come_or_are_not_whole(rig, fault):
    """Two in a row are passed over, three put the robot down; nothing of them is believed."""
    short = rig.master.short_cycles
    rig.inject("cable", f"{fault}:{LIMIT - 1}")
    rig.tick(LIMIT - 1)
    assert rig.master.short_cycles == short + LIMIT - 1
    rig.tick(3)
    assert rig.master.phase is Phase.ENABLED and rig.told["torque"] == COUNT
    assert rig.master.short_cycles == short + LIMIT - 1, "the next one is believed again"
    rig.inject("cable", f"{fault}:{LIMIT}")
    rig.tick(LIMIT)
    assert rig.master.phase is Phase.SETTLING
    assert rig.stop().startswith("bus incomplete, working counter")


def test_an_answer_that_comes_twice(rig):
    short = rig.master.short_cycles
    rig.inject("cable", "duplicated:10")
    rig.tick(12)
    assert rig.master.short_cycles == short and rig.master.phase is Phase.ENABLED


@pytest.mark.parametrize("lost", [1, 6])
def test_answers_of_the_mailbox_that_are_lost(rig, lost):
    """The access is tried again."""
    short = rig.master.short_cycles
    rig.inject("cable", f"set_up_lost:{lost}")
    assert rig.bus.sdo_read(3, 0x6061) == b"\x08"
    rig.tick(5)
    assert rig.master.short_cycles == short and rig.master.phase is Phase.ENABLED


@pytest.mark.parametrize("name", ["PacketError", "MailboxError", "WkcError", "AssertionError"])
def test_an_access_that_got_the_answer_to_another_is_tried_again(rig, name):
    """SOEM has one list for the errors of all slaves; pysoem asserts that they are of this one."""
    soem = rig.bus._pysoem
    errors = {
        "PacketError": lambda: soem.PacketError(1, 3),
        "MailboxError": lambda: soem.MailboxError(1, 5, "unknown"),
        "WkcError": soem.WkcError,
        "AssertionError": AssertionError,
    }
    tries = []

    def access():
        tries.append(None)
        if len(tries) < 3:
            raise errors[name]()
        return b"\x08"

    assert rig.bus._access(access, 3, 0x6061, 0) == b"\x08" and len(tries) == 3


def test_an_object_that_is_refused_while_it_runs(rig):
    rig.inject(KNEE, "mailbox:1")
    for _ in range(COUNT):
        rig.master.poll_mailbox()
        rig.tick()
    assert rig.master.mode_display[5] == 0 and rig.master.mode_display[6] == 8
    assert rig.master.phase is Phase.ENABLED


@pytest.mark.parametrize(
    ("joint", "fault", "lost", "named"),
    [
        pytest.param(NAMES[0], "silent", 1, f"{NAMES[0]} does not answer", id="first-silent"),
        pytest.param(KNEE, "silent", 1, f"{KNEE} does not answer", id="silent"),
        pytest.param(NAMES[11], "silent", 1, f"{NAMES[11]} does not answer", id="last-silent"),
        pytest.param(NAMES[0], "cut", 11, f"{NAMES[1]} does not", id="cut-after-the-first"),
        pytest.param(KNEE, "cut", 6, f"{NAMES[6]} does not answer", id="cut-in-the-middle"),
        pytest.param(NAMES[10], "cut", 1, f"{NAMES[11]} does not", id="cut-before-the-last"),
        pytest.param(NAMES[0], "unpowered", 12, f"{NAMES[0]} does not", id="first-unpowered"),
        pytest.param(KNEE, "unpowered", 7, f"{KNEE} does not answer", id="unpowered"),
        pytest.param(NAMES[11], "unpowered", 1, f"{NAMES[11]} does not", id="last-unpowered"),
    ],
)
def test_drives_that_frames_do_not_reach(rig, joint, fault, lost, named):
    """The others put the robot down; the lost ones have no torque after their watchdog's time."""
    rig.inject(joint, fault)
    rig.tick(LIMIT)
    assert rig.master.phase is Phase.SETTLING or lost == COUNT
    assert named in rig.master.reason
    assert f"working counter {3 * (COUNT - lost)} of 36" in rig.master.reason
    rig.tick(WATCHDOG)
    assert rig.told["torque"] <= COUNT - lost
    rig.stop()
    rig.recover()
    rig.enable()


@pytest.mark.parametrize("code", [0x001A, 0x001B, 0x002C, 0x002D], ids=lambda code: f"{code:04x}")
def test_a_drive_that_leaves_op_with_an_error(rig, code):
    """Synchronisation, watchdog, SYNC0: the clock of the drives is lost in the last two."""
    rig.inject(KNEE, f"al_error:{code:04x}")
    rig.tick()
    assert rig.told["torque"] == COUNT - 1, "at once"
    rig.tick(LIMIT)
    assert f"{KNEE} left OP" in rig.master.reason
    assert rig.drives.ask("tell")["al"][5] == [AlState.SAFEOP | AL_ERROR, code]
    rig.stop()
    rig.recover()
    rig.enable()


def test_a_drive_that_has_lost_its_power_is_set_up_again(rig):
    """Station address, sync managers, FMMUs, objects, watchdog, clock; the others stay in OP."""
    before = [rig.bus._read(5, at, size) for at, size in PLACES]
    objects = [rig.bus.sdo_read(5, index, 0) for index in (0x6065, 0x6066, 0x605A, 0x6007)]
    rig.inject(KNEE, "unpowered")
    rig.tick(LIMIT)
    rig.stop()
    rig.drives.ask("clear")
    rig.tick()
    assert rig.drives.ask("tell")["al"][5] == [AlState.INIT, 0]
    assert rig.bus.sdo_read(4, 0x6065, 0) == objects[0]
    rig.recover()
    assert before == [rig.bus._read(5, at, size) for at, size in PLACES]
    assert objects == [rig.bus.sdo_read(5, index, 0) for index in (0x6065, 0x6066, 0x605A, 0x6007)]
    clocks = [int.from_bytes(rig.bus._read(i, 0x0910, 8), "little") for i in (4, 5, 6)]
    assert clocks == sorted(clocks), "each is asked later, and shows it"
    rig.enable()


def test_the_battery_is_off_and_on(rig):
    """No drive has kept anything; one after the other is set up again."""
    for name in NAMES:
        rig.inject(name, "unpowered")
    rig.tick(LIMIT)
    assert rig.told["torque"] == 0
    rig.stop()
    rig.drives.ask("clear")
    rig.recover()
    rig.enable()


def test_while_all_is_off_drives_come_back_by_themselves(rig):
    rig.tick(10, command=False)  # no command any more
    rig.stop()
    rig.drives.ask("tick", WATCHDOG + 1)
    assert {al for al, _ in rig.drives.ask("tell")["al"]} == {AlState.SAFEOP | AL_ERROR}
    for _ in range(260):
        rig.tick()
        if rig.master.exchange():
            break
    assert rig.drives.ask("tell")["al"] == [[AlState.OP, 0]] * COUNT
    assert rig.master.phase is Phase.OFF and rig.told["torque"] == 0
    rig.enable()


def test_a_fault_outlasts_the_way_back_to_op(rig):
    """Only a reset that somebody asks for ends a drive's fault."""
    rig.inject(KNEE, "al_error:001a")
    rig.tick(LIMIT)
    rig.stop()
    rig.tick(260)
    assert rig.master.exchange() and rig.master.states[5] == DriveState.FAULT
    assert KNEE in rig.master.enable()


def test_the_master_is_gone(rig):
    """As after `kill -9`: the drives' own watchdog of 50 ms acts, in 100 ms at the latest."""
    assert rig.drives.ask("tick", WATCHDOG - 2)["torque"] == COUNT
    told = rig.drives.ask("tick", 3)
    assert told["torque"] == 0 and told["al"] == [[AlState.SAFEOP | AL_ERROR, 0x001B]] * COUNT
    rig.tick(LIMIT)
    assert "process data watchdog" in rig.master.reason
    rig.stop()
    rig.recover()
    rig.enable()


def test_the_controller_is_gone_while_frames_go_round(rig):
    rig.tick(12, command=False)
    assert rig.master.phase is not Phase.ENABLED
    rig.stop()


@pytest.mark.parametrize(
    "state", [AlState.INIT, AlState.PREOP, AlState.SAFEOP], ids=lambda s: s.name
)
def test_another_master_takes_the_drives_away(rig, state):
    send_as_another((B_WRITE, 0, AL_CONTROL, struct.pack("<H", state)))
    told = rig.drives.ask("tell")
    assert told["al"] == [[state, 0]] * COUNT and told["torque"] == 0
    rig.tick(LIMIT)
    assert f"{KNEE} left OP" in rig.master.reason
    rig.stop()
    rig.recover()
    rig.enable()


def test_another_master_sends_process_data(rig):
    """Outputs that are zero take torque off; the drives are lost to ours."""
    send_as_another((L_BOTH, 0, 0, bytes(480)))
    assert rig.drives.ask("tell")["torque"] == 0
    rig.tick(2)
    assert rig.master.phase is not Phase.ENABLED
    rig.stop()


def test_a_second_bridge_is_refused(rig):
    second = SoemBus(ROBOT, BusOptions("ecat0", PATIENCE))
    with pytest.raises(OSError, match="another drive_bridge has ecat0"):
        second.open()
    short = rig.master.short_cycles
    rig.tick(5)
    assert rig.master.short_cycles == short and rig.told["torque"] == COUNT


def test_where_another_master_sends_ours_does_not_start(alone):
    frame = bytes(frame_of((B_READ, 0, AL_CONTROL, bytes(2)))).ljust(60, b"\0")
    done = threading.Event()

    def send():
        while not done.wait(0.001):
            other.send(frame)

    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as other:
        other.bind(("ecat0", 0))
        sender = threading.Thread(target=send)
        sender.start()
        try:
            with pytest.raises(OSError, match="another EtherCAT master sends on ecat0"):
                SoemBus(ROBOT, BusOptions("ecat0", PATIENCE)).open()
        finally:
            done.set()
            sender.join()


def configured(**changes):
    """Try to set the drives up; return the error."""
    bus = SoemBus(ROBOT, BusOptions("ecat0", PATIENCE))
    try:
        with pytest.raises(DriveError) as refused:
            Master(bus, settings_of(ROBOT, **changes), ROBOT).configure()
    finally:
        bus.close()
    return str(refused.value)


def test_drives_in_another_order(alone):
    serials = (1, 3, 2, *range(4, 13))
    assert configured(serial_numbers=serials) == (
        f"{NAMES[1]}: the drive has serial number 2, it must be 3"
    )


def test_the_check_before_a_start_knows_the_order_too(alone):
    serials = (1, 3, 2, *range(4, 13))
    found, problem = probe_drives(ROBOT, "ecat0", PATIENCE, serials)
    assert found[0] == "12 slaves answer" and found[2].startswith(f"{NAMES[1]}: Gold Twitter")
    assert problem == (
        f"{NAMES[1]} has serial number 2, it must be 3; "
        f"{NAMES[2]} has serial number 3, it must be 2"
    )
    assert probe_drives(ROBOT, "ecat0", PATIENCE, range(1, 13)).problem == ""
    assert alone.ask("tell")["al"] == [[AlState.INIT, 0]] * COUNT


def test_another_device_in_a_drive_s_place(alone):
    bus = SoemBus(ROBOT, BusOptions("ecat0", PATIENCE))
    bus.open()
    bus._slaves[5].eeprom_write(0x000A, b"\x11\x22")
    bus.close()
    assert configured().startswith(f"{KNEE}: Identity(vendor=154, product=205329")
    bus.open()
    bus._slaves[5].eeprom_write(0x000A, b"\x24\x09")
    bus.close()


@pytest.mark.parametrize("step", [1, 17, 40])
def test_an_object_that_is_refused_at_configuration(alone, step):
    alone.ask("inject", KNEE, f"mailbox:{step}")
    assert configured().startswith(f"{KNEE}: slave 5, object 0x")
    assert alone.ask("tell")["torque"] == 0


def test_frames_of_the_set_up_that_are_lost(alone):
    """SOEM asks again; the drives come up all the same."""
    alone.ask("inject", "cable", "set_up_lost:2")
    bus = SoemBus(ROBOT, BusOptions("ecat0", PATIENCE))
    bus.open()
    assert bus.slave_count == COUNT
    bus.close()


def test_nobody_at_the_other_end(alone):
    alone.ask("inject", NAMES[0], "unpowered")
    with pytest.raises(OSError, match="no EtherCAT slave answers on ecat0"):
        SoemBus(ROBOT, BusOptions("ecat0", PATIENCE)).open()
