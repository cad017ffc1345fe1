"""The sweep's folder: kills, damage, other numbers of cores and other owners never change the answer."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import textwrap
import warnings
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from tuning_loops import CONSTANT, SHORT, SINE, THESIS, efp

import fpjax
import tuning
from fpjax import FpjaxWarning, InputError
from tuning import Axis

REPO = Path(__file__).parents[2]
HELPERS = str(REPO / "tests" / "helpers")

sweep_module = sys.modules["tuning.sweep"]  # the name tuning.sweep is the function
AXES = (Axis("observer.gain_1", 1.0, 1e3, 7), Axis("observer.gain_2", 5.0, 25.0, 5, "linear"))
COMMON = {"axes": AXES, "objective": THESIS, "chunk": 8, **SHORT}
PIECES = 5


def sweep(folder=None, **more):
    return tuning.sweep(efp(150.0), SINE, out=folder, **{**COMMON, **more})


@pytest.fixture(scope="module")
def whole():
    return np.array(sweep().costs)


def chunk(folder, piece):
    return Path(folder) / f"chunk-{piece:07d}.npy"


def zero(path):
    path.write_bytes(bytes(path.stat().st_size))


def flip(path, at=-60, bit=0):
    content = bytearray(path.read_bytes())
    if content:
        content[at % len(content)] ^= 1 << bit
        path.write_bytes(content)


def cut(path, share=0.5):
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def shorten(path):
    """A whole array of the wrong length, as another program might save it."""
    np.save(path, np.zeros((3, 1)))


def single(path):
    np.save(path, np.zeros((8, 1), np.float32))


def pickled(path):
    np.save(path, np.array([{"a": 1}], object), allow_pickle=True)


def exchange(path):
    other = path.with_name("chunk-0000003.npy")
    content = path.read_bytes()
    path.write_bytes(other.read_bytes())
    other.write_bytes(content)


def pipe(path):
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("damage", [zero, flip, cut, shorten, single, pickled, exchange, pipe])
def test_a_damaged_chunk_is_computed_again_and_said_so(damage, tmp_path, whole):
    sweep(tmp_path)
    damage(chunk(tmp_path, 1))
    with pytest.warns(FpjaxWarning, match=r"of 5 chunks in .*chunk-0000001\.npy .*computed again"):
        resumed = sweep(tmp_path, resume=True)
    np.testing.assert_array_equal(resumed.costs, whole)
    again = sweep(tmp_path, resume=True)  # without a warning
    np.testing.assert_array_equal(again.costs, whole)


@pytest.mark.parametrize("damage", [zero, flip, cut, Path.unlink])
def test_a_damaged_manifest_is_written_anew_where_the_chunks_are_of_this_sweep(damage, tmp_path, whole):
    sweep(tmp_path)
    damage(tmp_path / "sweep.json")
    with pytest.warns(FpjaxWarning, match=r"sweep\.json was (damaged|missing)"):
        resumed = sweep(tmp_path, resume=True)
    np.testing.assert_array_equal(resumed.costs, whole)
    damage(tmp_path / "sweep.json")
    with pytest.raises(InputError, match="no chunk beside it is one of this sweep"):
        tuning.sweep(efp(150.0), CONSTANT, out=tmp_path, resume=True, **COMMON)


def test_a_folder_has_one_owner_at_a_time(tmp_path, monkeypatch, whole):
    compute, refused = sweep_module.evaluate_chunk, []

    def met(*arguments):
        with pytest.raises(InputError, match=r"still running \(process \d+") as refusal:
            sweep(tmp_path, resume=True)
        refused.append(str(refusal.value))
        return compute(*arguments)

    monkeypatch.setattr(sweep_module, "evaluate_chunk", met)
    result = sweep(tmp_path)
    assert len(refused) == PIECES
    assert str(os.getpid()) in refused[0]
    np.testing.assert_array_equal(result.costs, whole)


def test_a_sentence_is_said_once(tmp_path):
    sweep(tmp_path)
    with pytest.raises(InputError) as refused:
        sweep(tmp_path)
    assert str(refused.value).count("holds a sweep already") == 1
    assert "cannot be kept" not in str(refused.value)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize(
    "size", [8, pytest.param(100, marks=pytest.mark.long), pytest.param(200, marks=pytest.mark.long), 500]
)
def test_the_costs_are_bit_equal_on_any_number_of_cores(size, dtype):
    axes = (Axis("observer.gain_1", 1.0, 1e3, 50), Axis("observer.gain_2", 5.0, 25.0, 10, "linear"))
    settings = {"objective": THESIS, "dt": 1e-4, "samples": 800}
    loop, reference = (fpjax.astype(part, dtype) for part in (efp(150.0), SINE))
    problem, _, checked = sweep_module._prepare(loop, reference, axes, settings)
    one, *others = (sweep_module.evaluate_chunk(problem, checked, 0, size, 500, workers=n) for n in (1, 2, 3, 7))
    assert one.dtype == dtype
    for other in others:
        np.testing.assert_array_equal(one, other)


def test_a_full_disk_is_one_sentence_and_leaves_nothing_half_written(tmp_path, monkeypatch):
    def full(handle):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("fpjax.output.runfile.os.fsync", full)
        with pytest.raises(InputError, match="No space left on device"):
            sweep(tmp_path)
    assert not list(tmp_path.glob(".*.partial"))
    assert not list(tmp_path.glob("chunk-*"))
    sweep(tmp_path, resume=True)


KILLED = """
    import os, sys; sys.path[:0] = sys.argv[1].split(os.pathsep)
    import jax; jax.config.update("jax_enable_x64", True)
    import os, signal
    from pathlib import Path
    from test_sweep_store import sweep
    replace, count = Path.replace, [0]
    def killed(self, target):
        count[0] += 1
        if count[0] == 4:
            os.kill(os.getpid(), signal.SIGKILL)
        return replace(self, target)
    Path.replace = killed
    sweep(sys.argv[2])
