"""A whole diagnosis, from a log to what is said of it."""

import dataclasses
import functools
import hashlib
import json
import time

import jax
import numpy as np
import numpy_machine
import pytest
from model_files import SMALL_BODY

import fpjax.gap
from fpjax import CoulombViscous, InputError, OneMass, diagnose, load_model
from fpjax.cli import main
from fpjax.gap import EFFECTS
from fpjax.gap.answer.tracking import Side, made_torque, tracking_error
from fpjax.gap.data.record import make_records
from fpjax.gap.machine import nominal_machine
from fpjax.gap.verb import allowed_effects
from fpjax.output.runfile import plain
from fpjax.simulation.precision import double_precision

MODEL = (
    SMALL_BODY
    + """
[controller]
type = "pi"
kp = 3.03  # 3 + ki dt: the log's own loop adds the error to its integral before it uses that
ki = 30.0
[simulation]
dt = 1e-3
stepping = "sampled"
"""
)
TORQUE = 0.12  # N m, added to the plant; the model knows nothing of it
TRIED = tuple(e for e in EFFECTS if e.name in ("constant_torque", "asymmetric_friction", "velocity_bias"))


@pytest.fixture(scope="module")
def log():
    """Four seconds with a constant torque."""
    return numpy_machine.record(seconds=4.0, extra=lambda *at: TORQUE)


@pytest.fixture(scope="module")
def found(log, tmp_path_factory):
    """(the diagnosis with three effects allowed, the time it took [s], stages reported, the log's path)."""
    path = tmp_path_factory.mktemp("log") / "axis.csv"
    columns = log.columns()
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    stages: list[tuple[str, float]] = []
    began = time.perf_counter()
    diagnosis = diagnose(path, MODEL, effects=TRIED, progress=lambda *at: stages.append(at))
    return diagnosis, time.perf_counter() - began, stages, path


@pytest.fixture(scope="module")
def pushed():
    """A diagnosis of a machine that something pushes twice, two effects allowed."""
    log = numpy_machine.record(
        seconds=4.0, dt=2e-3, extra=lambda time, *at: 0.5 if 1.2 < time < 1.5 or 3.0 < time < 3.2 else 0.0
    )
    names = ("constant_torque", "quadratic_drag")
    return diagnose(log, MODEL, effects=tuple(effect for effect in EFFECTS if effect.name in names))


def make_record(log):
    return make_records([log], [], 0.05)[0]


def test_the_cause_its_value_and_the_gap(found):
    diagnosis, *_ = found
    assert diagnosis.verdict == "explained"
    assert diagnosis.causes == ("constant_torque",)
    first = diagnosis.ranking[0]
    torque = first.parameters["torque"]
    assert torque.low < TORQUE < torque.high
    assert torque.value == pytest.approx(TORQUE, rel=0.02)
    assert first.indistinguishable_from == ("asymmetric_friction",)
    assert diagnosis.to_dict()["gap"]["signal"] == "torque"
    assert diagnosis.gap.before == pytest.approx(TORQUE, rel=0.1)
    low, high = diagnosis.gap.before_interval
    assert low < diagnosis.gap.before < high
    assert diagnosis.gap.after < 0.1 * diagnosis.gap.before
    assert diagnosis.gap.closed > 0.95
    assert [step.added for step in diagnosis.steps] == ["constant_torque"]
    assert diagnosis.steps[0].gap_after == diagnosis.gap.after
    assert load_model(diagnosis.model).loop.plant.inertia == pytest.approx(0.05, rel=0.01)
    assert any("constant_torque" in sentence for sentence in diagnosis.same_as)


def test_probabilities_are_shared_and_sum_to_at_most_one(found):
    diagnosis, *_ = found
    shares = {entry.effect: entry.probability for entry in diagnosis.ranking}
    assert shares["constant_torque"] == pytest.approx(shares["asymmetric_friction"])
    assert sum(shares.values()) <= 1.0
    assert diagnosis.probability == pytest.approx(shares["constant_torque"] + shares["asymmetric_friction"], abs=1e-3)


