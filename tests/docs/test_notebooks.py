"""The notebooks' cells run in order in a kernel, as the documentation runs them, and find what their text says."""

import pathlib
import re

import pytest
from public_records import EMPS, RECORDS

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")

DOCS = pathlib.Path(__file__).parents[2] / "docs"
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n((?::[^\n]*\n)*)(.*?)^```", flags=re.MULTILINE | re.DOTALL)


def cells_of(page):
    return [code for _, code in CELL.findall(page.read_text())]


@pytest.fixture
def run(monkeypatch):
    """All text that a page's cells print, and how many pictures they show."""
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))

    def run(name):
        page = DOCS / f"{name}.md"
        book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code) for code in cells_of(page)])
        resources = {"metadata": {"path": str(page.parent)}}
        nbclient.NotebookClient(book, timeout=None, kernel_name="python3", resources=resources).execute()
        outputs = [output for cell in book.cells for output in cell.outputs]
        pictures = sum("image/png" in output.get("data", {}) for output in outputs)
        return "".join(output.get("text", "") for output in outputs), pictures

    return run


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_simulate_and_tune(run):
    text, pictures = run("notebooks/simulate_and_tune")
    (coulomb, viscous) = re.findall(r"true +([\d.]+), before +\S+, after +([\d.]+)", text)
    assert float(coulomb[1]) == pytest.approx(20.0, rel=0.05)
    assert float(viscous[1]) == pytest.approx(2.0, rel=0.05)
    assert "sweep of 225 simulations" in text
    assert pictures == 3


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("at_hand", [True, False], ids=["record", "stand-in"])
def test_real_record(run, monkeypatch, tmp_path, at_hand):
    if at_hand and not EMPS.exists():
        pytest.skip("the EMPS records are not here")
    monkeypatch.setenv("FPJAX_RECORDS", str(RECORDS if at_hand else tmp_path))
    text, pictures = run("notebooks/real_record")
    assert text.startswith("DATA_EMPS.mat: the real record" if at_hand else "no real record here")
    assert "missing force: " in text
    assert "asserted: inertia_error" in text
    (mass,) = re.findall(r"^inertia ([\d.]+) kg, 90 % interval", text, flags=re.MULTILINE)
    assert float(mass) == pytest.approx(95.11, rel=0.011)  # the published deviation
    assert pictures == 2


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_log_to_c(run):
    text, pictures = run("notebooks/log_to_c")
    assert "gimbal_step" in text
    before, after = map(float, re.findall(r"machine: ([\d.]+) mrad/s recorded, ([\d.]+) mrad/s", text)[0])
    assert after < before
    assert pictures == 2


@pytest.mark.long
def test_own_blocks(run):
    text, pictures = run("own_blocks")
    assert "plant.friction.drag_coefficient" in text
    assert "cannot converge here" in text
    settled = [float(found) for found in re.findall(r"drag_coefficient, mean of the last quarter (\S+)", text)]
    assert settled[0] < 0.03
    assert settled[-1] == pytest.approx(0.05, rel=0.02)
    assert pictures == 2


def test_no_notebook_has_a_written_output():
    for page in (*(DOCS / "notebooks").glob("*.md"), DOCS / "own_blocks.md"):
        assert cells_of(page), page
        assert "```{code-cell" in page.read_text()
        assert "```text" not in page.read_text()
        assert "```console" not in page.read_text()


def test_every_file_that_a_notebook_opens_is_there():
    for page in (DOCS / "notebooks").glob("*.md"):
        for name in re.findall(r'"(\.\./\.\./[^"]+\.toml)"', page.read_text()):
            assert (page.parent / name).exists(), f"{page.name}: {name}"
