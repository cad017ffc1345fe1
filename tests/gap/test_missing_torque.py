"""What a log itself says of a missing torque, beside any name: its curves, its masses, its rare events."""

import math
from dataclasses import replace

import gap_search
import numpy as np
import numpy_machine
import pytest

from fpjax import load_model
from fpjax.gap import EFFECTS
from fpjax.gap.answer.curves import curves_of, named_share
from fpjax.gap.fit import search as search_module
from fpjax.gap.fit.candidate import Start
from fpjax.gap.select.dominant import dominant
from fpjax.gap.verb import make_search


@pytest.fixture(scope="module")
def hanging():
    """A weight that no model knows."""
    return gap_search.search_of(
        numpy_machine.record(
            seconds=12.0, sensors=("position",), extra=lambda time, speed, angle, u: -2.0 * math.sin(angle)
        )
    )


def test_a_large_weight_is_found_from_where_the_missing_torque_points(hanging):
    found = hanging.explore([Start((effect("unbalance"),), (), v) for v in effect("unbalance").starts(hanging.setting)])
    values = next(f for f in found if f.names == ("unbalance",)).candidate.values()
    assert values["unbalance_sine"] == pytest.approx(2.0, rel=0.01)
    assert abs(values["unbalance_cosine"]) < 0.02


def effect(name):
    return next(one for one in EFFECTS if one.name == name)


def test_a_weight_is_a_law_of_the_position_and_its_name_holds_what_the_curve_holds(hanging):
    curves = curves_of(hanging)
    found = dominant(curves.by)
    assert found is not None
    assert found.of == "position"
    assert curves.by["position"].share > 0.9
    for name, most, least in (("unbalance", 1.01, 0.9), ("stribeck", 0.5, -1.0)):
        starts = [
            Start((effect(name),), ("inertia", "coulomb", "viscous"), v) for v in effect(name).starts(hanging.setting)
        ]
        fit = hanging.explore(starts)[0]
        assert least < named_share(hanging, fit, curves) < most, name


def scale(search, **values):
    """(the torque scale of a candidate by mode, its fitter, the candidate)."""
    changes = {"limit": "torque_saturation", "gain": "torque_gain_error"}
    changes |= {name: name for name in ("actuator_lag", "velocity_lag")}
    effects = tuple(effect(name) for value, name in changes.items() if value in values)
    c = search.candidate(Start(effects, ("inertia", "coulomb", "viscous"), values))
    fitter = search.fitters[c.family.key]
    return fitter.torque_scale(c), fitter, c


@pytest.mark.parametrize("actuator", ["gain = 0.5", "lag = 5e-3", "limit = 3.0"])
def test_the_nominal_model_as_given_is_no_sluggish_one(actuator):
    log = numpy_machine.record(seconds=3.0, sensors=("position",))
    search = make_search([log], [], load_model(gap_search.MODEL + f"[actuator]\n{actuator}\n"))
    fitter = search.fitters[search.exact.family.key]
    assert fitter.torque_scale(search.exact) == pytest.approx(1.0)


