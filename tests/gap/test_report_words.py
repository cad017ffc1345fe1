"""What the report says and draws of a diagnosis: sentences, digits, units, the model with its changes, pictures."""

import dataclasses
import html
import math
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from report_cases import CASES

from fpjax import dump_model, load_model
from fpjax.gap import EFFECTS, Estimate, FittedParameter, FreeReplay, Share, Step, Where
from fpjax.gap.answer.summary import dominant_sentence, verdict_line
from fpjax.gap.report import (
    derived_values,
    digits,
    gap_picture,
    heading,
    markup,
    model_text,
    names,
    record_picture,
    sections,
    sentences,
    where_picture,
)
from fpjax.gap.report.digits import show_percent
from fpjax.gap.select.dominant import DominantVariable


def test_verdicts_have_fitting_sentences():
    told = {name: make() for name, make in CASES.items()}
    found = {name: sentences.verdict_sentence(told[name]) for name in told}
    assert found["explained"].startswith("The simulation lacks Stribeck friction; with that corrected")
    assert "cannot tell which" in found["pair_with_twins"]
    assert "a constant torque or asymmetric friction" in found["pair_with_twins"]
    assert "agrees" in found["no_gap"]
    assert "no effect of the vocabulary closes" in found["unexplained"]
    assert re.search(r"misses [\d.]+\u202fN rms of force", found["unexplained"])
    hidden = dataclasses.replace(told["unexplained"].gap, before=0.0)
    unseen = sentences.verdict_sentence(dataclasses.replace(told["unexplained"], gap=hidden))
    assert unseen.startswith("On withheld data no missing force stands above the noise floor of ")
    gap = dataclasses.replace(told["unexplained"].gap, closed=0.44)
    unsure = dataclasses.replace(told["unexplained"], gap=gap)
    allowed = dataclasses.replace(unsure, allowed=("backlash", unsure.ranking[0].effect))
    assert "none of the 2 effects" in verdict_line(allowed)
    assert "none of the 2 effects" in sentences.verdict_sentence(allowed)
    name = names.effect_name(unsure.ranking[0].effect, unsure.motion)
    attempt = sentences.verdict_sentence(unsure).replace("\u202f", " ")
    assert f"the best attempt, led by {name}, closes 44 % of it" in attempt
    assert f"led by {unsure.ranking[0].effect}, closes 44.0% of it" in verdict_line(unsure)
    assert "no effect" not in attempt + verdict_line(unsure)
    assert sentences.confidence_sentence(told["explained"]).replace("\u202f", " ") == "Very likely (96 %)."
    assert all(sentence.count(".\n") == 0 and sentence.endswith(".") for sentence in found.values())
    one_open = dataclasses.replace(told["pair_with_twins"], causes=("constant_torque", "backlash"))
    assert "asymmetric friction (this log cannot tell which), and backlash; with both" in sentences.verdict_sentence(
        one_open
    )
    partly = sentences.verdict_sentence(told["partly_explained"]).replace("\u202f", " ")
    assert re.match(r"Stribeck friction explains \d+ % of the missing torque; \d+ % is left \(", partly)
    assert not re.search(r"not|fail|but|only", partly)
    wrong = dataclasses.replace(told["explained"], causes=("inertia_error",))
    assert sentences.verdict_sentence(wrong).startswith("The simulation has a wrong inertia;")
    linear = dataclasses.replace(wrong, motion="linear")
    assert sentences.verdict_sentence(linear).startswith("The simulation has a wrong mass;")


def test_what_moves_the_machine_is_told_where_far_more_of_it_is_closed():
    told = CASES["partly_explained"]()

    def said(closed, moving):
        gap = dataclasses.replace(told.gap, closed=closed, closed_moving=moving)
        found = dataclasses.replace(told, gap=gap)
        return sentences.verdict_sentence(found).replace("\u202f", " "), verdict_line(found)

    page, line = said(0.13, 0.54)
    assert "13 % of the missing torque and 54 % of the part of it that moves the machine; 87 % is left" in page
    assert "13.0% of the gap is closed on withheld data and 54.0% of the part of it that moves the machine" in line
    assert told.gap.to_dict().keys() >= {"closed_moving"}
    for closed, moving in ((0.13, 0.2), (0.6, 0.62), (0.285, 0.295), (0.13, math.nan)):
        assert all("moves the machine" not in sentence for sentence in said(closed, moving))


