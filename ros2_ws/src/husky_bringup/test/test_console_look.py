"""The looks of a robot out of its URDF: measures in closed form, our own robots' too."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from husky_bringup.console.description import read_description
from husky_description.robot import load_robot
from husky_description.triangles import SECTORS
from husky_description.urdf import build_urdf

INSIDE = 1.0 - math.cos(math.pi / SECTORS)
"""Of a radius, by how much the sides of a prism lie inside its cylinder at most."""
BOX, ROD, BALL = (
    '<box size="0.2 0.4 0.6"/>',
    '<cylinder radius="0.1" length="0.5"/>',
    '<sphere radius="0.3"/>',
)
GREY, RED, BLUE = (128, 128, 128, 255), (255, 0, 0, 255), (0, 51, 255, 102)


def visual(form: str, more: str = "") -> str:
    return f"<visual>{more}<geometry>{form}</geometry></visual>"


def robot(visuals: str, more: str = "") -> str:
    return f'<robot name="r">{more}<link name="empty"/><link name="l">{visuals}</link></robot>'


def link_meshes(urdf: str) -> tuple[Mapping[str, trimesh.Trimesh], Sequence[str]]:
    """The looks of links, and what is missing."""
    read = read_description(urdf)
    return read.looks, read.missing


def look(visuals: str, more: str = "") -> trimesh.Trimesh:
    """The mesh of a link that can be drawn."""
    meshes, missing = link_meshes(robot(visuals, more))
    assert list(meshes) == ["l"] and not missing
    return meshes["l"]


def half_extent(form: ElementTree.Element, turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half the bounding box of a shape that is turned: its support in each direction."""
    if form.tag == "sphere":
        return np.full(3, float(form.get("radius", "")))
    if form.tag == "box":
        size = np.array(form.get("size", "").split(), dtype=float)
        return np.asarray(np.abs(turn) @ size / 2)
    axis = turn[:, 2]
    radius, length = float(form.get("radius", "")), float(form.get("length", ""))
    return np.asarray(length / 2 * np.abs(axis) + radius * np.sqrt(np.clip(1 - axis**2, 0, 1)))


# Robots -------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["carbon", "beta"])
def test_each_link_of_our_robots_that_has_a_look_has_a_mesh_of_its_measures(name: str) -> None:
    urdf = build_urdf(load_robot(name))
    meshes, missing = link_meshes(urdf)
    links = {
        str(link.get("name")): link.findall("visual")
        for link in ElementTree.fromstring(urdf).findall("link")
        if link.find("visual") is not None
    }
    assert not missing and len(links) > 8 and set(meshes) == set(links)
    for link, visuals in links.items():
        low, high, slack = np.full(3, np.inf), np.full(3, -np.inf), 1e-9
        for each in visuals:
            origin, geometry = each.find("origin"), each.find("geometry")
            assert origin is not None and geometry is not None
            place = np.array(origin.get("xyz", "").split(), dtype=float)
            angles = np.array(origin.get("rpy", "").split(), dtype=float)
            half = half_extent(geometry[0], Rotation.from_euler("xyz", angles).as_matrix())
            low, high = np.minimum(low, place - half), np.maximum(high, place + half)
            slack = max(slack, INSIDE * float(geometry[0].get("radius", "0")))
        np.testing.assert_allclose(meshes[link].bounds, (low, high), rtol=0, atol=slack)


# Shapes -------------------------------------------------------------------------------------------
SIDES = SECTORS / 2 * math.sin(2 * math.pi / SECTORS)
"""Area of the polygon of a circle of radius 1 m [m^2]."""


@pytest.mark.parametrize(
    ("form", "half", "volume", "share"),
    [
        (BOX, (0.1, 0.2, 0.3), 0.2 * 0.4 * 0.6, 1e-9),
        (ROD, (0.1, 0.1, 0.25), SIDES * 0.1**2 * 0.5, 1e-9),
        # Inside the ball by the sines of its sides in both directions: to the second order each.
        (BALL, (0.3, 0.3, 0.3), 4 / 3 * math.pi * 0.3**3, 2 * (math.pi / SECTORS) ** 2),
    ],
)
@pytest.mark.parametrize(
    ("origin", "place", "order"),
    [
        ("", (0.0, 0.0, 0.0), (0, 1, 2)),
        ('<origin xyz="1 -2 3"/>', (1.0, -2.0, 3.0), (0, 1, 2)),
        (f'<origin rpy="{math.pi / 2} 0 0"/>', (0.0, 0.0, 0.0), (0, 2, 1)),
        # About x first, then about the fixed z: y comes to z, z to y and on to x.
        (f'<origin xyz="0 0 1" rpy="{math.pi / 2} 0 {math.pi / 2}"/>', (0.0, 0.0, 1.0), (2, 0, 1)),
    ],
)
def test_a_shape_has_its_measures_where_its_origin_says(
    form: str,
    half: tuple[float, ...],
    volume: float,
    share: float,
    origin: str,
    place: tuple[float, ...],
    order: tuple[int, ...],
) -> None:
    mesh = look(visual(form, origin))
    assert mesh.volume == pytest.approx(volume, rel=share)
    turned = np.array(half)[list(order)]
    np.testing.assert_allclose(
        mesh.bounds, (np.subtract(place, turned), np.add(place, turned)), atol=1e-9
    )


