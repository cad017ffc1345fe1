"""The posterior of a diagnosis: drawn, written, read again."""

import dataclasses
import json
from types import SimpleNamespace

import equinox as eqx
import improve_case as case
import numpy as np
import pytest

import fpjax as fp
from fpjax.gap import EFFECTS
from fpjax.gap.answer.posterior import FILE, left_open, load_posterior
from fpjax.gap.answer.provenance import _machine, columns_hash, refuse_other_log, refuse_other_machine
from fpjax.improvement.from_diagnosis import _in_another_unit, known_in
from fpjax.improvement.machines import records_of
from fpjax.simulation.precision import double_precision


def test_draws_have_the_covariance_and_stay_within_the_bounds():
    posterior = case.known().posterior
    covariance = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, 0.0], [0.0, 0.0, 1e-4]]) * 1e-4
    posterior = dataclasses.replace(posterior, covariance=covariance)
    vectors, _ = posterior.draw(20_000, 0)
    assert vectors[:, 0] == pytest.approx(posterior.values)
    assert np.cov(vectors) == pytest.approx(covariance, abs=4e-6)
    wide = dataclasses.replace(posterior, covariance=np.diag(posterior.values**2) * 100.0)
    vectors, _ = wide.draw(200, 0)
    assert np.all(vectors >= posterior.low[:, None])
    assert np.all(vectors <= posterior.high[:, None])


def test_machines_have_the_drawn_values():
    posterior = dataclasses.replace(case.known().posterior, sensor={"lag": (1e-3, 5e-4)}, step=0.01)
    machine = posterior.machines(case.model(), records_of(case.log(), case.model()), 5, seed=4)
    vectors, sensor = posterior.draw(5, 4)
    assert np.asarray(machine.plant.inertia) == pytest.approx(vectors[0])
    assert np.asarray(machine.law.coulomb) == pytest.approx(vectors[1])
    assert np.asarray(machine.sensor.lag) == pytest.approx(sensor["lag"])
    assert np.all(sensor["lag"] >= 0.0)
    assert np.asarray(machine.sensor.step_size) == pytest.approx(0.01)


@pytest.mark.parametrize("content", [b"", b"no zip", b"PK\x03\x04" + b"x" * 60])
def test_a_damaged_posterior_is_one_sentence(tmp_path, content):
    (tmp_path / "posterior.npz").write_bytes(content)
    with pytest.raises(fp.InputError, match="not a posterior of this version"):
        load_posterior(tmp_path / "posterior.npz")


def test_a_posterior_is_the_same_after_writing(tmp_path):
    rival = dataclasses.replace(
        case.known(missing=0.05).posterior, key=("bristles", ("shape",)), gap=0.05, causes=("a",)
    )
    posterior = dataclasses.replace(
        case.known(missing=0.1).posterior, sensor={"bias": (0.1, 0.01)}, gap=0.1, rivals=((0.3, rival), (0.1, rival))
    )
    posterior.save(tmp_path / "posterior.npz")
    again = load_posterior(tmp_path / "posterior.npz")
    assert [share for share, _ in again.rivals] == [0.3, 0.1]
    pairs = [(posterior, again), *((rival, other) for _, other in again.rivals)]
    for before, after in pairs:
        for field in dataclasses.fields(before):
            old, new = getattr(before, field.name), getattr(after, field.name)
            if field.name == "rivals":
                continue
            if field.name == "missing":
                old, new = old[0], new[0]
            assert np.array_equal(old, new) if isinstance(old, np.ndarray) else old == new, field.name


def folder_of(tmp_path, **changes):
    known = case.known()
    known.posterior.save(tmp_path / "posterior.npz")
    inputs = [{"role": "fitted", "name": "made.csv", "sha256": "abc"}]
    content = {
        "verdict": "explained", "causes": ["coulomb_error"], "gap": {"after": 0.01}, "model": case.corrected(),
        "provenance": {"inputs": inputs}, "tracking": {"measured": 1.0}, "learned": [],
    }  # fmt: skip
    (tmp_path / "diagnosis.json").write_text(json.dumps(content | changes))
    return tmp_path


def test_a_finished_diagnosis_is_taken_from_its_folder(tmp_path):
    known = known_in(folder_of(tmp_path), case.log())
    assert known.verdict == "explained"
    assert known.made
    assert known.posterior.free == ("inertia", "coulomb", "viscous")


@pytest.mark.parametrize("broken", ["missing", "text", "keys", "posterior"])
def test_a_folder_that_is_no_diagnosis_is_refused_in_one_sentence(tmp_path, broken):
    folder_of(tmp_path)
    if broken == "missing":
        (tmp_path / "diagnosis.json").unlink()
    elif broken == "text":
        (tmp_path / "diagnosis.json").write_text("no json")
    elif broken == "keys":
        (tmp_path / "diagnosis.json").write_text("{}")
    else:
        (tmp_path / "posterior.npz").unlink()
    with pytest.raises(fp.InputError, match="diagnos"):
        known_in(tmp_path, case.log())


