"""The thesis' printed numbers, at the tolerances to which an independent reproduction found them."""

import json
import math
import os
import pathlib
import subprocess
import sys

import jax
import numpy as np
import pytest

from benchmarks.__main__ import main
from benchmarks.thesis import chapter2, chapter3, chapter4, command, presets, search, small_steps
from benchmarks.thesis.cells import NOT_REPRODUCED, REPRODUCED, SOLVER_SPECIFIC, Cell, Printed, judge
from benchmarks.thesis.changing_parameters import recoveries
from benchmarks.thesis.figures import all_figures, draw_all
from fpjax import InputError
from fpjax.output import plotting

# (cell, what the independent reproduction obtained, tolerance there)
CHAPTER_2 = [
    ("2.2/g1/alpha=0/velocity", 0.12745, 0.005),
    ("2.2/g1/alpha=0/friction", 19.996, 0.005),
    ("2.2/g1/alpha=1/velocity", 0.07326, 0.005),
    ("2.2/g1/alpha=10/velocity", 0.05148, 0.005),
    ("2.2/g1/alpha=100/velocity", 0.04859, 0.005),
    ("2.2/g1/alpha=500/velocity", 0.04754, 0.005),
    ("2.2/g1/alpha=1/friction", 10.118, 0.025),
    ("2.2/g1/alpha=10/friction", 1.353, 0.025),
    ("2.2/g1/alpha=100/friction", 0.3808, 0.025),
    ("2.2/g1/alpha=500/friction", 0.2250, 0.025),
    ("2.3/g2/alpha=1/velocity", 0.06232, 0.005),
    ("2.3/g2/alpha=10/velocity", 0.04947, 0.005),
    ("2.3/g2/alpha=100/velocity", 0.04686, 0.005),
    ("2.3/g2/alpha=500/velocity", 0.04647, 0.005),
    ("2.3/g2/alpha=1/friction", 6.718, 0.025),
    ("2.3/g2/alpha=10/friction", 0.7589, 0.025),
    ("2.3/g2/alpha=100/friction", 0.1284, 0.025),
    ("2.3/g2/alpha=500/friction", 0.0690, 0.025),
    ("2.4/g3/alpha=1,lambda=1/velocity", 0.07682, 0.005),
    ("2.4/g3/alpha=100,lambda=1/velocity", 0.04864, 0.005),
    ("2.4/g3/alpha=10,lambda=10/velocity", 0.04995, 0.005),
    ("2.4/g3/alpha=10,lambda=100/velocity", 0.04961, 0.005),
    ("2.4/g3/alpha=1,lambda=1/friction", 11.071, 0.025),
    ("2.4/g3/alpha=100,lambda=1/friction", 0.3884, 0.025),
    ("2.4/g3/alpha=10,lambda=10/friction", 0.8624, 0.025),
    ("2.4/g3/alpha=10,lambda=100/friction", 0.7861, 0.025),
    ("2.5/mfp/velocity", 0.04721, 0.025),
    ("2.5/mfp/friction", 0.1935, 0.025),
    ("2.5/mfp/standard_deviation", 0.705, 0.025),
]
DESIGN = [
    ("3/lead/alpha", 1.698),
    ("3/lead/zero", 216.96),
    ("3/lead/pole", 368.48),
    ("3/lead/gain", 57.04),
    ("3/plant_phase_at_45_Hz", -148.12),
    ("3/lead/crossover", 45.03),
    ("3/lead/phase", -133.20),
    ("3/lead/margin", 46.80),
    ("3/lead/bandwidth", 68.01),
]
CHAPTER_4 = [
    ("4.4/lambda=0/velocity", 0.12080, 0.02),
    ("4.4/lambda=0/friction", 20.0, 0.02),
    ("4.4/lambda=1/velocity", 0.01618, 0.02),
    ("4.4/lambda=1/friction", 3.426, 0.02),
    ("4.4/lambda=10/velocity", 0.00900, 0.02),
    ("4.4/lambda=10/friction", 1.628, 0.02),
    ("4.5/lambda=25/steepness", 25.0, 0.01),
    ("4.7/extension=1/compensated", 0.00478, 0.02),
    ("4.7/extension=2/compensated", 0.00464, 0.02),
    ("4.7/extension=1/uncompensated", 0.1157, 0.02),
    # the next ones only with this very solver and step
    ("4.4/lambda=100/velocity", 0.00573, 0.02),
    ("4.4/lambda=100/friction", 0.419, 0.02),
    ("4.4/lambda=500/velocity", 0.00540, 0.02),
    ("4.4/lambda=500/friction", 0.168, 0.03),
    ("fig4.2/alpha_2=10,alpha_1=10/viscous", 2.509, 0.001),
    ("fig4.2/alpha_2=100,alpha_1=100/viscous", 0.405, 0.002),
    ("fig4.2/alpha_2=100,alpha_1=500/viscous", 1.985, 0.001),
]


