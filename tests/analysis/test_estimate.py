"""An observer over a log: recovery of known friction, the bookkeeping of compensation, and what cannot be."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import fpjax as fp
from fpjax.analysis.estimate import observe
from fpjax.logs.dynamics.derivative import measured_velocity
from fpjax.logs.dynamics.regression import fit_pairs

DT = 1e-3
INERTIA, COULOMB, VISCOUS = 10.0, 20.0, 30.0


def record(observer=None, duration=20.0, offset=0.0, motion="velocity"):
    """A log of a simulated axis (sampled, so that the torque is held), compensated or not."""
    law = fp.CoulombViscous(COULOMB, VISCOUS, 500.0)
    plant = fp.OneMass(INERTIA, law, fp.Unbalance(0.0, 0.0, offset))
    loop = fp.ClosedLoop(plant, fp.ProportionalIntegral(300.0, 600.0), observer or fp.NoObserver())
    run = fp.simulate(
        loop,
        fp.Multisine([1.0, 0.5], [0.5, 1.3], [0.0, 1.0]),
        dt=DT,
        duration=duration,
        stepping="sampled",
        substeps=4,
        record=("torque", "velocity", "position"),
    )
    held = {name: np.asarray(values) for name, values in run.signals.items()}
    velocity, position = (held[name] if name == motion else None for name in ("velocity", "position"))
    return fp.Log(np.asarray(run.time), held["torque"], velocity, position, None, DT, "made up")


EFP = fp.ExtendedFriedlandPark(INERTIA, 100.0, 40.0)
SMOOTH = fp.ExtendedFriedlandPark(INERTIA, 100.0, 40.0, 500.0)  # of the law's own form


@pytest.mark.parametrize("motion", ["velocity", "position"])
def test_friction_is_recovered_from_either_motion(motion):
    found = fp.estimate(record(motion=motion), SMOOTH)
    assert found.final["coulomb"] == pytest.approx(COULOMB, rel=0.01)
    assert found.final["viscous"] == pytest.approx(VISCOUS, rel=0.01)
    assert found.least_squares["coulomb"] == pytest.approx(COULOMB, rel=0.01)
    assert found.least_squares["viscous"] == pytest.approx(VISCOUS, rel=0.01)
    assert found.least_squares["free inertia"] == pytest.approx(INERTIA, rel=0.01)
    assert found.sentences == ()
    assert len(found.time) == len(found.estimates["coulomb"]) == found.velocity.size
    pytest.importorskip("pandas")
    frame = found.to_dataframe()
    assert list(frame.columns) == [*found.estimates, "velocity"]
    assert frame["coulomb"].iloc[-1] == found.estimates["coulomb"][-1]
    assert frame.index[0] == found.time[0]


def test_a_log_that_was_compensated_gives_the_same_friction():
    """The logged torque holds another observer's compensation; the control is formed without knowing it."""
    other = fp.ClassicalFriedlandPark(INERTIA, fp.LogCosh(50.0, 500.0), 0.0, 500.0)
    log = record(other)
    assert not np.allclose(log.torque, record().torque, atol=1.0)
    found = fp.estimate(log, EFP)
    # Compensated reversals are abrupt, and the period in which w crosses zero has no slope of |w|: a per cent.
    assert found.final["coulomb"] == pytest.approx(COULOMB, rel=0.02)
    assert found.final["viscous"] == pytest.approx(VISCOUS, rel=0.02)


def test_a_known_load_is_subtracted():
    log = record(offset=-6.0)
    known = fp.estimate(log, EFP, load=fp.Unbalance(0.0, 0.0, -6.0))
    assert known.final["coulomb"] == pytest.approx(COULOMB, rel=0.01)
    assert abs(known.least_squares["offset"]) < 0.1
    assert fp.estimate(log, EFP).least_squares["offset"] == pytest.approx(-6.0, abs=0.1)


def test_pairing_half_a_period_wrong_biases_the_viscous_part():
    """Why the torque is paired with the middle of its period: at t_k the mass times half a period leaks in."""
    log = record()
    right = fit_pairs(log.torque[:-1], log.velocity, DT, INERTIA)
    # A shift of the velocity by a whole period is two half periods to one side.
    late = fit_pairs(log.torque[1:-1], log.velocity[:-1], DT, INERTIA)
    assert abs(right["viscous"] - VISCOUS) < 0.2
    assert abs(late["viscous"] - VISCOUS) > 5.0 * abs(right["viscous"] - VISCOUS)


def test_slow_gains_over_many_passes_are_least_squares():
    """In the limit the observer's average error equation is the normal equations, slopes being the regressor."""
    log = record(duration=10.0)
    inertia = INERTIA * 1.02  # wrong, so that least squares is not simply the truth
    fitted = fit_pairs(log.torque[:-1], log.velocity, DT, inertia)
    # Offset-free normal equations, with instruments (sign, w) over all periods.
    middle, rate = 0.5 * (log.velocity[1:] + log.velocity[:-1]), np.diff(log.velocity) / DT
    instruments = np.stack([np.sign(middle), middle])
    solution = np.linalg.solve(instruments @ instruments.T, instruments @ (log.torque[:-1] - inertia * rate))
    # A 20th of the usual gains: the estimates hardly move within a pass, as averaging needs.
    slow = fp.ExtendedFriedlandPark(inertia, 4.0, 2.0)
    found = fp.estimate(log, slow, passes=30, average=log.duration)
    assert found.final["coulomb"] == pytest.approx(solution[0], rel=5e-3)
    assert found.final["viscous"] == pytest.approx(solution[1], rel=5e-3)
    assert fitted["coulomb"] == pytest.approx(solution[0], rel=0.02)


