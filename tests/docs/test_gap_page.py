"""docs/gap.md's table of effects is the diagnosis' vocabulary: every name, every parameter, every unit."""

import pathlib
import re

import pytest

from fpjax.gap import EFFECTS, Setting

PAGE = (pathlib.Path(__file__).parents[2] / "docs" / "gap.md").read_text()
SETTING = Setting(0.05, 0.4, 0.03, 0.4, 5.0, 2.0, 6.0, 8.0, 1e-3)
READ_FROM_THE_DATA = {"velocity_quantisation": {"step": "rad/s"}}  # no change of a block: see `fpjax.gap.diagnose`


def table(title):
    """Rows of a section's first table: {cell in the first column: the other cells}."""
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split(" | ")] for line in section.splitlines() if line[:3] == "| `"
    ]
    return [(re.findall(r"`(\w+)`", row[0])[0], row[1:]) for row in rows]


@pytest.fixture(scope="module")
def told():
    return {name: dict(re.findall(r"`(\w+)` \[([^]]+)\]", cells[1])) for name, cells in table("The effects")}


def test_the_table_names_every_effect_once(told):
    names = [name for name, _ in table("The effects")]
    assert len(names) == len(set(names)) == 25
    assert set(names) == {effect.name for effect in EFFECTS} | set(READ_FROM_THE_DATA)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_parameters_and_units_are_those_that_a_diagnosis_reports(told, effect):
    values = {p.name: p.scale(SETTING) for p in (*effect.parameters, *effect.fixed)} | {
        "coulomb": SETTING.coulomb,
        "viscous": SETTING.viscous,
        "inertia": SETTING.inertia,
    }
    reported = {name: unit for name, (_, unit) in effect.describe(values, SETTING).items()}
    assert told[effect.name] == reported


def test_what_is_read_from_the_data(told):
    for name, parameters in READ_FROM_THE_DATA.items():
        assert told[name] == parameters


def test_the_twins_are_effects_of_the_table(told):
    twins = table("Exact twins")
    assert len(twins) == 7
    for name, cells in twins:
        assert {name, *re.findall(r"`(\w+)`", cells[0])} <= set(told)
