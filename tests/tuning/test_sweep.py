"""Dense sweeps: the grid, its files, and going on after an interruption."""

import dataclasses
import itertools
import os
import pathlib
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable

import equinox as eqx
import numpy as np
import pytest
from tuning_loops import CONSTANT, DEGREE, GAINS, SHORT, SINE, THESIS, efp

import fpjax
import tuning
from fpjax import InputError
from tuning import Axis, Parameter
from tuning.problem import make_problem
from tuning.sweep_store import SweepStore, fingerprint

REPO = pathlib.Path(__file__).parents[2]
HELPERS = str(REPO / "tests" / "helpers")

sweep_module = sys.modules["tuning.sweep"]  # the name tuning.sweep is the function
AXES = (Axis("observer.gain_1", 1.0, 1e3, 7), Axis("observer.gain_2", 5.0, 25.0, 5, "linear"))
COMMON = {"axes": AXES, "objective": THESIS, **SHORT}


def test_every_point_is_its_own_simulation():
    result = tuning.sweep(efp(150.0), {"a": SINE, "b": CONSTANT}, **COMMON)
    assert result.costs.shape == (7, 5, 2)
    assert result.simulations == 70
    np.testing.assert_allclose(AXES[0].values[[0, 3, 6]], [1.0, 10.0**1.5, 1e3])
    np.testing.assert_allclose(AXES[1].values, [5.0, 10.0, 15.0, 20.0, 25.0])
    measures = {"k": fpjax.EstimateFinal("coulomb"), "b": fpjax.EstimateFinal("viscous")}
    for place in ((0, 0), (3, 4), (6, 2)):
        loop = fpjax.blocks.parameters.set_parameters(
            efp(150.0), {axis.name: axis.values[i] for axis, i in zip(AXES, place, strict=True)}
        )
        for column, reference in enumerate((SINE, CONSTANT)):
            run = fpjax.simulate(loop, reference, measures=measures, **SHORT)
            expected = abs(run.measures["k"] - 20.0) + abs(run.measures["b"] / DEGREE - 2.0)
            np.testing.assert_allclose(result.costs[(*place, column)], expected, rtol=1e-8)
    gains, cost = result.best("b")
    assert cost == result.costs[..., 1].min()
    assert result.cost()[tuple(int(np.argmin(abs(axis.values - gains[axis.name]))) for axis in AXES)] == (
        pytest.approx(result.costs.mean(axis=-1)[np.unravel_index(np.argmin(result.costs[..., 1]), (7, 5))])
    )


def test_a_delay_is_swept_and_tuned_beyond_the_history_of_the_loop():
    blocks = (fpjax.OneMass(1.0, fpjax.Viscous(0.5)), fpjax.Proportional(5.0))
    short, long = (
        fpjax.ClosedLoop(*blocks, actuator=fpjax.Actuator(delay=1e-3, longest_delay=kept)) for kept in (2, 20)
    )
    common = {"dt": 1e-3, "samples": 101, "stepping": "sampled", "objective": "tracking"}
    axes = [Axis("actuator.delay", 1e-3, 16e-3, 4)]
    found, truth = (tuning.sweep(loop, SINE, axes=axes, **common).costs for loop in (short, long))
    np.testing.assert_allclose(found, truth, rtol=1e-12)
    # Without a bound a delay is tuned to eight periods more than its start.
    problem, _, _ = make_problem(short, SINE, ["actuator.delay"], **common)
    assert problem.loop.actuator.longest_delay == 10
    assert float(problem.space.high[0]) == pytest.approx(9e-3)
    assert make_problem(short, SINE, ["controller.kp"], **common)[0].loop.actuator.longest_delay == 2
    with pytest.raises(InputError, match=r"the largest actuator.delay, 2 s, is 2000 periods .* smaller upper bound"):
        tuning.tune(short, SINE, parameters=[Parameter("actuator.delay", high=2.0)], **common)
    one = tuning.sweep(short, SINE, axes=[Axis("actuator.delay", 1e-3, 1e-3, 1)], **common)
    np.testing.assert_allclose(one.costs[0], found[0], rtol=1e-12)


