"""The report: self-contained, well formed, complete, safe with hostile names, and its numbers are the diagnosis'."""

import base64
import dataclasses
import functools
import hashlib
import html.parser
import json
import math
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from report_cases import CASES

from fpjax.errors import InputError
from fpjax.gap import EFFECTS, Estimate, Identifiability, Ranked, Share, Where
from fpjax.gap.report import (
    digits,
    draw_overview,
    markup,
    model_text,
    reading,
    record_picture,
    svg,
    text,
    where_picture,
    words,
    write_report,
)
from fpjax.model_file import dump_model, load_model

SECTIONS = ["record", "where", "ranking", "shrink", "apart", "identifiability", "model", "warnings", "provenance"]
PICTURES = {
    "explained": {"overview", "record", "where", "residual", "shrink"},
    "pair_with_twins": {"overview", "record", "where", "residual", "shrink"},
    "no_gap": {"overview", "record", "shrink"},
    "partly_explained": {"overview", "record", "where", "residual", "shrink", "left", "learned"},
    "unexplained": {"overview", "record", "where", "residual", "shrink", "left"},
    "bare": {"overview", "where", "shrink"},
}
EXAMPLE = """[plant]
type = "one_mass"
inertia = 0.05
[friction]
type = "coulomb_viscous"
coulomb = 0.4
viscous = 0.03
[controller]
type = "pi"
kp = 2.0
ki = 12.0
[reference]
type = "sine"
amplitude = 2.0
frequency = 1.0
[simulation]
dt = 1e-3
duration = 0.6
"""
VOID = {"meta", "br", "link", "img", "input", "hr"}


class Page(html.parser.HTMLParser):
    """Checks nesting while reading, and keeps what the tests ask for."""

    def __init__(self, source):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.ids, self.sections, self.text, self.data, self.wrong = [], [], [], [], [], [], []
        self.feed(source)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append((tag, attributes))
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if tag == "section":
            self.sections.append(attributes["id"])
        if tag == "data":
            self.data.append([attributes["value"], ""])
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1] == tag, f"</{tag}> closes <{self.open[-1]}>"
        self.open.pop()

    def handle_data(self, data):
        if "style" not in self.open and "script" not in self.open:
            self.text.append(data)
        if self.open and self.open[-1] == "data":
            self.data[-1][1] += data


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Each case's diagnosis, the path of its report, and the page: written once, for drawing takes seconds."""

    @functools.cache
    def write(name):
        diagnosis = CASES[name]()
        path = write_report(diagnosis, tmp_path_factory.mktemp("report") / "deep" / name)
        return name, diagnosis, path, path.read_text(encoding="utf-8")

    return write


@pytest.fixture(scope="module", params=CASES)
def report(request, written):
    """Every case, one after the other."""
    return written(request.param)


def test_page_is_well_formed_and_every_section_is_there_in_order(report):
    _, _, _, source = report
    page = Page(source)
    assert source.startswith("<!DOCTYPE html>")
    assert page.sections == SECTIONS
    assert len(page.ids) == len(set(page.ids)), "an identifier is used twice"
    targets = {a["href"][1:] for t, a in page.tags if t in ("a", "use") and a.get("href", "").startswith("#")}
    targets |= set(re.findall(r"url\(#([^)]+)\)", source))
    assert targets
    assert targets <= set(page.ids)


def test_page_loads_nothing_from_anywhere(report):
    _, _, _, source = report
    page = Page(source)
    loading = {"src", "href", "srcset", "action", "poster", "data", "xlink:href", "background", "ping"}
    addresses = [
        (tag, name, value) for tag, attributes in page.tags for name, value in attributes.items() if name in loading
    ]
    assert all(value.startswith(("#", "data:")) for _, _, value in addresses), addresses
    assert not {"link", "iframe", "object", "embed", "base"} & {tag for tag, _ in page.tags}
    assert not re.findall(r"@import|url\(\s*['\"]?(?!#)", source)
    without_namespace = source.replace("http://www.w3.org/2000/svg", "")  # a name, not an address
    assert "http://" not in without_namespace
    assert "https://" not in without_namespace


