"""Model files that were once taken without a word: each is refused, or said something about, in one sentence."""

import dataclasses
import pathlib
import re

import pytest

from fpjax import InputError, dump_model, load_model

CORPUS = sorted((pathlib.Path(__file__).parent / "corpus").glob("*.toml"))
LONGEST = 300  # characters of a sentence that is read


def one_sentence(text):
    return "\n" not in text and len(text) <= LONGEST


@pytest.mark.parametrize("path", CORPUS, ids=[path.stem for path in CORPUS])
def test_the_corpus(path):
    kind, pattern = re.fullmatch(r"# (refused|said): (.*)", path.read_text().splitlines()[0]).groups()
    if kind == "refused":
        with pytest.raises(InputError, match=pattern) as refused:
            load_model(path)
        assert one_sentence(str(refused.value))
        assert re.search(r"\[\w+\]", str(refused.value))  # says where
        return
    notes = [note for note in load_model(path).notes if re.search(pattern, note)]
    assert len(notes) == 1
    assert one_sentence(notes[0])


def test_the_corpus_is_there():
    assert len(CORPUS) >= 30


@pytest.mark.parametrize(
    "change",
    [
        ("viscous = 0.02", "viscous = 0.02\nviscous_difference = 0.02"),
        ("viscous = 0.02", "viscous = 0.02\ncoulomb_difference = -0.4"),
        ("viscous = 0.02", "viscous = 0.02\ndrag_coefficient = 0.0"),
        ("frequency = 250.0", "frequency = 100.0"),
        ("dt = 1e-3", "dt = 1e-6"),
        ("inertia = 0.1", "inertia = 1e-9"),
        ('type = "pi"\nkp = 10.0\nki = 50.0', 'type = "lead"\ngain = 3.0\nzero = 5.0\npole = 50.0'),
        (
            'type = "pi"\nkp = 10.0\nki = 50.0',
            'type = "transfer_function"\nnumerator = [3.0, 1.0]\ndenominator = [1.0, 0.0]',  # a pole at zero is a PI's
        ),
        # less friction than the nominal, and still friction
        (
            "[controller]",
            '[[learned]]\nof = "velocity"\nat = [-1.0, 0.0, 1.0]\ntorque = [0.3, 0.0, -0.3]\n[controller]',
        ),
        ("[controller]", "[actuator]\nlimit = 5.0\ndead_zone = 0.1\n[controller]"),
    ],
)
def test_what_a_machine_can_be_is_taken_without_a_word(change):
    text = (pathlib.Path(__file__).parent / "corpus" / "sine_of_four_samples.toml").read_text()
    model = load_model(text.replace("frequency = 250.0", "frequency = 100.0").replace(*change))
    assert not [note for note in model.notes if "steepness" not in note]
    assert dataclasses.is_dataclass(model)
    assert dump_model(model)
