"""What a result says of itself: how far off its estimates end, and the path that the search took."""

import dataclasses

import jax
import numpy as np
import pytest
from model_files import body
from tuning_loops import COARSE, stiff

import fpjax as fp
import tuning
from tuning.notes import _accuracy, _noise_clause
from tuning.problem import make_problem

GAINS = ("observer.gain_1", "observer.gain_2")


@pytest.fixture(scope="module")
def slow():
    """Gains held too small to bring the estimates home within the run; the program is that of `test_start_values`."""
    held = [tuning.Parameter(name, 1.0, 0.5, 2.0) for name in GAINS]
    return tuning.tune(stiff(), fp.Sine(1.0, 0.5), parameters=held, **COARSE)


def test_estimates_that_end_off_the_truth_are_said_with_their_number(slow):
    run = fp.simulate(
        slow.apply(stiff()), fp.Sine(1.0, 0.5), record=("estimates.coulomb", "estimates.viscous"), **COARSE
    )
    for name, truth in (("coulomb", 20.0), ("viscous", 5.0)):
        assert slow.settled[name] == pytest.approx(run.settled[name] / truth - 1.0, abs=5e-3)
    off = {name for name, value in slow.settled.items() if abs(value) > 0.03}
    assert off
    (note,) = [note for note in slow.notes if "off the truth" in note]
    assert all(f"{name} {100.0 * slow.settled[name]:+.3g} %" in note for name in off)


def test_what_is_noted_leaves_the_cost_alone(slow):
    assert slow.mean == pytest.approx(slow.cost, rel=1e-6)
    assert slow.cases[0][0][0] == pytest.approx(slow.cost, rel=1e-6)


def test_the_path_leads_from_a_start_to_the_gains(slow):
    points = np.stack([slow.path[name] for name in GAINS], axis=1)
    assert len(points) == slow.iterations
    found = np.array([slow.gains[name] for name in GAINS])
    assert np.min(np.abs(points / found - 1.0).max(axis=1)) < 1e-9
    assert slow.to_dict()["path"] == slow.path


def test_starts_that_fill_up_a_kernel_are_not_counted(slow):
    assert 1 <= slow.starts <= tuning.start_values.KEPT + 1
    each = 3 * slow.starts  # a value and two tangents of every start that is still under way
    assert slow.simulations <= tuning.start_values.SCREENED + 1 + each * max(len(slow.path[name]) for name in GAINS)


@pytest.mark.long  # another loop: its Jacobian compiles for nine seconds
def test_a_machine_that_friction_holds_is_said_first_and_why():
    held = fp.ClosedLoop(
        fp.OneMass(10.0, fp.CoulombViscous(20.0, 5.0)),
        fp.Proportional(5.0),
        fp.ExtendedFriedlandPark(10.0, 100.0, 100.0, 500.0),
    )
    result = tuning.tune(held, fp.Sine(1.0, 0.5), parameters=GAINS, **(COARSE | {"duration": 0.5}))
    assert str(result).startswith("NOT AN OPTIMUM: the cost does not depend on observer.gain_1")
    assert any("the machine never moves" in note for note in result.notes)


@pytest.mark.long  # another loop: its Jacobian compiles for nine seconds
def test_estimates_are_judged_under_the_noise_of_the_sensor():
    """A noise of a tenth of the speed throws off an observer that was tuned without it."""

    def tuned(noise):
        noisy = fp.ClosedLoop(stiff().plant, stiff().controller, stiff().observer, sensor=fp.Gyro(noise=noise))
        return tuning.tune(noisy, fp.Sine(1.0, 0.5), parameters=GAINS, **(COARSE | {"duration": 0.5}))

    clean, rough = tuned(0.0), tuned(0.1)
    # Judged by one program. The search's own differs by rounding, which gains near the stability limit amplify.
    assert clean.noisy_cost == pytest.approx(clean.mean, rel=1e-9)
    assert not any("noise" in note for note in clean.notes)
    assert rough.gains["observer.gain_1"] < 0.1 * clean.gains["observer.gain_1"]
    assert rough.notes[0].startswith("tuned under the sensor's noise")
    assert any("off the truth" in note for note in rough.notes)


@pytest.mark.long
def test_gains_that_the_noise_upsets_are_tuned_again_under_it():
    """Without noise this machine's best gains are those of an unstable observer: nothing pushes it off the truth."""
    model = fp.load_model(
        body(4.18405e-4, 1.89698e-3, 1.15067e-3)
        + """
[actuator]
limit = 0.0868039
[sensor]
noise = 2.56149e-5
[controller]
type = "pi"
limit = 0.0868039
[observer]
type = "efp"
[reference]
type = "multisine"
amplitudes = [2.55152, 1.53091]
frequencies = [2.02092, 5.45648]
[simulation]
dt = 2.47137979e-3
duration = 2.46890841
stepping = "sampled"
solver = "exact"
"""
    )
    result = tuning.tune(model)
    assert any(
        note.startswith("tuned under the sensor's noise: with the best gains without it") for note in result.notes
    )
    assert result.noisy_cost < 1.1 * result.cost
    assert all(abs(value) < 0.03 for value in result.settled.values())
    tuned = dataclasses.replace(model, loop=result.apply(model.loop))
    for seed in range(3):  # other draws than those that it was looked at under
        settled = fp.simulate(tuned, key=jax.random.key(seed)).settled
        assert settled["coulomb"] == pytest.approx(1.89698e-3, rel=0.03)
        assert settled["viscous"] == pytest.approx(1.15067e-3, rel=0.03)


def test_an_estimate_that_runs_away_is_said_as_such():
    assert _accuracy({"coulomb": float("nan"), "viscous": 0.1})[0].count("coulomb without bound, viscous +10 %") == 1
    assert _accuracy({"coulomb": float("inf")})
    assert not _accuracy({"coulomb": 0.01})


def test_the_note_says_under_which_noise():
    noisy_loop = dataclasses.replace(stiff(), sensor=fp.Gyro(noise=1e-3))
    quiet, *noisy = (
        make_problem(noisy_loop, fp.Sine(1.0, 1.0), ["observer.gain_1"], dt=1e-3, duration=0.1, noise_seeds=seeds)[0]
        for seeds in ((), (0,), (0, 1))
    )
    assert _noise_clause(quiet, 0) == ""
    assert "worst of 8 draws" in _noise_clause(quiet, 8)
    assert [_noise_clause(one, 0).removeprefix(", ") for one in noisy] == [
        "under one draw of the sensor's noise", "in the worst of 2 draws of the sensor's noise"
    ]  # fmt: skip
