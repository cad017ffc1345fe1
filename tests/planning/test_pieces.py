"""The pieces of a plan: limits, motions within them, rivals of a diagnosis, and the evidence's algebra."""

import json
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from plan_case import servo, servo_text

from fpjax.cli.command_line import main
from fpjax.errors import InputError
from fpjax.logs import read_log
from fpjax.model_file import dump_model, load_model
from fpjax.planning import Plan, Separation, Visible, plan
from fpjax.planning.expected_evidence import evidence_against
from fpjax.planning.explain import not_visible, separations
from fpjax.planning.limits import Limits, make_limits
from fpjax.planning.machines import detectable, make_shop, reported, rival
from fpjax.planning.measurement_model import make_measurement_model
from fpjax.planning.rivals import (
    hidden_by_twin,
    machines_of,
    read_diagnosis,
    rivals_of,
    settled_of,
    twins_of,
)
from fpjax.planning.trajectory import SWEEP, Shape, make_course
from fpjax.planning.trial import RunComparison
from fpjax.simulation.precision import double_precision


def given(**values):
    return {name: values.get(name) for name in ("speed", "acceleration", "torque", "travel", "duration")}


LIMITS = Limits(5.0, 40.0, 3.0, 6.0, 4.0)


def shop_of(model):
    return make_shop(model, LIMITS, 3.0, 0.5)


# --- limits


def test_what_was_given_is_kept_and_what_was_chosen_is_said():
    notes = []
    limits = make_limits(servo(), None, given(speed=5.0, torque=3.0), notes)
    assert (limits.speed, limits.torque) == (5.0, 3.0)
    # 90 % of the torque, less Coulomb and viscous friction at the top speed, over the inertia
    assert limits.acceleration == pytest.approx((0.9 * 3.0 - 0.5 - 0.04 * 5.0) / 0.05)
    said = " ".join(notes)
    assert all(f"--{name} is not given" in said for name in ("acceleration", "travel", "duration"))
    assert "--speed is not given" not in said


def test_a_log_says_how_far_the_machine_went():
    time = np.arange(2000) * 1e-3
    motion = 0.2 * np.sin(2 * np.pi * time)
    rate = 0.2 * 2 * np.pi * np.cos(2 * np.pi * time)
    log = read_log({"time": time, "torque": np.sign(rate), "velocity": rate, "position": motion})
    limits = make_limits(servo("both"), log, given(), [])
    assert limits.travel == pytest.approx(0.4, rel=0.02)
    assert limits.speed == pytest.approx(0.4 * np.pi, rel=0.02)
    assert limits.torque == pytest.approx(1.2)
    assert limits.duration == pytest.approx(512 * 4e-3)  # the shortest that can be diagnosed at that rate


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (given(torque=0.4), "cannot move within its limits"),
        (given(torque=0.52), "cannot move within its limits"),
        (given(speed=-1.0), "--speed must be a number above zero"),
        (given(duration=0.5), "too short for a diagnosis"),
        (given(duration=1e9), "simulates a small part only: give at most"),
        (given(speed=50.0, travel=1e-3, acceleration=1.0), "contradict each other"),
    ],
)
def test_limits_that_cannot_be_are_one_sentence(values, words):
    with pytest.raises(InputError, match=words) as error:
        make_limits(servo(), None, values, [])
    assert "\n" not in str(error.value)


def test_a_speed_that_travel_and_acceleration_do_not_allow_is_lowered():
    notes = []
    limits = make_limits(servo(), None, given(speed=5.0, torque=3.0, travel=0.1, acceleration=10.0), notes)
    assert limits.speed == pytest.approx(1.0)
    assert any("at most" in note for note in notes)


def test_the_models_own_torque_limit_holds():
    model = servo(gains="kp = 4.0\nki = 40.0\nlimit = 2.0")
    assert make_limits(model, None, given(torque=9.0), []).torque == 2.0
    assert make_limits(model, None, given(), []).torque == 2.0


