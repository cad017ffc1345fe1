"""The largest torque that gains may command: the model file's limit, or a guess from what the drive gave so far."""

import math

import jax.numpy as jnp
import numpy as np

from ..gap.data.record import Record
from ..model_file import Model

HARDEST = 1.25  # allowed largest torque where no limit is known, relative to that of the log and of the current gains
NO_LIMIT = 1e29  # [N m] from here on a torque limit stands for no limit


def allowed_torque(model: Model, used: float) -> float:
    """Largest torque that gains may command [N m]; infinite where the simulated loop holds the drive's own limit.

    [limits] torque of the model file, where it is written. A limit of the controller or of the actuator in the file is
    in every simulated loop: a command beyond it comes to nothing there but wind-up, so no other bound is needed. Only
    where the file tells nothing of what the drive can give, what it gave so far is what is known.

    Args:
        model: the nominal model.
        used: the largest torque so far [N m].
    """
    if "torque" in model.limits:
        return model.limits["torque"]
    actuator = getattr(model.loop.actuator, "limit", None)
    known = [controller_limit(model), None if actuator is None else float(np.min(np.asarray(actuator)))]
    return HARDEST * used if all(one is None or one >= NO_LIMIT for one in known) else math.inf


def largest_torque(record: Record) -> float:
    """The log's largest torque [N m], its 99.9 % quantile, so that single outliers do not count."""
    return float(np.quantile(np.abs(record.torque), 0.999))


def controller_limit(model: Model) -> float | None:
    """The torque at which the file's controller limits its command [N m]; None where it does not."""
    controller = model.loop.controller
    return float(np.asarray(controller.limited(jnp.asarray(NO_LIMIT)))) if controller.bounded else None
