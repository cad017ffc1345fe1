"""The learned law recovers what moves the machine besides the model, and is told only where a simulation gains."""

import functools

import numpy as np
import pytest
from learned_logs import MODEL, VISCOUS, drive, searched

import fpjax as fp
from fpjax.gap.answer.corrected import corrected_model
from fpjax.gap.answer.fitted_machine import machine_of
from fpjax.gap.answer.gap_size import withheld
from fpjax.gap.answer.learned import blocks, learn, proposed, simulated
from fpjax.gap.answer.smooth_tables import make_tables


def bend(velocity):
    """Torque of a curve that rises, falls and levels off, as Stribeck's does, without a jump [N m]."""
    return 0.06 * np.tanh(velocity / 0.5) + 0.12 * np.exp(-((velocity / 1.2) ** 2)) * np.tanh(velocity / 0.2)


def wave(position):
    return 0.05 * np.cos(4.0 * position) + 0.03 * np.sin(position)


def spring(position):
    """From the middle of a travel of three revolutions on, stiffer towards the end."""
    return 0.01 * (position - 10.0) + 0.0004 * (position - 10.0) ** 3


CASES = {
    "velocity": {"law": lambda v, x, u, t: bend(v)},
    "position": {"law": lambda v, x, u, t: wave(x), "drift": 2.0},
    "spring": {"law": lambda v, x, u, t: spring(x), "drift": 1.0, "seconds": 20.0, "encoder": True},
    "torque": {"law": lambda v, x, u, t: 0.15 * u},
    "nothing": {"law": lambda v, x, u, t: 0.0},
    "push": {"law": lambda v, x, u, t: 0.0, "push": (4.2, 4.6, 0.6)},
    "pushed": {"law": lambda v, x, u, t: bend(v), "push": (4.2, 4.6, 0.6)},
}


@functools.cache
def found(name):
    """The search and the nominal model's fit of a case."""
    return searched(drive(**CASES[name]))


@functools.cache
def learned(name):
    return learn(found(name).search, found(name).fit)


def missing(search, fit):
    """Missing torque on withheld windows [N m]."""
    return float(np.sqrt(max(np.mean(withheld(search, fit)), 0.0)))


def moving(law):
    """Which points of a law are not those of a machine at rest, where static friction may hold any torque."""
    at = np.array(law.at)
    return np.abs(at) > 0.002 * np.max(np.abs(at)) if law.of == "velocity" else np.ones(len(at), bool)


def inside(law, truth):
    """Share of the points, those at rest left out, whose band holds the truth."""
    at = np.array(law.at)
    held = (np.array(law.low) <= truth(at)) & (truth(at) <= np.array(law.high))
    return float(np.mean(held[moving(law)]))


def test_a_curve_of_velocity_lies_within_its_band_and_the_gap_closes():
    search, fit = found("velocity").search, found("velocity").fit
    (law,) = learned("velocity").laws
    assert law.of == "velocity"
    assert inside(law, bend) >= 0.8
    # A band of half the curve would hold nearly any curve.
    assert np.max((np.array(law.high) - np.array(law.low))[moving(law)]) < 0.5 * np.max(np.abs(law.torque))
    assert missing(search, learned("velocity").fit) < 0.2 * missing(search, fit)
    # The share is of the energy that the simulation with the law no longer misses.
    taken = 1.0 - (missing(search, learned("velocity").fit) / missing(search, fit)) ** 2
    assert law.share == pytest.approx(taken, abs=0.01)


def test_its_blocks_simulate_the_curve():
    """The table and the jump of the blocks are the law that is drawn."""
    (law,) = learned("velocity").laws
    (table,), coulomb = blocks([law], 1.0)
    x = np.array([-2.0, -0.6, 0.3, 1.1, 3.0])
    torque = np.asarray(table.value(x)) + coulomb * np.sign(x)
    np.testing.assert_allclose(torque, np.interp(x, law.at, law.torque), atol=1e-6)
    np.testing.assert_allclose(torque, bend(x), atol=0.01)


def test_the_corrected_model_holds_the_law():
    """`learned.toml`: read back, its friction and its table are the fitted viscous friction and the curve."""
    text, missing = corrected_model(fp.load_model(MODEL), machine_of(learned("velocity").fit.candidate))
    assert missing == ""
    assert "[[learned]]" in text
    plant = fp.load_model(text).loop.plant
    (law,) = learned("velocity").laws
    for speed in (-2.0, -0.6, 0.3, 1.1, 3.0):
        motion = fp.Motion(np.array(speed), np.array(0.0), np.array(0.0), np.array(0.0))
        opposed = float(plant.load.readout(motion)) + float(plant.friction.readout((), motion, np.array(0.0)))
        assert opposed == pytest.approx(VISCOUS * speed + np.interp(speed, law.at, law.torque), abs=1e-4)


