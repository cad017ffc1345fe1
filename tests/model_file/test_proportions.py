"""Sizes that have no sense beside the machine's others are said; those that have one are not spoken of."""

import pathlib

import pytest
from model_files import LARGE_BODY

from fpjax import InputError, load_model

MODEL = (
    LARGE_BODY
    + """
[controller]
type = "pi"
kp = 800.0
ki = 8000.0
[observer]
type = "efp"
gain_1 = 10.0
gain_2 = 100.0
[reference]
type = "sine"
amplitude = 1.0
frequency = 0.5
[simulation]
dt = 1e-3
duration = 4.0
stepping = "sampled"
solver = "exact"
"""
)
RK4 = 'solver = "rk4"'
LIMIT = "[actuator]\nlimit = 200.0\n"
GALLERY = sorted((pathlib.Path(__file__).parents[2] / "examples" / "gallery").glob("*.toml"))


def changed(*changes):
    text = MODEL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new) if old else text + new
    return text


def said(text):
    return [note for note in load_model(text).notes if "is not given" not in note]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([("", "[actuator]\ndead_zone = 1e20\n")], "[actuator] dead_zone = 1e+20 N m is over 1000 times"),
        ([("", "[actuator]\noffset = -1e8\n")], "[actuator] offset = 1e+08 N m is over 1000 times"),
        ([("", LIMIT + "offset = 250.0\n")], "[actuator] offset = 250 N m is no less than limit = 200 N m"),
        ([("", LIMIT + "cogging_amplitude = 300.0\ncogging_periods = 7.0\n")], "the limit cannot hold against it"),
        ([("", '[load]\ntype = "unbalance"\namplitude = 1e20\n')], "[load] amplitude = 1e+20 N m"),
        ([("", '[load]\ntype = "position_torque"\ncosine = [1.0]\nsine = [1.0]\nperiods = 1e8\n')], "[load] periods"),
        ([("coulomb = 20.0", "coulomb = 1e20")], "needs 1e+20 N m: it is not followed"),
        ([("viscous = 2.0", "viscous = 1e12")], "gives at most"),
        ([("inertia = 10.0", "inertia = 1e12")], "gives at most"),
        ([("kp = 800.0", "kp = 1e-9"), ("ki = 8000.0", "ki = 0.0")], "gives at most"),
        ([("kp = 800.0", "kp = 1e20")], "the loop runs away"),
        ([("ki = 8000.0", "ki = 1e20")], "the loop runs away"),
        ([("", "[actuator]\nlimit = 0.1\n")], "the limit of 0.1 N m: it is not followed"),
        ([("viscous = 2.0", "viscous = 2.0\noffset = 1e9")], "[friction] offset = 1e+09 N m"),
        ([("viscous = 2.0", "viscous = 2.0\ndrift_amplitude = 1e9\ndrift_time = 1.0")], "[friction] drift_amplitude"),
        ([("viscous = 2.0", "viscous = 2.0\nstribeck_torque = 5.0\nstribeck_velocity = 1e6")], "is never reached"),
        ([("gain_1 = 10.0", "gain_1 = 10.0\ninertia = 1e-4")], "[observer] inertia = 0.0001 is 1e-05 times"),
        ([("gain_1 = 10.0", "gain_1 = 10.0\nsteepness = 1e20")], "[observer] steepness = 1e+20 s/rad smooths over"),
        ([("", "[feedforward]\nviscous = 1e9\n")], "[feedforward] viscous comes to 1e+09 N m"),
        ([("", "[feedforward]\ncoulomb = 1e9\nspeed = 0.1\n")], "[feedforward] coulomb = 1e+09 N m"),
        ([("", "[sensor]\nnoise = 1e6\n")], "[sensor] noise = 1e+06 rad/s is no less than the fastest reference"),
        ([("", "[sensor]\nbias = -5.0\n")], "[sensor] bias = 5 rad/s"),
        ([("", '[sensor]\ntype = "gyro"\nrandom_walk = 10.0\n')], "[sensor] random_walk = 10 rad/s/sqrt(s)"),
        ([("", "[sensor]\nlag = 60.0\n")], "[sensor] lag = 60 s is longer than the run (4 s)"),
        ([("", "[transmission]\nstiffness = 1e20\n")], "[transmission] stiffness = 1e+20 N m/rad resonates at"),
        ([("", "[transmission]\nstiffness = 1e4\ndamping = 1e20\n")], "[transmission] damping = 1e+20"),
        ([("viscous = 2.0", "viscous = 2.0\nbristle_deflection = 1e-3\nbristle_damping = 1e20")], "bristle_damping"),
        (
            [
                ('"coulomb_viscous"', '"lugre"\nstatic = 25.0\nstribeck_velocity = 0.1\nbristle_stiffness = 1e20'),
                ('solver = "exact"', RK4),
                ("gain_1 = 10.0", "gain_1 = 10.0\nsteepness = 100.0"),
            ],
            "[friction] bristle_stiffness = 1e+20 N m/rad resonates at",
        ),
    ],
)
def test_a_size_that_has_no_sense_beside_the_others_is_said(changes, words):
    (note,) = (note for note in said(changed(*changes)) if words in note)
    assert len(note) <= 300
    assert note.endswith(".")
    assert "\n" not in note


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([("", "[actuator]\ngain = 1e20\n")], r"\[actuator\] gain = 1e\+20 is too large"),
        ([("", "[actuator]\nlag = 1e6\n")], r"\[actuator\] lag = 1e\+06 s is too large"),
        ([("", "[sensor]\nscale = 1e20\n")], r"\[sensor\] scale = 1e\+20 is too large"),
        ([("", "[sensor]\nposition_noise = 1e20\n")], "position_noise"),
        ([("amplitude = 1.0", "amplitude = 1e20")], "amplitude"),
        ([("frequency = 0.5", "frequency = 0.5\nphase = 1e20")], "phase"),
        ([("gain_1 = 10.0", "gain_1 = 1e20")], "gain_1"),
        ([("viscous = 2.0", "viscous = 2.0\nbristle_deflection = 1e20")], "bristle_deflection"),
    ],
)
def test_a_number_that_no_machine_has_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        load_model(changed(*changes))


