"""A campaign file: the runs that it stands for, and what is refused before anything runs."""

import pytest

from husky_experiments.campaign.campaign_file import CampaignError, read_campaign


def rows(**content):
    """The command lines of a campaign of `trot`."""
    campaign = read_campaign({"experiment": "trot", **content})
    return [run.arguments for run in campaign.runs]


def test_every_combination_is_a_run_and_the_last_option_changes_fastest():
    assert rows(matrix={"speed": [0.3, 0.5], "duration": 5, "seed": {"from": 0, "to": 1}}) == [
        ("--speed=0.3", "--duration=5", "--seed=0"),
        ("--speed=0.3", "--duration=5", "--seed=1"),
        ("--speed=0.5", "--duration=5", "--seed=0"),
        ("--speed=0.5", "--duration=5", "--seed=1"),
    ]


def test_blocks_follow_one_another():
    campaign = read_campaign(
        {"experiment": "wair", "matrix": [{"slope": [0, 10], "seed": 0}, {"slope": 90, "blend": 3}]}
    )
    assert [run.label for run in campaign.runs] == [
        "slope_0_seed_0",
        "slope_10_seed_0",
        "slope_90_blend_3",
    ]
    assert campaign.varied == ("slope", "seed", "blend")
    assert campaign.conditions == ("slope", "blend")


@pytest.mark.parametrize(
    ("bounds", "values"),
    [
        ({"from": 2, "to": 7, "step": 2}, ["2", "4", "6"]),
        ({"from": 0.1, "to": 0.4, "step": 0.1}, ["0.1", "0.2", "0.3", "0.4"]),
        ({"from": 3, "to": 3}, ["3"]),
    ],
)
def test_a_range_ends_with_its_last_value(bounds, values):
    assert rows(matrix={"speed": bounds}) == [(f"--speed={value}",) for value in values]


def test_values_become_the_arguments_that_one_would_type():
    campaign = read_campaign(
        {
            "experiment": "beta_dynamic",
            "matrix": {"legs": [[0, 1], [4]], "plant.camera": False, "compliance": None},
        }
    )
    assert [run.arguments for run in campaign.runs] == [
        ("--legs", "0", "1", "--set=plant.camera=false"),
        ("--legs", "4", "--set=plant.camera=false"),
    ]
    flags = read_campaign({"experiment": "wair", "matrix": {"no_thrust": [True, False]}})
    assert [run.arguments for run in flags.runs] == [("--no-thrust",), ()]


def test_a_run_is_known_by_its_options_not_by_its_place():
    before = read_campaign({"experiment": "trot", "matrix": {"seed": 3, "speed": 0.5}}).runs[0]
    after = read_campaign({"experiment": "trot", "matrix": {"speed": [0.4, 0.5], "seed": [3, 4]}})
    assert [run.key == before.key for run in after.runs] == [False, False, True, False]
    swapped = read_campaign({"experiment": "beta_dynamic", "matrix": {"legs": [[0, 1], [1, 0]]}})
    assert swapped.runs[0].key != swapped.runs[1].key


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"experiment": "fly_to_the_moon"}, "no experiment 'fly_to_the_moon'; there are "),
        ({"matrx": {}}, "unknown key 'matrx'; there are title, experiment, matrix"),
        ({"matrix": {"speeed": 1}}, "row 0 (--speeed=1): unrecognized arguments"),
        ({"matrix": {"speed": [0.5, "fast"]}}, "row 1 (--speed=fast): argument --speed: invalid"),
        ({"matrix": {"see": 1}}, "row 0 (--see=1): unrecognized arguments"),
        ({"matrix": {"compliance": 5}}, "0 for a stiff frame, or 10 to 40 Hz"),
        ({"matrix": {"speed": True}}, "row 0 (--speed): argument --speed: expected one argument"),
        ({"matrix": {"speed=1": True}}, "'speed=1' is no name of an option"),
        ({"matrix": {"plant.terrain": "a\nb"}}, "has characters that cannot be printed"),
        ({"matrix": {"plant.terrain": [["a", "b"]]}}, "takes one value in a run, no list"),
        ({"matrix": {"seed": []}}, "seed has an empty list"),
        ({"matrix": {"seed": {"from": 3, "to": 1}}}, "from 3 to 1 by 1 is no range"),
        ({"matrix": {"seed": {"from": 0, "to": 1, "step": 0}}}, "step must be above 0"),
        ({"matrix": {"seed": {"from": 0, "to": 1e9}}}, "no more than 100000 values"),
        ({"matrix": {"seed": {"count": 3}}}, "a range has the numbers from, to"),
        ({"matrix": {"speed": [{"a": 1}]}}, "speed: {'a': 1} is no number, text"),
        ({"matrix": {"output": "here"}}, "output is set by the campaign itself"),
        ({"matrix": {"set": "plant.seed=3"}}, "write NODE.PARAMETER: value"),
        ({"matrix": {"seed": [1, 1]}}, "rows 0 and 1 are the same run"),
        ({"matrix": []}, "matrix: no runs"),
        ({"matrix": [3]}, "a mapping of options to values"),
        ({"keep": "some"}, "keep: 'some' is not one of failed, all, none"),
        ({"retry": 3}, "retry: 3 is not one of failed, errors, never"),
        ({"timeout": -1}, "timeout: -1 is no time above 0"),
        ({"timeout": 10**400}, "and below 1e9"),
        ({"metrics": "falls"}, "metrics: a list of names"),
    ],
)
def test_a_wrong_campaign_is_refused_with_what_is_allowed(change, said):
    with pytest.raises(CampaignError) as error:
        read_campaign({"experiment": "trot", "matrix": {"seed": 0}, **change})
    assert said in str(error.value)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "experiment: trot\n",
        "a: [",
        b"\xff\xfe",
        "experiment: trot\nmatrix: {seed: 0, seed: [1, 2]}\n",
        "experiment: trot\nmatrix: {seed: 2026-13-45}\n",
    ],
)
def test_a_file_that_is_none_is_named(content, tmp_path):
    file = tmp_path / "c.yaml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(CampaignError, match=r"c\.yaml"):
        read_campaign(file)
    with pytest.raises(CampaignError, match=r"none\.yaml: No such file"):
        read_campaign(tmp_path / "none.yaml")
