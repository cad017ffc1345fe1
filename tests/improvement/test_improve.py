"""improve on a diagnosis made by hand: what it proposes, what it promises, and when it proposes nothing."""

import dataclasses
import json

import improve_case as case
import numpy as np
import numpy_machine
import pytest

import fpjax as fp
from fpjax.gap.data.record import in_one_piece
from fpjax.improvement.from_diagnosis import about_left
from fpjax.improvement.machines import (
    divided,
    draw_machines,
    make_ground,
    one_piece,
    ready,
    records_of,
)
from fpjax.improvement.margins import NAMES
from fpjax.improvement.nominal_gains import nominal_gains
from fpjax.improvement.page import to_page
from fpjax.improvement.pictures import draw_gains
from fpjax.improvement.verb import followed, improve_known
from fpjax.output.stages import StageClock


def improved(known, model, free=()):
    log = case.log()
    return improve_known(known, log, model, followed(log, model, "log"), free, 0, StageClock(None), None, None)


@pytest.fixture(scope="module")
def small():
    with pytest.MonkeyPatch.context() as patch:
        case.few(patch)
        yield


@pytest.fixture(scope="module")
def found(small) -> fp.Improvement:
    return improved(case.known(), case.model(), ["controller"])


def test_no_more_torque_is_asked_for_than_the_file_allows(small, found):
    most = 0.95 * found.after.peak.value
    tight = improved(case.known(), case.model(f"[limits]\ntorque = {most}\n"), ["controller"])
    assert tight.after.peak.value < 1.01 * most
    assert not any("a larger [limits] torque" in note for note in tight.notes)


def test_nothing_above_the_drives_rating_is_proposed_also_where_the_log_is_above_it(small, found):
    reached = float(np.max(np.abs(case.log().torque)))
    for share in (0.9, 0.7, 0.5):
        tight = improved(case.known(), case.model(f"[limits]\ntorque = {share * reached}\n"), ["controller"])
        assert tight.decision == "keep" or tight.after.peak.value < 1.03 * share * reached
        said = tight.notes if tight.decision == "change" else [tight.reason]
        assert any("is above the" in each and "[limits] torque" in each for each in said)


@pytest.mark.parametrize("factor", [180.0 / np.pi, -1.0])
def test_a_reference_in_another_unit_or_of_the_other_sign_is_not_followed(factor):
    log = dataclasses.replace(case.log(), reference=factor * case.log().reference)
    with pytest.raises(fp.InputError, match=r"No gains are tuned .* the reference"):
        fp.improve(log, case.model(), free="controller")


def test_the_proposal_follows_as_promised_on_a_machine_that_is_no_code_of_ours(found):
    assert found.decision == "change"
    gains = found.after.gains
    log = case.log()
    machine = dataclasses.replace(case.TRUE, kp=gains["controller.kp"], ki=gains["controller.ki"])
    run = numpy_machine.record(machine, seconds=1.5, reference=log.reference, velocity_noise=5e-3)
    kept = slice(150, None)

    def error(one):
        return np.sqrt(np.mean((one.reference - one.velocity)[kept] ** 2) - 5e-3**2)

    assert error(run) < 0.7 * error(log)
    assert found.after.error.low < error(run) < found.after.error.high
    assert found.measured == pytest.approx(error(log), rel=1e-6)


def with_rivals(known, *rivals):
    return dataclasses.replace(known, posterior=dataclasses.replace(known.posterior, rivals=rivals))


def test_rivals_are_among_the_machines_as_often_as_they_are_likely():
    assert divided(16, []) == [16]
    assert divided(16, [0.25, 0.01]) == [11, 4, 1]
    assert divided(16, [0.5, 0.4]) == [8, 4, 4]
    heavy = case.known(values=(0.08, 0.4, 0.03), missing=0.1).posterior
    sticky = dataclasses.replace(case.known(values=(0.05, 0.6, 0.03)).posterior, key=("bristles", ()), gap=0.0)
    known = with_rivals(case.known(), (0.25, heavy), (0.25, sticky))
    records = records_of(case.log(), case.model())
    ground = make_ground(known, records, 0)
    machines = ready(draw_machines(known.posterior, case.model(), ground, 12, 1), ground, (4, 4))
    assert machines.count == 12
    assert [len(part.shares) for part in machines.parts] == [6, 3, 3]
    one, two, three = machines.parts
    assert np.asarray(two.machine.plant.inertia) == pytest.approx(0.08, rel=0.1)
    assert np.asarray(three.machine.law.coulomb) == pytest.approx(0.6, rel=0.1)
    # Each has the missing torque of its own explanation, and no other's.
    courses = np.abs(part_courses(two, ground)).max(axis=1)
    assert np.all(courses > 0.05)
    assert np.abs(part_courses(one, ground)).max() == 0.0
    assert np.abs(part_courses(three, ground)).max() == 0.0


