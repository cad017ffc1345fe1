"""Programs on disk: found by what they were made from, called without a trace, never in the place of another one."""

import os
import subprocess
import sys
import threading
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import fpjax
from fpjax.blocks.servo_sensor import ServoSensor
from fpjax.compiled import stored
from fpjax.compiled.stored import FOLDER, MOST_FOLDERS, Stored, description, store_in

# A process that calls a stored program and says whether it was traced.
PROGRAM = """
import sys, pathlib, jax, jax.numpy as jnp
from fpjax.compiled.stored import Stored, store_in
jax.config.update("jax_enable_x64", True)
store_in(pathlib.Path(sys.argv[1]))

def double(leaves, x):
    print("traced")
    return [jnp.sin(leaf) * x for leaf in leaves], jnp.cumsum(x)

many, total = Stored(jax.jit(double), "double")([jnp.arange(3.0), jnp.ones(3)], jnp.arange(3.0))
print(*(float(value) for value in [*many[0], *many[1], *total]))
"""


# The same after a call that jax's own cache serves.
BEFORE = """
import sys, jax, jax.numpy as jnp, pathlib
from fpjax.compiled.stored import Stored, store_in
jax.config.update("jax_compilation_cache_dir", sys.argv[1] + "/jax")
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

def walk(x):
    def body(carry, k):
        return jnp.tanh(carry * 1.1 + jnp.arange(50.0) @ carry), jnp.max(carry) + k
    return jax.lax.scan(body, x, jnp.arange(20.0))[1][-1]

stored = Stored(jax.jit(walk), "walk")
if sys.argv[2] != "stored":
    stored(jnp.ones(50))
if sys.argv[2] != "jax's":
    store_in(pathlib.Path(sys.argv[1]))
print(float(stored(jnp.ones(50))))
"""


@pytest.fixture
def folder(tmp_path):
    store_in(tmp_path)
    yield tmp_path
    store_in(None)


def files(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


def in_a_process(folder):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder)], capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout.splitlines()


def traced_counter():
    """(function, the list that each trace of it makes longer)."""
    traces = []

    def function(x):
        traces.append(x.shape)
        return jnp.sin(x) * 2.0

    return function, traces


def test_a_later_process_calls_the_program_without_a_trace(tmp_path):
    first, second = in_a_process(tmp_path), in_a_process(tmp_path)
    assert first == ["traced", second[0]]
    assert len(second) == 1
    assert len(files(tmp_path)) == 1