def scripts(source):
    """Every script's text."""
    return re.findall(r"<script[^>]*>(.*?)</script>", source, flags=re.DOTALL)


def test_one_script_runs_and_no_other_may(report):
    _, _, _, source = report
    page = Page(source)
    assert [attributes for tag, attributes in page.tags if tag == "script"] == [{}]
    (script,) = scripts(source)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = next(a["content"] for t, a in page.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy == f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"
    assert not re.search(r"fetch|XMLHttpRequest|import\(|eval|innerHTML|localStorage|cookie", script)


def test_every_panel_knows_where_it_lies_and_what_it_shows(report):
    """The numbers under the pointer: each panel's place within the picture, and its limits."""
    _, _, _, source = report
    for _, attributes in (found for found in Page(source).tags if found[0] == "svg"):
        _, _, width, height = map(float, attributes["viewbox"].split())
        panels = json.loads(attributes["data-axes"])
        assert panels
        for panel in panels:
            left, top, right, bottom = panel["box"]
            assert 0.0 <= left < right <= width
            assert 0.0 <= top < bottom <= height
            for side in set(panel) - {"box"}:
                first, last, low, high, log, label = panel[side]
                assert first < last if side == "x" else first > last
                assert low < high
                assert low > 0.0 or not log
                assert isinstance(label, str)


def test_page_reads_on_a_phone_in_the_dark_and_on_paper(report):
    _, _, _, source = report
    metas = [a for t, a in Page(source).tags if t == "meta"]
    assert any(m.get("name") == "viewport" and "width=device-width" in m["content"] for m in metas)
    assert any(m.get("charset") == "utf-8" for m in metas)
    assert "prefers-color-scheme:dark" in source
    assert "@media print" in source
    # both layouts of every picture, each with a description for those who cannot see it
    pictures = [a for t, a in Page(source).tags if t == "svg"]
    assert len(pictures) % 2 == 0
    assert all(a["role"] == "img" and a["aria-label"] for a in pictures)


def test_every_picture_is_beside_the_page(report):
    name, _, path, _ = report
    assert {p.stem for p in path.parent.glob("*.png")} == PICTURES[name]
    assert {p.name for p in path.parent.iterdir()} == {"report.html"} | {f"{p}.png" for p in PICTURES[name]}
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in path.parent.glob("*.png"))


def test_numbers_in_the_page_are_those_of_the_contract(report):
    _, diagnosis, _, source = report
    answer = json.loads(json.dumps(diagnosis.to_dict()))
    stated = {float(value) for value, _ in Page(source).data}
    wanted = [answer["gap"]["before"]]
    if answer["verdict"] != "no_gap":
        wanted += [answer["gap"]["after"], answer["gap"]["closed"], *(s["gap_after"] for s in answer["steps"][1:])]
    wanted.append(answer["gap"]["noise_floor"])
    wanted += [answer["gap"]["learned"], *(law["share"] for law in answer["learned"])]
    for entry in answer["ranking"]:
        wanted += [entry["probability"], entry["gap_after"]]
        wanted += [p[k] for p in entry["parameters"].values() for k in ("value", "low", "high")]
    missing = [number for number in wanted if math.isfinite(number) and number not in stated]
    assert not missing


def test_what_is_shown_is_the_number_rounded(report):
    _, _, _, source = report
    for exact, shown in Page(source).data:
        assert shown, exact
        value = float(exact)
        if "<" in shown:
            assert value < 1e-3, (exact, shown)
            continue
        number = shown.replace("−", "-")
        exponent = 0
        if "×10" in number:
            number, _, power = number.partition("×10")
            exponent = int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
        percent = "%" in number
        number = number.replace("\u202f", "").replace("%", "")
        step = 10.0 ** -len(number.partition(".")[2])
        # in per cent, or in the unit with a prefix: one of these factors, and never off by more than half a last digit
        factors = [100.0] if percent else [1.0, 1e3, 1e6]
        near = [abs(float(number) - factor * value / 10.0**exponent) <= 0.5001 * step for factor in factors]
        almost_all = percent and 0.995 <= value < 1.0 and number == "99.9"
        assert any(near) or almost_all, (exact, shown)


