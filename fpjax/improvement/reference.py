"""The reference that gains are judged on: the log's, or the model file's own."""

import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..logs import Log
from ..logs.arrays import Values
from ..model_file import Model
from ..simulation.precision import double_precision
from ..simulation.scan import astype

LONGEST = 20_000  # samples of the reference that are simulated at most


def followed(log: Log, model: Model, reference: str) -> Values:
    """The reference that gains are judged on, shape (samples,), at most `LONGEST`.

    Raises:
        InputError: where there is none.
    """
    if reference not in ("log", "model"):
        raise InputError(f"reference = {reference!r} is not known: follow the log's or the model's ('log', 'model').")
    if reference == "model":
        wanted = model.needed_reference()
        count = round((model.duration or log.duration) / log.dt)
        with double_precision():
            time = jnp.asarray(np.arange(min(count, LONGEST)) * log.dt)
            table = np.asarray(astype(wanted, jnp.float64).readout(time), float)
    elif log.reference is None:
        raise InputError(
            f"{log.name} has no reference, so its tracking error is not known: add that column (--columns "
            f"reference=NAME), or judge the gains on the model's own [reference] with --reference model."
        )
    else:
        table = np.asarray(log.reference, float)[:LONGEST]
    if not np.ptp(table) > 0.0:
        raise InputError(
            "The reference is constant, so its tracking error says nothing about gains: give a log of the machine at "
            "work, or --reference model with a [reference] that moves."
        )
    return table