def test_a_damaged_file_is_compiled_anew_and_mended(tmp_path):
    whole = in_a_process(tmp_path)
    (path,) = files(tmp_path)
    good = path.read_bytes()
    for bad in (b"", good[: len(good) // 2], b"no program"):
        path.write_bytes(bad)
        assert in_a_process(tmp_path) == whole
        assert in_a_process(tmp_path) == whole[1:]


def test_one_trace_for_all_stored_ones_of_a_process(folder):
    function, traces = traced_counter()
    x = jnp.arange(4.0)
    expected = jnp.sin(x) * 2.0
    for _ in range(2):
        np.testing.assert_array_equal(Stored(jax.jit(function), "sine")(x), expected)
    assert len(traces) == 1  # the second one came from the file
    other, traced = traced_counter()
    np.testing.assert_array_equal(Stored(jax.jit(other), "another")(x), expected)
    assert len(traced) == 1
    assert len(files(folder)) == 2


def test_shapes_types_and_settings_have_programs_of_their_own(folder):
    function, _ = traced_counter()
    program = Stored(jax.jit(function), "sine")
    assert program(jnp.arange(4.0)).shape == (4,)
    assert program(jnp.arange(5.0)).shape == (5,)
    assert program(jnp.arange(4.0, dtype=jnp.float32)).dtype == jnp.float32
    with jax.default_matmul_precision("highest"):
        program(jnp.arange(4.0))
    assert len(files(folder)) == 4


@pytest.mark.parametrize("made_of", [None, "sine"])
def test_nothing_is_stored_without_a_description_or_a_folder(tmp_path, made_of):
    store_in(tmp_path if made_of is None else None)
    try:
        function, traces = traced_counter()
        np.testing.assert_array_equal(Stored(jax.jit(function), made_of)(jnp.ones(2)), 2.0 * jnp.sin(jnp.ones(2)))
        assert traces
        assert not files(tmp_path)
    finally:
        store_in(None)


@pytest.fixture
def other_sources(monkeypatch):
    """As if the package's sources were others: a function of their version."""

    def change(version):
        stored._surroundings.cache_clear()
        monkeypatch.setattr(stored, "_digests", lambda within: [f"a file {version}"])

    yield change
    stored._surroundings.cache_clear()


def test_other_sources_other_programs_and_only_the_latest_are_kept(folder, other_sources):
    mine = [folder / FOLDER / "my thesis", folder / FOLDER / "0123"]
    for path in mine:
        path.mkdir(parents=True)
        os.utime(path, (1.0, 1.0))
    for version in range(MOST_FOLDERS + 2):
        other_sources(version)
        function, traces = traced_counter()
        Stored(jax.jit(function), "sine")(jnp.ones(2))
        assert len(traces) == 1
    assert len(list((folder / FOLDER).iterdir())) == MOST_FOLDERS + len(mine)
    assert all(path.is_dir() for path in mine)  # what is not ours is never removed


def test_a_folder_that_is_used_stays(folder, other_sources):
    for version in (0, *range(1, MOST_FOLDERS + 2)):
        for used in (0, version):
            other_sources(used)
            function, traces = traced_counter()
            Stored(jax.jit(function), "sine")(jnp.ones(2))
            time.sleep(0.01)
        assert len(traces) == 1 or version == 0
    other_sources(0)
    function, traces = traced_counter()
    Stored(jax.jit(function), "sine")(jnp.ones(2))
    assert not traces


def test_no_more_programs_than_allowed_are_kept(folder, monkeypatch):
    monkeypatch.setattr(stored, "MOST_PROGRAMS", 2)
    for kind in range(4):
        Stored(jax.jit(lambda x: x + 1.0), f"kind {kind}")(jnp.ones(2))
    assert len(files(folder)) == 2


def test_a_process_older_than_its_sources_stores_nothing(folder, monkeypatch):
    monkeypatch.setattr(stored, "_STARTED", 1.0)
    function, _ = traced_counter()
    np.testing.assert_array_equal(Stored(jax.jit(function), "sine")(jnp.ones(2)), 2.0 * jnp.sin(jnp.ones(2)))
    assert not files(folder)


def test_what_calls_a_library_is_not_stored(folder):
    """Its functions are made known where it is lowered: called without, it ends the process."""
    found = Stored(jax.jit(jnp.linalg.inv), "inverse")(2.0 * jnp.eye(3))
    np.testing.assert_allclose(found, 0.5 * np.eye(3))
    assert not files(folder)


def test_devices_structures_and_plain_python_in_one_process(folder):
    function, _ = traced_counter()
    program, x = Stored(jax.jit(function), "sine"), np.ones(2)
    first = program(x)
    with jax.default_device(jax.devices()[1]):
        np.testing.assert_array_equal(program(x), first)
    with jax.disable_jit():
        np.testing.assert_array_equal(program(x), first)
    np.testing.assert_array_equal(program(x), first)
    pair = Stored(jax.jit(lambda pair: jnp.sin(jax.tree.leaves(pair)[0])), "first of a pair")
    np.testing.assert_array_equal(pair((x, 2.0 * x)), pair([x, 2.0 * x]))


@pytest.mark.parametrize("option", ["jax_disable_most_optimizations", "jax_debug_infs"])
def test_options_of_the_compiler_have_programs_of_their_own(folder, option):
    for on in (False, True):
        jax.config.update(option, on)
        try:
            Stored(jax.jit(lambda x: x + 1.0), "one more")(jnp.ones(2))
        finally:
            jax.config.update(option, False)
    assert len(files(folder)) == 2


def test_a_folder_that_cannot_be_written_costs_nothing_but_time(tmp_path):
    (tmp_path / "file").write_text("")
    store_in(tmp_path / "file" / "stored")
    try:
        function, _ = traced_counter()
        np.testing.assert_array_equal(Stored(jax.jit(function), "sine")(jnp.ones(2)), 2.0 * jnp.sin(jnp.ones(2)))
    finally:
        store_in(None)


def test_threads_that_come_at_once_compile_once(folder):
    function, traces = traced_counter()
    program, ready, found = Stored(jax.jit(function), "sine"), threading.Barrier(4), []

    def call():
        ready.wait()
        found.append(program(jnp.ones(3)))

    threads = [threading.Thread(target=call) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert len(traces) == 1


def test_jax_uses_its_own_cache_again_afterwards(folder):
    before = jax.config.jax_enable_compilation_cache
    assert before
    ready = threading.Barrier(3)

    def call(number):
        ready.wait()
        Stored(jax.jit(lambda x: jnp.sin(x) + number), f"plus {number}")(jnp.ones(2))

    threads = [threading.Thread(target=call, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(files(folder)) == 3
    assert jax.config.jax_enable_compilation_cache == before


# --- what a program is made of


class Own(fpjax.OneMass):
    """A user's own plant."""


def structure(block):
    return jax.tree.structure(block)


def test_a_description_tells_blocks_apart_and_not_their_numbers():
    light, heavy = fpjax.OneMass(1.0, fpjax.Coulomb(1.0)), fpjax.OneMass(2.0, fpjax.Coulomb(3.0))
    told = description("kind", structure(light), (1, True, "rigid", None))
    assert told is not None
    assert told == description("kind", structure(heavy), (1, True, "rigid", None))
    others = [
        description(
            "kind", structure(fpjax.OneMass(1.0, fpjax.Stribeck(1.0, 2.0, 0.1, 0.5))), (1, True, "rigid", None)
        ),
        description("other", structure(light), (1, True, "rigid", None)),
        description("kind", structure(light), (2, True, "rigid", None)),
        description("kind", structure(light), (1, False, "rigid", None)),
    ]
    assert len({told, *others}) == 5


def test_a_static_setting_of_a_block_is_in_the_description():
    told = {description(structure(ServoSensor(longest_delay=periods))) for periods in (8, 8, 16)}
    assert len(told) == 2
    assert None not in told


def test_what_a_user_wrote_has_no_description():
    assert description(structure(Own(1.0, fpjax.Coulomb(1.0)))) is None
    assert description(lambda x: x) is None
    assert description(np.ones(2)) is None


def test_a_program_of_jaxs_own_cache_is_not_stored_without_its_functions(tmp_path):
    """Jax gives it again when the function is compiled to be stored, and it lacks what it calls."""
    said = [
        subprocess.run(
            [sys.executable, "-c", BEFORE, str(tmp_path), mode], capture_output=True, text=True, check=True, timeout=120
        ).stdout
        for mode in ("jax's", "both", "stored")
    ]
    assert len(set(said)) == 1
