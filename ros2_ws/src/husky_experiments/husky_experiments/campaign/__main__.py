"""`scripts/campaign.sh FILE.yaml [--option value ...]`."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from pathlib import Path

from husky_bringup.front import end_by_signals
from husky_bringup.settings import HelpFormatter
from husky_experiments.campaign.campaign_file import Campaign, CampaignError, read_campaign
from husky_experiments.campaign.engine import DISK_LIMIT, output_of, reserved, run
from husky_experiments.campaign.execution import read_record, read_result, start_experiment
from husky_experiments.campaign.report import PAGE, TABLE
from husky_runtime.domain_locks import free_domain


def main(arguments: list[str]) -> int:
    """Run a campaign, or one of its rows; return 0 only when every run has met its criteria."""
    try:
        if not arguments:
            return _list()
        options = _parser().parse_args(arguments)
        campaign = read_campaign(options.file)
        directory = output_of(options.file, options.output)
        if options.dry_run:
            for each in campaign.runs:
                print(f"{each.row:6d}  {each.command}")
            return 0
        if options.replay is not None:
            return _replay(campaign, options.replay, directory)
        table = run(
            options.file,
            output=directory,
            workers=options.workers,
            scheduler=options.scheduler,
            again=options.again,
            disk=options.disk,
        )
    except CampaignError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        where = f"{error.filename}: {error.strerror}" if error.filename else error
        print(f"error: {where}", file=sys.stderr)
        return 1
    passed = int(table["ok"].sum())
    for _, row in table[~table["ok"].astype(bool)].iterrows():
        print(f"  FAIL row {row['row']}: {row['failed']}")
    print(f"results in {directory}/, page {directory / PAGE}")
    result = {
        "campaign": campaign.title,
        "ok": passed == len(campaign.runs),
        "runs": len(campaign.runs),
        "passed": passed,
        "failed": len(table) - passed,
        "second_attempts": int((table["attempts"] > 1).sum()),
        "table": str(directory / f"{TABLE}.parquet"),
    }
    print(json.dumps(result), flush=True)
    return 0 if result["ok"] else 1


def _list() -> int:
    """Print the campaigns of the tree."""
    print("usage: scripts/campaign.sh FILE.yaml [--option value ...]\n")
    for file in sorted(Path(os.environ["HUSKY_ROOT"], "campaigns").glob("*.yaml")):
        campaign = read_campaign(file)
        print(f"  {f'campaigns/{file.name}':<33} {campaign.title} ({len(campaign.runs)} runs)")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/campaign.sh", description=main.__doc__, formatter_class=HelpFormatter
    )
    parser.add_argument("file", type=Path, help="campaign file (docs/campaigns.md)")
    parser.add_argument(
        "--output", type=Path, help="result directory (default: out/campaigns/ and the file's name)"
    )
    workers = parser.add_mutually_exclusive_group()
    workers.add_argument(
        "--workers", type=int, help="runs at a time (default: as many as this machine carries)"
    )
    workers.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="use the workers of this Dask scheduler"
    )
    parser.add_argument(
        "--again", action="store_true", help="forget the results of an earlier call"
    )
    parser.add_argument(
        "--disk",
        type=float,
        default=DISK_LIMIT,
        metavar="GB",
        help="room for bags, videos and figures that stay",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="list the runs, with the command of each"
    )
    parser.add_argument(
        "--replay", type=int, metavar="ROW", help="run one row again, with video and figures"
    )
    return parser


def _replay(campaign: Campaign, row: int, directory: Path) -> int:
    """Run one row again, with video and figures; return 0 only for the same run, passed."""
    if not 0 <= row < len(campaign.runs):
        raise CampaignError(f"--replay: row {row} is not one of 0 to {len(campaign.runs) - 1}")
    planned = campaign.runs[row]
    output = directory / "replay" / str(row)
    with reserved(directory), free_domain() as domain:
        shutil.rmtree(output, ignore_errors=True)
        code = start_experiment(planned, output, domain, illustrated=True).wait()
        record = read_record(directory / "runs" / planned.name)
    before = record["attempts"][-1]["metrics"].get("trajectory_sha256") if record else None
    now = read_result(output)["metrics"].get("trajectory_sha256")
    same = before == now if before and now else None
    if same is not None:
        print(f"the trajectory is {'' if same else 'NOT '}that of the campaign, to the bit")
    result = {"campaign": campaign.title, "row": row, "ok": code == 0, "same_trajectory": same}
    print(json.dumps(result | {"output": str(output)}), flush=True)
    return code or int(same is False)


if __name__ == "__main__":
    end_by_signals()
    sys.exit(main(sys.argv[1:]))
