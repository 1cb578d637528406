"""The front door: setup.sh names what is missing, env.sh sets what it says."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "scripts"
# What setup.sh itself runs, apart from Python and the build tools that it looks for.
COREUTILS = (
    "bash basename cat cut date dirname env flock grep head ls mkdir readlink rm sha256sum sort"
    " tail uname"
)
BUILD_TOOLS = ("cmake", "cc", "c++", "make")
PYTHON = os.path.realpath(sys.executable)


def run(*command: str | Path, cwd: Path = ROOT, **env: str) -> subprocess.CompletedProcess[str]:
    """Run a command in an almost empty environment."""
    return subprocess.run(
        command,
        cwd=cwd,
        env={"PATH": "/usr/bin:/bin", "HOME": tempfile.gettempdir(), "LC_ALL": "C.UTF-8", **env},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


def sourced(script: str, shell: str = "bash", cwd: Path = ROOT, **env: str) -> dict[str, str]:
    """The environment after a piece of shell script that sources env.sh."""
    result = run(shell, "-c", f"{script}\nenv -0", cwd=cwd, **env)
    assert result.returncode == 0, result.stderr
    return dict(item.split("=", 1) for item in result.stdout.split("\0") if "=" in item)


@pytest.fixture
def bare_tree(tmp_path: Path) -> Path:
    """A tree with the scripts and one package, in which nothing has been set up."""
    tree = tmp_path / "tree"
    shutil.copytree(SCRIPTS, tree / "scripts")
    shutil.copytree(ROOT / "ros2_ws/src/husky_msgs", tree / "ros2_ws/src/husky_msgs")
    return tree


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """A directory of exactly the programs that setup.sh needs."""
    directory = tmp_path / "bin"
    directory.mkdir()
    for name in (*COREUTILS.split(), *BUILD_TOOLS):
        found = shutil.which(name)
        if found is None:
            pytest.skip(f"this machine has no {name}")
        (directory / name).symlink_to(os.path.realpath(found))
    return directory


# ------------------------------------------------------------------ setup.sh
def test_setup_has_nothing_to_do_the_second_time() -> None:
    first = run(SCRIPTS / "setup.sh")
    assert first.returncode == 0, first.stderr
    again = run(SCRIPTS / "setup.sh")
    assert (again.returncode, again.stdout) == (0, "setup: up to date\n")


@pytest.mark.parametrize(
    ("tool", "package"),
    [
        ("cmake", "cmake"),
        ("cc", "build-essential"),
        ("c++", "build-essential"),
        ("make", "build-essential"),
    ],
)
def test_setup_names_the_package_of_a_missing_tool(
    bare_tree: Path, tools: Path, tool: str, package: str
) -> None:
    (tools / tool).unlink()
    result = run(
        bare_tree / "scripts/setup.sh",
        PATH=str(tools),
        HUSKY_PYTHON=PYTHON,
        HUSKY_ROS_PREFIX="wheels",
    )
    assert result.returncode != 0
    assert f"missing: {tool}\n" in result.stderr
    assert f"sudo apt install {package}\n" in result.stderr
    assert not (bare_tree / ".venv").exists()


def test_setup_names_the_package_of_missing_virtual_environments(
    bare_tree: Path, tools: Path, tmp_path: Path
) -> None:
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    (hidden / "sitecustomize.py").write_text("import sys\nsys.modules['ensurepip'] = None\n")
    python = tmp_path / "python"
    python.write_text(f'#!/bin/bash\nPYTHONPATH={hidden} exec {PYTHON} "$@"\n')
    python.chmod(0o755)
    result = run(
        bare_tree / "scripts/setup.sh",
        PATH=str(tools),
        HUSKY_PYTHON=str(python),
        HUSKY_ROS_PREFIX="wheels",
    )
    name = f"python{sys.version_info.major}.{sys.version_info.minor}-venv"
    assert result.returncode != 0
    assert f"sudo apt install {name}\n" in result.stderr


@pytest.mark.parametrize("version", ["3.10", "3.13"])
def test_setup_refuses_another_python(bare_tree: Path, tools: Path, version: str) -> None:
    python = tools / "python3"
    python.write_text(f"#!/bin/bash\necho {version}\n")
    python.chmod(0o755)
    named = run(
        bare_tree / "scripts/setup.sh",
        PATH=str(tools),
        HUSKY_PYTHON=str(python),
        HUSKY_ROS_PREFIX="wheels",
    )
    assert named.returncode != 0
    assert f"is Python {version}, needed is 3.11 or 3.12" in named.stderr


def test_setup_names_the_prefix_that_holds_no_ros(bare_tree: Path, tools: Path) -> None:
    result = run(bare_tree / "scripts/setup.sh", PATH=str(tools), HUSKY_ROS_PREFIX="/nowhere")
    assert result.returncode != 0
    assert "HUSKY_ROS_PREFIX=/nowhere holds no ROS" in result.stderr


def test_setup_refuses_a_path_that_ros_cannot_build_in(bare_tree: Path, tools: Path) -> None:
    spaced = bare_tree.rename(bare_tree.with_name("with space"))
    result = run(spaced / "scripts/setup.sh", PATH=str(tools))
    assert result.returncode != 0
    assert "path with spaces" in result.stderr


def test_setup_shows_the_end_of_the_log_of_what_failed(bare_tree: Path, tools: Path) -> None:
    (bare_tree / "scripts/requirements/build.txt").write_text(
        "no-such-package-of-husky==0\nsetuptools==0.0.1\n"
    )
    result = run(
        bare_tree / "scripts/setup.sh",
        PATH=str(tools),
        HUSKY_PYTHON=PYTHON,
        HUSKY_ROS_PREFIX="wheels",
        PIP_NO_INDEX="1",
        PIP_FIND_LINKS=str(tools),
    )
    assert result.returncode != 0
    assert "--- the end of" in result.stderr
    assert "setuptools==0.0.1" in result.stderr
    assert not (bare_tree / ".venv/stamp").exists()


# ------------------------------------------------------------------ env.sh
@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_env_sets_up_a_shell_from_anywhere(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell, path="/usr/bin:/bin") is None:
        pytest.skip(f"this machine has no {shell}")
    env = sourced(f". {SCRIPTS}/env.sh", shell=shell, cwd=tmp_path)
    assert env["VIRTUAL_ENV"] == str(ROOT / ".venv")
    assert env["PATH"].split(":")[0] == str(ROOT / ".venv/bin")
    assert env["AMENT_PREFIX_PATH"].split(":")[0] == str(ROOT / "ros2_ws/install")
    assert env["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert not {"ROS_DOMAIN_ID", "MUJOCO_GL"} & env.keys()
    assert {"NUMBA_CACHE_DIR", "OPENBLAS_NUM_THREADS"} <= env.keys()
    assert not [name for name in env if name.startswith("_husky")]


def test_env_gives_the_packages_and_ros_to_python() -> None:
    result = run(
        "bash", "-c",
        f". {SCRIPTS}/env.sh && python -c 'import husky_msgs.msg, husky_description, rclpy'",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr


def test_env_respects_what_is_set() -> None:
    mine = {
        "ROS_DOMAIN_ID": "42",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
        "FASTRTPS_DEFAULT_PROFILES_FILE": "/mine.xml",
        "MUJOCO_GL": "osmesa",
        "NUMBA_CACHE_DIR": "/mine",
        "OPENBLAS_NUM_THREADS": "4",
    }
    env = sourced(f". {SCRIPTS}/env.sh", **mine)
    assert {name: env[name] for name in mine} == mine


def test_nothing_but_drawing_loads_opengl() -> None:
    """Whatever MUJOCO_GL says, which what draws finds untouched."""
    nodes = "husky_sim.world, husky_sim.nodes.plant"
    modules = f"{nodes}, husky_experiments.run, husky_experiments.figures.video"
    result = run(
        "bash", "-c",
        f". {SCRIPTS}/env.sh && python -c 'import os, sys, {modules}; "
        """print(os.environ["MUJOCO_GL"], *{"OpenGL", "glfw"} & sys.modules.keys())'""",
        MUJOCO_GL="egl",
    )  # fmt: skip
    assert result.stdout == "egl\n", result.stderr


