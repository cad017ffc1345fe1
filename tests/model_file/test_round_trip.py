# ruff: noqa: E501 (tables of cases)
"""servo.toml written and read again: any model, any damage, any text."""

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from model_files import same

from fpjax import InputError, dump_model, load_model
from fpjax.blocks.plants.transmission import Transmission
from fpjax.output import toml_text

SIZES = st.floats(1e-12, 1e12, allow_subnormal=False)
ANY = st.floats(-1e12, 1e12, allow_subnormal=False)
SHARES = st.floats(0.01, 0.99)
FREQUENCIES = st.floats(1e-9, 49.0)  # what the longest dt below can show
STEPS = st.floats(1e-12, 6.0)
SPEEDS = st.floats(1e-12, 1e9)
LAGS = st.floats(1e-12, 1e3)
EXPONENTS = st.floats(0.01, 100.0)
FACTORS = st.floats(1e-3, 1e3)
EITHER = st.floats(-1e9, 1e9, allow_subnormal=False)
# What `fpjax.model_file.admissible` takes by key, where that is less than any size.
NARROW = {
    **dict.fromkeys(("exponent", "stribeck_exponent", "bristle_exponent"), EXPONENTS),
    **dict.fromkeys(("lag", "filter_time", "tracking_time"), LAGS),
    **dict.fromkeys(("position_noise", "angle_noise", "bristle_deflection"), STEPS),
    **dict.fromkeys(("stribeck_velocity", "stick_velocity", "pole", "noise", "speed", "random_walk"), SPEEDS),
    **dict.fromkeys(("phase", "cogging_phase"), st.floats(-1e4, 1e4, allow_subnormal=False)),
    **dict.fromkeys(("bias", "zero"), EITHER),
    "scale": FACTORS,
}  # fmt: skip


def table(required, optional=None, **fixed):
    optional = {key: NARROW.get(key, value) for key, value in (optional or {}).items() if key not in required}
    required = {key: NARROW.get(key, value) for key, value in required.items()}
    return st.fixed_dictionaries({**{k: st.just(v) for k, v in fixed.items()}, **required}, optional=optional)


def harmonics(*names):
    pair = st.integers(1, 3).flatmap(lambda n: st.tuples(*[st.lists(ANY, min_size=n, max_size=n) for _ in names]))
    return pair.map(lambda lists: dict(zip(names, lists, strict=True)))


def holding(required, optional=None, **fixed):
    """A law whose static level is at least its Coulomb level."""
    levels = st.tuples(st.floats(1e-12, 1e6), st.floats(1.0, 1e6)).map(
        lambda two: {"coulomb": two[0], "static": two[0] * two[1]}
    )
    return st.builds(dict.__or__, table(required, optional, **fixed), levels)