def test_chunks_change_nothing_but_rounding_and_diverged_points_cost_infinity():
    axes = (Axis("observer.gain_1", 1.0, 1e9, 40), Axis("observer.gain_2", 1.0, 1e9, 5))
    common = {**COMMON, "axes": axes, "samples": 101, "duration": None}
    whole = tuning.sweep(efp(150.0), SINE, chunk=200, **common)
    pieces = tuning.sweep(efp(150.0), SINE, chunk=64, **common)
    # Another shape is another kernel: its last bits may differ.
    np.testing.assert_allclose(whole.costs, pieces.costs, rtol=1e-12)
    assert 0 < whole.diverged < 200
    assert np.isinf(whole.costs[-1, -1, 0])
    assert np.isfinite(whole.best()[1])
    assert "diverged" in str(whole)


def test_an_interrupted_sweep_keeps_what_is_done_and_goes_on_bit_equal(tmp_path, monkeypatch):
    whole = tuning.sweep(efp(150.0), SINE, chunk=8, out=tmp_path / "whole", **COMMON)
    compute, calls = sweep_module.evaluate_chunk, []

    def interrupted(*arguments):
        calls.append(arguments[2])
        if len(calls) == 3:
            raise KeyboardInterrupt
        return compute(*arguments)

    monkeypatch.setattr(sweep_module, "evaluate_chunk", interrupted)
    with pytest.raises(KeyboardInterrupt):
        tuning.sweep(efp(150.0), SINE, chunk=8, out=tmp_path / "broken", **COMMON)
    kept = sorted(path.name for path in (tmp_path / "broken").glob("chunk-*.npy"))
    assert kept == ["chunk-0000000.npy", "chunk-0000001.npy"]
    assert not (tmp_path / "broken" / "cost.npy").exists()
    resumed = tuning.sweep(efp(150.0), SINE, chunk=8, out=tmp_path / "broken", resume=True, **COMMON)
    assert calls[3:] == [2, 3, 4]
    np.testing.assert_array_equal(resumed.costs, whole.costs)
    assert (tmp_path / "broken" / "cost.npy").read_bytes() == (tmp_path / "whole" / "cost.npy").read_bytes()
    # Once more finds nothing to do.
    again = tuning.sweep(efp(150.0), SINE, chunk=8, out=tmp_path / "broken", resume=True, **COMMON)
    assert len(calls) == 6
    np.testing.assert_array_equal(again.costs, whole.costs)


def test_a_folder_of_another_sweep_is_refused(tmp_path):
    tuning.sweep(efp(150.0), SINE, chunk=8, out=tmp_path, **COMMON)
    with pytest.raises(InputError, match="holds a sweep already"):
        tuning.sweep(efp(150.0), SINE, chunk=8, out=tmp_path, **COMMON)
    for other, named in (
        ({"loop": efp(120.0)}, "loop"), ({"reference": CONSTANT}, "reference"), ({"chunk": 9}, "chunk size"),
        ({"axes": AXES[:1]}, "axes"), ({"solver": "rk4"}, "step, duration or solver"),
        ({"loop": efp(120.0), "aggregate": "worst"}, "loop, objective or cases"),
    ):  # fmt: skip
        settings = {"chunk": 8, **COMMON, **other}
        loop, reference = settings.pop("loop", efp(150.0)), settings.pop("reference", SINE)
        with pytest.raises(InputError, match=rf"holds another sweep \(other {named}\): resume it as it was begun"):
            tuning.sweep(loop, reference, out=tmp_path, resume=True, **settings)


def printed(code, **environment):
    """What the code prints in a process of its own."""
    command = [sys.executable, "-c", textwrap.dedent(code), HELPERS]
    run = subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=REPO, env={**os.environ, **environment}
    )
    return run.stdout.strip()


