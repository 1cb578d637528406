"""What an experiment's command line refuses, before anything is started or removed."""

import pytest

from husky_experiments.__main__ import main
from husky_experiments.session import SessionError


def test_an_output_directory_with_something_else_in_it_is_left_alone(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("years of work")
    assert main(["stand", "--output", str(tmp_path)]) == 2
    assert "holds something else than an earlier run" in capsys.readouterr().err
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_an_unknown_node_is_refused_with_those_there_are(tmp_path, capsys):
    output = tmp_path / "run"
    assert main(["stand", "--output", str(output), "--set", "plnat.seed=3"]) == 1
    said = capsys.readouterr().out
    assert "'plnat'" in said and "low_level_controller" in said
    assert (output / "result.json").exists()
    # What an earlier run has left, whole or not, makes room for the next.
    (output / "result.json").unlink()
    assert main(["stand", "--output", str(output), "--set", "plnat.seed=3"]) == 1


@pytest.mark.parametrize("text", ["seed=3", "plant.seed", "plant.=3"])
def test_a_setting_that_is_none_is_refused(text, capsys):
    with pytest.raises(SystemExit):
        main(["stand", "--set", text])
    assert "NODE.PARAMETER=VALUE" in capsys.readouterr().err


def test_an_unknown_experiment_is_refused_with_those_there_are(capsys):
    assert main(["fly_to_the_moon"]) == 2
    assert "trot" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["9", "41", "-1", "soft"])
def test_a_frame_that_no_robot_has_is_refused(text, capsys):
    with pytest.raises(SystemExit):
        main(["stand", f"--compliance={text}"])
    said = capsys.readouterr().err
    assert f"--compliance: {text} is not allowed: 0 for a stiff frame, or 10 to 40 Hz" in said


def test_a_frame_that_is_given_twice_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["stand", "--compliance", "15", "--set", "plant.frame_frequency=20"])
    assert "--set plant.frame_frequency is given too" in capsys.readouterr().err


@pytest.mark.parametrize(("asked", "got"), [([], None), (["--compliance", "15"], 15.0)])
def test_the_plant_alone_is_told_how_the_frame_bends(asked, got, monkeypatch, tmp_path):
    started = []

    class Started:
        trajectory_sha256 = ""

        def __init__(self, where, settings, **_):
            started.append(settings)

        def __enter__(self):
            raise SessionError("it is enough to know how it would be started")

        def __exit__(self, *exception):
            pass

    monkeypatch.setattr("husky_experiments.run.Session", Started)
    assert main(["stand", "--output", str(tmp_path / "out"), *asked]) == 1
    (settings,) = started
    assert settings["plant"].get("frame_frequency") == got
    assert not [
        node for node in settings if node != "plant" and "frame_frequency" in settings[node]
    ]
