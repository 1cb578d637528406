"""Markers of `visualization_msgs` in a scene: whatever nodes draw, without knowing what it is.

All markers of one namespace in one frame that are of one family (arrows, lines, solids) become one
object of the scene, so that a ground of four hundred tiles costs as much as one. Texts stay apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from viser import SceneApi
from visualization_msgs.msg import Marker, MarkerArray

from husky_description.arrays import Array
from husky_description.shapes import ORIGIN, Shape
from husky_description.triangles import triangulate

_HEAD = 1.3
"""Length of an arrow's head that says none, in its diameters."""
_LONGEST = 100
"""Letters of a text; what follows is not drawn."""

_MOST_GROUPS, _MOST_MARKERS = 200, 5000
"""Groups, and markers in one of them; more are not drawn."""

Group = tuple[str, str, str]
"""Frame, namespace, family."""


@dataclass(slots=True)
class _Drawing:
    """The markers of one group, and the object that they are."""

    markers: dict[int, Marker] = field(default_factory=dict)
    until: dict[int, float] = field(default_factory=dict)  # robot's time [s], by marker
    handle: Any = None
    form: tuple[Any, ...] = ()  # what cannot be changed of the object
    changed: bool = True

    def drop(self, number: int) -> None:
        """Forget a marker, if there is such a one."""
        self.markers.pop(number, None)
        self.until.pop(number, None)
        self.changed = True


class Drawings:
    """The markers that there are, and their objects in the scene.

    Attributes:
        skipped: what is not drawn, for reports.
    """

    def __init__(self, scene: SceneApi, path_of: Callable[[str], str], title: str):
        """Draw nothing yet.

        Args:
            scene: to draw in.
            path_of: returns the scene's name of a frame.
            title: part of the objects' names, to tell them from other drawings.
        """
        self._scene, self._path_of, self._title = scene, path_of, title
        self._drawings: dict[Group, _Drawing] = {}
        self._hidden: set[str] = set()
        self.skipped: set[str] = set()

    def namespaces(self) -> list[str]:
        """Return the namespaces that there are now, in alphabetic order."""
        return sorted({namespace for _, namespace, _ in self._drawings})

    def frames(self) -> set[str]:
        """Return the frames in which there is something drawn."""
        return {frame for frame, _, _ in self._drawings}

    def show(self, namespace: str, shown: bool) -> None:
        """Show the markers of a namespace, or hide them."""
        if shown != (namespace in self._hidden):
            return
        (self._hidden.discard if shown else self._hidden.add)(namespace)
        for _, drawing in self._of(namespace):
            drawing.changed = True

    def take(self, message: MarkerArray) -> None:
        """Take markers that are added, changed or deleted."""
        for marker in message.markers:
            if marker.action == Marker.DELETEALL:
                self.clear()
            elif marker.action == Marker.DELETE:
                for _, drawing in self._of(marker.ns):
                    drawing.drop(marker.id)
            elif marker.type in _FAMILY_OF:
                self._add(marker)
            else:
                self.skipped.add(f"markers of type {marker.type}")

    def clear(self) -> None:
        """Forget all markers."""
        for drawing in self._drawings.values():
            for number in list(drawing.markers):
                drawing.drop(number)

    def draw(self, now: float) -> None:
        """Bring the scene up to a time of the robot [s]: what has had its time goes."""
        for group, drawing in list(self._drawings.items()):
            for number in [n for n, until in drawing.until.items() if until < now]:
                drawing.drop(number)
            if drawing.changed:
                drawing.changed = False
                self._redraw(group, drawing)
            if not drawing.markers:
                if drawing.handle is not None:
                    drawing.handle.remove()
                del self._drawings[group]

    def solids(self) -> Iterator[tuple[str, Array]]:
        """Yield frame and triangles [m] (n, 3, 3) of each group of solids that is seen."""
        for (frame, _, family), drawing in self._drawings.items():
            solids = drawing.handle
            if family in _SOLIDS and solids is not None and solids.visible:
                w, *xyz = solids.batched_wxyzs.T
                turns = Rotation.from_quat(np.stack((*xyz, w), axis=1)).as_matrix()
                unit = solids.vertices[solids.faces].reshape(-1, 3)
                turned = np.einsum("nij,nkj->nki", turns, solids.batched_scales[:, None] * unit)
                yield frame, (turned + solids.batched_positions[:, None]).reshape(-1, 3, 3)

    def _of(self, namespace: str) -> list[tuple[Group, _Drawing]]:
        return [(group, each) for group, each in self._drawings.items() if group[1] == namespace]

    def _add(self, marker: Marker) -> None:
        """Take a marker, and the place of the one of its number."""
        group = marker.header.frame_id, marker.ns, _FAMILY_OF[marker.type]
        for other, drawing in self._of(marker.ns):
            if other != group and marker.id in drawing.markers:
                drawing.drop(marker.id)
        if group not in self._drawings and len(self._drawings) >= _MOST_GROUPS:
            self.skipped.add(f"more than {_MOST_GROUPS} namespaces")
            return
        drawing = self._drawings.setdefault(group, _Drawing())
        if marker.id not in drawing.markers and len(drawing.markers) >= _MOST_MARKERS:
            self.skipped.add(f"more than {_MOST_MARKERS} markers of {marker.ns}")
            return
        if marker.colors:
            self.skipped.add("colours of single points")
        stamp, lifetime = seconds(marker.header.stamp), seconds(marker.lifetime)
        drawing.markers[marker.id] = marker
        drawing.until[marker.id] = stamp + lifetime if stamp > 0.0 < lifetime else math.inf
        drawing.changed = True

    def _redraw(self, group: Group, drawing: _Drawing) -> None:
        frame, namespace, family = group
        kind = _FAMILIES[family]
        seen = [marker for marker in drawing.markers.values() if marker.color.a > 0.0]
        arrays = kind.arrays(seen) if seen and namespace not in self._hidden else {}
        count = len(next(iter(arrays.values()))) if arrays else 0
        if count == 0:
            if drawing.handle is not None:
                drawing.handle.visible = False
            return
        form = (count, *kind.common(seen[0]))
        if form != drawing.form:
            path = f"{self._path_of(frame)}/{self._title}/{family}_{quote(namespace, safe='')}"
            drawing.handle, drawing.form = kind.add(self._scene, path, arrays, *form[1:]), form
        else:
            for name, values in arrays.items():
                setattr(drawing.handle, name, values)
        drawing.handle.visible = True