def test_verdicts_have_fitting_sentences():
    told = {name: make() for name, make in CASES.items()}
    sentences = {name: text.verdict_sentence(told[name]) for name in told}
    assert sentences["explained"].startswith("The simulation lacks Stribeck friction; with that put right")
    assert "cannot tell which" in sentences["pair_with_twins"]
    assert "a constant torque or asymmetric friction" in sentences["pair_with_twins"]
    assert "agrees" in sentences["no_gap"]
    assert "no effect of the vocabulary closes" in sentences["unexplained"]
    assert re.search(r"misses [\d.]+\u202fN rms of force", sentences["unexplained"])
    assert text.confidence_sentence(told["explained"]).replace("\u202f", " ") == "Very likely (96 %)."
    assert all(sentence.count(".\n") == 0 and sentence.endswith(".") for sentence in sentences.values())
    one_open = dataclasses.replace(told["pair_with_twins"], causes=("constant_torque", "backlash"))
    assert "asymmetric friction (this log cannot tell which), and backlash; with both" in text.verdict_sentence(
        one_open
    )
    partly = text.verdict_sentence(told["partly_explained"]).replace("\u202f", " ")
    assert re.match(r"Stribeck friction explains \d+ % of the missing torque; \d+ % is left \(", partly)
    assert not re.search(r"not|fail|but|only", partly)
    wrong = dataclasses.replace(told["explained"], causes=("inertia_error",))
    assert text.verdict_sentence(wrong).startswith("The simulation has a wrong inertia;")
    linear = dataclasses.replace(wrong, motion="linear")
    assert text.verdict_sentence(linear).startswith("The simulation has a wrong mass;")


def test_a_linear_axis_is_told_in_its_own_words(written):
    _, _, _, source = written("unexplained")
    shown = "".join(Page(source).text)
    assert "commanded less needed [N]" in shown
    assert "velocity [m/s]" in shown
    assert "near the force limit" in shown
    assert "rad/s" not in shown
    assert "torque" not in shown
    assert shown.count("at the end of what was allowed") == 1


def test_what_was_learned_is_told_beside_the_effects_and_never_as_one(written):
    _, diagnosis, _, source = written("partly_explained")
    shown = "".join(Page(source).text).replace("\u202f", " ")
    assert "Learned law of velocity" in shown
    assert "30 % follows the velocity and 70 % nothing that was recorded" in shown
    assert "measured, not a named effect" in shown
    assert all(entry.effect in {effect.name for effect in EFFECTS} for entry in diagnosis.ranking)
    assert 'download="learned.toml"' in source
    rows = text.learned_name(diagnosis), text.learned_sentence(diagnosis)
    assert rows[0] == "learned law of velocity"
    two = dataclasses.replace(diagnosis, learned=diagnosis.learned * 2)
    assert text.learned_name(two).startswith("learned laws of")


def test_a_model_is_said_to_run_only_where_it_does(written):
    """`fpjax simulate ... take this file` stands there only where reading the file back has shown it."""
    complete = dump_model(load_model(EXAMPLE))
    assert "simulate and fpjax tune take" in model_text.use_sentence(complete)
    for missing, word in (("[reference]", "reference"), ("[controller]", "unknown")):
        start = complete.index(missing)
        cut = complete[:start] + complete[complete.find("\n[", start) + 1 :]
        told = model_text.use_sentence(cut + '[controller]\ntype = "unknown"\n' if word == "unknown" else cut)
        assert "take this file" not in told
        assert word in told
    for name in ("explained", "partly_explained"):
        assert "take this file" not in "".join(Page(written(name)[3]).text)  # no controller, no reference


