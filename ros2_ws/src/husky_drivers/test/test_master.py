"""The master against twelve ideal drives written here from the standard, tick by tick."""

import math
import re
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_description.robot import load_robot
from husky_drivers.axes import settings_of
from husky_drivers.bus import GOLD_TWITTER, AlState, Emergency, Identity, SdoAbort
from husky_drivers.commissioning import DriveError
from husky_drivers.master import Master
from husky_drivers.phases import Phase

ROBOT = load_robot()
SETTINGS = settings_of(ROBOT)
COUNTS = 8192 * 30 / (2 * math.pi)
TORQUE_PER_AMPERE = 0.0218 * 30 * 0.7
RATED = ROBOT.drive.continuous_current
STAND = ROBOT.stand_joint_position
ZERO = np.zeros(12)
# statuswords of a Gold Twitter
DISABLED, READY, ON, ENABLED, STOPPING, FAULT = 0x0250, 0x0231, 0x0233, 0x1237, 0x0217, 0x0218
NEXT = {
    (DISABLED, 0x06): READY,
    (READY, 0x07): ON,
    (ON, 0x0F): ENABLED,
    (ENABLED, 0x02): STOPPING,
    **{(state, 0x00): DISABLED for state in (READY, ON, ENABLED, STOPPING)},
}


class IdealDrives:
    """A bus of twelve drives that obey at once, brake for `brake` frames, and can be broken."""

    slave_count = 12
    expected_working_counter = 36

    def __init__(self):
        self.words = [DISABLED] * 12
        self.previous = [0] * 12
        self.al = [int(AlState.PREOP)] * 12
        self.position = np.rint(STAND * COUNTS).astype(int)
        self.velocity = np.zeros(12, int)
        self.current = np.zeros(12, int)
        self.digital = [8] * 12
        self.deaf = set()  # do not change state
        self.away = set()  # do not take part
        self.brake = 3
        self.braking = [0] * 12
        self.frames = []
        self.objects = {}
        self.waiting = []
        self.mode_shown = None
        self.watchdogs = [None] * 12
        self.refuses = None

    def open(self):
        self.opened = True

    def close(self):
        self.opened = False

    def identity(self, position):
        return GOLD_TWITTER

    def request_state(self, state, position=None):
        for i in range(12) if position is None else (position,):
            if i not in self.away:
                self.al[i] = int(state)

    def al_status(self, position):
        return 0 if position in self.away else self.al[position]

    def al_status_code(self, position):
        return 0x001B if self.al[position] & 0x10 else 0

    def set_watchdog(self, position, seconds):
        self.watchdogs[position] = seconds

    def emergencies(self):
        waiting, self.waiting = self.waiting, []
        return waiting

    def sdo_read(self, position, index, subindex=0):
        assert index == 0x6061
        if self.mode_shown is not None:
            return struct.pack("<b", self.mode_shown)
        return struct.pack("<b", self.rows[position][5] if self.frames else 0)

    def sdo_write(self, position, index, subindex, data):
        if self.refuses == (position, index):
            raise SdoAbort(0x06090030, position, index, subindex)
        self.objects[position, index, subindex] = data

    def trip(self, axis, code):
        self.words[axis] = FAULT
        self.waiting.append(Emergency(axis, code))

    def exchange(self, outputs):
        self.rows = list(struct.iter_unpack("<iihHHbbh", bytes(outputs)))
        self.frames.append(self.rows)
        inputs = b"".join(
            struct.pack(
                "<iIiHhhI",
                self.position[i],
                self.digital[i],
                self.velocity[i],
                self.words[i],
                0,
                self.current[i],
                22200,
            )
            for i in range(12)
        )
        counter = 0
        for i in range(12):
            if i in self.away:
                continue
            counter += 3 if self.al[i] == AlState.OP else 1
            if self.al[i] == AlState.OP and i not in self.deaf:
                self.obey(i, self.rows[i][4])
        return memoryview(inputs), counter

    def obey(self, i, word):
        if self.words[i] == FAULT and word & 0x80 and not self.previous[i] & 0x80:
            self.words[i] = DISABLED
        if self.words[i] == STOPPING and word == 0x02:
            self.braking[i] += 1
            if self.braking[i] >= self.brake:
                self.words[i] = DISABLED
        elif (self.words[i], word) in NEXT:
            self.words[i], self.braking[i] = NEXT[self.words[i], word], 0
        self.previous[i] = word


