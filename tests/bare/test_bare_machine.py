"""The front door on a machine as it is delivered: a bare Debian, what README.md names, no display.

It goes on from the set-up of the image, which an ordinary user has made (`set_up` in
docker/Dockerfile), with this whole tree: figures, video and tests are set up here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from docker_engine import ROOT, Engine, run

pytestmark = [pytest.mark.graph, pytest.mark.bare]

_IMAGE, _NAME = "husky:set-up", "husky-bare-machine"
_DOWNLOADS = "husky-test-downloads"
"""Volume of what pip has downloaded; it outlasts a run, as images do."""
_PATIENCE = 900.0
"""Wall time that a step may take on a busy machine [s]."""
_DRAWING = "ros2_ws/src/husky_experiments/test/test_video.py"
_PURE = "ros2_ws/src/husky_description/test/test_mujoco_model.py tests/test_front_door.py"
_HINT = re.compile(r"^.* no video: (.+); install the packages (.+), or (\S+)$", re.MULTILINE)


class Machine:
    """A container in which an ordinary user sits before this tree."""

    def __init__(self, engine: Engine):
        self._engine = engine

    def sh(self, script: str, user: int = 8000) -> str:
        """Run a script; return what it prints.

        Raises:
            RuntimeError: it failed.
        """
        shell = ("exec", "--user", f"{user}:{user}", _NAME, "bash", "-c", script)
        return self._engine.run(*shell, timeout=_PATIENCE)

    def apt(self, *arguments: str) -> None:
        """Install or remove packages as root, without those that are only recommended."""
        options = "--yes --no-install-recommends"
        self.sh(f"DEBIAN_FRONTEND=noninteractive apt-get {options} {' '.join(arguments)}", user=0)

    def demo(self) -> tuple[str, dict[str, Any]]:
        """Run the demo, which has to succeed with figures; return what it says and its result."""
        said = self.sh("cd /opt/husky && scripts/demo.sh --distance 1 --output /tmp/demo")
        result = json.loads(said.splitlines()[-1])
        assert result["ok"], said
        assert int(self.sh("ls /tmp/demo/figures/*.png | wc -l")) > 3
        return said, result

    def passed(self, tests: str) -> dict[str, int]:
        """Run tests, none of which may fail; return how many passed, were skipped, ..."""
        said = self.sh(f"cd /opt/husky && scripts/test.sh -q -p no:cacheprovider {tests}")
        counts = re.findall(r"(\d+) (\w+)", said.splitlines()[-1])
        return {word: int(count) for count, word in counts}


@pytest.fixture(scope="module")
def machine(engine: Engine, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """A machine with this tree, on which nobody can draw yet."""
    engine.build(_IMAGE, "--target", "set_up")
    tree = tmp_path_factory.mktemp("tree") / "tree.tar"
    listed = "git ls-files -z --cached --others --exclude-standard"
    packed = f"{listed} | tar --create --null --files-from=- --ignore-failed-read --file={tree}"
    run(["bash", "-c", packed], {}, timeout=60.0)
    engine.run("rm", "--force", _NAME, check=False)
    pip = ("--volume", f"{_DOWNLOADS}:/pip", "--env=PIP_CACHE_DIR=/pip", "--env=PIP_NO_CACHE_DIR=")
    engine.run("run", "--detach", "--init", "--name", _NAME, *pip, _IMAGE, "sleep", "infinity")
    try:
        engine.run("cp", str(tree), f"{_NAME}:/tmp/tree.tar")
        machine = Machine(engine)
        machine.sh("chown 8000:8000 /pip && apt-get update", user=0)
        machine.sh("tar --extract --file=/tmp/tree.tar --directory=/opt/husky")
        yield machine
    finally:
        engine.run("rm", "--force", _NAME, check=False)


@pytest.fixture(scope="module")
def undrawn(machine: Machine) -> tuple[str, dict[str, Any]]:
    """What the demo says, and its result, on the bare machine."""
    return machine.demo()


def test_demo_and_tests_without_opengl(machine, undrawn):
    """All but the video, and one line that says so; what draws is skipped, all else passes."""
    said, result = undrawn
    assert len(_HINT.findall(said)) == said.count("no video") == 1, said
    assert "video.mp4" not in said
    assert "video.mp4" not in machine.sh("ls /tmp/demo")
    assert result["metrics"]["trajectory_sha256"]
    counts = machine.passed(f"{_DRAWING} {_PURE}")
    assert counts["skipped"] >= 3 and counts["passed"] > 40, counts


def test_the_lesser_package_that_is_named_suffices(machine, undrawn):
    osmesa = _HINT.search(undrawn[0])[3]
    machine.apt("install", osmesa)
    assert "skipped" not in machine.passed(_DRAWING)
    machine.apt("purge", "--auto-remove", osmesa)


def test_the_packages_that_are_named_suffice(machine, undrawn):
    """The same trajectory, a result of the same form, and a video."""
    said, result = undrawn
    machine.apt("install", _HINT.search(said)[2].replace(" and ", " ").replace(",", ""))
    assert "skipped" not in machine.passed(_DRAWING)
    drawn, same = machine.demo()
    # The other numbers are of the bag; on a busy machine its recorder may miss a message.
    assert same["metrics"]["trajectory_sha256"] == result["metrics"]["trajectory_sha256"]
    for part in ("metrics", "criteria"):
        assert same[part].keys() == result[part].keys()
    assert "no video" not in drawn and "/tmp/demo/video.mp4" in drawn
    assert int(machine.sh("stat -c %s /tmp/demo/video.mp4")) > 20_000
    program = "import imageio_ffmpeg as f; print(f.count_frames_and_secs('/tmp/demo/video.mp4')[0])"
    assert int(machine.sh(f'. /opt/husky/scripts/env.sh; python -c "{program}"')) > 100


def test_the_packages_are_those_of_the_readme():
    """The image is made with them, so that they have been tried."""
    readme = (ROOT / "README.md").read_text()
    dockerfile = (ROOT / "docker/Dockerfile").read_text()
    installed = " ".join(re.findall(r"apt-get install .*-recommends (.+?) \\", dockerfile))
    named = re.search(r"On Debian 12 [^`]*`([^`]+)`", readme)
    assert named and set(named[1].split()) == set(installed.split()) - {"ca-certificates", "tini"}