def test_what_the_simulation_misses_of_the_log_widens_the_promise(found, small):
    """The rms of the error is the same with and without what is added; its course is not."""
    log = case.log()
    time = log.time
    error = log.reference - log.velocity
    added = 0.2 * np.sin(2.0 * np.pi * 9.0 * time)
    size = np.sqrt(np.mean(error**2) / np.mean((error + added) ** 2))
    other = dataclasses.replace(log, velocity=log.reference - size * (error + added))
    model = case.model()
    table = followed(other, model, "log")
    told = improve_known(case.known(), other, model, table, ["controller"], 0, StageClock(None), None, None)
    assert told.measured == pytest.approx(found.measured, rel=0.02)
    assert width(told.before.error) < 1.5 * width(found.before.error)
    assert width(told.after.error) > 2.0 * width(found.after.error)


def test_where_other_gains_made_the_log_the_promise_is_in_doubt(found, small):
    log = case.log()
    softer = dataclasses.replace(case.TRUE, kp=0.5)
    other = numpy_machine.record(softer, seconds=1.5, reference=log.reference, velocity_noise=5e-3)
    known, model = dataclasses.replace(case.known(), made=False), case.model()
    told = improve_known(
        known, other, model, followed(other, model, "log"), ["controller"], 0, StageClock(None), None, None
    )
    assert told.measured is None
    assert width(told.after.error) > 0.15 > width(found.after.error)


def test_without_a_rate_sensor_the_encoder_tells_what_the_prediction_is_worth(small):
    log = case.log()
    machine = numpy_machine.record(case.TRUE, seconds=1.5, reference=log.reference, position_noise=1e-5)
    alone = dataclasses.replace(machine, velocity=None)
    known, model = dataclasses.replace(case.known(), made=False), case.model()
    told = improve_known(
        known, alone, model, followed(alone, model, "log"), ["controller"], 0, StageClock(None), None, None
    )
    assert width(told.after.error) < 0.15


def test_a_log_of_another_reference_says_nothing_of_the_prediction(small):
    log, model = case.log(), case.model()
    table = 0.5 * followed(log, model, "log")
    found = improve_known(case.known(), log, model, table, ["controller"], 0, StageClock(None), None, None)
    assert found.measured is None


def width(promised):
    return np.log(promised.high / promised.low)


def part_courses(part, ground):
    return part.shares @ ground.courses


def test_a_rival_widens_the_prediction(found, small):
    heavier = case.known(values=(0.075, 0.4, 0.03)).posterior
    wide = improved(with_rivals(case.known(), (0.4, heavier)), case.model(), ["controller"])
    assert wide.machines == found.machines
    alone, both = found.before.error, wide.before.error
    assert both.high / both.low > 1.2 * alone.high / alone.low


def test_a_rival_that_would_not_have_followed_as_the_log_shows_is_left_out(found, small):
    heavy = case.known(values=(0.1, 0.4, 0.03)).posterior
    rest = improved(with_rivals(case.known(), (0.4, heavy)), case.model(), ["controller"])
    assert rest.machines < found.machines
    assert any("left out" in note for note in rest.notes)


def test_the_answer_says_before_and_after_with_intervals(found):
    for side in (found.before, found.after):
        for name, value in side.rows():
            assert value.low <= value.value <= value.high, name
        assert set(side.margins) == {"modulus", "gain", "phase", "delay"}
        assert side.unstable == 0.0
    assert found.after.error.high < found.before.error.low
    assert found.before.reversal is not None
    told = str(found)
    assert "controller.kp" in told
    assert "at reversals" in told
    content = json.loads(json.dumps(found.to_dict()))
    assert content["decision"] == "change"
    assert content["after"]["error"]["unit"] == "rad/s"


