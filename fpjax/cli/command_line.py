"""The command line: parses it, runs one command, and turns every error into one sentence and an exit code."""

import argparse
import contextlib
import difflib
import gc
import importlib
import os
import signal
import sys
import threading
import types
import warnings
from collections.abc import Iterator
from typing import Any, NoReturn

from .._version import __version__
from ..errors import FpjaxWarning, InputError
from .closed_output import reader_may_leave

COMMANDS = {
    "simulate": "run a servo.toml, or replay a log through it, and print the errors",
    "sweep": "the cost on a dense grid of gains",
    "tune": "gains by gradients, Algorithm 1 or Nelder-Mead",
    "estimate": "run an observer over a log: friction estimates against least squares",
    "inspect": "what is in a log, what can be identified from it, and a first servo.toml",
    "diagnose": "where simulation and log differ, which effect causes it, how far the gap shrinks",
    "plan": "which run to record next: one that shows every effect, or that separates the causes a diagnosis left open",
    "improve": "gains that follow better in nearly every machine that a log leaves possible",
    "export": "the control law as C for a drive, the mechanics as MuJoCo or URDF, both checked",
    "demo": "simulate, tune and compare on an embedded example, in a minute",
}
INTERRUPTED, TERMINATED = 130, 143
AGAIN = 0.05  # after which a signal is sent again that came where its exception is lost [s]
EPILOG = """\
a first hour:
  fpjax demo --out demo                                simulate, tune, compare: pictures in demo/
  fpjax inspect run.csv --out look                     what is in a log, and look/servo.toml as a first model
  fpjax estimate run.csv --model look/servo.toml       Coulomb and viscous friction over time
  fpjax diagnose run.csv --model look/servo.toml --out why
  fpjax improve run.csv --model servo.toml --diagnosis why --out better    gains for the machine that was found

exit codes: 0 done, 2 bad input (one sentence on stderr), 130 interrupted, 143 terminated (what is finished is kept)
"""


class _Parser(argparse.ArgumentParser):
    """A parser whose error message is one sentence."""

    def error(self, message: str) -> NoReturn:
        sentence = message[:1].upper() + message[1:]
        print(f"{self.prog}: {sentence}; see {self.prog} --help.", file=sys.stderr)
        raise SystemExit(2)


