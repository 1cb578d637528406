"""Markers in the scene of the page: the objects of a real server, of real messages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from husky_bringup.console import drawings as module
from husky_bringup.console.drawings import Drawings
from husky_bringup.console.server import PageServer

HALF = math.sqrt(0.5)
QUARTER = (0.0, 0.0, HALF, HALF)
"""Quarter of a turn about z, (x, y, z, w): x comes to y, y to -x."""
AT = (1.0, 2.0, 3.0)
CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (9.0, 9.0, 9.0)]
TURNED = [(1.0, 2.0, 3.0), (1.0, 3.0, 3.0), (0.0, 3.0, 3.0), (0.0, 3.0, 4.0)]
"""The corners but the last, turned by a quarter and moved to `AT`."""
ARROW, CUBE, BALL, BALLS = Marker.ARROW, Marker.CUBE, Marker.SPHERE, Marker.SPHERE_LIST
TEXT = Marker.TEXT_VIEW_FACING
STRIP, PAIRS, CUBES, ROD = Marker.LINE_STRIP, Marker.LINE_LIST, Marker.CUBE_LIST, Marker.CYLINDER
Points = Sequence[tuple[float, float, float]]


class Page(Drawings):
    """Drawings whose objects in the frame `odom` are found by their names."""

    def of(self, *markers: Marker, now: float = 0.0) -> None:
        self.take(MarkerArray(markers=list(markers)))
        self.draw(now)

    def __getitem__(self, name: str) -> Any:
        return self._scene.get_handle_by_name(f"/odom/drawn/{name}")

    def sees(self, name: str) -> bool:
        return self[name] is not None and self[name].visible


@pytest.fixture
def page(server: PageServer) -> Page:
    server.scene.reset()
    return Page(server.scene, "/{}".format, "drawn")


def marker(kind: int, number: int = 0, ns: str = "n", points: Points = (), **more: Any) -> Marker:
    made = Marker(type=kind, id=number, ns=ns, points=[Point(x=x, y=y, z=z) for x, y, z in points])
    made.header.frame_id = more.get("frame", "odom")
    made.scale.x, made.scale.y, made.scale.z = more.get("scale", (1.0, 1.0, 1.0))
    place, turn, colour = made.pose.position, made.pose.orientation, made.color
    place.x, place.y, place.z = more.get("at", (0.0, 0.0, 0.0))
    turn.x, turn.y, turn.z, turn.w = more.get("turn", (0.0, 0.0, 0.0, 1.0))
    made.text = more.get("text", "")
    colour.r, colour.g, colour.b, colour.a = more.get("colour", (1.0, 0.2, 0.0, 1.0))
    made.header.stamp.sec, made.lifetime.sec = more.get("stamp", 0), more.get("lifetime", 0)
    return made


def cube(number: int = 0, ns: str = "n", **more: Any) -> Marker:
    return marker(CUBE, number, ns, **more)


def close(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, atol=1e-6)  # they are of single precision


# What is drawn ------------------------------------------------------------------------------------
def test_an_arrow_of_two_points_goes_from_one_to_the_other_as_its_pose_turns_it(page: Page) -> None:
    ends, scale = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.5)], (0.02, 0.06, 0.1)
    page.of(marker(ARROW, points=ends, at=AT, turn=QUARTER, scale=scale))
    arrow = page["arrows_n"]
    close(arrow.points, [[AT, (1.0, 4.0, 3.5)]])
    assert arrow.colors.tolist() == [[255, 51, 0]] and arrow.visible
    close((arrow.shaft_radius, arrow.head_radius, arrow.head_length), (0.01, 0.03, 0.1))


def test_an_arrow_of_a_pose_goes_along_its_x(page: Page) -> None:
    page.of(marker(ARROW, at=AT, turn=QUARTER, scale=(2.0, 0.1, 0.1)))
    arrow = page["arrows_n"]
    close(arrow.points, [[AT, (1.0, 4.0, 3.0)]])
    assert arrow.head_radius > arrow.shaft_radius == pytest.approx(0.05)
    assert 2.0 > arrow.head_length > 0.0


def test_an_arrow_of_few_words_is_an_arrow(page: Page) -> None:
    """One without a length of its head, and one of a single point."""
    page.of(marker(ARROW, points=[AT, (0, 0, 0)], scale=(0.02, 0.06, 0.0)))
    assert page["arrows_n"].head_length > page["arrows_n"].head_radius
    page.of(marker(ARROW, 1, points=[AT]), marker(ARROW, 2, at=AT))
    assert np.isfinite(page["arrows_n"].points).all()
    close(page["arrows_n"].points[2], [AT, (2.0, 2.0, 3.0)])


def test_a_strip_goes_from_point_to_point(page: Page) -> None:
    page.of(marker(STRIP, points=CORNERS[:4], at=AT, turn=QUARTER, scale=(0.03, 0.0, 0.0)))
    lines = page["lines_n"]
    close(lines.points, [TURNED[0:2], TURNED[1:3], TURNED[2:4]])
    assert lines.colors.tolist() == [[[255, 51, 0]] * 2] * 3
    assert lines.thickness == pytest.approx(0.03) and lines.thickness_units == "world"


def test_pairs_of_points_are_lines_and_an_odd_one_is_none(page: Page) -> None:
    page.of(marker(PAIRS, points=CORNERS, at=AT, turn=QUARTER))
    close(page["lines_n"].points, [TURNED[0:2], TURNED[2:4]])


def test_each_line_of_a_namespace_has_its_colour(page: Page) -> None:
    green = (0.0, 1.0, 0.0, 0.5)
    page.of(marker(STRIP, points=CORNERS[:3]), marker(PAIRS, 1, points=CORNERS[3:], colour=green))
    close(page["lines_n"].points, [CORNERS[0:2], CORNERS[1:3], CORNERS[3:5]])
    assert page["lines_n"].colors[:, 1].tolist() == [[255, 51, 0], [255, 51, 0], [0, 255, 0]]


@pytest.mark.parametrize(
    ("kind", "family"),
    [(CUBE, "boxes"), (BALL, "balls"), (ROD, "cylinders"), (CUBES, "boxes"), (BALLS, "balls")],
)
def test_solids_are_where_pose_and_points_have_them(page: Page, kind: int, family: str) -> None:
    flat, count = (0.5, 0.25, 0.1), 2 if kind in (CUBES, BALLS) else 1
    page.of(marker(kind, points=CORNERS[:count], at=AT, turn=QUARTER, scale=flat))
    solids = page[f"{family}_n"]
    close(solids.batched_positions, TURNED[:count])
    close(solids.batched_wxyzs, [(HALF, 0.0, 0.0, HALF)] * count)
    close(solids.batched_scales, [flat] * count)
    assert solids.batched_colors.tolist() == [[255, 51, 0]] * count and solids.visible
    close((solids.vertices.min(0), solids.vertices.max(0)), [[-0.5] * 3, [0.5] * 3])  # unscaled


def test_a_text_has_its_place_and_height(page: Page) -> None:
    page.of(marker(TEXT, at=AT, turn=QUARTER, scale=(0.0, 0.0, 0.15), text="walk 1.4 kJ" * 50))
    label = page["texts_n/0"]
    close(label.position, AT)
    assert label.text == ("walk 1.4 kJ" * 50)[:100] and label.font_scene_height == 0.15
    assert (label.font_size_mode, label.anchor) == ("scene", "center-center")


def test_texts_change_and_go_as_other_markers_do(page: Page) -> None:
    """Those of a route: a new one takes the place of all of the last."""
    labels = [marker(TEXT, number, text=str(number)) for number in range(3)]
    page.of(*labels, marker(STRIP, 3, points=CORNERS[:2]))
    assert [page[f"texts_n/{n}"].text for n in range(3)] == ["0", "1", "2"]
    first = page["texts_n/0"]
    page.of(marker(TEXT, 0, text="new", at=AT))
    assert page["texts_n/0"] is first and first.text == "new"
    close(first.position, AT)
    page.show("n", False)
    page.draw(0.0)
    assert not page.sees("texts_n")
    page.show("n", True)
    page.of(Marker(action=Marker.DELETEALL), labels[1])
    assert page.sees("texts_n") and page["texts_n/0"].text == "1" and page["texts_n/1"] is None
    page.of(Marker(action=Marker.DELETEALL))
    assert page["texts_n"] is None and page["texts_n/0"] is None and page.frames() == set()


def test_a_namespace_in_another_frame_is_drawn_there(server: PageServer, page: Page) -> None:
    page.of(cube(0), cube(1, frame="world"), cube(2, "other"))
    there = server.scene.get_handle_by_name("/world/drawn/boxes_n")
    assert there is not None and there.visible and len(page["boxes_n"].batched_positions) == 1
    assert page.frames() == {"odom", "world"} and page.namespaces() == ["n", "other"]


# Changes ------------------------------------------------------------------------------------------
def test_markers_that_change_keep_their_object_until_their_count_changes(page: Page) -> None:
    page.of(cube(0), marker(CUBES, 1, points=CORNERS[:2]))
    first, large, green = page["boxes_n"], (2.0, 2.0, 2.0), (0.0, 1.0, 0.0, 1.0)
    more = {"at": AT, "turn": QUARTER, "scale": large, "colour": green}
    page.of(marker(CUBES, 1, points=CORNERS[1:3], **more))
    assert page["boxes_n"] is first
    close(first.batched_positions, [CORNERS[0], *TURNED[1:3]])
    close(first.batched_wxyzs, [(1.0, 0.0, 0.0, 0.0), *[(HALF, 0.0, 0.0, HALF)] * 2])
    close(first.batched_scales, [(1.0, 1.0, 1.0), large, large])
    assert first.batched_colors.tolist() == [[255, 51, 0], [0, 255, 0], [0, 255, 0]]
    page.of(cube(2))
    assert page["boxes_n"] is not first and len(page["boxes_n"].batched_positions) == 4


def test_a_line_or_an_arrow_may_become_thicker(page: Page) -> None:
    for scale in ((0.1, 0.2, 0.3), (0.2, 0.4, 0.6)):
        page.of(marker(STRIP, 0, points=CORNERS[:2], scale=scale))
        page.of(marker(ARROW, 1, points=CORNERS[:2], scale=scale))
        assert page["lines_n"].thickness == scale[0]
        assert page["arrows_n"].shaft_radius == scale[0] / 2


def test_a_marker_may_become_another_and_move_to_another_frame(page: Page) -> None:
    """One namespace and one number are one marker."""
    page.of(marker(ARROW))
    page.of(cube())
    assert page.sees("boxes_n") and page["arrows_n"] is None
    page.of(cube(frame="world"))
    assert page["boxes_n"] is None and page.frames() == {"world"}


def test_whatever_a_namespace_is_called_it_has_an_object_of_its_own(page: Page) -> None:
    names = ("", "markers", "a", "a/b", "a%2Fb", " ")
    for _ in range(2):
        page.of(*(cube(0, name) for name in names))
    assert page.namespaces() == sorted(names)
    assert len({drawing.handle.name for drawing in page._drawings.values()}) == len(names)
    assert all(drawing.handle.name.count("/") == 3 for drawing in page._drawings.values())


def test_of_an_object_that_changes_only_the_newest_waits_for_who_does_not_keep_up(
    server: PageServer, page: Page
) -> None:
    def change(step: int) -> None:
        page.of(marker(STRIP, points=[(0, 0, 0), (float(step), 0, 0)]), marker(ARROW, 1))
        page.of(cube(2, at=(float(step), 0, 0)))

    change(1)
    change(2)
    waiting = server._websock_server._broadcast_buffer.message_from_id
    before = len(waiting)
    for step in range(3, 100):
        change(step)
    assert 0 < len(waiting) <= before


def test_what_is_transparent_is_not_drawn(page: Page) -> None:
    clear = (1.0, 1.0, 1.0, 0.0)
    page.of(cube(0, at=AT), cube(1, colour=clear))
    close(page["boxes_n"].batched_positions, [AT])
    page.of(cube(0, colour=clear))
    assert not page.sees("boxes_n")
    page.of(cube(0))
    assert page.sees("boxes_n")


def test_a_marker_goes_when_its_time_has_run_out(page: Page) -> None:
    page.of(cube(0, stamp=10, lifetime=2), cube(1, at=AT, stamp=10, lifetime=5), now=10.0)
    page.draw(11.9)
    assert len(page["boxes_n"].batched_positions) == 2
    page.draw(12.1)
    close(page["boxes_n"].batched_positions, [AT])
    page.of(cube(1, stamp=14, lifetime=5), now=15.1)
    assert page.sees("boxes_n")
    page.draw(19.1)
    assert not page.sees("boxes_n") and page.frames() == set()


@pytest.mark.parametrize(("stamp", "lifetime"), [(0, 0), (0, 2), (10, 0)])
def test_a_marker_of_no_stamp_or_lifetime_lives_on(page: Page, stamp: int, lifetime: int) -> None:
    page.of(cube(stamp=stamp, lifetime=lifetime), now=1e9)
    assert page.sees("boxes_n") and page.frames() == {"odom"}


def test_a_marker_is_deleted_by_its_namespace_and_number(page: Page) -> None:
    page.of(cube(0), cube(1, at=AT), cube(0, "other"), marker(ARROW, 2))
    for ns, number in [("n", 0), ("n", 2), ("n", 7), ("unknown", 0)]:
        page.of(Marker(action=Marker.DELETE, ns=ns, id=number))
    close(page["boxes_n"].batched_positions, [AT])
    assert page.sees("boxes_other") and not page.sees("arrows_n")


def test_all_markers_are_deleted_and_what_follows_is_drawn(page: Page) -> None:
    page.of(cube(0, stamp=1, lifetime=1), cube(0, "other"))
    page.of(Marker(action=Marker.DELETEALL), cube(5, at=AT))
    close(page["boxes_n"].batched_positions, [AT])
    assert not page.sees("boxes_other")
    page.of(Marker(action=Marker.DELETEALL), now=9.0)
    assert not page.sees("boxes_n") and page.frames() == set()


def test_a_namespace_is_hidden_and_shown_again_as_it_is_by_then(page: Page) -> None:
    page.of(cube(), marker(ARROW, 1), cube(0, "other"))
    for shown in (False, True):
        page.show("n", shown)
        page.of(cube(at=AT))
        assert page.sees("boxes_n") == page.sees("arrows_n") == shown
        assert page.sees("boxes_other")
    close(page["boxes_n"].batched_positions, [AT])


# What is not drawn --------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", [Marker.POINTS, Marker.TRIANGLE_LIST, Marker.MESH_RESOURCE, -1])
def test_a_kind_that_is_not_drawn_is_told_and_the_others_are_drawn(page: Page, kind: int) -> None:
    page.of(marker(kind, 0), cube(1))
    assert page.skipped == {f"markers of type {kind}"} and page.sees("boxes_n")


def test_no_more_is_drawn_than_is_allowed(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_GROUPS", 2)
    monkeypatch.setattr(module, "_MOST_MARKERS", 3)
    page.of(*map(cube, range(3)), cube(0, "b"))
    assert page.skipped == set()
    page.of(cube(0, "c"), cube(1, "b"))
    assert page["boxes_c"] is None and len(page["boxes_b"].batched_positions) == 2
    assert page.skipped == {"more than 2 namespaces"} and page.namespaces() == ["b", "n"]
    page.of(Marker(action=Marker.DELETE, ns="b", id=1), Marker(action=Marker.DELETE, ns="b", id=0))
    page.of(cube(0, "c"))
    assert page.sees("boxes_c"), "one that is empty does not count"
    page.of(cube(3), cube(2, at=AT))
    close(page["boxes_n"].batched_positions, [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), AT])
    assert page.skipped == {"more than 2 namespaces", "more than 3 markers of n"}


@pytest.mark.parametrize(
    ("kind", "count"), [(STRIP, 0), (STRIP, 1), (PAIRS, 0), (PAIRS, 1), (CUBES, 0), (BALLS, 0)]
)
def test_markers_of_too_few_points_are_nothing(page: Page, kind: int, count: int) -> None:
    page.of(marker(kind, 0, points=CORNERS[:count]), cube(0, "other"))
    name = {CUBES: "boxes_n", BALLS: "balls_n"}.get(kind, "lines_n")
    assert page.sees("boxes_other") and page[name] is None
    page.of(marker(kind, 1, points=CORNERS[:2]))
    assert page.sees(name)


def test_a_quaternion_of_zeros_is_no_turn(page: Page) -> None:
    for number, kind in enumerate((ARROW, STRIP, CUBES)):
        page.of(marker(kind, number, points=CORNERS[:2], at=AT, turn=(0.0, 0.0, 0.0, 0.0)))
    ends = page["arrows_n"].points[0], page["lines_n"].points[0], page["boxes_n"].batched_positions
    close(ends, [[AT, (2.0, 2.0, 3.0)]] * 3)
    close(page["boxes_n"].batched_wxyzs, [(1.0, 0.0, 0.0, 0.0)] * 2)
