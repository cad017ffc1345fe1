"""The report: self-contained, well formed, complete, safe with hostile names, and its numbers are the diagnosis'."""

import base64
import dataclasses
import functools
import hashlib
import json
import math
import re

import numpy as np
import pytest
from model_files import SMALL_SERVO
from report_cases import CASES
from report_page import SECTIONS, Page, scripts

from fpjax import InputError, dump_model, load_model
from fpjax.gap import EFFECTS, Estimate, Ranked, Share, Where
from fpjax.gap.report import (
    derived_values,
    draw_overview,
    model_text,
    sentences,
    svg,
    write_report,
)

PICTURES = {
    "explained": {"overview", "record", "where", "residual", "shrink"},
    "pair_with_twins": {"overview", "record", "where", "residual", "shrink"},
    "no_gap": {"overview", "record", "shrink"},
    "partly_explained": {"overview", "record", "where", "residual", "shrink", "left", "learned"},
    "unexplained": {"overview", "record", "where", "residual", "shrink", "left"},
    "bare": {"overview", "where", "shrink"},
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Each case's diagnosis, the path of its report, and the page: written once, for drawing takes seconds."""

    @functools.cache
    def write(name):
        diagnosis = CASES[name]()
        path = write_report(diagnosis, tmp_path_factory.mktemp("report") / "deep" / name)
        return name, diagnosis, path, path.read_text(encoding="utf-8")

    return write


# Drawing a page takes 3 to 7 s of processor time. These hold every section and picture, and all verdicts but
# "explained", whose page `test_diagnose` writes, and "unexplained"; the sentences of all are in `test_report_words`.
DRAWN = ("no_gap", "partly_explained", "bare")


@pytest.fixture(
    scope="module", params=[name if name in DRAWN else pytest.param(name, marks=pytest.mark.long) for name in CASES]
)
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


def test_a_picture_of_an_earlier_report_does_not_stay_beside_the_page(tmp_path):
    for name in ("left.png", "learned.png", "mine.png"):
        (tmp_path / name).write_bytes(b"earlier")
    CASES["bare"]().report(tmp_path)  # beside no report they are the user's own
    assert {path.stem for path in tmp_path.glob("*.png")} == PICTURES["bare"] | {"left", "learned", "mine"}
    CASES["bare"]().report(tmp_path)
    assert {path.stem for path in tmp_path.glob("*.png")} == PICTURES["bare"] | {"mine"}


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
        whole = number.partition(".")[0].lstrip("-")
        # 1290 of 1286: zeros left of the point may be rounded ones
        rounded = len(whole) - len(whole.rstrip("0")) if "." not in number and whole.strip("0") else 0
        step = 10.0 ** (rounded - len(number.partition(".")[2]))
        # in per cent, or in the unit with a prefix: one of these factors, and never off by more than half a last digit
        factors = [100.0] if percent else [1.0, 1e3, 1e6]
        near = [abs(float(number) - factor * value / 10.0**exponent) <= 0.5001 * step for factor in factors]
        almost_all = percent and 0.995 <= value < 1.0 and number == "99.9"
        assert any(near) or almost_all, (exact, shown)


@pytest.mark.long  # draws that page
def test_a_linear_axis_is_told_in_its_own_words(written):
    _, _, _, source = written("unexplained")
    shown = "".join(Page(source).text)
    assert "commanded minus needed [N]" in shown
    assert "velocity [m/s]" in shown
    assert "at the largest forces" in shown
    assert "rad/s" not in shown
    assert "torque" not in shown
    assert source.count("<small>at a bound of the search: not a measurement</small>") == 1


def test_what_was_learned_is_told_beside_the_effects_and_never_as_one(written):
    _, diagnosis, _, source = written("partly_explained")
    shown = "".join(Page(source).text).replace("\u202f", " ")
    assert "Learned law of velocity" in shown
    assert "30 % follows the velocity and 70 % follows no recorded signal" in shown
    assert "measured, not a named effect" in shown
    assert all(entry.effect in {effect.name for effect in EFFECTS} for entry in diagnosis.ranking)
    assert 'download="learned.toml"' in source
    rows = sentences.learned_name(diagnosis), sentences.learned_sentence(diagnosis)
    assert rows[0] == "learned law of velocity"
    two = dataclasses.replace(diagnosis, learned=diagnosis.learned * 2)
    assert sentences.learned_name(two).startswith("learned laws of")


def test_a_model_is_said_to_run_only_where_it_does(written):
    """`fpjax simulate ... take this file` stands there only where reading the file back has shown it."""
    complete = dump_model(load_model(SMALL_SERVO))
    assert "simulate and fpjax tune take" in model_text.use_sentence(complete)
    for missing, word in (("[reference]", "reference"), ("[controller]", "unknown")):
        start = complete.index(missing)
        cut = complete[:start] + complete[complete.find("\n[", start) + 1 :]
        told = model_text.use_sentence(cut + '[controller]\ntype = "unknown"\n' if word == "unknown" else cut)
        assert "take this file" not in told
        assert word in told
    # no controller, no reference
    assert "take this file" not in "".join(Page(written("partly_explained")[3]).text)


def test_causes_that_look_alike_are_classes():
    assert derived_values.classes(CASES["pair_with_twins"]()) == [
        ("constant_torque", "asymmetric_friction"),
        ("actuator_delay", "velocity_delay"),
    ]


def test_warnings_and_what_would_split_the_causes_are_in_the_page(report):
    _, diagnosis, _, source = report
    shown = "".join(Page(source).text)
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