def test_an_error_of_the_reading_alone_closes_no_gap_and_sounds_like_no_failure():
    told = CASES["explained"]()
    found = dataclasses.replace(told, causes=("velocity_delay",), gap=told.gap.unchanged())
    assert found.gap.closed == 0.0
    assert found.gap.after_interval == found.gap.before_interval
    page, line = sentences.verdict_sentence(found), verdict_line(found)
    assert line == "Explained by velocity_delay: apart from the reading, the simulation misses no torque that matters."
    assert page.startswith(
        "The simulation lacks a velocity sensor delay; the torque missing beside that is too little to matter ("
    )
    head = heading.header(found)
    assert "Difference" in head
    assert not re.search("Gap after|Gap closed", head)
    assert re.search("Gap after.*Gap closed", heading.header(told), re.DOTALL)
    # No place, no corrected course of a torque that does not matter; what the loop does with the reading is told.
    assert sentences.where_sentence(found) == ""
    assert where_picture.residual_axes(found) == []
    assert [name for name, _ in gap_picture.rows_of(dataclasses.replace(found, steps=()))] == ["Nominal model"]
    assert "what the nominal model misses does not matter" in sections.shrink(found, {})
    assert sentences.tracking_sentence(found) == sentences.tracking_sentence(told)


def test_units_and_shares_are_spelled_for_people():
    assert digits.show_unit("N m s^2/rad^2") == "N·m·s²/rad²"
    assert digits.show_unit("kg m^2") == "kg·m²"
    assert digits.show_unit("1") == ""
    assert digits.scale_for(0.00402, "s") == (1e3, "ms")
    assert digits.scale_for(3e-5, "rad") == (1e6, "µrad")
    assert digits.scale_for(3e-5, "kg m^2") == (1.0, "kg m^2")
    spaces = str.maketrans({"\u202f": " "})
    shares = {
        0.9996: "99.9 %",
        1.0: "100 %",
        0.0: "0 %",
        0.0004: "< 0.1 %",
        0.004: "0.4 %",
        0.0096: "1 %",
        0.5: "50 %",
        -0.04: "−4 %",
    }
    assert {share: digits.show_percent(share).translate(spaces) for share in shares} == shares


def test_confidence_is_that_of_the_diagnosis():
    assert sentences.confidence_sentence(dataclasses.replace(CASES["explained"](), probability=0.0)) == ""
    assert [names.sure(p) for p in (0.99, 0.9, 0.6, 0.1)] == [
        "practically certain",
        "very likely",
        "more likely than not",
        "little more than a guess",
    ]


@pytest.mark.parametrize(
    ("value", "low", "high", "shown", "interval"),
    [
        (20.3871, 20.31, 20.46, "20.387", "20.310 to 20.460"),
        (20.3871, 19.0, 22.0, "20.4", "19.0 to 22.0"),
        (2.0412e-4, 2.01e-4, 2.07e-4, "2.041×10⁻⁴", "2.010×10⁻⁴ to 2.070×10⁻⁴"),
        (-0.5, -3.0, 2.0, "−0.5", "−3.0 to 2.0"),
        (1286.0, 950.0, 1610.0, "1290", "950 to 1610"),
        (87677.0, -299023.0, 474377.0, "90000", "−300000 to 470000"),
        (0.0, -1e-3, 1e-3, "0.0000", "−0.0010 to 0.0010"),
        (3.14159, math.nan, math.nan, "3.142", ""),
    ],
)
def test_digits_are_those_that_the_interval_earns(value, low, high, shown, interval):
    value_shown, ends = digits.show_estimate(Estimate(value, low, high))
    assert (value_shown, " to ".join(ends or ())) == (shown, interval)


