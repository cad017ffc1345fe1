"""Whole plans: the evidence is what the machines make it, the limits hold, an interrupt keeps the best."""

import json

import numpy as np
import pytest
from plan_case import ranking, servo, servo_text

import fpjax as fp
from fpjax.cli.command_line import main

GIVEN = {"speed": 5.0, "torque": 3.0, "travel": 6.0, "duration": 4.0}
RIVALS = ranking(("viscous_error", 0.3, ["quadratic_drag"]), ("quadratic_drag", 0.2, []))


@pytest.mark.long
def test_rivals_are_separated_by_a_run_within_the_limits():
    found = fp.plan(servo(), diagnosis=RIVALS, seconds=30.0, velocity_noise=0.01, **GIVEN)
    assert found.aim == "rivals"
    assert found.rivals == ("viscous_error", "quadratic_drag")
    (pair,) = found.separations
    assert pair.separated
    assert found.gained[1] >= found.gained[0]
    assert max(found.used.values()) <= 1.01
    # A parabola and a line differ at high speed: the run goes there.
    assert found.used["speed"] > 0.5


@pytest.mark.long
def test_exact_twins_bring_no_evidence_and_are_said_to_be():
    near = ranking(("actuator_delay", 0.3, ["velocity_delay"]), ("velocity_delay", 0.3, []), ("stribeck", 0.2, []))
    found = fp.plan(servo(), diagnosis=near, seconds=30.0, **GIVEN)
    twins = [one for one in found.separations if one.twins]
    assert [set(one.between) for one in twins] == [{"actuator_delay", "velocity_delay"}]
    assert "encoder" in twins[0].sentence
    assert sum(one.separated for one in found.separations) == 2


@pytest.mark.long
def test_a_model_alone_makes_every_effect_visible_that_a_run_can_show(tmp_path, capsys):
    (tmp_path / "servo.toml").write_text(servo_text(sensors="both"))
    words = [word for name, value in GIVEN.items() for word in (f"--{name}", str(value))] + ["--seconds", "6"]
    out = tmp_path / "next"
    assert main(["plan", "--model", str(tmp_path / "servo.toml"), "--out", str(out), *words]) == 0
    content = json.loads((out / "plan.json").read_text())
    assert {one["effect"] for one in content["visible"] if one["twin"]} == {"torque_gain_error"}
    assert all(one["shown"] for one in content["visible"] if not one["twin"])
    assert {"reference.csv", "plan.json", "plan.png", "run.json"} <= {path.name for path in out.iterdir()}
    assert json.loads((out / "run.json").read_text())["status"] == "completed"


@pytest.mark.long
@pytest.mark.parametrize(("reference", "sensors"), [("velocity", "velocity"), ("position", "both")])
def test_an_unknown_controller_plans_the_motion_itself(reference, sensors):
    model = servo(sensors, "unknown", "", reference)
    found = fp.plan(model, diagnosis=RIVALS, seconds=12.0, **GIVEN)  # however good the run is
    assert any("unknown" in note for note in found.notes)
    moving = np.abs(found.motion["speed"]) > 0.5
    speed, acceleration = found.motion["speed"][moving], found.motion["acceleration"][moving]
    columns = np.stack([acceleration, np.sign(speed), speed], axis=1)
    # The first rival's viscous friction differs from the nominal one; its torque else is that of the motion.
    (inertia, coulomb, _), *_ = np.linalg.lstsq(columns, found.torque[moving], rcond=None)
    assert inertia == pytest.approx(0.05, rel=0.15)
    assert coulomb == pytest.approx(0.5, rel=0.3)


@pytest.mark.long
def test_an_interrupt_keeps_the_best_run_so_far():
    def once(stage, share):
        del share
        if stage == "improving by gradients":
            raise KeyboardInterrupt

    found = fp.plan(servo(), diagnosis=RIVALS, seconds=30.0, progress=once, **GIVEN)
    assert found.ended == "interrupted"
    assert any("interrupted" in note for note in found.notes)


@pytest.mark.slow
def test_an_unstable_loop_is_one_sentence():
    unstable = servo(gains="kp = 80.0\nki = 4000.0")
    with pytest.raises(fp.InputError, match="diverges on every motion"):
        fp.plan(unstable, diagnosis=RIVALS, seconds=20.0, **GIVEN)