def seconds(time: Any) -> float:
    """Return a stamp or a duration [s]."""
    return float(time.sec + 1e-9 * time.nanosec)


# Families -------------------------------------------------------------------------------------
Arrays = dict[str, Any]
"""Arrays of properties of an object, by name; all have an entry for each of its parts."""


@dataclass(frozen=True)
class _Family:
    """How the markers of one family become an object.

    Attributes:
        arrays: returns the properties of an object of some markers.
        common: returns the sizes that all its parts have, which are those of the first marker.
        add: adds an object of these properties and sizes under a name.
    """

    arrays: Callable[[Sequence[Marker]], Arrays]
    common: Callable[[Marker], tuple[float, ...]]
    add: Callable[..., Any]


def _arrows(markers: Sequence[Marker]) -> Arrays:
    ends = [_arrow(marker) for marker in markers]
    return {"points": _floats(ends), "colors": _colours([_rgb(marker) for marker in markers])}


def _thickness(marker: Marker) -> tuple[float, ...]:
    """Return the radii of an arrow's shaft and head, and the length of its head [m]."""
    scale = marker.scale
    if marker.points:  # diameters, and the head's length or nothing
        return scale.x / 2, scale.y / 2, scale.z or _HEAD * scale.y
    return scale.y / 2, scale.y, 2 * _HEAD * scale.y  # length, width, height


def _add_arrows(
    scene: SceneApi, path: str, arrays: Arrays, shaft: float, head: float, length: float
) -> Any:
    return scene.add_arrows(
        path, **arrays, shaft_radius=shaft, head_radius=head, head_length=length
    )


def _arrow(marker: Marker) -> Array:
    """Return both ends of an arrow: of two points, or along x of its pose."""
    if len(marker.points) >= 2:
        return _placed(marker, _points(marker)[:2])
    return _placed(marker, np.array(((0.0, 0.0, 0.0), (marker.scale.x, 0.0, 0.0))))


def _lines(markers: Sequence[Marker]) -> Arrays:
    parts = [_segments(marker) for marker in markers]
    colours = [_rgb(m) for m, part in zip(markers, parts, strict=True) for _ in part]
    both = np.repeat(_colours(colours)[:, None], 2, axis=1)  # of both ends
    return {"points": _floats(np.concatenate(parts)), "colors": both}


