"""The truth generator of `benchmarks withheld`: independent, exact where sticking is, converged."""

import json

import numpy as np
import pytest
from effect_contract import CONTRACT

from benchmarks.withheld.cases import generate
from benchmarks.withheld.contract import unit_of
from benchmarks.withheld.first import DT, PREROLL, VERSION, build, derived_velocity
from benchmarks.withheld.first import label_of as label_of_case
from benchmarks.withheld.identity import Identity, identities, seeds_of, split
from benchmarks.withheld.truth.check import refit_each, window_residual, window_residuals
from benchmarks.withheld.truth.effects import EFFECTS
from benchmarks.withheld.truth.integrate import simulate
from benchmarks.withheld.truth.machine import Machine, Record
from benchmarks.withheld.truth.outside import OUTSIDE


def drawn(seed: int, set_: str, system: str, effects: tuple[str, ...], number: int, sensors: str = "both") -> Identity:
    return Identity(1, seed, set_, sensors, system, effects, number)


def open_loop(physics: dict[str, float], torque: np.ndarray, substeps: int = 50, preroll: int = 0):
    """Run a machine without controller or noise under a torque given at the samples (linear)."""
    count = len(torque) - 1
    nothing = np.zeros(count)
    machine = Machine(physics, nothing, nothing, nothing, preroll, disturbance=torque, dt=DT)
    return simulate([machine], substeps)[0]


def test_a_derived_velocity_is_made_of_the_position_alone():
    case = build(drawn(0, "single", "drive", ("stribeck",), 3, "derived"), 800)
    record = simulate([case.machine], substeps=10)[0]
    found = derived_velocity(record, case.identity, DT)
    steps = np.diff(np.unique(found))
    assert np.allclose(steps / steps.min(), np.round(steps / steps.min()), atol=1e-6)
    # a drive's filter lags a few periods and rounds: it follows the motion, and is not the rate sensor
    assert np.corrcoef(found[50:], record.true_velocity[50:])[0, 1] > 0.99
    shifted = Record(**(vars(record) | {"velocity": record.velocity + 1.0}))
    np.testing.assert_array_equal(derived_velocity(shifted, case.identity, DT), found)


def test_wide_nominals_are_off_by_ten_to_thirty_per_cent_and_three_per_cent_at_most():
    for seed in range(2):
        for set_, low, high in (("wide", 10, 30), ("single_off", 0, 3), ("single", 0, 0)):
            case = build(drawn(seed, set_, "servo", ("unbalance",), 11), 300)
            label = label_of_case(case, simulate([case.machine], substeps=4)[0])
            for error in label["nominal_error_percent"].values():
                assert low - 1e-9 <= abs(error) <= high + 1e-9


def test_all_effects_of_the_contract_with_their_parameters():
    assert set(EFFECTS) == set(CONTRACT)
    for number, (effect, names) in enumerate(CONTRACT.items()):
        for seed in (0, 1, 2):
            plan = build(drawn(seed, "single", "servo", (effect,), number), 50).plan
            found = set(plan.parameters[effect])
            assert found <= names
            assert all(unit_of(effect, name) for name in found)
            assert found == names or effect == "asymmetric_friction"


def test_a_mass_sticks_exactly_and_breaks_away_at_the_right_time():
    # torque ramps 4 N m/s on C = 1 N m, J = 0.5: rests until t = 0.25 s, then w = 4 (t-.25)^2/(2 J)
    time = np.arange(601) * DT
    physics = {"inertia": 0.5, "coulomb_positive": 1.0, "coulomb_negative": 1.0}
    record = open_loop(physics, 4 * time)
    rest = record.time <= 0.25
    assert np.all(record.true_velocity[rest] == 0.0)
    expected = 4 * (record.time - 0.25) ** 2
    np.testing.assert_allclose(record.true_velocity[~rest], expected[~rest], rtol=0, atol=2e-8)


