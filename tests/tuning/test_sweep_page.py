"""The page of a sweep and the paths that methods took over it."""

import json
import re

import numpy as np
import pytest

from fpjax import InputError
from tuning import Axis, SweepResult

AXES = (Axis("observer.gain_1", 1.0, 1e3, 7), Axis("observer.gain_2", 5.0, 25.0, 5, "linear"))
PATH = {"observer.gain_1": [2.0, 30.0, 100.0], "observer.gain_2": [6.0, 9.0, 15.0]}


def result(axes=AXES, cost=None):
    """A grid whose least cost is at (100, 15), with one diverged corner."""
    if cost is None:
        cost = sum(
            np.reshape((np.log(axis.values / middle)) ** 2, [-1 if i == place else 1 for i in range(len(axes))])
            for place, (axis, middle) in enumerate(zip(axes, (100.0, 15.0, 1.0), strict=False))
        )
        cost = 1e-3 + np.broadcast_to(cost, [axis.count for axis in axes]).copy()
        cost.flat[-1] = np.inf
    return SweepResult(axes, ("sine",), cost[..., None], "estimation", cost.size, cost.size, 1.0, {})


def content(page):
    return json.loads(re.search(r"const data = (\{.*?\});\n", page.read_text()).group(1))


def test_the_page_holds_what_was_swept_and_loads_nothing(tmp_path):
    page = result().page(tmp_path / "sweep.html", paths={"grid": PATH})
    found = content(page)
    np.testing.assert_allclose(found["axes"][0]["values"], AXES[0].values, rtol=1e-6)
    row, column = found["best"]
    assert found["axes"][0]["values"][row] == pytest.approx(100.0)
    assert found["axes"][1]["values"][column] == 15.0
    assert found["cost"][row][column] == pytest.approx(1e-3)
    assert found["cost"][-1][-1] is None  # diverged
    assert found["paths"] == [
        {"name": "grid", "colour": found["paths"][0]["colour"], "points": [[2.0, 6.0], [30.0, 9.0], [100.0, 15.0]]}
    ]
    text = page.read_text()
    assert "default-src 'none'" in text
    assert not re.search(r"(src|href)=|https?://|@import|url\(", text)


@pytest.mark.parametrize(
    "axes", [AXES[:1], (*AXES, Axis("controller.kp", 0.1, 10.0, 3)), (AXES[0], Axis("observer.gain_2", 5.0, 5.0, 1))]
)
def test_any_number_of_axes(axes, tmp_path):
    swept = result(axes)
    found = content(swept.page(tmp_path / "sweep.html"))
    assert np.shape(found["cost"]) == tuple(axis.count for axis in axes[:2])
    swept.plot(tmp_path / "sweep.png")
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_a_dense_grid_is_thinned_and_says_so(tmp_path):
    axes = (Axis("observer.gain_1", 1.0, 1e3, 900), Axis("observer.gain_2", 5.0, 25.0, 3, "linear"))
    found = content(result(axes).page(tmp_path / "sweep.html"))
    assert len(found["axes"][0]["values"]) == 300
    assert "Thinned by 3 x 1" in found["note"]


def test_a_name_cannot_end_the_script(tmp_path):
    text = result().page(tmp_path / "sweep.html", paths={"</script><b>": PATH}).read_text()
    assert "</script><b>" not in text


def test_a_sweep_of_nothing_but_diverged_runs_is_a_page_too(tmp_path):
    page = result(cost=np.full((7, 5), np.inf)).page(tmp_path / "sweep.html")
    assert np.shape(content(page)["cost"]) == (7, 5)


@pytest.mark.parametrize(
    ("path", "words"),
    [({"controller.kp": [1.0]}, "not observer.gain_1"), (PATH | {"observer.gain_1": [1.0]}, r"has \[1, 3\] values")],
)
def test_a_path_of_something_else_is_refused(path, words, tmp_path):
    for draw in (result().plot, result().page):
        with pytest.raises(InputError, match=words):
            draw(tmp_path / "sweep.png", paths={"grid": path})


def test_the_picture_names_every_path():
    axes = result().plot(paths={"grid": PATH}).axes[0]
    assert "grid" in [text.get_text() for text in axes.get_legend().get_texts()]
    assert not [line for line in result().plot().axes[0].get_lines() if line.get_label() == "grid"]


def test_labels_of_contours_do_not_lie_over_each_other():
    """A valley in front of a cliff of six decades within one row of the grid."""
    axes = (Axis("observer.gain_1", 1e-6, 1e-3, 40), Axis("observer.gain_2", 1e-4, 0.1, 40))
    down, across = np.meshgrid(np.log10(axes[0].values), np.log10(axes[1].values), indexing="ij")
    cost = 0.02 + (down - across + 2.0) ** 2 * 5.0 + 10.0 ** np.clip(60.0 * (down + 3.6), -10.0, 6.0)
    figure = result(axes, cost).plot()
    shown = figure.axes[0]
    places = [shown.transData.transform(text.get_position()) for text in shown.texts]
    assert len(places) >= 3
    apart = [np.hypot(*(a - b)) for i, a in enumerate(places) for b in places[:i]]
    assert min(apart) > 25.0  # dots
