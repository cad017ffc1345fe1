"""The mark of an unfinished folder: what a kill leaves is never taken for one complete run."""

import errno
import json
import os

import pytest

from fpjax import InputError
from fpjax.output import runfile
from fpjax.output.runfile import MARK, RunFile, read_run, refuse_unfinished, whole_file, write_json, write_whole

OTHER = {"process": -1}


def begun(folder, names, command="fpjax simulate"):
    """A run that wrote these outputs and was killed."""
    record = RunFile(folder, command.split())
    for name in names:
        write_json(record.path(name), {"of": command})
    mark = json.loads((folder / MARK).read_text())
    write_json(folder / MARK, mark | OTHER)  # of another process, as after a kill
    return record


def test_a_complete_run_ends_with_run_json_and_without_a_mark(tmp_path):
    record = begun(tmp_path, ["a.json"])
    assert not (tmp_path / "run.json").exists()
    record.write()
    assert not (tmp_path / MARK).exists()
    assert read_run(tmp_path)["outputs"] == ["a.json"]
    refuse_unfinished(tmp_path / "a.json")


@pytest.mark.parametrize("name", ["run.json", MARK])
def test_a_folder_in_the_place_of_a_run_file_is_said_before_anything_is_computed(tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match="is a folder"):
        RunFile(tmp_path, ["fpjax", "simulate"])


def test_the_outputs_of_two_runs_do_not_look_like_one(tmp_path):
    begun(tmp_path, ["a.json", "b.json"], "fpjax first").write()
    begun(tmp_path, ["a.json"], "fpjax second")
    assert not (tmp_path / "run.json").exists()
    with pytest.raises(InputError, match="has not finished"):
        read_run(tmp_path)
    for name in ("a.json", "b.json"):
        with pytest.raises(InputError, match=r"not finished \(fpjax second, begun .*run that again, or delete"):
            refuse_unfinished(tmp_path / name)
    refuse_unfinished(tmp_path / "servo.toml")  # never an output: the user's own
    begun(tmp_path, ["a.json", "b.json"], "fpjax third").write()
    refuse_unfinished(tmp_path / "b.json")


def test_a_result_that_this_run_lacks_is_no_longer_in_the_folder(tmp_path):
    begun(tmp_path, ["diagnosis.json", "learned.toml"]).write()
    (tmp_path / "corrected.toml").write_text("the user's own")
    record = begun(tmp_path, ["diagnosis.json"])
    for name in ("learned.toml", "corrected.toml", "diagnosis.json"):
        record.without(name)
    record.write()
    assert not (tmp_path / "learned.toml").exists()
    assert (tmp_path / "corrected.toml").exists()  # never an output of this folder's runs
    assert (tmp_path / "diagnosis.json").exists()  # this run's
    RunFile(None, ["fpjax"]).without("learned.toml")  # no folder, nothing to remove


def test_what_a_run_left_is_known_after_another_run_in_between(tmp_path):
    begun(tmp_path, ["diagnosis.json", "learned.toml"]).write()
    begun(tmp_path, ["diagnosis.json"], "fpjax resumed").write()
    assert read_run(tmp_path)["earlier"] == ["learned.toml"]
    record = begun(tmp_path, ["diagnosis.json"])
    record.without("learned.toml")
    record.write()
    assert not (tmp_path / "learned.toml").exists()
    assert "earlier" not in read_run(tmp_path)


def test_a_run_that_fails_before_its_first_output_leaves_the_earlier_one(tmp_path):
    begun(tmp_path, ["a.json"]).write()
    before = (tmp_path / "run.json").read_bytes()
    RunFile(tmp_path, ["fpjax", "tune"]).write("bad input")
    assert (tmp_path / "run.json").read_bytes() == before
    refuse_unfinished(tmp_path / "a.json")


def test_an_interrupted_run_stays_marked(tmp_path):
    begun(tmp_path, ["a.json"]).write("interrupted")
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "interrupted"
    with pytest.raises(InputError, match="has not finished"):
        read_run(tmp_path)
    with pytest.raises(InputError, match="has not finished"):
        RunFile(None, []).read(tmp_path / "a.json", "model")


def test_an_interrupt_before_the_first_output_marks_a_folder_without_a_finished_run(tmp_path):
    RunFile(tmp_path, ["fpjax", "diagnose"]).write("interrupted")
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "interrupted"
    assert (tmp_path / MARK).exists()
    begun(tmp_path, ["a.json"]).write()
    before = (tmp_path / "run.json").read_bytes()
    RunFile(tmp_path, ["fpjax", "diagnose"]).write("interrupted")  # the finished one is still that
    assert (tmp_path / "run.json").read_bytes() == before
    assert not (tmp_path / MARK).exists()


def test_a_run_that_ended_badly_is_not_read_as_a_finished_one(tmp_path):
    RunFile(tmp_path, ["fpjax", "tune"]).write("bad input")
    with pytest.raises(InputError, match=r"not completed \(bad input\): run its command again"):
        read_run(tmp_path)


def test_folders_within_an_unfinished_one(tmp_path):
    """A folder for each log: what is whole may be used, what is not may not."""
    record = RunFile(tmp_path, ["fpjax", "diagnose", "--each"])
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_json(record.path(f"{name}/diagnosis.json"), {})
    write_json(tmp_path / "a" / runfile.FINISHED, {})
    mark = json.loads((tmp_path / MARK).read_text())
    write_json(tmp_path / MARK, mark | OTHER)
    refuse_unfinished(tmp_path / "a" / "diagnosis.json")
    with pytest.raises(InputError, match="has not finished"):
        refuse_unfinished(tmp_path / "b" / "diagnosis.json")
    refuse_unfinished(tmp_path / "b" / "servo.toml")


def test_a_mark_that_cannot_be_read_still_counts(tmp_path):
    begun(tmp_path, ["a.json"]).write()
    (tmp_path / MARK).write_text("{")
    with pytest.raises(InputError, match="has not finished"):
        read_run(tmp_path)


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_what_stops_a_writing_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, error):
    path = tmp_path / "a.json"
    write_whole(path, "old")

    def stop(_):
        raise error

    monkeypatch.setattr(runfile.os, "fsync", stop)
    with pytest.raises(InputError if isinstance(error, OSError) else KeyboardInterrupt):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.json"]

    def half():
        with whole_file(path) as file:
            file.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.json"]
