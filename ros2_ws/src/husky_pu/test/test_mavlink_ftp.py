"""The read-only FTP server, with pymavlink's own frames and a client that loses packets."""

import json
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavftp_op as ftp

from husky_pu.autopilot.component_metadata import GENERAL, PARAMETERS, component_files
from husky_pu.autopilot.flight_parameters import TABLE, FlightParameters
from husky_pu.autopilot.mavlink_ftp import DATA_SIZE, PAYLOAD_SIZE, FtpServer, crc32

ME, OTHER = (255, 190), (254, 190)
LONG = bytes(range(256)) * 5
FILES = {"/long.bin": LONG, "/short.txt": b"abc", "/empty": b""}
READ_ONLY_REQUESTS = (
    ftp.OP_CreateFile, ftp.OP_RemoveFile, ftp.OP_CreateDirectory, ftp.OP_RemoveDirectory,
    ftp.OP_OpenFileWO, ftp.OP_TruncateFile, ftp.OP_Rename,
)  # fmt: skip


def parse(payload):
    """A payload as pymavlink's client reads it."""
    header = struct.unpack_from("<HBBBBBxI", payload)
    return ftp.FTP_OP(*header, bytearray(payload[12 : 12 + header[3]]))


class Client:
    """Asks a server, counting sequence numbers."""

    def __init__(self, files=FILES, name=ME):
        self.server = FtpServer(files)
        self.name = name
        self.sequence = 0

    def request(self, opcode, data=b"", *, session=0, size=None, offset=0, name=None):
        size = len(data) if size is None else size
        frame = ftp.FTP_OP(self.sequence, session, opcode, size, 0, 0, offset, bytearray(data))
        payload = bytes(frame.pack()).ljust(PAYLOAD_SIZE, b"\0")
        reply = self.server.answer(payload, name or self.name)
        assert len(reply) == PAYLOAD_SIZE
        answer = parse(reply)
        assert (answer.seq, answer.req_opcode) == ((self.sequence + 1) & 0xFFFF, opcode)
        self.sequence = (self.sequence + 2) & 0xFFFF
        return answer

    def open(self, path=b"/long.bin", **keywords):
        answer = self.request(ftp.OP_OpenFileRO, path, **keywords)
        assert answer.opcode == ftp.OP_Ack
        return answer.session


def reason(answer):
    assert (answer.opcode, answer.size) == (ftp.OP_Nack, 1)
    return answer.payload[0]


def test_a_directory():
    client = Client()
    answer = client.request(ftp.OP_ListDirectory, b"/")
    assert bytes(answer.payload) == b"Flong.bin\t1280\0Fshort.txt\t3\0Fempty\t0\0"
    answer = client.request(ftp.OP_ListDirectory, b"", offset=1)
    assert bytes(answer.payload) == b"Fshort.txt\t3\0Fempty\t0\0"
    assert reason(client.request(ftp.OP_ListDirectory, b"/", offset=3)) == 6  # end of file
    assert reason(client.request(ftp.OP_ListDirectory, b"/none")) == 10


def test_a_directory_of_more_than_one_message():
    files = {f"/file_of_a_long_name_{number}": b"x" for number in range(40)}
    client, names = Client(files), []
    while (answer := client.request(ftp.OP_ListDirectory, b"/", offset=len(names))).size > 1:
        names += bytes(answer.payload).split(b"\0")[:-1]
    assert [f"F{name[1:]}\t1".encode() for name in files] == names


@pytest.mark.parametrize("path", [b"/long.bin", b"long.bin", b"//./long.bin\0rubbish"])
def test_a_file_piece_by_piece(path):
    client = Client()
    opened = client.request(ftp.OP_OpenFileRO, path, session=77)
    assert struct.unpack("<I", opened.payload) == (len(LONG),)
    assert opened.session == 77  # as MAVProxy wants it
    content = b""
    while True:
        answer = client.request(ftp.OP_ReadFile, session=77, size=200, offset=len(content))
        if answer.opcode == ftp.OP_Nack:
            break
        content += answer.payload
    assert (reason(answer), content) == (6, LONG)
    assert client.request(ftp.OP_TerminateSession, session=77).opcode == ftp.OP_Ack
    assert reason(client.request(ftp.OP_ReadFile, session=77, size=9)) == 4


@pytest.mark.parametrize(
    ("opcode", "data", "expected"),
    [
        *((opcode, b"/long.bin", 9) for opcode in READ_ONLY_REQUESTS),
        (ftp.OP_OpenFileRO, b"/none", 10),
        (ftp.OP_OpenFileRO, b"\xff\xfe", 10),
        (ftp.OP_OpenFileRO, b"/", 1),
        (ftp.OP_OpenFileRO, b"../../etc/passwd", 10),
        (ftp.OP_CalcFileCRC32, b"/none", 10),
        (ftp.OP_TerminateSession, b"", 4),
        (ftp.OP_ReadFile, b"", 4),
        (ftp.OP_BurstReadFile, b"", 4),
        (ftp.OP_WriteFile, b"x", 4),
        (16, b"", 7),
        (99, b"", 7),
    ],
)
def test_the_reason_of_a_refusal(opcode, data, expected):
    assert reason(Client().request(opcode, data, session=3)) == expected


