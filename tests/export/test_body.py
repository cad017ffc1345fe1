"""The exported body behaves in MuJoCo as in fpjax, and what it cannot hold is named with its cost."""

import jax
import numpy as np
import pytest

import fpjax as fp
from fpjax.cli import main
from fpjax.export import mujoco_replay
from fpjax.export.body import body_of

mujoco = pytest.importorskip("mujoco")

ONE = '[plant]\ntype = "one_mass"\ninertia = 10.0\n'
TWO = '[plant]\ntype = "one_mass"\ninertia = 10.0\n[transmission]\nstiffness = 1e5\ndamping = 50.0\nbacklash = 2e-4\n'
SIMPLE = '[friction]\ntype = "coulomb_viscous"\ncoulomb = 20.0\nviscous = 2.0\nsteepness = 500.0\n'
LUGRE = (
    '[friction]\ntype = "lugre"\ncoulomb = 20.0\nstatic = 25.0\nstribeck_velocity = 0.05\nbristle_stiffness = 2e4\n'
    "bristle_damping = 1e3\nviscous = 2.0\n"
)
STRIBECK = SIMPLE.replace('"coulomb_viscous"', '"stribeck"\nstatic = 26.0\nstribeck_velocity = 0.05')
ACTUATOR = (
    "[actuator]\ngain = 0.9\nlag = 0.002\ndelay = 0.0024\nlimit = 60.0\noffset = 2.0\ncogging_amplitude = 3.0\n"
    "cogging_periods = 7.0\ncogging_phase = 0.3\n"
)
UNBALANCE = '[load]\ntype = "unbalance"\namplitude = 5.0\nphase = 0.4\n'
REST = (
    '[controller]\ntype = "pi"\nkp = 300.0\nki = 1000.0\n[reference]\ntype = "sine"\namplitude = 1.0\nfrequency = 1.0\n'
    '[simulation]\ndt = 1e-3\nduration = 1.0\nstepping = "sampled"\nsubsteps = 8\n'
)
SMOOTH = "friction that is smooth at reversals (steepness 500)"  # of rk4; MuJoCo's friction and "exact" are dry
MOTOR_SIDE = '[sensor]\ntype = "ideal"\nside = "motor"\n'


@pytest.mark.parametrize(
    "text",
    [ONE + SIMPLE, ONE + SIMPLE + ACTUATOR, ONE + SIMPLE + UNBALANCE, TWO + SIMPLE + MOTOR_SIDE, ONE + LUGRE],
    ids=["plain", "actuator", "unbalance", "transmission", "lugre"],
)
def test_mujoco_moves_as_fpjax_does_where_it_holds_everything(text, tmp_path):
    made = fp.export_mujoco(fp.load_model(text + REST), tmp_path)
    assert set(made.costs) <= {SMOOTH}  # of these loops' own simulation, see SMOOTH
    for name, share in (("velocity", 0.01), ("position", 0.01), ("torque", 0.05)):
        ours, theirs, size = made.errors[name]
        assert ours == 0.0, "compared with fpjax itself"
        assert theirs < share * size, name


def test_a_position_goes_on_past_the_last_row_in_both_simulators(tmp_path):
    """Only fpjax' own run was told a stop after the last row: its feed-forward made one torque of 100 N m from it."""
    text = ONE.replace("10.0", "0.02") + SIMPLE.replace("20.0", "0.3").replace("2.0", "0.05")
    loop = (
        '[controller]\ntype = "position_cascade"\nkp = 20.0\nkv = 1.0\n[feedforward]\nvelocity = 1.0\ninertia = 0.02\n'
        '[units]\nreference = "position"\nsensors = "position"\n'
    )
    made = fp.export_mujoco(fp.load_model(text + loop + REST[REST.index("[reference]") :]), tmp_path)
    _, theirs, size = made.errors["torque"]
    assert size < 2.0
    assert theirs < 0.05 * size


def test_what_the_target_cannot_hold_is_named_with_its_cost(tmp_path):
    model = fp.load_model(ONE + STRIBECK + ACTUATOR + UNBALANCE + REST)
    found = fp.export_mujoco(model, tmp_path)
    assert set(found.costs) == {"Stribeck friction", SMOOTH}
    assert found.costs["Stribeck friction"] > 1e-4
    plain = fp.export_urdf(model, tmp_path)
    assert {"Stribeck friction", "the actuator's delay", "constant torques"} < set(plain.costs)
    assert (
        "two masses: spring, damper and backlash" in fp.export_urdf(fp.load_model(TWO + SIMPLE + REST), tmp_path).costs
    )
    hard = fp.load_model(TWO + "hardening = 1e12\n" + SIMPLE + REST)
    assert fp.export_mujoco(hard, tmp_path).costs["the hardening of the shaft"] > 0.0
    loaded = mujoco.MjModel.from_xml_path(str(tmp_path / "servo.urdf"))
    assert loaded.dof_frictionloss[0] == 20.0
    assert loaded.dof_damping[0] == 2.0
    assert loaded.dof_M0[0] == pytest.approx(10.0, rel=1e-6)


def test_dry_friction_in_place_of_a_smooth_one_is_named_with_its_cost(tmp_path):
    smooth = ONE + SIMPLE.replace("500.0", "20.0") + REST
    made = fp.export_mujoco(fp.load_model(smooth), tmp_path)
    cost = made.costs["friction that is smooth at reversals (steepness 20)"]
    assert cost == pytest.approx(made.errors["velocity"][1], rel=0.1), "it is all that the two differ by"
    assert fp.export_mujoco(fp.load_model(smooth + 'solver = "exact"\n'), tmp_path).costs == {}