def _segments(marker: Marker) -> Array:
    """Return both ends of each piece of a line (n, 2, 3)."""
    points = _placed(marker, _points(marker))
    if marker.type == Marker.LINE_STRIP:
        return np.stack((points[:-1], points[1:]), axis=1)
    return points[: len(points) // 2 * 2].reshape(-1, 2, 3)


def _add_lines(scene: SceneApi, path: str, arrays: Arrays, thickness: float) -> Any:
    return scene.add_line_segments(path, **arrays, thickness=thickness)


_Label = tuple[str, Array]
"""A text, and its place in the frame [m]."""


class _Labels:
    """Texts below one object of the scene, with which they are shown, hidden and removed."""

    def __init__(self, scene: SceneApi, path: str, arrays: Arrays, height: float):
        """Draw texts of a height [m]."""
        before = scene.get_handle_by_name(path)
        if before is not None:
            before.remove()
        self._root = scene.add_frame(path, show_axes=False)
        self._labels = [
            scene.add_label(
                f"{path}/{number}",
                text,
                position=place,
                font_size_mode="scene",
                font_scene_height=height,
                anchor="center-center",
            )
            for number, (text, place) in enumerate(arrays["labels"])
        ]

    @property
    def visible(self) -> bool:
        """True if they are seen."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._root.visible = visible

    @property
    def labels(self) -> list[_Label]:
        """Texts and places; there may be as many others in their place."""
        return [(label.text, label.position) for label in self._labels]

    @labels.setter
    def labels(self, labels: Sequence[_Label]) -> None:
        for label, (text, place) in zip(self._labels, labels, strict=True):
            label.text, label.position = text, place

    def remove(self) -> None:
        """Remove them."""
        self._root.remove()


def _texts(markers: Sequence[Marker]) -> Arrays:
    places = [_placed(marker, np.zeros((1, 3)))[0] for marker in markers]
    texts = [marker.text[:_LONGEST] for marker in markers]
    return {"labels": list(zip(texts, places, strict=True))}


def _solids(markers: Sequence[Marker]) -> Arrays:
    parts = [_placed(m, _points(m) if m.type in _LISTS else np.zeros((1, 3))) for m in markers]
    each = [marker for marker, part in zip(markers, parts, strict=True) for _ in part]
    return {
        "batched_positions": _floats(np.concatenate(parts)),
        "batched_wxyzs": _floats([_turn(marker) for marker in each]),
        "batched_scales": _floats([(m.scale.x, m.scale.y, m.scale.z) for m in each]),
        "batched_colors": _colours([_rgb(marker) for marker in each]),
    }


def _solid_family(unit: Shape) -> _Family:
    """Return the family of solids of a form, which is given with its measures 1 m."""
    vertices, faces = triangulate([unit])

    def add(scene: SceneApi, path: str, arrays: Arrays) -> Any:
        # A ground that threw shadows would throw them on itself, in stripes.
        return scene.add_batched_meshes_simple(
            path, vertices, faces, **arrays, lod="off", cast_shadow=False
        )

    return _Family(_solids, lambda marker: (), add)


_FAMILIES = {
    "arrows": _Family(_arrows, _thickness, _add_arrows),
    "lines": _Family(_lines, lambda marker: (marker.scale.x,), _add_lines),
    "boxes": _solid_family(Shape("box", (1.0, 1.0, 1.0), ORIGIN, ORIGIN, "")),
    "balls": _solid_family(Shape("sphere", (0.5,), ORIGIN, ORIGIN, "")),
    "cylinders": _solid_family(Shape("cylinder", (0.5, 1.0), ORIGIN, ORIGIN, "")),
    "texts": _Family(_texts, lambda marker: (marker.scale.z,), _Labels),
}
_SOLIDS = ("boxes", "balls", "cylinders")
_FAMILY_OF = {
    Marker.ARROW: "arrows",
    Marker.LINE_STRIP: "lines",
    Marker.LINE_LIST: "lines",
    Marker.CUBE: "boxes",
    Marker.CUBE_LIST: "boxes",
    Marker.SPHERE: "balls",
    Marker.SPHERE_LIST: "balls",
    Marker.CYLINDER: "cylinders",
    Marker.TEXT_VIEW_FACING: "texts",
}
_LISTS = (Marker.CUBE_LIST, Marker.SPHERE_LIST)


# Parts of a marker ----------------------------------------------------------------------------
def _points(marker: Marker) -> Array:
    return np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3)


def _placed(marker: Marker, points: Array) -> Array:
    """Return points of a marker (n, 3) in its frame."""
    place, (w, x, y, z) = marker.pose.position, _turn(marker)
    turned = Rotation.from_quat((x, y, z, w)).apply(points)
    return np.asarray(turned + (place.x, place.y, place.z))


def _turn(marker: Marker) -> tuple[float, float, float, float]:
    """Return how a marker is turned (w, x, y, z); one that says nothing is not."""
    q = marker.pose.orientation
    norm = math.hypot(q.w, q.x, q.y, q.z)
    return (q.w / norm, q.x / norm, q.y / norm, q.z / norm) if norm > 0.0 else (1.0, 0.0, 0.0, 0.0)


def _rgb(marker: Marker) -> tuple[float, float, float]:
    return marker.color.r, marker.color.g, marker.color.b


def _colours(values: Sequence[tuple[float, float, float]]) -> NDArray[np.uint8]:
    """Return colours in bytes (n, 3)."""
    shares = np.clip(np.array(values).reshape(-1, 3), 0.0, 1.0)
    return np.asarray(np.round(255.0 * shares), dtype=np.uint8)


def _floats(values: ArrayLike) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32)
