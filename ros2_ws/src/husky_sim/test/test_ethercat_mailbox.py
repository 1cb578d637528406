"""CoE at the mailbox of a drive, message by message (ETG.1000.6, CiA 301)."""

import struct

import pytest
from ethercat_line import Line
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_sim.devices.drives.drive import LONGEST_COMMAND

REQUEST, RESPONSE, INFORMATION, EMERGENCY = 2, 3, 8, 1
RATED_CURRENT, DEVICE_NAME, OS_COMMAND, VENDOR = (0x6075, 0), (0x1008, 0), (0x1023, 1), (0x1018, 1)
OS_REPLY = (0x1023, 3)
FIRST, SEGMENT = 140 - 16, 140 - 9  # bytes of the object in the first message and in the next


@pytest.fixture
def line():
    made = Line()
    made.configure()
    made.request(2)
    return made


def upload(line, index, subindex):
    return line.sdo(0, struct.pack("<BHB4x", 0x40, index, subindex))


def aborted(line, content):
    """Return the abort code of an SDO request."""
    service, answer = line.sdo(0, content)
    assert service == REQUEST and answer[0] == 0x80 and len(answer) == 8
    return struct.unpack_from("<I", answer, 4)[0]


def head(command, index, subindex, *size):
    return struct.pack("<BHB" + "I" * len(size), command, index, subindex, *size)


def download(line, index, subindex, data, chunk=SEGMENT):
    """Download in a normal transfer, in segments where it is long; return the last answer."""
    first, rest = data[:FIRST], data[FIRST:]
    answer = line.sdo(0, head(0x21, index, subindex, len(data)) + first)
    toggle = 0
    while rest:
        piece, rest = rest[:chunk], rest[chunk:]
        command = toggle | (0 if rest else 1) | max(7 - len(piece), 0) << 1
        answer = line.sdo(0, bytes((command,)) + piece.ljust(7, b"\0"))
        assert answer == (RESPONSE, bytes((0x20 | toggle,)) + bytes(7))
        toggle ^= 0x10
    return answer


def upload_all(line, index, subindex):
    """Return an object and the number of messages that it came in."""
    service, answer = upload(line, index, subindex)
    assert service == RESPONSE and answer[:4] == head(0x41, index, subindex)
    size, data = struct.unpack_from("<I", answer, 4)[0], answer[8:]
    toggle, messages = 0, 1
    while len(data) < size:
        service, answer = line.sdo(0, bytes((0x60 | toggle,)) + bytes(7))
        assert service == RESPONSE and answer[0] & 0xF0 == toggle
        unused = answer[0] >> 1 & 7
        data += answer[1 : len(answer) - unused]
        assert bool(answer[0] & 1) == (len(data) == size)
        toggle ^= 0x10
        messages += 1
    return data, messages


# -- SDO


def test_expedited_upload(line):
    assert upload(line, *VENDOR) == (RESPONSE, head(0x43, *VENDOR) + b"\x9a\0\0\0")
    assert upload(line, 0x1018, 0) == (RESPONSE, head(0x4F, 0x1018, 0) + b"\x04\0\0\0")
    assert upload(line, 0x6041, 0)[1][0] == 0x4B  # two bytes


def test_expedited_download(line):
    written = head(0x23, *RATED_CURRENT) + struct.pack("<I", 7000)
    assert line.sdo(0, written) == (RESPONSE, head(0x60, *RATED_CURRENT) + bytes(4))
    assert line.segment.records["rated_current"][0] == 7.0


def test_normal_transfers(line):
    assert upload_all(line, *DEVICE_NAME) == (b"Gold Twitter", 1)
    assert download(line, *OS_COMMAND, b"VR;XP") == (RESPONSE, head(0x60, *OS_COMMAND) + bytes(4))
    assert upload_all(line, *OS_COMMAND) == (b"VR;XP", 1)
    assert download(line, *RATED_CURRENT, struct.pack("<I", 9000))[0] == RESPONSE
    assert line.segment.records["rated_current"][0] == 9.0


@pytest.mark.parametrize(
    ("length", "messages"),
    [(FIRST, 1), (FIRST + 1, 2), (FIRST + 8, 2), (FIRST + SEGMENT, 2), (LONGEST_COMMAND, 4)],
)
def test_transfers_in_segments(line, length, messages):
    text = bytes(i % 251 for i in range(length))
    assert download(line, *OS_COMMAND, text)[0] == RESPONSE
    assert upload_all(line, *OS_COMMAND) == (text, messages)
    assert upload_all(line, *OS_REPLY)[0] == text + b";"


