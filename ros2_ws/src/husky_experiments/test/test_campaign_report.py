"""Table, summary and page of a campaign, from the records of its runs."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from husky_experiments.campaign.campaign_file import read_campaign
from husky_experiments.campaign.report import make_table, summarise, write_report

CAMPAIGN = read_campaign(
    {"experiment": "wair", "matrix": {"slope": [0, 45], "seed": {"from": 0, "to": 3}}}
)
SPEEDS = [[0.24, 0.25, 0.26, 0.27], [0.20, 0.22, 0.10, 0.21]]
"""By slope and seed; below 0.2 is too slow."""


def attempt(number, speed, error=""):
    ok = speed >= 0.2 and not error
    return {
        "directory": f"attempt_{number}",
        "ok": ok,
        "error": error,
        "wall_s": 1.0,
        "metrics": {} if error else {"mean_speed": speed, "by_leg": {"left": 1}, "all": [1, 2]},
        "criteria": {"mean_speed": {"value": speed, "bound": ">= 0.2", "ok": speed >= 0.2}},
    }


@pytest.fixture
def records():
    speeds = np.ravel(SPEEDS)
    made = {
        run.row: {
            "host": "here",
            "version": "v1",
            "attempts": [attempt(n, float(speed)) for n in ((1,) if speed >= 0.2 else (1, 2))],
        }
        for run, speed in zip(CAMPAIGN.runs, speeds, strict=True)
    }
    made[1]["attempts"].insert(0, attempt(1, 0.25, error="the plant has ended"))
    return made


def test_the_table_has_a_row_for_each_run_and_a_column_for_each_option_and_metric(records):
    table = make_table(CAMPAIGN, dict(reversed(records.items())))
    assert list(table["row"]) == list(range(8))
    assert list(table["slope"]) == [0] * 4 + [45] * 4
    assert list(table["mean_speed"]) == list(np.ravel(SPEEDS))
    assert (table["by_leg.left"] == 1).all() and (table["all"] == "[1, 2]").all()
    assert list(table["ok"]) == [True] * 6 + [False, True]
    assert list(table["attempts"]) == [1, 2, 1, 1, 1, 1, 2, 1]
    assert table["failed"][1] == "the plant has ended; then: passed"
    assert table["failed"][6] == "mean_speed = 0.1 (>= 0.2)"
    assert table["directory"][6] == f"runs/{CAMPAIGN.runs[6].name}/attempt_2"


def test_intervals_are_those_of_scipy(records):
    summary = summarise(make_table(CAMPAIGN, records), CAMPAIGN.conditions, ["mean_speed"])
    assert list(summary["slope"]) == [0, 0, 45, 45]
    share, speed = summary.iloc[2], summary.iloc[3]
    test = stats.ttest_1samp(SPEEDS[1], 0.0).confidence_interval(0.95)
    assert (speed["low"], speed["high"]) == pytest.approx((test.low, test.high))
    assert (speed["least"], speed["greatest"]) == (0.10, 0.22)
    # Newcombe (1998), method 3, by hand: 3 of 4.
    z, p, n = stats.norm.ppf(0.975), 0.75, 4
    middle, reach = p + z**2 / 2 / n, z * np.sqrt(p * (1 - p) / n + z**2 / 4 / n**2)
    expected = ((middle - reach) / (1 + z**2 / n), (middle + reach) / (1 + z**2 / n))
    assert (share["mean"], share["low"], share["high"]) == pytest.approx((0.75, *expected))


def test_one_run_has_no_interval_and_none_has_no_mean(records):
    records[5]["attempts"] = [attempt(1, 0.2, error="gone")]
    del records[4], records[6], records[7]
    table = make_table(CAMPAIGN, records)
    table.loc[table["slope"] == 45, "mean_speed"] = np.nan
    summary = summarise(table, CAMPAIGN.conditions, ["mean_speed"]).set_index(["slope", "metric"])
    assert summary.loc[(45, "mean_speed"), "n"] == 0
    assert np.isnan(summary.loc[(45, "mean_speed"), "mean"])
    assert summary.loc[(0, "mean_speed"), "n"] == 4


def test_an_option_that_a_run_leaves_out_is_a_condition_of_its_own():
    matrix = [{"slope": [0, 45], "seed": [1, 2]}, {"slope": 45, "lose": "fan", "seed": [1, 2]}]
    mixed = read_campaign({"experiment": "wair", "matrix": matrix})
    made = {
        run.row: {"host": "", "version": "", "attempts": [attempt(1, 0.3)]} for run in mixed.runs
    }
    summary = summarise(make_table(mixed, made), mixed.conditions, [])
    conditions = list(zip(summary["slope"], summary["lose"], summary["n"], strict=True))
    assert conditions == [(0, "default", 2), (45, "default", 2), (45, "fan", 2)]


def test_the_page_shows_failures_first_and_links_their_directories(records, tmp_path):
    table = write_report(CAMPAIGN, records, tmp_path)
    page = (tmp_path / "index.html").read_text()
    failed, unsteady, every = (
        page.index(f"<h2>{title}</h2>")
        for title in ("Failed", "Passed at the second attempt", "All runs")
    )
    assert failed < unsteady < every
    assert f'href="runs/{CAMPAIGN.runs[6].name}/attempt_2/"' in page[failed:unsteady]
    assert "the plant has ended" in page[unsteady:every]
    assert all(run.name in page[every:] for run in CAMPAIGN.runs)
    assert {f.name for f in (tmp_path / "figures").iterdir()} == {"ok.png", "mean_speed.png"}
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "runs.parquet"), table)
    read = pd.read_csv(tmp_path / "runs.csv", keep_default_na=False)
    pd.testing.assert_frame_equal(read, table, check_dtype=False)


def test_a_campaign_without_a_finished_run_has_an_empty_table(tmp_path):
    table = write_report(CAMPAIGN, {}, tmp_path)
    assert table.empty and {"row", "ok", "slope", "seed"} <= set(table.columns)
    assert "0 of 8 runs done" in (tmp_path / "index.html").read_text()


def test_odd_names_and_numbers_stay_text(records, tmp_path):
    records[0]["attempts"][0]["metrics"]["a$b$_{"] = 1
    records[1]["attempts"][-1]["metrics"]["mean_speed"] = 10**30
    table = write_report(replace(CAMPAIGN, metrics=("a$b$_{", "mean_speed")), records, tmp_path)
    assert (tmp_path / "figures" / "a$b$_{.png").is_file()
    assert table["attempts"].sum() == 10


def test_markup_in_a_message_stays_text(records, tmp_path):
    records[0]["attempts"] = [attempt(1, 0.25, error="<script>alert(1)</script>")]
    write_report(CAMPAIGN, records, tmp_path)
    assert "<script>alert" not in (tmp_path / "index.html").read_text()
