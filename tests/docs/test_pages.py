"""What builds the pages: formulas without a network, commands that are run and whose failure is the build's."""

import importlib.util
import json
import pathlib
import re
import sys

import pytest

DOCS = pathlib.Path(__file__).parents[2] / "docs"
MARKDOWN = sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts)


def extension(name):
    for needed in ("sphinx", "latex2mathml"):
        pytest.importorskip(needed)
    spec = importlib.util.spec_from_file_location(f"docs_{name}", DOCS / "_ext" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def without_code(text):
    return re.sub(r"^```.*?^```|`[^`\n]*`", "", text, flags=re.MULTILINE | re.DOTALL)


def test_every_formula_becomes_mathml():
    convert = extension("mathml").to_mathml
    found = 0
    for page in MARKDOWN:
        text = without_code(page.read_text())
        for shown, inline in re.findall(r"\$\$(.+?)\$\$|(?<!\$)\$([^$\n]+?)\$(?!\$)", text, flags=re.DOTALL):
            made = convert((shown or inline).strip(), "block" if shown else "inline")
            assert made.startswith("<math")
            found += 1
    assert found > 30


def test_a_formula_that_cannot_be_drawn_is_an_error():
    with pytest.raises(ValueError, match="does not know a command"):
        extension("mathml").to_mathml(r"\nosuchcommand x", "inline")


def test_no_page_wants_a_script_from_elsewhere():
    conf = (DOCS / "conf.py").read_text()
    assert "mathjax" not in conf
    assert "http" not in (DOCS / "_static" / "pages.css").read_text()


def test_commands_of_a_page_are_found_in_order():
    text = "# A\n```{terminal}\n$ fpjax a --out b\n```\n```console\n$ not run\n```\n```{terminal}\n$ python c.py\n```\n"
    assert extension("terminal").commands_of(text) == ["fpjax a --out b", "python c.py"]


def test_long_notes_are_folded_and_tables_are_not():
    note, table = "note: " + "a word " * 30, "  quantity" + " " * 100 + "value"
    folded = extension("terminal").folded([note.strip(), table])
    assert folded[-1] == table
    assert all(len(line) <= 90 for line in folded[:-1])
    assert " ".join(line.strip() for line in folded[:-1]) == note.strip()


def test_every_picture_of_a_page_comes_from_a_command_above_it():
    for page in MARKDOWN:
        text = page.read_text()
        for match in re.finditer(r"^```\{picture\} (\S+)/", text, flags=re.MULTILINE):
            before = text[: match.start()]
            assert re.search(rf"^\$ .*--out {re.escape(match[1])}$", before, flags=re.MULTILINE), f"{page}: {match[1]}"


def test_outputs_are_kept_until_the_page_or_the_sources_change(tmp_path, monkeypatch):
    terminal = extension("terminal")
    monkeypatch.setattr(terminal, "PLACE", tmp_path)
    ran = []

    def run(words, cwd, **settings):
        del settings
        ran.append(words[2:])
        (cwd / "outputs.json").write_text(json.dumps([f"ran {len(ran)}"] * len(words[2:])))
        return type("Done", (), {"returncode": 0, "stdout": "", "stderr": ""})

    monkeypatch.setattr(terminal.subprocess, "run", run)
    for key, commands, count in (
        ("1", ["fpjax a"], 1),
        ("1", ["fpjax a"], 1),
        ("2", ["fpjax a"], 2),
        ("2", ["fpjax b"], 3),
    ):
        assert terminal.outputs_of("page", commands, key) == {commands[0]: f"ran {count}"}
        assert len(ran) == count


def test_a_command_that_fails_fails_the_build(tmp_path, monkeypatch):
    terminal = extension("terminal")
    monkeypatch.setattr(terminal, "PLACE", tmp_path)
    with pytest.raises(terminal.ExtensionError, match=r"(?s)a command of the page failed.*nosuch\.toml"):
        terminal.outputs_of("page", ["fpjax simulate nosuch.toml"], "key")
    assert not (tmp_path / "page.json").exists()


OTHERS = sorted(
    path.relative_to(DOCS).with_suffix("").as_posix()
    for path in MARKDOWN
    if "{terminal}" in path.read_text() and path.stem not in {"tutorial", "own_blocks"}
)  # those two have tests of their own


@pytest.mark.long
@pytest.mark.parametrize("page", OTHERS)
def test_commands_of_the_other_pages_run_and_draw(page, tmp_path, monkeypatch):
    terminal = extension("terminal")
    monkeypatch.setattr(terminal, "PLACE", tmp_path)
    text = (DOCS / f"{page}.md").read_text()
    outputs = terminal.outputs_of(page, terminal.commands_of(text), "key")
    assert all(printed.strip() for printed in outputs.values())
    for picture in re.findall(r"^```\{picture\} (\S+)", text, flags=re.MULTILINE):
        assert (tmp_path / page / picture).exists()


def test_a_page_runs_our_commands_only(tmp_path, monkeypatch):
    terminal = extension("terminal")
    monkeypatch.setattr(terminal, "PLACE", tmp_path)
    with pytest.raises(terminal.ExtensionError, match="runs fpjax and python only"):
        terminal.outputs_of("page", ["rm -r all"], "key")


def test_the_extensions_leave_the_path_alone():
    before = list(sys.path)
    extension("terminal")
    assert sys.path == before