def test_classes_are_named_with_what_would_split_them(written):
    _, diagnosis, _, source = written("pair_with_twins")
    shown = "".join(Page(source).text)
    assert reading.classes(diagnosis) == [
        ("constant_torque", "asymmetric_friction"),
        ("actuator_delay", "velocity_delay"),
    ]
    assert all(experiment.do in shown for experiment in diagnosis.next_experiment)
    assert all(warning in shown for warning in diagnosis.warnings)


def test_hostile_names_are_only_text(tmp_path):
    bad = "<script>alert(1)</script>\"'&$x_{1$-->]]><b onmouseover=evil>"
    diagnosis = CASES["pair_with_twins"]()
    first = dataclasses.replace(
        diagnosis.ranking[0], effect=bad, parameters={bad: Estimate(1.0, 0.9, 1.1, bad)}, indistinguishable_from=(bad,)
    )
    comparison = dataclasses.replace(diagnosis.comparisons[0], name=bad)
    diagnosis = dataclasses.replace(
        diagnosis,
        causes=(bad,),
        ranking=(first, *diagnosis.ranking[1:]),
        steps=(dataclasses.replace(diagnosis.steps[0], added=bad),),
        next_experiment=(dataclasses.replace(diagnosis.next_experiment[0], separates=(bad, bad), do=bad),),
        warnings=(bad,),
        model=f"[{bad}]\n{bad} = {bad}\n",
        comparisons=(comparison, dataclasses.replace(comparison, name=bad + "2")),
        identifiability=(dataclasses.replace(diagnosis.identifiability[0], parameter=bad, verdict=bad, unit=bad),),
        seconds={bad: 1.0},
        gap=dataclasses.replace(diagnosis.gap, unit=bad),
        where=dataclasses.replace(diagnosis.where, regime={bad: 1.0}),
        provenance={
            "command": bad,
            "started": bad,
            "inputs": [{"name": bad, "role": bad, "sha256": bad}],
            "versions": {bad: bad},
        },
    )
    source = write_report(diagnosis, tmp_path).read_text(encoding="utf-8")
    page = Page(source)
    assert len(scripts(source)) == 1
    assert "alert" not in scripts(source)[0]
    assert not [a for _, a in page.tags if any(name.startswith("on") for name in a)]
    assert page.sections == SECTIONS
    assert bad in "".join(page.text)


def test_the_same_diagnosis_gives_the_same_bytes(tmp_path):
    diagnosis = CASES["bare"]()
    first, second = (write_report(diagnosis, tmp_path / name) for name in "ab")
    assert first.read_bytes() == second.read_bytes()
    assert (tmp_path / "a" / "where.png").read_bytes() == (tmp_path / "b" / "where.png").read_bytes()


def test_hooks_of_the_diagnosis(tmp_path):
    diagnosis = CASES["bare"]()
    assert diagnosis.report(tmp_path / "out") == tmp_path / "out" / "report.html"
    assert svg.to_png(diagnosis.plot()).startswith(b"\x89PNG")
    nothing = dataclasses.replace(diagnosis, where=Where(), gap=dataclasses.replace(diagnosis.gap, before=math.nan))
    assert svg.to_png(draw_overview(nothing)).startswith(b"\x89PNG")


def test_a_folder_that_cannot_be_made_is_said_in_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_report(CASES["bare"](), tmp_path / "file" / "out")


def test_an_unknown_verdict_is_refused(tmp_path):
    with pytest.raises(InputError, match="maybe"):
        write_report(dataclasses.replace(CASES["bare"](), verdict="maybe"), tmp_path)


