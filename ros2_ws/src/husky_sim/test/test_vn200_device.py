"""The emulated VN-200: its dialogue."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from vn200_bench import LEVEL, PERIOD, Bench, packets

from husky_description.rotation import swap_world_and_body
from husky_drivers.vn200.binary import OutputLayout
from husky_drivers.vn200.protocol import AsciiMessage, Checksum, decode_ascii, encode_ascii
from husky_drivers.vn200.stream import StreamParser


# Dialogue ---------------------------------------------------------------------------------------
def test_power_on_is_yaw_pitch_roll_at_40_hz_and_115200_baud():
    bench = Bench()
    assert bench.device.baud == 115200
    lines = bench.run(800, ((0.0, 0.0, 0.0, 1.0), LEVEL[1], LEVEL[2])).split(b"\r\n")[:-1]
    assert len(lines) == 40
    assert lines[0] == b"$VNYPR,+090.000,+000.000,+000.000*63"  # along x of ENU is east
    assert not bench.device.streaming


def test_euler_angles_are_those_of_the_rotation():
    rotation = Rotation.from_euler("ZYX", [43.5787, 1.8847, -5.9], degrees=True)
    pose = (swap_world_and_body(tuple(rotation.as_quat())), LEVEL[1], LEVEL[2])
    line = Bench().run(20, pose)
    assert decode_ascii(line).fields == ("+043.579", "+001.885", "-005.900")


@pytest.mark.parametrize(
    ("request_body", "reply"),
    [
        ("VNRRG,01", "$VNRRG,01,VN-200T-CR*31"),
        ("VNRRG,1", "$VNRRG,1,VN-200T-CR*01"),
        ("VNRRG,05", "$VNRRG,05,115200*5D"),
        ("VNRRG,07", "$VNRRG,07,40*5C"),
        ("VNRRG,30", "$VNRRG,30,0,0,0,0,1,0,1*6C"),
        ("VNRRG,26", "$VNRRG,26,1,0,0,0,1,0,0,0,1*6A"),
        ("VNWRG,06,0", "$VNWRG,06,0*6C"),
        ("VNWRG,07,40", "$VNWRG,07,40*59"),
        ("VNWRG,07,200", "$VNWRG,07,200*6F"),
        ("VNWRG,05,921600", "$VNWRG,05,921600*53"),
        ("VNWRG,5,9600", "$VNERR,0C*02"),  # too slow for YPR at 40 Hz
        ("VNASY,0", "$VNASY,0*4F"),
        ("VNASY,1", "$VNASY,1*4E"),
        ("VNWNV", "$VNWNV*57"),
        ("VNRFS", "$VNRFS*5F"),
        ("VNRST", "$VNRST*4D"),
        ("VNTAR", "$VNTAR*5F"),
    ],
)
def test_replies_are_the_published_ones(request_body, reply):
    assert Bench().say(request_body) == [reply]


@pytest.mark.parametrize(
    ("request_body", "code"),
    [
        ("VNXXX", 4),
        ("VNKMD,1", 4),
        ("VNWRG,06", 5),
        ("VNRRG", 5),
        ("VNWRG,75,1,1,01", 5),
        ("VNWRG,06,0,1,1", 6),
        ("VNRRG,01,1", 6),
        ("VNWNV,1", 6),
        ("VNWRG,05,100000", 7),
        ("VNWRG,06,99", 7),
        ("VNWRG,07,3", 7),
        ("VNWRG,75,1,1,01,8000", 7),
        ("VNWRG,75,1,1,08,0001", 7),  # no GPS in the emulator, and it says so
        ("VNASY,2", 7),
        ("VNWRG,26,1,0,0,0,1,0,0,0,2", 7),
        ("VNWRG,30,0,0,0,0,3,0,1", 7),
        ("VNRRG,x", 7),
        ("VNRRG,99", 8),
        ("VNWRG,01,VN-300", 9),
        ("VNWRG,08,0,0,0", 9),
        ("VNWRG,75,1,1,01,0131", 12),  # 432 kbit/s at 115200 baud
    ],
)
def test_refusals_have_the_published_codes(request_body, code):
    bench = Bench()
    before = bench.say("VNRRG,75") + bench.say("VNRRG,06") + bench.say("VNRRG,05")
    (line,) = bench.say(request_body)
    assert decode_ascii(line.encode()) == AsciiMessage("ERR", (f"{code:02X}",))
    assert bench.say("VNRRG,75") + bench.say("VNRRG,06") + bench.say("VNRRG,05") == before


def test_damaged_and_overlong_lines():
    bench = Bench()
    assert bench.send(b"$VNRRG,1*00\r\n") == ["$VNERR,03*72"]
    assert bench.send(b"$" + b"A" * 300) == ["$VNERR,02*73"]
    assert bench.send(b"\xff" * 300) == []
    assert bench.send(b"noise" + encode_ascii("VNRRG,05")) == ["$VNRRG,05,115200*5D"]
    assert bench.send(b"$VNRR") == []
    assert bench.send(b"G,05*XX\r\n") == ["$VNRRG,05,115200*5D"]


def test_replies_are_secured_as_the_request_was():
    (line,) = Bench().say("VNRRG,05", Checksum.CRC16)
    assert decode_ascii(line.encode()) == AsciiMessage("RRG", ("05", "115200"), Checksum.CRC16)


def test_unasked_output_is_secured_as_register_30_says():
    bench = Bench()
    bench.say("VNWRG,30,0,0,0,0,2,0,1")
    assert decode_ascii(bench.run(20)).checksum is Checksum.CRC16


@pytest.mark.parametrize(
    ("control", "behind"),
    [("1,0", ["T0000000"]), ("0,1", ["S0000"]), ("2,2", ["T0000000", "S0000"])],
)
def test_counter_and_status_stand_behind_unasked_output(control, behind):
    bench = Bench()
    assert len(bench.say(f"VNWRG,30,{control},0,0,1,0,1")) == 1
    assert list(decode_ascii(bench.run(20)).fields[3:]) == behind


def test_a_reference_frame_rotation_counts_after_a_save_and_a_reset():
    """Of a device lying on its right side: what it calls z is the user's y."""
    bench = Bench(reset_time=0.0).stream()
    rows = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0)
    pose = (LEVEL[0], (0.1, 0.2, 0.3), LEVEL[2])
    (before,) = packets(bench.run(1, pose))
    bench.say("VNWRG,26," + ",".join(f"{number:g}" for number in rows))
    assert packets(bench.run(1, pose))[0][1:] == before[1:]
    bench.say("VNWNV")
    bench.say("VNRST")
    (after,) = packets(bench.run(1, pose))
    matrix = np.reshape(rows, (3, 3))
    assert matrix @ before[5:8] == pytest.approx(after[5:8])
    assert matrix @ before[8:11] == pytest.approx(after[8:11])
    for first, second in (before[8:11], after[8:11]), (before[5:8], after[5:8]):
        in_world = Rotation.from_quat(before[1:5]).apply(first)
        assert Rotation.from_quat(after[1:5]).apply(second) == pytest.approx(in_world, abs=1e-6)