def test_nothing_of_the_fit_is_changed():
    search, fit = found("velocity").search, found("velocity").fit
    c = fit.candidate
    before = [part.copy() for part in (*c.states, *c.hidden, c.level, c.vector)]
    families = dict(search.fitters)
    again = learn(search, fit)
    for was, now in zip(before, (*c.states, *c.hidden, c.level, c.vector), strict=True):
        np.testing.assert_array_equal(was, now)
    assert search.fitters == families
    assert again.laws == learned("velocity").laws


@pytest.mark.long
def test_a_wave_over_position_is_not_a_curve_of_velocity():
    (law,) = learned("position").laws
    assert law.of == "position"
    assert law.period == pytest.approx(2.0 * np.pi)
    assert inside(law, wave) >= 0.8


@pytest.mark.long
def test_a_spring_over_several_revolutions_is_a_law_of_the_whole_travel():
    (law,) = learned("spring").laws
    assert law.of == "position"
    assert law.period is None
    assert law.at[-1] - law.at[0] > 4.0 * np.pi
    assert inside(law, spring) >= 0.8
    search, fit = found("spring").search, found("spring").fit
    assert missing(search, learned("spring").fit) < 0.2 * missing(search, fit)


@pytest.mark.long
def test_a_weak_motor_is_a_law_of_the_torque_and_drives_a_simulation():
    (law,) = learned("torque").laws
    assert law.of == "torque"
    (table,), _ = blocks([law], 0.0)
    motion = fp.Motion(np.array(0.3), np.array(0.0), np.array(0.0), np.array(0.2))
    assert float(table.readout(motion)) == pytest.approx(0.03, rel=0.05)


@pytest.mark.parametrize("name", ["nothing", pytest.param("push", marks=pytest.mark.long)])
def test_noise_and_a_push_that_nobody_recorded_teach_nothing(name):
    assert learned(name) is None


@pytest.mark.long
def test_a_pushed_window_does_not_bend_the_curve():
    law = next(law for law in proposed(found("pushed").search, found("pushed").fit) if law.of == "velocity")
    assert inside(law, bend) >= 0.8


def test_a_law_that_does_not_hold_withheld_is_not_told(monkeypatch):
    """A proposal is only told for what the simulation with it no longer misses: a wrong sign is refused."""
    import fpjax.gap.answer.learned as room

    (law,) = proposed(found("velocity").search, found("velocity").fit)
    turned = law.__class__(law.of, law.share, law.at, *(tuple(-t for t in x) for x in (law.torque, law.high, law.low)))
    monkeypatch.setattr(room, "proposed", lambda search, fit: (turned,))
    assert learn(found("velocity").search, found("velocity").fit) is None


def test_a_jump_leaves_no_less_than_no_friction():
    (law,) = learned("velocity").laws
    at, torque = (-3.0, 0.0, 0.0, 3.0), (0.5, 0.5, -0.5, -0.5)
    turned = law.__class__("velocity", 0.5, at, torque, torque, torque)
    beside = simulated(found("velocity").search, found("velocity").fit, [turned])
    assert beside.candidate.values()["coulomb"] == 0.0
    (table,), coulomb = blocks([turned], 0.2)
    assert coulomb == -0.2
    x = np.array([-3.0, 0.0, 3.0])
    np.testing.assert_allclose(np.asarray(table.value(x)) + coulomb * np.sign(x), [0.5, 0.0, -0.5], atol=1e-6)


def test_tables_of_a_revolution_and_of_a_short_travel():
    long, blind, short = (
        drive(lambda v, x, u, t: 0.0, seconds=4.0, drift=drift, encoder=encoder)
        for drift, encoder in ((4.0, True), (4.0, False), (0.0, False))
    )
    records = [searched_records(log) for log in (long, short, blind)]
    assert make_tables(records[0])["position"][0].period == pytest.approx(2.0 * np.pi)
    tables = make_tables(records[0], (30.0,))["position"]
    whole = [table for table in tables if table.period is None]
    assert [t.period for t in tables if t.period] == pytest.approx([2.0 * np.pi, 2.0 * np.pi / 30.0])
    assert len(whole) == 1
    assert whole[0].at[-1] - whole[0].at[0] == pytest.approx(np.ptp(records[0][0].angle), rel=0.01)
    assert [table.period for table in make_tables(records[1])["position"]] == [None]
    # Of an integrated rate nobody knows where the travel began.
    assert None not in [table.period for table in make_tables(records[2])["position"]]


def searched_records(log):
    from fpjax.gap.data.record import make_records

    return make_records([log], [], 0.05)
