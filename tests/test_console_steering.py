"""Operators at the process `console`: what reaches the robot, and what never does."""

from __future__ import annotations

import contextlib
import json
import math
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from console_process import ConsoleBench
from node_bench import values_of
from noting_robot import NotingRobot
from operator_client import OperatorClient
from websockets.exceptions import InvalidStatus

from husky_msgs.msg import PropulsionState
from husky_runtime import graph

pytestmark = pytest.mark.graph

AHEAD = [1.0, 0.0, 0.0]
ZERO = (0.0, 0.0, 0.0)
STOPPED = {"emergency_stop", graph.DRIVES_EMERGENCY_STOP}
CUT = {"emergency_stop", graph.DRIVES_CUT}


class SteeredBench(ConsoleBench):
    """A console whose robot notes what it is asked for."""

    robot: NotingRobot

    def asks(self, what: str, value: str, *calls: str) -> None:
        """An operator presses a button: the robot is asked for this, and nothing else."""
        operator = self.operator()
        self.robot.calls.clear()
        operator.ask(what, value)
        self.wait(lambda: len(self.robot.calls) >= len(calls), f"{calls} after {value}")
        assert self.robot.calls == list(calls)

    @contextlib.contextmanager
    def driven(
        self, operator: OperatorClient, velocity: tuple[float, float, float], **held: Any
    ) -> Iterator[threading.Thread]:
        """An operator holds something, and the robot follows.

        Where the machine is so slow that his words come too late, he lets go and holds it anew.
        """
        while True:
            with operator.holding(**held) as saying:
                self.robot.velocities.clear()
                late = len(self.reports) + 60
                self.wait(
                    lambda late=late: velocity in self.robot.velocities or len(self.reports) > late,
                    "a velocity",
                )
                if velocity in self.robot.velocities:
                    yield saying
                    return

    def begin_anew(self) -> None:
        """Let the clients go; what they have asked for is over then, too."""
        super().begin_anew()
        if self.process is not None and self.process.poll() is None:
            self.wait_for_report(lambda each: values_of(each)["operators"] == "0", "their end")

    def follows(self, velocity: tuple[float, float, float]) -> None:
        """The robot is sent this velocity, from now on."""
        self.robot.velocities.clear()
        self.wait(lambda: self.robot.velocities[-3:] == [velocity] * 3, f"{velocity} three times")

    def is_left_alone(self) -> None:
        """The robot is sent zero for a moment, then nothing any more."""
        self.robot.velocities.clear()
        count = len(self.reports)
        self.wait(lambda: len(self.reports) > count + 25, "25 reports")
        assert self.robot.velocities.count(ZERO) == len(self.robot.velocities) < 20


@pytest.fixture(scope="module")
def console_of_module(
    domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[SteeredBench]:
    console = SteeredBench(domain, tmp_path_factory.mktemp("steering"))
    console.robot = NotingRobot(console.node)
    yield console
    console.close()


@pytest.fixture
def console(console_of_module: SteeredBench) -> Iterator[SteeredBench]:
    console = console_of_module
    console.serve(connections=20)
    console.robot.state.mode, console.robot.drives.operational = "stand", True
    console.robot.calls.clear()
    yield console
    console.begin_anew()


# The page ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("path", "kind", "part"),
    [
        ("/", "text/html", 'src="/view/"'),
        ("/operator.js", "text/javascript", "WebSocket"),
        ("/operator.css", "text/css", "#stop"),
        ("/view/", "text/html", "viser"),
    ],
)
def test_the_page_has_its_parts(console: SteeredBench, path: str, kind: str, part: str) -> None:
    with urllib.request.urlopen(console.address + path) as answer:
        assert answer.headers.get_content_type() == kind
        assert part.encode() in answer.read()


@pytest.mark.parametrize("path", ["/no", "/../setup.py", "/operator.js/", "//"])
def test_there_is_nothing_else(console: SteeredBench, path: str) -> None:
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(console.address + path)


def test_no_page_of_others_has_it_in_a_frame(console: SteeredBench) -> None:
    with urllib.request.urlopen(console.address) as answer:
        assert "frame-ancestors 'self'" in answer.headers["Content-Security-Policy"]