def test_error_modes():
    bench = Bench()
    bench.say("VNWRG,30,0,0,0,0,1,0,0")
    assert bench.say("VNXXX") == []
    bench.say("VNWRG,30,0,0,0,0,1,0,2")
    assert bench.say("VNXXX") == ["$VNERR,04*75"]
    assert bench.run(800) == b""


def test_a_port_number_is_echoed_only_when_it_was_given():
    bench = Bench()
    assert bench.say("VNWRG,06,2,1") == [encode_ascii("VNWRG,06,2,1").decode().strip()]
    assert bench.say("VNRRG,06") == [encode_ascii("VNRRG,06,2").decode().strip()]
    bench.say("VNWRG,06,0,2")  # the other port
    assert bench.say("VNRRG,06") == [encode_ascii("VNRRG,06,2").decode().strip()]


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        (2, "$VNQTN,+0.000000,+0.000000,+0.707107,+0.707107"),
        (11, "$VNACC,+00.000,-00.000,-09.810"),
        (12, "$VNGYR,+00.000000,-00.000000,-00.000000"),
    ],
)
def test_other_ascii_messages(kind, line):
    bench = Bench()
    bench.say(f"VNWRG,06,{kind}")
    assert bench.run(20).decode().split("*")[0] == line
    register = {2: "09", 11: "18", 12: "19"}[kind]
    assert bench.say(f"VNRRG,{register}")[0].split("*")[0] == f"$VNRRG,{register},{line[7:]}"