def test_a_sliding_mass_stops_where_coulomb_friction_says_and_stays():
    # 50 ms of 5 N m on J = 0.5, C = 1: w = 8 * 0.05 = 0.4 rad/s, stops 0.4 / 2 = 0.2 s later
    torque = np.where(np.arange(601) <= 50, 5.0, 0.0)
    physics = {"inertia": 0.5, "coulomb_positive": 1.0, "coulomb_negative": 1.0}
    record = open_loop(physics, torque)
    # the disturbance is linear between samples: the last drive period delivers half a period more
    start = record.true_velocity[52]
    stop = record.time[52] + start / 2
    assert start == pytest.approx(0.4, abs=0.01)
    sliding = (record.time > 0.06) & (record.time < stop)
    expected = start - 2 * (record.time - record.time[52])
    np.testing.assert_allclose(record.true_velocity[sliding], expected[sliding], atol=1e-12)
    assert np.all(record.true_velocity[record.time > stop + 1e-9] == 0.0)
    travel = record.true_position[-1] - record.true_position[52]
    assert travel == pytest.approx(start**2 / 4, abs=1e-8)


def test_stick_slip_under_a_sine_meets_the_analytic_solution():
    # J w' = A sin(W t) - C after breakaway at asin(C/A)/W; sticks again where w returns to zero
    a, c, j, angular = 2.0, 1.2, 0.05, 2 * np.pi * 2
    time = np.arange(301) * 1e-3
    physics = {"inertia": j, "coulomb_positive": c, "coulomb_negative": c}
    record = open_loop(physics, a * np.sin(angular * time))
    begin = np.arcsin(c / a) / angular
    expected = (a * (np.cos(angular * begin) - np.cos(angular * record.time)) / angular - c * (record.time - begin)) / j
    # it slides on until the integral of the net torque is used up
    after = (record.time > begin) & (expected > 0)
    end = (
        record.time[after][np.argmax(np.diff(record.time[after]) > 1.5e-3)]
        if np.any(np.diff(record.time[after]) > 1.5e-3)
        else record.time[after][-1]
    )
    slides = (record.time > begin) & (record.time <= end)
    error = np.abs(record.true_velocity[slides] - expected[slides])
    # samples of the torque are joined by lines: (W dt)^2 / 12 of the amplitude
    assert np.max(error) < a * (angular * 1e-3) ** 2 / 12 / j / angular * 3
    assert np.all(record.true_velocity[record.time < begin] == 0)


def test_static_friction_above_coulomb_holds_until_it_breaks():
    physics = {
        "inertia": 0.1,
        "coulomb_positive": 1.0,
        "coulomb_negative": 1.0,
        "stribeck_torque": 0.5,
        "stribeck_velocity": 0.01,
        "stribeck_exponent": 2.0,
    }
    time = np.arange(401) * DT
    record = open_loop(physics, 5 * time)
    assert np.all(record.true_velocity[record.time <= 0.3] == 0)
    # once it moves, the excess of the static torque accelerates it: (1.5 - 1) / 0.1 = 5 rad/s^2
    moving = record.true_velocity[(record.time > 0.31)]
    assert moving[-1] > 5 * 0.08


@pytest.mark.parametrize(("kind", "exponent"), [(1.0, 1.0), (2.0, 0.5), (2.0, 2.0), (3.0, 1.0)])
def test_bristles_are_springs_at_small_travel_and_coulomb_friction_at_large(kind, exponent):
    physics = {
        "inertia": 1e-3,
        "coulomb_positive": 1.0,
        "coulomb_negative": 1.0,
        "bristle_kind": kind,
        "bristle_exponent": exponent,
        "bristle_stiffness": 1000.0,
        "bristle_damping": 0.6,
    }
    # a slow ramp: the bristle's own curve is 1 % from its initial slope there
    small = open_loop(physics, np.linspace(0, 0.02, 401))
    assert small.true_position[-1] == pytest.approx(0.02 / 1000.0, rel=0.03)
    large = open_loop(physics, np.full(301, 1.5))
    slope = (large.true_velocity[-1] - large.true_velocity[-101]) / (100 * DT)
    assert slope == pytest.approx(0.5 / 1e-3, rel=1e-3 if exponent < 2 else 0.01)


def test_two_masses_swing_at_their_free_frequency():
    inertia, share, frequency = 0.2, 0.4, 25.0
    stiffness = inertia * share * (1 - share) * (2 * np.pi * frequency) ** 2
    physics = {"inertia": inertia, "load_share": share, "transmission": 1.0, "stiffness": stiffness}
    torque = np.where(np.arange(1001) < 5, 1.0, 0.0)
    record = open_loop(physics, torque)
    swing = record.true_velocity[100:] - record.true_velocity[100:].mean()
    ups = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    exact = ups - swing[ups] / (swing[ups + 1] - swing[ups])
    assert 1 / (np.mean(np.diff(exact)) * DT) == pytest.approx(frequency, rel=5e-4)


