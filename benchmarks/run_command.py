"""The package's own command line in this process: what a benchmark judges is what a user gets."""

import contextlib
import io


def fpjax_command(words: list[str]) -> str:
    """Run `fpjax WORDS...`; returns what it printed.

    Raises:
        RuntimeError: with what it printed, where it does not end in 0.
        KeyboardInterrupt: where it was interrupted or terminated.
    """
    from fpjax.cli import main

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(words)
    if code in (130, 143):
        # interrupted or terminated: the benchmark stops, it is no failed case
        raise KeyboardInterrupt
    if code != 0:
        raise RuntimeError(f"fpjax {words[0]} ended with code {code}: {said.getvalue().strip()}")
    return said.getvalue()
