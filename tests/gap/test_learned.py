"""The learned law recovers what moves the machine besides the model, and learns nothing where nothing follows."""

import numpy as np
import pytest
from learned_logs import drive, searched

import fpjax as fp
from fpjax.gap.answer.learned import LearnedBlocks, learn
from fpjax.gap.answer.smooth_tables import make_tables


def bend(velocity):
    """Torque of a curve that rises, falls and levels off, as Stribeck's does, without a jump [N m]."""
    return 0.06 * np.tanh(velocity / 0.5) + 0.12 * np.exp(-((velocity / 1.2) ** 2)) * np.tanh(velocity / 0.2)


def wave(position):
    return 0.05 * np.cos(4.0 * position) + 0.03 * np.sin(position)


@pytest.fixture(scope="module")
def of_velocity():
    found = searched(drive(lambda v, x, u, t: bend(v)))
    return found, learn(found.search, found.fit)


def inside(law, truth):
    """Share of the points, those at rest left out, whose band holds the truth."""
    at = np.array(law.at)
    moving = np.abs(at) > 0.02 * np.max(np.abs(at)) if law.of == "velocity" else np.ones(len(at), bool)
    held = (np.array(law.low) <= truth(at)) & (truth(at) <= np.array(law.high))
    return float(np.mean(held[moving]))


def test_a_curve_of_velocity_lies_within_its_band(of_velocity):
    _, learned = of_velocity
    assert [law.of for law in learned.laws] == ["velocity"]
    law = learned.laws[0]
    assert inside(law, bend) >= 0.8
    assert np.max(np.array(law.high) - np.array(law.low)) < 0.5 * np.max(np.abs(law.torque))
    assert law.share > 0.9
    assert law.share + learned.nothing == pytest.approx(1.0)


def test_the_torque_that_is_left_falls(of_velocity):
    found, learned = of_velocity
    assert learned.after < 0.2 * learned.before
    assert learned.level < 0.3 * found.fit.level


def test_the_best_law_of_each_variable_is_weighed(of_velocity):
    _, learned = of_velocity
    assert max(learned.gains, key=learned.gain_of) == "velocity"
    assert learned.gain_of("velocity") == pytest.approx(learned.gain)
    assert learned.gain_of("velocity") > learned.gain_of("load") + 100.0


def test_its_blocks_simulate_the_curve(of_velocity):
    """The table and the jump of the blocks are the law that is drawn."""
    _, learned = of_velocity
    blocks = learned.blocks()
    (table,) = blocks.tables
    x = np.array([-2.0, -0.6, 0.3, 1.1, 3.0])
    torque = np.asarray(table.value(x)) + blocks.coulomb * np.sign(x)
    np.testing.assert_allclose(torque, learned.laws[0].curve(x)[0], atol=1e-6)
    np.testing.assert_allclose(torque, bend(x), atol=0.01)


def test_nothing_of_the_fit_is_changed(of_velocity):
    found, learned = of_velocity
    c = found.fit.candidate
    before = [b.copy() for b in (*c.burst, *c.states, *c.hidden, c.level)]
    again = learn(found.search, found.fit)
    for was, now in zip(before, (*c.burst, *c.states, *c.hidden, c.level), strict=True):
        np.testing.assert_array_equal(was, now)
    assert again == learned


def test_a_wave_over_position_is_not_a_curve_of_velocity():
    found = searched(drive(lambda v, x, u, t: wave(x), drift=2.0))
    learned = learn(found.search, found.fit)
    assert [law.of for law in learned.laws] == ["position"]
    law = learned.laws[0]
    assert law.period == pytest.approx(2.0 * np.pi)
    assert learned.gain_of("position") > learned.gain_of("velocity") + 100.0
    torque, low, high = law.curve(np.array([0.3, 0.3 + 2.0 * np.pi]))
    assert torque[0] == pytest.approx(torque[1])
    assert np.all(low <= torque)
    assert np.all(torque <= high)
    assert inside(law, wave) >= 0.8


def test_noise_teaches_nothing():
    found = searched(drive(lambda v, x, u, t: 0.0))
    learned = learn(found.search, found.fit)
    assert learned.laws == ()
    assert learned.nothing == 1.0
    assert max(learned.gains.values()) < 5.0
    assert learned.blocks() == LearnedBlocks((), 0.0, 0.0)


def test_a_push_that_nobody_recorded_teaches_nothing():
    found = searched(drive(lambda v, x, u, t: 0.0, push=(4.2, 4.6, 0.6)))
    assert learn(found.search, found.fit).laws == ()


def test_a_pushed_window_does_not_bend_the_curve():
    found = searched(drive(lambda v, x, u, t: bend(v), push=(4.2, 4.6, 0.6)))
    law = learn(found.search, found.fit).law("velocity")
    assert law is not None
    assert inside(law, bend) >= 0.8


def test_friction_that_grows_with_the_load_is_told_from_velocity_and_torque():
    found = searched(drive(lambda v, x, u, t: 0.15 * abs(u) * np.tanh(v / 0.02)))
    learned = learn(found.search, found.fit)
    assert learned.laws[0].of == "load"
    blocks = learned.blocks()
    assert blocks.load_coefficient == pytest.approx(0.15, rel=0.03)
    assert blocks.tables == () or {t.of for t in blocks.tables} == {"velocity"}


def test_a_weak_motor_is_a_law_of_the_torque_and_drives_a_simulation():
    found = searched(drive(lambda v, x, u, t: 0.15 * u))
    learned = learn(found.search, found.fit)
    assert [law.of for law in learned.laws] == ["torque"]
    (table,) = learned.blocks().tables
    motion = fp.Motion(np.array(0.3), np.array(0.0), np.array(0.0), np.array(0.2))
    assert float(table.readout(motion)) == pytest.approx(0.03, rel=0.05)


def test_tables_of_a_revolution_and_of_a_short_travel():
    long, short = drive(lambda v, x, u, t: 0.0, seconds=4.0, drift=4.0), drive(lambda v, x, u, t: 0.0, seconds=4.0)
    records = [searched_records(log) for log in (long, short)]
    assert make_tables(records[0])["position"][0].period == pytest.approx(2.0 * np.pi)
    assert [t.period for t in make_tables(records[0], (30.0,))["position"]] == pytest.approx(
        [2.0 * np.pi, 2.0 * np.pi / 30.0]
    )
    assert make_tables(records[1])["position"][0].period is None


def searched_records(log):
    from fpjax.gap.data.record import make_records

    return make_records([log], [], 0.05)