class Loop:
    """A master on ideal drives, with a controller that holds the stance."""

    def __init__(self, **overrides):
        self.bus = IdealDrives()
        self.master = Master(self.bus, settings_of(ROBOT, **overrides))
        self.master.configure()
        self.master.start()
        self.command = (8, STAND, ZERO, ZERO)

    def tick(self, ticks=1, command=True):
        for _ in range(ticks):
            if command:
                assert self.master.set_command(*self.command) == ""
            self.master.exchange()

    def enable(self):
        self.tick()
        assert self.master.enable() == ""
        self.until(Phase.ENABLED, 100)

    def until(self, phase, limit, command=True):
        for ticks in range(limit):
            if self.master.phase is phase:
                return ticks
            self.tick(command=command)
        raise AssertionError(f"{phase} not within {limit} ticks: {self.master.phase}")

    @property
    def rows(self):
        return self.bus.rows


@pytest.fixture
def loop():
    return Loop()


@pytest.fixture
def enabled(loop):
    loop.enable()
    return loop


# set-up


def test_configuration_writes_what_the_settings_say():
    bus = IdealDrives()
    Master(bus, SETTINGS).configure()

    def number(index, subindex, code):
        return struct.unpack(code, bus.objects[4, index, subindex])[0]

    assert number(0x6075, 0, "<I") == round(RATED * 1000)
    assert number(0x6073, 0, "<H") == round(ROBOT.drive.peak_current / RATED * 1000)
    assert number(0x60C2, 1, "<B") * 10 ** number(0x60C2, 2, "<b") == pytest.approx(0.002)
    window = ROBOT.drive.following_error_window
    assert number(0x6065, 0, "<I") == round(window * COUNTS)
    # cascade: outer gain kp / kd in 1/s, inner gain kd in A per count/s
    assert number(0x2112, 1, "<f") == pytest.approx(300 / 4)
    assert number(0x2111, 1, "<f") == pytest.approx(4 / TORQUE_PER_AMPERE / COUNTS)
    brake = number(0x6085, 0, "<I") / COUNTS
    assert ROBOT.joint_velocity_limit[4] / brake == pytest.approx(0.05)
    assert number(0x6007, 0, "<h") == 1
    assert bus.watchdogs == [0.05] * 12
    assert bus.al == [AlState.SAFEOP] * 12


def test_configuration_names_the_drive_that_refuses():
    bus = IdealDrives()
    bus.refuses = (5, 0x6085)
    with pytest.raises(DriveError, match=r"front_right_knee: .*0x6085.*out of range"):
        Master(bus, SETTINGS).configure()


def test_configuration_counts_and_identifies(monkeypatch):
    bus = IdealDrives()
    monkeypatch.setattr(bus, "slave_count", 11, raising=False)
    with pytest.raises(DriveError, match="11 slaves on the bus, expected 12"):
        Master(bus, SETTINGS).configure()
    bus = IdealDrives()
    monkeypatch.setattr(bus, "identity", lambda position: Identity(1, 2, 3))
    with pytest.raises(DriveError, match=r"front_left_hip_frontal.*not a Gold Twitter"):
        Master(bus, SETTINGS).configure()


def test_start_names_the_drive_that_stays_behind():
    bus = IdealDrives()
    master = Master(bus, SETTINGS)
    master.configure()
    bus.away.add(3)
    with pytest.raises(DriveError, match="front_right_hip_frontal"):
        master.start()


@pytest.mark.parametrize(
    ("name", "value"), [("tick", 0.0), ("confirm_ticks", 0), ("enable_window", math.nan)]
)
def test_settings_are_checked(name, value):
    with pytest.raises(ValueError, match=name):
        settings_of(ROBOT, **{name: value})


def test_gains_are_checked_and_written_while_running(enabled):
    for kp, kd in ((-1.0, 4.0), (math.inf, 4.0), (300.0, 0.0), (300.0, math.nan)):
        with pytest.raises(ValueError, match=r"k[pd] is"):
            enabled.master.set_gains(kp, kd)
    enabled.master.set_gains(200.0, 5.0)
    assert struct.unpack("<f", enabled.bus.objects[11, 0x2112, 1])[0] == pytest.approx(40.0)


# scaling