"""


def test_a_killed_sweep_gives_its_folder_back_and_leaves_no_half_file(tmp_path, whole):
    here = os.pathsep.join([os.path.dirname(__file__), HELPERS])
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(REPO), os.environ.get("PYTHONPATH", "")]),
    }
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(KILLED), here, str(tmp_path)], env=environment, timeout=300
    )
    assert run.returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob("chunk-*"))) == 2
    assert list(tmp_path.glob(".chunk-*.partial"))
    resumed = sweep(tmp_path, resume=True)
    np.testing.assert_array_equal(resumed.costs, whole)
    assert not list(tmp_path.glob(".chunk-*.partial"))


class Killed(BaseException):
    """A kill: no handler of ours may catch it and go on."""


class Store(RuleBasedStateMachine):
    """Whatever happened to the folder, resuming gives the answer of a sweep that nothing happened to."""

    @initialize()
    def begin(self):
        self.folder = Path(tempfile.mkdtemp(prefix="sweep-"))
        self.owner = None

    def teardown(self):
        if self.owner is not None:
            self.owner.release()
        if hasattr(self, "folder"):
            shutil.rmtree(self.folder)

    def _run(self, cores):
        compute = sweep_module.evaluate_chunk

        def on_cores(*arguments):
            return compute(*arguments, workers=cores)

        with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
            warnings.simplefilter("ignore", FpjaxWarning)
            patch.setattr(sweep_module, "evaluate_chunk", on_cores)
            return sweep(self.folder, resume=(self.folder / "sweep.json").exists() or self._chunks() != [])

    def _chunks(self):
        return sorted(self.folder.glob("chunk-*.npy"))

    @rule(after=st.integers(0, 14), cores=st.integers(1, 4))
    def kill(self, after, cores):
        """At the n-th rename or sync to the disk."""
        if self.owner is not None:
            return
        calls = [0]

        def then(fn):
            def call(*arguments, **words):
                calls[0] += 1
                if calls[0] > after:
                    raise Killed
                return fn(*arguments, **words)

            return call

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Path, "replace", then(Path.replace))
            patch.setattr("fpjax.output.runfile.os.fsync", then(os.fsync))
            patch.setattr(Path, "unlink", then(Path.unlink))  # a killed process tidies nothing up
            with contextlib.suppress(Killed, InputError):  # `resume` says which refusals are right
                self._run(cores)

    @rule(
        piece=st.integers(0, 4),
        how=st.sampled_from([zero, cut, shorten, single, pickled, Path.unlink]),
    )
    def damage(self, piece, how):
        if chunk(self.folder, piece).exists():
            how(chunk(self.folder, piece))

    @rule(piece=st.integers(0, 4), at=st.integers(0, 1 << 12), bit=st.integers(0, 7))
    def flip(self, piece, at, bit):
        if chunk(self.folder, piece).exists():
            flip(chunk(self.folder, piece), at, bit)

    @rule(one=st.integers(0, 4), other=st.integers(0, 4))
    def swap(self, one, other):
        if chunk(self.folder, one).exists() and chunk(self.folder, other).exists():
            first, second = chunk(self.folder, one).read_bytes(), chunk(self.folder, other).read_bytes()
            chunk(self.folder, one).write_bytes(second)
            chunk(self.folder, other).write_bytes(first)

    @rule(at=st.integers(0, 1 << 10), bit=st.integers(0, 7))
    def damage_manifest(self, at, bit):
        # With no whole chunk beside it nobody could say whose folder it is: that is refused, and tested above.
        if (self.folder / "sweep.json").exists() and not self._chunks():
            return
        if (self.folder / "sweep.json").exists():
            flip(self.folder / "sweep.json", at, bit)

    @rule()
    def another_owner_comes(self):
        from tuning.folder_lock import FolderLock

        if self.owner is None:
            self.owner = FolderLock(self.folder)

    @rule()
    def another_owner_goes(self):
        if self.owner is not None:
            self.owner.release()
            self.owner = None

    @rule(cores=st.integers(1, 4))
    def resume(self, cores):
        before = {path.name: path.read_bytes() for path in self._chunks()}
        if self.owner is not None:
            with pytest.raises(InputError, match="still running"):
                self._run(cores)
            assert before == {path.name: path.read_bytes() for path in self._chunks()}
            return
        try:
            costs = self._run(cores).costs
        except InputError as error:
            if "no chunk beside it is one of this sweep" not in str(error):
                raise
            # The one case without an answer: nothing is left that says which sweep this is.
            (self.folder / "sweep.json").unlink(missing_ok=True)
            for path in self._chunks():
                path.unlink()
            return
        np.testing.assert_array_equal(costs, ANSWER["whole"])
        np.testing.assert_array_equal(np.load(self.folder / "cost.npy"), ANSWER["whole"].reshape(-1, 1))


ANSWER = {}


@pytest.fixture
def answer(whole):
    ANSWER["whole"] = whole


@pytest.mark.usefixtures("answer")
class TestStore(Store.TestCase):
    settings = settings(
        max_examples=25,
        stateful_step_count=12,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        derandomize=True,
    )