def test_missing_pieces_are_left_out_and_not_invented(tmp_path):
    full = CASES["explained"]()
    unknown = np.full(len(full.comparisons[0].time), np.nan)
    awkward = dataclasses.replace(
        full,
        ranking=(Ranked("stribeck", math.nan, math.nan, {}), Ranked("a_users_own_effect", 0.2, 0.01, {})),
        comparisons=(dataclasses.replace(full.comparisons[0], after=unknown),),
        where=dataclasses.replace(full.where, residual=None, maps={}, regime={}, time=(Share(1.0, 1.0, math.nan),)),
        identifiability=(),
        steps=(),
        tracking=None,
    )
    page = Page(write_report(awkward, tmp_path).read_text(encoding="utf-8"))
    shown = "".join(page.text)
    assert "A users own effect" in shown
    assert "nan" not in re.findall(r"[a-z]+", shown.lower())
    assert not {value for value, _ in page.data} & {"nan", "inf"}


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


def test_the_worst_place_is_where_the_nominal_model_is_most_wrong():
    series, first, last = record_picture.worst_place(record_picture.series_of(CASES["unexplained"]()))
    error = np.abs(series.commanded - series.before)
    assert first <= int(np.argmax(error)) <= last
    assert last - first < 0.3 * len(series.time)


@pytest.mark.parametrize(
    ("value", "low", "high", "shown", "interval"),
    [
        (20.3871, 20.31, 20.46, "20.387", "20.310 to 20.460"),
        (20.3871, 19.0, 22.0, "20.4", "19.0 to 22.0"),
        (2.0412e-4, 2.01e-4, 2.07e-4, "2.041×10⁻⁴", "2.010×10⁻⁴ to 2.070×10⁻⁴"),
        (-0.5, -3.0, 2.0, "−0.5", "−3.0 to 2.0"),
        (1286.0, 950.0, 1610.0, "1286", "950 to 1610"),
        (0.0, -1e-3, 1e-3, "0.0000", "−0.0010 to 0.0010"),
        (3.14159, math.nan, math.nan, "3.142", ""),
    ],
)
def test_digits_are_those_that_the_interval_earns(value, low, high, shown, interval):
    assert digits.show_estimate(Estimate(value, low, high)) == (shown, interval)


def test_units_and_shares_are_spelled_for_people():
    assert digits.show_unit("N m s^2/rad^2") == "N·m·s²/rad²"
    assert digits.show_unit("kg m^2") == "kg·m²"
    assert digits.show_unit("1") == ""
    assert digits.scale_for(0.00402, "s") == (1e3, "ms")
    assert digits.scale_for(3e-5, "rad") == (1e6, "µrad")
    assert digits.scale_for(3e-5, "kg m^2") == (1.0, "kg m^2")
    spaces = str.maketrans({"\u202f": " "})
    shares = {0.9996: "99.9 %", 1.0: "100 %", 0.0: "0 %", 0.0004: "< 0.1 %", 0.004: "0.4 %", 0.5: "50 %", -0.04: "−4 %"}
    assert {share: digits.show_percent(share).translate(spaces) for share in shares} == shares


def test_confidence_is_that_of_the_diagnosis():
    assert text.confidence_sentence(dataclasses.replace(CASES["explained"](), probability=0.0)) == ""
    assert [words.sure(p) for p in (0.99, 0.9, 0.6, 0.1)] == [
        "practically certain",
        "very likely",
        "more likely than not",
        "little more than a guess",
    ]


def test_a_parameter_at_its_bound_has_no_interval():
    pinned, bound = (
        Identifiability("gap", 1e-3, deviation, "rad", verdict)
        for deviation, verdict in ((1e-5, "pinned"), (0.0, "at a bound"))
    )
    told = [reading.fixed(found) for found in (pinned, bound)]
    assert told[0].bounded
    assert told[0].high == pytest.approx(1e-3 + 1.645e-5)
    assert not told[1].bounded
    assert words.state_meaning("at a bound")
    assert words.state_meaning("traded off with viscous")


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
    assert set(words.EFFECTS) == {effect.name for effect in EFFECTS} | {"velocity_quantisation"}
    assert len({w.name for w in words.EFFECTS.values()}) == len(words.EFFECTS)


def test_escaping_covers_attributes():
    assert markup.text("<a \"b\" 'c' &>") == "&lt;a &quot;b&quot; &#x27;c&#x27; &amp;&gt;"