def test_inputs_in_si(loop):
    loop.bus.position[:] = 24576  # a tenth of a joint turn
    loop.bus.velocity[:] = -8192
    loop.bus.current[:] = 500
    loop.tick()
    assert loop.master.position == pytest.approx(np.full(12, 2 * math.pi / 10))
    assert loop.master.velocity == pytest.approx(np.full(12, -2 * math.pi / 30))
    assert loop.master.effort == pytest.approx(np.full(12, 0.5 * RATED * TORQUE_PER_AMPERE))


def test_outputs_in_the_drives_units(enabled):
    effort = np.linspace(-9.9, 9.9, 12)
    velocity = np.linspace(-2.0, 2.0, 12)
    enabled.tick(3)
    enabled.command = (8, STAND, velocity, effort)
    enabled.tick()
    for i, row in enumerate(enabled.rows):
        position, speed, torque, limit, word, mode, _, offset = row
        assert position == round(STAND[i] * COUNTS)
        assert speed == pytest.approx(velocity[i] * COUNTS, abs=0.5)
        assert offset == pytest.approx(effort[i] / TORQUE_PER_AMPERE / RATED * 1e3, abs=0.5)
        assert limit == pytest.approx(10.0 / TORQUE_PER_AMPERE / RATED * 1e3, abs=0.5)
        assert (torque, word, mode) == (0, 0x0F, 8)
    enabled.command = (10, STAND, ZERO, effort)
    enabled.tick()
    assert [row[2] for row in enabled.rows] == pytest.approx(
        effort / TORQUE_PER_AMPERE / RATED * 1e3, abs=0.5
    )
    assert {(row[5], row[7]) for row in enabled.rows} == {(10, 0)}


# enabling


def test_all_are_switched_on_before_any_is_enabled(loop):
    loop.bus.deaf.add(7)
    loop.tick()
    assert loop.master.enable() == ""
    loop.tick(50)
    assert set(loop.bus.words) == {ON, DISABLED}
    loop.bus.deaf.clear()
    loop.until(Phase.ENABLED, 100)
    assert loop.master.reason == ""


def test_states_are_confirmed_for_consecutive_readings():
    for confirm in (10, 30):
        loop = Loop(confirm_ticks=confirm)
        loop.tick()
        loop.master.enable()
        # four frames until the states are seen; twelve mode readings, one a tick
        assert loop.until(Phase.ENABLED, 200) == max(confirm, 12) + confirm + 4


def test_enabling_gives_up_after_its_timeout(loop):
    loop.bus.deaf.add(7)
    loop.tick()
    loop.master.enable()
    assert loop.until(Phase.OFF, 400) == 251
    assert loop.master.reason == "not enabled: hind_left_hip_sagittal: switch on disabled"
    loop.tick(3)
    assert set(loop.bus.words) == {DISABLED}


def test_a_mode_that_is_not_shown_is_not_trusted(loop):
    loop.bus.mode_shown = 1
    loop.tick()
    loop.master.enable()
    loop.until(Phase.OFF, 400)
    assert "a drive does not show the mode" in loop.master.reason
    assert ENABLED not in loop.bus.words


def test_targets_start_where_the_joints_are(loop):
    loop.bus.position += 1500
    loop.tick()
    loop.master.enable()
    while loop.master.phase is not Phase.ENABLED:
        loop.bus.position += 1  # still moving by hand until torque comes
        at = loop.bus.position.copy()
        was_enabled = ENABLED in loop.bus.words
        loop.tick()
        if not was_enabled:
            assert np.abs([row[0] for row in loop.rows] - at).max() <= 2
        assert {(row[1], row[2], row[7]) for row in loop.rows} == {(0, 0, 0)}
    # then they close on the command at the hand-over speed
    step = SETTINGS.handover_velocity * SETTINGS.tick * COUNTS
    last = np.array([row[0] for row in loop.rows])
    for _ in range(40):
        loop.tick()
        now = np.array([row[0] for row in loop.rows])
        assert np.abs(now - last).max() <= step + 1
        last = now
    assert last == pytest.approx(np.rint(STAND * COUNTS))


def test_position_control_after_damping_starts_at_the_joint(enabled):
    enabled.tick(3)
    enabled.command = (9, STAND, ZERO, ZERO)
    enabled.bus.position -= 4000
    enabled.tick(3)
    enabled.command = (8, STAND, ZERO, ZERO)
    enabled.tick()
    step = SETTINGS.handover_velocity * SETTINGS.tick * COUNTS
    assert np.abs([row[0] for row in enabled.rows] - enabled.bus.position).max() <= step + 1


