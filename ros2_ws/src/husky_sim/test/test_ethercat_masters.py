"""Masters that we did not write on the simulated drives, frame by frame over a virtual cable.

SOEM is driven through the bus "soem", as the robot's bridge does, and by itself; KickCAT by its own
Python module.
"""

import struct
from datetime import timedelta

import pytest

from husky_description.robot import load_robot
from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.bus import GOLD_TWITTER, AlState, BusOptions, SdoAbort
from husky_drivers.ethercat.commissioning import DriveError
from husky_drivers.ethercat.master import Master
from husky_drivers.ethercat.pdo import RX_ASSIGNMENT, TX_ASSIGNMENT
from husky_drivers.ethercat.soem_bus import SoemBus

ROBOT = load_robot()
ZEROS = bytes(18 * 12)
PATIENCE = 1.0
"""Wall time after which a frame counts as lost here [s]: longer than the machine can be busy."""
ATTEMPTS = 5
COMMAND = bytes(range(256)) + b"the end"
"""Does not fit into a mailbox of 140 bytes: goes up and down in segments."""


@pytest.fixture
def bus(drives):
    drives.ask("clear")
    bus = SoemBus(ROBOT, BusOptions("ecat0", PATIENCE))
    bus.open()
    yield bus
    bus.close()


@pytest.fixture
def master(bus):
    """At OP, by the set-up of the robot's own master."""
    master = Master(bus, settings_of(ROBOT), ROBOT)
    master.configure()
    master.start()
    return master


def test_soem_finds_twelve_gold_twitters_in_preop(bus):
    assert bus.slave_count == 12
    assert [bus.identity(i) for i in range(12)] == [GOLD_TWITTER] * 12
    assert [al.status for al in bus.al_states()] == [AlState.PREOP] * 12


def test_soem_brings_them_to_op_and_exchanges(bus, master):
    for _ in range(100):
        inputs, counter = bus.exchange(ZEROS)
        assert counter == bus.expected_working_counter == 36
    with pytest.raises(ValueError, match="17 bytes of outputs for slaves that take 216"):
        bus.exchange(bytes(17))
    one = struct.unpack_from("<iIiHhhI", inputs, 22 * 7)
    assert one[1] == 8 and one[3] & 0x4F in (0x00, 0x40), "STO released, not ready or disabled"
    assert [al.status for al in bus.al_states()] == [AlState.OP] * 12


def test_closing_leaves_them_in_init_without_torque(drives, bus, master):
    master.stop()
    told = drives.ask("tell")
    assert told["al"] == [[AlState.INIT, 0]] * 12 and told["torque"] == 0


def test_objects_expedited_normal_and_in_segments(bus):
    bus.sdo_write(3, 0x6065, 0, struct.pack("<I", 123456))
    assert bus.sdo_read(3, 0x6065, 0) == struct.pack("<I", 123456)
    assert bus.sdo_read(11, 0x1008, 0) == b"Gold Twitter"
    bus.sdo_write(4, 0x1023, 1, COMMAND)
    slave = bus._slaves[4]
    assert slave.sdo_read(0x1023, 1, size=1024, release_gil=True) == COMMAND


@pytest.mark.parametrize(
    ("index", "subindex", "data", "code"),
    [
        (0x5FFF, 0, None, 0x06020000),
        (0x6091, 7, None, 0x06090011),
        (0x6064, 0, bytes(4), 0x06010002),
        (0x6065, 0, bytes(2), 0x06070010),
        (0x605A, 0, b"\x63\0", 0x06090030),
    ],
)
def test_a_refused_access_has_its_abort_code(bus, index, subindex, data, code):
    with pytest.raises(SdoAbort) as refused:
        if data is None:
            bus.sdo_read(2, index, subindex)
        else:
            bus.sdo_write(2, index, subindex, data)
    assert refused.value.code == code
    assert bus.sdo_read(2, 0x1018, 1) == struct.pack("<I", GOLD_TWITTER.vendor), "goes on"


