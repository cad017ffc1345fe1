# ruff: noqa: E501 (tables of cases)
"""servo.toml: what is written is what is simulated, to the last bit; bad input is one sentence."""

import dataclasses
import pathlib

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from model_files import LARGE_BODY, LARGE_LOOP, same

import fpjax as fp
from fpjax.blocks.friction.bristles import Bristles
from fpjax.blocks.friction.general import GeneralFriction
from fpjax.blocks.position_torque import ConstantTorque, Loads, PositionTorque
from fpjax.blocks.servo_sensor import ServoSensor
from fpjax.model_file import simplified

TEXT = (
    LARGE_BODY
    + LARGE_LOOP
    + """
[reference]
type = "sine"
amplitude = 1.0
frequency = 1.0
[simulation]
dt = 1e-4
duration = 0.5
"""
)


def changed(old, new):
    assert old in TEXT
    return TEXT.replace(old, new)


def test_a_model_is_what_its_file_says():
    model = fp.load_model(TEXT)
    loop = model.loop
    assert isinstance(loop.plant, fp.OneMass)
    assert float(loop.plant.inertia) == 10.0
    assert isinstance(loop.controller, fp.ProportionalIntegral)
    assert isinstance(loop.observer, fp.ExtendedFriedlandPark)
    assert float(loop.observer.inertia) == 10.0
    assert (model.dt, model.duration, model.stepping, model.solver) == (1e-4, 0.5, "continuous", "rk4")
    assert model.nominal["coulomb"] == 20.0
    assert model.stepper().samples == 5001


def test_a_safe_steepness_is_chosen_and_said():
    model = fp.load_model(TEXT)
    assert fp.stiffness_number(model.loop, 1e-4) < 0.51 * fp.RungeKutta4.stability_limit
    assert "[friction] steepness is not given: 6960 s/rad was chosen" in model.notes[0]
    given_one = fp.load_model(changed("viscous = 2.0", "viscous = 2.0\nsteepness = 1000.0"))
    assert given_one.notes == ()
    assert float(given_one.loop.observer.steepness) == 1000.0
    signed = fp.load_model(changed("viscous = 2.0", 'viscous = 2.0\nsteepness = "sign"'))
    assert signed.loop.plant.friction.steepness is None
    assert signed.loop.observer.steepness is None


def test_the_exact_solver_takes_the_set_valued_law_and_samples():
    model = fp.load_model(changed("duration = 0.5", 'duration = 0.5\nsolver = "exact"'))
    assert model.loop.plant.friction.steepness is None
    assert model.stepping == "sampled"
    assert same(model, fp.load_model(fp.dump_model(model)))
    with pytest.raises(fp.InputError, match="only works at sample instants"):
        fp.load_model(changed("duration = 0.5", 'duration = 0.5\nsolver = "exact"\nstepping = "continuous"'))


