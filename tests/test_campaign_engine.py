"""Campaigns whose runs fail, hang, lose their worker or are interrupted.

The engine and its processes are real; the experiment is a script that does what its seed says, in
no time (`tests/graph/test_campaign.py` has the robot).
"""

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import pytest
from distributed import LocalCluster

from husky_experiments import campaign
from husky_experiments.campaign import engine

FLAKY, FAILING, BROKEN, WAITING = 2, 3, 4, 5
"""Seeds of runs that fail once, that always fail, that leave no result, that wait for a file."""
PATIENCE = 120.0
"""Wall time after which something that should happen has not [s]."""
EXPERIMENT = f"""\
    #!/bin/bash
    for argument; do
        case "$argument" in
            --seed=*) seed="${{argument#*=}}" ;;
            --output=*) output="${{argument#*=}}" ;;
        esac
    done
    echo "$seed $ROS_DOMAIN_ID ${{HUSKY_STARTER%%:*}}" >> "$HUSKY_ROOT/started"
    mkdir -p "$output/bag" "$output/logs"
    head -c 100000 /dev/zero > "$output/bag/bag.mcap"
    ok=true
    case "$seed" in
        {FLAKY}) [[ "$output" = *attempt_2 ]] || ok=false ;;
        {FAILING}) ok=false ;;
        {BROKEN}) echo "the plant has crashed"; exit 3 ;;
        {WAITING}) "$HUSKY_PYTHON" -P -m husky_bringup.front "$HUSKY_ROOT/wait.py" || exit ;;
    esac
    cat > "$output/result.json" << END
    {{"experiment": "trot", "ok": $ok, "metrics": {{"trajectory_sha256": "$seed"}},
     "criteria": {{"falls": {{"value": 0, "bound": "<= 0", "ok": $ok}}}}}}
    END
    [ $ok = true ]
    """
WAIT = """\
    import os, time
    while not os.path.exists(os.path.join(os.environ["HUSKY_ROOT"], "go")):
        time.sleep(0.05)
    """


def eventually(condition, what):
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.05)
    return found


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """A tree with the experiment, which workers take for the source tree."""
    root = tmp_path_factory.mktemp("tree")
    (root / "scripts").mkdir()
    script = root / "scripts" / "experiment.sh"
    script.write_text(textwrap.dedent(EXPERIMENT))
    script.chmod(0o755)
    (root / "wait.py").write_text(textwrap.dedent(WAIT))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HUSKY_ROOT", str(root))
        patch.setenv("HUSKY_PYTHON", sys.executable)
        yield root


@pytest.fixture(scope="module")
def cluster(root):
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        yield cluster


@pytest.fixture(autouse=True)
def fresh(root):
    for name in ("started", "go"):
        (root / name).unlink(missing_ok=True)


class Start(NamedTuple):
    """Seed, ROS domain and worker's process of a run that was started."""

    seed: int
    domain: int
    worker: int


def starts(root):
    file = root / "started"
    lines = file.read_text().splitlines() if file.exists() else []
    return [Start(*map(int, line.split())) for line in lines]


def wait_for_start(root, number=0):
    """Return a start of the run that waits, the first by default."""
    return eventually(
        lambda: [start for start in starts(root) if start.seed == WAITING][number:],
        "the run that waits",
    )[0]