def test_a_reference_that_differs_by_its_last_digit_is_the_same():
    problem = make_problem(efp(150.0), SINE, GAINS, objective=tuning.Tracking(), **SHORT)[0]
    tables = problem.references

    def other(by):
        return fingerprint(
            dataclasses.replace(problem, references=tuple(table * (1.0 + by) for table in tables)), [], 8
        )

    assert other(0.0) == other(2e-16) == other(-2e-16) == fingerprint(problem, [], 8)
    assert other(1e-6) != other(0.0)
    turned = dataclasses.replace(problem, references=tuple(-table for table in tables))
    assert fingerprint(turned, [], 8) != other(0.0)


def test_the_identity_of_a_sweep_is_the_same_in_another_process(tmp_path):
    """Else a killed driver could not resume."""
    code = """
        import jax; jax.config.update("jax_enable_x64", True)
        import sys; sys.path.insert(0, sys.argv[1])
        from tuning_loops import GAINS, SHORT, SINE, THESIS, efp
        import tuning
        from tuning.problem import make_problem
        from tuning.sweep_store import fingerprint
        print(fingerprint(make_problem(efp(150.0), SINE, GAINS, objective=tuning.Tracking(), **SHORT)[0], [], 8))
    """
    here = fingerprint(make_problem(efp(150.0), SINE, GAINS, objective=tuning.Tracking(), **SHORT)[0], [], 8)
    other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    assert printed(code, PYTHONHASHSEED=other) == str(here)


def test_the_file_names_its_axes(tmp_path):
    result = tuning.sweep(efp(150.0), {"a": SINE, "b": CONSTANT}, out=tmp_path / "sweep", chunk=16, **COMMON)
    content = tuning.load_sweep(result.save(tmp_path / "sweep.npz"))
    assert list(content["axes"]) == ["observer.gain_1", "observer.gain_2", "reference"]
    assert list(content["references"]) == ["a", "b"]
    np.testing.assert_array_equal(content["cost"], result.costs)
    np.testing.assert_array_equal(content["observer.gain_1"], AXES[0].values)
    assert content["summary"]["best"]["a"]["cost"] == result.best("a")[1]
    frame = pytest.importorskip("pandas") and result.to_dataframe()
    row = frame.loc[frame["cost on b"].idxmin()]
    assert {axis.name: row[axis.name] for axis in AXES} == result.best("b")[0]
    assert len(frame) == result.simulations / 2


@pytest.mark.parametrize(
    "axes", [pytest.param(AXES[:1], marks=pytest.mark.long), AXES, (*AXES, Axis("controller.kp", 100.0, 200.0, 3))]
)
def test_pictures(axes, tmp_path):
    result = tuning.sweep(efp(150.0), SINE, **{**COMMON, "axes": axes, "duration": 0.01})
    figure = result.plot(tmp_path / "sweep.png")
    assert figure.axes
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_a_linear_axis_may_cross_zero():
    result = tuning.sweep(efp(150.0), SINE, **{**COMMON, "axes": [Axis("observer.gain_1", -5.0, 5.0, 11, "linear")]})
    assert np.all(np.isfinite(result.costs))


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ([], "nothing to sweep"),
        ([Axis("observer.gain_9", 1.0, 2.0, 3)], "gain_"),
        ([Axis("observer.gain_1", 2.0, 1.0, 3)], "empty"),
        ([Axis("observer.gain_1", 1.0, 1.0, 3)], "empty"),
        ([Axis("observer.gain_1", 0.0, 1.0, 3)], "above zero.*:linear at the end of --axis"),
        ([Axis("observer.gain_1", 1.0, float("inf"), 3)], "not finite"),
        ([Axis("observer.gain_1", 1.0, 2.0, 0)], "count = 0"),
        ([Axis("observer.gain_1", 1.0, 2.0, 3, "octave")], "not known"),
        ([AXES[0], AXES[0]], "twice"),
    ],
)
def test_absurd_axes_are_refused(axes, words):
    with pytest.raises(InputError, match=words):
        tuning.sweep(efp(150.0), SINE, **{**COMMON, "axes": axes})


