"""The verbs as a user calls them: a file, a model or blocks; results that say, draw and tabulate themselves."""

import dataclasses
import pathlib
import warnings

import equinox as eqx
import jax
import numpy as np
import pytest

import fpjax as fp
import tuning

GIMBAL = pathlib.Path(__file__).parents[2] / "examples" / "gimbal.toml"


@pytest.fixture(scope="module")
def run():
    return fp.simulate(GIMBAL, duration=2.0)


def test_a_path_a_model_and_its_blocks_give_the_same(run):
    model = fp.load_model(GIMBAL)
    of_model = fp.simulate(model, duration=2.0)
    of_blocks = fp.simulate(
        model.loop, model.reference, dt=model.dt, duration=2.0, solver="exact", stepping="sampled", record=("torque",)
    )
    np.testing.assert_array_equal(run.signals["torque"], of_model.signals["torque"])
    np.testing.assert_allclose(run.signals["torque"], of_blocks.signals["torque"], rtol=1e-9)


def test_a_run_of_a_file_is_plain_numpy(run):
    assert isinstance(run.time, np.ndarray)
    assert all(isinstance(values, np.ndarray) for values in run.signals.values())
    with warnings.catch_warnings():  # double-precision jax arrays would warn here
        warnings.simplefilter("error")
        assert np.sqrt(np.mean(run.signals["velocity"] ** 2)) > 0.0


def test_a_run_says_its_numbers_and_its_precision(run):
    said = str(run)
    assert "2001 samples of 0.001 s, float64" in said
    assert "coulomb, mean of the last quarter" in said
    assert "(true 20)" in said
    assert "f64[" not in repr(run)


def test_a_run_draws_itself_and_becomes_a_frame(run, tmp_path):
    figure = run.plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000
    assert [axes.get_ylabel() for axes in figure.axes][-2:] == ["coulomb [N m]", "viscous [N m s/rad]"]
    pandas = pytest.importorskip("pandas")
    frame = run.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert frame.index.name == "time"
    assert len(frame) == 2001
    log = fp.read_log(frame)
    np.testing.assert_array_equal(log.torque, run.signals["torque"])
    np.testing.assert_array_equal(fp.read_log(log.to_dataframe()).position, log.position)
    with pytest.raises(fp.InputError, match=r"made of Run: give .* its to_dataframe"):
        fp.diagnose(run, GIMBAL)


def test_a_log_and_its_estimation(run, tmp_path):
    log = fp.Log(
        np.asarray(run.time), np.asarray(run.signals["torque"]), np.asarray(run.signals["measured_velocity"]), None,
        None, 1e-3, "made up",
    )  # fmt: skip
    labels = [axes.get_ylabel() for axes in log.plot(tmp_path / "log.png").axes]
    assert labels == ["torque [N m]", "velocity [rad/s]"]
    asked = dataclasses.replace(log, reference=log.velocity + 1e-3).plot().axes[-1]
    assert asked.get_ylabel() == "reference [rad/s]"
    assert (tmp_path / "log.png").exists()
    by_path = fp.estimate(log, GIMBAL)
    by_block = fp.estimate(log, fp.load_model(GIMBAL).loop.observer)
    assert by_path.final == pytest.approx(by_block.final, rel=1e-9)


@pytest.mark.long  # fifteen seconds of compiling
def test_tune_takes_a_file(tmp_path):
    result = tuning.tune(GIMBAL, duration=1.0, method=tuning.LevenbergMarquardt(2), starts=1)
    assert list(result.gains) == ["observer.gain_1", "observer.gain_2"]
    result.plot(tmp_path / "tune.png")
    assert (tmp_path / "tune.png").exists()


