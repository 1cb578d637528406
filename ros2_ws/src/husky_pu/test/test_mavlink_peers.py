"""A crowd on the flight controller's UDP port: who is served, who keeps his place."""

import pytest
from mavlink_bench import KEY, Bench, dialect, heartbeat, signed

CROWD = [("10.0.0.1", port) for port in range(400)]
SECOND = 500  # ticks


def kinds(bench, link):
    return [message.get_type() for message in bench.take(link)]


def flood(bench, ticks, each=13):
    """All of the crowd speak again and again, `each` in a tick; return the bytes they are told."""
    told = 0
    for tick in range(ticks):
        for number in range(each):
            bench.send(heartbeat(), CROWD[(tick * each + number) % len(CROWD)])
        bench.tick()
        told += sum(len(bench.autopilot.take_output(link)) for link in CROWD)
    return told


@pytest.fixture
def bench():
    """A companion that streams setpoints and a ground station at work."""
    bench = Bench()
    for step in range(2 * SECOND):
        if step % 50 == 0:
            bench.setpoint(link="companion")
        if step % SECOND == 0:
            bench.send(heartbeat(), "station")
        bench.tick()
    bench.take("companion"), bench.take("station")
    return bench


def test_a_new_ground_station_hears_at_once(bench):
    flood(bench, SECOND)
    bench.send(heartbeat(), "new")
    bench.tick(25)
    assert {"HEARTBEAT", "ATTITUDE_QUATERNION"} <= set(kinds(bench, "new"))
    assert bench.command(176, 1, 7).result == 0


def test_answers_come_though_the_place_is_gone_at_once(bench):
    """All within one look at the port."""
    flood(bench, SECOND)
    bench.send(dialect.MAVLink_timesync_message(0, 7), "new")
    for peer in CROWD[:64]:
        bench.send(heartbeat(), peer)
    assert "new" not in bench.autopilot.server.links.names
    assert "new" in bench.autopilot.server.links.addressees
    assert kinds(bench, "new") == ["TIMESYNC", "HEARTBEAT"]
    assert "new" not in bench.autopilot.server.links.addressees


def test_companion_and_station_keep_their_places(bench):
    """Though both say a word only now and then, and each of the crowd many."""
    for _ in range(3):
        bench.setpoint(link="companion")
        bench.send(heartbeat(), "station")
        flood(bench, 50)
        bench.setpoint(link="companion")
        flood(bench, 150)
        for link in ("companion", "station"):
            assert kinds(bench, link).count("ATTITUDE_QUATERNION") == pytest.approx(20, abs=1)
    assert bench.stream.contested == 0


def test_a_companion_keeps_its_place_from_its_first_setpoints_on():
    bench = Bench()
    for _ in range(4):
        bench.setpoint(link="companion")
        flood(bench, 5)
    assert "companion" in bench.autopilot.server.links.names


def test_a_crowd_costs_no_more_than_as_many_peers_as_there_are_places(bench):
    quiet = Bench()
    for peer in CROWD[:16]:
        quiet.send(heartbeat(), peer)
    quiet.tick(SECOND)
    most = sum(len(quiet.autopilot.take_output(peer)) for peer in CROWD)
    words = 13 * SECOND
    size = len(heartbeat().pack(bench.codec))
    assert flood(bench, SECOND) <= most + words * size  # a heartbeat for a heartbeat


def test_garbage_takes_nobodys_place(bench):
    for number in range(14):
        bench.send(heartbeat(), ("10.0.0.2", number))
    for peer in CROWD:
        bench.autopilot.receive(b"\xfd\x09\x00 garbage", peer)
    assert all(("10.0.0.2", number) in bench.autopilot.server.links.names for number in range(14))
    assert len(bench.autopilot.server.links.names) == 16


def test_somebody_with_our_id_takes_nobodys_place(bench):
    for number in range(14):
        bench.send(heartbeat(), ("10.0.0.2", number))
    thief = dialect.MAVLink(None, 1, 1)
    for peer in CROWD:
        bench.send(heartbeat(), peer, codec=thief)
    assert all(("10.0.0.2", number) in bench.autopilot.server.links.names for number in range(14))


def test_a_signed_frame_is_taken_once_whichever_way_it_comes():
    """One that was recorded, and arrives again on another link or an hour later on a new one."""
    now = 1.8e9  # s since 1970
    stamp = round((now - 1_420_070_400) * 1e5)
    bench = Bench(signing_key=KEY, unix_time=lambda: now)
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
    frame = arm.pack(signed(KEY, stamp))
    bench.autopilot.receive(frame, "a")
    assert bench.logic.armed
    bench.logic.disarm(force=True)
    for link in ("a", "b"):
        bench.autopilot.receive(frame, link)
        assert not bench.logic.armed, link
    old = Bench(signing_key=KEY, unix_time=lambda: now + 3600.0)
    old.autopilot.receive(frame, "a")
    assert not old.logic.armed
    assert old.autopilot.server.links.refused == 1
