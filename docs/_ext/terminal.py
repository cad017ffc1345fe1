"""Pages that run the commands which they show: `{terminal}` prints them with their output, `{picture}` shows a file.

All commands of a page run once, in the order of the page, in one process and one folder of its own, when the page is
read: see `terminal_commands.py`. Their outputs are kept as long as the page's commands and the package's sources stay
what they are.
"""

import hashlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import textwrap
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

DOCS = pathlib.Path(__file__).parents[1]
ROOT = DOCS.parent
PLACE = DOCS / "_build" / "terminal"
FENCE = re.compile(r"^(`{3,})\{terminal\}[^\n]*\n(.*?)^\1\s*$", flags=re.MULTILINE | re.DOTALL)
PROMPT = "$ "
WIDTH = 90  # characters of a line that the page shows without scrolling


def fingerprint(*more: str) -> str:
    """Of all that an output depends on besides the page: the package's sources, the examples, the versions."""
    digest = hashlib.sha256("\n".join((sys.version, *more)).encode())
    for folder in ("fpjax", "tuning", "examples"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".toml", ".css"}:
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def commands_of(text: str) -> list[str]:
    """Every command of a page, in its order."""
    lines = [line for _, body in FENCE.findall(text) for line in body.splitlines()]
    return [line.removeprefix(PROMPT) for line in lines if line.startswith(PROMPT)]


def outputs_of(page: str, commands: list[str], key: str) -> dict[str, str]:
    """What each command printed; they are run where that is not known yet.

    Raises:
        ExtensionError: where a command fails, with what it printed.
    """
    folder = PLACE / page
    kept = folder.with_suffix(".json")
    wanted = {"key": key, "commands": commands}
    if kept.exists() and folder.is_dir():
        said = json.loads(kept.read_text())
        if {name: said[name] for name in wanted} == wanted:
            return said["outputs"]
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for example in (ROOT / "examples").glob("*.toml"):
        shutil.copy(example, folder)
    script = DOCS / "_ext" / "terminal_commands.py"
    environment = {**os.environ, "MPLBACKEND": "Agg", "COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, str(script), *commands],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise ExtensionError(f"{page}: a command of the page failed.\n{done.stdout}\n{done.stderr}")
    outputs = dict(zip(commands, json.loads((folder / "outputs.json").read_text()), strict=True))
    kept.write_text(json.dumps({**wanted, "outputs": outputs}, indent=1))
    return outputs


def folded(lines: list[str]) -> list[str]:
    """Sentences no wider than the page, as a terminal folds them; tables as they are.

    Args:
        lines: that a command printed.
    """
    found = []
    for line in lines:
        sentence = line.startswith(("note: ", "warning: ")) and len(line) > WIDTH
        found += textwrap.wrap(line, WIDTH, subsequent_indent="  ", break_on_hyphens=False) if sentence else [line]
    return found


class Terminal(SphinxDirective):
    """Commands after a `$`, each with what it printed."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        lines = []
        outputs: dict[str, str] | None = None
        if self.config.execute_pages:
            text = pathlib.Path(self.env.doc2path(self.env.docname)).read_text()
            outputs = outputs_of(self.env.docname, commands_of(text), self.config.sources_fingerprint)
        for line in self.content:
            lines.append(line)
            if outputs is not None and line.startswith(PROMPT):
                lines += folded(outputs[line.removeprefix(PROMPT)].rstrip().splitlines())
        shown = "\n".join(lines)
        block = nodes.literal_block(shown, shown, language="console", classes=["terminal"])
        return [block]


class Picture(SphinxDirective):
    """A picture that a command of this page has drawn; the content is its caption."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar[Any] = {
        "alt": directives.unchanged_required,
        "width": directives.length_or_percentage_or_unitless,
    }

    def run(self) -> list[nodes.Node]:
        if not self.config.execute_pages:
            return []
        uri = f"/{(PLACE / self.env.docname).relative_to(DOCS).as_posix()}/{self.arguments[0]}"
        if not (DOCS / uri[1:]).is_file():
            raise self.error(f"no command above has drawn {self.arguments[0]}")
        image = nodes.image(uri=uri, alt=self.options.get("alt", self.arguments[0]))
        if "width" in self.options:
            image["width"] = self.options["width"]
        figure = nodes.figure("", image)
        if self.content:
            caption = nodes.caption("", "", *self.parse_inline(" ".join(self.content))[0])
            figure += caption
        return [figure]


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_directive("terminal", Terminal)
    app.add_directive("picture", Picture)
    app.add_config_value("execute_pages", True, "env")
    app.add_config_value("sources_fingerprint", "", "env")
    return {"parallel_read_safe": False, "parallel_write_safe": True}
