"""Results replace those of an earlier run, nothing else, and not before the run begins."""

import pytest

from husky_experiments.output_directory import OutputDirectory


def written(path):
    return {
        str(each.relative_to(path)): each.read_text("utf-8")
        for each in path.rglob("*")
        if each.is_file() and each.name != "files.txt"
    }


def run(path, files, *, begins=True):
    """A run that writes some of its files before it has begun, as logs are, and others behind."""
    directory = OutputDirectory(path)
    (first, *rest) = files.items()
    write(path, *first)
    if begins:
        directory.begun()
        for each in rest:
            write(path, *each)
    directory.leave()
    return directory


def write(path, name, text):
    (path / name).parent.mkdir(parents=True, exist_ok=True)
    (path / name).write_text(text, "utf-8")


FIRST = {"logs/plant.log": "1", "bag/metadata.yaml": "1", "result.json": "1"}
SECOND = {"logs/plant.log": "2", "bag/metadata.yaml": "2"}


def test_a_run_replaces_the_files_of_the_one_before_and_keeps_all_others(tmp_path):
    run(tmp_path / "out", FIRST)
    write(tmp_path / "out", "notes.txt", "mine")
    write(tmp_path / "out", "bag/ümlaut/notes.txt", "mine too")
    run(tmp_path / "out", SECOND)
    mine = {"notes.txt": "mine", "bag/ümlaut/notes.txt": "mine too"}
    assert written(tmp_path / "out") == {**SECOND, **mine}
    run(tmp_path / "out", FIRST)
    assert written(tmp_path / "out") == {**FIRST, **mine}


def test_a_run_that_does_not_begin_leaves_all_as_it_was(tmp_path):
    run(tmp_path / "out", FIRST)
    write(tmp_path / "out", "notes.txt", "mine")
    before = sorted(tmp_path.rglob("*"))
    run(tmp_path / "out", SECOND, begins=False)
    assert written(tmp_path / "out") == {**FIRST, "notes.txt": "mine"}
    assert sorted(tmp_path.rglob("*")) == before
    run(tmp_path / "out", SECOND)
    assert written(tmp_path / "out") == {**SECOND, "notes.txt": "mine"}


def test_the_first_run_leaves_what_it_has_also_if_it_does_not_begin(tmp_path):
    run(tmp_path / "out", FIRST, begins=False)
    assert written(tmp_path / "out") == {"logs/plant.log": "1"}


@pytest.mark.parametrize("begins", [True, False])
def test_what_a_killed_run_has_left_is_kept_apart(tmp_path, begins):
    path = tmp_path / "out"
    run(path, FIRST)
    write(path, "notes.txt", "mine")
    killed = OutputDirectory(path)
    write(path, "logs/plant.log", "killed")
    if begins:
        killed.begun()
    after = run(path, SECOND)
    left = {"left_1/logs/plant.log": "killed", "left_1/.begun": ""}
    notes = "left_1/notes.txt" if begins else "notes.txt"
    assert written(path) == {**SECOND, **left, notes: "mine"}
    assert str(path / "left_1") in after.notice


def test_what_an_earlier_version_has_left_is_kept_apart(tmp_path):
    write(tmp_path, "result.json", "0")
    run(tmp_path, SECOND)
    assert written(tmp_path) == {**SECOND, "left_1/result.json": "0"}


def test_a_file_of_somebody_else_by_a_name_of_ours_is_kept_beside(tmp_path):
    run(tmp_path / "out", {"result.json": "1"})
    write(tmp_path / "out", "logs/plant.log", "mine")
    run(tmp_path / "out", SECOND)
    assert written(tmp_path / "out") == {**SECOND, "logs/plant.log.kept": "mine"}


def test_a_directory_of_something_else_is_refused(tmp_path):
    write(tmp_path, "notes.txt", "mine")
    with pytest.raises(FileExistsError, match="holds something else than an earlier run"):
        OutputDirectory(tmp_path)
    assert written(tmp_path) == {"notes.txt": "mine"}


def test_a_list_that_names_files_elsewhere_removes_none(tmp_path):
    write(tmp_path, "elsewhere.txt", "mine")
    run(tmp_path / "out", FIRST)
    (tmp_path / "out/files.txt").write_text(f"../../elsewhere.txt\n{tmp_path}/elsewhere.txt\n")
    run(tmp_path / "out", SECOND)
    assert (tmp_path / "elsewhere.txt").exists()
