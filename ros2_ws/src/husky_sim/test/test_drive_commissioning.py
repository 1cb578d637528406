"""The master sets drives up in which somebody has saved something else."""

import math
import struct

import pytest

from husky_description.robot import load_robot
from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.bus import NO_OBJECT, AlState, SdoAbort
from husky_drivers.ethercat.commissioning import DriveError, guards, parameters, recover
from husky_drivers.ethercat.master import Master
from husky_drivers.ethercat.pdo import mapped
from husky_sim.devices.drives.segment import SimulatedSegment

ROBOT = load_robot()
SETTINGS = settings_of(ROBOT)
AXIS, NAME = 3, ROBOT.joint_names[3]
COUNTS = 8192 * 30 / (2 * math.pi)
SAVED = {
    od.POLARITY: 0x80,
    od.GEAR_MOTOR: 30,
    od.POSITION_OFFSET: 4000,
    od.VELOCITY_OFFSET: -7,
    od.RANGE_LOWER: 0,
    od.RANGE_UPPER: 8191,
    od.LIMIT_LOWER: -1000,
    od.LIMIT_UPPER: 1000,
    od.MAX_MOTOR_SPEED: 500,
    od.MAX_ACCELERATION: 100,
    od.MAX_DECELERATION: 100,
    od.RATED_CURRENT: 5000,
    od.RATED_TORQUE: 123,
    od.MAX_CURRENT: 100,
    od.INTEGRAL_GAIN: 3.0,
    od.VELOCITY_GAIN: 0.5,
    od.POSITION_GAIN: 9.0,
    od.FOLLOWING_WINDOW: 10,
    od.FOLLOWING_TIME: 1,
    od.QUICK_STOP_OPTION: 0,
    od.SHUTDOWN_OPTION: 1,
    od.DISABLE_OPTION: 1,
    od.HALT_OPTION: 1,
    od.FAULT_OPTION: 1,
    od.ABORT_CONNECTION_OPTION: 0,
    od.DECELERATION: 5,
    od.QUICK_STOP_DECELERATION: 5,
    od.INTERPOLATION_VALUE: 7,
}


def set_up(saved=None):
    """Return the segment, and the sentences about what was changed in one of its drives."""
    segment = SimulatedSegment(ROBOT)
    Master(segment, SETTINGS, ROBOT).configure()  # as it is after one set-up, all drives alike
    for drive in segment.drives:
        assert drive.record["al_status"] == AlState.SAFEOP
    segment.drives[AXIS].preset(saved or {})
    master = Master(segment, SETTINGS, ROBOT)
    master.configure()
    return segment, master.changes


def test_a_second_set_up_changes_nothing():
    assert set_up()[1] == []


def test_whichever_access_is_refused_the_drive_is_not_used_and_named():
    """Each one in turn, from the first mapping object to the last parameter."""
    refused = 0
    while True:
        segment = SimulatedSegment(ROBOT)
        segment.inject(NAME, f"mailbox:{refused + 1}")
        try:
            Master(segment, SETTINGS, ROBOT).configure()
        except DriveError as error:
            assert str(error).startswith(f"{NAME}: slave {AXIS}, object 0x"), error
            assert {al.status for al in segment.al_states()} == {AlState.PREOP}
            refused += 1
        else:
            break
    assert refused > len(list(parameters(SETTINGS, AXIS)))


def test_drives_are_told_apart_by_their_serial_numbers():
    as_it_is = settings_of(ROBOT, serial_numbers=tuple(range(1, 13)))
    Master(SimulatedSegment(ROBOT), as_it_is, ROBOT).configure()
    swapped = (1, 2, 3, 5, 4, *range(6, 13))
    master = Master(SimulatedSegment(ROBOT), settings_of(ROBOT, serial_numbers=swapped), ROBOT)
    with pytest.raises(DriveError, match=f"{NAME}: the drive has serial number 4, it must be 5"):
        master.configure()


def test_a_drive_that_was_exchanged_while_it_had_no_power_is_not_taken_back():
    segment, settings = SimulatedSegment(ROBOT), settings_of(ROBOT, serial_numbers=range(1, 13))
    master = Master(segment, settings, ROBOT)
    master.configure()
    master.start()
    segment.inject(NAME, "unpowered")
    segment.clear()
    assert segment.al_states()[AXIS].status == AlState.INIT
    serial = next(entry for entry in segment.drives[AXIS]._fixed if entry == od.SERIAL_NUMBER)
    segment.drives[AXIS]._fixed[serial] = 99
    assert f"{NAME}: the drive has serial number 99, it must be 4" in recover(segment, settings)
    assert segment.al_states()[AXIS].status == AlState.PREOP
    segment.drives[AXIS]._fixed[serial] = 4
    assert recover(segment, settings) == ""
    assert {al.status for al in segment.al_states()} == {AlState.OP}


