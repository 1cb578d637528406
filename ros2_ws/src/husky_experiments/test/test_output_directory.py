"""Results replace those of an earlier run, nothing else, and not before the run begins."""

import json
import os
import stat

import pytest

from husky_experiments.output_directory import OutputDirectory


def written(path):
    """Files and links below a directory but for the list: what they hold, or where they point."""
    return {
        str(each.relative_to(path)): os.readlink(each)
        if each.is_symlink()
        else each.read_text("utf-8")
        for each in path.rglob("*")
        if (each.is_symlink() or each.is_file()) and each.name != "files.txt"
    }


def run(path, files, *, begins=True):
    """A run that writes some of its files before it has begun, as logs are, and others behind."""
    directory = OutputDirectory(path)
    (first, *rest) = files.items()
    write(directory.work, *first)
    if begins:
        directory.begun()
        for each in rest:
            write(directory.work, *each)
    directory.leave()
    assert not directory.work.exists()
    return directory


def write(path, name, text):
    (path / name).parent.mkdir(parents=True, exist_ok=True)
    (path / name).write_text(text, "utf-8")


def state_of(path):
    found = {each: each.lstat() for each in path.rglob("*")}
    return {e: (s.st_ino, s.st_mode, s.st_size, s.st_mtime_ns) for e, s in found.items()}


def kill(directory):
    """Do what the kernel does for a process that is killed."""
    os.close(directory._lock)


FIRST = {"logs/plant.log": "1", "bag/metadata.yaml": "1", "result.json": "1"}
SECOND = {"logs/plant.log": "2", "bag/metadata.yaml": "2"}
VERSION_0 = json.dumps({"experiment": "trot", "ok": True, "metrics": {}, "criteria": {}})


def test_a_run_replaces_the_files_of_the_one_before_and_keeps_all_others(tmp_path):
    path = tmp_path / "out"
    run(path, FIRST)
    write(path, "notes.txt", "mine")
    write(path, "bag/ümlaut/notes.txt", "mine too")
    run(path, SECOND)
    mine = {"notes.txt": "mine", "bag/ümlaut/notes.txt": "mine too"}
    assert written(path) == {**SECOND, **mine}
    run(path, FIRST)
    assert written(path) == {**FIRST, **mine}


def test_what_is_written_while_the_run_is_under_way_is_not_of_the_run(tmp_path):
    directory = OutputDirectory(tmp_path)
    write(directory.work, "result.json", "1")
    directory.begun()
    write(tmp_path, "notes.txt", "mine")
    directory.leave()
    run(tmp_path, SECOND)
    assert written(tmp_path) == {**SECOND, "notes.txt": "mine"}


def test_a_run_that_does_not_begin_leaves_all_as_it_was(tmp_path):
    """Links, empty and private directories as well."""
    path = tmp_path / "out"
    run(path, FIRST)
    write(path, "private/notes.txt", "mine")
    (path / "private").chmod(0o700)
    (path / "empty").mkdir(mode=0o555)
    (path / "link").symlink_to("/etc")
    (path / "dangling").symlink_to("nowhere")
    before = state_of(path)
    assert run(path, SECOND, begins=False).as_it_was
    assert state_of(path) == before
    run(path, SECOND)
    assert written(path) == {
        **SECOND,
        "private/notes.txt": "mine",
        "link": "/etc",
        "dangling": "nowhere",
    }
    assert stat.S_IMODE((path / "private").stat().st_mode) == 0o700 and (path / "empty").is_dir()


def test_the_first_run_leaves_what_it_has_also_if_it_does_not_begin(tmp_path):
    assert not run(tmp_path / "out", FIRST, begins=False).as_it_was
    assert written(tmp_path / "out") == {"logs/plant.log": "1"}


@pytest.mark.parametrize("begins", [True, False])
def test_what_a_killed_run_has_left_is_kept_apart(tmp_path, begins):
    path = tmp_path / "out"
    run(path, FIRST)
    write(path, "notes.txt", "mine")
    killed = OutputDirectory(path)
    write(killed.work, "logs/plant.log", "killed")
    if begins:
        killed.begun()
    kill(killed)
    assert str(path / "left_1") in run(path, SECOND).notice
    left = {"left_1/logs/plant.log": "killed", "notes.txt": "mine"}
    assert written(path) == {**SECOND, **left}
    assert run(path, FIRST).notice == ""
    assert written(path) == {**FIRST, **left}