def test_seconds_are_those_of_each_stage(found):
    diagnosis, took, stages, _ = found
    assert list(diagnosis.seconds) == [name for name in dict.fromkeys(name for name, _ in stages) if name != "done"]
    assert all(spent >= 0.0 for spent in diagnosis.seconds.values())
    assert 0.9 * took < sum(diagnosis.seconds.values()) <= took
    shares = [share for _, share in stages]
    assert shares == sorted(shares)
    assert stages[-1] == ("done", 1.0)


def test_it_says_what_it_was_made_from(found):
    diagnosis, _, _, path = found
    made = diagnosis.provenance
    assert set(made["inputs"][-1]["machine"]) == {"form", "values"}
    log, model = made["inputs"]
    assert log["name"] == "axis.csv"
    assert log["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert model["sha256"] == hashlib.sha256(MODEL.encode()).hexdigest()
    assert (log["samples"], log["role"], model["role"]) == (4000, "fitted", "model")
    assert log["windows_fitted"] + log["windows_withheld"] == made["windows"]["fitted"] + made["windows"]["withheld"]
    assert min(log["windows_fitted"], log["windows_withheld"]) >= 2
    assert {"fpjax", "jax", "numpy", "python"} <= set(made["versions"])
    assert made["arguments"]["effects"] == list(diagnosis.allowed)
    assert sorted(diagnosis.allowed) == sorted(effect.name for effect in TRIED)
    answer = json.loads(json.dumps(diagnosis.to_dict()))
    assert answer["ahead"] == diagnosis.ahead <= 1.0
    assert answer["provenance"] == made
    assert answer["tracking"]["measured"] == diagnosis.tracking.measured
    free = answer["free_replay"]
    assert free["after"] < 0.1 * free["before"]


def test_the_closed_loop_around_the_corrected_machine_tracks_as_the_log_does(found):
    diagnosis, *_ = found
    tracking = diagnosis.tracking
    assert tracking.signal == "velocity"
    assert tracking.controller_error < 1e-3
    assert tracking.after == pytest.approx(tracking.measured, rel=2e-3)
    assert f"{tracking.after:.4g}" in str(diagnosis)


def test_the_report_shows_all_of_it(found, tmp_path):
    diagnosis, *_ = found
    source = diagnosis.report(tmp_path).read_text(encoding="utf-8")
    for word in (diagnosis.provenance["inputs"][0]["sha256"], "Closed-loop tracking error", "Effects tried", "Windows"):
        assert word in source
    assert str(diagnosis.provenance["versions"]["jax"]) in source


def test_a_controller_that_did_not_make_the_torque_predicts_nothing(log):
    record = make_record(log)
    share, _ = made_torque(load_model(MODEL), record)
    assert share < 1e-3
    share, _ = made_torque(load_model(MODEL.replace("kp = 3.03 ", "kp = 6.0 ")), record)
    assert share > 0.1
    # the integral gets its start from the log, whatever it was
    share, start = made_torque(load_model(MODEL), make_record(dataclasses.replace(log, torque=log.torque + 0.2)))
    assert share < 1e-3
    assert float(start[0]) == pytest.approx(0.2, abs=0.01)
    record = make_record(dataclasses.replace(log, torque=log.torque + 0.3 * np.sign(log.reference)))
    share, _ = made_torque(load_model(MODEL), record)
    assert share > 0.1


def test_the_tracking_error_is_that_of_the_machine_simulated():
    log = numpy_machine.record(numpy_machine.Machine(coulomb=0.9), seconds=8.0)
    model, record = load_model(MODEL), make_record(log)
    with double_precision():
        sides = [Side(nominal_machine(OneMass(0.05, CoulombViscous(level, 0.03)), None, None)) for level in (0.4, 0.9)]
    warnings = []
    found = tracking_error(model, [record], *sides, warnings)
    assert warnings == []
    assert found.after == pytest.approx(found.measured, rel=2e-3)
    assert abs(found.before / found.measured - 1.0) > 0.05
    before, _, after = MODEL.partition('type = "pi"')
    unknown = load_model(before + 'type = "unknown"\n' + after[after.index("[simulation]") :])
    assert tracking_error(unknown, [record], *sides, warnings) is None
    assert tracking_error(model, [make_record(dataclasses.replace(log, reference=None))], *sides, warnings) is None
    assert warnings == []
    other = load_model(MODEL.replace("kp = 3.03 ", "kp = 6.0 "))
    assert tracking_error(other, [record], *sides, warnings) is None
    assert "do not give the torque" in warnings[0]


def test_the_missing_torque_is_what_acted(found):
    diagnosis, *_ = found
    (compared,) = diagnosis.comparisons
    missing = (compared.before - compared.torque)[np.isfinite(compared.before)]
    # the filter takes off what might be noise, so it falls a little short
    assert 0.8 * TORQUE < np.median(missing) < 1.05 * TORQUE
    left = (compared.after - compared.torque)[np.isfinite(compared.after)]
    assert np.sqrt(np.mean(left**2)) < 0.2 * TORQUE


@pytest.mark.long
def test_pushes_that_nobody_recorded_are_located_and_not_explained_away(pushed):
    assert pushed.verdict == "unexplained"
    assert pushed.causes == ()
    assert max(entry.probability for entry in pushed.ranking) < 0.2
    assert "none of the 2 effects" in str(pushed)
    inside = sum(
        share.share
        for share in pushed.where.time
        if max(share.start, 1.0) < min(share.stop, 1.7) or max(share.start, 2.8) < min(share.stop, 3.4)
    )
    assert inside > 0.7
    assert sum(share.share for share in pushed.where.time) < inside + 0.1
    assert pushed.residual_where is not None
    assert 0.9 < sum(pushed.where.regime.values()) < 1.001


def told_numbers(diagnosis):
    """`diagnosis.json` without what differs from run to run."""
    answer = json.loads(json.dumps(plain(diagnosis.to_dict())))
    return {name: part for name, part in answer.items() if name not in ("seconds", "provenance")}


@pytest.mark.long
def test_report_and_json_hold_the_same_numbers(pushed, found, tmp_path):
    for diagnosis in (pushed, found[0]):
        answer, gap = told_numbers(diagnosis), diagnosis.gap
        assert answer["gap"]["closed"] == pytest.approx(
            min((gap.before - gap.after) / (gap.before - gap.noise_floor), 1.0)
        )
        source = diagnosis.report(tmp_path).read_text(encoding="utf-8")
        for name in ("before", "after", "noise_floor"):
            assert f"{answer['gap'][name]:.4g}" in str(diagnosis)
            assert f'value="{answer["gap"][name]!r}"' in source
            assert all(
                f'value="{end!r}"' in source for end in answer["gap"]["interval"][name] if end != gap.noise_floor
            )


@pytest.fixture
def few_effects(monkeypatch):
    """The command line, with three effects in place of all: whole diagnoses in seconds."""
    monkeypatch.setattr(fpjax.gap, "diagnose", functools.partial(diagnose, effects=TRIED))


@pytest.mark.long
def test_the_command_line_and_python_agree_to_the_last_digit(found, few_effects, tmp_path, capsys):
    diagnosis, *_, path = found
    (tmp_path / "servo.toml").write_text(MODEL)
    words = [
        "diagnose",
        str(path),
        "--model",
        str(tmp_path / "servo.toml"),
        "--out",
        str(tmp_path / "why"),
        "--no-cache",
    ]
    assert main([*words, "--no-report"]) == 0
    assert json.loads((tmp_path / "why" / "diagnosis.json").read_text()).items() >= told_numbers(diagnosis).items()
    assert (tmp_path / "why" / "corrected.toml").read_text() == diagnosis.model
    assert str(diagnosis) in capsys.readouterr().out


@pytest.mark.long
def test_the_precision_of_the_process_changes_nothing(found, log):
    """Python is in single precision unless told otherwise, the command line in double."""
    with jax.enable_x64(False):
        assert told_numbers(diagnose(found[3], MODEL, effects=TRIED)) == told_numbers(found[0])


def test_a_log_that_is_too_short_is_said_in_one_sentence(log):
    short = {name: column[:100] for name, column in log.columns().items()}
    with pytest.raises(InputError, match="too few"):
        diagnose(dataclasses.replace(log, **short), MODEL)


def test_an_empty_vocabulary_is_refused_and_a_larger_one_is_not_restricted():
    with pytest.raises(InputError, match="effects is empty"):
        allowed_effects(())
    own = dataclasses.replace(EFFECTS[0], name="mine")
    assert allowed_effects((*EFFECTS, own)) == ()
    assert allowed_effects((own,)) == ("mine",)