def test_env_can_be_sourced_twice_and_in_a_strict_shell() -> None:
    once = sourced(f"set -euo pipefail; . {SCRIPTS}/env.sh")
    twice = sourced(f"set -euo pipefail; . {SCRIPTS}/env.sh; . {SCRIPTS}/env.sh")
    ignored = {"_", "SHLVL"}
    assert {k: v for k, v in once.items() if k not in ignored} == {
        k: v for k, v in twice.items() if k not in ignored
    }


STATE = """
cd() { echo "not there"; }; dirname() { echo /nowhere; }; mkdir() { false; }; ls() { false; }
export -f cd dirname mkdir ls; export CDPATH=.:/tmp BASH_ENV=/nowhere IFS=x GREP_OPTIONS=-v
shopt -s expand_aliases nullglob failglob; alias cp='false' unset='false' bash='false'; set -fCu
"""
"""State that a shell may have, or hand on to programs."""


def test_nothing_of_the_callers_shell_matters_to_env(tmp_path: Path) -> None:
    plain = sourced(f". {SCRIPTS}/env.sh", cwd=tmp_path)
    odd = sourced(f"{STATE}. {SCRIPTS}/env.sh", cwd=tmp_path)
    assert {name: odd.get(name) for name in plain if name not in ("_", "SHLVL", "IFS")} == {
        name: value for name, value in plain.items() if name not in ("_", "SHLVL")
    }