@pytest.fixture(scope="module")
def second():
    return chapter2.obtain(presets.PRINTED)


@pytest.fixture(scope="module")
def fourth():
    return chapter4.obtain(presets.PRINTED)


@pytest.fixture(scope="module")
def searched():
    return search.obtain(presets.PRINTED)


@pytest.mark.parametrize(("cell", "value", "tolerance"), CHAPTER_2)
def test_chapter_2(second, cell, value, tolerance):
    assert second[cell] == pytest.approx(value, rel=tolerance)


def test_overshoot_of_the_nominal_input(second):
    assert second["fig2.6/g1/alpha=500/overshoot"] == pytest.approx(17.0, abs=1.0)


@pytest.mark.parametrize(("cell", "value"), DESIGN)
def test_lead_design(cell, value):
    assert chapter3.design()[cell] == pytest.approx(value, rel=0.005)


@pytest.mark.parametrize(("cell", "value", "tolerance"), CHAPTER_4)
def test_chapter_4(fourth, cell, value, tolerance):
    assert fourth[cell] == pytest.approx(value, rel=tolerance)


def test_algorithm_1_finds_the_gains_of_the_reproduction(searched):
    assert searched["4.2/constant/alpha_2"] == pytest.approx(59.929, abs=1e-3)
    assert searched["4.2/constant/alpha_1"] == pytest.approx(8.459, abs=1e-3)
    assert searched["4.2/constant/iterations"] == 29
    assert searched["4.2/constant/error_after_20_iterations"] == pytest.approx(0.01245, abs=1e-5)
    assert searched["4.2/sine/alpha_2"] == pytest.approx(72.5, abs=0.05)
    assert searched["4.2/sine/alpha_1"] == pytest.approx(298.4, abs=0.05)
    assert searched["4.2/sine/iterations"] == 30
    assert searched["4.6/extension=1/alpha_2"] == pytest.approx(10.78, abs=0.005)
    assert searched["4.6/extension=1/alpha_1"] == pytest.approx(337.5, abs=0.05)


def test_a_square_of_half_a_period_is_the_constant(searched):
    for row in ("alpha_2", "alpha_1", "iterations"):
        assert searched[f"4.2/square/{row}"] == searched[f"4.2/constant/{row}"]


def test_every_printed_cell_is_obtained(second, fourth, searched):
    for printed, found in (
        (chapter2.PRINTED, second),
        (chapter4.PRINTED, fourth),
        (search.PRINTED, searched),
    ):
        assert {one.cell for one in printed} <= set(found)
        assert all(math.isfinite(found[one.cell]) for one in printed)


@pytest.mark.slow
def test_the_efp_estimate_of_b_moves_with_the_solver_and_the_step():
    for setting, expected in (
        (presets.OTHER_SOLVER, (2.47, 0.34, 1.66)),
        (presets.FINEST_STEP, (2.35, 0.24, 1.18)),
    ):
        found = chapter4.obtain(setting)
        for (gain_2, gain_1), value in zip(chapter4.FIG_4_2_GAINS, expected, strict=True):
            cell = f"fig4.2/alpha_2={gain_2:g},alpha_1={gain_1:g}/viscous"
            assert found[cell] == pytest.approx(value, abs=0.006)


def test_limits_as_the_step_goes_to_zero():
    found = small_steps.obtain(presets.FINEST_STEP)
    expected = {1: (6.704, 0.06233), 10: (0.7535, 0.04946), 100: (0.1177, 0.04685), 500: (0.0504, 0.04645)}
    for alpha, (friction, velocity) in expected.items():
        assert found[f"limit/2.3/g2/alpha={alpha}/friction"] == pytest.approx(friction, rel=0.002)
        assert found[f"limit/2.3/g2/alpha={alpha}/velocity"] == pytest.approx(velocity, rel=0.001)
    assert found["limit/2.3/g2/alpha=0/velocity"] == pytest.approx(0.1276, rel=0.002)


