"""What a plan says and writes; bad input of its command."""

import dataclasses
import json
import re

import jax.numpy as jnp
import numpy as np
import pytest
from plan_case import LIMITS, servo_text

from fpjax import Plan, load_model
from fpjax.cli.command_line import main
from fpjax.planning import Separation, Visible
from fpjax.planning.explain import not_visible, separations
from fpjax.planning.picture import draw
from fpjax.planning.trial import RunComparison


def example(aim="rivals"):
    time = np.arange(501) * 4e-3
    speed = 5.0 * np.sin(np.pi * time)
    motion = {"speed": speed, "acceleration": np.gradient(speed, 4e-3), "position": np.cumsum(speed) * 4e-3}
    pairs = separations(
        ["stribeck", "viscous_error", "actuator_delay"],
        [RunComparison(0, 1, ()), RunComparison(1, 0, ()), RunComparison(0, 2, ()), RunComparison(1, 2, ())],
        np.array([40.0, 30.0, 2.0, 0.0]), ["here", "there", "x", "y"],
        {frozenset(("viscous_error", "actuator_delay")): "They make exactly the same log."},
    )  # fmt: skip
    visible = (
        Visible("stribeck", {"stribeck_torque": (0.1, "N m")}, 40.0, 0.07),
        Visible("torque_saturation", {"limit": (3.0, "N m")}, 1e-10, 0.0, unseen=not_visible(1e-10, 0.0, nowhere=True)),
        Visible("quadratic_drag", {}, 30.0, 0.002, unseen=not_visible(30.0, 0.002, nowhere=False)),
        Visible("viscous_error", {}, 4.0, 0.1, unseen=not_visible(4.0, 0.1, nowhere=False)),
    )
    return Plan(
        aim, time, speed, motion, np.sign(speed), LIMITS, visible if aim == "effects" else (),
        pairs if aim == "rivals" else (), (), 0.01, {"velocity": 0.005}, False, False, "N m", "servo.toml", 3,
        (1.0, 2.0), "converged",
    )  # fmt: skip


def test_every_pair_has_its_sentence_the_weaker_direction_and_its_twins():
    pairs = {one.between: one for one in example().separations}
    first = pairs["stribeck", "viscous_error"]
    assert first.nats == 30.0
    assert "30 nats, 10 needed; because" in first.sentence
    assert "there" in first.sentence
    weak = pairs["stribeck", "actuator_delay"]
    assert not weak.separated
    assert "will not decide" in weak.sentence
    assert weak.experiment in weak.sentence
    twin = pairs["viscous_error", "actuator_delay"]
    assert twin.twins
    assert "inseparable by any run" in twin.sentence


def test_what_the_run_does_not_show_is_said_with_its_reason_and_is_not_the_least_visible():
    made = example("effects")
    assert made.decided == 1
    assert "show 1 of the 4 effects" in made.sentence()
    assert "least visible is stribeck: 40 nats, 10 needed, and 7.0% of the commanded torque" in made.sentence()
    limit, drag, viscous = made.unseen()
    assert re.search("torque saturation: no motion that was tried within the limits", limit)
    assert re.search("quadratic drag: its torque is less than 1.5% of what this run commands", drag)
    assert re.search("viscous error: the evidence stays below the 10 nats", viscous)
    assert not_visible(20.0, 0.02, nowhere=False) == ""
    assert not_visible(20.0, None, nowhere=False) == ""
    assert "1e-10" not in str(made)


@pytest.mark.parametrize("aim", ["rivals", "effects"])
def test_a_plan_writes_what_a_drive_and_a_model_read(aim, tmp_path):
    made = example(aim)
    paths = made.write(tmp_path / "next")
    assert sorted(paths) == ["plan.json", "plan.png", "reference.csv"]
    content = json.loads(paths["plan.json"].read_text())
    assert content["aim"] == aim
    assert content["limits"]["speed"] == 5.0
    (tmp_path / "servo.toml").write_text(
        servo_text() + 'duration = 2.0\n[reference]\ntype = "recorded"\nfile = "next/reference.csv"\n'
    )
    reference = load_model(tmp_path / "servo.toml").needed_reference()
    np.testing.assert_allclose(np.asarray(reference.readout(jnp.asarray(made.time))), made.reference, atol=1e-6)
    assert str(made)
    assert isinstance(made.sentence(), str)
    assert all(isinstance(one, Separation) for one in made.separations)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--torque", "0.1"], "cannot move within its limits"),
        (["--speed", "-3"], "--speed must be a number above zero"),
        (["--seconds", "0"], "--seconds must be above zero"),
        (["--diagnosis", "nowhere"], "cannot be read"),
        (["--diagnosis", "nowhere", "--log", "x.csv"], "not allowed with"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(words, sentence, tmp_path, capsys):
    path = tmp_path / "servo.toml"
    path.write_text(servo_text())
    try:
        code = main(["plan", "--model", str(path), "--out", str(tmp_path / "out"), "--no-cache", *words])
    except SystemExit as error:
        code = error.code
    assert code == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert "Traceback" not in said


@pytest.mark.parametrize("aim", ["rivals", "effects"])
def test_the_picture_says_what_the_run_is_for_in_names_and_plain_numbers(aim):
    plan = example(aim)
    figure = draw(plan)
    said = figure.get_suptitle() + " ".join(text.get_text() for axes in figure.axes for text in axes.texts)
    assert "told apart" not in said  # one pair is not: 2 nats are not enough
    assert "all effects visible" not in said
    assert "not enough" in said
    names = [label.get_text() for label in figure.axes[-1].get_yticklabels()]
    assert any("Stribeck friction" in name for name in names)
    many = dataclasses.replace(plan.visible[0], nats=14400.0) if plan.visible else None
    if many is not None:
        told = draw(dataclasses.replace(plan, visible=(many,)))
        assert "14400" in [text.get_text() for text in told.axes[-1].texts]