def test_the_tuned_model_is_the_corrected_one_with_the_new_gains(found):
    model = fp.load_model(found.model)
    assert float(model.loop.plant.friction.coulomb) == pytest.approx(0.4)
    assert float(model.loop.controller.kp) == pytest.approx(found.after.gains["controller.kp"], rel=1e-6)


def test_the_page_needs_nothing_and_names_every_gain(found):
    page = to_page(found)
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    for change in found.changes:
        assert change.gain in page


def test_the_pages_numbers_have_units_and_its_words_are_an_engineers(found):
    page = to_page(found)
    facts = page[page.index('<dl class="facts">') : page.index("</dl>")]
    assert facts.count("90 % interval <span>") == facts.count("<dt>")
    assert all("rad/s</span>" in cell for cell in facts.split("<dt>")[1:])
    assert " N m " not in page.partition("<pre>")[0].partition("Notes")[0]
    assert "gain margin, a factor" in page
    change = next(each for each in found.changes if each.gain == "controller.kp")
    assert f"{change.after:.5g} N·m·s/rad" in page
    linear = dataclasses.replace(found, model='[units]\nmotion = "linear"\n[controller]\ntype = "pi"\n')
    assert f"{change.after:.5g} N·s/m" in to_page(linear)
    unknown = dataclasses.replace(found, model="", diagnosis=None)
    assert f">{change.after:.5g}</span>" in to_page(unknown)
    assert "<div></div>" not in page  # an empty cell has no place on a phone
    told = to_page(dataclasses.replace(found, causes=("stribeck",)))
    assert "(Stribeck friction)" in told


@pytest.mark.parametrize("narrow", [False, True])
def test_no_title_is_cut_and_no_bound_lies_on_a_dot(found, narrow):
    figure = draw_gains(found, narrow=narrow)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    title = axes.title if axes.title.get_text() else axes._left_title
    assert title.get_window_extent().x1 <= figure.bbox.x1
    dots = axes.transData.transform([(0.0, 0.0), (1.0, 0.0)])[:, 0]
    radius = 0.5 * 30.0**0.5 * figure.dpi / 72.0  # of a dot, from its area [points^2]
    for bound in axes.texts:
        box = bound.get_window_extent()
        assert box.x1 < dots[0] - radius or box.x0 > dots[1] + radius


@pytest.mark.long
def test_gains_that_cannot_be_bettered_are_kept(small, found):
    model = case.model()
    best = found.after.gains
    loop = fp.set_parameters(
        model.loop, {"controller.kp": best["controller.kp"], "controller.ki": best["controller.ki"]}
    )
    low, high = 0.999, 1.001  # nothing within these bounds is 2 % better
    bounds = {word: (low * value, high * value) for word, value in best.items()}
    kept = improved(case.known(), dataclasses.replace(model, loop=loop, bounds=bounds))
    assert kept.decision == "keep"
    assert "Keep your gains" in str(kept)
    assert kept.model == ""
    assert kept.after.gains == kept.before.gains


def test_a_corrected_model_that_is_unstable_has_no_margins_and_nothing_is_predicted(small):
    observer = '[observer]\ntype = "efp"\ngain_1 = 2.0\ngain_2 = 0.5\n'
    unstable = fp.load_model(case.text(observer).replace("kp = 1.5", "kp = 200.0"))
    found = improved(case.known(), unstable, ["controller"])
    assert found.decision == "unstable"
    assert found.before.unstable == 1.0
    assert {name: value.high for name, value in found.before.margins.items()} == dict.fromkeys(NAMES, 0.0)
    for told in (str(found), to_page(found)):
        assert "unstable" in told
        assert "inf " not in told


def test_what_is_kept_has_one_prediction(found):
    kept = dataclasses.replace(found, decision="keep", reason="Keep your gains.", after=found.before, changes=())
    error = next(line for line in str(kept).splitlines() if "tracking error, rms" in line)
    assert error.split("rms", 1)[1].strip() == str(found.before.error)


def test_of_a_machine_that_is_hardly_known_nothing_is_promised_anywhere(found):
    """However well its log is explained."""
    told = dataclasses.replace(found, decision="cannot_promise", reason="Too little is known.", changes=())
    assert not told.promised
    assert "possible, not promised" in str(told)
    assert "90 % interval" not in str(told)
    page = to_page(told)
    assert "Possible, not promised" in page
    assert "no promise: too little is known" in page