def test_a_parameter_at_its_bound_has_no_interval():
    pinned, bound = (
        FittedParameter("gap", 1e-3, deviation, "rad", verdict)
        for deviation, verdict in ((1e-5, "pinned"), (0.0, "at a bound"))
    )
    told = [derived_values.fixed(found) for found in (pinned, bound)]
    assert told[0].bounded
    assert told[0].high == pytest.approx(1e-3 + 1.645e-5)
    assert not told[1].bounded
    assert names.state_meaning("at a bound")
    assert names.state_meaning("traded off with viscous")


def test_what_changed_in_the_model_is_marked():
    nominal = '[plant]\ninertia = 0.05  # measured\n[friction]\ncoulomb = 0.40\nviscous = 0.03\nnote = "a # b"\n'
    corrected = '[plant]\ninertia = 5e-2\n[friction]\ncoulomb = 0.42\nnote = "a # b"\n\n[actuator]\ndelay = 0.004\n'
    lines, gone = model_text.compare(nominal, corrected)
    assert [line.change for line in lines] == ["", "", "", "changed", "", "", "added", "added"]
    assert lines[3].was == "0.40"
    assert gone == ["friction.viscous = 0.03"]
    assert model_text.count_changes(nominal, corrected) == 3
    assert not any(line.change for line in model_text.compare("", corrected)[0])


def test_defaults_that_became_visible_are_no_change():
    nominal = (
        '[units]\nmotion = "rotary"\n[plant]\ntype = "one_mass"\ninertia = 0.1\n'
        '[friction]\ntype = "coulomb_viscous"\ncoulomb = 0.4\nviscous = 0.03\n[simulation]\ndt = 0.001\n'
    )
    spelled_out = dump_model(load_model(nominal))
    assert "solver" in spelled_out
    assert model_text.count_changes(nominal, spelled_out) == 0
    changed = spelled_out.replace("inertia = 0.1", "inertia = 0.11")
    lines, gone = model_text.compare(nominal, changed)
    assert [(line.text.split()[0], line.was) for line in lines if line.change] == [("inertia", "0.1")]
    assert gone == []


def test_the_vocabulary_is_worded_completely():
    assert set(names.EFFECTS) == {effect.name for effect in EFFECTS} | {"velocity_quantisation"}
    assert len({w.name for w in names.EFFECTS.values()}) == len(names.EFFECTS)


def test_escaping_covers_attributes():
    assert markup.text("<a \"b\" 'c' &>") == "&lt;a &quot;b&quot; &#x27;c&#x27; &amp;&gt;"


def test_logs_of_the_same_hours_are_laid_end_to_end():
    full = CASES["explained"]()
    for count, label in ((1, "time [s]"), (2, "withheld time, logs end to end [s]")):
        figure = Figure()
        told = dataclasses.replace(full, comparisons=full.comparisons * count)
        record_picture.draw_record(figure, told, narrow=True)
        assert figure.axes[1].get_xlabel() == label


def test_a_frequency_bin_that_begins_at_zero_is_in_the_picture():
    edges = [0.0, 0.1, 1.0, 10.0, 100.0]
    bins = tuple(Share(a, b, share) for a, b, share in zip(edges[:-1], edges[1:], (0.7, 0.1, 0.1, 0.1), strict=True))
    full = CASES["bare"]()
    told = dataclasses.replace(full, where=Where(maps={"frequency": bins}, frequency=bins[:1]))
    figure = Figure()
    where_picture.draw_where(figure, told, narrow=True)
    axes = figure.axes[0]
    assert axes.get_xscale() == "log"
    assert 0.0 < axes.get_xlim()[0] < 0.1 / 2
    assert axes.get_ylim()[1] > 0.7


def test_a_companion_is_drawn_as_likely_as_the_table_has_it():
    full = CASES["explained"]()
    first, second, *rest = full.ranking
    pair = (first, dataclasses.replace(second, probability=0.0, cause_probability=0.83), *rest)
    figure = Figure()
    gap_picture.draw_ranking(figure, dataclasses.replace(full, ranking=pair))
    widths = [bar.get_width() for bar in figure.axes[0].patches]
    assert widths[:2] == pytest.approx([first.probability, 0.83])