def test_verdicts_follow_from_the_numbers():
    printed = Printed("a", "0.50", 0.01)
    assert Cell(printed, 0.504, {"rk4": 0.506}).verdict == REPRODUCED
    assert Cell(printed, 0.504, {"rk4": 0.52}).verdict == SOLVER_SPECIFIC
    assert Cell(printed, 0.52, {"rk4": 0.50}).verdict == NOT_REPRODUCED
    assert Cell(printed, 0.509, {}).verdict == REPRODUCED  # cut off to 0.50
    assert Cell(printed, math.nan, {}).verdict == NOT_REPRODUCED
    assert Cell(Printed("a", "1.1e-3", 0.0), 1.149e-3, {}).verdict == REPRODUCED  # rounds to 1.1e-3
    assert Cell(Printed("a", "29", 0.0), 30.0, {}).verdict == NOT_REPRODUCED
    assert Cell(Printed("a", "30", below=True), 30.2, {}).verdict == NOT_REPRODUCED
    assert Cell(Printed("a", "-148"), -148.12, {}).verdict == REPRODUCED


def test_a_reason_belongs_to_the_longest_beginning_of_the_cell_and_not_to_reproduced_ones():
    printed = [Printed("1/a", "1"), Printed("1/b", "1"), Printed("1/c", "1")]
    found = {"1/a": 2.0, "1/b": 2.0, "1/c": 1.0}
    cells = judge(printed, found, {}, {"1/": "all", "1/b": "this"})
    assert [cell.reason for cell in cells] == ["all", "this", ""]