@pytest.mark.parametrize("kp", [1.5, 1.6])
def test_a_diagnosis_of_other_gains_is_not_held_against_the_log(small, kp):
    model = fp.load_model(case.text().replace("kp = 1.5", f"kp = {kp}"))
    found = fp.improve(case.log(), model, free=["controller"], diagnosis=case.known())
    assert (found.measured is not None) == (kp == 1.5)
    assert any("its gains were others" in note for note in found.notes) == (kp != 1.5)


def test_a_gain_at_its_bound_is_said_with_both_bounds(small):
    narrow = case.model("[bounds]\ncontroller.kp = [1.4, 1.6]\n")
    found = improved(case.known(), narrow)
    assert [change.at for change in found.changes] == ["high"]
    assert "at the high end of its bounds</span>" in to_page(found)
    assert any("controller.kp ended at the high end of its bounds" in n and "in 1.4 to 1.6" in n for n in found.notes)


def test_how_much_smaller_the_error_becomes_is_as_uncertain_as_the_error(found):
    """The headline holds the ratio: what the model itself does not know of an error belongs to it too."""
    ratio, after = (np.log(each.high / each.low) for each in (found.ratio, found.after.error))
    assert ratio > 0.9 * after
    assert ratio > 0.06


# --- the gains of the nominal model beside the proposed ones


def test_the_nominal_models_gains_are_judged_beside_the_proposed_ones(found):
    """The nominal Coulomb level is half of the true one: its feed-forward is too weak."""
    alone = found.nominal
    assert set(alone.gains) == set(found.after.gains)
    assert found.to_dict()["nominal"]["ratio"]["value"] == alone.ratio.value
    assert alone.sentence() in found.notes
    assert alone.sentence() in str(found)
    assert "The gains of the nominal model" in to_page(found)


def test_the_nominal_models_gains_are_those_that_a_tuning_without_the_diagnosis_finds(small, found):
    log = case.log()
    assert nominal_gains(log, case.model(), ["controller"]) == pytest.approx(found.nominal.gains)


def long_log():
    """(a log too long to be simulated as a whole, what is known; missing torque only where nothing is followed)."""
    log = case.log(60.0)
    (whole,) = records_of(log, case.model())
    missing = np.full(len(whole.time), 100.0)
    missing[: len(in_one_piece(whole).time)] = 0.0
    posterior = dataclasses.replace(case.known().posterior, missing=(missing,))
    return log, dataclasses.replace(case.known(), posterior=posterior)


def test_of_a_long_log_one_stretch_is_followed_with_its_own_missing_torque():
    log, known = long_log()
    (whole,) = records_of(log, case.model())
    piece, table = one_piece(whole, log, followed(log, case.model(), "log"))
    assert len(piece.time) < len(log.time) / 2
    at = np.searchsorted(log.time, piece.time - 5e-4)
    assert table == pytest.approx(log.reference[at][: len(table)])
    ground = make_ground(known, [whole], 0)
    assert ground.courses.shape == (3, len(piece.time))
    assert not ground.courses.any()


@pytest.mark.long
def test_a_long_log_is_improved_and_it_is_said_what_was_followed(small):
    log, known = long_log()
    model = case.model()
    found = improve_known(
        known, log, model, followed(log, model, "log"), ["controller"], 0, StageClock(None), None, None
    )
    assert found.measured == pytest.approx(found.before.error.value, rel=0.05)
    assert any("The log is long" in note for note in found.notes)


def test_a_machine_that_nobody_knows_is_promised_nothing(small):
    known = case.known(missing=1.5, verdict="unexplained", spread=0.6)
    found = improved(known, case.model(), ["controller"])
    if found.decision == "change":  # whatever it is, it must hold for nearly all
        assert found.wins >= 0.95
        assert found.reason.startswith("Expected, not promised")
    else:
        assert found.model == ""
    assert any("does not explain" in note and "no promise" in note for note in found.notes)
    assert not found.promised
    assert found.to_dict()["promised"] is False
    assert "expected, not promised" in str(found)
    assert "90 % interval" not in str(found)
    assert "Expected, not promised" in to_page(found)


def test_what_is_left_of_a_part_that_is_explained_is_told_with_its_size():
    said = about_left(case.known(missing=1.5, verdict="partly_explained"), 6.0, "N m")
    assert "1.5 N m rms, 25% of the torque" in said
    assert "hold if it does not" in said