def test_what_refuses_to_enable(loop):
    bus, master = loop.bus, loop.master
    loop.tick()
    loop.tick(5, command=False)
    assert "no joint command" in master.enable()
    loop.tick()
    loop.bus.position[8] += round(0.25 * COUNTS)
    loop.tick()
    assert "hind_left_knee: target is 0.250 rad from the joint" in master.enable()
    bus.position[8] = round(STAND[8] * COUNTS)
    bus.digital[2] = 0
    loop.tick()
    assert master.enable() == "safe torque off: front_left_knee"
    bus.digital[2] = 8
    bus.trip(4, 0x7300)
    loop.tick()
    assert master.enable() == "front_right_hip_sagittal: fault (feedback)"
    bus.words[4] = DISABLED
    bus.away.add(1)
    loop.tick()
    assert "counter 33 of 36: front_left_hip_sagittal does not answer" in master.enable()
    bus.away.clear()
    loop.tick()
    assert master.enable() == ""
    assert "drives are not off" in master.enable()


# commands


def replace(values, where, value):
    changed = np.array(values)
    changed[where] = value
    return changed


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ((8, replace(STAND, 5, math.nan), ZERO, ZERO), "front_right_knee: position"),
        ((8, STAND, replace(ZERO, 0, math.inf), ZERO), "velocity .* not finite"),
        (
            (8, STAND, ZERO, replace(ZERO, 11, -10.5)),
            r"hind_right_knee: effort .* -10.5 is outside",
        ),
        ((8, replace(STAND, 2, 0.3), ZERO, ZERO), "front_left_knee: position .* outside"),
        ((9, STAND, np.full(12, 30.0), ZERO), "velocity .* 30 is outside"),
        ((1, STAND, ZERO, ZERO), "mode of operation 1 is not one of"),
        ((8, STAND[:11], ZERO, ZERO), "11 numbers of position"),
    ],
)
def test_bad_commands_are_refused_whole(enabled, command, words):
    enabled.tick(3)
    before = enabled.rows
    reason = enabled.master.set_command(*command)
    assert re.search(words, reason), reason
    assert enabled.master.refused_commands == 1
    enabled.master.exchange()
    assert enabled.rows == before


def test_refused_commands_do_not_feed_the_watchdog(enabled):
    for _ in range(6):
        enabled.master.set_command(8, np.full(12, math.nan), ZERO, ZERO)
        enabled.master.exchange()
    assert enabled.master.phase is Phase.QUICK_STOP
    assert enabled.master.reason == "no joint command"


@given(
    st.lists(st.floats(width=64, allow_nan=True, allow_infinity=True), min_size=36, max_size=36),
    st.integers(-128, 127),
)
@settings(max_examples=60)
def test_any_command_leads_to_an_answer_and_to_numbers_that_fit(values, mode):
    values = np.array(values)
    reason = RUNNING.master.set_command(mode, values[:12], values[12:24], values[24:])
    within = (
        mode in (8, 9, 10)
        and np.isfinite(values).all()
        and np.all(np.abs(values[12:24]) <= 29.7)
        and np.all(np.abs(values[24:]) <= 10.0)
        and np.all(values[:12] >= SETTINGS.position_lower)
        and np.all(values[:12] <= SETTINGS.position_upper)
    )
    assert (reason == "") == within
    RUNNING.master.exchange()


RUNNING = Loop()


# stopping


def test_silence_stops_all_drives_well_within_100_ms(enabled):
    enabled.tick(5)
    enabled.bus.brake = 10_000  # a brake that never ends
    ticks = 0
    while ENABLED in enabled.bus.words or STOPPING in enabled.bus.words:
        enabled.tick(command=False)
        ticks += 1
        words = {row[4] for row in enabled.rows}
        if ticks <= SETTINGS.command_timeout_ticks:
            assert words == ({0x0F} if ticks < SETTINGS.command_timeout_ticks else {0x02})
    assert ticks * SETTINGS.tick <= 0.08
    assert enabled.master.phase is Phase.OFF
    assert enabled.master.reason == "no joint command"


def test_drives_off_after_their_brake(enabled):
    for _ in range(100):
        enabled.tick(command=False)
        if enabled.master.phase is Phase.OFF:
            break
    assert set(enabled.bus.words) == {DISABLED}
    enabled.tick(2)
    assert {row[3] for row in enabled.rows} == {0}  # no torque is allowed either


def test_commands_that_come_back_do_not_enable(enabled):
    enabled.tick(20, command=False)
    enabled.tick(50)
    assert enabled.master.phase is Phase.OFF
    assert set(enabled.bus.words) == {DISABLED}