@pytest.mark.parametrize("path", GALLERY, ids=[path.stem for path in GALLERY])
def test_machines_that_people_have_are_taken_without_a_word(path):
    assert not [note for note in load_model(path).notes if "check" in note]


@pytest.mark.parametrize(
    "change",
    [
        ("", "[actuator]\nlimit = 1e20\n"),  # as good as none
        ("", LIMIT + "offset = 30.0\ncogging_amplitude = 20.0\ncogging_periods = 30.0\ndead_zone = 2.0\n"),
        ("", "[sensor]\nnoise = 0.01\nlag = 0.01\nbias = 0.02\n"),
        ("", '[load]\ntype = "unbalance"\namplitude = 500.0\n'),
        ("", "[transmission]\nstiffness = 1e5\ndamping = 10.0\nbacklash = 0.01\n"),
        ("amplitude = 1.0", "amplitude = 1e-3"),
        ("amplitude = 1.0", "amplitude = 0.0"),
        ("kp = 800.0", "kp = 1e5"),
    ],
)
def test_what_has_a_sense_is_taken_without_a_word(change):
    assert not said(changed(change))


def test_units_of_a_linear_axis_are_its_own():
    (note,) = said(changed(("", '[units]\nmotion = "linear"\n[actuator]\ndead_zone = 1e20\n')))
    assert "dead_zone = 1e+20 N is over" in note


def test_a_position_reference_is_differentiated():
    text = changed(
        ('type = "pi"\nkp = 800.0\nki = 8000.0', 'type = "position_cascade"\nkp = 10.0\nkv = 800.0'),
        ("", '[units]\nreference = "position"\n[sensor]\nnoise = 2.0\n'),
    )
    assert not said(text)  # 1 rad at 0.5 Hz is up to 3.14 rad/s
    assert (
        "noise = 4 rad/s is no less than the fastest reference, 3.14 rad/s"
        in said(text.replace("noise = 2.0", "noise = 4.0"))[0]
    )
