"""An interrupted diagnosis goes on where it was and ends with the same numbers, whatever became of its file."""

import errno
import hashlib
import io
import os
import pickle
from dataclasses import replace

import gap_search
import numpy as np
import pytest
from numpy_machine import record

from fpjax import InputError, load_model
from fpjax.gap import EFFECTS
from fpjax.gap.fit import saved_fits as module
from fpjax.gap.fit.candidate import Start
from fpjax.gap.fit.saved_fits import SavedFits, key_of
from fpjax.gap.select.decision import decide
from fpjax.gap.verb import make_search
from fpjax.simulation.precision import double_precision

FEW = tuple(effect for effect in EFFECTS if effect.name in ("constant_torque", "presliding", "quadratic_drag"))
KEY = "a" * 64


@pytest.fixture(scope="module")
def log():
    return record(seconds=3.0, extra=lambda *_: 0.1)


@pytest.fixture
def model():
    with double_precision():
        return load_model(gap_search.MODEL)


def decided(log, model, keep=None, until=""):
    """The decision between a few effects; an interrupt where the stage `until` begins."""

    def stage(name, share):
        if until and name.startswith(until):
            raise KeyboardInterrupt

    with double_precision():
        try:
            return decide(make_search([log], [], model, FEW, keep), stage)
        finally:
            if keep is not None:
                keep.close()


def same(one, other):
    assert one.chosen.fit.names == other.chosen.fit.names
    assert one.shares == other.shares
    for a, b in zip(one.singles, other.singles, strict=True):
        assert a.fit.candidate.vector.tobytes() == b.fit.candidate.vector.tobytes()
        assert (a.evidence, a.left) == (b.evidence, b.left)
        for mine, its in zip(a.fit.missing, b.fit.missing, strict=True):
            assert mine.tobytes() == its.tobytes()