LEVELS = {"coulomb": SIZES, "viscous": SIZES}
STEEP = {"steepness": SIZES | st.just("sign")}
GENERAL = {
    "coulomb_difference": ANY, "viscous_difference": ANY, "drag_coefficient": SIZES, "drift_amplitude": ANY,
    "drift_time": SIZES, "load_coefficient": st.floats(0.0, 0.99), "stribeck_velocity": SIZES, "stribeck_exponent": SIZES, "position_periods": SIZES, **STEEP,
}  # fmt: skip
BRISTLES = {"bristle_damping": SIZES, "bristle_exponent": SIZES}
FRICTION = st.one_of(
    table(LEVELS, {**STEEP, "offset": ANY}, type="coulomb_viscous"),
    table({f"{k}_{side}": SIZES for k in LEVELS for side in ("positive", "negative")}, STEEP, type="coulomb_viscous"),
    table({**LEVELS, "stribeck_torque": ANY, "stribeck_velocity": SIZES}, GENERAL, type="coulomb_viscous"),
    st.builds(dict.__or__, table(LEVELS, GENERAL, type="coulomb_viscous"), harmonics("position_cosine", "position_sine")),
    table({**LEVELS, "bristle_deflection": SIZES}, {**BRISTLES, **GENERAL}, type="coulomb_viscous"),
    holding({"stribeck_velocity": SIZES}, {"viscous": SIZES, **STEEP}, type="stribeck"),
    holding({}, {"stick_velocity": SIZES, **STEEP}, type="stiction"),
    table({"coulomb": SIZES, "stiffness": SIZES}, {"exponent": SIZES, "viscous": SIZES}, type="dahl"),
    holding(dict.fromkeys(("stribeck_velocity", "bristle_stiffness"), SIZES), type="lugre"),
    table({}, {"offset": ANY}, type="none"),
)  # fmt: skip
PLANT = st.one_of(
    table({"inertia": SIZES}, type="one_mass"),
    table({"motor_inertia": SIZES, "load_inertia": SIZES, "stiffness": SIZES}, {"damping": SIZES}, type="two_mass"),
    table({"motor_inertia": SIZES, "load_inertia": SIZES, "stiffness": SIZES}, type="series_two_mass"),
)
CONTROLLER = st.one_of(
    table({"kp": SIZES, "ki": SIZES}, {"limit": SIZES, "tracking_time": SIZES}, type="pi"),
    table({"kp": SIZES}, {"limit": SIZES}, type="p"),
    table({"gain": ANY, "zero": ANY, "pole": SIZES}, {"limit": SIZES}, type="lead"),
    table({"kp": SIZES, "kv": SIZES}, {"limit": SIZES}, type="position_cascade"),
    table({"kp": SIZES, "kv": SIZES, "ki": SIZES}, {"limit": SIZES, "tracking_time": SIZES}, type="position_cascade"),
    st.just({"type": "transfer_function", "numerator": [2.0, 3.0], "denominator": [1.0, 30.0]}),
    st.just({"type": "unknown"}),
)
OBSERVER = st.one_of(
    st.sampled_from(["cfp", "mfp"]).flatmap(lambda t: table({"gain": SIZES}, {"viscous": SIZES, **STEEP}, type=t)),
    table({"gain": SIZES, "coulomb": SIZES}, {"nonlinearity": st.sampled_from(["quadratic", "absolute"])}, type="nfp"),
    st.sampled_from(["efp", "efp_steepness_coulomb"]).flatmap(
        lambda t: table({"gain_1": SIZES, "gain_2": SIZES}, {"inertia": SIZES, **STEEP}, type=t)
    ),
    table({"gain_1": SIZES, "gain_2": SIZES, "coulomb": SIZES}, type="efp_steepness_viscous"),
    table({"gain": SIZES, "coulomb": SIZES}, {"nonlinearity": st.just("quadratic")}, type="steepness"),
)  # fmt: skip
LOAD = st.one_of(
    table({"amplitude": ANY}, {"phase": ANY}, type="unbalance"),
    st.builds(dict.__or__, table({}, {"periods": SIZES}, type="position_torque"), harmonics("cosine", "sine")),
)
POINTS = (
    st.integers(2, 5)
    .flatmap(
        lambda n: st.tuples(
            st.lists(st.integers(-50, 50), min_size=n, max_size=n, unique=True).map(sorted),
            st.lists(ANY, min_size=n, max_size=n),
        )
    )
    .map(lambda pair: {"at": [0.1 * at for at in pair[0]], "torque": pair[1]})
)
LEARNED = st.builds(
    dict.__or__,
    st.one_of(
        table(
            {"of": st.sampled_from(["velocity", "torque", "time"])},
            {"interpolation": st.sampled_from(["linear", "cubic"])},
        ),
        st.just({"of": "position", "period": 11.0}),
    ),
    POINTS,
)
ACTUATOR = st.one_of(
    table({}, {"gain": FACTORS, "lag": SIZES, "limit": SIZES, "dead_zone": SIZES, "offset": ANY}),
    table({"cogging_amplitude": ANY, "cogging_periods": SIZES}, {"cogging_phase": ANY, "delay": st.floats(0, 1e-2)}),
)
SENSOR = st.one_of(
    table({}, {"scale": SIZES, "bias": ANY, "lag": SIZES, "delay": st.floats(0, 1e-2), "noise": SIZES, "step": STEPS,
               "side": st.sampled_from(["load", "motor"])}),
    table({"load_side": SHARES}, {"position_step": STEPS}),
    table({}, {"noise": SIZES, "bias": ANY, "random_walk": SIZES, "scale": SIZES}, type="gyro"),
    table({"step": STEPS}, {"filter_time": SIZES, "position_noise": SIZES}, type="encoder"),
    table({"angle_noise": SIZES}, {"noise": SIZES, "step": STEPS}, type="kalman"),
    table({"side": st.sampled_from(["load", "motor"])}, type="ideal"),
)  # fmt: skip
REFERENCE = st.one_of(
    table({"amplitude": EITHER, "frequency": FREQUENCIES}, {"phase": EITHER, "offset": EITHER}, type="sine"),
    table({"amplitude": EITHER}, type="constant"),
    table(
        {"amplitude": EITHER, "start_frequency": FREQUENCIES, "end_frequency": FREQUENCIES},
        {"sweep_time": SIZES},
        type="chirp",
    ),
    st.sampled_from(["triangle", "square"]).flatmap(
        lambda t: table({"amplitude": EITHER, "frequency": FREQUENCIES}, type=t)
    ),
    table({"amplitudes": st.just([1.0, 0.1]), "frequencies": st.just([0.3, 7.0])}, type="multisine"),
)
SIMULATION = table(
    {"dt": st.floats(1e-4, 1e-2), "duration": st.floats(0.1, 10.0)},
    {
        "substeps": st.integers(1, 50),
        "solver": st.sampled_from(["euler", "ode3", "rk4"]),
        "stepping": st.just("sampled"),
    },
)
UNITS = table({}, {"motion": st.sampled_from(["rotary", "linear"]), "sensors": st.sampled_from(["position", "both"])})
MODEL = st.fixed_dictionaries(
    {"plant": PLANT, "friction": FRICTION, "simulation": SIMULATION},
    optional={
        "units": UNITS, "controller": CONTROLLER, "observer": OBSERVER, "load": LOAD | st.lists(LOAD, min_size=2, max_size=3),
        "learned": LEARNED | st.lists(LEARNED, min_size=2, max_size=3), "actuator": ACTUATOR, "sensor": SENSOR, "reference": REFERENCE,
    },
)  # fmt: skip
QUIET = settings(deadline=None, max_examples=50, suppress_health_check=list(HealthCheck))


