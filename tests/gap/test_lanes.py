"""Lanes of the replay: packed and taken apart again, the same on any number of threads, errors and settings kept."""

import threading
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gap_search import search_of
from numpy_machine import record

from fpjax.gap.data.record import make_records
from fpjax.gap.data.replay_tables import tables_of
from fpjax.gap.simulate import family as families
from fpjax.gap.simulate.family import Runner, window_fields
from fpjax.gap.simulate.lane_kernel import LANES
from fpjax.gap.simulate.windows import as_rows, from_rows
from fpjax.simulation.precision import double_precision


@pytest.fixture(scope="module")
def search():
    return search_of(record(seconds=6.0))


@pytest.fixture(scope="module")
def runner(search):
    return search.fitter(("rigid", ())).runner


def lanes(search, count):
    """`count` lanes of different inertia, in the log's windows one after the other."""
    log = search.records[0]
    vector = np.repeat(search.fitter(("rigid", ())).family.neutral(search.setting)[:, None], count, 1)
    vector[search.family(()).index("inertia")] *= 1.0 + 0.02 * np.random.default_rng(1).standard_normal(count)
    fields = window_fields(log, np.arange(count) % len(log.starts), np.zeros((2, len(log.starts))))
    return vector, np.zeros((2, count)), fields


def test_rows_are_taken_apart_as_they_were_put_together(search):
    vector, states, fields = lanes(search, 5)
    states += [[1.0], [2.0]]
    fields = fields | {"hidden": np.arange(10.0).reshape(2, 5)}
    rows = as_rows(vector, states, fields)
    with double_precision():
        taken = from_rows(jnp.asarray(rows), jnp.asarray(fields["start"]), len(vector))
    np.testing.assert_array_equal(taken[0], vector)
    np.testing.assert_array_equal(taken[1], states)
    for name, value in fields.items():
        np.testing.assert_array_equal(np.stack(taken[2].hidden) if name == "hidden" else getattr(taken[2], name), value)


@pytest.mark.parametrize("count", [1, LANES, 5 * LANES - 7, 6 * LANES])
def test_threads_compute_what_one_does(search, runner, monkeypatch, count):
    given = lanes(search, count)
    found = []
    for cores in (1, 2, 3):
        monkeypatch.setattr(families, "cores", lambda cores=cores: cores)
        found.append(runner.run(0, *given))
    assert found[0][0].shape == (runner.channels, runner.samples, count)
    assert np.all(np.isfinite(found[0][0]))
    for other in found[1:]:
        np.testing.assert_array_equal(other[0], found[0][0])
        np.testing.assert_array_equal(other[1], found[0][1])


def test_no_lanes_are_no_lanes(search, runner):
    found, ends = runner.run(0, *lanes(search, 0))
    assert found.shape == (runner.channels, runner.samples, 0)
    assert ends.shape == (2, 0)


def test_threads_have_the_callers_settings_and_errors_reach_it(search, runner, monkeypatch):
    monkeypatch.setattr(families, "cores", lambda: 2)
    kernel, seen = runner.kernel, {}

    def spied(*arguments):
        seen[threading.current_thread().name] = jax.config.jax_debug_nans
        return kernel(*arguments)

    monkeypatch.setattr(runner, "kernel", spied)
    given = lanes(search, 6 * LANES)
    with jax.debug_nans(True):
        runner.run(0, *given)
    assert len(seen) == 2
    assert all(seen.values())

    def failing(*arguments):
        raise ValueError("no kernel")

    monkeypatch.setattr(runner, "kernel", failing)
    with pytest.raises(ValueError, match="no kernel"):
        runner.run(0, *given)
    monkeypatch.setattr(runner, "kernel", kernel)
    assert np.all(np.isfinite(runner.run(0, *given)[0]))  # and nothing stays locked


def test_a_log_of_another_length_or_rate_compiles_nothing(search, runner):
    runner.run(0, *lanes(search, 3))
    compiled = runner.kernel.function._cache_size()
    for seconds, dt in ((4.3, 1e-3), (5.0, 2e-3)):
        others = make_records([record(seconds=seconds, dt=dt)], [], search.setting.inertia)
        assert others[0].samples != search.records[0].samples
        with double_precision():
            other = Runner(runner.family, others, [tables_of(others[0])])
        fields = window_fields(others[0], np.arange(3), np.zeros((2, len(others[0].starts))))
        found, _ = other.run(0, lanes(search, 3)[0], np.zeros((2, 3)), fields)
        assert found.shape == (other.channels, others[0].samples, 3)
        assert other.kernel is runner.kernel
    assert runner.kernel.function._cache_size() == compiled


def test_a_window_whose_simulation_diverges_has_no_say_in_the_step(search):
    c = search.base
    fitter = search.fitters[c.family.key]
    (part,) = fitter.linearise([c], search.train)[0]
    matrix, slope, _ = fitter.reduced(c, [part], np.zeros(1))
    here, columns = part.c.copy(), part.slope.copy()
    here[0], columns[0] = np.inf, np.nan
    lost, steps, _ = fitter.reduced(c, [replace(part, c=here, slope=columns)], np.zeros(1))
    rest = replace(part, windows=part.windows[1:], c=part.c[1:], slope=part.slope[1:])
    without, alone, _ = fitter.reduced(c, [rest], np.zeros(1))
    np.testing.assert_allclose(lost, without, rtol=1e-9)
    np.testing.assert_allclose(steps, alone, rtol=1e-9)
    assert not np.allclose(matrix, without)
    assert not np.allclose(slope, alone)