def test_an_operator_is_told_how_things_stand(console: SteeredBench) -> None:
    operator, robot = console.operator(), console.robot
    robot.state.reason = "stand requested"
    console.wait(lambda: operator.robot.get("why") == "stand requested", "the mode")
    console.wait(lambda: operator.robot.get("modes"), "the table")
    told = operator.robot
    assert told["kind"] == "standing" and "reset simulation" in str(told["actions"])
    assert told["mode"] == "stand" and told["gait"] == "trot" and told["drives"] == "enabled"
    assert [mode["name"] for mode in told["modes"] if mode["possible"]] == ["walk", "sit"]
    assert told["gaits"] == ["trot", "crawl"] and "fans" not in told
    robot.state.mode, robot.fans = "walk", PropulsionState(connected=True, mode="OFFBOARD")
    console.wait(lambda: operator.robot.get("fans") == "disarmed, OFFBOARD", "the fans")
    console.wait(lambda: operator.robot["mode"] == "walk", "the next mode")
    assert [each["name"] for each in operator.robot["modes"] if each["possible"]] == ["stand"]
    robot.fans = None


# Buttons ----------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("what", "value", "calls"),
    [
        ("action", "right itself", ["righting"]),
        ("mode", "no such mode", ["no such mode"]),  # the controller refuses it
        ("gait", "crawl", ["gait crawl"]),
        ("drives", "enable", [graph.DRIVES_ENABLE]),
        ("drives", "disable", [graph.DRIVES_DISABLE]),
        ("drives", "reset faults", [graph.DRIVES_RESET_FAULTS]),
        ("fans", "arm", ["arm True"]),
        ("fans", "disarm", ["arm False"]),
        ("fans", "kill", [graph.PROPULSION_KILL]),
        ("flight mode", "OFFBOARD", ["OFFBOARD"]),
        ("action", "sit down", ["sit"]),
        ("action", "reset simulation", ["reset '' -1"]),
        ("action", "next gait", ["gait crawl"]),
    ],
)
def test_a_button_asks_the_robot(
    console: SteeredBench, what: str, value: str, calls: list[str]
) -> None:
    operator = console.operator()
    console.wait(lambda: operator.robot.get("gait") == "trot", "the gait")
    console.asks(what, value, *calls)
    console.robot.state.gait = "trot"


def test_standing_up_enables_the_drives_first(console: SteeredBench) -> None:
    console.robot.state.mode, console.robot.drives.operational = "passive", False
    operator = console.operator()
    console.wait(lambda: operator.robot.get("drives", "").startswith("not"), "the drives")
    console.asks("action", "stand up", graph.DRIVES_ENABLE, "stand_up")


def test_a_refusal_is_told_to_who_caused_it(console: SteeredBench) -> None:
    operator, other = console.operator(), console.operator()
    operator.ask("mode", "stand")
    said = "stand: refused, already in stand"
    console.wait(lambda: operator.state["said"] == said, "the reason")
    assert operator.state["refused"] and len(operator.state["at"]) == len("12:34:56")
    beat = other.state["beat"]
    console.wait(lambda: other.state["beat"] > beat + 1, "words to the other")
    assert other.state["said"] == "" and not other.state["refused"]


@pytest.mark.parametrize(("what", "value"), [("mood", "sit"), ("action", "jump"), ("", "")])
def test_what_is_not_there_is_asked_of_nobody(console: SteeredBench, what: str, value: str) -> None:
    operator = console.operator()
    operator.ask(what, value)
    said = f"there is nothing called {what} {value}"
    console.wait(lambda: operator.state["said"] == said, "that there is no such thing")
    assert console.robot.calls == []


@pytest.mark.parametrize("beat", [0, 10**9])
def test_what_was_long_under_way_is_not_done(console: SteeredBench, beat: int) -> None:
    operator = console.operator()
    word = {"type": "ask", "what": "mode", "value": "sit", "beat": beat}
    operator.send_raw(json.dumps(word))
    said = "sit: came too late, ask again"
    console.wait(lambda: operator.state["said"] == said, "that it is too late")
    assert console.robot.calls == []
    value, calls = ("cut", CUT) if beat else ("emergency stop", STOPPED)
    operator.send_raw(json.dumps(word | {"what": "action", "value": value}))
    console.wait(lambda: set(console.robot.calls) == calls, "the stop of both")