def test_the_worst_place_is_where_the_nominal_model_is_most_wrong():
    series, first, last = record_picture.worst_place(record_picture.series_of(CASES["unexplained"]()))
    error = np.abs(series.commanded - series.before)
    assert first <= int(np.argmax(error)) <= last
    assert last - first < 0.3 * len(series.time)


def test_an_interval_that_nobody_knows_is_not_printed():
    full = CASES["explained"]()
    first, *rest = full.ranking
    bounded = Estimate(0.0, math.nan, math.nan, "s", at_bound=True)
    lost = dataclasses.replace(full, ranking=(dataclasses.replace(first, parameters={"delay": bounded}), *rest))
    assert "delay 0 s (at a bound)" in str(lost)
    assert "nan" not in str(lost)


def test_what_is_traded_off_is_not_called_unknown_where_its_interval_is_narrow():
    assert names.state_meaning("traded off with viscous", 0.3) == "only their combination is determined"
    assert "small error" in names.state_meaning("traded off with viscous", 1e-4)
    assert names.state_meaning("pinned", 1e-4) == "this log determines it"


def test_what_a_free_simulation_does_is_told_and_whether_fits_were_held():
    explained = CASES["explained"]()
    told = re.sub(r"\s", " ", sentences.replay_sentence(explained))
    assert "departs over 0.5 s by 34 % of the motion, the corrected model by 1 % of the motion" in told
    assert "a bandwidth of 1.6 Hz" in told
    free = dataclasses.replace(explained, free_replay=FreeReplay(7.2, 0.0121, 0.5, 0.0))
    told = sentences.replay_sentence(free)
    assert "by 7.2 times the motion" in told
    assert "held" not in told
    assert sentences.replay_sentence(dataclasses.replace(explained, free_replay=None)) == ""


def plain(told):
    """Text of a page or a sentence, with common spaces."""
    return html.unescape(re.sub(r"<[^>]*>", "", told)).replace("\u202f", " ")


def test_the_first_screen_tells_cause_share_closed_share_left_and_where():
    for name in ("explained", "partly_explained"):
        told = CASES[name]()
        head = plain(heading.header(told))
        assert "Stribeck friction" in head
        assert re.search(r"\d+ % is left", head), head
        assert "of the energy of the nominal model's gap lies" in head
        assert "perfect model" not in head


def test_a_cause_at_the_start_of_the_sentence_is_as_bold_as_any_other():
    head = heading.header(CASES["partly_explained"]())
    assert "<h1><strong>Stribeck friction</strong> explains" in head


def test_a_share_that_details_close_too_is_told_with_them():
    told = CASES["partly_explained"]()
    before, after = told.gap.before, told.gap.after
    cause, nan2 = 0.5 * (before + after), (math.nan, math.nan)
    steps = (Step("stribeck", cause, nan2), Step("presliding", after, nan2), Step("actuator_lag", after, nan2))
    sentence = sentences.verdict_sentence(dataclasses.replace(told, steps=steps))
    assert sentence.startswith("Stribeck friction, with presliding friction as a detail, explains")
    assert "lag" not in sentence  # it takes nothing away


def test_shares_of_what_moves_the_machine_are_told_apart_from_those_of_the_gap():
    told = dataclasses.replace(
        CASES["partly_explained"](), dominant_variable=DominantVariable("velocity", 0.94, 0.004, 0.81)
    )
    sentence = plain(dominant_sentence(told, show_percent))
    assert "a curve over velocity alone holds 94 % of that part's energy, and the cause holds 81 %." in sentence
    assert "count vibration too" in sentence
    assert dominant_sentence(CASES["explained"]()) == ""


