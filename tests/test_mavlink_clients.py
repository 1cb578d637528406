"""Other people's MAVLink clients against the process `flight_controller`, over UDP.

Two ground stations that share no code with this project: MAVSDK (C++) and MAVProxy (on pymavlink's
own connection).
"""

import contextlib
import json
import time

import numpy as np
import pytest
from flight_bench import VOLTAGE, RunningFlightBench, free_port
from mavproxy import MavProxy
from node_bench import every, values_of

import husky_pu
from husky_description.robot import load_robot
from husky_pu.autopilot.flight_parameters import TABLE
from husky_pu.autopilot.mixer import Mixer

pytestmark = pytest.mark.graph

MIXER = Mixer(load_robot())


@pytest.fixture
def bench(domain, tmp_path):
    made = RunningFlightBench(domain, tmp_path)
    yield made
    made.close()


class Pilot:
    """Flies OFFBOARD through MAVSDK."""

    def __init__(self, bench, system):
        from mavsdk.plugins.action import Action
        from mavsdk.plugins.offboard import Offboard
        from mavsdk.plugins.telemetry import Telemetry

        self.bench = bench
        self.action, self.offboard = Action(system), Offboard(system)
        self.telemetry = Telemetry(system)

    def thrust(self, share):
        """Hold it level from now on, at 20 Hz."""
        from mavsdk.plugins.offboard import Attitude

        self.offboard.set_attitude(Attitude(0.0, 0.0, 0.0, share))

    def fly(self, share):
        """Arm, give a share of all thrust, and go on for a second."""
        bench = self.bench
        self.thrust(0.0)
        bench.wait_for_report(lambda r: int(values_of(r)["setpoints"]) > 5, "a stream")
        self.offboard.start()
        bench.wait_for_report(lambda r: values_of(r)["mode"] == "OFFBOARD", "OFFBOARD")
        self.action.arm()
        bench.wait(self.telemetry.armed, "armed")
        self.thrust(share)
        pulses = MIXER.pulses([(share - 0.01) * MIXER.max_thrust] * 4, VOLTAGE)
        bench.wait(lambda: np.mean(bench.commands[-1].pwm) > np.mean(pulses), "thrust")
        bench.advance(1.0)
        assert self.offboard.is_active()
        assert self.telemetry.armed()

    def has_ended(self):
        """Check that it is disarmed, and that nothing was wrong on the way."""
        bench = self.bench
        bench.wait(lambda: not self.telemetry.armed(), "disarmed, as told")
        values = bench.wait_for_report(lambda r: values_of(r)["armed"] == "False", "disarmed")
        assert (values["setpoints_refused"], values["frames_damaged"]) == ("0", "0")


@contextlib.contextmanager
def mavsdk_client(component, connection):
    """A client of MAVSDK 4 or later, of a kind, at a connection, and the autopilot it sees."""
    from mavsdk import ComponentType, Configuration, Mavsdk

    kind = ComponentType[component]
    with Mavsdk(Configuration.create_with_component_type(kind)) as client:
        client.add_any_connection(connection)

        def first_autopilot():
            system = client.first_autopilot(60.0)
            assert system is not None
            return system

        yield first_autopilot


def test_mavsdk_as_a_ground_station(bench):
    from mavsdk.plugins.action import ActionError
    from mavsdk.plugins.offboard import OffboardError
    from mavsdk.plugins.param import Param

    with mavsdk_client("GROUND_STATION", f"udpout://127.0.0.1:{bench.udp_port}") as autopilot:
        system = autopilot()
        parameters, pilot = Param(system), Pilot(bench, system)
        listed = parameters.get_all_params()
        names = {p.name for p in (*listed.int_params, *listed.float_params)}
        assert {"COM_OF_LOSS_T", "MC_ROLLRATE_P", "BAT1_N_CELLS"} <= names
        assert len(names) == len(listed.int_params) + len(listed.float_params) == len(TABLE)
        assert parameters.get_param_float("COM_OF_LOSS_T") == pytest.approx(1.0)
        assert parameters.get_param_int("BAT1_N_CELLS") == 6
        parameters.set_param_int("NAV_RCL_ACT", 6)
        assert parameters.get_param_int("NAV_RCL_ACT") == 6

        bench.advance(1.0)  # at rest: it may be armed as far as its sensors go
        with pytest.raises(ActionError, match="DENIED"):
            pilot.action.arm()  # neither a radio nor a stream of setpoints
        with pytest.raises(OffboardError):
            pilot.offboard.start()  # no setpoint
        pilot.fly(0.25)
        telemetry = pilot.telemetry
        assert telemetry.battery().voltage_v == pytest.approx(VOLTAGE, abs=0.3)
        assert abs(telemetry.attitude_quaternion().w) == pytest.approx(1.0, abs=0.05)  # level
        pilot.action.kill()
        pilot.has_ended()


