"""What commands share: arguments, the start of jax, tables, notes."""

import argparse
import concurrent.futures
import contextlib
import contextvars
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import InputError
from ..output.json_object import JsonObject
from ..output.runfile import RunFile, open_folder
from .numbers import real, whole

if TYPE_CHECKING:
    from ..logs import Log
    from ..model_file import Model

T = TypeVar("T")
HEARD_WITHIN = 0.2  # s


def add_out(parser: argparse.ArgumentParser, required: bool = False) -> None:
    """--out, --no-cache."""
    parser.add_argument(
        "--out", metavar="DIR", required=required, help="folder for results, pictures and run.json (made if missing)"
    )
    parser.add_argument(
        "--no-cache", action="store_true", help="compile afresh: do not keep compiled programs for the next time"
    )


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """--columns, --rate, --from, --to, --every, --strict; --repair is accepted for old scripts."""
    parser.add_argument(
        "--columns", metavar="MAP",
        help='where names or units differ: "velocity=gyro_z:deg/s,torque=tau_cmd", with a scale "torque=Iq:A*0.12" '
        '(N m per A), "position=enc:counts/4096" (a turn), "torque_measured=Iq:A*0.12", "axis=2" of a robot, or "emps"',
    )  # fmt: skip
    parser.add_argument("--rate", type=real, metavar="HZ", help="rows a second, of a log without a time column")
    parser.add_argument("--from", dest="start", type=real, metavar="S", help="leave out what is before, in log time")
    parser.add_argument("--to", dest="stop", type=real, metavar="S", help="leave out what is after, in log time")
    parser.add_argument(
        "--every", type=whole, default=1, metavar="N", help="make one row of N: torque by its mean, motion at the first"
    )
    parser.add_argument(
        "--strict", action="store_true", help="refuse a log that would have to be cut, filled or resampled"
    )
    parser.add_argument("--repair", action="store_true", help=argparse.SUPPRESS)  # done by default now


def log_options(arguments: argparse.Namespace) -> JsonObject:
    """What `add_log_options` gave, as `read_log` takes it.

    Raises:
        InputError: for a rate that is not positive.
    """
    rate = arguments.rate
    if rate is not None and not 0.0 < rate < float("inf"):
        raise InputError(f"--rate must be positive, got {rate:g} Hz; 1000 is usual.")
    return {
        "columns": arguments.columns, "start": arguments.start, "stop": arguments.stop,
        "take_every": arguments.every, "strict": arguments.strict, "dt": 1.0 / rate if rate is not None else None,
    }  # fmt: skip


def check_torque_unit(log: "Log", model: "Model") -> None:
    """A torque in amperes and a model in newton metres cannot be compared.

    Raises:
        InputError: where the log's torque has another label than the model's.
    """
    label = log.torque_unit
    if label not in ("N m", "N", model.units.torque):
        unit = "N" if model.linear else "N m"
        raise InputError(
            f"{log.name}: its torque is in {label} and the model's in {model.units.name('N m')}: give {unit} per "
            f'{label}, as in --columns torque=NAME:{label}*0.12, or write [units] torque = "{label}" in the model.'
        )


def read_measured(
    path: str,
    model: "Model",
    arguments: argparse.Namespace,
    record: RunFile,
    *,
    role: str = "log",
    require: tuple[str, ...] | None = None,
) -> "Log":
    """A log of the model's machine, noted in the run's record with what its reader warns of.

    Args:
        path: of the log.
        model: whose motion and torque it is in.
        arguments: with those of `add_log_options`.
        record: of the run.
        role: of the log in the run.
        require: columns that must be there; None for those that every log needs.

    Raises:
        InputError: for a log that cannot be read, or whose torque has another unit than the model's.
    """
    from ..logs import read_log

    more = {} if require is None else {"require": require}
    log = read_log(record.read(path, role), linear=model.linear, **more, **log_options(arguments))
    check_torque_unit(log, model)
    record.notes.extend(log.warnings)
    return log