def make_parser(chosen: str | None) -> argparse.ArgumentParser:
    """The parser; only the chosen command's module is imported.

    Args:
        chosen: the command on the command line, None where there is none.
    """
    parser = _Parser(
        prog="fpjax",
        description="Simulate, tune and diagnose servo loops with friction.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"fpjax {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        command = commands.add_parser(
            name, help=summary, description=summary[0].upper() + summary[1:] + ".",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        if name == chosen:
            importlib.import_module(f"fpjax.cli.{name}").add_arguments(command)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: the arguments after `fpjax`; None for those of the process.

    Returns:
        The exit code: 0, 2 after one sentence on bad input, 130 after Ctrl-C, 143 after SIGTERM, 1 for a defect of
        fpjax.
    """
    own_process = argv is None
    words = sys.argv[1:] if argv is None else argv
    if own_process:
        # jax and matplotlib hold a million objects that are never garbage: with the default thresholds the collector
        # would walk them again and again.
        gc.set_threshold(50_000, 20, 20)
    with _terminable(), reader_may_leave() as output:
        try:
            code = _run(words)
        except SystemExit:  # argparse's, after --help or a mistyped option
            if _lost(output):
                raise SystemExit(2) from None
            raise
        if _lost(output):
            code = code or 2
    if own_process and code >= INTERRUPTED:
        os._exit(code)  # a regular exit would wait for a compilation that runs on another thread
    return code


class _Terminated(KeyboardInterrupt):
    """A request of the system to end; finished results are kept, as after Ctrl-C."""


def exit_code(error: KeyboardInterrupt) -> int:
    """The exit code of a command that an interrupt ended: 143 after SIGTERM, 130 after Ctrl-C."""
    return TERMINATED if isinstance(error, _Terminated) else INTERRUPTED


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Within the block SIGTERM, and SIGHUP where it is not ignored, end the command as an interrupt does.

    Neither they nor Ctrl-C are lost where Python drops an exception.
    """
    before: dict[int, Any] = {}
    collecting, waiting = threading.Event(), list[int]()

    def send_again(number: int) -> None:
        threading.Timer(AGAIN, os.kill, (os.getpid(), number)).start()

    def watch(phase: str, _: object) -> None:
        if phase == "start":
            collecting.set()
            return
        collecting.clear()
        while waiting:
            send_again(waiting.pop())

    def ask(number: int, frame: types.FrameType | None) -> None:
        if collecting.is_set():  # callbacks of the collector, of weak references, `__del__`
            waiting.append(number)
        elif _is_deaf(frame):
            send_again(number)
        else:
            raise KeyboardInterrupt if number == signal.SIGINT else _Terminated

    if threading.current_thread() is threading.main_thread():
        for name, usual in (
            ("SIGINT", signal.default_int_handler), ("SIGTERM", signal.SIG_DFL), ("SIGHUP", signal.SIG_DFL)
        ):  # fmt: skip
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is usual:
                before[number] = signal.signal(number, ask)
    gc.callbacks.insert(0, watch)  # before those of jax, in which an exception would be lost too
    try:
        yield
    finally:
        gc.callbacks.remove(watch)
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_deaf(frame: types.FrameType | None) -> bool:
    """Whether Python would drop an exception raised in a frame: of a collector's callback, or of a `__del__`."""
    callbacks = {getattr(callback, "__code__", None) for callback in gc.callbacks}
    while frame is not None:
        if frame.f_code in callbacks or frame.f_code.co_name == "__del__":
            return True
        frame = frame.f_back
    return False


def _run(argv: list[str]) -> int:
    """Parse and run one command; returns the exit code."""
    chosen = next((word for word in argv if not word.startswith("-")), None)
    name = chosen if chosen in COMMANDS else None
    arguments: Any = None
    try:
        if not argv:
            make_parser(None).print_help()
            return 0
        if chosen is not None and name is None:
            near = difflib.get_close_matches(chosen, COMMANDS, n=1)
            hint = f"did you mean {near[0]!r}? There" if near else "there"
            raise InputError(f"there is no command {chosen!r}: {hint} are {', '.join(COMMANDS)}.")
        arguments = make_parser(name).parse_args([_expanded(word) for word in argv])
        arguments.argv = ["fpjax", *argv]
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning  # type: ignore[assignment]
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", FpjaxWarning)
            result = importlib.import_module(f"fpjax.cli.{arguments.command}").run(arguments)
        sys.stdout.flush()
        return result or 0
    except InputError as error:
        return _fail(name, str(error), 2)
    except KeyboardInterrupt as error:
        kept = getattr(arguments, "kept", "")
        ended = "terminated" if isinstance(error, _Terminated) else "interrupted"
        return _fail(name, f"{ended}{f': {kept}' if kept else '; finished results are kept'}.", exit_code(error))
    except Exception as error:
        if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):  # numpy's error, and jax's
            return _fail(name, "out of memory: use fewer candidates, a shorter run or a larger step.", 2)
        if os.environ.get("FPJAX_TRACEBACK"):
            raise
        first = (str(error).splitlines() or [""])[0][:200]
        return _fail(
            name,
            f"stopped by a defect of fpjax ({type(error).__name__}: {first}); please report it with what "
            f"FPJAX_TRACEBACK=1 shows.",
            1,
        )


def _expanded(word: str) -> str:
    """A word with "~" as the home folder: shells leave it in quotes, and behind the "=" of an option."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + equals + os.path.expanduser(value)


def _fail(name: str | None, sentence: str, code: int) -> int:
    sys.stdout.flush()
    print(f"fpjax {name}: {sentence}" if name else f"fpjax: {sentence}", file=sys.stderr)
    return code


def _lost(output: Any) -> bool:
    """Whether what was printed could not be written, which is then said."""
    output.flush()
    if output.lost:
        _fail(None, f"standard output could not be written ({output.lost}): free space there, or print elsewhere.", 2)
    return bool(output.lost)


def _show_warning(message: Any, category: Any, *_: Any, **__: Any) -> None:
    if issubclass(category, FpjaxWarning):
        print(f"warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