def test_a_path_gives_the_same_as_its_text(tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text(TEXT)
    assert eqx.tree_equal(fp.load_model(path).loop, fp.load_model(TEXT).loop)
    assert fp.load_model(path).path == path
    with pytest.raises(fp.InputError, match=r"did you mean 'servo\.toml'"):
        fp.load_model(tmp_path / "servos.toml")
    with pytest.raises(fp.InputError, match="is a folder"):
        fp.load_model(tmp_path)


def test_gains_that_are_not_written_are_placed_and_said():
    bare = changed("gain_1 = 298.0\ngain_2 = 72.6\n", "").replace("kp = 150.0\nki = 200.0\n", "")
    model = fp.load_model(bare)
    observer, controller = model.loop.observer, model.loop.controller
    # tau = sqrt(8 dt T); the mean of |w| sign(w) and of w^2 of a half period of the unit sine are 1 and 1/2.
    tau = (8.0 * 1e-4 * 0.5) ** 0.5
    assert float(observer.gain_2) == pytest.approx(10.0 / tau, rel=0.01)
    assert float(observer.gain_1) == pytest.approx(2.0 * 10.0 / tau, rel=0.01)
    omega = (0.2 / 1e-4 * 10.0 / 0.5) ** 0.5
    assert float(controller.kp) == pytest.approx(1.4 * omega * 10.0, rel=0.01)
    assert float(controller.ki) == pytest.approx(omega**2 * 10.0, rel=0.01)
    assert sum("chosen by pole placement" in note for note in model.notes) == 2
    assert same(model, fp.load_model(fp.dump_model(model)))
    with pytest.raises(fp.InputError, match=r"\[controller\] kp is missing, and without \[reference\]"):
        fp.load_model(bare.split("[reference]")[0] + "[simulation]\ndt = 1e-4\n")


def test_under_exact_sticking_the_observer_gets_a_steepness_that_is_said():
    text = changed("duration = 0.5", 'duration = 0.5\nsolver = "exact"')
    model = fp.load_model(text)
    assert float(model.loop.observer.steepness) == pytest.approx(0.8 * 2.0 * 10.0 / (20.0 * 1e-4), rel=0.01)
    assert any("[observer] steepness is not given: 8000 s/rad was chosen" in note for note in model.notes)


BAD = {
    "a misspelt key": (("inertia = 10.0", "inertai = 10.0"), r"\[plant\] inertai is not known: did you mean 'inertia'"),
    "a misspelt section": (("[plant]", "[plants]"), r"section \[plants\] is not known: did you mean 'plant'"),
    "a misspelt type": (('"one_mass"', '"onemass"'), r"\[plant\] type = 'onemass' is not known: did you mean 'one_mass'"),
    "a missing key": (("coulomb = 20.0\n", ""), r"\[friction\] coulomb is missing: write coulomb = ... in N m"),
    "a missing type": (('type = "pi"\n', ""), r"\[controller\] type is missing"),
    "a missing section": (('[simulation]\ndt = 1e-4\nduration = 0.5\n', ""), r"section \[simulation\] is missing"),
    "a negative inertia": (("10.0", "-10.0"), r"\[plant\] inertia must be above zero, got -10 kg m\^2"),
    "a negative friction": (("= 20.0", "= -20.0"), r"\[friction\] coulomb must be zero or more, got -20 N m"),
    "a negative gain": (("298.0", "-298.0"), r"\[observer\] gain_1 must be .*, got -298"),
    "text for a number": (("10.0", '"10"'), r"\[plant\] inertia = '10' is text: write a number without quotes"),
    "yes or no": (("10.0", "true"), r"is yes or no: write a number"),
    "not a number": (("10.0", "nan"), r"\[plant\] inertia must be finite, got nan kg m\^2"),
    "too many digits": (("10.0", "1" + 400 * "0"), r"\[plant\] inertia must be finite, got inf kg m\^2"),
    "no step": (("1e-4", "0.0"), r"\[simulation\] dt must be above zero, got 0 s"),
    "a short duration": (("0.5", "1e-5"), r"duration = 1e-05 s is shorter than one step"),
    "a huge duration": (("0.5", "1e9"), r"duration = 1e\+09 s is 1e\+13 steps"),
    "an unknown solver": (("0.5", '0.5\nsolver = "rk45"'), r"solver = 'rk45' is not known: did you mean 'rk4'"),
    "fractional substeps": (("0.5", "0.5\nsubsteps = 1.5"), r"substeps must be a whole number from 1 to 100000, got 1.5"),
    "broken TOML": (("inertia = 10.0", "inertia = "), r"is not valid TOML: .*line"),
    "a key twice": (("inertia = 10.0", "inertia = 1.0\ninertia = 10.0"), r"is not valid TOML"),
    "a key outside": (("[plant]", "inertia = 1.0\n[plant]"), r"section \[inertia\] is not known"),
    "a value for a section": (("[plant]", "load = 1.0\n[plant]"), r"load is a section"),
    "mixed units": (("[plant]", '[units]\nmotion = "linear"\ntorque = "N m"\n[plant]'), r"is not of a linear axis|does not go with a linear axis"),
    "a torque in millinewtonmetres": (("[plant]", '[units]\ntorque = "mNm"\n[plant]'), r"another unit than the log is read in: write .* N m"),
    "a sensor in continuous time": (
        ("0.5", '0.5\nstepping = "continuous"\n[sensor]\nnoise = 0.1'),
        r"\[sensor\] only works at sample instants",
    ),
    "a delay in milliseconds": (("[plant]", "[actuator]\ndelay = 2.0\n[plant]"), r"20000 periods of dt .* check its unit"),
    "half a cogging": (("[plant]", "[actuator]\ncogging_amplitude = 2.0\n[plant]"), r"cogging needs both"),
    "both ways": (("coulomb = 20.0", "coulomb = 20.0\ncoulomb_positive = 1.0"), r"has both coulomb and coulomb_positive"),
    "one direction": (("coulomb = 20.0", "coulomb_positive = 1.0"), r"coulomb_negative is missing"),
    "stribeck without speed": (("viscous = 2.0", "viscous = 2.0\nstribeck_torque = 1.0"), r"stribeck_velocity is missing"),
    "a gear that locks itself": (("viscous = 2.0", "viscous = 2.0\nload_coefficient = 1.0"), r"load_coefficient must be below 1, got 1"),
    "a load coefficient in per cent": (("viscous = 2.0", "viscous = 2.0\nload_coefficient = 12"), r"load_coefficient must be between 0 and 1, got 12"),
    "a table of nothing": (("[plant]", "[[learned]]\nat = [0, 1]\ntorque = [0, 1]\n[plant]"), r'\[learned\] of is missing: write of = "velocity"'),
    "a table of a misspelt variable": (("[plant]", '[[learned]]\nof = "speed"\nat = [0, 1]\ntorque = [0, 1]\n[plant]'), r"of = 'speed' is not known"),
    "a table that goes back": (("[plant]", '[[learned]]\nof = "time"\nat = [0, 2, 1]\ntorque = [0, 1, 2]\n[plant]'), r"\[learned\] the points in at must be finite and increase"),
    "a table of unequal lists": (("[plant]", '[[learned]]\nof = "time"\nat = [0, 2]\ntorque = [0, 1, 2]\n[plant]'), r"at and torque have 2 and 3 entries"),
    "a period that is too short": (("[plant]", '[[learned]]\nof = "position"\nat = [0, 6.3]\ntorque = [0, 1]\nperiod = 6.28\n[plant]'), r"no less than the period 6.28"),
    "a period of a velocity": (("[plant]", '[[learned]]\nof = "velocity"\nat = [0, 1]\ntorque = [0, 1]\nperiod = 2.0\n[plant]'), r'of = "velocity" has no period'),
    "a jump beside zero": (("[plant]", '[[learned]]\nof = "velocity"\nat = [0, 1, 1]\ntorque = [0, 1, 2]\n[plant]'), r"at = 1 occurs twice"),
    "a jump that pushes": (("[plant]", '[[learned]]\nof = "velocity"\nat = [-1, 0, 0, 1]\ntorque = [0, 30, -30, 0]\n[plant]'), r"jumps down by 60 N m at zero velocity"),
    "bristles on two bodies": (
        ("viscous = 2.0", "viscous = 2.0\nbristle_deflection = 1e-3\n[transmission]\nstiffness = 1e4"),
        r"not possible for a law with bristles",
    ),
    "uneven harmonics": (
        ("viscous = 2.0", "viscous = 2.0\nposition_cosine = [1.0]\nposition_sine = [1.0, 2.0]"),
        r"have 1 and 2 entries",
    ),
    "another law's key": (('"coulomb_viscous"', '"lugre"'), r"\[friction\] static is missing"),
    "a reference without a file": (('"sine"\namplitude = 1.0\nfrequency = 1.0', '"recorded"'), r"file is missing"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_is_one_sentence(name):
    (old, new), match = BAD[name]
    with pytest.raises(fp.InputError, match=match) as caught:
        fp.load_model(changed(old, new))
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_units_follow_the_axis():
    linear = changed("[plant]", '[units]\nmotion = "linear"\nsensors = "position"\n[plant]')
    model = fp.load_model(linear)
    assert model.linear
    assert model.units.torque == "N"
    with pytest.raises(fp.InputError, match="inertia must be above zero, got -10 kg"):
        fp.load_model(linear.replace("10.0", "-10.0"))
    volts = changed("[plant]", '[units]\ntorque = "V"\n[plant]')
    with pytest.raises(fp.InputError, match=r"inertia must be above zero, got -10 V s\^2/rad"):
        fp.load_model(volts.replace("10.0", "-10.0"))


@pytest.mark.parametrize("spelt", ["N m", "Nm", "N*m", "N·m", "N.m"])
def test_newton_metres_are_one_unit_however_they_are_written(spelt):
    assert fp.load_model(changed("[plant]", f'[units]\ntorque = "{spelt}"\n[plant]')).units.torque == "N m"


def test_what_is_missing_is_asked_for_only_where_it_is_needed():
    text = TEXT[: TEXT.index("[controller]")] + "[simulation]\ndt = 1e-3\n"
    model = fp.load_model(text)
    assert not model.controller_known
    for ask, match in (
        (model.needed_controller, "enough to estimate and diagnose"),
        (model.needed_reference, r"\[reference\] is missing"),
        (model.needed_duration, r"\[simulation\] duration is missing"),
    ):
        with pytest.raises(fp.InputError, match=match):
            ask()
    assert 'type = "unknown"' in fp.dump_model(model)


def test_a_recorded_reference_is_read_beside_the_file(tmp_path):
    time = 1e-3 * np.arange(50)
    rows = "\n".join(f"{t!r},{t * 2!r}" for t in time.tolist())
    (tmp_path / "run.csv").write_text(f"time,wanted\n{rows}\n")
    recorded = '[reference]\ntype = "recorded"\nfile = "run.csv"\ncolumns = "reference=wanted:deg/s"'
    text = changed('[reference]\ntype = "sine"\namplitude = 1.0\nfrequency = 1.0', recorded)
    (tmp_path / "servo.toml").write_text(text)
    model = fp.load_model(tmp_path / "servo.toml")
    np.testing.assert_allclose(model.reference.values, np.radians(2 * time), rtol=1e-12)
    # written into another folder, it names the same log
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "tuned.toml").write_text(fp.dump_model(model))
    again = fp.load_model(tmp_path / "other" / "tuned.toml")
    np.testing.assert_array_equal(again.reference.values, model.reference.values)


def test_neutral_effects_are_dropped_and_the_rest_simulates_the_same():
    zero, law = jnp.zeros(()), GeneralFriction(coulomb=20.0, viscous=2.0, coulomb_difference=3.0)
    law = dataclasses.replace(law, position_cosine=(zero,) * 3, position_sine=(zero,) * 3)
    load = Loads((fp.NoLoad(), PositionTorque((zero,), (zero,), 1.0), PositionTorque((zero + 0.5,), (zero,), 6.0)))
    loop = fp.ClosedLoop(
        fp.OneMass(inertia=10.0, friction=law, load=load),
        fp.ProportionalIntegral(kp=150.0, ki=200.0),
        actuator=fp.Actuator(gain=1.0, delay=0.0, limit=1e30, dead_zone=0.0, offset=0.0),
        sensor=ServoSensor(lag=2e-3),
    )
    model = simplified(fp.load_model(TEXT), loop)
    text = fp.dump_model(model)
    assert isinstance(model.loop.plant.friction, fp.AsymmetricCoulombViscous)
    assert isinstance(model.loop.actuator, fp.IdealActuator)
    assert model.loop.plant.friction.steepness is not None
    assert "[actuator]" not in text
    assert "coulomb_positive = 23.0" in text
    assert 'type = "position_torque"' in text
    assert "lag = 0.002" in text
    assert model.stepping == "sampled"
    signed = dataclasses.replace(model.loop.plant.friction, steepness=None)
    plain = eqx.tree_at(lambda at: at.plant.friction, model.loop, signed, is_leaf=lambda x: x is None)
    runs = [
        fp.simulate(each, model.reference, dt=1e-4, duration=0.3, stepping="sampled", record=("velocity",))
        for each in (loop, plain)
    ]
    np.testing.assert_allclose(runs[0].signals["velocity"], runs[1].signals["velocity"], rtol=0, atol=1e-12)


def test_neutral_bristles_sensor_and_load_share_survive_a_file():
    law = Bristles(GeneralFriction(coulomb=20.0, viscous=2.0), deflection=1e-3, damping=3.0)
    loop = dataclasses.replace(fp.load_model(TEXT).loop, plant=fp.OneMass(inertia=10.0, friction=law))
    model = simplified(fp.load_model(TEXT), loop)
    assert same(model, fp.load_model(fp.dump_model(model)))
    assert "bristle_deflection = 0.001" in fp.dump_model(model)


def test_what_belongs_to_an_absent_effect_is_not_written():
    law = GeneralFriction(coulomb=20.0, viscous=2.0, drag_coefficient=0.1, drift_amplitude=0.0, drift_time=2.5)
    law = dataclasses.replace(law, stribeck_torque=0.0, stribeck_velocity=0.3, position_periods=7.0)
    loop = dataclasses.replace(fp.load_model(TEXT).loop, plant=fp.OneMass(inertia=10.0, friction=law))
    text = fp.dump_model(simplified(fp.load_model(TEXT), loop))
    assert "drag_coefficient = 0.1" in text
    assert not [word for word in ("drift", "stribeck", "periods") if word in text]


def test_constant_torques_become_the_offset_wherever_they_stand():
    inner = Loads((fp.Unbalance(3.0, 0.5, 0.25), ConstantTorque(1.0)))
    load = Loads((inner, ConstantTorque(0.5), ConstantTorque(0.0)))
    base = fp.load_model(TEXT)
    plant = dataclasses.replace(base.loop.plant, load=load)
    model = simplified(base, dataclasses.replace(base.loop, plant=plant))
    assert "offset = 1.75" in fp.dump_model(model)
    assert "offset = 1.75" in fp.dump_model(dataclasses.replace(base, loop=dataclasses.replace(base.loop, plant=plant)))
    assert same(model, fp.load_model(fp.dump_model(model)))
    motion = fp.Motion(jnp.asarray(0.1), jnp.asarray(0.7), jnp.asarray(0.0))
    np.testing.assert_allclose(model.loop.plant.load.readout(motion), load.readout(motion), rtol=1e-15)


def test_a_known_unbalance_and_what_a_fit_adds_to_it_are_one():
    ripple = PositionTorque((0.25,), (0.5,), 6.0)
    load = Loads((ripple, fp.Unbalance(3.0, 0.5, 0.25), PositionTorque((0.75,), (-1.5,), 1.0)))
    base = fp.load_model(TEXT)
    plant = dataclasses.replace(base.loop.plant, load=load)
    model = simplified(base, dataclasses.replace(base.loop, plant=plant))
    text = fp.dump_model(model)
    assert text.count('type = "unbalance"') == 1
    assert text.count('type = "position_torque"') == 1
    assert same(model, fp.load_model(text))
    motion = fp.Motion(jnp.zeros(5), jnp.linspace(-3.0, 3.0, 5), jnp.zeros(5))
    np.testing.assert_allclose(model.loop.plant.load.readout(motion), load.readout(motion), rtol=0, atol=1e-14)


def test_a_block_without_words_is_said():
    class Own(fp.AbstractController):
        def init(self):
            return ()

        def derivative(self, state, reference, measurement):
            return ()

        def readout(self, state, reference, measurement):
            return reference

    model = fp.load_model(TEXT)
    loop = dataclasses.replace(model.loop, controller=Own())
    with pytest.raises(fp.InputError, match="cannot hold Own"):
        fp.dump_model(dataclasses.replace(model, loop=loop))


def test_every_example_is_read_and_written():
    for path in sorted((pathlib.Path(__file__).parents[2] / "examples").glob("*.toml")):
        model = fp.load_model(path)
        assert same(model, fp.load_model(fp.dump_model(model))), path.name


def test_the_documentation_names_every_key():
    from fpjax.model_file import body, controller, friction, observer, reading, reference

    text = (pathlib.Path(__file__).parents[2] / "docs" / "model_file.md").read_text()
    forms = [*body.PLANTS, *friction.FORMS, *controller.CONTROLLERS, *reference.REFERENCES]
    words = {form.name for form in forms} | {key.name for form in forms for key in form.keys}
    tables = (
        body.TRANSMISSION, body.ACTUATOR, body._SERVO, body._GYRO, body._ENCODER, body._UNBALANCE, body._HARMONICS,
        friction.DIRECTION, friction.GENERAL, friction.BRISTLES, controller._CASCADE, observer._GAINS,
    )  # fmt: skip
    words |= {key.name for keys in tables for key in keys}
    words |= {*observer.OBSERVERS, *body.SENSORS, *body.LOADS, *reading.SECTIONS, "transfer_function", "unknown"}
    assert {word for word in words if f"`{word}`" not in text and f"`[{word}]`" not in text} == set()


CASCADE = changed('type = "pi"\nkp = 150.0\nki = 200.0', 'type = "position_cascade"\nkp = 20.0\nkv = 150.0').replace(
    "[observer]", "[feedforward]\nvelocity = 0.9\ninertia = 9.0\ncoulomb = 18.0\nspeed = 0.05\n[observer]"
)
POSITION = '[units]\nreference = "position"\n'


@pytest.mark.parametrize(
    ("numerator", "name", "value", "written"),
    [
        ([0.5, 5.0], "through", 0.25, ([0.5, 5.0], [2.0, 0.3])),
        ([0.5, 5.0], "through", 10.0, ([10.0, 10.0 * 0.15 + 2.4625], [1.0, 0.15])),
        ([3.0], "output", [4.0], ([0.0, 4.0], [1.0, 0.15])),
    ],
)
def test_a_changed_transfer_function_is_written_as_the_loop_holds_it(numerator, name, value, written):
    text = (
        f'[plant]\ntype = "one_mass"\ninertia = 0.02\n[friction]\ntype = "none"\n[controller]\ntype = "transfer_function"\n'
        f"numerator = {numerator}\ndenominator = [2.0, 0.3]\n[simulation]\ndt = 1e-3\n"
    )
    model = fp.load_model(text)
    changed = dataclasses.replace(model, loop=fp.set_parameters(model.loop, {f"controller.{name}": value}))
    again = fp.load_model(fp.dump_model(changed))
    table = again.sections["controller"]
    for key, coefficients in zip(("numerator", "denominator"), written, strict=True):
        np.testing.assert_allclose(table[key], coefficients, rtol=1e-12)
    for leaf in ("transition", "output", "through", "sampled_transition"):
        np.testing.assert_allclose(getattr(again.loop.controller, leaf), getattr(changed.loop.controller, leaf))
    with pytest.raises(fp.InputError, match="sampled matrices are not those of its transition"):
        fp.dump_model(dataclasses.replace(model, loop=fp.set_parameters(model.loop, {"controller.drive": [7.0]})))


def test_a_feedforward_of_a_position_cascade_is_written_and_read_again():
    model = fp.load_model(POSITION + CASCADE)
    controller = model.loop.controller
    assert isinstance(controller, fp.PositionFeedforward)
    assert isinstance(controller.controller, fp.PositionLoop)
    values = [float(getattr(controller, name)) for name in ("velocity", "inertia", "coulomb", "viscous", "lag")]
    assert values == [0.9, 9.0, 18.0, 0.0, 1e-4]
    assert same(model, fp.load_model(fp.dump_model(model)))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (TEXT + "[feedforward]\nvelocity = 1.0\n", "velocity"),  # no key of a velocity reference's
        (POSITION + CASCADE.replace('type = "position_cascade"\nkp = 20.0\nkv = 150.0', 'type = "p"\nkp = 2.0'), "needs a controller that follows"),
        (POSITION + CASCADE.replace("speed = 0.05\n", ""), "speed is missing"),
        (POSITION + CASCADE.replace("velocity = 0.9", "velocity = -1.0"), "velocity"),
    ],
)  # fmt: skip
def test_a_feedforward_that_cannot_be_is_one_sentence(text, sentence):
    with pytest.raises(fp.InputError, match=sentence):
        fp.load_model(text)