@pytest.mark.parametrize(
    ("what", "value"), [("action", "emergency stop"), ("mode", "emergency_stop")]
)
def test_an_emergency_stop_goes_to_drives_and_controller(
    console: SteeredBench, what: str, value: str
) -> None:
    operator = console.operator()
    operator.ask(what, value)
    console.wait(lambda: set(console.robot.calls) == STOPPED, "the stop of both")


def test_an_emergency_stop_that_the_drives_refuse_is_told(console: SteeredBench) -> None:
    """What the controller answers does not hide it."""
    operator = console.operator()
    console.robot.broken = {graph.DRIVES_EMERGENCY_STOP}
    try:
        operator.ask("action", "emergency stop")
        said = "EMERGENCY STOP: refused, it is broken; emergency stop: done"
        console.wait(lambda: operator.state["said"] == said, "both outcomes")
    finally:
        console.robot.broken = set()


def test_stops_go_before_what_was_asked_by_three_hundred_words(
    console: SteeredBench,
) -> None:
    """Another's words wait in his connection; those that wait at the node are forgotten."""
    flood, operator = console.operator(), console.operator()
    for _ in range(300):
        flood.ask("mode", "sit")
    operator.ask("action", "emergency stop")
    operator.ask("action", "cut")
    console.wait(lambda: set(console.robot.calls) >= STOPPED | CUT, "both stops")
    assert console.robot.calls.count("sit") < 200


def test_no_flood_displaces_a_stop_that_the_robot_has_not_taken_yet(console: SteeredBench) -> None:
    """A service keeps ten requests that it has not taken; the robot's node sleeps meanwhile."""
    flood, operator = console.operator(), console.operator()
    operator.ask("action", "emergency stop")
    operator.hears("EMERGENCY STOP ...; emergency stop ...")
    for _ in range(30):
        flood.ask("mode", "sit")
    flood.hears("sit: too much is asked at once")
    console.wait(lambda: set(console.robot.calls) >= STOPPED | {"sit"}, "the stop of both")


# Velocities -------------------------------------------------------------------------------------
def test_the_robot_walks_while_a_stick_is_held(console: SteeredBench) -> None:
    operator = console.operator()
    with console.driven(operator, (0.25, 0.0, 0.0), stick=AHEAD, speed=0.5):
        console.wait(lambda: console.robot.calls == ["walk"], "walking")
        console.wait(lambda: operator.state["driver"] == "you", "that he drives")
    console.follows(ZERO)
    console.is_left_alone()


def test_who_is_lost_drives_no_longer(console: SteeredBench) -> None:
    operator, other = console.operator(), console.operator()
    with console.driven(operator, (0.5, 0.0, 0.0), keys=["w"]) as saying:
        operator.break_off()
        saying.join()
        console.follows(ZERO)
        console.is_left_alone()
    console.clients.remove(operator)
    console.wait(lambda: other.state["driver"] == "", "that nobody drives")


def test_a_page_that_is_asleep_drives_no_longer(console: SteeredBench) -> None:
    """Its words still come, but with the beat of when it fell asleep."""
    operator = console.operator()
    with console.driven(operator, (0.5, 0.0, 0.0), keys=["w"]), operator.held():
        console.follows(ZERO)
        console.is_left_alone()


def test_an_emergency_stop_bars_who_still_holds(console: SteeredBench) -> None:
    operator, other = console.operator(), console.operator()
    with console.driven(operator, (0.5, 0.0, 0.0), keys=["w"]):
        other.ask("action", "emergency stop")
        console.wait(lambda: set(console.robot.calls) >= STOPPED, "the stop of both")
        console.follows(ZERO)
        console.is_left_alone()


