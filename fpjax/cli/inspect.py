"""`fpjax inspect`: what is in a log, what can be identified from it, and a first servo.toml."""

import argparse
import itertools
import os
import pathlib
import sys
from typing import TYPE_CHECKING

from ..logs.columns.units import is_label
from ..logs.dynamics.nominal import PARAMETERS
from ..output.json_object import JsonObject
from ..output.runfile import RunFile, write_json, write_whole
from .common import add_log_options, add_out, finish, log_options, running, say, table

if TYPE_CHECKING:
    from ..logs import Log
    from ..logs.checks.inspection import Inspection
    from ..logs.dynamics.nominal import Nominal

EXTRAS = 6  # unmapped columns shown at most
EXAMPLES = """\
examples:
  fpjax inspect run.csv --out look
  fpjax inspect run.csv --columns "velocity=gyro_z:deg/s,torque=tau_cmd"
  fpjax inspect DATA_EMPS.mat --columns emps --out look
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("log", metavar="LOG", help="CSV, .npz, .mat, JSON, WPILOG, Parquet, MCAP or a ROS 2 bag")
    add_log_options(parser)
    parser.add_argument("--linear", action="store_true", help="a linear axis, m and N (default: by the columns' units)")
    parser.add_argument("--no-plots", action="store_true", help="no pictures")
    add_out(parser)


def run(arguments: argparse.Namespace) -> int:
    """Inspect a log; this needs no jax."""
    from ..logs import read_log
    from ..logs.checks.inspection import inspect_log

    with running(arguments) as record:
        record.stage("read")
        path = record.read(arguments.log, "log")
        log = read_log(path, linear=arguments.linear or None, **log_options(arguments))
        record.stage("inspect")
        found = inspect_log(log)
        _show(found)
        for sentence in found.warnings[len(log.warnings) :]:
            print(f"warning: {sentence}", file=sys.stderr)
        record.notes.extend(found.warnings)
        if record.folder is not None:
            record.stage("write")
            _write(found, record, not arguments.no_plots)
        finish(record)
    return 0


def _show(found: "Inspection") -> None:
    log = found.log
    jitter = f"stamps off by at most {100 * log.jitter / log.dt:.2g} % of a period"
    clock = "resampled" if log.resampled else "as recorded"
    print(f"{log.name}: {log.samples} rows, {log.rate:.6g} Hz, {log.duration:.4g} s, {clock}, {jitter}\n")
    rows = []
    for column in found.columns[: len(log.columns()) - 1 + EXTRAS]:
        step = "" if column.step is None else f"{column.step:.3g}"
        limit = "" if not column.at_limit else f"{100 * column.at_limit:.2g} %"
        noise = column.noise if column.noise > 1e-12 * column.rms else 0.0  # the rounding of a constant column is none
        rows.append((column.name, column.unit, column.low, column.high, column.rms, noise, step, limit))
    print(table(rows, ("column", "unit", "low", "high", "rms", "noise", "step", "at its limit")))
    rate, unit = ("m/s", "m") if log.linear else ("rad/s", "rad")
    print(
        f"\n  speed up to {found.speed:.4g} {rate}, travel {found.travel:.4g} {unit}, {found.reversals} reversals, "
        f"99 % of the torque's power below {found.bandwidth:.3g} Hz\n"
    )
    print(table([(each.what, each.can, each.why) for each in found.abilities], ("can this log show", "", "because")))
    nominal = found.nominal
    if nominal is None:
        print("\n  no nominal model: the log has too few windows of motion in both directions and at several speeds")
        return
    what = "torque" if nominal.reverse else "motion"
    print(
        f"\nrigid machine fitted to {nominal.rows} windows of {nominal.window:g} s: explains "
        f"{100 * nominal.share:.4g} % of the {what}, leaves {nominal.residual:.3g} {log.torque_unit} rms"
    )
    names = _units(log)
    rows = [
        (name, getattr(nominal, name), f"+- {deviation:.2g}", names[name])
        for name, deviation in zip(PARAMETERS, nominal.deviations, strict=True)
        if name in ("inertia", "coulomb", "viscous", "offset") or nominal.amplitude > 0.0
    ]
    print(table(rows))


def _units(log: "Log") -> dict[str, str]:
    force, motion = log.torque_unit, "m" if log.linear else "rad"
    inertia, viscous = ("kg", "N s/m") if log.linear else ("kg m^2", "N m s/rad")
    if is_label(force):
        inertia, viscous = f"{force} s^2/{motion}", f"{force} s/{motion}"
    units = {"inertia": inertia, "viscous": viscous}
    return {name: units.get(name, force) for name in PARAMETERS}


def starter(found: "Inspection") -> str | None:
    """A servo.toml with the least-squares nominal model; None where this is not plausible."""
    from ..output.toml_text import write

    nominal, log = found.nominal, found.log
    if nominal is None or not nominal.plausible:
        return None
    names = _units(log)
    units = {"motion": "linear"} if log.linear else {}
    if is_label(log.torque_unit):
        units["torque"] = log.torque_unit
    position_only = log.velocity is None
    if position_only:
        units["reference"] = "position"
    sensors = "position" if position_only else "both" if log.position is not None else "velocity"
    sections: JsonObject = {
        "units": {**units, "sensors": sensors},
        "plant": {"type": "one_mass", "inertia": _digits(nominal.inertia)},
        "friction": {
            "type": "coulomb_viscous",
            "coulomb": max(_digits(nominal.coulomb), 0.0),
            "viscous": max(_digits(nominal.viscous), 0.0),
            "offset": _digits(nominal.offset),
        },
        **_load(nominal),
        "controller": {"type": "unknown"},
        "simulation": {"dt": log.dt, "stepping": "sampled"},
    }
    places = {"inertia": "plant", "coulomb": "friction", "viscous": "friction", "offset": "friction"}
    comments = {
        (places[name], name): f"{names[name]}, +- {deviation:.2g}"
        for name, deviation in zip(places, nominal.deviations, strict=False)
    }
    if nominal.amplitude > 0.0:
        comments["load", "amplitude"] = f"{names['sine']}, +- {max(nominal.deviations[4:]):.2g}"
        comments["load", "phase"] = "rad: the motor holds amplitude x sin(position + phase)"
    comments["controller", "type"] = 'enough to estimate and diagnose; to simulate or tune: "pi" with kp and ki, ...'
    comments["simulation", "dt"] = "s"
    head = f"# A first model, fitted to {log.name} (windows of {nominal.window:g} s); correct what you know better.\n"
    return head + write(sections, comments)


def _load(nominal: "Nominal") -> JsonObject:
    """The [load] section, where the log shows a torque that depends on the sine of the position."""
    if nominal.amplitude == 0.0:
        return {}
    return {
        "load": {
            "type": "unbalance",
            "amplitude": _digits(nominal.amplitude),
            "phase": _digits(nominal.phase),
        }
    }


def _aside(path: pathlib.Path) -> pathlib.Path:
    """A name beside a file that no file has: servo.before.toml, servo.before-2.toml, ..."""
    names = (f"{path.stem}.before{'' if n == 1 else f'-{n}'}{path.suffix}" for n in itertools.count(1))
    return next(place for name in names if not (place := path.with_name(name)).exists())


def _keep_aside(path: pathlib.Path, record: RunFile) -> None:
    """Rename a model that is not this run's, and say so."""
    kept = _aside(path)
    os.replace(path, kept)
    say(record, f"{path} was there, of another log or yours: it is kept as {kept.name}.")


def _digits(value: float) -> float:
    """A number with six significant digits, for a file that people read."""
    return float(f"{value:.6g}")


def _write(found: "Inspection", record: RunFile, plots: bool) -> None:
    write_json(record.path("inspection.json"), found.to_dict())
    text = starter(found)
    if text is not None:
        path = record.path("servo.toml")
        if path.is_file() and path.read_text(errors="replace") != text:
            _keep_aside(path, record)
        write_whole(path, text)
    else:
        why = "there is no nominal model" if found.nominal is None else found.nominal.doubt
        print(f"\n  no servo.toml was written: {why}")
        assert record.folder is not None
        if (path := record.folder / "servo.toml").is_file():
            _keep_aside(path, record)
    if plots:
        from .pictures_log import draw_inspection

        draw_inspection(found, record.path("inspection.png"))
    else:
        record.without("inspection.png")
