"""Labels of the second truth that are not their laws' own numbers: what they are, and how older ones are renewed."""

import hashlib
import json

import numpy as np
import pytest

from benchmarks.withheld.cases import generate, label_path, log_path
from benchmarks.withheld.identity import identities
from benchmarks.withheld.renew import renew_labels
from benchmarks.withheld.second import cases as second
from benchmarks.withheld.second.cases import Asked, Case, build, run
from benchmarks.withheld.second.equivalent import CONTRACT_FORM, EFFECTS
from benchmarks.withheld.second.label import label_of
from benchmarks.withheld.second.simulate import RECORDED, Plant, simulate
from benchmarks.withheld.second.world import Trace
from fpjax import InputError

PERIODS = 600


def drawn(effect: str, seed: int = 0, system: str = "joint") -> Case:
    return build(seed, f"labels/{effect}", "single", "both", system, (effect,), PERIODS, 1.0)


def values_of(label: dict, effect: str, key: str = "parameters") -> dict[str, float]:
    return {name: one["value"] for name, one in label[key][effect].items()}


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("system", ["joint", "table"])
def test_of_a_law_of_the_contracts_form_the_equivalent_is_the_parameter(effect, system):
    case = drawn(effect, system=system)
    case.world.values |= CONTRACT_FORM[effect]
    label = label_of(case, simulate([case.world])[0], {}, "both", "single")
    own = case.plan.parameters[effect]
    assert values_of(label, effect) == pytest.approx(own, rel=1e-9)
    assert values_of(label, effect, "law") == pytest.approx(own, rel=1e-15)


def course(trace: Trace, name: str) -> np.ndarray:
    found = getattr(trace, name)
    assert found is not None
    return found


def straight_line(x: np.ndarray, y: np.ndarray) -> float:
    return float(np.polyfit(x, y, 1)[0])


def nearest_by_hand(effect: str, case: Case, trace: Trace) -> dict[str, float]:
    """The definition, from the trace."""
    values = case.world.values
    if effect == "compliance":
        x, v, torque = course(trace, "twist"), course(trace, "twist_rate"), course(trace, "transmitted")
        # normal equations of a spring and a damper
        xx, vv, xv = x @ x, v @ v, x @ v
        stiffness = (vv * (x @ torque) - xv * (v @ torque)) / (xx * vv - xv**2)
        load = values["inertia"] * values["load_share"]
        motor = values["inertia"] - load
        frequency = float(np.sqrt(stiffness * (1 / motor + 1 / load)) / (2 * np.pi))
        return {"stiffness": float(stiffness), "frequency": frequency}
    moves = np.abs(trace.true_velocity) > 0.02 * case.plan.drawn.kind.speed
    return {"coefficient": straight_line(np.abs(course(trace, "delivered")[moves]), course(trace, "load_level")[moves])}


@pytest.mark.parametrize("effect", EFFECTS)
def test_of_another_form_the_label_is_the_nearest_law_of_the_contract_and_the_laws_own_number_stays_beside(effect):
    for seed in (0, 2):
        case = drawn(effect, seed)
        trace = simulate([case.world])[0]
        label, own = label_of(case, trace, {}, "both", "single"), case.plan.parameters[effect]
        assert values_of(label, effect) == pytest.approx(nearest_by_hand(effect, case, trace), rel=1e-8)
        assert values_of(label, effect, "law") == pytest.approx(own, rel=1e-15)
        assert values_of(label, effect) != pytest.approx(own, rel=1e-3)
        assert label["version"] == second.VERSION
        # of a law that is not said to be of another form the label is its own parameter
        case.plan.other_form.clear()
        label = label_of(case, trace, {}, "both", "single")
        assert values_of(label, effect) == pytest.approx(own, rel=1e-15)
        assert label["law"] == {}


@pytest.mark.parametrize("effects", [("load_dependent_friction",), ("compliance", "load_dependent_friction")])
def test_what_is_recorded_for_the_label_obeys_newton(effects):
    case = build(0, "labels", "pairs", "both", "joint", effects, 300, 1.0)
    values, step = case.world.values, 1e-3 / 24
    plant = Plant([case.world])
    share = values["load_share"] if "compliance" in effects else 0.0
    inertia = values["inertia"] * np.array([1 - share, share][: len(plant.velocity)])
    delivered, held, changes = [], [], []
    for k in range(6000):
        before, time = plant.velocity[:, 0].copy(), k * step
        torque = 1.5 * case.plan.scales.torque * np.sin(2 * np.pi * 9 * time)
        plant.step(np.array([torque]), time, step)
        delivered.append(plant.inside()["delivered"][0])
        held.append(plant.held(plant.position[-1])[0])
        changes.append(inertia @ (plant.velocity[:, 0] - before) / step)
    # what is delivered beyond friction accelerates all inertia and holds all loads
    beyond = np.array(delivered) - np.array(held)
    assert np.std(beyond - changes) < 0.02 * np.std(changes)