def test_linearise_takes_a_file_a_model_or_blocks():
    model = fp.load_model(GIMBAL)
    of_file = fp.linearise(GIMBAL, 1.0)
    of_blocks = fp.linearise(model.loop, 1.0, dt=model.dt, solver="exact")
    assert of_file.dt == model.dt
    assert of_file.margins().phase_margin == pytest.approx(of_blocks.margins().phase_margin, rel=1e-4)
    assert "phase margin" in repr(of_file)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: fp.linearise(3), "linearise got int '3'"),
        (lambda: fp.linearise(fp.load_model(GIMBAL).loop), "linearise needs dt"),
        (lambda: fp.linearise(GIMBAL, at="fast"), "must be a speed"),
        (lambda: fp.diagnose("run.csv", GIMBAL, effects=("stribeck",)), "effects holds str 'stribeck'"),
        (lambda: fp.improve("run.csv", GIMBAL, diagnosis=3), "improve got int '3' as its diagnosis"),
        (lambda: fp.plan(3), "plan got int '3': give a Model"),
        (lambda: fp.plan(GIMBAL, speed="quick"), "speed must be a number, got str 'quick'"),
        (lambda: fp.plan(GIMBAL, diagnosis=3), "plan got int '3' as its diagnosis"),
        (lambda: fp.load_model(3), "A model cannot be read from int '3'"),
    ],
)
def test_a_wrong_kind_of_argument_is_one_sentence(call, sentence):
    with pytest.raises(fp.InputError, match=sentence) as raised:
        call()
    assert "\n" not in str(raised.value)


class OwnLaw(fp.AbstractStaticFriction):
    """A law whose fields are plain numbers."""

    coulomb: float = 3.0
    steepness: float = 100.0

    def level(self, motion):
        return self.coulomb

    def drag(self, motion):
        return 0.1 * motion.velocity


def test_an_own_law_with_plain_numbers_runs_and_is_tunable_by_name():
    loop = fp.ClosedLoop(fp.OneMass(1.0, OwnLaw()), fp.ProportionalIntegral(10.0, 10.0))
    run = fp.simulate(loop, fp.Sine(1.0, 1.0), dt=1e-3, duration=1.0, record=("velocity",))
    packaged = fp.ClosedLoop(fp.OneMass(1.0, fp.CoulombViscous(3.0, 0.1, 100.0)), fp.ProportionalIntegral(10.0, 10.0))
    same = fp.simulate(packaged, fp.Sine(1.0, 1.0), dt=1e-3, duration=1.0, record=("velocity",))
    np.testing.assert_allclose(run.signals["velocity"], same.signals["velocity"], rtol=1e-12)


def test_plain_numbers_of_an_own_law_have_names_and_gradients():
    loop = fp.ClosedLoop(fp.OneMass(1.0, OwnLaw()), fp.ProportionalIntegral(10.0, 10.0))
    assert {"plant.friction.coulomb", "plant.friction.steepness"} <= set(fp.parameter_names(loop))

    def loss(coulomb):
        changed = fp.set_parameters(loop, {"plant.friction.coulomb": coulomb})
        measures = {"error": fp.MeanSquare()}
        return fp.simulate(changed, fp.Sine(1.0, 1.0), dt=1e-3, duration=0.2, measures=measures).measures["error"]

    difference = float(loss(3.01) - loss(2.99)) / 0.02
    assert float(jax.grad(loss)(3.0)) == pytest.approx(difference, rel=1e-3)


LOOP = fp.ClosedLoop(fp.OneMass(1.0, fp.NoFriction()), fp.Proportional(1.0))
NOISY = fp.ClosedLoop(fp.OneMass(1.0, fp.NoFriction()), fp.Proportional(1.0), sensor=fp.Gyro(1e-3))
NOISE = {
    "references": fp.Constant(1.0), "dt": 1e-3, "samples": 5, "stepping": "sampled", "objective": "tracking",
    "parameters": ["controller.kp"],
}  # fmt: skip
ROWS = jax.vmap(lambda _: LOOP.init())(np.ones(3))


def with_level(coulomb):
    return fp.ClosedLoop(fp.OneMass(1.0, fp.SmoothCoulomb(coulomb, 100.0)), fp.Proportional(1.0))