def test_mavsdk_as_a_companion_that_is_spoken_to_first(domain, tmp_path):
    number = free_port()
    with mavsdk_client("COMPANION_COMPUTER", f"udpin://127.0.0.1:{number}") as autopilot:
        bench = RunningFlightBench(domain, tmp_path, ground_station=f"127.0.0.1:{number}")
        try:
            pilot = Pilot(bench, autopilot())
            bench.advance(1.0)
            pilot.fly(0.3)
            pilot.action.disarm()
            pilot.has_ended()
        finally:
            bench.close()


def test_mavproxy(bench, tmp_path):
    station = MavProxy(bench.udp_port, tmp_path, "link,param,arm,mode,cmdlong,ftp,log")
    say, heard = station.say, station.heard

    def stream(thrust, until, what):
        """Send setpoints at about 10 Hz until something is true."""
        bench.wait(until, what, every(0.1, lambda: say(f"attitude 1 0 0 0 {thrust}")))

    def later(seconds):
        end = bench.time_ns + round(1e9 * seconds)
        return lambda: bench.time_ns > end

    try:
        bench.wait(lambda: heard(r"Received \d\d+ parameters"), "parameters")
        say("param show COM_OF_LOSS_T")
        bench.wait(lambda: heard(r"COM_OF_LOSS_T +1\.0"), "a parameter")
        say("param set COM_OF_LOSS_T 100")
        bench.wait(lambda: heard("AP: COM_OF_LOSS_T: must be 0 to 60"), "a refusal")
        say("ftp get /parameters.json")
        bench.wait(lambda: heard(r"Wrote \d+ bytes to parameters.json"), "a file")
        say("log list")
        bench.wait(lambda: heard("No logs"), "that there are no logs")
        stream(0, later(1.5), "a stream")
        say("long DO_SET_MODE 1 6")
        stream(0, lambda: heard("Mode OFFBOARD"), "OFFBOARD")
        # By force, PX4's way; `arm throttle force` says ArduPilot's number.
        say("long COMPONENT_ARM_DISARM 1 21196")
        stream(0, lambda: heard("AP: Armed"), "armed")
        stream(0.25, later(1.0), "thrust")
        say("status SERVO_OUTPUT_RAW")
        stream(0.25, lambda: heard(r"SERVO_OUTPUT_RAW \{"), "pulses")
        pulses = heard(r"servo1_raw : (\d+)")
        assert int(pulses[1]) > 1100
        say("status BATTERY_STATUS")
        stream(0.25, lambda: heard(r"voltages : \[40\d\d, 40\d\d"), "the battery")
        say("disarm force")
        stream(0, lambda: heard("AP: Disarmed"), "disarmed")
        say("link")
        bench.wait(lambda: heard(r"link 1 OK .* 0 lost, 0\.0% loss"), "a link without losses")
        assert not heard("timed out")
    finally:
        station.close()


# One flight controller for what follows: none of it arms.
@pytest.fixture(scope="module")
def station(domain, tmp_path_factory):
    """A bench, and the autopilot that MAVSDK sees there as a ground station."""
    bench = RunningFlightBench(domain, tmp_path_factory.mktemp("station"))
    connection = f"udpout://127.0.0.1:{bench.udp_port}"
    try:
        with mavsdk_client("GROUND_STATION", connection) as autopilot:
            yield bench, autopilot()
    finally:
        bench.close()


def download(bench, ftp, place, burst):
    """Fetch a file by MAVSDK; return where it lies."""
    results = []
    place.mkdir()
    ftp.download_async(
        "/parameters.json", str(place), burst, lambda result, *_: results.append(result)
    )
    bench.wait(lambda: results and results[-1].name != "NEXT", "the file")
    assert results[-1].name == "SUCCESS"
    return place / "parameters.json"