def test_backlash_moves_the_load_only_once_it_is_crossed():
    physics = {
        "inertia": 0.2,
        "load_share": 0.5,
        "transmission": 2.0,
        "gap": 0.02,
        "stiffness": 3e4,
        "damping": 5.0,
        "coulomb_positive": 0.05,
        "coulomb_negative": 0.05,
        "friction_load_share": 1.0,
    }
    record = open_loop(physics, np.full(301, 1.0))
    crossing = np.sqrt(2 * 0.01 * 0.1 / 1.0)  # half the gap by the motor alone
    alone = record.time < crossing
    np.testing.assert_allclose(record.true_velocity[alone], 10 * record.time[alone], atol=1e-9)
    # (1 - 0.05) N m on 0.2 kg m^2 for 0.3 s, but for the swing that the impact leaves.
    assert record.true_velocity[-1] == pytest.approx(0.95 / 0.2 * 0.3, rel=0.1)


def test_a_delay_need_not_be_whole_periods_and_a_lag_is_exact():
    # J = 1, one period of command 1 N m by a P controller on a reference pulse
    reference = np.zeros(60)
    reference[10] = 1.0
    for name, value in (("actuator_delay", 2.35e-3), ("actuator_lag", 3e-3)):
        physics = {"inertia": 1.0, "kp": 1e-6, name: value}
        nothing = np.zeros(60)
        record = simulate([Machine(physics, reference, nothing, nothing)])[0]
        got = record.true_velocity * 1e6 / DT  # a share of the pulse's impulse
        since = record.time - 0.010
        if name == "actuator_delay":
            expected = np.clip((since - value) / DT, 0, 1)
        else:

            def ramp(t, lag=value):
                t = np.maximum(t, 0)
                return (t - lag * (1 - np.exp(-t / lag))) / DT

            expected = ramp(since) - ramp(since - DT)
        np.testing.assert_allclose(got, expected, atol=2e-6)


def test_the_velocity_sensor_delays_by_a_fraction():
    physics = {"inertia": 1.0, "velocity_delay": 3.4e-3}
    record = open_loop(physics, np.full(101, 2.0))
    later = record.time > 0.004
    np.testing.assert_allclose(record.velocity[later], 2 * (record.time[later] - 3.4e-3), atol=1e-9)


def short(effect: str, system: str, seed: int, periods: int = 160) -> Machine:
    """A case without noise, cut to a few hundred milliseconds in the middle of its log."""
    table = OUTSIDE if effect in OUTSIDE else EFFECTS
    name = "outside" if effect in OUTSIDE else "single"
    machine = build(drawn(seed, name, system, (effect,), list(table).index(effect)), 2000).machine
    start = PREROLL + 400
    machine.reference = machine.reference[start : start + periods]
    machine.velocity_normal = machine.position_normal = np.zeros(periods)
    machine.preroll = 0
    if machine.disturbance is not None:
        machine.disturbance = machine.disturbance[start : start + periods + 1]
    for field in ("held_reading", "held_command"):
        if getattr(machine, field) is not None:
            setattr(machine, field, getattr(machine, field)[start : start + periods])
    machine.physics |= {"velocity_step": 0.0}  # a rounding turns any difference into a whole step
    return machine


@pytest.mark.long
def test_fifty_substeps_are_converged_for_every_effect():
    effects = [*EFFECTS, *OUTSIDE]
    machines = [short(effect, system, 0) for system in ("servo", "drive") for effect in effects]
    machines += [short(effect, "gimbal", 2) for effect in ("presliding", "backlash", "stribeck")]
    coarse, fine = simulate(machines, 50), simulate(machines, 200)
    for machine, a, b in zip(machines, coarse, fine, strict=True):
        error = np.sqrt(np.mean((a.true_velocity - b.true_velocity) ** 2))
        # far below the sensor noise that the log gets
        assert error < 0.05 * machine.physics["velocity_noise"]


