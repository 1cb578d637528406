"""A robot by its description: one coloured mesh for each link of a URDF, ratings of its joints."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
import trimesh

from husky_description.shapes import Shape
from husky_description.triangles import triangulate

_GREY = (0.5, 0.5, 0.5, 1.0)
"""Colour of what has none."""

Colour = tuple[float, ...]


@dataclass(frozen=True)
class Description:
    """What a URDF says of a robot, as far as the page shows it.

    Attributes:
        name: of the robot, in words.
        looks: the visual of each link that has one, in the link's frame [m].
        ratings: the torque that each joint is rated for, where it is told [N m].
        missing: what of the looks cannot be drawn, and why.
    """

    name: str
    looks: Mapping[str, trimesh.Trimesh]
    ratings: Mapping[str, float]
    missing: Sequence[str]


def read_description(urdf: str) -> Description:
    """Read a URDF.

    Boxes, cylinders and spheres are drawn; a mesh file is not: the browser has no access to it.

    Raises:
        ValueError: it is none.
    """
    try:
        root = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise ValueError(f"the description is no XML: {error}") from error
    if root.tag != "robot":
        raise ValueError(f"the description is a <{root.tag}>, it must be a <robot>")
    colours = {
        str(material.get("name")): _rgba(material.find("color"))
        for material in root.findall("material")
        if material.find("color") is not None
    }
    looks: dict[str, trimesh.Trimesh] = {}
    missing: list[str] = []
    for link in root.findall("link"):
        by_colour: dict[Colour, list[Shape]] = {}
        for visual in link.findall("visual"):
            try:
                shape = _shape(visual)
            except ValueError as error:
                missing.append(f"{link.get('name')}: {error}")
                continue
            by_colour.setdefault(_colour(visual, colours), []).append(shape)
        if by_colour:
            parts = [_mesh(shapes, colour) for colour, shapes in by_colour.items()]
            whole: Any = trimesh.util.concatenate(parts)
            looks[str(link.get("name"))] = whole
    name = str(root.get("name", "robot")).replace("_", " ")
    return Description(name, looks, _ratings(root), missing)


def _ratings(root: ElementTree.Element) -> dict[str, float]:
    found: dict[str, float] = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        with contextlib.suppress(ValueError):
            effort = 0.0 if limit is None else _numbers(limit, "effort", 1, "0")[0]
            if effort > 0.0:
                found[str(joint.get("name"))] = effort
    return found


def _shape(visual: ElementTree.Element) -> Shape:
    """Return a visual's geometry in its link's frame.

    Raises:
        ValueError: it is none that can be drawn, or has no measures.
    """
    origin, geometry = visual.find("origin"), visual.find("geometry")
    form = geometry[0] if geometry is not None and len(geometry) else None
    if form is None or form.tag not in _SIZES:
        what = "nothing" if form is None else f"a {form.tag}"
        raise ValueError(f"{what} is not drawn, there are {', '.join(_SIZES)}")
    size: list[float] = []
    for name, count in _SIZES[form.tag].items():
        size += _numbers(form, name, count)
    if min(size) <= 0.0:
        raise ValueError(f"the {form.tag} has no extent")
    xyz, rpy = ((0.0,) * 3 if origin is None else _numbers(origin, n, 3, _ZERO) for n in _POSE)
    return Shape(form.tag, tuple(size), xyz, rpy, "")


_SIZES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}}
"""By form: attributes, and how many numbers each has."""
_POSE, _ZERO = ("xyz", "rpy"), "0 0 0"


def _numbers(
    element: ElementTree.Element, name: str, count: int, default: str = ""
) -> tuple[float, ...]:
    """Return the numbers of an attribute.

    Raises:
        ValueError: there are not so many, or one of them is none, or not finite.
    """
    found = tuple(float(word) for word in element.get(name, default).split())
    if len(found) != count or not np.all(np.isfinite(found)):
        raise ValueError(f"{name} of {element.tag} must be {count} finite numbers")
    return found


def _colour(visual: ElementTree.Element, named: dict[str, Colour]) -> Colour:
    material = visual.find("material")
    if material is None:
        return _GREY
    own = material.find("color")
    return named.get(str(material.get("name")), _GREY) if own is None else _rgba(own)


def _rgba(element: ElementTree.Element | None) -> Colour:
    """Return a colour, grey for one that is none."""
    try:
        found = _GREY if element is None else _numbers(element, "rgba", 4)
    except ValueError:
        return _GREY
    return tuple(np.clip(found, 0.0, 1.0).tolist())


def _mesh(shapes: Iterable[Shape], colour: Colour) -> trimesh.Trimesh:
    vertices, faces = triangulate(shapes)
    rgba = np.round(255 * np.array(colour)).astype(np.uint8)
    colours = np.tile(rgba, (len(vertices), 1))
    return trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False)