MEMORY = {"bristle_deflection", "dahl", "lugre"}  # friction that two bodies cannot share


OFFSET = {"plant": {"type": "one_mass", "inertia": 1.0}, "simulation": {"dt": 1e-3, "duration": 1.0}}
OFFSET |= {"friction": {"type": "none", "offset": 1.0}}


@QUIET
@example(OFFSET | {"load": [{"type": "unbalance", "amplitude": 0.0}] * 2})
@example(OFFSET | {"load": [{"type": "unbalance", "amplitude": 0.0}, {"type": "none"}]})
@given(MODEL)
def test_round_trip_is_exact(sections):
    model = load_model(toml_text.write(sections))
    text = dump_model(model)
    again = load_model(text)
    assert same(model, again)
    assert dump_model(again) == text
    fields = ("dt", "duration", "stepping", "solver", "substeps", "units", "controller_known")
    assert [getattr(model, name) for name in fields] == [getattr(again, name) for name in fields]


@QUIET
@given(
    MODEL.filter(lambda m: m["plant"]["type"] == "one_mass" and not MEMORY & {*m["friction"], m["friction"]["type"]}),
    table(
        {"stiffness": SIZES},
        {
            "backlash": STEPS,
            "damping": SIZES,
            "load_share": SHARES,
            "friction_share": SHARES,
            "hardening": SIZES,
            "viscous_share": SHARES,
        },
    ),
)
@example(
    {"plant": {"type": "one_mass", "inertia": 1.0}, "friction": {"type": "none"}, "simulation": {"dt": 1e-3}},
    {"stiffness": 1.0, "friction_share": 0.5, "viscous_share": 0.5},
)
def test_round_trip_with_a_transmission(sections, transmission):  # fmt: skip
    model = load_model(toml_text.write({**sections, "transmission": transmission}))
    assert isinstance(model.loop.plant, Transmission)
    assert same(model, load_model(dump_model(model)))


WORDS = st.sampled_from(
    ["type", "inertia", "coulomb", "kp", "dt", "steepness", "stiffness", "delay", "nonsense", "file"]
)
VALUES = st.one_of(st.floats(), st.integers(), st.booleans(), st.text(max_size=5), st.lists(st.floats(), max_size=3))


@QUIET
@given(MODEL, st.data())
def test_any_damage_gives_a_model_or_an_input_error(sections, data):
    sections = {
        name: [dict(t) for t in each] if isinstance(each, list) else dict(each) for name, each in sections.items()
    }
    for _ in range(data.draw(st.integers(1, 3))):
        name = data.draw(st.sampled_from(sorted(sections)))
        if isinstance(sections[name], list):
            continue
        key = data.draw(
            st.sampled_from(sorted(sections[name])) if sections[name] and data.draw(st.booleans()) else WORDS
        )
        sections[name][key] = data.draw(VALUES)
        if data.draw(st.integers(0, 4)) == 0:
            del sections[name][key]
    try:
        text = toml_text.write(sections)
    except InputError:  # inf and nan are not written
        return
    load_or_sentence(text)


@QUIET
@given(st.text(alphabet='[]plantfrico=".0123456789\n_- ', max_size=300))
def test_any_text_gives_a_model_or_an_input_error(text):
    load_or_sentence("\n" + text)


def load_or_sentence(text):
    try:
        return load_model(text)
    except InputError as error:
        sentence = str(error)
    assert "\n" not in sentence
    return None
