"""A slave controller by its registers: AL states, watchdog, EEPROM, mailboxes' flags, clocks."""

import struct

import pytest
from ethercat_line import (
    AL_CODE,
    AL_CONTROL,
    AL_STATUS,
    AP_MULTIPLE,
    AP_READ,
    AP_WRITE,
    B_READ,
    B_WRITE,
    BUFFERS,
    FIRST_STATION,
    FP_MULTIPLE,
    FP_READ,
    IN,
    L_BOTH,
    MAILBOXES,
    OUT,
    Line,
    fmmu,
    sync_manager,
)

from husky_drivers.ethercat.bus import GOLD_TWITTER
from husky_sim.devices.ethercat.clocks import HOP
from husky_sim.devices.ethercat.sii import checksum, eeprom_image

INIT, PREOP, BOOT, SAFEOP, OP, ERROR = 1, 2, 3, 4, 8, 0x10


@pytest.fixture
def line():
    made = Line()
    made.configure()
    return made


def ask_state(line, control, i=0):
    """Write the AL control register of a drive; return its AL status and code."""
    line.write(i, AL_CONTROL, struct.pack("<H", control))
    return tuple(struct.unpack("<H", line.read(i, at, 2))[0] for at in (AL_STATUS, AL_CODE))


def test_a_master_finds_them_and_their_places():
    line = Line()
    kinds, count = line.ask(B_READ, 0, 0x0000, bytes(2))
    assert (kinds[0], count) == (0x11, 12)
    for i in range(line.count):
        description, links = line.send((AP_READ, -i, 4, bytes(6)), (AP_READ, -i, 0x0110, bytes(2)))
        fmmus, managers, ram, ports, features = struct.unpack("<BBBBH", description[0])
        assert (fmmus, managers, ram, ports) == (4, 4, 8, 0x0F)
        assert features & 0x0D == 0x0D  # byte-wise FMMUs, DC of 64 bits
        links = struct.unpack("<H", links[0])[0]
        open_ports = [port for port in range(4) if links >> 8 + 2 * port & 0x3 == 0x2]
        assert open_ports == ([0, 1] if i < line.count - 1 else [0])
    assert line.states() == [INIT] * line.count


def test_registers_that_are_not_there_read_0_and_those_to_read_only_stay(line):
    assert line.write(0, 0x0E00, b"\xff") == 1
    assert line.read(0, 0x0E00, 2) == b"\0\0"
    before = line.read(0, 0x0000, 10)
    assert line.write(0, 0x0000, bytes(10)) == 1
    assert line.read(0, 0x0000, 10) == before
    assert line.read(0, 0x2FFE, 4) == bytes(4)
    assert line.read(0, 0x3000, 1) is None
    assert line.write(0, 0x2FFF, b"\0\0") == 0


def test_an_alias_answers_while_it_is_in_use(line):
    image = eeprom_image(GOLD_TWITTER, 1)
    assert struct.unpack_from("<H", image, 8)[0] == 0
    line.write(3, 0x0508, struct.pack("<H", 77))
    line.write(3, 0x0502, struct.pack("<HI", 0x0201, 4))  # write word 4
    line.write(3, 0x0502, struct.pack("<HI", 0x0400, 0))  # reload
    assert line.ask(FP_READ, 77, 0x0010, bytes(2))[1] == 0
    line.write(3, 0x0103, b"\x01")
    assert line.ask(FP_READ, 77, 0x0010, bytes(2)) == (struct.pack("<H", FIRST_STATION + 3), 1)


# -- EEPROM


def test_eeprom_by_8_bytes_holds_identity_and_mailboxes(line):
    def words(address, form):
        line.write(0, 0x0502, struct.pack("<HI", 0x0100, address))
        control = struct.unpack("<H", line.read(0, 0x0502, 2))[0]
        assert control == 0x0040  # not busy, no error, 8 bytes at once
        return struct.unpack(form, line.read(0, 0x0508, 8))

    assert words(0x08, "<II") == (GOLD_TWITTER.vendor, GOLD_TWITTER.product)
    assert words(0x0C, "<II") == (GOLD_TWITTER.revision, 1)
    assert words(0x18, "<HHHH") == (0x1800, 140, 0x1900, 140)
    assert words(0x1C, "<H6x") == (0x0004,)
    assert words(0x7FFF, "<Q") == (2**64 - 1,)


