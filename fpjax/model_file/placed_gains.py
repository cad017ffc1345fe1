"""Gains that a servo.toml leaves out: chosen by pole placement, with a note for the user."""

import numpy as np

from ..analysis.placement import friction_bandwidth, place_gain, placed_bandwidth, placed_time
from ..blocks.parameters import parameter_names, set_parameters
from ..blocks.references import AbstractReference
from ..errors import InputError
from ..output.json_object import JsonObject
from ..simulation.loop import ClosedLoop
from ..simulation.scan import make_inputs, make_stepper


def with_placed_gains(
    loop: ClosedLoop,
    missing: tuple[str, ...],
    reference: AbstractReference | None,
    time: JsonObject,
    truths: JsonObject,
    notes: list[str],
) -> ClosedLoop:
    """The loop with values for the gains that its file does not give.

    Args:
        loop: with any value for them.
        missing: their keys, as "observer.gain_1".
        reference: of the loop.
        time: dt, duration, solver, stepping, substeps.
        truths: friction parameters by name.
        notes: gets a sentence for each section.

    Raises:
        InputError: without a reference, whose motion the rules need, or for a gain without a rule.
    """
    if not missing:
        return loop
    if reference is None or time["duration"] is None:
        section, _, key = missing[0].partition(".")
        raise InputError(
            f"[{section}] {key} is missing, and without [reference] and [simulation] duration it cannot be chosen: "
            f"write {key}, or both of those."
        )
    stepper = make_stepper(dt=time["dt"], duration=time["duration"], solver=time["solver"], stepping="sampled")
    table = np.asarray(make_inputs(loop, reference, stepper).references[0])
    known = parameter_names(loop)
    values: dict[str, float] = {}
    for key in missing:
        section, _, word = key.partition(".")
        name = next(each for each in known if each.startswith(f"{section}.") and each.rpartition(".")[2] == word)
        found = place_gain(loop, [table], time["dt"], name, truths)
        if found is None:
            raise InputError(f"[{section}] {word} is missing, and no rule places it for this loop: write a number.")
        values[name] = float(f"{found:.3g}")
    for section in dict.fromkeys(name.partition(".")[0] for name in values):
        own = {name.rpartition(".")[2]: value for name, value in values.items() if name.startswith(f"{section}.")}
        why = (
            _velocity_loop(loop, table, time, truths)
            if section == "controller"
            else f"each estimate alone settles in {placed_time(time['dt'], time['duration']):.3g} s on this reference; "
            f"fpjax tune finds better ones"
        )
        chosen = ", ".join(f"{key} = {value:g}" for key, value in own.items())
        notes.append(f"[{section}] {', '.join(own)} not given: {chosen} chosen by pole placement ({why}).")
    return set_parameters(loop, values)


def _velocity_loop(loop: ClosedLoop, table: np.ndarray, time: JsonObject, truths: JsonObject) -> str:
    """The placed velocity loop in words, and whether friction determined its bandwidth."""
    needed = friction_bandwidth(loop, [table], truths)
    placed = placed_bandwidth(time["dt"], time["duration"], needed)
    faster = placed > placed_bandwidth(time["dt"], time["duration"])
    return f"a velocity loop of {placed:.3g} rad/s, damping 0.7" + (
        ", so fast that friction cannot hold it" if faster else ""
    )