def test_the_limits_of_the_file_hold_and_an_option_may_only_be_tighter(tmp_path):
    path = tmp_path / "servo.toml"
    plain = servo()
    path.write_text(plain.text + "[limits]\nspeed = 4.0\ntravel = 3.0\n")
    model, notes = load_model(path), []
    assert load_model(dump_model(model)).limits == model.limits == {"speed": 4.0, "travel": 3.0}
    limits = make_limits(model, None, given(speed=9.0, torque=3.0), notes)
    assert (limits.speed, limits.travel) == (4.0, 3.0)
    said = " ".join(notes)
    assert "--speed 9 is above [limits] speed of the model: 4 rad/s is used" in said
    assert "--travel is not given: 3 rad is used, as [limits] of the model" in said
    assert make_limits(model, None, given(travel=1.0, torque=3.0), []).travel == 1.0
    with pytest.raises(InputError, match=r"\[limits\] speeed is not known: did you mean 'speed'"):
        load_model(plain.text + "[limits]\nspeeed = 4.0\n")
    with pytest.raises(InputError, match=r"\[limits\] travel must be above zero, got 0 rad"):
        load_model(plain.text + "[limits]\ntravel = 0.0\n")


# --- motions


@pytest.mark.parametrize("limits", [LIMITS, Limits(5.0, 2.0, 9.0, 6.0, 4.0), Limits(5.0, 400.0, 9.0, 0.05, 4.0)])
def test_no_motion_leaves_its_limits_whatever_its_numbers(limits):
    course = make_course(limits, 4e-3, 0.02)
    rng = np.random.default_rng(1)
    with double_precision():
        for _ in range(10):
            shape = Shape(*(jnp.asarray(part + rng.normal(0, 3, part.shape)) for part in course.starts(0, 1)[0]))
            motion = course.motion(shape)
            assert float(jnp.max(jnp.abs(motion.speed))) <= limits.speed
            assert float(jnp.max(jnp.abs(motion.acceleration))) <= limits.acceleration
            assert float(jnp.ptp(motion.position)) <= limits.travel
            ends = np.abs(np.asarray(motion.speed)[[0, -1]])
            assert np.max(ends) < 1e-9 * limits.speed
            assert abs(float(motion.position[-1])) < 1e-6 * limits.travel + 1e-9


@pytest.mark.parametrize("limits", [LIMITS, Limits(5.0, 2.0, 9.0, 6.0, 4.0), Limits(5.0, 400.0, 9.0, 0.05, 4.0)])
def test_one_start_is_the_sweep_which_uses_its_limits(limits):
    course = make_course(limits, 4e-3, 0.02)
    with double_precision():
        start = course.starts(0, 7)[SWEEP]
        begun, sweep = course.motion(start), course.within(course.usual[:, 1])
    speed = np.asarray(sweep.speed)
    assert np.max(np.abs(np.asarray(begun.speed) - speed)) < 0.1 * np.max(np.abs(speed))  # the tones are hardly there
    used = [
        np.max(np.abs(speed)) / limits.speed,
        np.max(np.abs(np.asarray(sweep.acceleration))) / limits.acceleration,
        np.ptp(np.asarray(sweep.position)) / limits.travel,
    ]
    assert 0.99 < max(used) <= 1.0
    apart = np.diff(np.flatnonzero(np.diff(np.sign(course.usual[1:, 1]))))  # samples from one reversal to the next
    assert np.mean(apart[:3]) > 3.0 * np.mean(apart[-3:])


def test_position_speed_and_acceleration_are_one_motion():
    course = make_course(LIMITS, 4e-3, 0.02)
    with double_precision():
        motion = course.motion(course.starts(0, 1)[0])
    speed = np.gradient(np.asarray(motion.position), 4e-3)
    assert np.max(np.abs(speed - np.asarray(motion.speed))[2:-2]) < 0.01 * LIMITS.speed


# --- machines and rivals


def test_every_effect_has_a_detectable_size_that_is_not_neutral():
    shop = shop_of(servo("both"))
    assert len(shop.effects()) == 24
    for effect in shop.effects():
        variant = detectable(shop, effect)
        neutral = {p.name: p.neutral(shop.setting) for p in effect.parameters}
        assert any(variant.values.get(name, value) != value for name, value in neutral.items()), effect.name