def test_the_causal_differentiator_says_how_late_it_is():
    log = record(motion="position", duration=5.0)
    velocity, how = measured_velocity(log, differentiator="causal", cutoff=50.0)
    truth = record(duration=5.0).velocity
    assert "ms late" in how
    late = float(how.rpartition("at 50 Hz, ")[2].split()[0]) * 1e-3
    shifts = np.linspace(0.0, 8e-3, 161)
    time = np.arange(len(truth)) * DT
    # The first 100 samples are the start of the filter.
    misfit = [np.sum((np.interp(time - shift, time, truth) - velocity)[100:] ** 2) for shift in shifts]
    assert shifts[int(np.argmin(misfit))] == pytest.approx(late, abs=3e-4)


def test_an_estimate_that_cannot_converge_is_told():
    found = fp.estimate(record(duration=2.0), fp.ExtendedFriedlandPark(INERTIA, 0.1, 40.0))
    assert any(said.startswith("the viscous estimate (b_hat) cannot converge here") for said in found.sentences)
    assert "(b_hat) cannot converge here" in str(found)


@pytest.mark.parametrize(
    "observer",
    [
        fp.ClassicalFriedlandPark(INERTIA, fp.Absolute(40.0), VISCOUS),
        fp.ModifiedFriedlandPark(INERTIA, fp.Absolute(40.0), VISCOUS),
        fp.NovelFriedlandPark(INERTIA, fp.Quadratic(40.0), COULOMB),
    ],
    ids=["cfp", "mfp", "nfp"],
)
def test_observers_of_one_parameter(observer):
    found = fp.estimate(record(), observer)
    truth = {"coulomb": COULOMB, "viscous": VISCOUS}
    for name, value in found.final.items():
        assert value == pytest.approx(truth[name], rel=0.02)


def test_a_pass_starts_where_the_last_one_ended():
    log = record(duration=3.3)  # ends in motion
    assert abs(log.velocity[-1]) > 0.2
    arrays = (jnp.asarray(log.torque[:-1]), jnp.asarray(log.velocity), jnp.asarray(DT))
    one, two = observe(EFP, *arrays, 1), observe(EFP, *arrays, 2)
    step = np.max(np.abs(np.diff(np.asarray(one["coulomb"])[-300:])))
    # A jump back to the initial state would be 20 N m; a pass that continues moves by about a step.
    assert abs(float(two["coulomb"][0] - one["coulomb"][-1])) < 3.0 * step


def test_picture_and_numbers(tmp_path):
    found = fp.estimate(record(duration=2.0), EFP)
    found.plot(tmp_path / "sub" / "friction.png")
    assert (tmp_path / "sub" / "friction.png").stat().st_size > 10_000
    curve = found.friction
    law = COULOMB * np.sign(curve.velocity) + VISCOUS * curve.velocity
    np.testing.assert_allclose(curve.middle, law, atol=0.05 * COULOMB)
    numbers = found.to_dict()
    assert numbers["estimates"]["coulomb"] == found.final["coulomb"]
    assert numbers["excitation"]["slow_mode_s"] > 0.0


TIME = DT * np.arange(501)
LOG = fp.Log(TIME, 20.0 * np.sign(np.cos(9.0 * TIME)), np.sin(9.0 * TIME), None, None, DT, "made up")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"dt": 2.0 * DT}, "its times are 0.001 s apart, but its dt is 0.002 s"),
        ({"dt": -DT}, "dt must be a positive time"),
        ({"dt": "1 ms"}, "dt must be a positive time"),
        ({"time": np.full(501, np.nan)}, "its times are nan s apart"),
        ({"torque": ["high"] * 501}, "torque must be numbers"),
        ({"torque": LOG.torque[:300]}, "torque has the shape .300,. and time .501,."),
        ({"velocity": LOG.velocity[:, None]}, "velocity has the shape .501, 1."),
    ],
)
def test_columns_that_make_no_log_are_refused(changes, said):
    with pytest.raises(fp.InputError, match=said):
        dataclasses.replace(LOG, **changes)


def test_a_log_may_be_of_lists_of_single_precision_and_with_a_break():
    assert dataclasses.replace(LOG, torque=LOG.torque.tolist()).torque.dtype == np.float64
    long = np.float32(DT) * np.arange(400_000, dtype=np.float32)
    assert fp.Log(long, long, long, None, None, DT).samples == 400_000
    broken = TIME + np.where(TIME > 0.2, 60.0, 0.0)
    assert dataclasses.replace(LOG, time=broken).dt == DT


@pytest.mark.parametrize(
    ("log", "observer", "options", "said"),
    [
        (LOG, fp.NoObserver(), {}, "estimates nothing"),
        (dataclasses.replace(LOG, velocity=None), EFP, {}, "neither velocity nor position"),
        (
            dataclasses.replace(LOG, time=LOG.time[:9], torque=LOG.torque[:9], velocity=LOG.velocity[:9]),
            EFP,
            {},
            "at least 16",
        ),
        (LOG, EFP, {"average": 9.0}, "at most the log.s 0.501 s, got 9 s"),
        (LOG, EFP, {"passes": 0}, "at least 1, got 0"),
        (LOG, fp.ExtendedFriedlandPark(INERTIA, 1e12, 1e12), {}, "smaller gains"),
        (dataclasses.replace(LOG, velocity=None, position=LOG.time), EFP, {"cutoff": 900.0}, "between 0 and 500 Hz"),
        (
            dataclasses.replace(LOG, velocity=None, position=LOG.time),
            EFP,
            {"differentiator": "spline"},
            "zero_phase",
        ),
    ],
)
def test_what_cannot_be_is_one_sentence(log, observer, options, said):
    with pytest.raises(fp.InputError, match=said):
        fp.estimate(log, observer, **options)