def test_stiction_is_left_out_as_other_effects_are(tmp_path):
    text = SIMPLE.replace('"coulomb_viscous"', '"stiction"\nstatic = 26.0') + REST
    found = fp.export_mujoco(fp.load_model(ONE + text), tmp_path)
    name = "stiction (static friction above Coulomb friction)"
    assert set(found.costs) == {name, SMOOTH}
    joint = mujoco.MjModel.from_xml_path(str(found.file))
    assert (joint.dof_frictionloss[0], joint.dof_damping[0]) == (20.0, 2.0)
    assert name in fp.export_urdf(fp.load_model(ONE + text), tmp_path).costs


def test_each_learned_torque_is_named_by_its_variable_and_has_its_own_cost(tmp_path):
    learned = (
        '[[learned]]\nof = "position"\nat = [0.0, 0.2, 0.4]\ntorque = [0.0, 5.0, 0.0]\n'
        '[[learned]]\nof = "velocity"\nat = [-1.0, 0.0, 1.0]\ntorque = [-0.5, 0.0, 0.5]\n'
    )
    costs = fp.export_mujoco(fp.load_model(ONE + SIMPLE + learned + REST), tmp_path).costs
    names = [f"the learned torque over the {variable}" for variable in ("position", "velocity")]
    assert set(costs) == {*names, SMOOTH}
    assert costs[names[0]] > 2.0 * abs(costs[names[1]])


def test_each_kind_of_friction_is_divided_by_its_own_share():
    text = TWO.replace("backlash = 2e-4", "friction_share = 0.75\nviscous_share = 0.1") + SIMPLE + MOTOR_SIDE
    body = body_of(fp.load_model(text + REST).loop, shaft=True, lugre=False)
    assert body.coulomb == pytest.approx((5.0, 15.0))
    assert body.viscous == pytest.approx((1.8, 0.2))
    # As one joint all of it acts there.
    joint = body_of(fp.load_model(text + REST).loop, shaft=False, lugre=False)
    assert (joint.coulomb, joint.viscous) == (pytest.approx((20.0, 0.0)), pytest.approx((2.0, 0.0)))


def test_a_log_is_replayed_in_both_simulators(tmp_path, capsys):
    (tmp_path / "servo.toml").write_text(ONE + STRIBECK + REST)
    truth = fp.load_model(tmp_path / "servo.toml")
    run = fp.simulate(
        truth.loop, truth.reference, dt=1e-3, duration=1.0, stepping="sampled", substeps=8,
        record=("reference", "torque", "velocity"), key=jax.random.key(0),
    )  # fmt: skip
    columns = np.column_stack([run.time, *(np.asarray(run.signals[n]) for n in ("torque", "velocity", "reference"))])
    np.savetxt(tmp_path / "run.csv", columns, delimiter=",", header="time,torque,velocity,reference", comments="")
    words = [
        "export",
        str(tmp_path / "servo.toml"),
        "--mujoco",
        str(tmp_path / "sim"),
        "--log",
        str(tmp_path / "run.csv"),
    ]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "rms error against run.csv" in said
    assert "Stribeck friction" in said
    assert (tmp_path / "sim" / "servo.xml").exists()
    assert (tmp_path / "sim" / "export.json").exists()
    assert main([*words, "--from", "0.99"]) == 2  # the options of a log are heeded
    assert "--from and --to leave" in capsys.readouterr().err
    assert main([*words, "--columns", "torque=torque:A"]) == 2
    assert "its torque is in A" in capsys.readouterr().err


@pytest.mark.parametrize("export", [fp.export_mujoco, fp.export_urdf])
def test_a_torque_in_units_of_a_label_is_said_to_be_no_si(export, tmp_path):
    text = ONE + SIMPLE + REST
    assert not export(fp.load_model(text), tmp_path).notes
    (note,) = export(fp.load_model(text + '[units]\ntorque = "V"\n'), tmp_path).notes
    assert "in units of V" in note
    assert "takes SI" in note
    assert "torque constant [N m/V]" in note


@pytest.mark.parametrize("export", [fp.export_mujoco, fp.export_urdf])
def test_a_model_is_given_by_its_file_as_everywhere(export, tmp_path):
    file = tmp_path / "axis.toml"
    file.write_text(ONE + SIMPLE + REST)
    assert export(str(file), tmp_path / "sim").file.stem == "axis"


def test_without_mujoco_the_file_is_written_and_that_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("fpjax.export.body_export.find_mujoco", lambda: None)
    made = fp.export_mujoco(fp.load_model(ONE + SIMPLE + REST), tmp_path)
    assert made.file.exists()
    assert made.errors == {}
    assert "not installed" in made.notes[0]
    assert mujoco_replay.find_mujoco() is mujoco


def test_nothing_asked_for_is_one_sentence(tmp_path, capsys):
    (tmp_path / "servo.toml").write_text(ONE + SIMPLE + REST)
    words = ["export", str(tmp_path / "servo.toml")]
    for more, said in (
        ([], "nothing to export"),
        (["--mujoco", str(tmp_path / "body"), "--check"], "--check compiles the C"),
        (["--c", str(tmp_path / "code"), "--log", "run.csv"], "--log is replayed in MuJoCo"),
    ):
        assert main([*words, *more]) == 2
        assert said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["servo.toml"]