def test_what_a_sluggish_model_leaves_is_read_as_the_larger_torque_that_it_is(hanging):
    own = hanging.setting
    heavy, fitter, c = scale(hanging, inertia=2.0 * own.inertia)
    assert np.all(heavy[~fitter.modes.sensor] > 1.0)
    assert heavy.max() == pytest.approx(2.0, rel=0.05)  # where inertia is all that holds it
    free = gap_search.search_of(numpy_machine.record(seconds=3.0, sensors=("position",)))
    assert scale(free, viscous=own.viscous + 1.0)[0].max() > 2.0
    assert scale(hanging, limit=0.3 * own.torque)[0].min() > 1.5
    # A livelier model is not read as a smaller torque: a light mass would shrink what it is judged by.
    # Nor is a lag sluggish: what is missing acts on the mass, behind the actuator.
    for livelier in ({"inertia": 0.5 * own.inertia}, {"gain": 3.0}, {"actuator_lag": 0.05}, {}):
        assert scale(hanging, **livelier)[0] == pytest.approx(1.0), livelier
    # Mass and gain in proportion move alike, and are judged alike.
    assert scale(hanging, inertia=2.0 * own.inertia, viscous=2.0 * own.viscous, gain=2.0)[0] == pytest.approx(1.0)
    # The volume of torques counts where a torque is seen above the noise, and is not small beside the inertial torque.
    torques = np.where(fitter.modes.sensor, 0.0, 3.0)
    nothing = np.zeros_like(torques)
    late = scale(hanging, actuator_lag=0.05)[2]
    light = scale(hanging, inertia=0.5 * own.inertia)[2]
    assert fitter.log_volume(c, np.stack([nothing, nothing, nothing])) == 0.0
    for made, imposed in ((torques, nothing), (nothing, torques)):
        assert fitter.log_volume(c, np.stack([made, imposed, nothing])) > 0.0
        # Where a motion is imposed, a light mass is not favoured for answering more.
        assert (fitter.log_volume(light, np.stack([made, imposed, nothing])) < 0.0) == bool(np.any(made))
        # A loop's answer passes the actuator's lag; what acts on the mass does not.
        assert (fitter.log_volume(late, np.stack([made, imposed, nothing])) > 0.0) == bool(np.any(imposed))
    # The noise of a measured torque makes no model likelier that keeps it out of its motion.
    more, usual, less, none = (
        fitter.log_volume(one, np.stack([nothing, nothing, torques])) for one in (light, scale(hanging)[2], c, late)
    )
    assert more < usual < min(less, none)
    few, some = (fitter.torques(replace(c, level=np.full(fitter.modes.bands, q)), hanging.train) for q in (1e-9, 0.1))
    windows = sum(len(chosen) for chosen in hanging.train)
    # A level far below the noise counts no torque; where the torque makes the motion, half of the windows count.
    assert np.max(few[:, 0]) < 0.01 * windows
    assert 0.4 * windows < some[0, 0] <= 0.5 * windows
    assert some[1, 0] < 0.1 * windows


def test_a_lag_that_the_nominal_model_has_lets_a_loops_answer_pass_as_before():
    log = numpy_machine.record(seconds=3.0, sensors=("position",))
    known = make_search([log], [], load_model(gap_search.MODEL + "[actuator]\nlag = 0.02\n"))
    imposed = np.where(known.modes.sensor, 0.0, 3.0)
    volumes = []
    for lag in (0.02, 0.03):
        _, fitter, c = scale(known, actuator_lag=lag)
        volumes.append(fitter.log_volume(c, np.stack([0.0 * imposed, imposed, 0.0 * imposed])))
    assert volumes[0] == pytest.approx(0.0, abs=1e-9)
    assert volumes[1] > 0.0


@pytest.mark.parametrize("forwards", [True, False])
def test_a_log_of_one_direction_has_the_damping_of_its_side(forwards):
    """With the mean of both sides a friction that drives in the other direction passed for no damping at all."""
    one = numpy_machine.record(seconds=3.0, sensors=("position",), reference=np.full(3000, 3.0 if forwards else -3.0))
    search = gap_search.search_of(one)
    friction = effect("asymmetric_friction")
    more = search.setting.viscous + 1.0
    values = {"viscous": 0.5 * more, "viscous_difference": 0.5 * more if forwards else -0.5 * more}
    sides = search.candidate(Start((friction,), (), values))
    alike = search.candidate(Start((friction,), (), {"viscous": more, "viscous_difference": 0.0}))
    own = search.fitters[sides.family.key]
    assert own.lost_response(sides) == pytest.approx(own.lost_response(alike), rel=0.05)
    assert own.lost_response(alike).max() > 2.0