def running(*names):
    """Command lines of the processes that have one of these names in it."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            line = file.read_bytes().replace(b"\0", b" ").decode(errors="replace")
            found += [line] if any(str(name) in line for name in names) else []
    return found


def of_seeds(*seeds, **keys):
    return {"experiment": "trot", "matrix": {"seed": list(seeds)}, **keys}


def bags(output):
    return sorted(f"{p.parents[1].name}/{p.parent.name}" for p in output.rglob("runs/*/*/bag"))


def test_runs_are_done_once_and_their_data_goes_unless_they_failed(cluster, root, tmp_path):
    seeds = (0, 1, FLAKY, FAILING, BROKEN)
    table = campaign.run(of_seeds(*seeds), output=tmp_path, scheduler=cluster, quiet=True)
    assert list(table["seed"]) == list(seeds)
    assert list(table["ok"]) == [True, True, True, False, False]
    assert list(table["attempts"]) == [1, 1, 2, 2, 2]
    assert table["failed"][2] == "falls = 0 (<= 0); then: passed"
    assert table["failed"][4].startswith("exit code 3: the plant has crashed")
    assert [name.partition("-")[0] for name in bags(tmp_path)] == [
        f"seed_{seed}" for seed in (FLAKY, FAILING, FAILING, BROKEN, BROKEN)
    ]
    assert len(starts(root)) == 8
    # A second call has nothing to do, one with a larger matrix only what is new.
    again = campaign.run(of_seeds(*seeds), output=tmp_path, scheduler=cluster, quiet=True)
    assert again.equals(table) and len(starts(root)) == 8
    more = campaign.run(of_seeds(7, *seeds), output=tmp_path, scheduler=cluster, quiet=True)
    assert [*more["seed"]] == [7, *seeds] and len(starts(root)) == 9


def test_what_fails_by_its_criteria_may_be_a_result(cluster, root, tmp_path):
    content = of_seeds(FAILING, BROKEN, retry="errors", keep="none")
    table = campaign.run(content, output=tmp_path, scheduler=cluster, quiet=True)
    assert list(table["attempts"]) == [1, 2]
    assert bags(tmp_path) == []


def test_data_beyond_the_limit_goes(cluster, root, tmp_path, capsys):
    campaign.run(
        of_seeds(FAILING, BROKEN, 0, keep="all"), output=tmp_path, scheduler=cluster, disk=0.00035
    )
    assert len(bags(tmp_path)) == 3  # of five, 100 kB each: those of one failed run, and of 0
    assert "keep no data" in capsys.readouterr().err


def test_a_run_that_takes_too_long_is_ended(cluster, root, tmp_path):
    content = of_seeds(WAITING, retry="never", timeout=0.5)
    table = campaign.run(content, output=tmp_path, scheduler=cluster, quiet=True)
    assert list(table["failed"]) == ["ended after 0.5 s of wall time"]


def test_two_runs_at_a_time_are_in_two_domains_and_a_lost_worker_is_replaced(
    cluster, root, tmp_path
):
    seeds = of_seeds(WAITING, WAITING + 10, 0)  # the second one passes at once
    with ThreadPoolExecutor() as pool:
        ending = pool.submit(campaign.run, seeds, output=tmp_path, scheduler=cluster, quiet=True)
        first = wait_for_start(root)
        eventually(lambda: len(starts(root)) >= 3, "the other runs")
        others = {domain for seed, domain, _ in starts(root) if seed != WAITING}
        assert first.domain not in others
        os.kill(first.worker, signal.SIGKILL)
        again = wait_for_start(root, 1)
        assert again.worker != first.worker
        (root / "go").touch()
        table = ending.result(PATIENCE)
    assert list(table["ok"]) == [True] * 3 and list(table["attempts"]) == [1] * 3


def test_a_campaign_that_is_ended_leaves_nothing_running_and_goes_on(root, cluster, tmp_path):
    file = tmp_path / "some.yaml"
    file.write_text(f"experiment: trot\nmatrix: {{seed: [0, {WAITING}]}}\n")
    output = tmp_path / "out"
    command = [
        sys.executable,
        "-P",
        "-m",
        "husky_bringup.front",
        "-m",
        "husky_experiments.campaign",
    ]
    for number, code in ((signal.SIGINT, 130), (signal.SIGKILL, -9)):
        process = subprocess.Popen(
            [*command, str(file), "--output", str(output), "--workers", "1"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        wait_for_start(root)
        if number == signal.SIGINT:
            os.killpg(process.pid, number)  # as a terminal does
        else:
            process.kill()
        said = process.communicate(timeout=PATIENCE)[0]
        assert process.returncode == code, said
        assert "Traceback" not in said
        if number == signal.SIGKILL:
            eventually(lambda: not running(root, output), "the end of the run")
        assert running(root, output) == []
        (root / "started").unlink()
    (root / "go").touch()
    table = campaign.run(file, output=output, scheduler=cluster, quiet=True)
    assert list(table["ok"]) == [True, True]
    assert [seed for seed, _, _ in starts(root)] == [WAITING]  # the other one was done


def test_a_damaged_record_is_none_and_again_forgets_all_once_there_are_workers(
    cluster, root, tmp_path
):
    def carry_out(**options):
        campaign.run(of_seeds(0, 1), output=tmp_path, scheduler=cluster, quiet=True, **options)
        return [start.seed for start in starts(root)]

    assert sorted(carry_out()) == [0, 1]
    for text in ("{", "[]", '{"attempts": 5}', '{"attempts": [{}]}'):
        next(tmp_path.glob("runs/seed_0-*/record.json")).write_text(text)
        (root / "started").unlink()
        assert carry_out() == [0], text
        (root / "started").unlink()
        with pytest.raises(campaign.CampaignError, match="no Dask scheduler answers at nobody"):
            campaign.run(of_seeds(0), output=tmp_path, scheduler="nobody", again=True, quiet=True)
        (root / "started").touch()
        assert carry_out() == []
    assert sorted(carry_out(again=True)) == [0, 1]


def test_two_campaigns_do_not_share_a_directory(root, cluster, tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(campaign.CampaignError, match="something else than a campaign"):
        campaign.run(of_seeds(0), output=tmp_path, scheduler=cluster, again=True, quiet=True)
    output = tmp_path / "out"
    refused = pytest.raises(BlockingIOError, match="another campaign writes into")
    with engine.reserved(output), refused:
        campaign.run(of_seeds(0), output=output, scheduler=cluster, quiet=True)


def test_a_scheduler_that_does_not_answer_is_named(root, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "_CONNECTING", 0.5)
    with pytest.raises(campaign.CampaignError, match=r"at tcp://127\.0\.0\.1:9: "):
        campaign.run(of_seeds(0), output=tmp_path, scheduler="tcp://127.0.0.1:9", quiet=True)
