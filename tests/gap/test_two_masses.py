"""A nominal model of two masses: its own shaft is taken as it is, on either side of the sensor."""

import numpy as np
import pytest

import fpjax as fp
from fpjax.gap.select.starts import alone
from fpjax.gap.verb import make_search, read_logs, read_model

TOTAL, STIFFNESS, DAMPING = 0.012, 74.0, 0.047  # kg m^2, N m/rad, N m s/rad: a shaft of 25 Hz
COULOMB, EXTRA, SLOW, VISCOUS = 0.35, 0.3, 0.3, 0.03  # N m, N m, rad/s, N m s/rad
MODEL = f"""
[units]
motion = "rotary"
reference = "none"
sensors = "position"
[plant]
type = "two_mass"
motor_inertia = {TOTAL / 2}
load_inertia = {TOTAL / 2}
stiffness = {STIFFNESS}
damping = {DAMPING}
[friction]
type = "stribeck"
coulomb = {COULOMB}
static = {COULOMB + EXTRA}
stribeck_velocity = {SLOW}
viscous = {VISCOUS}
[controller]
type = "unknown"
[simulation]
dt = 1e-3
"""


def recorded(seconds=8.0, dt=1e-3, fine=40, faster=1.0):
    """Two halves with friction on the load, whose position a fine encoder reads: semi-implicit Euler, dt / 40."""
    h = dt / fine
    motor, load, behind, position = 0.0, 0.0, 0.0, 0.0
    rows = []
    for time in dt * np.arange(round(seconds / dt)):
        wanted = 0.9 * np.sin(2 * np.pi * 0.11 * faster * time) + 0.15 * np.sin(2 * np.pi * 0.37 * faster * time)
        torque = np.clip(20.0 * (wanted - behind) - 0.25 * motor, -6.0, 6.0)
        rows.append((time, torque, position))
        for _ in range(fine):
            shaft = STIFFNESS * (behind - position) + DAMPING * (motor - load)
            motor += h * (torque - shaft) / (TOTAL / 2)
            level = COULOMB + EXTRA * np.exp(-((load / SLOW) ** 2))
            if load != 0.0 or abs(shaft) > level:
                way = np.sign(load) if load else np.sign(shaft)
                after = load + h * (shaft - level * way - VISCOUS * load) / (TOTAL / 2)
                load = 0.0 if after * load < 0.0 else after
            behind, position = behind + h * motor, position + h * load
    time, torque, position = np.array(rows).T
    step = 2 * np.pi / 65536
    return {"time": time, "torque": torque, "position": step * np.round(position / step)}


@pytest.fixture(scope="module")
def log():
    return recorded()


FEW = tuple(e for e in fp.gap.EFFECTS if e.name in ("stribeck", "presliding", "compliance", "torque_gain_error"))


@pytest.mark.long
def test_the_numbers_alone_go_on_from_their_fit_as_every_effect_does(log):
    (logs,) = read_logs(log)
    search = make_search(logs, [], read_model(MODEL), FEW)
    starts = alone(search)
    assert {start.like is search.base for start in starts if not start.effects} == {False, True}
    assert {start.like is search.base for start in starts if start.effects == FEW[:1]} == {False, True}


@pytest.mark.long  # a diagnosis each
def test_nothing_is_asserted_of_its_own_log(log):
    found = fp.diagnose(log, MODEL, effects=FEW)
    assert found.causes == ()
    assert found.gap.before < 0.05 * EXTRA  # the steps of Euler's rule and of the encoder


@pytest.mark.long
@pytest.mark.parametrize("effects", [FEW, FEW[:1]])
def test_what_is_missing_beside_the_shaft_is_found_with_its_size(log, effects):
    without = MODEL.replace(f"static = {COULOMB + EXTRA}", f"static = {COULOMB + 0.5 * EXTRA}")
    assert FEW[0].name == "stribeck"
    found = fp.diagnose(log, without, effects=effects)
    assert found.causes == ("stribeck",)
    assert found.ranking[0].parameters["stribeck_torque"].value == pytest.approx(EXTRA, rel=0.03)
    assert any("presliding is not tried" in warning for warning in found.warnings) == (effects is FEW)
    assert all(entry.effect != "presliding" for entry in found.ranking)


@pytest.mark.long
def test_a_wrong_inertia_leaves_the_known_shaft_as_it_is():
    """Stiffness and damping are as given, not the resonance; the log begins in motion, with the shaft wound up."""
    late = {name: values[500:] for name, values in recorded(6.0, faster=10.0).items()}
    light = MODEL.replace(f"_inertia = {TOTAL / 2}", f"_inertia = {0.7 * TOTAL / 2}")
    inertia = tuple(e for e in fp.gap.EFFECTS if e.name == "inertia_error")
    found = fp.diagnose(late, light, effects=FEW + inertia)
    assert found.causes == ("inertia_error",)
    assert found.ranking[0].parameters["inertia"].value == pytest.approx(TOTAL, rel=0.03)
    plant = fp.load_model(found.model).loop.plant
    assert float(plant.stiffness) == pytest.approx(STIFFNESS, rel=1e-4)
    assert float(plant.damping) == pytest.approx(DAMPING, rel=1e-4)
