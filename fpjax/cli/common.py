"""Parts that several commands share: arguments, the start of jax, tables, notes."""

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
HEARD_WITHIN = 0.2  # [s] within which an interrupt is noticed while another thread works


def add_out(parser: argparse.ArgumentParser, required: bool = False) -> None:
    """--out, --no-cache."""
    parser.add_argument(
        "--out", metavar="DIR", required=required, help="folder for results, pictures and run.json (created if missing)"
    )
    parser.add_argument(
        "--no-cache", action="store_true", help="compile everything; do not keep compiled programs for the next run"
    )


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """--columns, --rate, --from, --to, --every, --strict; --repair is accepted for old scripts."""
    parser.add_argument(
        "--columns", metavar="MAP",
        help='names and units of columns: "velocity=gyro_z:deg/s,torque=tau_cmd", with a scale "torque=Iq:A*0.12" '
        '(N m/A), "position=enc:counts/4096" (per turn), "torque_measured=Iq:A*0.12", "axis=2" of a robot, or "emps"',
    )  # fmt: skip
    parser.add_argument(
        "--rate",
        type=real,
        metavar="HZ",
        help="sample rate of a log without a time column, or of one too coarse to tell it",
    )
    parser.add_argument(
        "--from", dest="start", type=real, metavar="S",
        help="leave out rows before this log time [s], as its stamps count (dates since 1970, in UTC)",
    )  # fmt: skip
    parser.add_argument(
        "--to", dest="stop", type=real, metavar="S", help="leave out rows after this log time, likewise"
    )
    parser.add_argument(
        "--every", type=whole, default=1, metavar="N", help="make one row of N: mean torque, motion of the first row"
    )
    parser.add_argument(
        "--strict", action="store_true", help="refuse a log that would have to be cut, filled or resampled"
    )
    parser.add_argument("--repair", action="store_true", help=argparse.SUPPRESS)  # done by default now


def log_options(arguments: argparse.Namespace) -> JsonObject:
    """The options of `add_log_options` as keyword arguments of `read_log`.

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
    """Check that the torques of log and model have the same unit.

    Raises:
        InputError: where the log's torque has another label than the model's, for instance A and N m.
    """
    label = log.torque_unit
    if label not in ("N m", "N", model.units.torque):
        unit = "N" if model.linear else "N m"
        raise InputError(
            f"{log.name}: its torque is in {label}, but the model's in {model.units.name('N m')}: give the {unit} per "
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
    """Read a log of the model's machine, and note it and its warnings in the run file.

    Args:
        path: of the log.
        model: of the machine; gives the kind of motion and the unit of the torque.
        arguments: with those of `add_log_options`.
        record: the run file.
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
    """Start jax in double precision, with compiled programs kept for the next process unless --no-cache is given.

    On the CPU, unless the environment names another platform (JAX_PLATFORMS).
    """
    from ..output.progress import Stages, starting

    with starting(), Stages("fpjax") as stages:
        stages.stage("starting jax")
        import jax

        jax.config.update("jax_enable_x64", True)
        if not jax.config.jax_platforms:  # pyright: ignore[reportAttributeAccessIssue]
            # A command runs one loop, or kernels of some hundred: a GPU takes longer for either (docs/performance.md).
            jax.config.update("jax_platforms", "cpu")
        from .. import model_file as model_file  # needed by every command; all else is imported where it is used
    if not arguments.no_cache:
        from ..compiled.native import enable_compilation_cache

        with contextlib.suppress(InputError):  # without a writable home folder the command works, only slower
            enable_compilation_cache()


@contextlib.contextmanager
def running(arguments: argparse.Namespace) -> Iterator[RunFile]:
    """The run file of a command: --out is tested at the beginning, run.json written at the end, also after an error.

    SIGTERM arrives here as a KeyboardInterrupt (see `command_line`), and so is treated as one.
    """
    record = RunFile(open_folder(arguments.out), arguments.argv)
    arguments.kept = ""
    try:
        yield record
    except KeyboardInterrupt:
        with contextlib.suppress(InputError):  # a full disk must not hide the interrupt
            record.write("interrupted")
        raise
    except InputError as error:
        record.notes.append(str(error))
        with contextlib.suppress(InputError):
            record.write("bad input")
        raise
    record.write()


@contextlib.contextmanager
def running_jax(arguments: argparse.Namespace) -> Iterator[RunFile]:
    """`running`, for a command that computes: jax is started in a stage of its own."""
    with running(arguments) as record:
        record.stage("start")
        start_jax(arguments)
        yield record


def interruptible(work: Callable[[], T]) -> T:
    """The result of `work`, computed on another thread, so that an interrupt takes effect at once."""
    return started(work)()


def started(work: Callable[[], T]) -> Callable[[], T]:
    """Start `work` on another thread; the function returned waits for its result, and can be interrupted at once.

    Python handles signals only between its own instructions, and one call into the compiler takes many seconds. After
    an interrupt the thread goes on: its result can be waited for again, or `command_line` ends the process without it.
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
                if done.done():  # then it is not our waiting that timed out: the work itself raised TimeoutError
                    raise

    threading.Thread(target=run, daemon=True).start()
    return result


@contextlib.contextmanager
def busy(title: str, what: str) -> Iterator[None]:
    """Show one stage of a command whose progress is not known: drawing, writing."""
    from ..output.progress import Stages

    with Stages(title) as stages:
        stages.stage(what)
        yield


def say(record: RunFile, sentence: str) -> None:
    """Print a note for the user, and keep it in run.json."""
    record.notes.append(sentence)
    print(f"note: {sentence}", file=sys.stderr)


def table(rows: Sequence[Sequence[Any]], header: Sequence[str] = ()) -> str:
    """A text table: words aligned to the left, numbers to the right."""
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
    """A number with five significant digits; anything else as text."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return str(value) if isinstance(value, int) else f"{value:.5g}"


def finish(record: RunFile) -> None:
    """Print where the results are."""
    if record.folder is not None and record.outputs:
        names = ", ".join(dict.fromkeys(record.outputs))
        print(f"\nwrote {names} and run.json to {record.folder}")


def read_pairs(words: Sequence[str], option: str) -> dict[str, float]:
    """{"plant.inertia": 12.0} from ["plant.inertia=12"].

    Raises:
        InputError: for a word that is not NAME=NUMBER, or a name that is given twice.
    """
    values: dict[str, float] = {}
    for word in words:
        name, equals, number = word.partition("=")
        if name.strip() in values:
            raise InputError(f"{option} {name.strip()} is given twice: give it once.")
        try:
            values[name.strip()] = real(number)
        except ValueError:
            equals = ""
        if not equals or not name.strip():
            raise InputError(f"{option} {word!r} is not NAME=NUMBER: write for instance {option} plant.inertia=12.")
    return values