def test_a_rival_has_the_parameters_that_the_diagnosis_reported():
    shop = shop_of(servo())
    for effect in shop.effects():
        told = {name: one.value for name, one in reported(detectable(shop, effect), shop).items()}
        again = rival(shop, effect.name, told)
        assert again is not None
        found = {name: one.value for name, one in reported(again, shop).items()}
        for name, value in told.items():
            assert abs(found[name]) == pytest.approx(abs(value), rel=1e-6, abs=1e-12), (effect.name, name)


def test_delays_without_a_position_are_twins_and_with_one_are_not():
    for sensors, twins in (("velocity", 1), ("both", 0)):
        shop = shop_of(servo(sensors))
        variants = [detectable(shop, e) for e in shop.effects() if e.name in ("actuator_delay", "velocity_delay")]
        assert len(twins_of(shop, variants)) == twins


def test_a_torque_gain_hides_behind_the_nominal_numbers():
    shop = shop_of(servo())
    by_name = {effect.name: effect for effect in shop.effects()}
    assert "exactly the same log" in hidden_by_twin(shop, detectable(shop, by_name["torque_gain_error"]))
    assert hidden_by_twin(shop, detectable(shop, by_name["stribeck"])) == ""


def ranking(*entries):
    return {
        "verdict": "unexplained",
        "ranking": [
            {"effect": name, "probability": p, "parameters": {}, "indistinguishable_from": same}
            for name, p, same in entries
        ],
    }


def test_rivals_are_the_first_its_confusables_and_what_is_near():
    found = rivals_of(ranking(("stribeck", 0.3, ["presliding"]), ("viscous_error", 0.1, []), ("presliding", 0.0, [])))
    assert [one.name for one in found] == ["stribeck", "presliding", "viscous_error"]


def test_a_second_cause_that_is_settled_is_in_every_rival_and_no_rival():
    content = ranking(("stribeck", 0.3, ["viscous_error"]), ("constant_torque", 0.2, []), ("viscous_error", 0.1, []))
    content |= {"verdict": "explained", "causes": ["stribeck", "constant_torque"]}
    content["ranking"][1]["parameters"] = {"torque": {"value": 0.07}}
    rivals, settled = rivals_of(content), settled_of(content)
    assert [one.name for one in rivals] == ["stribeck", "viscous_error"]
    assert [one.name for one in settled] == ["constant_torque"]
    assert all(one.values["torque"] == 0.07 for one in machines_of(shop_of(servo()), rivals, settled))


@pytest.mark.parametrize(
    "content",
    [
        ranking(("stribeck", 0.96, []), ("viscous_error", 0.001, [])),
        {**ranking(("stribeck", 0.5, ["presliding"])), "verdict": "no_gap"},
        {**ranking(), "verdict": "unexplained"},
    ],
)
def test_a_diagnosis_without_rivals_is_told_so(content):
    with pytest.raises(InputError, match="no rivals"):
        rivals_of(content)


def test_rivals_that_are_all_exact_twins_need_another_sensor():
    content = ranking(("actuator_delay", 0.4, ["velocity_delay"]), ("velocity_delay", 0.4, []))
    with pytest.raises(InputError, match=re.compile("inseparable by any run.*second sensor")):
        plan(servo(), diagnosis=content, speed=5.0, torque=3.0, travel=6.0, duration=4.0)


