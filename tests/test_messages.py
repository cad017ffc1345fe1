"""Messages: every one in the source, and what becomes of names without an end."""

import ast
import pathlib
import warnings

import pytest
from sentences import faults

from fpjax import FpjaxWarning, InputError, load_model, read_log
from fpjax.cli import main
from fpjax.errors import LONGEST, readable

REPO = pathlib.Path(__file__).parents[1]
FILLED = 200  # characters that the values of a template may take before it is cut


def template(node):
    """A message with a word for each value in it; None where it is put together elsewhere."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        parts = [part.value if isinstance(part, ast.Constant) else ast.unparse(part) for part in node.values]
        return "".join(str(part) for part in parts)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        sides = template(node.left), template(node.right)
        return None if None in sides else "".join(sides)
    return None


def messages():
    for package in ("fpjax", "tuning"):
        for path in sorted((REPO / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if not isinstance(node, ast.Call) or not node.args:
                    continue
                name = getattr(node.func, "id", getattr(node.func, "attr", ""))
                if name in ("InputError", "Suspicion", "DivergedError", "append", "say", "warn"):
                    text = template(node.args[-1] if name == "say" else node.args[0])
                    if text is not None and len(text.split()) > 6:
                        yield f"{path.relative_to(REPO)}:{node.lineno}", text


def test_no_message_of_the_source_says_a_thing_twice_or_too_much():
    found = dict(messages())
    assert len(found) > 300
    for where, text in found.items():
        assert len(text) < LONGEST - FILLED + 100, where  # the values' own expressions are a part of it
        assert not [fault for fault in faults(text) if "twice" in fault or "line" in fault], where


LONG = "x" * 5000


@pytest.mark.parametrize(
    "read",
    [
        lambda: load_model(f"{LONG} = 1"),
        lambda: load_model(f"[{LONG}]\na = 1"),
        lambda: load_model(f'[plant]\ntype = "{LONG}"\n[friction]\ntype = "none"\n[simulation]\ndt = 1e-3'),
        lambda: load_model(f'[plant]\n"{LONG}\\n{LONG}" = 1\n[friction]\ntype = "none"\n[simulation]\ndt = 1e-3'),
        lambda: read_log({LONG: [1.0], "torque": [1.0]}),
        lambda: read_log({"time": [1.0]}, columns={"torque": LONG}),
        lambda: read_log({f"{name}{LONG}": [1.0] for name in range(30)}),
        lambda: read_log({"time": [1.0]}, columns=f"torque={LONG}*{LONG}:{LONG}"),
        lambda: read_log(LONG),
        lambda: read_log(f"{LONG[:200]}/{LONG[:200]}/{LONG[:200]}.csv"),
    ],
)
def test_names_without_an_end_are_cut(read):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FpjaxWarning)
        with pytest.raises(InputError) as refused:
            read()
    assert not faults(str(refused.value)), str(refused.value)


@pytest.mark.parametrize("words", [[LONG], ["simulate", LONG], ["inspect", f"{LONG}.csv"], ["tune", "a\nb.toml"]])
def test_so_are_words_of_the_command_line(words, capsys):
    try:
        code = main(words)
    except SystemExit as exit:
        code = exit.code
    assert code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert len(line) < LONGEST + 40


def test_a_message_that_is_read_is_left_as_it_is():
    for text in ("", "kp = -1 must be zero or more.", "a " * (LONGEST // 2 - 1)):
        assert readable(text) == text
    path = "/a/long/path/" + 180 * "y"
    assert path in str(InputError(f"{path} does not exist: check the path. {LONG}"))
    assert str(FpjaxWarning(LONG)).startswith("xxx")
    assert len(str(FpjaxWarning("y " * 5000))) <= LONGEST