def test_a_reading_that_lags_shows_less_of_a_missing_torque():
    """Where it alone shows the motion: what it leaves would else be read as a smaller torque than it is."""
    log = numpy_machine.record(seconds=3.0, sensors=("velocity",))
    rate = gap_search.search_of(log)
    turned = 2.0 * np.pi * rate.modes.frequency * 0.02
    shown = np.where(rate.modes.sensor, 1.0, np.sqrt(1.0 + turned**2))
    assert scale(rate, velocity_lag=0.02)[0] == pytest.approx(shown)
    # Against what the nominal model has of it.
    known = make_search([log], [], load_model(gap_search.MODEL + "[sensor]\nlag = 0.02\n"))
    assert scale(known, velocity_lag=0.02)[0] == pytest.approx(1.0)
    assert scale(known, velocity_lag=0.03)[0].max() == pytest.approx(1.5, rel=0.02)


def chatter(seed, seconds=12.0):
    """A torque of 1 N m rms that changes every 20 ms, by sample of 1 ms."""
    return np.repeat(np.random.default_rng(seed).standard_normal(round(seconds * 50)), 20)


def test_a_torque_error_is_as_likely_in_the_command_as_at_the_mass():
    """It bends the fitted inertia by as much either way: up where the log alone holds it, down where it acts."""
    error, time = 0.5 * chatter(6), 1e-3 * np.arange(12000)
    machine = numpy_machine.Machine(kp=0.0, ki=0.0)
    run = {
        "seconds": 12.0,
        "sensors": ("position",),
        "feedforward": chatter(5) + 2.0 * np.sin(2.0 * np.pi * 1.3 * time),
    }
    log = numpy_machine.record(machine, **run)
    logs = (
        replace(log, torque=log.torque + error),
        numpy_machine.record(machine, **run, extra=lambda time, speed, angle, command: error[int(1e3 * time + 1e-3)]),
    )
    heavier, lighter = (
        search.base.values()["inertia"] / search.setting.inertia for search in map(gap_search.search_of, logs)
    )
    # A regression of one on the other would err by 12 % and more in one of the two: the error has a quarter of the
    # chatter's energy.
    assert 1.0 < heavier < 1.1
    assert 0.9 < lighter < 1.0
    assert heavier * lighter == pytest.approx(1.0, abs=0.02)


def test_a_command_that_stays_the_same_answers_no_missing_torque():
    """Two steps of a torque tell the mass, and what shakes the machine between them says nothing of it.

    Counted as torques that a loop answers, what is missing there spoke for a light mass: 0.04 for 0.1 kg m^2.
    """
    shaken = 0.03 * np.repeat(np.random.default_rng(3).standard_normal(800), 20)
    log = numpy_machine.record(
        numpy_machine.Machine(inertia=0.1, kp=0.0, ki=0.0, viscous=0.08), seconds=16.0,
        feedforward=np.where(np.arange(16000) < 8000, 0.7, 0.9),
        extra=lambda time, speed, angle, command: shaken[int(1e3 * time + 1e-3)],
    )  # fmt: skip
    search = gap_search.search_of(log, gap_search.MODEL.replace("0.03", "0.08"))
    assert search.setting.inertia == 0.05
    assert search.base.values()["inertia"] == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize("viscous", [0.5, 2.0])
def test_a_slow_command_answers_no_fast_torque(viscous):
    """A motor under the chirp of a voltage, shaken at up to 170 Hz, where the chirp of 0.3 to 1.5 Hz has nothing.

    Counted as an answer there, what a part of a sine leaks into fast octaves spoke for the light mass that was given.
    """
    time = 1e-3 * np.arange(12000)
    shaken = np.repeat(np.random.default_rng(3).standard_normal(4000), 3)
    log = numpy_machine.record(
        numpy_machine.Machine(inertia=0.1, kp=0.0, ki=0.0, viscous=viscous), seconds=12.0,
        feedforward=4.0 * viscous * np.sin(2.0 * np.pi * (0.3 + 0.05 * time) * time),
        extra=lambda time, speed, angle, command: shaken[int(1e3 * time + 1e-3)],
    )  # fmt: skip
    search = gap_search.search_of(log, gap_search.MODEL.replace("0.03", str(viscous)))
    assert search.setting.inertia == pytest.approx(0.05)
    assert search.base.values()["inertia"] == pytest.approx(0.1, rel=0.06)