def test_a_nominal_machine_leaves_nothing_but_noise():
    case = build(drawn(0, "none", "drive", (), 0), 400)
    record = simulate([case.machine])[0]
    residual = window_residual(case.plan.nominal, record, DT)
    ratio = np.mean(residual**2) / case.machine.physics["velocity_noise"] ** 2
    assert abs(ratio - 1) < 5 * np.sqrt(2 / residual.size)


@pytest.mark.long  # makes every case twice
def test_a_case_does_not_depend_on_its_company_and_its_path_tells_nothing():
    wanted = [
        one
        for one in identities(0, 1)
        if (one.set, one.system, one.sensors != "encoder") == ("single", "servo", True)
        and one.effects[0] in ("stribeck", "unbalance", "velocity_delay")
    ]
    together = simulate([build(one, 60).machine for one in wanted])
    for one, record in zip(wanted, together, strict=True):
        alone = simulate([build(one, 60).machine])[0]
        np.testing.assert_allclose(alone.velocity, record.velocity, rtol=1e-9, atol=1e-12)
        assert not any(effect in one.name for effect in EFFECTS)
    names = [one.name for seed in range(4) for truth_ in (1, 2) for one in identities(seed, truth_)]
    assert len(set(names)) == len(names)


def test_logs_models_and_labels_on_disk(tmp_path):
    wanted = [one for one in identities(1, 1) if one.system == "drive" and one.set in ("none", "outside")]
    assert generate(tmp_path, wanted, periods=300) == len(wanted)
    assert generate(tmp_path, wanted, periods=300) == 0
    for one in wanted:
        place = tmp_path / "logs" / one.name
        assert sorted(p.name for p in place.iterdir()) == ["log.csv", "servo.toml"]
        header = (place / "log.csv").read_text().splitlines()[0]
        label = json.loads((tmp_path / "labels" / f"{one.name}.json").read_text())
        assert ("position" in header) == (one.sensors != "rate")
        assert ("velocity" in header) == (one.sensors != "encoder")
        assert label["half"] == "reported"
        assert label["effects"] == []


def test_halves_do_not_share_seeds():
    assert [split(seed) for seed in range(3)] == ["development", "reported", "development"]
    assert not set(seeds_of("development", 9)) & set(seeds_of("reported", 9))
    assert seeds_of("reported", 2, skip=1) == [3, 5]
    assert all(split(seed) == "reported" for seed in seeds_of("reported", 9))


def label_of(effect: str, seed: int, system: str = "drive") -> tuple[list[list[str]], bool, dict]:
    from benchmarks.withheld.truth.twins import accepted

    number = list(EFFECTS).index(effect)
    case = build(drawn(seed, "single", system, (effect,), number, "both" if seed % 2 else "rate"), 20)
    return accepted(case.plan, case.with_position), case.with_position, case.plan.laws


def test_exact_twins_depend_on_the_position_channel():
    seen = set()
    for seed in range(12):
        sets, position, _ = label_of("actuator_delay", seed)
        assert (["velocity_delay"] in sets) == (not position)
        seen.add(position)
        sets, _, _ = label_of("constant_torque", seed)
        assert ["asymmetric_friction"] in sets
        sets, _, laws = label_of("asymmetric_friction", seed)
        assert (["constant_torque"] in sets) == (laws["asymmetric_friction"] == "opposite Coulomb")
        assert label_of("unbalance", seed)[0] == [["unbalance"]]
    assert seen == {True, False}