BAD = {
    "a number for a loop": (lambda: fp.simulate(3), "simulate got int '3': give a ClosedLoop"),
    "a block for a loop": (lambda: fp.simulate(fp.NoFriction(), dt=1e-3), "got a NoFriction with no parameters"),
    "a number for a reference": (lambda: fp.simulate(LOOP, 1.0, dt=1e-3), "reference is float '1.0'.*fp.Constant"),
    "no reference": (lambda: fp.simulate(LOOP, dt=1e-3, duration=1.0), "reference is nothing"),
    "no step": (lambda: fp.simulate(LOOP, fp.Constant(1.0)), "needs dt"),
    "a file that is not there": (lambda: fp.simulate("servos.toml"), "does not exist"),
    "a number for a log": (lambda: fp.estimate(3, GIMBAL), "estimate got int '3' as its log"),
    "a number for an observer": (lambda: fp.estimate("log.csv", 3), "estimate got int '3': give an observer"),
    "a number to tune": (lambda: tuning.tune(3), "tune got int '3'"),
    "blocks to tune without a step": (lambda: tuning.tune(LOOP, fp.Constant(1.0)), "tune needs a reference and dt"),
    "text for a step": (lambda: fp.simulate(GIMBAL, dt="fast"), "dt must be a number of seconds, got str 'fast'"),
    "text for a duration": (lambda: tuning.tune(GIMBAL, duration="x"), "duration must be a number of seconds, got"),
    "half a sample": (lambda: fp.simulate(GIMBAL, samples=10.5), "samples must be a whole number, got float 10.5"),
    "text for a parameter": (lambda: fp.OneMass("heavy", fp.NoFriction()), "a number or an array, got the text"),
    "numbers for blocks": (
        lambda: fp.simulate(fp.ClosedLoop(1, 2), fp.Constant(1.0), dt=1e-3, samples=5),
        "The loop's plant is",
    ),
    "a number for a law": (
        lambda: fp.simulate(fp.ClosedLoop(fp.OneMass(1.0, 3), fp.Proportional(1.0)), fp.Constant(1.0), dt=1e-3),
        "The plant's friction is .*3",
    ),
    "text for the number of starts": (lambda: tuning.tune(GIMBAL, starts="3"), "starts must be a whole number, got"),
    "one name that is not known": (
        lambda: tuning.tune(GIMBAL, parameters="observer.gain_3"), "'observer.gain_3' is not known",
    ),
    "a record without values": (lambda: fp.simulate(GIMBAL, fp.Recorded([], 1e-3)), r"shape \(0,\): give one number"),
    "a record in columns": (
        lambda: fp.simulate(LOOP, fp.Recorded(np.ones((3, 2)), 1e-3), dt=1e-3, samples=5), r"shape \(3, 2\)",
    ),
    "a record with a gap": (lambda: fp.Recorded([1.0, np.nan], 1e-3), "Recorded: values must be finite, 1 of 2"),
    "a sine of no size": (lambda: fp.Sine(np.nan, 1.0), "Sine: amplitude must be finite, got nan"),
    "a sine that is aliased": (
        lambda: fp.simulate(LOOP, fp.Sine(1.0, 700.0), dt=1e-3, samples=5), "700 Hz cannot be followed at dt = 0.001 s",
    ),
    "a sine to tune on that is aliased": (lambda: tuning.tune(GIMBAL, fp.Sine(1.0, 700.0)), "must stay below 500 Hz"),
    "no plants": (lambda: tuning.tune(GIMBAL, plants={"plant.inertia": []}), r"values of shape \(0,\)"),
    "parameters without names": (lambda: fp.set_parameters(LOOP, [("plant.inertia", 2.0)]), "got list .* by name"),
    "no substep": (lambda: fp.simulate(GIMBAL, substeps=0), "substeps = 0 must both be at least 1"),
    "no substep to tune with": (lambda: tuning.tune(GIMBAL, substeps=0), "substeps = 0"),
    "no substep to linearise": (lambda: fp.linearise(GIMBAL, substeps=0), "substeps = 0 must be at least 1"),
    "an array for a parameter": (
        lambda: fp.simulate(with_level([1.0, 2.0]), fp.Constant(1.0), dt=1e-3, samples=5),
        r"got plant.friction.coulomb of the shape \(2,\): give one number",
    ),
    "an array for a parameter to tune beside": (
        lambda: tuning.tune(
            with_level([1.0]), fp.Constant(1.0), dt=1e-3, samples=5, objective="tracking", parameters=["controller.kp"]
        ),
        "got plant.friction.coulomb of the shape",
    ),
    "an array in a reference": (
        lambda: fp.simulate(LOOP, fp.Sine([1.0, 2.0], 1.0), dt=1e-3, samples=5), "got reference.amplitude of the shape",
    ),
    "an array for a step": (lambda: fp.simulate(LOOP, fp.Constant(1.0), dt=np.ones(2), samples=5), "got ndarray"),
    "no state": (lambda: fp.simulate(GIMBAL, initial={}), "initial is dict '{}': give loop.init()"),
    "a state of another loop": (lambda: fp.simulate(GIMBAL, initial=LOOP.init()), "initial.controller has other parts"),
    "a state of arrays": (
        lambda: fp.simulate(LOOP, fp.Constant(1.0), dt=1e-3, samples=5, initial=ROWS),
        "initial.plant has other parts than loop.init.*, or parts of other shapes",
    ),
    "a state of the other stepping": (
        lambda: fp.simulate(
            GIMBAL, stepping="continuous", solver="rk4", initial=fp.simulate(GIMBAL, samples=5).final_state
        ),
        "initial.period has other parts",
    ),
    "no state to identify from": (
        lambda: fp.identify(LOOP, fp.Constant(1.0), {"velocity": np.ones(5)}, ["plant.inertia"], dt=1e-3, initial={}),
        "initial is dict",
    ),
    "an array beside what is identified": (
        lambda: fp.identify(
            with_level([1.0]), fp.Constant(1.0), {"velocity": np.ones(5)}, ["plant.inertia"], dt=1e-3
        ),
        "got plant.friction.coulomb of the shape",
    ),
    "a state of another loop to linearise at": (
        lambda: fp.linearise(GIMBAL, LOOP.init(), reference=1.0), "at.controller has other parts",
    ),
    "a number for a key": (lambda: fp.simulate(GIMBAL, key=3), r"key is int '3': give a jax.random key"),
    "a seed below zero to tune": (lambda: tuning.tune(GIMBAL, seed=-1), "seed must be a whole number from 0 to .*-1"),
    "half a seed to improve": (lambda: fp.improve("run.csv", GIMBAL, seed=0.5), "seed must be .*, got 0.5"),
    "a seed below zero to plan": (lambda: fp.plan(GIMBAL, seed=-1), "seed must be a whole number"),
    "a seed below zero of plants": (
        lambda: tuning.population(LOOP, {"plant.inertia": 0.1}, count=2, seed=-1), "seed must be a whole number",
    ),
    "a seed below zero of noise": (lambda: tuning.tune(NOISY, **NOISE, noise_seeds=[-1]), "noise_seeds must be"),
    "one number for seeds of noise": (lambda: tuning.tune(NOISY, **NOISE, noise_seeds=3), "a list of seeds.*got 3"),
    "nothing recorded": (
        lambda: fp.simulate(LOOP, fp.Constant(1.0), dt=1e-3, samples=5).plot(),
        "Nothing was recorded",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", list(BAD))
def test_bad_input_is_one_sentence(case):
    call, sentence = BAD[case]
    with pytest.raises(fp.InputError, match=sentence) as error:
        call()
    assert "\n" not in str(error.value)


def test_arrays_and_states_under_vmap_are_single_numbers():
    def last(coulomb, speed):
        start = with_level(1.0).init()
        start = eqx.tree_at(lambda at: at.plant.velocity, start, speed)
        run = fp.simulate(with_level(coulomb), fp.Constant(0.0), dt=1e-3, samples=5, record="velocity", initial=start)
        return run.signals["velocity"][-1]

    both = jax.vmap(last)(jax.numpy.array([1.0, 2.0]), jax.numpy.array([3.0, 4.0]))
    np.testing.assert_allclose(both, [last(1.0, jax.numpy.array(3.0)), last(2.0, jax.numpy.array(4.0))], rtol=1e-12)


@pytest.mark.parametrize(("first", "then"), [(0.02, 2e-3), (2e-3, 0.02)])
def test_a_run_goes_on_under_another_delay(first, then):
    def run(delay, initial=None):
        loop = fp.ClosedLoop(fp.OneMass(1.0, fp.NoFriction()), fp.Proportional(1.0), actuator=fp.Actuator(delay=delay))
        return fp.simulate(loop, fp.Constant(1.0), dt=1e-3, samples=30, stepping="sampled", initial=initial)

    assert not run(then, run(first).final_state).diverged


def test_the_fields_of_a_users_own_reference_are_its_own():
    class Wave(fp.AbstractReference):
        frequency: float = 600.0  # rad/s
        upper: float = float("inf")

        def readout(self, time):
            return jax.numpy.minimum(jax.numpy.sin(self.frequency * time), self.upper)

    loop = fp.ClosedLoop(fp.OneMass(1.0, fp.Viscous(0.5)), fp.Proportional(5.0))
    assert not fp.simulate(loop, Wave(), dt=1e-3, samples=11, stepping="sampled").diverged
