"""The package's own command line, run in this process: a benchmark judges what a user gets."""

import contextlib
import io


def fpjax_command(words: list[str]) -> str:
    """Run `fpjax WORDS...`; returns what it printed.

    Raises:
        RuntimeError: where the exit code is not 0, with what was printed.
        KeyboardInterrupt: where it was interrupted or terminated.
    """
    from fpjax.cli import main

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(words)
    if code in (130, 143):
        # SIGINT or SIGTERM: the benchmark stops; this is not a failed case.
        raise KeyboardInterrupt
    if code != 0:
        raise RuntimeError(f"fpjax {words[0]} ended with code {code}: {said.getvalue().strip()}")
    return said.getvalue()
