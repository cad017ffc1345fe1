"""Any proper transfer function on the velocity error."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, PyTree

from ...errors import InputError
from ..block import as_parameter
from ..signals import Measurement
from .base import AbstractController


class TransferFunction(AbstractController):
    """Any proper transfer function on the velocity error, highest power first.

    Continuous stepping integrates it; sampled stepping uses scipy's zero-order-hold discretisation, made for the
    `period` given.

    Attributes:
        transition: A, shape (order, order).
        drive: B, shape (order,).
        output: C, shape (order,).
        through: D.
        sampled_transition: discretised A; None without a period.
        sampled_drive: discretised B; None without a period.
    """

    transition: Array
    drive: Array
    output: Array
    through: Array
    sampled_transition: Array | None
    sampled_drive: Array | None
    period: float | None = eqx.field(static=True)

    def __init__(
        self,
        numerator: ArrayLike | Sequence[float],
        denominator: ArrayLike | Sequence[float],
        *,
        period: float | None = None,
    ) -> None:
        """Realise numerator(s) / denominator(s).

        Args:
            numerator: coefficients, highest power first.
            denominator: coefficients, highest power first.
            period: control period [s] for sampled stepping.
        """
        from scipy import signal

        numerator = np.atleast_1d(np.asarray(numerator, dtype=float))
        denominator = np.atleast_1d(np.asarray(denominator, dtype=float))
        if denominator.size == 0 or denominator[0] == 0.0 or numerator.size > denominator.size:
            raise InputError(
                f"TransferFunction: {numerator.tolist()} / {denominator.tolist()} is not proper: the denominator "
                f"needs a leading coefficient other than zero and at least the numerator's order."
            )
        # The controllable form. scipy's tf2ss drops small leading coefficients of the numerator, with a warning.
        poles = denominator[1:] / denominator[0]
        zeros = np.concatenate([np.zeros(denominator.size - numerator.size), numerator / denominator[0]])
        # The state is x' = A x + B e with A = [-a1 -a2 ...; 1 0 ...; 0 1 ...] and B = [1 0 ...]; the output is C x +
        # D e.
        order = poles.size
        a, b = np.zeros((order, order)), np.zeros((order, 1))
        a[:1], a[1:, :-1], b[:1] = -poles, np.eye(order)[:-1, :-1], 1.0
        c, d = (zeros[1:] - zeros[0] * poles)[None, :], zeros[0]
        self.transition, self.drive = as_parameter(a), as_parameter(b[:, 0])
        self.output, self.through = as_parameter(c[0]), as_parameter(np.asarray(d).reshape(()))
        self.period = period
        self.sampled_transition = self.sampled_drive = None
        if period is not None and denominator.size > 1:
            held: Any = signal.cont2discrete((a, b, c, d), period, method="zoh")
            self.sampled_transition = as_parameter(np.asarray(held[0]))
            self.sampled_drive = as_parameter(np.asarray(held[1])[:, 0])

    def init(self) -> tuple[Array, ...]:
        """The order's states, one scalar each."""
        return tuple(jnp.zeros_like(self.through) for _ in range(self.drive.shape[-1]))

    def derivative(self, state: PyTree, reference: Array, measurement: Measurement) -> tuple[Array, ...]:
        """A x + B e."""
        return self._move(self.transition, self.drive, state, reference - measurement.velocity)

    def readout(self, state: PyTree, reference: Array, measurement: Measurement) -> Array:
        """C x + D e [N m]."""
        error = reference - measurement.velocity
        return sum((self.output[i] * x for i, x in enumerate(state)), self.through * error)

    def step(self, state: PyTree, reference: Array, measurement: Measurement, dt: Array) -> tuple[Array, ...]:
        """A_d x + B_d e."""
        del dt
        if not state:
            return ()
        if self.sampled_transition is None or self.sampled_drive is None:
            raise InputError(
                "TransferFunction has no control period, so sampled stepping cannot discretise it: "
                "build it as TransferFunction(numerator, denominator, period=dt)."
            )
        return self._move(self.sampled_transition, self.sampled_drive, state, reference - measurement.velocity)

    @staticmethod
    def _move(transition: Array, drive: Array, state: PyTree, error: Array) -> tuple[Array, ...]:
        # The states are separate scalars, and the products are written out: a chunk of candidates then stays a set of
        # plain vectors (one packed array costs 35 to 75 %).
        order = range(len(state))
        return tuple(sum((transition[i, j] * state[j] for j in order), drive[i] * error) for i in order)
