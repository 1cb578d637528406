"""Parameters on the page: a real server, a client that speaks viser's protocol, made-up nodes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from gate_bench import until
from parameters_bench import HEIGHT, WALKER, Bench, Say, Source, browser, event, parameter
from rcl_interfaces.msg import ParameterType, ParameterValue

from husky_bringup.console.parameter_inputs import label_of
from husky_bringup.console.server import PageServer


@pytest.fixture(scope="module")
def say(server: PageServer) -> Iterator[Say]:
    with browser(server) as say:
        yield say


@pytest.fixture
def source() -> Source:
    return Source()


@pytest.fixture
def bench(server: PageServer, say: Say, source: Source) -> Iterator[Bench]:
    source.found.pop("/other")
    bench = Bench(server, say, source)
    bench.until(lambda: len(bench.panel._inputs) == len(WALKER))
    bench.settle()
    yield bench
    source.may_write.set()
    source.may_describe.set()
    bench.panel.close()
    until(lambda: not bench.panel._worker._waiting)


# What is shown --------------------------------------------------------------------------------
def test_an_input_for_each_parameter_by_its_type(bench: Bench) -> None:
    kinds = {name: each._kind for name, each in bench.panel._inputs.items()}
    assert kinds == {
        HEIGHT: "slider",
        "gait.trot.steps": "slider",
        "gait.walk.height": "slider",
        "free": "number",
        "on": "checkbox",
        "robot": "text",
        "sensing": "dropdown",
        "frame": "text",
        "legs": "list",
        "gains": "list",
        "blob": "fixed",
        "unset": "fixed",
    }
    slider, steps = (bench.panel._inputs[n]._handle for n in (HEIGHT, "gait.trot.steps"))
    assert (slider.min, slider.max, slider.value) == (0.1, 0.6, 0.4)
    assert (steps.min, steps.max, steps.step, steps.precision) == (1, 20, 1, 0)
    assert bench.panel._inputs["sensing"]._handle.options == ("ideal", "noisy")
    assert bench.shown("legs") == '["a", "b"]' and bench.shown("unset") == "not set"
    disabled = {n for n, each in bench.panel._inputs.items() if each._handle.disabled}
    assert disabled == {"robot", "blob", "unset"}
    assert bench.state() == "12 of 12 parameters"


def test_labels_have_units_and_hints_have_ranges(bench: Bench) -> None:
    hints = {n: each._handle.hint for n, each in bench.panel._inputs.items()}
    assert label_of(WALKER[0]) == "height [m]"
    assert hints[HEIGHT] == "of the base; 0.1 to 0.6 m"
    assert hints["robot"] == "which it is; fixed at the start"
    assert hints["sensing"] == "one of ideal, noisy"
    assert hints["frame"] == "Enter sets it"


def test_folders_are_the_names_before_the_last_point(bench: Bench) -> None:
    assert bench.folders() == {"gait.trot": ["height [m]", "steps"], "gait.walk": ["height"]}


def test_a_pattern_chooses(bench: Bench) -> None:
    bench.give(bench.panel._names, "gait.trot.*")
    bench.until(lambda: list(bench.panel._inputs) == [HEIGHT, "gait.trot.steps"])
    assert bench.state() == "2 of 12 parameters"
    assert list(bench.folders()) == ["gait.trot"]
    registered = bench.gui._gui_input_handle_from_uuid
    # The dropdown, the button, the pattern, and two sliders.
    assert len(registered) == 5
    bench.give(bench.panel._names, "x" * 300)
    bench.until(lambda: bench.state() == "names may have 200 characters, not 300")
    assert bench.panel._inputs == {}


def test_more_than_a_hundred_are_left_out(bench: Bench) -> None:
    many = [parameter(f"p{index}", index) for index in range(130)]
    bench.source.found["/walker"] = {each.name: each for each in many}
    bench.panel._look()
    bench.until(lambda: "p0" in bench.panel._inputs)
    assert list(bench.panel._inputs) == [f"p{index}" for index in range(100)]
    assert bench.state().startswith("130 of 130 parameters; 30 of them are left out")
    bench.give(bench.panel._names, "p12*")
    bench.until(lambda: bench.state() == "11 of 130 parameters")
    assert "p129" in bench.panel._inputs


def test_another_node_is_chosen(bench: Bench) -> None:
    bench.source.found["/other"] = {"x": parameter("x", 1.0)}
    registered = bench.gui._gui_input_handle_from_uuid.values()
    (button,) = [each for each in registered if each.label == "look again"]
    bench.give(button, True)
    bench.until(lambda: "/other" in bench.panel._chooser.options)
    assert bench.panel._chooser.value == "/walker"
    bench.give(bench.panel._chooser, "/other")
    bench.until(lambda: list(bench.panel._inputs) == ["x"])
    assert bench.change_and_hear("x", 2.0) == "/other.x = 2.0"
    assert bench.source.written == [("/other.x", 2.0)]


def test_looking_again_keeps_inputs_and_shows_new_values(bench: Bench) -> None:
    before = dict(bench.panel._inputs)
    bench.source.has("/walker", "free", 9.5)
    bench.panel._look()
    bench.until(lambda: bench.shown("free") == 9.5)
    assert bench.panel._inputs == before


def test_a_node_that_has_gone_and_comes_back(bench: Bench) -> None:
    gone = bench.source.found.pop("/walker")
    bench.panel._look()
    bench.until(lambda: bench.state() == "/walker has gone")
    assert bench.panel._inputs == {} and bench.panel._chooser.value == "/walker"
    bench.source.found["/walker"] = gone
    bench.panel._look()
    bench.until(lambda: len(bench.panel._inputs) == len(WALKER))


def test_nodes_that_come_later_are_found_unasked(bench: Bench) -> None:
    """And the chosen one, once it is back; one that is there is asked nothing again."""
    bench.source.found["/other"] = {"x": parameter("x", 1.0)}
    gone = bench.source.found.pop("/walker")
    bench.panel.draw(10.0)
    bench.until(lambda: bench.state() == "/walker has gone")
    assert set(bench.panel._chooser.options) == {"/other", "/walker"}
    bench.source.found["/walker"] = gone
    bench.panel.draw(14.9)
    bench.panel.draw(20.0)
    bench.until(lambda: len(bench.panel._inputs) == len(WALKER))
    bench.source.has("/walker", "free", 9.5)
    bench.source.found["/third"] = {}
    bench.panel.draw(30.0)
    bench.until(lambda: "/third" in bench.panel._chooser.options)
    assert bench.shown("free") == 2.5


def test_a_node_that_does_not_answer(bench: Bench) -> None:
    bench.source.mute = {"/walker"}
    assert bench.change_and_hear("free", 1.0) == "/walker.free: /walker is silent"
    assert bench.shown("free") == 2.5
    bench.panel._look()
    bench.until(lambda: bench.state() == "/walker is silent")
    assert bench.panel._inputs == {}
    bench.source.mute = {"*"}
    bench.panel._look()
    bench.until(lambda: bench.state() == "nobody is there")
    bench.source.mute = set()
    bench.panel._look()
    bench.until(lambda: len(bench.panel._inputs) == len(WALKER))


def test_nothing_is_asked_in_the_thread_that_draws_or_before_it_draws(
    server: PageServer, say: Say, source: Source
) -> None:
    bench = Bench(server, say, source)
    assert source.threads == set()
    bench.until(lambda: bench.panel._chooser.options == ("/other", "/walker"))
    bench.until(lambda: bench.state() == "0 of 0 parameters")
    assert source.threads == {"worker nodes", "worker /other"}
    bench.panel.close()
    until(lambda: not bench.panel._worker._waiting)
    bench.panel.draw(0.0)


# What is set ----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        (HEIGHT, 0.5, 0.5),
        (HEIGHT, 0, 0.0),
        ("gait.trot.steps", 7, 7),
        ("free", 1e6, 1e6),
        ("on", False, False),
        ("sensing", "noisy", "noisy"),
        ("frame", "world <b>", "world <b>"),
        ("legs", '["c"]', ["c"]),
        ("gains", "[1e-3, 2]", [1e-3, 2]),
    ],
)
def test_a_value_is_set(bench: Bench, name: str, given: Any, value: Any) -> None:
    said = bench.change_and_hear(name, given)
    assert bench.source.written == [(f"/walker.{name}", value)]
    assert type(bench.source.written[0][1]) is type(value)
    assert said.startswith(f"/walker.{name} = ") and "<" not in said


def test_what_is_typed_is_sent_by_enter(bench: Bench) -> None:
    for text in ("w", "wo", "world"):
        bench.give(bench.panel._inputs["frame"]._handle, text)
    bench.until(lambda: bench.shown("frame") == "world")
    assert bench.source.written == []
    assert bench.change_and_hear("frame", "world") == "/walker.frame = world"
    assert bench.source.written == [("/walker.frame", "world")]


def test_a_value_that_is_refused_goes_back(bench: Bench) -> None:
    bench.source.refusals["0.5"] = "not while it walks"
    assert bench.change_and_hear(HEIGHT, 0.5) == f"/walker.{HEIGHT}: not while it walks"
    assert bench.shown(HEIGHT) == 0.4


def test_what_the_node_makes_of_a_value_is_shown(bench: Bench) -> None:
    bench.source.may_write.clear()
    bench.change(HEIGHT, 0.5)
    until(lambda: bench.source.written != [])
    bench.source.write = lambda values: []  # type: ignore[method-assign]
    bench.source.may_write.set()
    bench.until(lambda: bench.outcome() == f"/walker.{HEIGHT} = 0.5")
    bench.change(HEIGHT, 0.6)
    bench.until(lambda: bench.shown(HEIGHT) == 0.5)


def test_of_a_slider_that_is_dragged_the_first_and_the_newest_value_are_set(bench: Bench) -> None:
    bench.source.may_write.clear()
    bench.change(HEIGHT, 0.2)
    until(lambda: bench.source.written != [])
    bench.panel.take_event(event("/walker", gait__trot__height=0.15))
    bench.panel.draw(0.0)
    assert bench.shown(HEIGHT) == 0.2
    for value in (0.21, 0.22, 0.23, 0.24, 0.25):
        bench.change(HEIGHT, value)
    bench.until(lambda: bench.shown(HEIGHT) == 0.25)
    bench.source.has("/walker", HEIGHT, 0.55)
    bench.panel.take_event(event("/walker", gait__trot__height=0.55))
    bench.panel.draw(0.0)
    assert bench.shown(HEIGHT) == 0.25, "it stays under the mouse"
    bench.source.may_write.set()
    bench.settle()
    name = f"/walker.{HEIGHT}"
    assert bench.source.written == [(name, 0.2), (name, 0.25)]
    assert bench.shown(HEIGHT) == 0.25 and bench.outcome() == f"{name} = 0.25"


def test_an_answer_that_is_older_than_what_a_browser_sends_is_not_shown(bench: Bench) -> None:
    bench.source.may_describe.clear()
    bench.panel._look()
    bench.until(lambda: "/walker" in bench.panel._worker._under_way)
    bench.source.may_write.clear()
    bench.change(HEIGHT, 0.2)
    bench.until(lambda: bench.panel._is_busy(HEIGHT))
    bench.source.may_describe.set()
    until(lambda: bench.source.written != [])
    bench.panel.draw(0.0)
    assert bench.shown(HEIGHT) == 0.2
    bench.source.may_write.set()
    bench.settle()
    assert bench.shown(HEIGHT) == 0.2


def test_writes_of_other_parameters_wait_their_turn(bench: Bench) -> None:
    bench.source.may_write.clear()
    for name, value in ((HEIGHT, 0.2), ("on", False), ("sensing", "noisy")):
        bench.change(name, value)
    bench.until(lambda: bench.panel._is_busy("sensing"))
    bench.source.may_write.set()
    bench.settle()
    assert [name for name, _ in bench.source.written] == [
        f"/walker.{HEIGHT}",
        "/walker.on",
        "/walker.sensing",
    ]


def test_a_node_that_hangs_holds_up_no_other(bench: Bench) -> None:
    bench.source.may_write.clear()
    bench.change("free", 1.0)
    until(lambda: bench.source.written != [])
    bench.source.quick = {"/other"}
    bench.source.found["/other"] = {"x": parameter("x", 1.0)}
    bench.panel._look()
    bench.until(lambda: "/other" in bench.panel._chooser.options)
    bench.give(bench.panel._chooser, "/other")
    bench.until(lambda: list(bench.panel._inputs) == ["x"])
    assert bench.change_and_hear("x", 2.0) == "/other.x = 2.0"
    bench.panel._outcome.content = ""
    bench.source.may_write.set()
    bench.until(lambda: bench.outcome() == "/walker.free = 1.0")
    assert list(bench.panel._inputs) == ["x"]


# What changes elsewhere -----------------------------------------------------------------------
def test_a_change_elsewhere_is_shown(bench: Bench) -> None:
    bench.source.has("/walker", "free", 7.5)
    bench.panel.take_event(event("/other", free=3.5))
    bench.panel.draw(0.0)
    assert bench.shown("free") == 2.5
    bench.panel.take_event(event("/walker", free=7.5))
    bench.panel.draw(0.0)
    assert bench.shown("free") == 7.5 and bench.source.written == []
    bench.give(bench.panel._names, "f*")
    bench.until(lambda: list(bench.panel._inputs) == ["free", "frame"])
    assert bench.shown("free") == 7.5


@pytest.mark.parametrize("while_it_is_set", [True, False])
def test_a_change_after_the_node_has_been_read_is_shown(
    bench: Bench, while_it_is_set: bool
) -> None:
    before = bench.source.described
    bench.source.may_describe.clear()
    if while_it_is_set:
        bench.change("free", 5.0)
    else:
        bench.panel._look()
    bench.until(lambda: bench.source.described > before)
    bench.source.has("/walker", "free", 7.5)
    bench.panel.take_event(event("/walker", free=7.5))
    bench.panel.draw(0.0)
    bench.source.may_describe.set()
    bench.settle()
    assert bench.shown("free") == 7.5


def test_a_word_that_is_none_of_those_allowed_is_shown_all_the_same(bench: Bench) -> None:
    told = event("/walker", sensing=0.0)
    told.changed_parameters[0].value = ParameterValue(
        type=ParameterType.PARAMETER_STRING, string_value="odd"
    )
    bench.panel.take_event(told)
    bench.panel.draw(0.0)
    assert bench.shown("sensing") == "odd"
    assert bench.panel._inputs["sensing"]._handle.options == ("ideal", "noisy", "odd")


def test_a_change_whose_type_is_another_asks_the_node(bench: Bench) -> None:
    bench.source.has("/walker", "frame", 1.5)
    bench.panel.take_event(event("/walker", frame=1.5))
    bench.until(lambda: bench.panel._inputs["frame"]._kind == "number")
    assert bench.shown("frame") == 1.5


@pytest.mark.parametrize("kind", ["new", "deleted"])
def test_parameters_that_come_and_go(bench: Bench, kind: str) -> None:
    if kind == "new":
        bench.source.found["/walker"]["extra"] = parameter("extra", 1.0)
    else:
        del bench.source.found["/walker"]["free"]
    expected = set(bench.source.found["/walker"])
    bench.panel.take_event(event("/walker", kind, any=1.0))
    bench.until(lambda: set(bench.panel._inputs) == expected)


def test_an_event_that_makes_no_sense(bench: Bench) -> None:
    told = event("/walker", free=1.0)
    told.changed_parameters[0].value.type = 99
    for each in (
        told,
        event("/walker", free=math.nan),
        event("/walker", gait__trot__height=math.inf),
    ):
        bench.panel.take_event(each)
        bench.settle()
    bench.source.has("/walker", HEIGHT, 0.3)
    bench.panel.take_event(event("/walker", gait__trot__height=0.3))
    bench.panel.draw(0.0)
    assert bench.shown(HEIGHT) == 0.3


# Nonsense from a browser ----------------------------------------------------------------------
NONSENSE = (
    None,
    "text",
    "nan",
    math.nan,
    math.inf,
    [],
    [[1]],
    {"a": 1},
    -1,
    2**63,
    1e300,
    b"\0\xff",
    "x" * 20_000,
    "[" * 9000,
    "9" * 6000,
    '["\\ud800"]',
    "[NaN]",
    '{"a": 1}',
    "[null]",
)


def test_nonsense_brings_nothing_down(bench: Bench) -> None:
    for name in list(bench.panel._inputs):
        for value in NONSENSE:
            bench.change(name, value)
    for value in NONSENSE:
        bench.give(bench.panel._chooser, value)
        bench.give(bench.panel._names, value)
        bench.panel.draw(0.0)
    bench.say(type="GuiFormSubmitMessage", uuid="nobody")
    bench.give(bench.panel._names, "free")  # all before it is dealt with once it has come
    bench.until(lambda: bench.panel._names.value == "free")
    bench.until(lambda: bench.panel._chooser.value == "/walker")
    bench.give(bench.panel._chooser, "/nowhere")
    bench.until(lambda: "/nowhere" in bench.outcome())
    bench.give(bench.panel._names, "*")
    bench.until(lambda: len(bench.panel._inputs) == len(WALKER))
    bench.settle()
    assert bench.panel._chooser.value == "/walker"
    assert not {"robot", "blob", "unset"} & {n.partition(".")[2] for n, _ in bench.source.written}
    assert all(value == value for _, value in bench.source.written)
    assert len(bench.browsers()) == 1
    msgspec.msgpack.encode([bench.shown(name) for name in bench.panel._inputs])  # viser does
    bench.source.found["/walker"] = {each.name: each for each in WALKER}
    bench.panel._look()
    bench.settle()
    assert bench.change_and_hear("free", 1.0) == "/walker.free = 1.0"