def documented():
    """Rows of the page's table: cell, printed, obtained, verdict."""
    lines = (
        (pathlib.Path(__file__).parents[2] / "docs" / "thesis.md").read_text().split("## Every cell")[1].splitlines()
    )
    rows = [[word.strip() for word in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    return rows[2:]


def test_the_page_lists_every_cell():
    printed = [one for chapter in command.chapters().values() for one in chapter.printed]
    assert [row[:2] for row in documented()] == [[one.cell, "< " * one.below + one.text] for one in printed]


def test_other_truths():
    found = {(one.observer, one.truth): one for one in recoveries()}
    # what EFP calls b is its start-up transient
    expected = {0.0: 1.989, 1.0: 1.991, 2.0: 1.993, 4.0: 1.996, 8.0: 2.003, 20.0: 2.022}
    for truth, value in expected.items():
        assert found["EFP", truth].estimate == pytest.approx(value, abs=2e-3)
    for truth in (5.0, 10.0, 20.0):
        assert abs(found["NFP", truth].error) < 4e-4
    for truth in (1.0, 2.0, 5.0, 20.0):
        assert abs(found["extension 2", truth].error) < 0.021
    assert abs(found["extension 1", 15.0].error) > 0.03


@pytest.mark.slow
def test_all_cells_with_their_verdicts():
    cells = command.all_cells(quick=False)
    verdicts = {cell.printed.cell: cell.verdict for cell in cells}
    for (name, _, obtained, verdict), cell in zip(documented(), cells, strict=True):
        assert verdict == cell.verdict, name
        assert cell.obtained == pytest.approx(float(obtained), rel=0.02), name  # chatter remembers every rounding
    reproduced = [cell for cell, *_ in CHAPTER_2 if cell not in SPECIFIC] + [cell for cell, _ in DESIGN]
    reproduced += ["4.4/lambda=1/velocity", "4.4/lambda=10/friction", "4.5/lambda=25/steepness"]
    reproduced += ["4.7/extension=1/compensated", "4.7/extension=2/compensated", "fig2.6/g1/alpha=500/overshoot"]
    assert {cell: verdicts[cell] for cell in reproduced} == dict.fromkeys(reproduced, REPRODUCED)
    assert {cell: verdicts[cell] for cell in SPECIFIC} == dict.fromkeys(SPECIFIC, SOLVER_SPECIFIC)
    missed = [cell for cell in verdicts if cell.startswith(("3.4/", "4.2/chirp", "4.2/triangular", "4.2/square"))]
    missed += ["3/pi/overshoot", "4.7/extension=1/uncompensated", "2.5/mfp/equals_table_2.3/friction"]
    missed += ["4.6/extension=2/alpha_1", "4.6/extension=2/alpha_2", "abstract/largest_velocity_reduction"]
    assert {cell: verdicts[cell] for cell in missed} == dict.fromkeys(missed, NOT_REPRODUCED)


SPECIFIC = (
    "2.3/g2/alpha=100/friction",
    "2.3/g2/alpha=500/friction",
    "4.4/lambda=100/velocity",
    "4.4/lambda=100/friction",
    "4.4/lambda=500/velocity",
    "4.4/lambda=500/friction",
    "fig4.2/alpha_2=10,alpha_1=10/viscous",
    "fig4.2/alpha_2=100,alpha_1=100/viscous",
    "fig4.2/alpha_2=100,alpha_1=500/viscous",
    "fig4.11/lambda=1/oscillates",
    "4.2/sine/alpha_2",
    "4.2/sine/alpha_1",
)


def test_command_writes_the_cells(tmp_path, monkeypatch, capsys):
    chapters = command.chapters()
    monkeypatch.setattr(command, "chapters", lambda: {"limits": chapters["limits"]})
    out = tmp_path / "made" / "here"
    assert main(["thesis", "--out", str(out), "--quick", "--no-figures"]) == 0
    rows = json.loads((out / "thesis.json").read_text())
    assert [row["cell"] for row in rows] == [one.cell for one in small_steps.PRINTED]
    for row in rows:
        assert list(row) == ["cell", "printed", "obtained", "relative_error", "verdict"]
        assert row["relative_error"] == pytest.approx((row["obtained"] - row["printed"]) / row["printed"])
        assert row["verdict"] in (REPRODUCED, SOLVER_SPECIFIC, NOT_REPRODUCED)
    details = json.loads((out / "thesis_details.json").read_text())
    assert all(row["reason"] for row in details if row["verdict"] != REPRODUCED)
    run = json.loads((out / "run.json").read_text())
    assert run["versions"]["jax"] == jax.__version__
    assert run["status"] == "completed"
    assert set(run["outputs"]) == {"thesis.json", "thesis_details.json", "recoveries.json", "thesis.md"}
    assert 0.0 < run["seconds"]["cells"] <= run["seconds"]["total"]
    printed = capsys.readouterr().out
    assert all(row["cell"] in printed for row in rows)
    assert f"{len(rows)} cells:" in printed


def test_an_unwritable_folder_is_one_sentence(tmp_path, capsys):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    assert main(["thesis", "--out", str(blocked / "below")]) == 2
    said = capsys.readouterr().err.strip()
    assert said.count("\n") == 0
    assert str(blocked) in said


def test_an_interrupted_run_leaves_the_earlier_results_alone(tmp_path, monkeypatch):
    def interrupted(**_):
        raise KeyboardInterrupt

    (tmp_path / "thesis.json").write_text("[1]")
    monkeypatch.setattr(command, "all_cells", interrupted)
    assert main(["thesis", "--out", str(tmp_path)]) == 130
    assert (tmp_path / "thesis.json").read_text() == "[1]"
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.json"]


def test_help_does_not_import_jax():
    code = (
        "import sys\nfrom benchmarks.__main__ import main\ntry: main(['thesis', '--help'])\nexcept SystemExit: pass\n"
    )
    code += "assert 'jax' not in sys.modules\n"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=dict(os.environ), cwd=os.getcwd())


def test_a_figure_is_drawn_for_every_number():
    drawn = {tuple(int(word) for word in stem.split("_")[1:]) for stem in all_figures()}
    wanted = {(2, n) for n in range(4, 17)} | {(3, n) for n in range(2, 13)} | {(4, n) for n in range(2, 14)}
    assert drawn == wanted


def test_figures_are_pictures(tmp_path):
    from matplotlib.image import imread

    for path in draw_all(tmp_path, names=("figure_2_10", "figure_3_03", "figure_2_12")):
        picture = imread(path)
        assert picture.shape[1] > 600
        assert picture[..., :3].std() > 0.05
    assert not list(tmp_path.glob(".*"))


@pytest.mark.slow
def test_all_figures(tmp_path):
    assert len(draw_all(tmp_path)) == len(all_figures())


def test_thinning_keeps_the_peaks():
    time = np.linspace(0.0, 1.0, 100_003)
    signal = np.sin(40.0 * time)
    signal[77_777] = 9.0
    signal[-3] = -5.0
    kept_time, kept = plotting.thin(time, signal, points=1000)
    assert len(kept) < 1200
    assert kept.max() == 9.0
    assert kept.min() == -5.0
    assert kept_time[0] == 0.0
    assert kept_time[-1] == 1.0
    assert np.max(np.abs(np.interp(time, kept_time, kept) - signal)[:70_000]) < 0.1


def test_a_picture_that_cannot_be_written_says_so(tmp_path):
    (tmp_path / "file").write_text("")
    figure, _ = plotting.new_figure()
    with pytest.raises(InputError, match="cannot be written"):
        plotting.save(figure, tmp_path / "file" / "picture.png")