def test_the_diagnosis_of_another_log_is_refused(tmp_path):
    other = dataclasses.replace(case.log(), sha256="def")
    with pytest.raises(fp.InputError, match=r"made\.csv, not to"):
        known_in(folder_of(tmp_path), other)
    with pytest.raises(fp.InputError, match="samples"):
        known_in(tmp_path, case.log(2.0))


def test_so_is_one_in_memory_which_knows_the_columns_of_arrays():
    log, model = case.log(), case.model()
    made = {"inputs": [{"role": "fitted", "name": "a log", "sha256": "x", "columns": columns_hash(log)}]}
    answer = fp.Diagnosis(
        "unexplained", (), (), SimpleNamespace(before=0.1, after=0.1), (), None, (), "", (), provenance=made,
        posterior=case.known().posterior,
    )  # fmt: skip
    changed = dataclasses.replace(log, torque=1.001 * log.torque)
    with pytest.raises(fp.InputError, match="The diagnosis belongs to a log, not to "):
        fp.improve(changed, model, free=("controller",), diagnosis=answer)
    with pytest.raises(fp.InputError, match="The diagnosis belongs to a log, not to "):
        fp.plan(model, log=changed, diagnosis={"ranking": [], "provenance": made})
    assert refuse_other_log(made, log, "it") == 0
    assert refuse_other_log(made, log.with_further([changed]), "it") == 0
    assert refuse_other_log(made, changed.with_further([log]), "it") == 0
    other = {"inputs": [*made["inputs"], {"role": "fitted", "name": "b", "sha256": "y", "columns": "z"}]}
    assert refuse_other_log(other, log, "it") == 1


def test_the_diagnosis_beside_another_machine_is_refused(tmp_path):
    model = case.model()
    entry = {"role": "model", "name": "servo.toml", "sha256": "0", "machine": _machine(model)}
    inputs = [{"role": "fitted", "name": "made.csv", "sha256": "abc"}, entry]
    folder = folder_of(tmp_path, provenance={"inputs": inputs})
    assert known_in(folder, case.log(), model=model).verdict == "explained"
    gains = eqx.tree_at(lambda loop: loop.controller.kp, model.loop, 123.0)
    assert known_in(folder, case.log(), model=dataclasses.replace(model, loop=gains)).verdict == "explained"
    for changed in (
        '[sensor]\nside = "motor"\n',
        "[actuator]\ndelay = 1e-3\n",
        '[load]\ntype = "unbalance"\namplitude = 0.1\n',
    ):
        with pytest.raises(fp.InputError, match="beside another machine"):
            known_in(folder, case.log(), model=case.model(changed))
    heavier = eqx.tree_at(lambda loop: loop.plant.inertia, model.loop, 1.01 * float(model.loop.plant.inertia))
    with pytest.raises(fp.InputError, match="beside another machine than that of"):
        known_in(folder, case.log(), model=dataclasses.replace(model, loop=heavier))


def test_a_model_in_single_precision_is_the_machine_that_was_diagnosed_in_double():
    text = case.text().replace("inertia = ", "inertia = 4.13335  # ", 1)
    single = fp.load_model(text)
    with double_precision():
        double = fp.load_model(text)
    known = {"inputs": [{"role": "model", "machine": json.loads(json.dumps(_machine(double)))}]}
    refuse_other_machine(known, single, "why")
    refuse_other_machine({}, single, "why")  # an older diagnosis does not say
    with pytest.raises(fp.InputError, match="beside another machine"):
        refuse_other_machine(known, fp.load_model(text.replace("4.13335", "4.13435")), "why")


def weighed(*names, worth=1.0, wide=()):
    """A fit as `left_open` sees it."""
    effects = tuple(effect for effect in EFFECTS if effect.name in names)
    every = (*names, *(f"{one}_error" for one in wide))
    candidate = SimpleNamespace(names=every, wide=frozenset(wide), effects=effects)
    fit = SimpleNamespace(candidate=candidate)
    return SimpleNamespace(fit=fit, structural=names, worth=worth, behind=lambda best: best.worth - worth)


def test_what_the_log_leaves_open_is_drawn_from_and_an_exact_twin_is():
    chosen = weighed("unbalance", "velocity_delay", worth=9.0)
    twin = weighed("unbalance", "actuator_delay", worth=9.0)
    alone = weighed("actuator_delay", worth=2.0)
    nominal = weighed(wide=("inertia",))
    decision = SimpleNamespace(factor=None, chosen=chosen, rivals=(chosen, twin), singles=(alone,), nominal=nominal)
    likely = {
        "unbalance": 0.83, "velocity_delay": 0.4, "actuator_delay": 0.4, "velocity_quantisation": 0.98,
        "inertia_error": 0.06, "stribeck": 0.01, "cogging": float("nan"),
    }  # fmt: skip
    found = left_open(decision, ("unbalance", "velocity_delay", "velocity_quantisation"), likely)
    assert [(share, fit) for share, fit in found] == [(0.4, twin.fit), (0.06, nominal.fit)]