def test_a_sweep_of_1e12_candidates_is_refused_at_once_with_its_count_and_time():
    axes = [Axis("observer.gain_1", 1.0, 2.0, 10**6), Axis("observer.gain_2", 1.0, 2.0, 10**6)]
    begin = time.perf_counter()
    with pytest.raises(InputError, match=r"1e\+12 candidates.*estimated 1e\+08 steps a second.*years") as refused:
        tuning.sweep(efp(150.0), SINE, **{**COMMON, "axes": axes})
    assert time.perf_counter() - begin < 10.0
    assert "\n" not in str(refused.value)


def test_missing_chunks_are_not_listed_at_once(tmp_path):
    pieces = 10**12
    store = SweepStore(tmp_path, "x", pieces, 1, 1, float, resume=False)
    for piece in (0, 1, 3, 12_345_678):
        store.keep(piece, np.zeros((1, 1)))
    assert store.finished() == {0, 1, 3, 12_345_678}
    assert list(itertools.islice(store.missing(store.finished()), 3)) == [2, 4, 5]


class Scaled(tuning.Tracking):
    """An objective that holds a function."""

    quantity: Callable[[float], float] = eqx.field(static=True, default=abs)


def test_a_function_without_a_name_is_refused_where_the_sweep_is_kept(tmp_path):
    common = {**COMMON, "objective": Scaled(quantity=lambda value: value)}
    with pytest.raises(InputError, match="<lambda>, a function without a name of its own"):
        tuning.sweep(efp(150.0), SINE, out=tmp_path / "unnamed", **common)
    assert not (tmp_path / "unnamed").exists()
    tuning.sweep(efp(150.0), SINE, out=tmp_path / "named", **{**COMMON, "objective": Scaled()})


def test_chunks_of_other_versions_are_another_sweep(tmp_path, monkeypatch):
    tuning.sweep(efp(150.0), SINE, out=tmp_path, **COMMON)
    monkeypatch.setattr("tuning.sweep_store.versions", lambda: {"jax": "0.0"})
    with pytest.raises(InputError, match=r"\(other versions\)"):
        tuning.sweep(efp(150.0), SINE, out=tmp_path, resume=True, **COMMON)


def test_a_sweep_of_another_form_says_so(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("tuning.sweep_store.FORM", 2)
        tuning.sweep(efp(150.0), SINE, out=tmp_path, **COMMON)
    with pytest.raises(InputError, match="holds a sweep that another version of fpjax has kept"):
        tuning.sweep(efp(150.0), SINE, out=tmp_path, resume=True, **COMMON)


def test_other_bad_input(tmp_path):
    with pytest.raises(InputError, match="out=FOLDER"):
        tuning.sweep(efp(150.0), SINE, resume=True, **COMMON)
    with pytest.raises(InputError, match="chunk must be at least 1 candidate, got 0"):
        tuning.sweep(efp(150.0), SINE, chunk=0, **COMMON)
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match="can be written"):
        tuning.sweep(efp(150.0), SINE, out=tmp_path / "file", **COMMON)
    result = tuning.sweep(efp(150.0), SINE, **COMMON)
    with pytest.raises(InputError, match="choose another place"):
        result.save(tmp_path / "file" / "sweep.npz")
    with pytest.raises(InputError, match="was not swept"):
        result.cost("chirp")


@pytest.mark.slow
def test_1e5_candidates_of_5000_steps_stay_under_one_gibibyte(tmp_path):
    code = """
        import resource, sys; sys.path.insert(0, sys.argv[1])
        import jax; jax.config.update("jax_enable_x64", True)
        from tuning_loops import SETUP, SINE, THESIS, DEGREE, efp
        import tuning
        Axis = tuning.Axis
        axes = [Axis("observer.gain_1", DEGREE, 1e4 * DEGREE, 317), Axis("observer.gain_2", 1.0, 500.0, 317)]
        result = tuning.sweep(efp(150.0), SINE, axes=axes, objective=THESIS, **SETUP)
        print(result.simulations, result.simulated_steps, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    """
    simulations, steps, kilobytes = map(int, printed(code).split())
    assert simulations >= 100_000
    assert steps >= 100_000 * 5_000
    assert kilobytes < 1024 * 1024