@pytest.mark.parametrize("operation", ["unlink", "rmdir", "mkdir", "rename"])
@pytest.mark.parametrize("after", range(4))
def test_a_run_that_is_killed_while_it_replaces_files(tmp_path, monkeypatch, operation, after):
    """The next run goes on from there, and nothing of somebody else is lost."""
    path = tmp_path / "out"
    run(path, FIRST)
    write(path, "notes.txt", "mine")
    killed = OutputDirectory(path)
    new = {"logs/other.log": "new", "figures/a.png": "new", "b.png": "new", "c.png": "new"}
    for each in new.items():
        write(killed.work, *each)
    killed.begun()

    class Killed(BaseException):
        pass

    left, genuine = [after], getattr(type(path), operation)

    def counted(self, *arguments, **options):
        left[0] -= 1
        if left[0] < 0:
            raise Killed
        return genuine(self, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(type(path), operation, counted)
        try:
            killed.leave()
        except Killed:
            pass
    run(path, SECOND)
    found = written(path)
    assert {name: found[name] for name in (*SECOND, "notes.txt")} == {**SECOND, "notes.txt": "mine"}
    assert set(found) <= {*SECOND, "notes.txt", *(f"left_1/{name}" for name in new)}


def test_two_runs_at_once_are_refused(tmp_path):
    first = OutputDirectory(tmp_path)
    with pytest.raises(BlockingIOError, match="another run writes into"):
        OutputDirectory(tmp_path)
    write(first.work, "result.json", "1")
    first.begun()
    first.leave()
    assert written(tmp_path) == {"result.json": "1"}
    run(tmp_path, SECOND)


def test_what_an_earlier_version_has_left_is_kept_apart_once_the_run_begins(tmp_path):
    before = {"result.json": VERSION_0, "notes.txt": "mine"}
    for each in before.items():
        write(tmp_path, *each)
    run(tmp_path, SECOND, begins=False)
    assert written(tmp_path) == before
    run(tmp_path, SECOND)
    assert written(tmp_path) == {**SECOND, **{f"left_1/{n}": t for n, t in before.items()}}


@pytest.mark.parametrize("name", ["result.json", "logs/plant.log", "logs", "bag"])
def test_a_file_of_somebody_else_by_a_name_of_ours_is_kept_beside(tmp_path, name):
    run(tmp_path / "out", {"video.mp4": "1"})
    write(tmp_path / "out", name, "mine")
    run(tmp_path / "out", FIRST)
    assert written(tmp_path / "out") == {**FIRST, f"{name}.kept": "mine"}
    write(tmp_path / "out", "result.json", "changed by hand")
    run(tmp_path / "out", FIRST)
    assert "changed by hand" in written(tmp_path / "out").values()


def test_results_that_were_moved_and_linked_stay_where_they_are(tmp_path):
    path, archive = tmp_path / "out", tmp_path / "archive"
    run(path, FIRST)
    (path / "bag").rename(archive)
    (path / "bag").symlink_to(archive)
    run(path, SECOND)
    assert written(archive) == {"metadata.yaml": "1"}
    assert written(path) == {**SECOND, "bag.kept": str(archive)}


@pytest.mark.parametrize(
    "files",
    [
        {"notes.txt": "mine"},
        {"notes.txt": "mine", "files.txt": "notes.txt\n"},
        {"main.py": "mine", "result.json": "{}"},
        {"main.py": "mine", "result.json": "no JSON"},
    ],
)
def test_a_directory_of_something_else_is_refused(tmp_path, files):
    for each in files.items():
        write(tmp_path, *each)
    with pytest.raises(FileExistsError, match="holds something else than an earlier run"):
        OutputDirectory(tmp_path)
    assert {each.name: each.read_text("utf-8") for each in tmp_path.iterdir()} == files


def test_a_list_that_names_files_elsewhere_removes_none(tmp_path):
    write(tmp_path, "elsewhere.txt", "mine")
    run(tmp_path / "out", FIRST)
    found = (tmp_path / "elsewhere.txt").stat()
    listed = tmp_path / "out/files.txt"
    stamp = f"{found.st_mtime_ns} {found.st_size}"
    names = ("../elsewhere.txt", f"{tmp_path}/elsewhere.txt", "", "logs")
    lines = [listed.read_text("utf-8").splitlines()[0], *(f"{stamp} {name}" for name in names)]
    listed.write_bytes("\n".join([*lines, "no line", ""]).encode() + b"\xff\xfe\n")
    run(tmp_path / "out", SECOND)
    assert written(tmp_path)["elsewhere.txt"] == "mine"


def test_names_may_be_any_bytes(tmp_path):
    name = os.fsdecode(b"\xff.log")
    run(tmp_path, {name: "1"})
    run(tmp_path, SECOND)
    assert written(tmp_path) == SECOND