@pytest.mark.parametrize("call", ["", "bash ", "sh "])
def test_nothing_of_the_callers_shell_matters_to_scripts(call: str) -> None:
    """Started as programs, and as a shell's argument."""
    called = run("bash", "-c", f"{STATE}unalias bash\n{call}{SCRIPTS}/experiment.sh trot --help")
    assert called.returncode == 0, called.stderr
    assert "forward speed [m/s]" in called.stdout


def test_scripts_are_found_by_links_too(tmp_path: Path) -> None:
    for name in ("setup.sh", "experiment.sh", "env.sh"):
        (tmp_path / name).symlink_to(SCRIPTS / name)
    assert run(tmp_path / "setup.sh").stdout == "setup: up to date\n"
    listed = run(tmp_path / "experiment.sh").stdout
    assert "usage: scripts/experiment.sh NAME" in listed and "  wair_map " in listed
    assert sourced(f". {tmp_path}/env.sh")["HUSKY_ROOT"] == str(ROOT)


def test_another_ros_and_another_python_are_left_out(tmp_path: Path) -> None:
    """A user's own modules, and workspaces that are built on no other ROS, stay behind ours."""
    humble, overlay, mine = tmp_path / "humble", tmp_path / "ws/install/arm", tmp_path / "mine"
    index = "share/ament_index/resource_index"
    for path in (humble / index / "packages/rcl", overlay / index / "packages/arm"):
        path.parent.mkdir(parents=True)
        path.touch()
    parents = overlay / index / "parent_prefix_path/arm"
    parents.parent.mkdir()
    parents.write_text(f"{tmp_path}/ws/install/leg:{humble}\n")
    others = f"{humble}/lib/python3.10/site-packages:{overlay}/lib/python/site-packages"
    env = sourced(
        f". {SCRIPTS}/env.sh",
        PATH=f"{humble}/bin:/usr/bin:/bin:node_modules/.bin",
        PYTHONPATH=f"{others}:{tmp_path}/venv/lib/python2.7/site-packages::{mine}",
        AMENT_PREFIX_PATH=f"{overlay}:{humble}",
        CMAKE_PREFIX_PATH=f"{overlay}:{humble}:{mine}",
        LD_LIBRARY_PATH=f"lib:{overlay}/lib:{humble}/opt/yaml_vendor/lib:{humble}/lib:{mine}",
        ROS_DISTRO="humble",
    )
    assert env["ROS_DISTRO"] == "jazzy"
    for name in ("PATH", "PYTHONPATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH"):
        assert not [e for e in env[name].split(":") if e.startswith((str(humble), str(overlay)))]
        assert "" not in env[name].split(":"), name
    for name in ("PYTHONPATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH"):
        assert env[name].split(":")[-1] == str(mine)
    assert env["PYTHONPATH"].split(":")[-2].endswith("/site-packages"), "packages of ours first"


def test_modules_in_the_working_directory_are_not_imported(tmp_path: Path) -> None:
    (tmp_path / "random.py").write_text("raise SystemExit('a stranger')\n")
    called = run(SCRIPTS / "experiment.sh", "trot", "--help", cwd=tmp_path, PYTHONOPTIMIZE="2")
    assert called.returncode == 0, called.stderr
    assert "forward speed [m/s] (default: 0.5)" in " ".join(called.stdout.split())


@pytest.mark.parametrize("script", ["experiment.sh", "bringup.sh"])
def test_other_discovery_is_left_out_or_named(script: str) -> None:
    """By what ends its graph itself; a robot that stays may be meant to be found that way."""
    command = f". {SCRIPTS}/front.sh; echo ${{ROS_DISCOVERY_SERVER:-none}}"
    ran = run("bash", "-p", "-c", command, script, ROS_DISCOVERY_SERVER="127.0.0.1:11811")
    told = {
        "experiment.sh": ("none", "note: ROS_DISCOVERY_SERVER=127.0.0.1:11811 is left out"),
        "bringup.sh": ("127.0.0.1:11811", "each other by ROS_DISCOVERY_SERVER=127.0.0.1:11811"),
    }
    found, words = told[script]
    assert ran.stdout.splitlines()[-1] == found and words in ran.stderr, ran.stderr


