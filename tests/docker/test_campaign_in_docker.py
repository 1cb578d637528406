"""A campaign across containers: a scheduler, two workers, and the program that hands out runs."""

import pandas as pd
import pytest
import yaml
from containers import Containers

pytestmark = [pytest.mark.graph, pytest.mark.docker]

CAMPAIGN = {"experiment": "trot", "matrix": {"duration": 2, "seed": [0, 1]}}
DIRECTORY = "out/campaigns"
"""Volume of the profile, below the working directory."""
IMAGE, PROJECT = "husky:test", "husky-test-campaign"
PROFILE = ("--profile", "campaign")


@pytest.fixture
def containers(engine):
    """The containers of the profile, with a short campaign in the volume; none runs yet."""
    engine.build(f"{IMAGE}-campaign", "--target", "campaign")
    file = f"{DIRECTORY}/short.yaml"
    told = {"HUSKY_BASE": engine.base, "HUSKY_IMAGE": IMAGE, "HUSKY_CAMPAIGN": file}
    containers = Containers(engine, PROJECT, told)
    containers.remove()  # what a run that was killed has left
    try:
        write = ("bash", "-c", 'printf %s "$0" > "$1"', yaml.safe_dump(CAMPAIGN), file)
        containers.compose(*PROFILE, "run", "--rm", "--no-deps", "-T", "campaign", *write)
        yield containers
    finally:
        containers.remove()


def test_two_workers_share_the_runs_and_a_second_start_has_none_left(containers, tmp_path):
    """On a read-only root, as an ordinary user, in containers that share a volume alone."""
    up = (*PROFILE, "up", "--no-build", "--exit-code-from", "campaign")
    containers.compose(*up, timeout=600.0)
    place = f"/opt/husky/{DIRECTORY}/short"
    containers.compose(*PROFILE, "cp", f"campaign:{place}", str(tmp_path / "short"))
    table = pd.read_parquet(tmp_path / "short/runs.parquet")
    assert list(table["seed"]) == [0, 1]
    assert table["ok"].all() and set(table["attempts"]) == {1}, table
    assert table["host"].nunique() == 2, table
    assert (tmp_path / "short/figures/mean_speed.png").is_file()
    said = containers.compose(*up, timeout=600.0)
    assert "2 runs, 2 done before" in said