def remainder(data):
    """Divide bits by x^8 + x^2 + x + 1; a start of 0xFF inverts the first byte."""
    rest = (int.from_bytes(data, "big") ^ 0xFF << 8 * (len(data) - 1)) << 8
    while rest.bit_length() > 8:
        rest ^= 0x107 << rest.bit_length() - 9
    return rest


def test_eeprom_checksum_and_categories():
    image = bytes(eeprom_image(GOLD_TWITTER, 1))
    assert image[14] == checksum(image[:14]) == remainder(image[:14])
    assert checksum(b"123456789") == remainder(b"123456789")
    at, found = 0x80, {}
    while (kind := struct.unpack_from("<H", image, at)[0]) != 0xFFFF:
        size = 2 * struct.unpack_from("<H", image, at + 2)[0]
        found[kind] = image[at + 4 : at + 4 + size]
        at += 4 + size
    assert found[10][:14] == b"\x01\x0cGold Twitter"
    assert found[30][5] & 0x20 == 0  # no complete access
    managers = list(struct.iter_unpack("<HHBBBB", found[41]))
    assert [(m[0], m[2]) for m in managers] == [
        (0x1800, 0x26),
        (0x1900, 0x22),
        (0x1100, 0x64),
        (0x1180, 0x20),
    ]


def test_eeprom_without_write_enable_reports_an_error(line):
    line.write(0, 0x0502, struct.pack("<HI", 0x0200, 4))
    assert struct.unpack("<H", line.read(0, 0x0502, 2))[0] == 0x2040


# -- AL states


def test_up_to_op_and_down(line):
    for state in (PREOP, SAFEOP, OP, SAFEOP, OP, PREOP, SAFEOP, OP, INIT):
        assert ask_state(line, state) == (state, 0)


@pytest.mark.parametrize(
    ("path", "wanted", "code"),
    [
        ((), SAFEOP, 0x0011),
        ((), OP, 0x0011),
        ((PREOP,), OP, 0x0011),
        ((), BOOT, 0x0013),
        ((PREOP,), BOOT, 0x0013),
        ((), 5, 0x0012),
        ((PREOP,), 0, 0x0012),
    ],
)
def test_a_step_that_is_not_allowed_leaves_an_error_until_it_is_acknowledged(
    line, path, wanted, code
):
    for state in path:
        ask_state(line, state)
    now = path[-1] if path else INIT
    assert ask_state(line, wanted) == (now | ERROR, code)
    assert ask_state(line, PREOP) == (now | ERROR, code)  # not acknowledged
    assert ask_state(line, now | ERROR) == (now, 0)
    assert ask_state(line, PREOP) == (PREOP, 0)


@pytest.mark.parametrize(
    "mailboxes",
    [
        sync_manager(0x1800, 140, 0x26, 0) + sync_manager(0x1900, 140, 0x22),
        sync_manager(0x1800, 140, 0x22) + sync_manager(0x1900, 140, 0x22),
        sync_manager(0x1800, 140, 0x26) + sync_manager(0x1900, 140, 0x20),
        sync_manager(0x1800, 140, 0x26) + sync_manager(0x1880, 140, 0x22),
        sync_manager(0x1800, 33, 0x26) + sync_manager(0x1900, 140, 0x22),
        sync_manager(0x1800, 140, 0x26) + sync_manager(0x2FC0, 140, 0x22),
        sync_manager(0x0800, 140, 0x26) + sync_manager(0x1900, 140, 0x22),
    ],
    ids=["off", "wrong way", "buffer", "overlap", "short", "beyond the end", "in registers"],
)
def test_preop_needs_mailboxes(line, mailboxes):
    line.write(0, 0x0800, bytes(16))  # off; what is on keeps its settings
    line.write(0, 0x0800, mailboxes)
    assert ask_state(line, PREOP) == (INIT | ERROR, 0x0016)
    line.write(0, 0x0800, bytes(16))
    line.write(0, 0x0800, MAILBOXES)
    assert ask_state(line, PREOP | ERROR) == (PREOP, 0)