def test_a_factor_that_does_as_well_as_wrong_numbers_is_drawn_with_the_other_causes_beside_it():
    chosen = weighed("unbalance", worth=9.0, wide=("inertia", "coulomb"))
    alone, beside = weighed("torque_gain_error", worth=2.0), weighed("unbalance", "torque_gain_error", worth=8.0)
    likely = {"unbalance": 0.95, "inertia_error": 0.47, "coulomb_error": 0.47, "torque_gain_error": 0.47}
    for factor, drawn in ((beside, beside), (None, alone)):
        decision = SimpleNamespace(
            factor=factor, chosen=chosen, rivals=(chosen,), singles=(alone,), nominal=weighed()
        )  # fmt: skip
        assert left_open(decision, ("unbalance", "inertia_error", "coulomb_error"), likely) == [(0.47, drawn.fit)]


def test_a_slight_error_of_the_rate_reading_is_left_open():
    """To the gap a scale is nearly a wrong inertia, to the tracking it is an error of its own."""
    chosen = weighed("stribeck", "velocity_scale_error", worth=9.0)
    alone, other = weighed("stribeck", worth=7.0), weighed("cogging", worth=8.0)
    decision = SimpleNamespace(factor=None, chosen=chosen, rivals=(chosen,), singles=(other, alone), nominal=weighed())
    assert left_open(decision, ("stribeck",), {"stribeck": 0.9}) == [(0.5, alone.fit)]
    assert left_open(decision, ("stribeck", "velocity_scale_error"), {"stribeck": 0.9}) == []


def test_what_does_as_well_in_the_place_of_a_detail_is_left_open():
    """A lag of the sensor for a delay of the actuator, without a position: the loop is another one."""
    chosen = weighed("constant_torque", "actuator_delay", worth=99.0)
    lag, far = weighed("constant_torque", "velocity_lag", worth=98.0), weighed("constant_torque", "cogging", worth=60.0)
    alone = weighed("constant_torque", worth=50.0)
    decision = SimpleNamespace(
        factor=None, chosen=chosen, rivals=(far, chosen, lag), singles=(alone,), nominal=weighed()
    )
    assert left_open(decision, ("constant_torque",), {}) == [(0.5, lag.fit)]
    assert left_open(decision, ("constant_torque", "actuator_delay"), {}) == []
    assert left_open(decision, (), {}) == []  # of a log that nothing explains no part is a detail


def test_nothing_is_improved_where_the_velocity_is_in_another_unit_than_the_position():
    known = case.known()
    assert _in_another_unit(known.posterior, ("velocity_scale_error",), [57.3])
    assert _in_another_unit(known.posterior, ("velocity_scale_error",), [-1.0])
    assert not _in_another_unit(known.posterior, ("velocity_scale_error",), [0.93])
    assert not _in_another_unit(known.posterior, ("stribeck",), [57.3])
    alone = dataclasses.replace(known.posterior, noise=(known.posterior.noise[0], 0.0))
    assert not _in_another_unit(alone, ("velocity_scale_error",), [3.0])  # a fitted scale, beside no position
    with pytest.raises(fp.InputError, match="until this is settled: x is not y"):
        fp.improve(
            case.log(),
            case.model(),
            free=("controller",),
            diagnosis=dataclasses.replace(known, contradiction="x is not y"),
        )


def test_a_diagnosis_of_several_stretches_of_one_file_is_one_of_that_log(tmp_path):
    """And one of several files is not."""
    log, known = dataclasses.replace(case.log(), sha256="a"), case.known().posterior
    fitted = [{"role": "fitted", "name": "made.csv", "sha256": own, "samples": len(log)} for own in ("a", "a", "b")]
    folder_of(tmp_path, provenance={"inputs": fitted[:2]})
    dataclasses.replace(known, missing=(known.missing[0], np.zeros(700))).save(tmp_path / FILE)
    assert len(known_in(tmp_path, log).posterior.missing) == 2
    (tmp_path / "other").mkdir()
    folder_of(tmp_path / "other", provenance={"inputs": [fitted[0], fitted[2]]})
    dataclasses.replace(known, missing=(known.missing[0], np.zeros(700))).save(tmp_path / "other" / FILE)
    with pytest.raises(fp.InputError, match="diagnosis of 2 logs"):
        known_in(tmp_path / "other", log)


def test_how_likely_the_reported_model_is_comes_from_the_ranking(tmp_path):
    known = dataclasses.replace(case.known().posterior, causes=("inertia_error", "compliance"))
    ranking = [
        {"effect": "compliance", "cause_probability": 0.02, "parameters": {}},
        {"effect": "inertia_error", "cause_probability": None, "parameters": {}},
        {"effect": "cogging", "cause_probability": 0.4, "parameters": {}},
    ]
    folder = folder_of(tmp_path, ranking=ranking, gap={"before": 0.3, "after": 0.01})
    known.save(tmp_path / "posterior.npz")
    found = known_in(folder, case.log())
    assert found.likely == 0.02
    assert found.gap_before == 0.3