def test_a_few_lost_commands_are_bridged(enabled):
    enabled.tick(4)
    before = enabled.rows
    enabled.tick(4, command=False)
    enabled.tick()
    assert enabled.master.phase is Phase.ENABLED
    assert enabled.rows == before


def test_emergency_stop_is_latched(enabled):
    enabled.master.emergency_stop()
    enabled.tick()
    assert {row[4] for row in enabled.rows} == {0x02}
    enabled.until(Phase.OFF, 20)
    assert "emergency stop" in enabled.master.enable()
    assert enabled.master.emergency_stopped
    assert enabled.master.reset_faults() == ""
    enabled.until(Phase.OFF, 20)
    assert not enabled.master.emergency_stopped
    enabled.enable()


def test_emergency_stop_works_without_a_controller_and_when_off(loop):
    loop.master.emergency_stop()
    loop.tick(10, command=False)
    loop.tick()
    assert "emergency stop" in loop.master.enable()


def test_disable(enabled):
    enabled.master.disable()
    enabled.until(Phase.OFF, 20)
    assert enabled.master.reason == "disabled"


def test_restart_forgets_the_command_and_takes_torque_with_the_next_frame(enabled):
    enabled.tick(5)
    enabled.master.restart("the world has been reset")
    enabled.tick(command=False)
    assert {(row[3], row[4]) for row in enabled.rows} == {(0, 0)}
    assert enabled.master.reason == "the world has been reset"
    assert "no joint command" in enabled.master.enable()


# lost drives


def test_one_lost_drive_damps_the_others_then_stops_them(enabled):
    enabled.tick(5)
    enabled.bus.trip(5, 0x8611)
    enabled.tick(2)
    assert enabled.master.phase is Phase.DAMPING
    assert enabled.master.reason == "front_right_knee: fault (position tracking)"
    enabled.tick()
    rows = enabled.rows
    assert [row[4] for row in rows] == [0x0F] * 5 + [0x00] + [0x0F] * 6
    assert {(row[1], row[5], row[7]) for row in rows} == {(0, 9, 0)}
    ticks = enabled.until(Phase.QUICK_STOP, 400)
    assert ticks + 2 == SETTINGS.fault_damping_ticks
    enabled.until(Phase.OFF, 20)
    assert enabled.bus.words == [DISABLED] * 5 + [FAULT] + [DISABLED] * 6
    assert enabled.master.reason == "front_right_knee: fault (position tracking)"


@pytest.mark.parametrize("left_in", [DISABLED, ON])
def test_a_drive_that_falls_without_a_command_is_not_taken_back(enabled, left_in):
    enabled.tick(5)
    enabled.bus.words[3] = left_in
    enabled.tick(2)
    assert enabled.master.phase is Phase.DAMPING
    enabled.tick()
    assert enabled.rows[3][4] == 0x00
    enabled.until(Phase.OFF, 400)
    assert ENABLED not in enabled.bus.words


def test_damping_ends_when_the_controller_dies_too(enabled):
    enabled.bus.trip(5, 0x8611)
    enabled.tick(2)
    enabled.tick(6, command=False)
    assert enabled.master.phase is Phase.QUICK_STOP
    assert enabled.master.reason == "no joint command"


def test_all_drives_lost_is_off_at_once(enabled):
    enabled.bus.words = [DISABLED] * 12
    enabled.tick(3)
    assert enabled.master.phase is Phase.OFF


def test_a_drive_lost_while_enabling(loop):
    loop.tick()
    loop.master.enable()
    while ENABLED not in loop.bus.words:
        loop.tick()
    loop.bus.words[9] = DISABLED
    loop.tick(2)
    assert loop.master.phase in (Phase.QUICK_STOP, Phase.OFF)
    assert "hind_right_hip_frontal: switch on disabled" in loop.master.reason
    loop.until(Phase.OFF, 20)


# fault reset


def test_reset_is_an_edge_on_faulty_drives_only(loop):
    loop.bus.trip(5, 0x8611)
    loop.bus.deaf.add(5)
    loop.tick()
    assert loop.master.reset_faults() == ""
    words = []
    for _ in range(6):
        loop.tick()
        words.append([row[4] for row in loop.rows])
    assert {tuple(sorted(set(w))) for w in words} == {(0x00,), (0x00, 0x80)}
    assert all(w[i] == 0 for w in words for i in range(12) if i != 5)
    assert [w[5] for w in words] in ([0, 0x80] * 3, [0x80, 0] * 3)
    loop.bus.deaf.clear()
    loop.until(Phase.OFF, 30)
    assert loop.master.status()[5].error_code == 0
    loop.enable()


