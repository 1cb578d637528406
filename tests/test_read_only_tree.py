"""A tree that was set up and cannot be written any more: all runs, or one line says why not."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def read_only(*command: str, cwd: Path, **env: str) -> subprocess.CompletedProcess[str]:
    """Run a command for which the tree is mounted read-only; skip where nobody may mount."""
    options = ["--mount"] if os.geteuid() == 0 else ["--mount", "--map-root-user"]
    mount = 'mount --bind "$0" "$0" && mount -o remount,bind,ro "$0" && [ ! -w "$0/log" ]'
    base = {"PATH": os.environ["PATH"], "HOME": str(cwd), "LC_ALL": "C.UTF-8"}

    def run(script: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["unshare", *options, "sh", "-c", f"{mount} && {script}", str(ROOT), *command],
            cwd=cwd,
            env={**base, **env},
            capture_output=True,
            text=True,
            timeout=280.0,
            check=False,
        )

    possible = run("true")
    if possible.returncode != 0:
        pytest.skip(f"a mount of one's own is not allowed here: {possible.stderr.strip()}")
    return run('exec "$@"')


def test_setup_with_nothing_to_do(tmp_path: Path) -> None:
    result = read_only(f"{ROOT}/scripts/setup.sh", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (0, "setup: up to date\n"), result.stderr
    assert result.stderr == ""


def test_setup_with_something_to_do(tmp_path: Path) -> None:
    """Without the packages of tests and figures .venv would be another one."""
    result = read_only(f"{ROOT}/scripts/setup.sh", "--nodes", cwd=tmp_path)
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr == (
        "setup: the virtual environment .venv would have to be made, "
        f"but {ROOT} cannot be written: run this where it can, or as its owner\n"
    )


@pytest.mark.graph
@pytest.mark.slow
def test_an_experiment_with_its_output_elsewhere(tmp_path: Path, domain: int) -> None:
    """What is compiled goes to the user's own cache, beginning with what the tree has."""
    result = read_only(
        f"{ROOT}/scripts/experiment.sh", "stand", "--duration", "0.5", "--no-figures", "--no-video",
        "--output", "out", cwd=tmp_path, ROS_DOMAIN_ID=str(domain),
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    assert json.loads(result.stdout.splitlines()[-1])["ok"]
    assert (tmp_path / "out/result.json").is_file()
    assert list((tmp_path / ".cache/husky/numba").rglob("*.nbc"))


def test_the_output_of_an_experiment_in_the_tree(tmp_path: Path) -> None:
    output = f"{ROOT}/out/read_only"
    result = read_only(f"{ROOT}/scripts/experiment.sh", "stand", "--output", output, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith("error: --output: [Errno 30] Read-only file system: ")
    assert result.stderr.count("\n") == 1