def test_a_link_of_several_shapes_is_one_mesh() -> None:
    mesh = look(visual(BOX) + visual(ROD, '<origin xyz="0 0 5"/>') + visual(BOX))
    assert mesh.volume == pytest.approx(2 * 0.048 + SIDES * 0.005)
    np.testing.assert_allclose(mesh.bounds, ((-0.1, -0.2, -0.3), (0.1, 0.2, 5.25)), atol=1e-9)


# Colours ------------------------------------------------------------------------------------------
NAMED = '<material name="red"><color rgba="1 0 0 1"/></material>'


@pytest.mark.parametrize(
    ("material", "colour"),
    [
        ("", GREY),
        ("<material/>", GREY),
        ('<material name="red"/>', RED),
        ('<material name="unknown"/>', GREY),
        ('<material name="own"><color rgba="0 0.2 1 0.4"/></material>', BLUE),
        ('<material><color rgba="7 -1 0 1"/></material>', RED),
        ('<material><color rgba="1 0 0"/></material>', GREY),
        ('<material><color rgba="red"/></material>', GREY),
        ('<material><color rgba="nan 0 0 1"/></material>', GREY),
        ("<material><color/></material>", GREY),
    ],
)
def test_a_shape_has_the_colour_of_its_material_or_grey(
    material: str, colour: tuple[int, ...]
) -> None:
    mesh = look(visual(BOX, material), NAMED)
    assert len(mesh.vertices) and (mesh.visual.vertex_colors == colour).all()


def test_shapes_of_one_link_keep_their_own_colours() -> None:
    red, far = '<material name="red"/>', '<origin xyz="0 0 9"/>'
    mesh = look(visual(BOX, red) + visual(BALL, far) + visual(ROD, red), NAMED)
    above = mesh.vertices[:, 2] > 5.0
    assert above.any() and (mesh.visual.vertex_colors[above] == GREY).all()
    assert not above.all() and (mesh.visual.vertex_colors[~above] == RED).all()


# What cannot be drawn -----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (visual('<mesh filename="package://a/b.stl"/>'), "a mesh is not drawn"),
        (visual('<capsule radius="1" length="1"/>'), "a capsule is not drawn"),
        (visual(""), "nothing is not drawn"),
        ("<visual/>", "nothing is not drawn"),
        (visual('<box size="1 1"/>'), "size of box must be 3"),
        (visual('<box size="1 1 1 1"/>'), "size of box must be 3"),
        (visual('<box size="1 -1 1"/>'), "no extent"),
        (visual('<box size="0 0 0"/>'), "no extent"),
        (visual("<box/>"), "size of box must be 3"),
        (visual('<box size="1 nan 1"/>'), "finite"),
        (visual('<box size="one 1 1"/>'), "one"),
        (visual('<cylinder radius="1"/>'), "length of cylinder must be 1"),
        (visual('<cylinder radius="inf" length="1"/>'), "finite"),
        (visual("<sphere/>"), "radius of sphere must be 1"),
        (visual('<sphere radius="-1"/>'), "no extent"),
        (visual('<cylinder radius="1 2" length="1"/>'), "radius of cylinder must be 1"),
        (visual(BOX, '<origin xyz="1 2"/>'), "xyz of origin must be 3"),
        (visual(BOX, '<origin rpy="0 0 nan"/>'), "finite"),
        (visual(BOX, '<origin xyz="0 0 z"/>'), "z"),
    ],
)
def test_what_cannot_be_drawn_is_told_and_the_rest_is_drawn(bad: str, why: str) -> None:
    meshes, missing = link_meshes(robot(bad + visual(BOX)))
    assert meshes["l"].volume == pytest.approx(0.048)
    assert len(missing) == 1 and missing[0].startswith("l: ") and why in missing[0]
    alone, missing = link_meshes(robot(bad))
    assert alone == {} and len(missing) == 1


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no XML"),
        ("husky", "no XML"),
        ("<robot>", "no XML"),
        (robot("")[:-1], "no XML"),
        ("<robot/>\0", "no XML"),
        ("<sdf/>", "<sdf>"),
        ("<mujoco><robot/></mujoco>", "<mujoco>"),
    ],
)
def test_what_is_no_urdf_is_a_value_error(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        link_meshes(text)


_WORDS = st.lists(
    st.sampled_from(["0", "1", "-2", "0.5", "nan", "inf", "-inf", "x", "1e-320", "", "0x1"]),
    max_size=4,
).map(" ".join)


@given(st.sampled_from(["box", "cylinder", "sphere"]), _WORDS, _WORDS, _WORDS, _WORDS)
def test_whatever_the_numbers_are_a_shape_is_drawn_or_told(
    form: str, size: str, radius: str, place: str, colour: str
) -> None:
    material = f'<material><color rgba="{colour}"/></material>'
    shape = f'<{form} size="{size}" radius="{radius}" length="{size}"/>'
    meshes, missing = link_meshes(robot(visual(shape, f'<origin xyz="{place}"/>{material}')))
    assert len(meshes) + len(missing) == 1
    assert all(np.isfinite(mesh.vertices).all() for mesh in meshes.values())
