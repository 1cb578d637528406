"""Report of a campaign: table of its runs, summary with confidence intervals, figures, page."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
from scipy import stats

from husky_experiments.campaign.campaign_file import Campaign, PlannedRun
from husky_experiments.campaign.execution import Record
from husky_experiments.figures.campaign import draw_summary
from husky_runtime.stored_file import write_atomically

TABLE, SUMMARY, PAGE = "runs", "summary", "index.html"
"""Names of the files, the first two without their endings."""
OUTCOME = "ok"
"""Column of whether a run has met its criteria; its mean is the share of runs that have."""
CONFIDENCE = 0.95
"""Of the intervals: Student's t of a mean, Wilson's of a share."""
_FIRST = ("row", OUTCOME, "attempts", "failed")
_LAST = ("wall_s", "host", "version", "directory")
"""First and last columns of the table."""
_FAILURE_NAMES = ("error", "carried_through")
"""Metric and criterion of a run without a result: column `failed` has them."""


def write_report(
    campaign: Campaign, records: Mapping[int, Record], directory: Path
) -> pd.DataFrame:
    """Write table, summary, figures and page of the runs that are done; return the table.

    Args:
        campaign: all that was to be done.
        records: of the runs that are done, by row.
        directory: of the campaign.
    """
    table = make_table(campaign, records)
    summary = summarise(table, campaign.conditions, campaign.metrics or _criteria(records))
    write_atomically(directory / f"{TABLE}.parquet", table.to_parquet(index=False))
    table.to_csv(directory / f"{TABLE}.csv", index=False)
    summary.to_csv(directory / f"{SUMMARY}.csv", index=False)
    shutil.rmtree(directory / "figures", ignore_errors=True)
    by_metric = [] if summary.empty else summary.groupby("metric", sort=False)
    figures = [
        draw_summary(rows, campaign.conditions, directory / "figures") for _, rows in by_metric
    ]
    page = _page(campaign, records, summary, [path.relative_to(directory) for path in figures])
    write_atomically(directory / PAGE, page.encode())
    return table


# The table --------------------------------------------------------------------------------------
def make_table(campaign: Campaign, records: Mapping[int, Record]) -> pd.DataFrame:
    """Return one row a run, in the order of the matrix, with the metrics of its last attempt.

    Columns: `row`, `ok`, `attempts`, `failed` (criteria that do not hold, or the error; of a run
    that passed at its second attempt those of the first), the options of the matrix (none where a
    run takes the default), metrics and values of criteria, `wall_s`, `host`, `version`,
    `directory`.
    """
    options = dict.fromkeys(name for run in campaign.runs for name in run.options)
    rows = [options | _row(campaign.runs[row], records[row]) for row in sorted(records)]
    table = pd.DataFrame(rows, columns=None if rows else [*_FIRST, *options, *_LAST])
    for name in table.columns:
        values = [None if pd.isna(value) else value for value in table[name]]
        values = [str(v) if isinstance(v, int) and abs(v) >= 2**63 else v for v in values]
        kinds = {type(value) for value in values} - {type(None)}
        if len(kinds) > 1 and kinds != {int, float}:  # Parquet wants one kind a column
            table[name] = [None if value is None else str(value) for value in values]
    middle = [name for name in table.columns if name not in (*_FIRST, *_LAST)]
    return table[[*_FIRST, *middle, *_LAST]]


def _row(run: PlannedRun, record: Record) -> dict[str, Any]:
    last = record["attempts"][-1]
    options = {
        name: " ".join(map(str, value)) if isinstance(value, tuple) else value
        for name, value in run.options.items()
    }
    values = last["metrics"] | {name: each["value"] for name, each in last["criteria"].items()}
    for name in _FAILURE_NAMES:
        values.pop(name, None)
    row = {"row": run.row} | options
    row |= {OUTCOME: last["ok"], "attempts": len(record["attempts"]), "failed": _failures(record)}
    row |= {name: value for name, value in _flat(values) if name not in row}
    directory = f"runs/{run.name}/{last['directory']}".rstrip("/")
    return row | {
        "wall_s": round(sum(attempt["wall_s"] for attempt in record["attempts"]), 2),
        "host": record["host"],
        "version": record["version"],
        "directory": directory,
    }


def _failures(record: Record) -> str:
    """Return the failures of the first attempt, and how the second differed."""
    failures = [failure_of(attempt) for attempt in record["attempts"]]
    if len(failures) == 1 or failures[0] == failures[1]:
        return failures[0]
    return f"{failures[0]}; then: {failures[1] or 'passed'}"


def failure_of(attempt: Record) -> str:
    """Return why an attempt failed, "" where it has not."""
    unmet = [
        f"{name} = {each['value']} ({each['bound']})"
        for name, each in attempt["criteria"].items()
        if not each["ok"] and name not in _FAILURE_NAMES
    ]
    return str(attempt["error"]) or ", ".join(unmet)


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the scalars of nested metrics, named by their path; lists as JSON."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", json.dumps(value) if isinstance(value, list) else value


# The summary ------------------------------------------------------------------------------------
def summarise(
    table: pd.DataFrame, conditions: Sequence[str], metrics: Sequence[str]
) -> pd.DataFrame:
    """Return one row for each condition and metric, over the seeds.

    Columns: the conditions, `metric`, `n` (runs that have a value), `mean`, `low` and `high` (95 %
    interval of the mean; of `ok` that of the share), `least`, `greatest`.

    Args:
        table: of the runs.
        conditions: options to group by.
        metrics: beside `ok`; those that the table does not have are left out.
    """
    by = [name for name in conditions if name in table.columns]
    rows = []
    for condition, group in table.groupby(by, sort=False, dropna=False) if by else [((), table)]:
        for metric in dict.fromkeys((OUTCOME, *metrics)):
            if metric in table.columns:
                values = pd.to_numeric(group[metric], errors="coerce").dropna().to_numpy(float)
                chosen = {
                    name: "default" if pd.isna(value) else value
                    for name, value in zip(by, condition, strict=True)
                }
                rows.append(chosen | {"metric": metric} | _statistics(values, metric == OUTCOME))
    return pd.DataFrame(rows)


def _criteria(records: Mapping[int, Record]) -> list[str]:
    """Return the names of the criteria of all runs."""
    found = [name for record in records.values() for name in record["attempts"][-1]["criteria"]]
    return [name for name in dict.fromkeys(found) if name not in _FAILURE_NAMES]


def _statistics(values: np.ndarray[Any, Any], share: bool) -> dict[str, float]:
    """Return size, mean, interval and extremes of a sample."""
    count = len(values)
    if not count:
        return {"n": 0} | dict.fromkeys(("mean", "low", "high", "least", "greatest"), np.nan)
    mean, low, high = float(values.mean()), np.nan, np.nan
    if share:
        interval = stats.binomtest(int(values.sum()), count).proportion_ci(CONFIDENCE, "wilson")
        low, high = interval.low, interval.high
    elif count > 1:
        error = float(stats.sem(values))
        low, high = stats.t.interval(CONFIDENCE, count - 1, mean, error) if error else (mean, mean)
    return {
        "n": count,
        "mean": mean,
        "low": float(low),
        "high": float(high),
        "least": float(values.min()),
        "greatest": float(values.max()),
    }


# The page ---------------------------------------------------------------------------------------
def _page(
    campaign: Campaign,
    records: Mapping[int, Record],
    summary: pd.DataFrame,
    figures: list[Path],
) -> str:
    """Return the page: failures first, then summary, figures and all runs, with directories."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("husky_experiments", "campaign"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    runs = [
        {
            "run": campaign.runs[row],
            "record": records[row],
            "ok": records[row]["attempts"][-1]["ok"],
            "failures": [failure_of(attempt) for attempt in records[row]["attempts"]],
        }
        for row in sorted(records)
    ]
    return environment.get_template("page.html").render(
        campaign=campaign,
        runs=runs,
        failed=[each for each in runs if not each["ok"]],
        unsteady=[each for each in runs if each["ok"] and len(each["failures"]) > 1],
        shown=campaign.varied,
        summary=summary.to_dict("records"),
        conditions=campaign.conditions,
        figures=figures,
    )
