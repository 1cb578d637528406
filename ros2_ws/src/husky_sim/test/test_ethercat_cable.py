"""Frames over a cable: the raw port, and what SOEM alone can show of mailboxes and clocks."""

import queue
import struct
import threading

import pytest
from own_network import own_network
from wired_drives import far_side

from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.interface import flags_of, set_flags
from husky_drivers.ethercat.patient_ear import PatientEar
from husky_drivers.ethercat.pdo import RX_ASSIGNMENT, TX_ASSIGNMENT
from husky_runtime.lockstep import Peer, Presence
from husky_sim.devices.ethercat.clocks import HOP
from husky_sim.devices.ethercat.raw_port import RawPort

COUNT = 12
PATIENCE = 1_000_000  # us; a frame takes 0.1 ms, a busy machine longer
IFF_UP = 1
HEAD = b"\xff" * 12 + b"\x88\xa4"


@pytest.fixture(scope="module")
def soem(network):
    """Return a master of SOEM with the drives in SAFEOP."""
    pysoem = pytest.importorskip("pysoem")
    # SOEM sends a frame again after 2 ms, and takes the late answer for that of a later frame
    timeouts = pysoem.settings.timeouts
    before = (timeouts.ret, timeouts.safe)
    timeouts.ret = timeouts.safe = PATIENCE
    with far_side():
        master = pysoem.Master()
        master.always_release_gil = True
        master.open("ecat0")
        assert master.config_init() == COUNT
        assert master.state_check(pysoem.PREOP_STATE, PATIENCE) == pysoem.PREOP_STATE
        for slave in master.slaves:
            for count, assigned in ((od.RX_COUNT, RX_ASSIGNMENT), (od.TX_COUNT, TX_ASSIGNMENT)):
                slave.sdo_write(count.index, 0, b"\0")
                for slot, index in enumerate(assigned, 1):
                    slave.sdo_write(count.index, slot, struct.pack("<H", index))
                slave.sdo_write(count.index, 0, bytes((len(assigned),)))
        master.config_map()
        assert master.config_dc()
        assert master.state_check(pysoem.SAFEOP_STATE, PATIENCE) == pysoem.SAFEOP_STATE
        yield master
        master.close()
    timeouts.ret, timeouts.safe = before


@pytest.mark.parametrize("length", [0, 1, 4, 5, 124, 125, 131, 132, 256, 512])
def test_objects_of_any_length_go_up_and_down(soem, length):
    """Expedited up to 4 bytes, 124 in one mailbox, 131 more in each segment."""
    slave = soem.slaves[4]
    text = bytes(i % 251 for i in range(length))
    if length:  # SOEM writes none as four
        slave.sdo_write(0x1023, 1, text)
        assert slave.sdo_read(0x1023, 1, 1024) == text
        assert slave.sdo_read(0x1023, 3, 1024) == text + b";"
    else:
        assert soem.slaves[5].sdo_read(0x1023, 1) == b""


def test_it_measures_the_delays_between_the_clocks(soem):
    delays = [int.from_bytes(slave._fprd(0x0928, 4), "little") for slave in soem.slaves]
    # receive times of clocks that drift are whole nanoseconds; the errors of the line add up
    assert delays == pytest.approx([HOP * i for i in range(COUNT)], abs=COUNT)


def test_the_clock_of_the_first_drive_comes_with_the_process_data(soem):
    times = []
    for _ in range(3):
        soem.send_processdata()
        assert soem.receive_processdata(PATIENCE) == COUNT  # inputs alone in SAFEOP
        times.append(soem.dc_time)
    assert times == sorted(set(times))


def test_a_watchdog_reads_back_as_it_was_set(soem):
    soem.slaves[1].set_watchdog("processdata", 50.0)
    assert soem.slaves[1].get_watchdog("processdata") == 50.0
    assert soem.slaves[2].get_watchdog("processdata") == 100.0


def test_a_port_answers_by_itself_or_later():
    """A frame goes back at once, or by `send`; both are padded, and no port hears itself."""
    heard, came = queue.Queue(), queue.Queue()
    answers = iter((False, True))

    def on_frame(frame):
        came.put(frame)
        return [frame] if next(answers) else []

    def hear(frame):
        heard.put(bytes(frame))
        return []

    with own_network():
        far = RawPort("ecat1", on_frame)
        near = RawPort("ecat0", hear)
    near.send(HEAD + b"first")
    held = came.get(timeout=10)
    assert bytes(held) == (HEAD + b"first").ljust(60, b"\0")
    near.send(HEAD + b"second")
    assert heard.get(timeout=10) == (HEAD + b"second").ljust(60, b"\0")
    far.send(held)
    assert heard.get(timeout=10) == bytes(held)
    for port in (far, near):
        port.close()
    assert heard.empty()


def test_a_master_in_lockstep_waits_for_its_own_answer_until_the_drives_are_lost():
    def frame(index):
        return HEAD + b"\0\0\0" + bytes((index,)) + b"\0" * 40

    with own_network():
        far = RawPort("ecat1", lambda frame: [frame] if frame[17] in answered else [])
        peer = Peer("drives", grace=0.2)
        ear = PatientEar("ecat0", peer)
        near = RawPort("ecat0", lambda frame: [])
        answered = {1, 3}
        near.send(frame(1))
        assert ear.wait() and peer.answered == 1
        ear.forget()
        near.send(frame(2))  # lost
        late = threading.Timer(0.05, far.send, [frame(1)])  # not what is awaited
        late.start()
        assert not ear.wait() and peer.presence is Presence.LOST and peer.answered == 1
        late.join()
        near.send(frame(3))
        while not ear.wait():  # a lost one gets little time, but as often as it is asked
            ear.forget()
            near.send(frame(3))
        assert peer.presence is Presence.EXPECTED and peer.answered == 2
        set_flags("ecat0", flags_of("ecat0") & ~IFF_UP)
        assert not ear.wait()
    for each in (far, near, ear):
        each.close()
