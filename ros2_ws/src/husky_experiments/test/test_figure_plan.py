"""The figure of a plan, and the script that makes one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from matplotlib.image import imread

from husky_control.planning.plan import load_plan

SCRIPT = Path(__file__).resolve().parents[4] / "scripts" / "plan_incline.py"


def test_the_script_plans_saves_and_draws(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "30"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    plan = load_plan(tmp_path / "plan.npz")
    assert abs(plan.slope - 0.5236) < 1e-4
    assert "plan.png" in done.stdout
    image = imread(tmp_path / "plan.png")
    assert image.shape[0] > 500
    assert image.std() > 0.05  # something is drawn


def test_the_script_is_short() -> None:
    assert len(SCRIPT.read_text().splitlines()) < 25
