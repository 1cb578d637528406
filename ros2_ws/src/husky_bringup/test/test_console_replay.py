"""A bag on the page: what counts at a time of it, played and gone to in any order."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from mcap.reader import make_reader
from page_client import PageClient
from rclpy.serialization import serialize_message
from replay_bench import BEGIN, LENGTH, MAPPING, MODES, pose, read, stamp
from tf2_msgs.msg import TFMessage
from viser._messages import GuiUpdateMessage

from husky_bringup.console.__main__ import command
from husky_bringup.console.page import Page
from husky_bringup.console.player import Player
from husky_bringup.console.record import Record
from husky_bringup.console.server import PageServer
from husky_bringup.nodes import replay
from husky_bringup.nodes.replay import decode
from husky_msgs.msg import ControllerState
from husky_runtime import graph


class Seen(Player):
    """A player whose page is read."""

    def stand(self, wall_time: float) -> None:
        """Turn until everything has been drawn."""
        for _ in range(8):
            self.turn(wall_time)

    def look(self, wall_time: float) -> dict[str, Any]:
        self.stand(wall_time)
        scene = self._page._scene
        return {
            "mode": self._page._facts._rows[graph.CONTROLLER_STATE][0][1],
            "x": round(scene._tree.poses("odom").get("imu", (math.nan,))[0], 3),
            "drawn": scene._drawings.namespaces(),
            "map": [h.vertices[0, 2] for h in scene._map._handles.values() if h.visible],
            "report": self._page._reports._last["node"][0].message,
            "plotted": len(self._page._plots["speed of the base [m/s]"]._points),
        }


@pytest.fixture
def play(server: PageServer) -> Callable[[Record], Seen]:
    server.scene.reset()
    server.gui.reset()
    return lambda record: Seen(server, Page(server, ""), record, decode)


def expected(seconds: float) -> dict[str, Any]:
    """What the page shows of the bag at a time, by what the robot has told."""
    return {
        "mode": MODES[int(seconds * len(MODES) / LENGTH)],
        "x": seconds,
        "drawn": sorted(f"of_{n}" for n in range(LENGTH) if seconds - 3.0 <= n <= seconds),
        "map": [seconds // 3.0 * 3.0] if seconds >= MAPPING else [],
        "report": f"second {int(seconds)}",
        "plotted": 1 + int(min(seconds, 10.0) / 0.06 + 1e-6),  # every third message of 50 Hz
    }


# What is on the page --------------------------------------------------------------------------
def test_any_time_can_be_gone_to_in_any_order(play: Any, record: Record) -> None:
    player = play(record)
    for number, seconds in enumerate((0.0, 12.1, 4.1, 12.5, 7.1, 19.1, 18.1, 1.1)):
        player._slider.value = seconds
        seen = player.look(10.0 * number)
        assert player.time == BEGIN + seconds
        shown = expected(seconds)
        assert seen.pop("plotted") == pytest.approx(shown.pop("plotted"), abs=2), seconds
        assert seen == shown
    assert player.failures == 0


def test_playing_shows_the_same_as_going_there(play: Any, record: Record) -> None:
    player = play(record)
    player._press()
    player._speed.value = "2"
    wall = 0.0
    while player.time < BEGIN + 12.0:
        wall += 0.25
        player.turn(wall)
    assert player.time == pytest.approx(BEGIN + 2.0 * wall)
    player._press()
    at = player.time - BEGIN
    seen = player.look(wall + 100.0)
    assert player.time == BEGIN + at, "it stands"
    assert all(seen[what] == expected(at)[what] for what in ("mode", "drawn", "map"))
    assert seen["x"] == pytest.approx(at, abs=0.021)


def test_its_end_is_the_end_until_it_begins_again(play: Any, record: Record) -> None:
    player = play(record)
    player._slider.value = 19.5
    player.turn(1.0)
    player._press()
    for wall in (2.0, 2.5, 3.0, 3.5, 4.0):
        player.turn(wall)
    assert player.time == record.end and not player._plays
    player._press()
    player.turn(4.1)
    assert record.start < player.time < record.start + 0.5


def test_while_the_slider_is_moved_the_time_stands_there(play: Any, record: Record) -> None:
    player = play(record)
    player._press()
    player.turn(1.0)
    for wall, moved in ((1.1, 8.0), (1.2, 8.5), (1.3, 9.0)):
        player._slider.value = moved
        player.turn(wall)
        player.turn(wall + 0.05)
        assert player.time == BEGIN + moved
    player.turn(1.9)
    assert player.time > BEGIN + 9.0


class MovedMeanwhile:
    """A slider that a browser moves to 12 s just before the player moves it."""

    def __init__(self, server: PageServer, slider: Any):
        self._server, self._slider = server, slider

    @property
    def value(self) -> Any:
        return self._slider.value

    @value.setter
    def value(self, value: float) -> None:
        message = GuiUpdateMessage(self._slider._impl.uuid, {"value": 12.0})
        taken = self._server._take_value(0, message)
        self.told = asyncio.run_coroutine_threadsafe(taken, self._server.get_event_loop())
        with contextlib.suppress(TimeoutError):
            self.told.result(0.3)
        self._slider.value = value


@pytest.mark.parametrize("plays", [True, False])
def test_where_a_browser_moves_the_slider_is_not_lost(
    play: Any, record: Record, server: PageServer, plays: bool
) -> None:
    """It comes while the slider follows the time, or is put where there is something."""
    player = play(record)
    if plays:
        player._press()
    else:
        player._slider.value = -5.0
    slider = player._slider
    player._slider = moved = MovedMeanwhile(server, slider)
    for _ in range(6):
        player.turn(0.1)
    player._slider = slider
    moved.told.result()
    player.turn(0.2)
    assert player.time == BEGIN + 12.0


@pytest.mark.parametrize("value", [math.nan, math.inf, -5.0, 1e300])
def test_a_slider_that_is_sent_nonsense(play: Any, record: Record, value: float) -> None:
    player = play(record)
    player._slider.value = value
    player.turn(1.0)
    assert record.start <= player.time <= record.end
    player._slider.value = 12.0
    assert player.look(10.0)["mode"] == "walk"


def test_a_speed_that_is_none_counts_as_one(play: Any, record: Record) -> None:
    player = play(record)
    player._speed._impl.value = "fast"  # as a browser may set it
    player._press()
    player.turn(0.5)
    assert player.time == pytest.approx(BEGIN + 0.5)


def test_a_description_is_drawn_once(play: Any, record: Record, monkeypatch: Any) -> None:
    player = play(record)
    taken: list[str] = []
    monkeypatch.setattr(player._page, "take", lambda topic, *rest: taken.append(topic))
    for seconds in (15.0, 5.0, 10.0):
        player._slider.value = seconds
        player.turn(seconds)
    assert taken.count(graph.ROBOT_DESCRIPTION) == 1 and taken.count(graph.TF_STATIC) == 3


def test_the_robot_in_the_picture_stands_in_odom_as_soon_as_that_is_there(
    play: Any, record: Record
) -> None:
    """Its first transforms may be of its own frames alone."""
    player = play(record)
    scene = player._page._scene
    alone = TransformStamped(child_frame_id="imu")
    alone.header.frame_id = graph.FRAME_BASE
    scene.take_transforms(TFMessage(transforms=[alone]))
    scene.draw(0.0)
    assert scene._origin.value == graph.FRAME_BASE
    scene.take_transforms(pose(0.0))
    scene.draw(0.0)
    assert scene._origin.value == graph.FRAME_ODOM
    scene._origin.value = "imu"  # what somebody has chosen stays
    scene.take_transforms(TFMessage(transforms=[TransformStamped(child_frame_id="more")]))
    scene.draw(0.0)
    assert scene._origin.value == "imu"


# What it holds ---------------------------------------------------------------------------------
def test_a_page_waits_for_what_has_not_been_read(
    play: Any, walk_bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Record, "_read", lambda self: None)
    record = Record(walk_bag)
    player = play(record)
    player._slider.value = 15.0
    player.turn(1.0)
    record.read_to = BEGIN + 6.0
    player.turn(2.0)
    assert player.time == pytest.approx(BEGIN + 6.0) and player.time < BEGIN + 6.0
    player.stand(2.1)
    assert "read" in player._notes.content and "30 %" in player._notes.content
    record.read_to = math.inf
    player.turn(3.0)
    assert player.time == BEGIN + 15.0


def test_a_bag_that_is_cut_is_shown_up_to_there(walk_bag: Path, tmp_path: Path, play: Any) -> None:
    (tmp_path / "bag").mkdir()
    with (walk_bag / "bag.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        last = summary.chunk_indexes[-1]
        file.seek(0)
        cut = file.read(last.chunk_start_offset + last.chunk_length // 2)
    (tmp_path / "bag" / "bag.mcap").write_bytes(cut)
    record = read(tmp_path / "bag")
    length = record.end - BEGIN
    assert 1.0 < length < LENGTH - 1.0
    player = play(record)
    player._slider.value = round(length - 0.5, 2)
    seen = player.look(1.0)
    assert seen["x"] == pytest.approx(length - 0.5, abs=0.026)
    assert "is not whole" in player._notes.content


def test_a_message_that_is_none_is_counted(tmp_path: Path, write_bag: Any, play: Any) -> None:
    states = [
        (graph.CONTROLLER_STATE, ControllerState(stamp=stamp(t), mode="walk")) for t in (1, 2)
    ]
    bad = serialize_message(states[0][1])[:20]
    data = [(topic, serialize_message(message)) for topic, message in states]
    write_bag(tmp_path / "bag", [data[0], (graph.ODOM, bad), data[1]])
    player = play(read(tmp_path / "bag"))
    player._slider.value = 1.0
    player.stand(1.0)
    assert player.failures == 1 and "1, the last: 20 bytes are no Odom" in player._notes.content


def test_a_page_that_cannot_be_drawn_goes_on(
    play: Any, record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    player = play(record)
    with monkeypatch.context() as broken:
        broken.setattr(player._page, "draw", lambda *times: 1 / 0)
        player.turn(1.0)
    assert player.failures == 1
    player._slider.value = 12.0
    assert player.look(2.0)["mode"] == "walk" and "division" in player._notes.content


# The program ----------------------------------------------------------------------------------
def test_the_page_of_a_bag(walk_bag: Path) -> None:
    """As `scripts/console.sh` starts it: a browser sees where the robot was."""
    words = command(["--bag", walk_bag.name, "--port", "0"])
    process = subprocess.Popen(words, cwd=walk_bag.parent, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = re.fullmatch(r"the record is at (\S+)\n", process.stdout.readline())
        assert address
        page = PageClient(address[1])
        wait_for(lambda: "/scene/base_link/look" in page.nodes)
        labels = ("play", "time [s]")
        wait_for(lambda: {each.get("label") for each in page.gui.values()}.issuperset(labels))
        (slider,) = (u for u, each in page.gui.items() if each.get("label") == "time [s]")
        for nonsense in ([1, [2]], {"a": None}, "nothing", None, math.nan, 1e300):
            for uuid, each in page.gui.items():
                if each.get("label") != "play":  # whatever it is sent, it is pressed
                    page.say(type="GuiUpdateMessage", uuid=uuid, updates={"value": nonsense})
        for moved in (12.0, 3.0):
            page.say(type="GuiUpdateMessage", uuid=slider, updates={"value": moved})
            wait_for(lambda x=moved: page.positions.get("/scene/base_link", (0.0,))[0] == x)
        process.send_signal(signal.SIGINT)
        page.join()
        assert process.wait() == 128 + signal.SIGINT
    finally:
        process.kill()


def wait_for(condition: Callable[[], bool]) -> None:
    while not condition():  # the time of a test is bounded
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing"], "nothing"),
        (["."], ". is no bag: it has neither metadata.yaml nor an MCAP file"),
        (["bag", "--namespace", "/other"], "nothing of a robot in /other"),
        (["bag", "--port", "70000"], "port"),
        (["bag", "--token", "?"], "token"),
    ],
)
def test_what_cannot_be_shown_is_told_in_a_line(
    walk_bag: Path, arguments: list[str], words: str, monkeypatch: Any, capsys: Any
) -> None:
    monkeypatch.chdir(walk_bag.parent)
    monkeypatch.setattr(sys, "argv", ["replay", *arguments])
    assert replay.main() == 1
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith("error: ") and words in said.err
    assert said.err.count("\n") == 1