def test_binary_output_of_other_groups():
    bench = Bench()
    bench.say("VNWRG,06,0")
    bench.say("VNWRG,76,1,80,16,0001,0600,0006")
    layout = OutputLayout([0, 0x0001, 0x0600, 0, 0x0006])
    (message,) = StreamParser(layout).feed(bench.run(80))
    assert layout.fields == (
        "time.time_startup",
        "imu.accel",
        "imu.angular_rate",
        "attitude.yaw_pitch_roll",
        "attitude.quaternion",
    )
    assert message.values[0] == 80 * PERIOD
    assert message.values[1:4] == pytest.approx((0, 0, -9.81))
    assert message.values[7] == pytest.approx(90.0)


def test_the_reply_to_a_change_of_rate_goes_out_before_it():
    bench = Bench()
    bench.device.feed(encode_ascii("VNWRG,05,921600"))
    assert bench.device.take_output() == b"$VNWRG,05,921600*53\r\n"
    assert bench.device.baud == 115200
    bench.device.take_output()
    assert bench.device.baud == 921600


def test_or_behind_it():
    bench = Bench(replies_at_new_baud=True)
    bench.device.feed(encode_ascii("VNWRG,05,921600"))
    assert bench.device.take_output() == b"$VNWRG,05,921600*53\r\n"
    assert bench.device.baud == 921600


def test_settings_survive_a_reset_only_when_saved():
    bench = Bench(reset_time=0.01).stream()
    bench.say("VNWNV")
    bench.say("VNWRG,00,tag")
    bench.say("VNRST")
    assert bench.run(7) == b""  # still starting
    assert bench.say("VNRRG,00") == []
    assert len(packets(bench.run(10))) > 5
    assert bench.say("VNRRG,00") == [encode_ascii("VNRRG,00,").decode().strip()]
    bench.say("VNRFS")
    bench.run(10)
    assert bench.device.baud == 115200
    assert bench.say("VNRRG,75") == [encode_ascii("VNRRG,75,0,1,00").decode().strip()]


@pytest.mark.parametrize("restarts", [False, True])
def test_a_reset_restarts_the_clock_if_wanted(restarts):
    bench = Bench(reset_restarts_clock=restarts, reset_time=0.01).stream()
    bench.run(100)
    bench.say("VNWNV")
    bench.say("VNRST")
    first = packets(bench.run(10))[0][0]
    assert first == (8 * PERIOD if restarts else 108 * PERIOD)


def test_pause_and_resume():
    bench = Bench().stream()
    bench.say("VNASY,0")
    assert not bench.device.streaming
    assert bench.run(10) == b""
    bench.say("VNASY,1")
    assert bench.device.streaming
    assert len(packets(bench.run(10))) == 10


def test_tare_makes_the_present_attitude_the_reference():
    bench = Bench().stream()
    tilted = (tuple(Rotation.from_euler("xyz", [0.3, 0.2, 1.0]).as_quat()), LEVEL[1], LEVEL[2])
    bench.run(1, tilted)
    bench.say("VNTAR")
    (values,) = packets(bench.run(1, tilted))
    assert np.abs(values[1:5]) == pytest.approx([0, 0, 0, 1], abs=1e-6)
    (values,) = packets(bench.run(1))
    turned = Rotation.from_quat(values[1:5]).magnitude()
    expected = Rotation.from_euler("xyz", [0.3, 0.2, 1.0]).magnitude()
    assert turned == pytest.approx(expected, abs=1e-6)


def test_output_that_nobody_takes_is_bounded_and_reported():
    bench = Bench().stream()
    for tick in range(1000):
        bench.device.sample(tick * PERIOD, *LEVEL)
    assert len(bench.device.take_output()) <= 2048 + 54
    assert bench.device.take_output() == b"$VNERR,0B*03\r\n"


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=60),
            st.tuples(
                st.sampled_from(["RRG", "WRG", "ASY", "TAR", "RST", "RFS", "WNV", "XYZ"]),
                st.lists(st.text("0123456789ABCDEF.-", max_size=6), max_size=6),
            ).map(lambda m: AsciiMessage(m[0], tuple(m[1])).encode()),
        ),
        max_size=20,
    )
)
def test_no_bytes_of_the_host_break_it(chunks):
    bench = Bench()
    for chunk in chunks:
        bench.device.feed(chunk)
        bench.run(1)
    bench.run(100)
    bench.device.feed(b"\r\n")
    bench.device.take_output()
    bench.say("VNWRG,30,0,0,0,0,1,0,1")
    assert bench.say("VNRRG,01") == ["$VNRRG,01,VN-200T-CR*31"]