def test_mavsdk_is_told_what_there_is(station, tmp_path):
    from mavsdk.plugins.component_metadata import ComponentMetadata
    from mavsdk.plugins.ftp import Ftp, FtpError
    from mavsdk.plugins.info import Info
    from mavsdk.plugins.telemetry import Telemetry

    bench, system = station
    version = Info(system).get_version()
    told = (
        version.flight_sw_vendor_major,
        version.flight_sw_vendor_minor,
        version.flight_sw_vendor_patch,
    )
    assert told == husky_pu.VERSION
    times, telemetry = [], Telemetry(system)
    telemetry.subscribe_unix_epoch_time(lambda microseconds, _: times.append(microseconds))
    bench.wait(lambda: times, "the time")
    assert times[-1] * 1e-6 == pytest.approx(time.time(), abs=3600.0)

    ftp = Ftp(system)
    names = {entry.name for entry in ftp.list_directory("/").entries}
    assert names == {"general.json", "parameters.json"}
    for burst in (False, True):
        local = download(bench, ftp, tmp_path / str(burst), burst)
        assert len(json.loads(local.read_text())["parameters"]) == len(TABLE)
        assert ftp.are_files_identical(str(local), "/parameters.json")
        assert not ftp.are_files_identical(str(local), "/general.json")
    with pytest.raises(FtpError, match="FILE_PROTECTED"):
        ftp.remove_file("/general.json")
    with pytest.raises(FtpError, match="FILE_DOES_NOT_EXIST"):
        ftp.list_directory("/none")

    found, metadata = {}, ComponentMetadata(system)
    metadata.subscribe_metadata_available(
        lambda update, _: found.update({update.type.name: update.json_metadata})
    )
    metadata.request_autopilot_component()
    bench.wait(lambda: "ALL_COMPLETED" in found, "the metadata")
    assert json.loads(found["PARAMETER"])["parameters"][0]["name"] == next(iter(TABLE))


def test_mavsdk_is_told_what_there_is_not(station):
    from mavsdk.plugins.log_files import LogFiles, LogFilesError
    from mavsdk.plugins.mission_raw import MissionItem, MissionRaw, MissionRawError
    from mavsdk.plugins.param import Param, ParamError, ProtocolVersion
    from mavsdk.plugins.shell import Device, Shell

    bench, system = station
    parameters = Param(system)
    with pytest.raises(ParamError, match="VALUE_OUT_OF_RANGE"):
        parameters.set_param_float("COM_OF_LOSS_T", 100.0)
    with pytest.raises(ParamError, match="DOES_NOT_EXIST"):
        parameters.set_param_float("NO_SUCH", 1.0)
    with pytest.raises(ParamError, match="DOES_NOT_EXIST"):
        parameters.get_param_float("NO_SUCH")

    with pytest.raises(LogFilesError, match="NO_LOGFILES"):
        LogFiles(system).get_entries()

    mission = MissionRaw(system)
    with pytest.raises(MissionRawError, match="UNSUPPORTED"):
        mission.upload_mission([MissionItem(0, 6, 16, 1, 1, 0.0, 0.0, 0.0, 0.0, 0, 0, 10.0, 0)])
    assert mission.download_mission() == []
    mission.clear_mission()

    said, shell = [], Shell(system)
    shell.subscribe_receive(lambda received, _: said.append(received.data))
    shell.send("help", Device.SHELL)
    bench.wait(lambda: "no shell" in "".join(said), "a word of the shell")

    # The same parameters by the extended protocol; the binding takes its answer for an error.
    with contextlib.suppress(ParamError):
        parameters.select_component(1, ProtocolVersion.EXT)
    listed = parameters.get_all_params()
    assert len(listed.int_params) + len(listed.float_params) == len(TABLE)
    parameters.set_param_float("COM_OF_LOSS_T", 0.5)
    assert parameters.get_param_float("COM_OF_LOSS_T") == 0.5
    with pytest.raises(ParamError):
        parameters.set_param_float("COM_OF_LOSS_T", 100.0)