def test_a_working_directory_that_is_gone_is_named(tmp_path: Path) -> None:
    script = f"rmdir {tmp_path}; exec {SCRIPTS}/experiment.sh trot"
    ran = run("bash", "-c", script, cwd=tmp_path)
    said = [line for line in ran.stderr.splitlines() if "getcwd" not in line]  # bash itself
    assert ran.returncode == 1 and said == [
        "error: the working directory has been deleted; change to one that exists"
    ]


def test_a_log_directory_that_is_not_ours_is_replaced(tmp_path: Path) -> None:
    (tmp_path / ".ros").mkdir()
    (tmp_path / ".ros/log").touch()  # no directory to write in, for root too
    env = sourced(f". {SCRIPTS}/env.sh", HOME=str(tmp_path))
    assert Path(env["ROS_LOG_DIR"]).is_dir()
    (tmp_path / ".ros/log").unlink()
    assert "ROS_LOG_DIR" not in sourced(f". {SCRIPTS}/env.sh", HOME=str(tmp_path))


def test_env_before_setup_says_so_and_leaves_the_shell_alive(bare_tree: Path) -> None:
    result = run("bash", "-c", ". scripts/env.sh; echo alive $?", cwd=bare_tree)
    assert "run " in result.stderr and "scripts/setup.sh first" in result.stderr
    assert result.stdout == "alive 1\n"


def test_ros2_is_the_stand_in_where_there_is_no_other(tmp_path: Path) -> None:
    if shutil.which("ros2", path="/usr/bin:/bin") or (ROOT / ".venv/bin/ros2").exists():
        pytest.skip("this machine has a genuine ros2 command")
    other = tmp_path / "scripts/ros2/bin"
    shutil.copytree(SCRIPTS / "ros2", other.parent)
    search = f"{other}:/usr/bin:/bin"  # as in a shell that has sourced another checkout's env.sh
    result = run("bash", "-c", f". {SCRIPTS}/env.sh; command -v ros2; ros2 --help", PATH=search)
    assert result.stdout.startswith(str(SCRIPTS / "ros2/bin/ros2"))
    assert "usage: ros2" in result.stdout


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_genuine_ros2_is_never_shadowed(tmp_path: Path, when: str) -> None:
    genuine = tmp_path / "ros2"
    genuine.write_text("#!/bin/sh\necho genuine\n")
    genuine.chmod(0o755)
    extend, source = f"PATH=$PATH:{tmp_path}", f". {SCRIPTS}/env.sh"
    if when == "after":  # a PATH that gets its ROS later, in front as ROS's own scripts do
        extend = f"PATH={tmp_path}:$PATH"
    script = f"{extend}; {source}" if when == "before" else f"{source}; {extend}"
    assert run("bash", "-c", f"{script}; ros2").stdout == "genuine\n"


# ------------------------------------------------------------------ what they are made of
def test_requirements_are_pinned_and_named_once() -> None:
    names: list[str] = []
    for path in sorted((SCRIPTS / "requirements").glob("*.txt")):
        for line in path.read_text().splitlines():
            if line and not line.startswith("#"):
                match = re.fullmatch(r"([A-Za-z0-9._-]+)==([0-9][A-Za-z0-9.]*)", line)
                assert match, f"{path.name}: {line} is not pinned"
                names.append(re.sub(r"[-_.]+", "-", match[1]).lower())
    assert len(names) == len(set(names)), sorted(n for n in names if names.count(n) > 1)


@pytest.mark.parametrize("script", sorted(p.name for p in SCRIPTS.glob("*.sh")))
def test_scripts_are_valid_shell(script: str) -> None:
    result = run("bash", "-n", SCRIPTS / script)
    assert result.returncode == 0, result.stderr


def test_wheels_point_at_headers_that_are_here() -> None:
    underlay = (ROOT / ".venv/ros_underlay").read_text().strip()
    if underlay != "wheels":
        pytest.skip(f"ROS comes from {underlay}")
    exported = list((ROOT / ".venv/share").glob("*/cmake/*Export.cmake"))
    assert exported
    assert not [path for path in exported if "/opt/python/" in path.read_text()]