def start_jax(arguments: argparse.Namespace) -> None:
    """Double precision, and compiled programs kept for the next process unless --no-cache."""
    from ..output.progress import Stages, starting

    with starting(), Stages("fpjax") as stages:
        stages.stage("starting jax")
        import jax

        jax.config.update("jax_enable_x64", True)
        from .. import model_file as model_file  # what every command needs; the rest is imported where it is used
    if not arguments.no_cache:
        from ..compiled.native import enable_compilation_cache

        with contextlib.suppress(InputError):  # a home that cannot be written is no reason not to compute
            enable_compilation_cache()


@contextlib.contextmanager
def running(arguments: argparse.Namespace) -> Iterator[RunFile]:
    """The run file of a command: --out is tried first, run.json is left at the end, also after a failure.

    Termination (SIGTERM) ends here as an interrupt does (`command_line`), so it leaves the same.
    """
    record = RunFile(open_folder(arguments.out), arguments.argv)
    arguments.kept = ""
    try:
        yield record
    except KeyboardInterrupt:
        with contextlib.suppress(InputError):  # a full disk is no reason to hide the interrupt
            record.write("interrupted")
        raise
    except InputError as error:
        record.notes.append(str(error))
        with contextlib.suppress(InputError):
            record.write("bad input")
        raise
    record.write()


def interruptible(work: Callable[[], T]) -> T:
    """What `work` returns, computed on another thread, so that an interrupt is heard at once."""
    return started(work)()


def started(work: Callable[[], T]) -> Callable[[], T]:
    """Begins `work` on another thread; what is returned waits for it, and an interrupt of the waiting is heard at once.

    Python hears signals only between its own instructions, and one call into the compiler takes many seconds. After an
    interrupt the thread is left behind, to be waited for again or not; `command_line` ends the process without it.
    """
    done: concurrent.futures.Future[T] = concurrent.futures.Future()
    context = contextvars.copy_context()

    def run() -> None:
        try:
            done.set_result(context.run(work))
        except BaseException as error:
            done.set_exception(error)

    def result() -> T:
        while True:
            try:
                return done.result(HEARD_WITHIN)
            except concurrent.futures.TimeoutError:
                if done.done():  # the work's own
                    raise

    threading.Thread(target=run, daemon=True).start()
    return result


@contextlib.contextmanager
def busy(title: str, what: str) -> Iterator[None]:
    """One stage of a command that has no share of its own: drawing, writing."""
    from ..output.progress import Stages

    with Stages(title) as stages:
        stages.stage(what)
        yield


def say(record: RunFile, sentence: str) -> None:
    """A note for the user, kept in run.json."""
    record.notes.append(sentence)
    print(f"note: {sentence}", file=sys.stderr)


def table(rows: Sequence[Sequence[Any]], header: Sequence[str] = ()) -> str:
    """Columns that line up: words to the left, numbers to the right."""
    cells = [[show(cell) for cell in row] for row in ([header] if header else []) + [list(row) for row in rows]]
    width = [max(len(row[i]) for row in cells if i < len(row)) for i in range(max(map(len, cells), default=0))]
    numeric = [
        any(isinstance(row[i], int | float) for row in rows if i < len(row)) and len(rows) > 0
        for i in range(len(width))
    ]
    lines = []
    for row in cells:
        parts = [cell.rjust(width[i]) if numeric[i] else cell.ljust(width[i]) for i, cell in enumerate(row)]
        lines.append(("  " + "  ".join(parts)).rstrip())
    if header:
        lines.insert(1, "  " + "  ".join("-" * each for each in width))
    return "\n".join(lines)


def show(value: object) -> str:
    """A number with five digits, a word as it is."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return str(value) if isinstance(value, int) else f"{value:.5g}"


def finish(record: RunFile) -> None:
    """Say where the results are."""
    if record.folder is not None and record.outputs:
        names = ", ".join(dict.fromkeys(record.outputs))
        print(f"\nwrote {names} and run.json to {record.folder}")


def read_pairs(words: Sequence[str], option: str) -> dict[str, float]:
    """{"plant.inertia": 12.0} of ["plant.inertia=12"].

    Raises:
        InputError: for what is not NAME=NUMBER.
    """
    values = {}
    for word in words:
        name, equals, number = word.partition("=")
        try:
            values[name.strip()] = real(number)
        except ValueError:
            equals = ""
        if not equals or not name.strip():
            raise InputError(f"{option} {word!r} is not NAME=NUMBER: write for instance {option} plant.inertia=12.")
    return values
