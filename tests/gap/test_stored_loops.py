"""The diagnosis' loops on disk: the same numbers, told apart by all that their traces depend on."""

import pathlib
import sys
from dataclasses import replace

import numpy as np
import pytest
from gap_search import search_of
from numpy_machine import record

from fpjax.compiled.stored import PACKAGE, SOURCES, store_in
from fpjax.gap.effects.vocabulary import EFFECTS
from fpjax.gap.machine import FEATURES
from fpjax.gap.simulate import hidden_states, replay
from fpjax.gap.simulate.family import Runner, make_family, window_fields
from fpjax.gap.simulate.hidden_states import HiddenStates

STRUCTURES = ("rigid", "bristles", "transmission")


@pytest.fixture(scope="module")
def search():
    return search_of(record(seconds=6.0))


@pytest.fixture
def folder(tmp_path):
    """Loops made within the test are stored here."""
    for made in (replay.residual_kernel, hidden_states._kernel, hidden_states._whole_kernel):
        made.cache_clear()
    store_in(tmp_path)
    yield tmp_path
    store_in(None)


def loops(search, structure, features=FEATURES, effects=EFFECTS):
    """Runner and hidden states (None of a rigid machine) of a family."""
    family = make_family((structure, features), search.nominal, effects, search.setting)
    hidden = None if structure == "rigid" else HiddenStates(family, search.records, search.tables)
    return Runner(family, search.records, search.tables), hidden


def lanes(search, runner):
    log, family = search.records[0], runner.family
    vector = np.repeat(family.neutral(search.setting)[:, None], 3, 1)
    vector[family.index("inertia")] *= [1.0, 1.1, 0.9]
    return vector, np.zeros((family.states, 3)), window_fields(log, np.arange(3), np.zeros((2, len(log.starts))))


def called_files(function):
    """Files of the package of which a function runs within a call."""
    seen = set()
    sys.setprofile(lambda frame, event, argument: seen.add(frame.f_code.co_filename))
    try:
        function()
    finally:
        sys.setprofile(None)
    return {pathlib.Path(name).relative_to(PACKAGE) for name in seen if name.startswith(str(PACKAGE))}


@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_stored_loop_gives_the_same_numbers(search, folder, structure, monkeypatch):
    runner, _ = loops(search, structure)
    given = lanes(search, runner)
    stored = runner.run(0, *given)
    assert len([path for path in folder.rglob("*") if path.is_file()]) == 1
    replay.residual_kernel.cache_clear()
    monkeypatch.setattr(replay, "begin", None)  # it is not traced again
    again = loops(search, structure)[0].run(0, *given)  # from the file
    monkeypatch.undo()
    store_in(None)
    plain = runner.run(0, *given)
    for found in (again, plain):
        for one, other in zip(found, stored, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_all_that_a_trace_calls_is_among_the_sources(search, folder, structure):
    runner, hidden = loops(search, structure)
    seen = called_files(lambda: runner.run(0, *lanes(search, runner)))
    if hidden is not None:
        vector = runner.family.neutral(search.setting)[:, None]
        seen |= called_files(lambda: hidden.centers(vector, 0, np.arange(1)))
        if structure == "transmission":
            seen |= called_files(lambda: hidden.shafts(vector, 0))
    assert pathlib.Path("gap/simulate/replay.py") in seen  # what is looked at is a trace
    assert pathlib.Path("blocks/friction/general.py") in seen
    missing = {path for path in seen if not any(path.is_relative_to(source) for source in SOURCES)}
    assert not missing


def test_every_family_has_a_program_of_its_own(search, folder):
    made_of = [
        loops(search, structure, features)[0].kernel.made_of
        for structure in STRUCTURES
        for features in ((), FEATURES[:1], FEATURES)
    ]
    made_of += [
        Runner(loops(search, "rigid")[0].family, search.records, search.tables, fine=True).kernel.made_of,
        *(one.run.made_of for structure in STRUCTURES[1:] for one in loops(search, structure)[1:]),
        loops(search, "transmission")[1].whole.made_of,
    ]
    assert None not in made_of
    assert len(set(made_of)) == len(made_of)


def test_a_users_own_effect_is_not_taken_for_the_packages(search, folder):
    own = replace(EFFECTS[3], name="mine"), replace(EFFECTS[3])  # another name, and the name of another law
    for effect in own:
        kernel = loops(search, "rigid", FEATURES, (*EFFECTS[:3], effect))[0].kernel
        assert kernel.made_of is None
