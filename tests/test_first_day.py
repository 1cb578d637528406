"""The parameter and the experiment of docs/first_day.md; its shell blocks are in test_readme.py."""

import argparse
import os
import re
import shutil
import subprocess
import sys

import pasted
import pytest
from pasted import FIRST_DAY, ROOT

PARAMETER, EXPERIMENT = "Add a parameter", "Add an experiment"
PACKAGE = "ros2_ws/src/husky_control/husky_control"


@pytest.mark.skipif(shutil.which("git") is None, reason="the change is pasted by git apply")
def test_the_parameter_is_as_the_document_shows_it(tmp_path):
    """In a copy of the package."""
    change, told, _ = pasted.blocks(PARAMETER, FIRST_DAY)
    shutil.copytree(ROOT / PACKAGE, tmp_path / PACKAGE, ignore=shutil.ignore_patterns("*.pyc"))
    environment = {
        **os.environ,
        "GIT_CEILING_DIRECTORIES": str(tmp_path.parent),
        "PYTHONPATH": f"{(tmp_path / PACKAGE).parent}:{os.environ.get('PYTHONPATH', '')}",
    }
    subprocess.run(["bash", "-e", "-c", change], cwd=tmp_path, env=environment, check=True)
    (line, shown), (_, taken), (_, refused) = pasted.transcript(told)
    name = line.split()[-1]
    program = (
        "from husky_control.parameters import Parameters, TABLE\n"
        f"row = TABLE[{name!r}]\n"
        f"Parameters().set({name!r}, 4.0)\n"
        "print(f'  Description: {row.description} [{row.unit}]')\n"
        "print(f'    Min value: {row.lower}\\n    Max value: {row.upper}')"
    )
    said = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert said.stdout.splitlines() == [shown[2], *shown[4:]]
    assert taken == ["Set parameter successful"] and "Min: 0.8, Max: 10.0" in refused[0]
    steps = tmp_path / PACKAGE / "modes/stand_up_and_sit.py"
    assert steps.read_text().count(f'"{name}"') == 1


def the_experiment(directory):
    """Save the experiment of the document; return its name and the command line that runs it."""
    (program,) = pasted.blocks(EXPERIMENT, FIRST_DAY, "python")
    command = re.search(
        r"^scripts/experiment\.sh (\w.*)$", pasted.blocks(EXPERIMENT, FIRST_DAY)[0], re.M
    )
    name, *options = command[1].split()
    (directory / f"{name}.py").write_text(program)
    return name, options


def test_the_experiment_takes_the_options_of_the_document(tmp_path):
    pytest.importorskip("rclpy")
    name, options = the_experiment(tmp_path)
    experiment = {}
    exec(compile((tmp_path / f"{name}.py").read_text(), name, "exec"), experiment)
    parser = argparse.ArgumentParser()
    experiment["add_options"](parser)
    assert parser.parse_args(options).duration == 5.0 and callable(experiment["run"])


@pytest.mark.graph
@pytest.mark.slow
def test_the_experiment_runs(domain, tmp_path):
    name, options = the_experiment(tmp_path)
    program = (
        "import sys\n"
        "from husky_experiments import catalogue\n"
        f"catalogue.__path__.append({str(tmp_path)!r})\n"
        "from husky_experiments.__main__ import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    output = ["--output", str(tmp_path / "out"), "--no-video", "--no-figures"]
    command = [sys.executable, "-c", program, name, *options, *output]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (shown,) = pasted.blocks(EXPERIMENT, FIRST_DAY, "text")
    wanted = [line for line in shown.splitlines() if line.startswith("  ok")]
    printed = [line for line in done.stdout.splitlines() if line.startswith("  ok")]
    assert pasted.alike(printed) == pasted.alike(wanted)