def test_faults_are_not_reset_unasked(loop):
    loop.bus.trip(5, 0x8611)
    loop.tick(200)
    assert loop.bus.words[5] == FAULT
    status = loop.master.status()[5]
    assert (status.error_code, status.error) == (0x8611, "position tracking")


def test_a_reset_that_does_not_help_says_so(loop):
    loop.bus.trip(5, 0x2340)
    loop.bus.deaf.add(5)
    loop.tick()
    loop.master.reset_faults()
    loop.until(Phase.OFF, 300)
    assert loop.master.reason == "not reset: front_right_knee: fault (short circuit)"


def test_reset_is_refused_while_drives_run(enabled):
    assert "drives are not off" in enabled.master.reset_faults()


# working counter


def test_inputs_of_a_short_exchange_are_not_used(enabled):
    enabled.tick(3)
    before = enabled.master.position.copy()
    enabled.bus.away.add(0)
    enabled.bus.position += 5000
    assert enabled.master.set_command(*enabled.command) == ""
    assert not enabled.master.exchange()
    assert enabled.master.position == pytest.approx(before)
    assert enabled.master.working_counter == 33
    assert enabled.master.short_cycles == 1
    enabled.bus.away.clear()
    enabled.tick()
    assert enabled.master.phase is Phase.ENABLED
    assert enabled.master.position != pytest.approx(before)


def test_short_exchanges_in_a_row_stop_all_drives(enabled):
    enabled.bus.away.add(0)
    enabled.tick(2)
    assert enabled.master.phase is Phase.ENABLED
    enabled.tick()
    assert enabled.master.phase is Phase.QUICK_STOP
    assert "front_left_hip_frontal does not answer" in enabled.master.reason
    enabled.tick()
    assert {row[4] for row in enabled.rows} == {0x02}
    # nothing is heard of the drives any more: torque is taken by the clock
    assert enabled.until(Phase.OFF, 100) < SETTINGS.quick_stop_timeout_ticks
    enabled.tick()
    assert {row[4] for row in enabled.rows} == {0x00}


def test_a_drive_that_left_op_is_brought_back_by_a_reset(enabled):
    enabled.bus.al[6] = 0x14
    enabled.bus.words[6] = DISABLED
    enabled.tick(60)
    assert "hind_left_hip_frontal left OP (process data watchdog)" in enabled.master.reason
    enabled.master.reset_faults()
    enabled.until(Phase.OFF, 50)
    enabled.enable()


# garbage


@given(st.lists(st.binary(min_size=264, max_size=264), min_size=1, max_size=6), st.integers(0, 60))
@settings(max_examples=60)
def test_garbage_from_the_drives_never_raises(frames, counter):
    loop = Loop()
    loop.enable()
    honest = loop.bus.exchange
    for data in frames:
        loop.bus.exchange = lambda outputs, data=data: (
            honest(outputs) and (memoryview(data), counter)
        )
        loop.tick()
        loop.master.status()
    loop.bus.exchange = honest
    for _ in range(500):
        loop.tick(command=False)
    assert loop.master.phase is Phase.OFF
    assert ENABLED not in loop.bus.words


def test_status_tells_what_the_drive_tells(enabled):
    enabled.bus.current[3] = -250
    enabled.bus.position[3] -= 391
    enabled.bus.digital[4] = 0
    enabled.tick(5)
    enabled.master.poll_mailbox()
    rows = enabled.master.status()
    assert [row.joint for row in rows] == list(ROBOT.joint_names)
    assert rows[3].statusword == 0x1237
    assert rows[3].state.title == "operation enabled"
    assert rows[3].current == pytest.approx(-0.25 * RATED)
    assert rows[3].bus_voltage == pytest.approx(22.2)
    assert rows[3].following_error == pytest.approx(391 / COUNTS, rel=0.01)
    assert rows[3].mode_of_operation == 8
    assert (rows[3].safe_torque_off, rows[4].safe_torque_off) == (False, True)


def test_stop_removes_torque_and_closes(enabled):
    enabled.master.stop()
    assert {row[4] for row in enabled.rows} == {0}
    assert not enabled.bus.opened