def test_other_refusals():
    client = Client()
    session = client.open()
    assert reason(client.request(ftp.OP_WriteFile, b"x", session=session)) == 9
    assert reason(client.request(ftp.OP_ReadFile, session=session, size=240)) == 3
    sessions = {session, *(client.open(session=session) for _ in range(3))}
    assert len(sessions) == 4
    assert reason(client.request(ftp.OP_OpenFileRO, b"/empty")) == 5
    assert reason(client.request(ftp.OP_ReadFile, session=session, size=9, name=OTHER)) == 4
    assert client.request(ftp.OP_ResetSessions).opcode == ftp.OP_Ack
    client.open()


def test_a_request_that_comes_again_gets_its_reply_again():
    client = Client()
    frame = ftp.FTP_OP(5, 0, ftp.OP_OpenFileRO, 6, 0, 0, 0, bytearray(b"/empty"))
    payload = bytes(frame.pack()).ljust(PAYLOAD_SIZE, b"\0")
    replies = {client.server.answer(payload, ME) for _ in range(20)}
    assert len(replies) == 1
    client.sequence = 7
    assert [client.open(session=1) for _ in range(3)] == [1, 2, 3]  # only one was opened before


def test_replies_are_not_answered():
    for opcode in (ftp.OP_Ack, ftp.OP_Nack):
        frame = ftp.FTP_OP(5, 0, opcode, 0, 0, 0, 0, bytearray())
        assert FtpServer(FILES).answer(bytes(frame.pack()), ME) is None


@given(st.binary(max_size=PAYLOAD_SIZE), st.sampled_from([ME, OTHER]))
def test_any_bytes_are_answered(payload, name):
    server = FtpServer(FILES)
    reply = server.answer(payload, name)
    if len(payload) > 3 and payload[3] in (ftp.OP_Ack, ftp.OP_Nack):
        assert reply is None
    else:
        assert parse(reply).opcode in (ftp.OP_Ack, ftp.OP_Nack)
    server.stream()


@given(st.data(), st.integers(0, DATA_SIZE))
def test_a_burst_gets_through_though_packets_are_lost(data, size):
    """As MAVProxy fetches: bursts, then what is missing of them."""
    client = Client()
    session = client.open()
    pieces = {}

    def take(packet):
        if data.draw(st.booleans()):
            pieces[packet.offset] = bytes(packet.payload)

    first = client.request(ftp.OP_BurstReadFile, session=session, size=size)
    take(first)
    sequence, complete = first.seq, first.burst_complete
    while client.server.bursting:
        ((name, payload),) = client.server.stream()
        packet = parse(payload)
        assert name == ME and not complete
        assert (packet.seq, packet.req_opcode) == (sequence + 1, ftp.OP_BurstReadFile)
        sequence, complete = packet.seq, packet.burst_complete
        take(packet)
    assert complete
    assert client.server.stream() == []
    while (at := first_gap(pieces)) < len(LONG):
        pieces[at] = bytes(
            client.request(ftp.OP_ReadFile, session=session, size=DATA_SIZE, offset=at).payload
        )
    whole = bytearray(len(LONG))
    for offset, piece in pieces.items():
        whole[offset : offset + len(piece)] = piece
    assert bytes(whole) == LONG
    end = client.request(ftp.OP_BurstReadFile, session=session, offset=len(LONG))
    assert reason(end) == 6


def first_gap(pieces):
    end = 0
    while pieces.get(end):
        end += len(pieces[end])
    return end


def test_a_crowd_of_clients_costs_no_more_than_sixteen():
    client = Client()
    for number in range(1000):
        client.open(name=(number, 1))
    assert len(client.server._clients) == 16


def test_the_checksum_is_the_one_of_mavlink():
    assert crc32(b"123456789") == 0x2DFD2D88  # CRC-32 from 0, without inversion, reflected
    assert crc32(b"56789", crc32(b"1234")) == crc32(b"123456789")
    answer = Client({"/a": b"123456789"}).request(ftp.OP_CalcFileCRC32, b"/a")
    assert struct.unpack("<I", answer.payload) == (0x2DFD2D88,)


def test_component_metadata_tells_every_parameter():
    parameters = FlightParameters({"BAT1_N_CELLS": 4})
    files = component_files(parameters.defaults)
    (entry,) = json.loads(files[GENERAL])["metadataTypes"]
    assert entry == {
        "type": 1,
        "uri": "mftp:///parameters.json",
        "fileCrc": crc32(files[PARAMETERS]),
    }
    told = {row["name"]: row for row in json.loads(files[PARAMETERS])["parameters"]}
    assert list(told) == list(TABLE)
    assert told["BAT1_N_CELLS"]["default"] == 4
    assert told["BAT1_N_CELLS"]["type"] == "Int32"
    assert (told["COM_OF_LOSS_T"]["min"], told["COM_OF_LOSS_T"]["max"]) == (0.0, 60.0)
    assert told["COM_OF_LOSS_T"]["units"] == "s"
    assert told["IMU_DGYRO_CUTOFF"]["units"] == "Hz"
    assert "units" not in told["MC_YAW_WEIGHT"]
