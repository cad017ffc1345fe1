"""What a result says of itself: how far off its estimates end, and the path that the search took."""

import numpy as np
import pytest

import fpjax as fp
import tuning

GAINS = ("observer.gain_1", "observer.gain_2")
RUN = {"dt": 2e-3, "stepping": "sampled", "solver": "exact"}


def loop():
    return fp.ClosedLoop(
        fp.OneMass(10.0, fp.CoulombViscous(20.0, 5.0)),
        fp.ProportionalIntegral(400.0, 2000.0),
        fp.ExtendedFriedlandPark(10.0, 100.0, 100.0, 500.0),
    )


@pytest.fixture(scope="module")
def short():
    """Gains held too small to bring the estimates home within the run."""
    held = [tuning.Parameter(name, 1.0, 0.5, 2.0) for name in GAINS]
    return tuning.tune(loop(), fp.Sine(1.0, 0.5), parameters=held, duration=0.5, **RUN)


def test_estimates_that_end_off_the_truth_are_said_with_their_number(short):
    run = fp.simulate(
        short.apply(loop()), fp.Sine(1.0, 0.5), duration=0.5, record=("estimates.coulomb", "estimates.viscous"), **RUN
    )
    for name, truth in (("coulomb", 20.0), ("viscous", 5.0)):
        assert short.settled[name] == pytest.approx(run.settled[name] / truth - 1.0, abs=5e-3)
    off = {name for name, value in short.settled.items() if abs(value) > 0.03}
    assert off
    (note,) = [note for note in short.notes if "off the truth" in note]
    assert all(f"{name} {100.0 * short.settled[name]:+.3g} %" in note for name in off)


def test_what_is_noted_leaves_the_cost_alone(short):
    assert short.mean == pytest.approx(short.cost, rel=1e-6)
    assert short.cases[0][0][0] == pytest.approx(short.cost, rel=1e-6)


def test_the_path_leads_from_a_start_to_the_gains(short):
    points = np.stack([short.path[name] for name in GAINS], axis=1)
    assert len(points) == short.iterations
    found = np.array([short.gains[name] for name in GAINS])
    assert np.min(np.abs(points / found - 1.0).max(axis=1)) < 1e-9
    assert short.to_dict()["path"] == short.path


def test_starts_that_fill_up_a_kernel_are_not_counted(short):
    assert 1 <= short.starts <= tuning.starts.KEPT + 1
    each = 3 * short.starts  # a value and two tangents of every start that is still under way
    assert short.simulations <= tuning.starts.SCREENED + 1 + each * max(len(short.path[name]) for name in GAINS)


def test_a_machine_that_friction_holds_is_said_first_and_why():
    held = fp.ClosedLoop(
        fp.OneMass(10.0, fp.CoulombViscous(20.0, 5.0)),
        fp.Proportional(5.0),
        fp.ExtendedFriedlandPark(10.0, 100.0, 100.0, 500.0),
    )
    result = tuning.tune(held, fp.Sine(1.0, 0.5), parameters=GAINS, duration=0.5, **RUN)
    assert str(result).startswith("NOT AN OPTIMUM: the cost does not depend on observer.gain_1")
    assert any("the machine never moves" in note for note in result.notes)


def test_estimates_are_judged_under_the_noise_of_the_sensor():
    """A noise of a tenth of the speed biases an observer that was tuned without it."""

    def noisy(noise):
        return fp.ClosedLoop(
            loop().plant, loop().controller, loop().observer, sensor=fp.Gyro(noise=noise)
        )  # fmt: skip

    clean, rough = (
        tuning.tune(noisy(noise), fp.Sine(1.0, 0.5), parameters=GAINS, duration=0.5, **RUN) for noise in (0.0, 0.1)
    )
    assert rough.gains == pytest.approx(clean.gains, rel=1e-6)  # the cost has no noise unless it is asked for
    assert abs(rough.settled["viscous"]) > abs(clean.settled["viscous"])
    assert any("off the truth" in note for note in rough.notes)