MEMORYLESS = {
    "coulomb_error": lambda p, _: {"coulomb_positive": p["coulomb"], "coulomb_negative": p["coulomb"]},
    "viscous_error": lambda p, _: {"viscous_positive": p["viscous"], "viscous_negative": p["viscous"]},
    "inertia_error": lambda p, _: {"inertia": p["inertia"]},
    "stribeck": lambda p, hidden: hidden | p,
    "asymmetric_friction": lambda p, _: p,
    "position_dependent_friction": lambda p, hidden: (
        hidden | {"ripple": p["amplitude"], "ripple_periods": p["periods"]}
    ),
    "quadratic_drag": lambda p, _: {"drag": p["coefficient"]},
    "unbalance": lambda p, hidden: hidden | {"unbalance": p["amplitude"]},
    "cogging": lambda p, hidden: hidden | {"cogging": p["amplitude"], "cogging_periods": p["periods"]},
    "constant_torque": lambda p, _: {"constant_torque": p["torque"]},
    "torque_gain_error": lambda p, _: {"gain": p["gain"]},
    "torque_saturation": lambda p, hidden: hidden | {"limit": p["limit"]},
    "torque_dead_zone": lambda p, _: {"dead_zone": p["width"]},
    "velocity_bias": lambda p, _: {"bias": p["bias"]},
    "velocity_scale_error": lambda p, _: {"scale": p["scale"]},
}
SHAPES = {
    "stribeck": ("stribeck_exponent", "stribeck_shape"),
    "position_dependent_friction": (
        "ripple_phase",
        "ripple_second",
        "ripple_third",
        "ripple_phase_second",
        "ripple_phase_third",
    ),
    "unbalance": ("unbalance_phase",),
    "cogging": ("cogging_phase", "cogging_second", "cogging_phase_second"),
    "torque_saturation": ("softness",),
}


@pytest.mark.long
def test_the_labels_parameters_close_the_gap():
    """Nominal model + the label's parameters (and hidden phases) leaves noise, in every case."""
    cases = [build(drawn(2, "single", "drive", (effect,), list(EFFECTS).index(effect)), 1500) for effect in MEMORYLESS]
    records = simulate([case.machine for case in cases], substeps=10)
    nominals, changes = [case.plan.nominal for case in cases], []
    for case in cases:
        plan, effect = case.plan, case.identity.effects[0]
        hidden = {name: plan.physics[name] for name in SHAPES.get(effect, ()) if name in plan.physics}
        changes.append(MEMORYLESS[effect](plan.parameters[effect], hidden))
    all_perfect = window_residuals(nominals, records, DT, changes=changes)
    all_nominal = window_residuals(nominals, records, DT)
    for case, perfect, nominal in zip(cases, all_perfect, all_nominal, strict=True):
        effect, noise = case.identity.effects[0], case.machine.physics["velocity_noise"]
        # 1500 samples of noise scatter by sqrt(2 / 1500) = 0.037: four of it.
        assert abs(np.mean(perfect**2) / noise**2 - 1) < 0.15, effect
        assert np.mean(nominal**2) / noise**2 > 1.5, effect


@pytest.mark.long
def test_every_effect_stands_out_of_the_noise_and_only_nominal_errors_are_fitted_away():
    # the fourth nominal-like effect: a gain divides all three by itself
    nominal_like = {"coulomb_error", "viscous_error", "inertia_error", "torque_gain_error"}
    cases = [build(drawn(2, "single", "servo", (effect,), i), 3000) for i, effect in enumerate(EFFECTS)]
    records, nominals = simulate([case.machine for case in cases], substeps=10), [case.plan.nominal for case in cases]
    before, after = window_residuals(nominals, records, DT), refit_each(nominals, records, DT)
    for case, nominal, (fitted, residual) in zip(cases, before, after, strict=True):
        noise = case.machine.physics["velocity_noise"]
        ratio, left = np.mean(nominal**2) / noise**2, np.mean(residual**2) / noise**2
        # 3000 samples of pure noise scatter by sqrt(2 / 3000) = 0.026 around one
        assert ratio > 1.5, case.identity
        if case.identity.effects[0] in nominal_like:
            assert abs(left - 1) < 0.15, case.identity
            gain = case.machine.physics.get("gain", 1.0)
            for name, tolerance in (("inertia", 0.002), ("coulomb", 0.005), ("viscous", 0.03)):
                true = getattr(case.plan.draw, name) / gain
                assert fitted[name] == pytest.approx(true, rel=tolerance), case.identity
        else:
            assert left > 1.5, case.identity


def test_a_seed_draws_what_it_always_drew():
    """Reported figures belong to logs that can be made again: whoever changes a draw raises VERSION."""
    case = build(drawn(0, "single", "servo", ("unbalance",), 11), 60)
    assert VERSION == 1
    assert case.plan.nominal["inertia"] == pytest.approx(2.589800918813772e-4, rel=1e-9)
    assert case.plan.parameters["unbalance"]["amplitude"] == pytest.approx(1.2611927101753963e-3, rel=1e-9)
    assert np.std(case.machine.reference) == pytest.approx(0.18619770799917806, rel=1e-9)