def test_a_best_attempt_is_no_corrected_model_and_without_a_gap_nothing_was_corrected():
    free = FreeReplay(1.04, 0.2, 0.75, 2.4)
    attempt = dataclasses.replace(CASES["unexplained"](), free_replay=free)
    assert "the best attempt by 20 %" in plain(sentences.replay_sentence(attempt))
    assert "The best attempt as a model" in sections.model(attempt)
    assert "Closed by the best attempt" in heading.header(attempt)
    none = dataclasses.replace(CASES["no_gap"](), free_replay=free, tracking=CASES["explained"]().tracking)
    for sentence in (sentences.replay_sentence(none), sentences.tracking_sentence(none)):
        assert "nominal model" in sentence
        assert not re.search("correct|attempt", sentence)


def test_of_a_gap_below_the_noise_floor_no_share_is_closed():
    full = CASES["unexplained"]()
    hidden = dataclasses.replace(full, gap=dataclasses.replace(full.gap, before=0.0, closed=0.0))
    assert "is-closed" in heading.header(full)
    assert "is-closed" not in heading.header(hidden)


def test_gaps_of_a_log_in_amperes_are_in_amperes_everywhere():
    full = CASES["explained"]()
    told = dataclasses.replace(full, gap=dataclasses.replace(full.gap, unit="A", before=0.127, noise_floor=4.07e-4))
    assert derived_values.gap_scale(told) == (1e3, "mA")
    assert "0.407 mA" in plain(heading.header(told))
    figure = Figure()
    where_picture.draw_residual(figure, told, narrow=True)
    assert figure.axes[0].get_ylabel() == "commanded minus needed [A]"


def test_intervals_carry_their_unit():
    told = CASES["explained"]()
    assert re.search(r"90 % interval [\d.]+ to [\d.]+ mN·m", plain(heading.header(told)))
    two = dataclasses.replace(told, steps=told.steps * 2)
    assert re.search(r"[\d.]+ to [\d.]+ mN·m", plain(sections.shrink(two, {})))


def test_a_short_log_has_wider_bins_and_no_empty_panel():
    rng = np.random.default_rng(0)
    centres, *quantiles = where_picture.binned(np.linspace(0.0, 5.0, 200), rng.normal(size=200))
    assert len(centres) >= 8
    assert all(np.isfinite(each).all() for each in quantiles)
    assert len(where_picture.binned(np.linspace(0.0, 5.0, 6000), rng.normal(size=6000))[0]) >= 58


def test_the_line_of_an_even_spread_is_not_cut_and_the_rest_has_the_corrected_models_colour():
    edges = np.linspace(0.0, 1.0, 5)
    bins = tuple(
        Share(float(a), float(b), 0.1, expected)
        for a, b, expected in zip(edges[:-1], edges[1:], (0.25, 0.25, 0.25, 0.25), strict=True)
    )
    told = dataclasses.replace(
        CASES["bare"](), where=Where(maps={"velocity": bins}, velocity=bins[:1], regime={"reversal": 1.0})
    )
    colours = []
    for draw in (where_picture.draw_where, where_picture.draw_rest):
        figure = Figure()
        draw(figure, told, narrow=True)
        regime, velocity = figure.axes
        assert velocity.get_ylim()[1] > 0.25
        colours.append(tuple(regime.patches[0].get_facecolor()))
    assert colours[0] != colours[1]


def test_the_detection_level_of_the_gap_is_not_drawn_as_noise_of_the_samples():
    figure = Figure()
    record_picture.draw_record(figure, CASES["explained"](), narrow=True)
    labels = [label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]]
    assert not any("noise" in label for label in labels)


def test_what_is_pinned_within_an_interval_over_zero_is_said_to_be_perhaps_zero():
    assert names.state_meaning("pinned", 0.8) == "this log determines it; it may be zero"


def test_parameters_and_experiments_of_a_linear_axis_have_its_words():
    assert names.parameter_name("inertia", "linear") == "mass"
    assert names.parameter_name("torque", "linear") == "force"
    full = CASES["unexplained"]()
    asked = dataclasses.replace(full.next_experiment[0], do="A constant torque acts at rest.")
    assert "A constant force acts at rest." in sections.apart(dataclasses.replace(full, next_experiment=(asked,)))