def test_the_dictionary_can_be_listed(bus):
    listed = {entry.index: entry for entry in bus._slaves[0].od}
    assert {0x1000, 0x1018, 0x1C12, 0x6041, 0x6502} <= set(listed)
    gear = listed[0x6091]
    assert gear.name == b"gear ratio" and len(gear.entries) == 3
    assert gear.entries[1].bit_length == 32


def test_an_emergency_comes_with_the_mailbox(drives, bus, master):
    drives.ask("inject", ROBOT.joint_names[5], "fault:7300")
    drives.ask("tick", 1)
    master.exchange()
    master.exchange()
    assert master.error_code[5] == 0, "nothing has been read"
    master.poll_mailbox()
    master.exchange()
    assert master.error_code[5] == 0x7300


def test_a_drive_off_the_bus_is_named(drives, bus, master):
    drives.ask("inject", ROBOT.joint_names[8], "silent")
    assert bus.exchange(ZEROS)[1] == 33
    states = bus.al_states()
    assert [i for i, al in enumerate(states) if al.status == 0] == [8]
    bus.close()
    with pytest.raises(DriveError, match="11 slaves on the bus, expected 12"):
        Master(SoemBus(ROBOT, BusOptions("ecat0", PATIENCE)), settings_of(ROBOT), ROBOT).configure()


def test_kickcat_brings_them_to_op_and_exchanges(drives):
    """Written in C++ from the standard, with no line in common with SOEM.

    Its time-outs are by the wall clock, so on a busy machine a frame may be lost to it.
    """
    kickcat = pytest.importorskip("kickcat")
    for attempt in range(ATTEMPTS):
        drives.ask("clear")
        try:
            bring_up_and_exchange(kickcat)
            break
        except RuntimeError:
            if attempt == ATTEMPTS - 1:
                raise
    assert drives.ask("tell")["al"] == [[AlState.OP, 0]] * 12


def bring_up_and_exchange(kickcat):
    link = kickcat.create_link("ecat0", "")
    link.set_timeout(timedelta(seconds=0.05))  # it lets each frame of the set-up take so long
    bus = kickcat.Bus(link)
    bus.init(0.1)
    slaves = bus.slaves()
    assert len(slaves) == 12
    for slave in slaves:
        for count, assigned in ((od.RX_COUNT, RX_ASSIGNMENT), (od.TX_COUNT, TX_ASSIGNMENT)):
            entries = [(0, b"\0")]
            entries += [(k, struct.pack("<H", index)) for k, index in enumerate(assigned, 1)]
            entries += [(0, bytes((len(assigned),)))]
            for subindex, data in entries:
                bus_write(kickcat, bus, slave, count.index, subindex, data)
    bus.create_mapping()
    assert {(slave.output_size, slave.input_size) for slave in slaves} == {(18, 22)}
    bus.request_state(kickcat.State.SAFE_OP)
    bus.wait_for_state(kickcat.State.SAFE_OP, 2.0)
    bus.request_state(kickcat.State.OPERATIONAL)
    bus.wait_for_state(kickcat.State.OPERATIONAL, 2.0, bus.process_data_no_check)
    for _ in range(20):
        bus.process_data()  # raises for a wrong working counter
    assert struct.unpack_from("<iI", slaves[7].input_data)[1] == 8
    second = timedelta(seconds=1.0)
    name = bus.read_sdo(slaves[3], 0x1008, 0, kickcat.Access.PARTIAL, 64, second)
    assert name == b"Gold Twitter"


def bus_write(kickcat, bus, slave, index, subindex, data):
    request = slave.mailbox.write_sdo(index, subindex, False, data, timedelta(seconds=1.0))
    running = kickcat.mailbox.request.MessageStatus.RUNNING
    while request.status() == running:
        bus.process_mailboxes()
    if request.status() != kickcat.mailbox.request.MessageStatus.SUCCESS:
        raise RuntimeError(f"object 0x{index:04X}:{subindex} is not written: {request.status()}")