def test_a_folder_without_a_diagnosis_is_told_so(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_diagnosis(tmp_path)
    (tmp_path / "diagnosis.json").write_text("{}")
    with pytest.raises(InputError, match="no ranking"):
        read_diagnosis(tmp_path)


# --- the evidence


def test_what_may_move_is_projected_out():
    notes = []
    model = servo()
    measurement = make_measurement_model(model, LIMITS, None, 0.05, {"velocity": 0.01}, notes)
    count, windows = len(measurement.modes.gain), len(measurement.starts)
    rng = np.random.default_rng(0)
    with double_precision():
        tangents = jnp.asarray(1e4 * rng.normal(size=(2, count, windows)))
        shifts = jnp.asarray(1e4 * rng.normal(size=(2, count, windows)))
        shift = rng.normal(size=(2, windows))
        inside = jnp.einsum("p,pmw->mw", jnp.asarray([0.3, -0.2]), tangents)
        inside = inside + jnp.einsum("sw,smw->mw", jnp.asarray(shift), shifts)
        outside = jnp.asarray(rng.normal(size=(count, windows)))
        nothing = evidence_against(measurement, inside, tangents, shifts)
        some = evidence_against(measurement, outside, tangents, shifts)
        more = evidence_against(measurement, 3.0 * outside + inside, tangents, shifts)
    assert float(nothing.nats) < 1e-3 * float(some.nats)
    assert float(more.nats) > 2.0 * float(some.nats)
    # Small misfits, alike in all windows, cost half their square in deviations, whatever the bands.
    alike = 1e-3 * jnp.tile(outside[:, :1], windows)
    whitened = np.asarray(alike) / np.sqrt(measurement.variance)[:, None]
    with double_precision():
        small = float(evidence_against(measurement, alike, *nothing_free(count, windows)).nats)
    assert small == pytest.approx(0.5 * np.sum(whitened**2), rel=1e-4)


def nothing_free(count, windows):
    return jnp.zeros((0, count, windows)), jnp.zeros((1, count, windows))


def test_what_one_window_alone_shows_is_no_evidence():
    measurement = make_measurement_model(servo(), LIMITS, None, 0.05, {"velocity": 0.01}, [])
    count, windows = len(measurement.modes.gain), len(measurement.starts)
    random = np.random.default_rng(0)
    spread = random.normal(size=(count, windows))
    alone = np.zeros((count, windows))
    alone[:, 2] = np.sqrt(windows) * random.normal(size=count)
    with double_precision():
        free = nothing_free(count, windows)
        everywhere, once = (
            float(evidence_against(measurement, jnp.asarray(one), *free).nats) for one in (spread, alone)
        )
    assert everywhere > 10.0
    assert once < 1e-9


@pytest.mark.parametrize("sensors", ["velocity", "position", "both"])
def test_the_missing_torque_is_that_which_makes_the_misfit(sensors):
    noise = {"velocity": 1e-4, "position": 1e-6}
    measurement = make_measurement_model(servo(sensors), LIMITS, None, 0.05, noise, [])
    modes, windows = measurement.modes, len(measurement.starts)
    time = np.linspace(0.0, 1.0, measurement.samples)[:, None]
    torque = 0.3 * np.sin(2.0 * np.pi * 5.0 * time + np.arange(windows))  # N m
    plain = np.where(modes.sensor, 0.0, np.sqrt(modes.gain))[:, None] * (modes.torque.T @ torque)
    with double_precision():
        told = evidence_against(measurement, jnp.asarray(modes.turn.T @ plain), *nothing_free(len(plain), windows))
    assert float(told.missing) == pytest.approx(np.sqrt(np.mean(torque**2)), rel=0.1)


def test_the_evidence_has_a_gradient():
    measurement = make_measurement_model(servo(), LIMITS, None, 0.05, {"velocity": 0.01}, [])
    count, windows = len(measurement.modes.gain), len(measurement.starts)
    rng = np.random.default_rng(0)
    with double_precision():
        c, t, x = (jnp.asarray(rng.normal(size=(*k, count, windows))) for k in ((), (1,), (2,)))

        def nats(scale):
            return evidence_against(measurement, scale * c, t, x).nats

        slope, step = jax.grad(nats)(1.0), 1e-5
        assert float(slope) == pytest.approx(float(nats(1 + step) - nats(1 - step)) / (2 * step), rel=1e-5)


# --- sentences, pictures, files


def example(aim="rivals"):
    time = np.arange(501) * 4e-3
    speed = 5.0 * np.sin(np.pi * time)
    motion = {"speed": speed, "acceleration": np.gradient(speed, 4e-3), "position": np.cumsum(speed) * 4e-3}
    pairs = separations(
        ["stribeck", "viscous_error", "actuator_delay"],
        [RunComparison(0, 1, ()), RunComparison(1, 0, ()), RunComparison(0, 2, ()), RunComparison(1, 2, ())],
        np.array([40.0, 30.0, 2.0, 0.0]), ["here", "there", "x", "y"],
        {frozenset(("viscous_error", "actuator_delay")): "They make exactly the same log."},
    )  # fmt: skip
    visible = (
        Visible("stribeck", {"stribeck_torque": (0.1, "N m")}, 40.0, 0.07),
        Visible("torque_saturation", {"limit": (3.0, "N m")}, 1e-10, 0.0, unseen=not_visible(1e-10, 0.0, nowhere=True)),
        Visible("quadratic_drag", {}, 30.0, 0.002, unseen=not_visible(30.0, 0.002, nowhere=False)),
        Visible("viscous_error", {}, 4.0, 0.1, unseen=not_visible(4.0, 0.1, nowhere=False)),
    )
    return Plan(
        aim, time, speed, motion, np.sign(speed), LIMITS, visible if aim == "effects" else (),
        pairs if aim == "rivals" else (), (), 0.01, {"velocity": 0.005}, False, False, "N m", "servo.toml", 3,
        (1.0, 2.0), "converged",
    )  # fmt: skip


def test_every_pair_has_its_sentence_the_weaker_direction_and_its_twins():
    pairs = {one.between: one for one in example().separations}
    first = pairs["stribeck", "viscous_error"]
    assert first.nats == 30.0
    assert "30 nats, 10 needed; because" in first.sentence
    assert "there" in first.sentence
    weak = pairs["stribeck", "actuator_delay"]
    assert not weak.separated
    assert "will not decide" in weak.sentence
    assert weak.experiment in weak.sentence
    twin = pairs["viscous_error", "actuator_delay"]
    assert twin.twins
    assert "inseparable by any run" in twin.sentence


def test_what_the_run_does_not_show_is_said_with_its_reason_and_is_not_the_least_visible():
    made = example("effects")
    assert made.decided == 1
    assert "show 1 of the 4 effects" in made.sentence()
    assert "least visible is stribeck: 40 nats, 10 needed, and 7.0% of the commanded torque" in made.sentence()
    limit, drag, viscous = made.unseen()
    assert re.search("torque saturation: no motion that was tried within the limits", limit)
    assert re.search("quadratic drag: its torque is less than 1% of what this run commands", drag)
    assert re.search("viscous error: the evidence stays below the 10 nats", viscous)
    assert not_visible(20.0, 0.02, nowhere=False) == ""
    assert not_visible(20.0, None, nowhere=False) == ""
    assert "1e-10" not in str(made)


@pytest.mark.parametrize("aim", ["rivals", "effects"])
def test_a_plan_writes_what_a_drive_and_a_model_read(aim, tmp_path):
    made = example(aim)
    paths = made.write(tmp_path / "next")
    assert sorted(paths) == ["plan.json", "plan.png", "reference.csv"]
    content = json.loads(paths["plan.json"].read_text())
    assert content["aim"] == aim
    assert content["limits"]["speed"] == 5.0
    (tmp_path / "servo.toml").write_text(
        servo_text() + 'duration = 2.0\n[reference]\ntype = "recorded"\nfile = "next/reference.csv"\n'
    )
    reference = load_model(tmp_path / "servo.toml").needed_reference()
    np.testing.assert_allclose(np.asarray(reference.readout(jnp.asarray(made.time))), made.reference, atol=1e-6)
    assert str(made)
    assert isinstance(made.sentence(), str)
    assert all(isinstance(one, Separation) for one in made.separations)


# --- the command


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--torque", "0.1"], "cannot move within its limits"),
        (["--speed", "-3"], "--speed must be a number above zero"),
        (["--seconds", "0"], "--seconds must be above zero"),
        (["--diagnosis", "nowhere"], "cannot be read"),
        (["--diagnosis", "nowhere", "--log", "x.csv"], "not allowed with"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(words, sentence, tmp_path, capsys):
    path = tmp_path / "servo.toml"
    path.write_text(servo_text())
    try:
        code = main(["plan", "--model", str(path), "--out", str(tmp_path / "out"), "--no-cache", *words])
    except SystemExit as error:
        code = error.code
    assert code == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert "Traceback" not in said
