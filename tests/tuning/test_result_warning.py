"""Gains that are no optimum say so in print, in repr and in the JSON."""

import pytest

from tuning import Identifiability, TuningResult


def result(verdicts):
    names = tuple(verdicts)
    block = Identifiability(names, dict.fromkeys(names, 1.0), verdicts, 1.0, dict.fromkeys(names, 1.0), "forward mode")
    return TuningResult(
        method="adam", objective="estimation", references=("sine",), gains=dict.fromkeys(names, 2.0),
        start=dict.fromkeys(names, 1.0), cost=0.5, start_cost=1.0, mean=0.5, worst=0.5, cases=[[[0.5]]], simulations=1,
        simulated_steps=1, iterations=1, history=[(1, 0.5)], starts=1, diverged_starts=0, message="done",
        run_seconds=0.0, compile_seconds=0.0, identifiability=block, versions={},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("verdicts", "words"),
    [
        ({"observer.gain": "at its high bound"}, "NOT AN OPTIMUM: observer.gain at its high bound 2"),
        ({"a": "dead", "b": "dead"}, "NOT AN OPTIMUM: the cost does not depend on a or b"),
    ],
)
def test_it_is_said_everywhere(verdicts, words):
    found = result(verdicts)
    assert str(found).startswith(words)
    assert repr(found) == str(found)
    assert found.to_dict()["warning"].startswith(words)


def test_an_optimum_says_nothing_of_the_kind():
    found = result({"a": "pinned", "b": "dead"})
    assert found.warning == ""
    assert "NOT AN OPTIMUM" not in str(found)
    assert found.to_dict()["at_bounds"] == {}
