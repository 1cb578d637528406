"""Where the console finds frames: against matrices of SciPy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from husky_bringup.console.frame_tree import IDENTITY, FrameTree, Pose, compose

SIZE = 14
"""Frames of a random tree."""
TOLERANCE = 1e-12
"""A dozen products of numbers around ten, rounded to double precision."""


def random_pose(rng: np.random.Generator) -> Pose:
    return (*rng.normal(0.0, 2.0, 3).tolist(), *Rotation.random(random_state=rng).as_quat())


def matrix(pose: Sequence[float]) -> NDArray[np.float64]:
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(pose[3:]).as_matrix()
    result[:3, 3] = pose[:3]
    return result


def shifted(x: float, y: float = 0.0, z: float = 0.0) -> Pose:
    return (x, y, z, 0.0, 0.0, 0.0, 1.0)


def random_tree(seed: int) -> tuple[FrameTree, list[int], list[NDArray[np.float64]]]:
    """A tree told in any order, the parent of each frame, and where each is in the root."""
    rng = np.random.default_rng(seed)
    parents = [-1, *(int(rng.integers(max(0, i - 3), i)) for i in range(1, SIZE))]
    poses = [IDENTITY, *(random_pose(rng) for _ in range(1, SIZE))]
    in_root = [np.eye(4)]
    for child in range(1, SIZE):
        in_root.append(in_root[parents[child]] @ matrix(poses[child]))
    tree = FrameTree()
    for child in rng.permutation(np.arange(1, SIZE)).tolist():
        tree.tell(f"f{parents[child]}", f"f{child}", poses[child])
    return tree, parents, in_root


def assert_same(pose: Pose, expected: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(matrix(pose), expected, rtol=0.0, atol=TOLERANCE)


# Poses --------------------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(3))
def test_a_composed_pose_is_the_product_of_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outer, inner = random_pose(rng), random_pose(rng)
    assert_same(compose(outer, inner), matrix(outer) @ matrix(inner))


@pytest.mark.parametrize("seen_from", ["root", "middle", "leaf"])
@pytest.mark.parametrize("seed", range(4))
def test_each_frame_is_where_the_product_of_matrices_has_it(seed: int, seen_from: str) -> None:
    tree, parents, in_root = random_tree(seed)
    leaves = set(range(SIZE)) - set(parents)
    middle = next(i for i in reversed(range(1, SIZE)) if i not in leaves and parents[i] != 0)
    origin = {"root": 0, "middle": middle, "leaf": max(leaves)}[seen_from]
    poses = tree.poses(f"f{origin}")
    assert set(poses) == set(tree.frames()) == {f"f{i}" for i in range(SIZE)}
    assert poses[f"f{origin}"] == IDENTITY
    for i in range(SIZE):
        assert_same(poses[f"f{i}"], np.linalg.inv(in_root[origin]) @ in_root[i])


# What changes -------------------------------------------------------------------------------------
def test_a_transform_that_comes_again_replaces_the_old() -> None:
    tree = FrameTree()
    tree.tell("a", "b", shifted(1.0))
    tree.tell("b", "c", shifted(0.0, 1.0))
    tree.tell("a", "b", [5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    assert tree.poses("a")["c"][:3] == (5.0, 1.0, 0.0)
    assert tree.poses("c")["a"][:3] == (-5.0, -1.0, 0.0)


def test_what_a_transform_was_read_from_may_change_afterwards() -> None:
    tree, told = FrameTree(), list(shifted(1.0))
    tree.tell("a", "b", told)
    told[0] = 9.0
    assert tree.poses("a")["b"] == shifted(1.0)


def test_a_frame_that_changes_its_parent_leaves_the_old_one_and_takes_its_children_along() -> None:
    tree = FrameTree()
    tree.tell("world", "a", shifted(1.0))
    tree.tell("world", "b", shifted(10.0))
    tree.tell("a", "cup", shifted(0.5))
    tree.tell("cup", "tea", shifted(0.0, 0.0, 0.1))
    tree.tell("b", "cup", shifted(0.25))
    poses = tree.poses("world")
    assert poses["cup"][0] == 10.25 and poses["tea"][:3] == (10.25, 0.0, 0.1)
    assert tree.poses("tea")["a"][:3] == (-9.25, 0.0, -0.1)
    # It is nowhere near its first parent any more: without the second there is no way to it.
    tree.tell("elsewhere", "b", shifted(0.0))
    assert set(tree.poses("world")) == {"world", "a"}
    assert set(tree.poses("cup")) == {"cup", "tea", "b", "elsewhere"}


def test_a_frame_may_come_back_to_its_first_parent() -> None:
    tree = FrameTree()
    for parent, x in [("a", 1.0), ("b", 2.0), ("a", 3.0)]:
        tree.tell(parent, "cup", shifted(x))
    assert tree.poses("a") == {"a": IDENTITY, "cup": shifted(3.0)}
    assert tree.poses("b") == {"b": IDENTITY}


# What there is not --------------------------------------------------------------------------------
def test_frames_that_do_not_hang_together_do_not_see_each_other() -> None:
    tree = FrameTree()
    tree.tell("odom", "base", shifted(1.0))
    tree.tell("world", "stone", shifted(2.0))
    assert tree.frames() == ["base", "odom", "stone", "world"]
    assert set(tree.poses("base")) == {"odom", "base"}
    assert set(tree.poses("world")) == {"world", "stone"}


def test_a_frame_that_nobody_has_told_sees_itself_alone() -> None:
    tree = FrameTree()
    assert tree.frames() == [] and tree.poses("odom") == {"odom": IDENTITY}
    tree.tell("odom", "base", shifted(1.0))
    assert tree.poses("moon") == {"moon": IDENTITY}
    assert tree.frames() == ["base", "odom"], "asking makes no frame"


# Loops --------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "edges",
    [
        [("a", "b"), ("b", "a")],
        [("a", "b"), ("b", "c"), ("c", "a")],
        [("a", "b"), ("b", "c"), ("c", "b")],
        [("a", "b"), ("b", "c"), ("c", "c")],
    ],
)
def test_a_loop_of_frames_has_an_end(edges: list[tuple[str, str]]) -> None:
    tree = FrameTree()
    for parent, child in edges:
        tree.tell(parent, child, shifted(1.0))
    for origin in tree.frames():
        poses = tree.poses(origin)
        assert poses[origin] == IDENTITY and set(poses) <= set(tree.frames())


def test_of_a_child_that_is_its_parents_parent_each_sees_the_other() -> None:
    tree = FrameTree()
    tree.tell("a", "b", shifted(1.0))
    tree.tell("b", "a", shifted(3.0))
    assert set(tree.poses("a")) == set(tree.poses("b")) == {"a", "b"}


def test_a_loop_that_ends_has_lost_nobody() -> None:
    tree = FrameTree()
    for parent, child in (("a", "b"), ("b", "a"), ("c", "a")):
        tree.tell(parent, child, shifted(1.0))
    assert set(tree.poses("c")) == {"a", "b", "c"}


def test_a_frame_without_a_name_is_one() -> None:
    tree = FrameTree()
    tree.tell("x", "", shifted(1.0))
    assert tree.poses("")["x"][0] == -tree.poses("x")[""][0] != 0.0