def test_what_a_command_does_at_the_ends_of_windows_counts_as_in_their_middle():
    """A loop's answer to the steps of a reference, whose period may be that of the windows."""
    search = gap_search.search_of(numpy_machine.record(seconds=6.0))
    fitter, (record,) = search.fitters[search.exact.family.key], search.records

    def changes(phase):
        since = (np.arange(len(record.time)) - record.starts[0] - phase * record.samples) % record.samples * record.dt
        burst = np.exp(-since / 0.05) * np.cos(2.0 * np.pi * 8.0 * since)
        return np.mean(fitter._changes(replace(record, torque=burst)), axis=0)  # by mode

    at_ends, within = changes(0.0), changes(0.4)
    assert np.all(at_ends > 0.3 * within)
    assert np.all(within > 0.3 * at_ends)


def test_a_log_that_is_quiet_but_for_a_few_pushes_has_a_gap():
    def push(time, speed, angle, command):
        return 3.0 if 2.0 < time % 4.0 < 2.15 else 0.0

    search = gap_search.search_of(numpy_machine.record(seconds=8.0, sensors=("position",), extra=push))
    quiet = gap_search.search_of(numpy_machine.record(seconds=8.0, sensors=("position",)))

    def missing(one):
        return one.finish([one.exact])[0].missing_rms(one.train)

    # 3 N m for 0.15 s of every 4 s: 0.58 N m rms over the log.
    assert missing(search) > 0.1
    assert missing(quiet) < 0.1 * missing(search)


def test_the_travel_of_several_logs_is_that_of_the_one_that_goes_furthest():
    """A first run of one short stroke hides no ripple that the next one shows."""
    short, wide = (
        numpy_machine.record(
            seconds=2.0, sensors=("position",), reference=speed * np.sin(np.pi * 1e-3 * np.arange(2000))
        )
        for speed in (0.3, 6.0)
    )
    search = make_search([short, wide], [], load_model(gap_search.MODEL))
    assert search.setting.travel == pytest.approx(np.ptp(wide.position), rel=0.01)
    assert search.setting.travel > 5.0 * np.ptp(short.position)


@pytest.mark.parametrize("guide", [0.0, 10.0])
@pytest.mark.parametrize("sensor", ["velocity", "position"])
@pytest.mark.parametrize("viscous", [0.03, 2.0])
def test_a_torque_that_is_missing_to_a_machine_with_much_viscous_friction_is_told_as_large_as_it_is(
    monkeypatch, viscous, sensor, guide
):
    """A motor under a voltage comes to its speed in a fortieth of a second, and a window shows hardly more of it."""
    monkeypatch.setattr(search_module, "guide_bandwidth", lambda *arguments: guide)
    machine = numpy_machine.Machine(viscous=viscous, kp=3.0 + viscous, ki=30.0 + 10.0 * viscous)
    log = numpy_machine.record(machine, seconds=6.0, dt=4e-3, sensors=(sensor,), substeps=8)
    text = gap_search.MODEL.replace("coulomb = 0.4", "coulomb = 0.1").replace("viscous = 0.03", f"viscous = {viscous}")
    search = make_search([log], [], load_model(text.replace("dt = 1e-3", "dt = 4e-3")))
    assert search.guide == guide
    missing = float(np.sqrt(np.mean(np.concatenate(search.finish([search.exact])[0].missing))))
    assert missing == pytest.approx(0.3, rel=0.12)
