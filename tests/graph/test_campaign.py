"""A campaign of the robot: two graphs at a time, and one of its runs again."""

import json
import subprocess
from pathlib import Path

import pandas as pd
import pytest

pytestmark = [pytest.mark.graph, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]


def test_a_run_is_the_same_beside_another_and_alone(tmp_path):
    """Two of them at once in domains of their own; then one by `--replay`, which compares."""
    file = tmp_path / "trots.yaml"
    file.write_text("experiment: trot\nmatrix: {duration: 1.5, seed: [0, 1]}\n")
    command = [ROOT / "scripts" / "campaign.sh", file, "--output", tmp_path / "out"]

    def result(*more):
        run = subprocess.run([*command, *more], capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr
        return json.loads(run.stdout.splitlines()[-1])

    told = result("--workers", "2")
    assert (told["runs"], told["passed"], told["second_attempts"]) == (2, 2, 0)
    table = pd.read_parquet(told["table"])
    assert table["trajectory_sha256"].nunique() == 2
    assert not list((tmp_path / "out/runs").rglob("bag"))
    again = result("--replay", "1")
    assert again["same_trajectory"] is True
    output = Path(again["output"])
    assert (output / "figures/tracking.png").is_file() and (output / "bag").is_dir()