@pytest.mark.parametrize(
    ("buffers", "code"),
    [
        (sync_manager(0x1100, OUT + 1, 0x64) + sync_manager(0x1180, IN, 0x20), 0x001D),
        (sync_manager(0x1100, OUT, 0x60) + sync_manager(0x1180, IN, 0x20), 0x001D),
        (sync_manager(0x1100, OUT, 0x64, 0) + sync_manager(0x1180, IN, 0x20), 0x001D),
        (sync_manager(0x1100, OUT, 0x64) + sync_manager(0x1180, IN - 2, 0x20), 0x001E),
        (sync_manager(0x1100, OUT, 0x64) + sync_manager(0x1180, IN, 0x24), 0x001E),
    ],
)
def test_safeop_needs_buffers_as_long_as_the_mapped_objects(line, buffers, code):
    ask_state(line, PREOP)
    line.write(0, 0x0810, bytes(16))
    line.write(0, 0x0810, buffers)
    assert ask_state(line, SAFEOP) == (PREOP | ERROR, code)
    line.write(0, 0x0810, bytes(16))
    line.write(0, 0x0810, BUFFERS)
    assert ask_state(line, SAFEOP | ERROR) == (SAFEOP, 0)


def test_safeop_needs_the_mapping_that_is_simulated(line):
    ask_state(line, PREOP, 1)
    line.segment.drives[1].sdo_write(0x1C13, 0, b"\x00")
    assert ask_state(line, SAFEOP, 1) == (PREOP | ERROR, 0x001E)


def test_a_sync_manager_that_is_on_keeps_its_settings(line):
    line.write(0, 0x0800, sync_manager(0x2000, 99, 0x44))
    assert line.read(0, 0x0800, 5) == MAILBOXES[:5]


# -- watchdog


def test_watchdog_registers_set_the_drives_watchdog(line):
    records = line.segment.records
    assert records["watchdog"] == pytest.approx(0.1)
    line.write(0, 0x0420, struct.pack("<H", 500))
    assert records["watchdog"][0] == 500 * 1e-4  # as `SimulatedSegment.set_watchdog` has it
    line.write(0, 0x0400, struct.pack("<H", 2498 + 2500))
    assert records["watchdog"][0] == pytest.approx(0.1)
    line.write(0, 0x0420, struct.pack("<H", 0))
    assert records["watchdog"][0] == float("inf")  # off


def test_without_outputs_a_drive_falls_to_safeop_and_counts_it(line):
    line.bring_to_op()
    for expirations in (1, 2):
        for _ in range(49):
            line.tick()
        assert line.read(0, 0x0440, 1) == b"\x01"
        assert line.states() == [OP] * line.count
        line.tick()
        assert line.states() == [SAFEOP | ERROR] * line.count
        assert line.read(0, AL_CODE, 2) == b"\x1b\x00"
        assert line.read(0, 0x0440, 3) == bytes((0, 0, expirations))
        assert line.read(0, 0x0817, 1) == b"\x01"  # its outputs are closed
        line.request(SAFEOP)
        assert line.read(0, 0x0440, 3) == bytes((1, 0, expirations))
        line.request(OP)
    line.write(0, 0x0442, b"\0")
    assert line.read(0, 0x0442, 1) == b"\0"


def test_only_whole_outputs_feed_the_watchdog(line):
    line.bring_to_op()
    whole, partial = bytes((OUT + IN) * line.count), bytes(OUT - 1)
    assert line.ask(L_BOTH, OUT, 0, partial)[1] == 2
    for _ in range(60):
        line.tick()
        line.ask(L_BOTH, 0, 0, whole[:OUT])  # those of drive 0 alone
        line.ask(L_BOTH, OUT, 0, partial)
    assert line.states() == [OP] + [SAFEOP | ERROR] * (line.count - 1)


def test_drives_off_the_bus_let_frames_pass(line):
    line.segment.inject("front_left_knee", "silent")
    silent = int(line.segment.records["silent"].argmax())
    assert line.ask(B_READ, 0, AL_STATUS, bytes(2))[1] == line.count - 1
    found, count = line.ask(AP_READ, -silent, 0x0010, bytes(2))
    assert struct.unpack("<H", found)[0] == FIRST_STATION + silent + 1 and count == 1
    assert line.read(silent, AL_STATUS, 2) is None


