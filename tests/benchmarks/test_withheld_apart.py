"""The two truths of `benchmarks withheld` share neither laws nor integrator, with each other or with the package."""

import ast
from pathlib import Path

import pytest

from benchmarks.withheld import contract, second, truth
from benchmarks.withheld.second.effects import EFFECTS as EFFECTS_2
from benchmarks.withheld.truth.effects import EFFECTS as EFFECTS_1

ROOMS = {module.__name__: Path(module.__path__[0]) for module in (truth, second)}
STANDARD = {"numpy", "collections", "dataclasses", "itertools", "json", "pathlib", "typing", "zlib"}
NEUTRAL = "contract"  # names and units: no law


def imported(path: Path) -> list[tuple[int, str]]:
    """(dots, module) of every import of a file."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [(0, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [(node.level, name) for name in ([node.module] if node.module else [a.name for a in node.names])]
    return found


@pytest.mark.parametrize("room", ROOMS)
def test_a_truth_imports_numpy_the_contract_and_its_own_files_alone(room):
    folder = ROOMS[room]
    own = {path.stem for path in folder.glob("*.py")}
    files = sorted(folder.glob("*.py"))
    assert len(files) > 8
    for path in files:
        for dots, module in imported(path):
            head = module.split(".")[0]
            inside = dots == 1 and head in own
            # the parent holds the other truth: of it the table of names and units alone
            assert inside or (dots == 2 and module == NEUTRAL) or (dots == 0 and head in STANDARD), (path.name, module)


def test_the_contract_holds_no_law():
    path = Path(contract.__file__)
    assert imported(path) == []
    functions = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    assert [node.name for node in functions] == ["unit_of"]
    assert not [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.BinOp)]


def lines_of(path: Path) -> list[str]:
    """Lines without indentation, blank ones and imports left out."""
    lines = [line.strip() for line in path.read_text().splitlines()]
    return [line for line in lines if line and not line.startswith(("import ", "from "))]


def longest_common_run(first: list[str], second: list[str]) -> int:
    """Most lines one after the other that two files have in common."""
    best, above = 0, [0] * (len(second) + 1)
    for one in first:
        row = [0]
        row += [above[j] + 1 if one == other else 0 for j, other in enumerate(second)]
        best, above = max(best, *row), row
    return best


def test_the_truths_share_no_run_of_lines():
    # five lines: the fields of a machine's record, which are the loop's own words
    files = [[*folder.glob("*.py")] for folder in ROOMS.values()]
    for first in files[0]:
        for other in files[1]:
            assert longest_common_run(lines_of(first), lines_of(other)) <= 5, (first.name, other.name)
    assert longest_common_run(["a", "b", "c", "d"], ["x", "b", "c", "y"]) == 2


def test_both_have_the_effects_of_the_contract_in_its_order_each_with_a_law_of_its_own():
    assert tuple(EFFECTS_2) == contract.EFFECTS
    assert tuple(EFFECTS_1) == tuple(name for name in contract.EFFECTS if name != "load_dependent_friction")
    for name, law in EFFECTS_1.items():
        assert law.__name__ == name
        assert {law.__module__, EFFECTS_2[name].__module__} == {f"{room}.effects" for room in ROOMS}


def test_every_parameter_has_a_unit():
    assert contract.unit_of("quadratic_drag", "coefficient") == "N m s^2/rad^2"
    assert contract.unit_of("load_dependent_friction", "coefficient") == "1"
    with pytest.raises(KeyError):
        contract.unit_of("stribeck", "torque_of_stribeck")