def test_the_twist_that_is_recorded_is_that_of_its_rate():
    case = drawn("compliance")
    trace = simulate([case.world])[0]
    assert trace.delivered is None
    rate = np.gradient(course(trace, "twist"), case.world.dt)
    assert np.std((rate - trace.twist_rate)[1:-1]) < 0.05 * np.std(rate)


# sums of the sizes of torque, position and derived velocity, written down at the version before
BEFORE = [
    [176.43852252854498, 71.0369724954973, 1.342090673699334],
    [573.7269331838545, 129.24441278193868, 1.095831261036761],
    [5.02219438125139, 148.5813791146032, 11.814369440034415],
    [2721.373944562286, 19.252079999999996, 0.0747224029141639],
]


def test_what_is_recorded_for_the_label_changes_no_log(monkeypatch):
    asked = [
        Asked(0, "kept", "single", "both", "joint", ("compliance",)),
        Asked(2, "kept", "single", "both", "table", ("load_dependent_friction",)),
        Asked(4, "kept", "pairs", "both", "hobby", ("compliance", "load_dependent_friction")),
        Asked(5, "kept", "single", "encoder", "gantry", ("backlash",)),
    ]
    found = run(asked, 250)
    sums = [[np.sum(np.abs(getattr(t, name))) for name in ("torque", "position", "derived")] for _, t, _ in found]
    # a count more or less on another processor
    np.testing.assert_allclose(sums, BEFORE, rtol=1e-3)
    monkeypatch.setattr(Plant, "inside", lambda self: {})
    for (_, trace, _), (_, bare, _) in zip(found, run(asked, 250), strict=True):
        assert bare.twist is None
        assert bare.delivered is None
        for name in RECORDED:
            np.testing.assert_array_equal(getattr(trace, name), getattr(bare, name))


# labels that an earlier version wrote


def files_of(folder) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix != ".json"
    }


def test_labels_of_an_earlier_version_are_made_anew_and_their_logs_are_kept(tmp_path):
    found = identities(0, 2)
    wanted = [
        next(one for one in found if one.effects == (effect,) and one.set == "wide") for effect in (*EFFECTS, "cogging")
    ]
    wanted += [one for one in found if one.set == "outside"][:1]
    generate(tmp_path, wanted, periods=400)
    assert renew_labels(tmp_path, wanted, 400) == 0
    fresh = {one: json.loads(label_path(tmp_path, one).read_text()) for one in wanted}
    for one, label in fresh.items():
        old = label | {"version": second.SAME_LOGS, "parameters": label["parameters"] | label["law"]}
        del old["law"]
        label_path(tmp_path, one).write_text(json.dumps(old))
    # what a version beside the generator wrote, a starter's model say, is kept
    model = log_path(tmp_path, wanted[0]) / "servo.toml"
    model.write_text(model.read_text() + "# mine\n")
    before = files_of(tmp_path)
    assert renew_labels(tmp_path, wanted, 400) == len(wanted)
    assert files_of(tmp_path) == before
    for one, label in fresh.items():
        assert json.loads(label_path(tmp_path, one).read_text()) == label
    assert generate(tmp_path, wanted, periods=400) == 0


def test_a_label_of_another_machine_is_not_renewed(tmp_path):
    [one] = [one for one in identities(0, 2) if one.effects == ("compliance",) and one.set == "wide"]
    generate(tmp_path, [one], periods=300)
    label = json.loads(label_path(tmp_path, one).read_text())
    label["parameters"] = {"compliance": {name: v | {"value": 1.5} for name, v in label["law"]["compliance"].items()}}
    for version in (second.SAME_LOGS - 1, second.SAME_LOGS):
        text = json.dumps(label | {"version": version})
        label_path(tmp_path, one).write_text(text)
        if version == second.SAME_LOGS:
            with pytest.raises(InputError, match="another machine"):
                renew_labels(tmp_path, [one], 300)
        else:
            # of a version whose logs were others nothing is renewed
            assert renew_labels(tmp_path, [one], 300) == 0
        assert label_path(tmp_path, one).read_text() == text