# -- FMMUs to other memory


def test_an_fmmu_can_lead_to_the_flag_of_a_mailbox(line):
    line.bring_to_op()
    line.write(0, 0x0620, fmmu(0x9000, 1, 0x080D, 1))
    assert line.ask(10, 0x9000, 0, b"\0") == (b"\x00", 1)
    line.mail(0, struct.pack("<HBHB4x", 2 << 12, 0x40, 0x1000, 0))
    assert line.ask(10, 0x9000, 0, b"\0") == (b"\x08", 1)


def test_bitwise_fmmus_are_not_there(line):
    line.bring_to_op()
    bitwise = bytearray(fmmu(0x9000, 1, 0x080D, 1))
    bitwise[6] = bitwise[7] = 3
    line.write(0, 0x0620, bitwise)
    assert line.ask(10, 0x9000, 0, b"\0")[1] == 0


# -- distributed clocks


def clock_line(drift):
    line = Line([0.0] + [drift] * 11)
    line.configure()
    line.time_ns = 10**12 + 1234567
    return line


def number(line, i, address, form):
    return struct.unpack(form, line.read(i, address, struct.calcsize(form)))[0]


def test_receive_times_tell_the_delays_of_a_line():
    line = clock_line(0.0)
    line.ask(B_WRITE, 0, 0x0900, bytes(4))
    times = [[number(line, i, 0x0900 + 4 * p, "<I") for p in (0, 1)] for i in range(line.count)]
    last = line.count - 1
    for i in range(last):
        # the round trip behind a slave is longer than that behind the next by twice their delay
        behind_next = times[i + 1][1] - times[i + 1][0] if i + 1 < last else 0
        assert times[i][1] - times[i][0] - behind_next == 2 * HOP
        assert number(line, i, 0x0918, "<Q") == line.time_ns + i * HOP
    assert times[last][1] == 0


def test_system_time_is_the_local_one_with_its_offset():
    line = clock_line(0.0)
    line.write(2, 0x0920, struct.pack("<q", -line.time_ns))
    line.time_ns += 777
    assert number(line, 2, 0x0910, "<Q") == 777 + 2 * HOP


@pytest.mark.parametrize("command", [AP_MULTIPLE, FP_MULTIPLE])
def test_clocks_that_drift_follow_the_first(command):
    drift, cycle = 50.0, 2_000_000
    line = clock_line(drift)
    line.ask(B_WRITE, 0, 0x0900, bytes(4))
    for i in range(line.count):
        line.write(i, 0x0920, struct.pack("<q", -number(line, i, 0x0918, "<Q")))
        line.write(i, 0x0928, struct.pack("<I", i * HOP))
    for _ in range(200):
        line.time_ns += cycle
        slave = 0 if command == AP_MULTIPLE else FIRST_STATION
        assert line.ask(command, slave, 0x0910, bytes(8))[1] == line.count
    step = drift * 1e-6 * cycle
    for i in range(1, line.count):
        shown = number(line, i, 0x092C, "<I")
        difference = (shown & 0x7FFFFFFF) * (-1 if shown >> 31 else 1)
        # a proportional loop lags by the drift of a cycle over its gain, to the next nanosecond
        assert abs(difference - 4 * step) <= 4
    assert number(line, 0, 0x092C, "<I") == 0


def test_sync0_settings_are_kept(line):
    line.write(0, 0x09A0, struct.pack("<I", 2_000_000))
    line.write(0, 0x0990, struct.pack("<Q", 10**10))
    line.write(0, 0x0980, b"\x00\x03")
    assert line.read(0, 0x0980, 2) == b"\x00\x03"
    assert number(line, 0, 0x09A0, "<I") == 2_000_000
    assert number(line, 0, 0x0990, "<Q") == 10**10


def test_a_station_address_is_where_the_master_puts_it():
    line = Line()
    assert line.ask(AP_WRITE, -5, 0x0010, b"\x34\x12")[1] == 1
    assert line.ask(FP_READ, 0x1234, 0x0000, bytes(1)) == (b"\x11", 1)
    assert line.ask(FP_READ, 0x0000, 0x0000, bytes(1))[1] == line.count - 1