def test_an_empty_object_has_no_bytes(line):
    assert upload(line, *OS_COMMAND) == (RESPONSE, head(0x41, *OS_COMMAND, 0))


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (head(0x40, 0x5555, 0, 0), 0x06020000),
        (head(0x40, 0x1018, 9, 0), 0x06090011),
        (head(0x23, 0x1018, 1, 0), 0x06010002),
        (head(0x2F, *RATED_CURRENT, 1), 0x06070010),
        (head(0x23, *RATED_CURRENT, 0), 0x06090030),
        (head(0x50, 0x1018, 0, 0), 0x06010000),  # complete access
        (head(0x31, 0x1C12, 0, 2), 0x06010000),
        (head(0xA0, 0x1018, 0, 0), 0x05040001),
        (head(0x60, 0, 0, 0), 0x05040001),  # a segment of nothing
        (head(0x01, 0, 0, 0), 0x05040001),
        (head(0x21, *OS_COMMAND, 5000), 0x05040005),
    ],
)
def test_abort_codes(line, content, code):
    assert aborted(line, content) == code
    assert struct.unpack_from("<HB", content, 1)[1] in (0, 1, 9)
    assert upload(line, *VENDOR)[0] == RESPONSE  # and it goes on


def test_an_object_that_is_too_long_is_refused_at_its_end(line):
    text = bytes(LONGEST_COMMAND + 1)
    line.sdo(0, head(0x21, *OS_COMMAND, len(text)) + text[:FIRST])
    for i in range(2):
        line.sdo(0, bytes((0x10 * i,)) + text[:SEGMENT])
    rest = len(text) - FIRST - 2 * SEGMENT
    assert aborted(line, b"\x01" + text[:rest]) == 0x06070012


def test_toggle_bits_alternate(line):
    download(line, *OS_COMMAND, bytes(400))
    upload(line, *OS_COMMAND)
    line.sdo(0, b"\x60" + bytes(7))
    assert aborted(line, b"\x60" + bytes(7)) == 0x05030000
    assert aborted(line, b"\x70" + bytes(7)) == 0x05040001  # the transfer is over
    line.sdo(0, head(0x21, *OS_COMMAND, 400) + bytes(FIRST))
    assert aborted(line, b"\x10" + bytes(SEGMENT)) == 0x05030000


def test_segments_bring_as_many_bytes_as_were_announced(line):
    line.sdo(0, head(0x21, *OS_COMMAND, 200) + bytes(FIRST))
    assert aborted(line, b"\x01" + bytes(10)) == 0x06070010
    line.sdo(0, head(0x21, *OS_COMMAND, 200) + bytes(FIRST))
    assert aborted(line, b"\x00" + bytes(SEGMENT)) == 0x06070010


def test_an_abort_of_the_master_ends_a_transfer(line):
    download(line, *OS_COMMAND, bytes(400))
    upload(line, *OS_COMMAND)
    assert line.mail(0, struct.pack("<H", REQUEST << 12) + head(0x80, *OS_COMMAND, 0)) == 1
    assert line.fetch(0) is None
    assert aborted(line, b"\x60" + bytes(7)) == 0x05040001


# -- the mailbox


def test_mailboxes_are_closed_in_init(line):
    line.request(1)
    assert line.mail(0, bytes(10)) == 0
    assert line.fetch(0) is None


def test_a_request_counts_when_its_last_byte_is_written(line):
    request = struct.pack("<HHBBH", 10, 0, 0, 0x13, REQUEST << 12) + head(0x40, *VENDOR, 0)
    mailbox = request.ljust(140, b"\0")
    assert line.write(0, 0x1810, mailbox[16:]) == 0  # not from its first byte
    assert line.write(0, 0x1800, mailbox[:100]) == 1
    assert line.fetch(0) is None
    assert line.write(0, 0x1800 + 100, mailbox[100:]) == 1
    assert line.read(0, 0x080D, 1) == b"\x08"
    assert line.read(0, 0x1900, 100)[8:12] == head(0x43, *VENDOR)
    assert line.read(0, 0x080D, 1) == b"\x08"  # until its last byte is read
    assert line.read(0, 0x1900 + 100, 40) == bytes(40)
    assert line.read(0, 0x080D, 1) == b"\x00"
    assert line.read(0, 0x1900, 140) is None


def test_a_request_waits_while_replies_do(line):
    for _ in range(2):
        assert line.mail(0, struct.pack("<H", REQUEST << 12) + head(0x40, *VENDOR, 0)) == 1
    assert line.mail(0, struct.pack("<H", REQUEST << 12) + head(0x40, *DEVICE_NAME, 0)) == 1
    assert line.read(0, 0x0805, 1) == b"\x08"
    assert line.mail(0, bytes(10)) == 0
    commands = []
    while (message := line.fetch(0)) is not None:
        commands.append(message[1][2])
    assert commands == [0x43, 0x43, 0x41]
    assert line.read(0, 0x0805, 1) == b"\x00"


def test_a_repeated_request_is_answered_once(line):
    message = struct.pack("<HHBBH", 10, 0, 0, 0x33, REQUEST << 12) + head(0x40, *VENDOR, 0)
    for _ in range(2):
        assert line.write(0, 0x1800, message.ljust(140, b"\0")) == 1
    assert line.fetch(0) is not None and line.fetch(0) is None


def test_a_lost_reply_is_repeated(line):
    line.mail(0, struct.pack("<H", REQUEST << 12) + head(0x40, *VENDOR, 0))
    first = line.fetch(0)
    for request in (3, 1, 3):  # bit 1 toggles
        assert line.fetch(0) is None
        line.write(0, 0x080E, bytes((request,)))
        assert line.read(0, 0x080F, 1)[0] & 2 == request & 2
        assert line.fetch(0) == first


