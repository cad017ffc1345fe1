"""The gallery: six machines without gains, each simulated and tuned from default settings to a sensible result."""

import dataclasses
import math
import pathlib

import pytest

import fpjax as fp
import tuning

GALLERY = sorted((pathlib.Path(__file__).parents[2] / "examples" / "gallery").glob("*.toml"))
LONG = {"gimbal", "robot_joint"}
LOADED = {"robot_joint", "hobby_servo"}  # friction grows with the load: a law of two numbers holds its mean at best


def test_there_are_six():
    assert {path.stem for path in GALLERY} == {
        "belt_axis", "gimbal", "hobby_servo", "robot_joint", "spindle", "telescope_mount",
    }  # fmt: skip


# Twenty seconds of processor time each: the two that differ most are in `.ci/run`.
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=pytest.mark.long if path.stem in LONG else pytest.mark.slow)
        for path in GALLERY
    ],
)
def test_it_is_simulated_and_tuned_by_default(path):
    model = fp.load_model(path)
    assert sum("chosen by pole placement" in note for note in model.notes) == 2
    before = fp.simulate(model)
    assert not before.diverged
    result = tuning.tune(model)
    assert math.isfinite(result.cost)
    assert result.cost < result.start_cost
    assert result.at_bounds == {}
    after = fp.simulate(dataclasses.replace(model, loop=result.apply(model.loop)))
    assert not after.diverged
    for name, value in after.settled.items():
        assert value == pytest.approx(model.nominal[name], rel=0.3 if path.stem in LOADED else 0.05)
