"""Damaged model files, some hundred of them: each is read and written again, or refused in one sentence."""

import warnings

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sentences import faults

from fpjax import FpjaxWarning, InputError, dump_model, load_model
from fpjax.output.toml_text import write

PLAIN = {
    "plant": {"type": "one_mass", "inertia": 0.1},
    "friction": {"type": "coulomb_viscous", "coulomb": 0.2, "viscous": 0.02},
    "controller": {"type": "pi", "kp": 3.0, "ki": 10.0},
    "reference": {"type": "sine", "amplitude": 1.0, "frequency": 1.0},
    "simulation": {"dt": 1e-3, "duration": 1.0},
}
OTHERS = [
    {"friction": {"type": "coulomb_viscous", "coulomb": 0.2, "viscous": 0.02, "load_coefficient": 0.2}},
    {"friction": {"type": "coulomb_viscous", "coulomb": 0.2, "viscous": 0.02, "stribeck_torque": 0.1,
                  "stribeck_velocity": 0.05, "drag_coefficient": 0.01, "position_cosine": [0.05],
                  "position_sine": [0.02], "drift_amplitude": 0.1, "drift_time": 3.0}},
    {"friction": {"type": "coulomb_viscous", "coulomb_positive": 0.2, "coulomb_negative": 0.3,
                  "viscous_positive": 0.1, "viscous_negative": 0.2}},
    {"friction": {"type": "coulomb_viscous", "coulomb": 0.2, "viscous": 0.02, "bristle_deflection": 1e-3}},
    {"friction": {"type": "lugre", "coulomb": 0.2, "static": 0.3, "stribeck_velocity": 0.01,
                  "bristle_stiffness": 100.0}},
    {"learned": [{"of": "velocity", "at": [-2.0, -0.1, 0.1, 2.0], "torque": [-0.3, -0.2, 0.2, 0.3]}]},
    {"learned": [{"of": "position", "at": [0.0, 1.0, 2.0], "torque": [0.0, 0.1, 0.0], "period": 6.28}]},
    {"transmission": {"stiffness": 100.0, "damping": 0.1, "backlash": 1e-3, "load_share": 0.5}},
    {"plant": {"type": "two_mass", "motor_inertia": 0.1, "load_inertia": 0.2, "stiffness": 300.0}},
    {"actuator": {"gain": 1.0, "lag": 1e-3, "delay": 2e-3, "limit": 3.0, "dead_zone": 0.01,
                  "cogging_amplitude": 0.02, "cogging_periods": 12.0}},
    {"sensor": {"type": "servo", "scale": 1.0, "noise": 1e-3, "delay": 1e-3, "step": 1e-3, "lag": 1e-3}},
    {"sensor": {"type": "kalman", "noise": 1e-3, "angle_noise": 1e-4}},
    {"controller": {"type": "transfer_function", "numerator": [3.0, 1.0], "denominator": [1.0, 0.0], "limit": 3.0}},
    {"controller": {"type": "lead", "gain": 3.0, "zero": 5.0, "pole": 50.0, "limit": 2.0}},
    {"controller": {"type": "position_cascade", "kp": 5.0, "kv": 3.0, "ki": 1.0}, "units": {"reference": "position"}},
    {"load": [{"type": "unbalance", "amplitude": 1.0},
              {"type": "position_torque", "cosine": [0.1], "sine": [0.2], "periods": 3.0}]},
    {"observer": {"type": "efp", "gain_1": 298.0, "gain_2": 72.0}},
    {"observer": {"type": "nfp", "gain": 10.0, "nonlinearity": "log_cosh", "steepness": 100.0}},
    {"reference": {"type": "multisine", "amplitudes": [1.0, 0.5], "frequencies": [1.0, 3.3]}},
    {"units": {"torque": "V", "motion": "linear"}},
]  # fmt: skip
BASES = [PLAIN | other for other in OTHERS]
NUMBERS = [0.0, -1.0, 1.0, 1e-300, 1e300, 1e308, 1e-12, 1e12, 1e30, 1e31, -1e-9, 10**400, 2**63, 0.5, 499.0, 1e6]
OTHER_VALUES = [True, "1.0", "sign", "", [1.0], [], "x" * 3000, [[1.0]], [0.0, 0.0], "velocity", "lugre", "servo"]
FACTORS = [0.0, -1.0, 1e-3, 1e3, 1e-9, 1e9, 1e20, 57.3]

number = st.integers(0, 999)  # of a section, a key, an entry: taken modulo how many there are
change = st.one_of(
    st.tuples(st.just("scale"), number, number, st.sampled_from(FACTORS)),
    st.tuples(st.just("set"), number, number, st.sampled_from(NUMBERS + OTHER_VALUES)),
    st.tuples(st.just("drop"), number, number, st.none()),
    st.tuples(st.just("add"), number, number, st.sampled_from(["inertai", "z" * 3000, "limit", "steepness", "offset"])),
    st.tuples(st.just("borrow"), number, number, number),
    st.tuples(st.just("entry"), number, number, st.sampled_from(NUMBERS)),
)


def damaged(base, changes):
    """The model with the changes, as text."""
    sections = {name: [*map(dict, t)] if isinstance(t, list) else dict(t) for name, t in base.items()}
    for kind, section, key, value in changes:
        name = list(sections)[section % len(sections)]
        tables = sections[name]
        if kind == "borrow":
            other = BASES[value % len(BASES)]
            name = list(other)[section % len(other)]
            tables = other[name]
            sections[name] = [*map(dict, tables)] if isinstance(tables, list) else dict(tables)
            continue
        table = tables[key % len(tables)] if isinstance(tables, list) else tables
        if kind == "add":
            table[value] = 1.0
            continue
        if not table:
            continue
        word = list(table)[key % len(table)]
        if kind == "drop":
            del table[word]
        elif kind == "set":
            table[word] = value
        elif kind == "scale" and isinstance(table[word], float):
            table[word] *= value
        elif kind == "entry" and isinstance(table[word], list) and table[word]:
            entries = list(table[word])
            entries[section % len(entries)] = value
            table[word] = entries
    return write(sections)


@settings(deadline=None, max_examples=80, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.sampled_from(BASES), st.lists(change, min_size=1, max_size=3))
@example(BASES[0], [])
def test_a_damaged_model_is_read_or_refused_in_a_sentence(base, changes):
    try:
        text = damaged(base, changes)
    except InputError:  # a number that the writer refuses
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FpjaxWarning)
        model, refused = None, ""
        try:
            model = load_model(text)
        except InputError as error:
            refused = str(error)
    if model is None:
        assert not faults(refused), refused
        return
    for note in model.notes:
        assert not faults(note), note
    written = dump_model(model)
    assert dump_model(load_model(written)) == written


@pytest.mark.parametrize("base", BASES, ids=lambda base: "-".join(base)[:40])
def test_the_models_that_are_damaged_are_sound(base):
    assert dump_model(load_model(write(base)))