@pytest.mark.parametrize(
    ("kind", "length", "detail"),
    [(2, 10, 2), (4, 10, 2), (0, 10, 2), (3, 1, 6), (3, 135, 8), (3, 0xFFFF, 8)],
    ids=["EoE", "FoE", "error", "short", "longer than the mailbox", "much longer"],
)
def test_mailbox_errors(line, kind, length, detail):
    message = struct.pack("<HHBB", length, 0, 0, kind | 0x10).ljust(140, b"\0")
    assert line.write(0, 0x1800, message) == 1
    assert line.fetch(0) == (0, struct.pack("<HH", 1, detail))


def test_a_service_that_is_not_there(line):
    assert line.mail(0, struct.pack("<H", 6 << 12) + bytes(8)) == 1
    assert line.fetch(0) == (0, struct.pack("<HH", 1, 4))


@settings(max_examples=60, deadline=None)
@given(messages=st.lists(st.binary(min_size=1, max_size=134), max_size=4), state=st.integers(2, 4))
def test_garbage_is_answered_or_dropped(wired_mailbox, messages, state):
    line = wired_mailbox
    for message in messages:
        line.mail(0, bytes((message[0],)) + b"\x20" + message[1:])
        line.mail(0, message)
        for _ in range(3):
            line.fetch(0)
    while line.fetch(0) is not None:
        pass
    assert line.read(0, 0x0805, 1) == b"\0"


@pytest.fixture(scope="module")
def wired_mailbox():
    made = Line()
    made.configure()
    made.request(2)
    return made


# -- emergencies


def test_an_emergency_comes_by_itself_and_once(line):
    line.segment.inject("front_left_knee", "fault:3310")
    i = int((line.segment.records["injected_fault"] != 0).argmax())
    line.tick()
    assert line.read(i, 0x080D, 1) == b"\x08"
    message = (3, struct.pack("<HHB5x", EMERGENCY << 12, 0x3310, 0x05))
    assert line.fetch(i) == message  # error register: voltage
    assert line.fetch(i) is None
    assert not line.segment.emergencies()  # the wire has taken it
    assert all(line.fetch(j) is None for j in range(line.count) if j != i)


def test_process_data_put_an_emergency_into_the_mailbox(line):
    line.bring_to_op()
    line.segment.inject("front_left_knee", "fault:7300")
    line.tick()
    line.ask(12, 0, 0, bytes(480))
    i = int((line.segment.records["injected_fault"] != 0).argmax())
    assert line.wired.slaves[i].memory[0x080D] == 0x08


# -- SDO information


def information(line, opcode, data):
    """Return opcode and data of the answer, put together from its fragments."""
    assert line.mail(0, struct.pack("<HBxH", INFORMATION << 12, opcode, 0) + data) == 1
    whole, expected = b"", None
    while True:
        protocol, body = line.fetch(0)
        service, answer, left = struct.unpack_from("<HBxH", body)
        assert (protocol, service >> 12) == (3, INFORMATION)
        assert expected in (None, left) and bool(answer & 0x80) == (left > 0)
        whole, expected = whole + body[6:], left - 1
        if left == 0:
            return answer & 0x7F, whole


def object_list(line, kind):
    opcode, data = information(line, 1, struct.pack("<H", kind))
    assert opcode == 2 and struct.unpack_from("<H", data)[0] == kind
    return [value for (value,) in struct.iter_unpack("<H", data[2:])]


def test_every_object_is_listed_described_and_as_long_as_it_says(line):
    indices = object_list(line, 1)
    assert indices == sorted(set(indices)) and {0x1000, 0x1018, 0x1C12, 0x6041} <= set(indices)
    assert object_list(line, 0) == [len(object_list(line, kind)) for kind in range(1, 6)]
    for index in indices:
        opcode, data = information(line, 3, struct.pack("<H", index))
        found, kind, last, code = struct.unpack_from("<HHBB", data)
        assert (opcode, found) == (4, index) and data[6:].decode("ascii")
        assert code == (0x09 if last else 0x07)
        for subindex in range(last + 1):
            opcode, data = information(line, 5, struct.pack("<HBB", index, subindex, 7))
            assert opcode == 6 and data[:3] == struct.pack("<HB", index, subindex)
            data_type, bits, access = struct.unpack_from("<HHH", data, 4)
            assert access & 7 == 7 and data[10:].decode("ascii")
            assert last or data_type == kind
            value = line.segment.drives[0].sdo_read(index, subindex)
            assert 8 * len(value) == bits


def test_information_on_what_is_not_there(line):
    assert information(line, 3, struct.pack("<H", 0x5555)) == (7, struct.pack("<I", 0x06020000))
    missing = information(line, 5, struct.pack("<HBB", 0x1018, 9, 7))
    assert missing == (7, struct.pack("<I", 0x06090011))
    assert information(line, 9, b"\0\0")[0] == 7