# Goals -----------------------------------------------------------------------------------------
def test_a_click_on_the_ground_is_a_goal_and_is_ended(console: SteeredBench) -> None:
    """By an operator, with another's picture beside; and told to him where nobody takes it."""
    page, operator, robot = console.client(), console.operator(), console.robot

    def click() -> None:
        """Press the button, then click until the console listens to the picture."""
        operator.ask("navigation", "go to")
        console.wait(lambda: operator.state["picks"], "that his click is waited for")
        console.wait(lambda: not operator.state["picks"], "the end of that", say_both)

    def say_both() -> None:
        page.say(
            type="ScenePointerMessage",
            event_type="click",
            ray_origin=(1.0, 2.0, 3.0),
            ray_direction=(0.0, 0.0, -1.0),
            screen_pos=((0.5, 0.5),),
            modifier=None,
        )
        operator.ask("navigation", "click")

    def click_in_map() -> None:
        for frame, child in (("map", graph.FRAME_ODOM), (graph.FRAME_ODOM, graph.FRAME_BASE)):
            console.move(0.0, child, frame)
        click()

    def hears(said: str) -> None:
        console.wait(lambda: operator.state["said"] == said, said)

    click()
    hears("go to: there is no navigator")
    operator.ask("navigation", "stop going")
    hears("stop going: there is no navigator")
    with robot.navigator() as goals:
        no_map = "go to: there is no transform from odom to map"
        console.wait(lambda: operator.state["said"] == no_map, no_map, click)
        console.wait(lambda: goals, "a goal", click_in_map)
        place, turn = goals[0].pose.position, goals[0].pose.orientation
        assert goals[0].header.frame_id == "map" and (place.x, place.y) == (1.0, 2.0)
        assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(math.atan2(2.0, 1.0))
        hears("going to 1.00, 2.00 m in map, heading 63 deg ...")
        for said in ("stop going: done", "stop going: no action is under way"):
            operator.ask("navigation", "stop going")
            hears(said)
        assert robot.calls == ["cancel", "cancel"]


# Nobody brings it down --------------------------------------------------------------------------
@pytest.mark.parametrize(
    "nonsense", ["", "text", b"\xff" * 100, "[" * 4000, "{}", '{"type": "hold"}', '{"beat": 1}']
)
def test_what_is_no_word_ends_that_connection(console: SteeredBench, nonsense: str | bytes) -> None:
    refused = console.value("refused_from_operators")
    operator = console.operator()
    operator.send_raw(nonsense)
    console.wait(lambda: operator.closed, "the end")
    assert operator.code == 1008 and operator.reason
    console.wait_for_report(
        lambda each: values_of(each)["refused_from_operators"] == str(refused + 1), "counted"
    )
    console.asks("mode", "sit", "sit")


@pytest.mark.parametrize("length", [5_000, 20_000_000])
def test_what_is_too_long_ends_that_connection(console: SteeredBench, length: int) -> None:
    operator = console.operator()
    try:
        operator.send_raw("x" * length)
    except OSError:
        pass  # it is closed before all is sent
    console.wait(lambda: operator.closed, "the end")
    console.asks("mode", "sit", "sit")


def test_who_sends_without_end_holds_up_nobody(console: SteeredBench) -> None:
    flood = console.operator()
    for _ in range(300):
        flood.hold(keys=["s"])
    console.asks("mode", "sit", "sit")


def test_fifty_operators_are_served_or_refused(console: SteeredBench) -> None:
    assert console.crowd(console.operator) == (20, 30)
    console.begin_anew()
    console.asks("mode", "sit", "sit")


def test_pages_of_somebody_else_steer_nothing(console: SteeredBench) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        console.operator(origin="https://example.org")


def test_the_end_of_the_console_stops_the_robot(console: SteeredBench) -> None:
    with console.driven(console.operator(), (0.5, 0.0, 0.0), keys=["w"]):
        console.end()
    assert console.process is not None
    console.process = None
    console.wait(lambda: console.robot.velocities[-1] == ZERO, "zero")


@pytest.mark.slow
def test_a_token_is_asked_for_where_others_get_to(console: SteeredBench) -> None:
    console.serve(host="0.0.0.0", token="open-sesame")
    console.address = f"http://127.0.0.1:{console.address.rpartition(':')[2]}"
    with pytest.raises(InvalidStatus, match="401"):
        console.operator()
    console.operator(additional_headers={"Authorization": "Bearer open-sesame"})
