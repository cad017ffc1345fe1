"""Run the commands of one page in this folder and write what each printed to outputs.json.

`fpjax ...` runs in this process, which imports and compiles once for the whole page; `python ...` in one of its own.
"""

import contextlib
import io
import json
import pathlib
import shlex
import subprocess
import sys

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))


def run(command: str) -> tuple[int, str]:
    """(exit code, what was printed to either stream)."""
    words = shlex.split(command)
    if words[0] == "python":
        words[1:2] = [str(ROOT / words[1])]
        done = subprocess.run(
            [sys.executable, *words[1:]], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        return done.returncode, done.stdout
    if words[0] != "fpjax":
        raise SystemExit(f"{command}: a page runs fpjax and python only")
    from fpjax.cli import main

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        code = main(words[1:])
    return code, printed.getvalue()


def main() -> None:
    outputs = []
    for command in sys.argv[1:]:
        code, printed = run(command)
        outputs.append(printed)
        if code:
            raise SystemExit(f"{command}: exit code {code}\n{printed}")
    pathlib.Path("outputs.json").write_text(json.dumps(outputs))


if __name__ == "__main__":
    main()
