"""The corrected model: whatever the cause, its servo.toml loads, runs, and holds what was fitted."""

import functools

import equinox as eqx
import numpy as np
import pytest
from model_files import SMALL_SERVO

from fpjax import AbstractLoad, load_model
from fpjax.cli import main
from fpjax.gap import EFFECTS, Setting
from fpjax.gap.answer.corrected import corrected_model
from fpjax.gap.answer.fitted_machine import machine_at
from fpjax.gap.simulate.family import Nominal, key_for, make_family

STEP = 0.01  # rad/s
NOMINAL = SMALL_SERVO + 'stepping = "sampled"\nsubsteps = 4\n'
VALUES = {"inertia": 0.05, "coulomb": 0.4, "viscous": 0.03}
SETTING = Setting(0.05, 0.4, 0.03, 0.4, 2.0, 0.8, 6.0, 10.0, 1e-3, effort=1.5, nominal=VALUES)
NAMES = [effect.name for effect in EFFECTS]


class Spring(AbstractLoad):
    """A load that no file knows."""

    def readout(self, motion):
        """Torque [N m]."""
        return 0.1 * motion.position


@functools.cache
def corrected(name):
    """(machine, servo.toml) of one effect, every parameter of it away from neutral."""
    model = load_model(NOMINAL)
    if name == "velocity_quantisation":  # read from the data, no change of the machine
        family = make_family(key_for((), SETTING), Nominal(model.loop.plant), EFFECTS, SETTING)
        machine = machine_at(family, family.neutral(SETTING))
        return machine, corrected_model(model, machine, STEP)
    effect = EFFECTS[NAMES.index(name)]
    family = make_family(key_for((effect,), SETTING), Nominal(model.loop.plant), EFFECTS, SETTING)
    vector = family.neutral(SETTING)
    for parameter in effect.parameters:
        value = vector[family.index(parameter.name)] + 0.5 * parameter.scale(SETTING)
        vector[family.index(parameter.name)] = np.clip(value, parameter.low(SETTING), parameter.high(SETTING))
    for key, value in effect.starts(SETTING)[0].items():
        vector[family.index(key)] = value
    machine = machine_at(family, vector)
    return machine, corrected_model(model, machine)


@pytest.fixture(scope="module")
def nominal_velocity(tmp_path_factory):
    """True velocity of the nominal model's run."""
    return run(NOMINAL, tmp_path_factory.mktemp("nominal"))


def run(text, folder):
    """The measured velocity of `fpjax simulate`."""
    (folder / "servo.toml").write_text(text)
    assert main(["simulate", str(folder / "servo.toml"), "--out", str(folder), "--no-plots", "--no-cache"]) == 0
    table = np.genfromtxt(folder / "simulation.csv", delimiter=",", names=True)
    return table["velocity"]


# One effect of each block that a file writes; the others, which are the same blocks with other parameters, are `long`.
FIRST = {"stribeck", "backlash", "actuator_delay", "cogging", "velocity_lag"}


@pytest.mark.parametrize(
    "name",
    [name if name in FIRST else pytest.param(name, marks=pytest.mark.long) for name in NAMES]
    + ["velocity_quantisation"],
)
def test_the_corrected_model_loads_and_runs(name, nominal_velocity, tmp_path):
    _, (text, missing) = corrected(name)
    assert missing == ""
    velocity = run(text, tmp_path)
    assert np.all(np.isfinite(velocity))
    assert np.max(np.abs(velocity)) < 4.0
    assert np.max(np.abs(velocity - nominal_velocity)) > 1e-5, "the file lost the effect"


def test_a_block_without_words_says_why():
    machine, _ = corrected("coulomb_error")
    sprung = eqx.tree_at(lambda at: at.plant.load, machine, Spring())
    text, missing = corrected_model(load_model(NOMINAL), sprung)
    assert text == ""
    assert "cannot be written as servo.toml" in missing
    assert "Spring" in missing