@pytest.mark.long
def test_an_interrupted_decision_goes_on_and_ends_with_the_same_bits(log, model, tmp_path):
    path = tmp_path / "kept"
    whole = decided(log, model)
    with pytest.raises(KeyboardInterrupt):
        decided(log, model, SavedFits(path), "what each")
    content = path.read_bytes()
    again = SavedFits(path)
    same(decided(log, model, again), whole)
    assert again.taken >= 4  # two bases, the nominal model, every effect
    # Damaged anywhere, the whole answers before it are taken and the rest is computed again.
    for damage in (content[: len(content) // 2], content[:-1], flipped(content, len(content) // 2)):
        path.write_bytes(damage)
        part = SavedFits(path)
        same(decided(log, model, part), whole)
        assert 0 < part.taken < again.taken
    # Of another log nothing is taken.
    path.write_bytes(content)
    other = SavedFits(path)
    decided(record(seconds=3.2, extra=lambda *_: 0.1), model, other)
    assert other.taken == 0


def flipped(content, place):
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


class Bare:
    effects = ()


def asked(path, *questions, key=KEY):
    """What was computed, of the questions that a run asks in order; None for a file that it did not get."""
    computed, one = [], SavedFits(path)
    one.begin(key)
    for question in questions:

        def work(question=question):
            computed.append(question)
            return np.arange(3.0) + len(question)

        found = one.answer(question, work, Bare())
        assert found.tolist() == (np.arange(3.0) + len(question)).tolist()
    one.close()
    return computed


def test_answers_are_taken_in_their_order(tmp_path):
    path = tmp_path / "kept"
    assert asked(path, "a", "bb") == ["a", "bb"]
    assert asked(path, "a", "bb", "ccc") == ["ccc"]
    # From the first question that is another one, nothing is.
    assert asked(path, "a", "dddd", "ccc") == ["dddd", "ccc"]
    assert asked(path, "a", "dddd", "ccc") == []
    assert asked(path, "a", key="b" * 64) == ["a"]


@pytest.mark.parametrize("cut", [1, 20, 45, 60, 90])
def test_a_half_written_end_is_computed_again(tmp_path, cut):
    path = tmp_path / "kept"
    asked(path, "a", "bb", "ccc")
    path.write_bytes(path.read_bytes()[:-cut])
    assert asked(path, "a", "bb", "ccc") == ["ccc"]
    assert asked(path, "a", "bb", "ccc") == []


@pytest.mark.parametrize("content", [b"", b"not mine", b"\0" * 5000])
def test_any_other_file_is_replaced(tmp_path, content):
    path = tmp_path / "kept"
    path.write_bytes(content)
    assert asked(path, "a") == ["a"]
    assert asked(path, "a") == []


class Evil:
    def __reduce__(self):
        return os.mkdir, ("ran",)


def test_a_file_runs_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module._Writer, "dump", lambda self, found: self.stream.write(pickle.dumps(Evil())))
    monkeypatch.setattr(
        module._Writer, "__init__", lambda self, stream, search: setattr(self, "stream", stream), raising=True
    )
    asked(tmp_path / "kept", "a")
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    assert asked(tmp_path / "kept", "a") == ["a"]
    assert not (tmp_path / "ran").exists()
    # Nor does one whose question is evil, and it is no traceback either.
    part = pickle.dumps((Evil(), b""))
    head = module._HEAD.pack(len(part), hashlib.sha256(part).digest())
    (tmp_path / "kept").write_bytes(module._MAGIC + KEY.encode() + b"\n" + head + part)
    assert asked(tmp_path / "kept", "a") == ["a"]
    assert not (tmp_path / "ran").exists()
    with pytest.raises(pickle.UnpicklingError, match="no part of a fit"):
        module._Plain(io.BytesIO(pickle.dumps(Evil()))).load()


def test_numbers_are_the_same_bits_and_one_array_stays_one():
    one = np.asfortranarray(np.random.default_rng(0).standard_normal((3, 2)))
    written = {"one": one, "again": one, "every": one[:, ::2], "flat": np.float64(0.1), "yes": np.array(True)}
    stream = io.BytesIO()
    module._Writer(stream, Bare()).dump(written)
    found = module._Reader(io.BytesIO(stream.getvalue()), Bare()).load()
    for name, value in written.items():
        assert type(found[name]) is type(value)
        assert (found[name].dtype, found[name].shape) == (value.dtype, value.shape)
        assert found[name].tobytes() == value.tobytes()
    assert found["one"] is found["again"]
    assert found["one"].flags.f_contiguous
    assert found["one"].flags.writeable


class Address:
    def __reduce__(self):
        return np.ndarray, ((1,), np.dtype("O"), b"\0" * 7 + b"\1")


@pytest.mark.parametrize("content", [Address(), np.array([None]), np.arange(3.0)])
def test_bytes_are_never_taken_for_addresses(content):
    with pytest.raises(pickle.UnpicklingError, match="no part of a fit"):
        module._Reader(io.BytesIO(pickle.dumps(content)), Bare()).load()


def test_one_diagnosis_at_a_time_writes_to_a_file(tmp_path):
    path = tmp_path / "kept"
    first = SavedFits(path)
    first.begin(KEY)
    second = SavedFits(path)
    with pytest.raises(InputError, match="still running: wait for it"):
        second.begin(KEY)
    second.discard()  # not its to remove
    assert path.exists()
    first.discard()
    assert not path.exists()


def test_a_full_disk_keeps_nothing_and_is_no_reason_to_stop(tmp_path, monkeypatch):
    path = tmp_path / "kept"
    one = SavedFits(path)
    one.begin(KEY)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(module.os, "write", full)
    assert one.answer("a", lambda: 1.0, Bare()) == 1.0
    assert one.answer("b", lambda: 2.0, Bare()) == 2.0
    assert "No space left" in one.lost
    assert not path.exists()


def test_the_key_follows_log_and_model(log, model):
    key = key_of([log], [], model, FEW)
    assert key == key_of([log], [], model, FEW)
    others = [
        key_of([record(seconds=3.2, extra=lambda *_: 0.1)], [], model, FEW),
        key_of([], [log], model, FEW),
        key_of([log], [], model, FEW[:2]),
        key_of([log], [], load_model(gap_search.MODEL.replace("0.05", "0.06")), FEW),
    ]
    assert len({key, *others}) == 5


def test_a_question_holds_all_that_a_start_does():
    one = Start((), ("inertia",), {"inertia": 0.05})
    others = [replace(one, wide=()), replace(one, values={"inertia": 0.06}), replace(one, or_given=True)]
    assert len({module._of_starts([start]) for start in (one, *others)}) == 4