@pytest.mark.parametrize("entry", SAVED, ids=lambda entry: entry.name)
def test_whatever_is_saved_the_drive_gets_the_value_that_it_has_to_have(entry):
    segment, changes = set_up({entry: SAVED[entry]})
    (wanted,) = (
        value
        for each, value in (*guards(SETTINGS, AXIS), *parameters(SETTINGS, AXIS))
        if each is entry
    )
    assert entry.unpack(segment.sdo_read(AXIS, entry.index, entry.subindex)) == pytest.approx(
        wanted
    )
    (change,) = changes
    assert change.startswith(f"{NAME}: {entry.title} was {SAVED[entry]:g}, set to ")


def test_every_object_that_is_set_is_among_them():
    known = {entry for entry, _ in (*guards(SETTINGS, AXIS), *parameters(SETTINGS, AXIS))}
    assert known - set(SAVED) == {od.GEAR_SHAFT, od.INTERPOLATION_EXPONENT}


def test_the_right_values_in_numbers():
    """In the drive's units: 39 114 counts a radian, 16 A, per mille."""
    segment, _ = set_up(SAVED)

    def number(index, subindex, code):
        return struct.unpack(code, segment.sdo_read(AXIS, index, subindex))[0]

    lower, upper = ROBOT.joint_lower[AXIS] - 0.05, ROBOT.joint_upper[AXIS] + 0.05
    window = ROBOT.drive.following_error_window
    assert number(0x607E, 0, "<B") == 0
    assert number(0x607D, 1, "<i") == pytest.approx((lower - window) * COUNTS, abs=1)
    assert number(0x607D, 2, "<i") == pytest.approx((upper + window) * COUNTS, abs=1)
    speed = 2 * ROBOT.joint_velocity_limit[AXIS] * COUNTS
    assert number(0x6080, 0, "<I") == pytest.approx(speed, abs=1)
    assert number(0x6075, 0, "<I") == 16000
    assert number(0x60B0, 0, "<i") == number(0x60B1, 0, "<i") == 0
    assert (number(0x607B, 1, "<i"), number(0x607B, 2, "<i")) == (-(2**31), 2**31 - 1)


@pytest.mark.parametrize(
    ("count", "saved", "words"),
    [
        (od.RX_COUNT, (0x1602, 0x160B), "mappings (0x1C12) was 0x1602 0x160B, set to 0x1605"),
        (od.TX_COUNT, (), "input mappings (0x1C13) was empty, set to 0x1A03"),
        (
            od.mapped_count(0x1605),
            mapped(0x1605)[1:],
            "mapped by 0x1605 (0x1605) was 0x60FF0020 0x60710010 0x60720010",
        ),
    ],
)
def test_mappings_of_others_are_replaced(count, saved, words):
    segment, changes = set_up({count: saved})
    (change,) = changes
    assert change.startswith(f"{NAME}: ") and words in change
    segment.bring_to(AlState.OP)
    assert segment.al_states()[AXIS].status == AlState.OP


def test_a_drive_that_nobody_has_set_up_tells_the_same_of_all():
    segment = SimulatedSegment(ROBOT)
    master = Master(segment, SETTINGS, ROBOT)
    master.configure()
    assert "all drives: rated (continuous) current [mA] (0x6075) was 1000, set to 16000" in (
        master.counters()["changed"].split("; ")
    )


def test_a_drive_without_an_object_that_guards_is_fine(monkeypatch):
    segment = SimulatedSegment(ROBOT)
    read = segment.sdo_read

    def without_polarity(position, index, subindex=0):
        if index == od.POLARITY.index:
            raise SdoAbort(NO_OBJECT, position, index, subindex)
        return read(position, index, subindex)

    monkeypatch.setattr(segment, "sdo_read", without_polarity)
    Master(segment, SETTINGS, ROBOT).configure()


def test_a_drive_that_does_not_keep_a_value_is_refused(monkeypatch):
    segment = SimulatedSegment(ROBOT)
    monkeypatch.setattr(segment.drives[AXIS], "sdo_write", lambda index, subindex, data: None)
    segment.drives[AXIS].preset({od.RX_COUNT: (0x1605, 0x1618)})
    words = rf"{NAME}: least software position limit .* \(0x607D:1\) takes .* and holds "
    with pytest.raises(DriveError, match=words):
        Master(segment, SETTINGS, ROBOT).configure()
