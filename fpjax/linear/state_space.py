"""A linear system in state space, continuous or sampled, from which margins and step responses are computed."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from ..errors import InputError

Array = NDArray[Any]
# A growth rate below this, relative to the fastest pole, is rounding: the pole counts as an integrator, not as
# unstable.
NEUTRAL = 1e-6


@dataclasses.dataclass(frozen=True)
class StateSpace:
    """x' = A x + B u (or x_k+1), y = C x + D u.

    Attributes:
        a: A, shape (states, states).
        b: B, shape (states, inputs).
        c: C, shape (outputs, states).
        d: D, shape (outputs, inputs).
        dt: period [s]; None in continuous time.
        inputs: names of the inputs, in the order of B's columns.
        outputs: names of the outputs, in the order of C's rows.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    dt: float | None
    inputs: tuple[str, ...] = ("u",)
    outputs: tuple[str, ...] = ("y",)

    def channel(self, output: str, source: str) -> "StateSpace":
        """The system from one input to one output, by their names.

        Args:
            output: one of `outputs`.
            source: one of `inputs`.

        Raises:
            InputError: for a name that is not there.
        """
        if output not in self.outputs or source not in self.inputs:
            raise InputError(
                f"There is no channel from {source!r} to {output!r}: inputs are {', '.join(self.inputs)}, outputs "
                f"{', '.join(self.outputs)}."
            )
        i, j = self.outputs.index(output), self.inputs.index(source)
        return StateSpace(
            self.a, self.b[:, j : j + 1], self.c[i : i + 1], self.d[i : i + 1, j : j + 1], self.dt, (source,), (output,)
        )

    def poles(self) -> Array:
        """Eigenvalues of A: [rad/s] in continuous time, of z when sampled."""
        return np.linalg.eigvals(self.a) if self.a.size else np.zeros(0, complex)

    def rates(self) -> Array:
        """The poles in [rad/s], those of a sampled system through log(z) / dt."""
        poles = self.poles()
        if self.dt is None:
            return poles
        away = poles[np.abs(poles) > 1e-12]  # a delay's poles at zero are infinitely fast
        return np.log(away.astype(complex)) / self.dt

    def growth(self) -> float:
        """The largest growth rate of a pole [1/s]: positive where unstable, about 0 for an integrator."""
        rates = self.rates()
        return float(np.real(rates).max()) if rates.size else -math.inf

    @property
    def stable(self) -> bool:
        """Whether no pole grows; integrators (a position, an estimate that is not excited) count as stable."""
        rates = self.rates()
        return bool(rates.size == 0 or np.real(rates).max() <= NEUTRAL * max(1.0, float(np.abs(rates).max())))

    def response(self, frequency: Any) -> Array:
        """The frequency response, shape (frequencies, outputs, inputs).

        Args:
            frequency: [rad/s], shape (frequencies,).
        """
        frequency = np.atleast_1d(np.asarray(frequency, dtype=float))
        points = 1j * frequency if self.dt is None else np.exp(1j * frequency * self.dt)
        if not self.a.size:
            return np.broadcast_to(self.d.astype(complex), (len(points), *self.d.shape)).copy()
        # A = Q T Q^H with T upper triangular (Schur form): then each frequency is one triangular system, of order n^2.
        # Diagonalising A would be cheaper still, but fails for the repeated poles of a delay.
        upper, basis = linalg.schur(self.a.astype(complex), output="complex")[:2]
        right, left = basis.conj().T @ self.b, self.c @ basis
        found = np.empty((len(points), *self.d.shape), complex)
        for place, point in enumerate(points):
            shifted = point * np.eye(len(upper)) - upper
            with np.errstate(all="ignore"):
                found[place] = left @ linalg.solve_triangular(shifted, right, check_finite=False) + self.d
        return found

    def step(self, duration: float, points: int = 1000) -> tuple[Array, Array]:
        """(time [s], response of the first output to a unit step of the first input, from rest).

        Args:
            duration: [s].
            points: about how many points are returned; a sampled response is thinned out to whole periods.
        """
        states = len(self.a)
        if self.dt is None:
            interval = duration / points
            # One matrix exponential gives both the transition and the integral of the input: exp([A B; 0 0] dt) =
            # [A_d B_d; 0 1].
            block = np.zeros((states + 1, states + 1))
            block[:states, :states], block[:states, states] = self.a * interval, self.b[:, 0] * interval
            moved = linalg.expm(block)
            move, drive, every = moved[:states, :states], moved[:states, states], 1
        else:
            interval, move, drive = self.dt, self.a, self.b[:, 0]
            every = max(1, round(duration / self.dt / points))
        count = max(2, round(duration / interval) + 1)
        state, values = np.zeros(states), np.empty(count)
        for sample in range(count):
            values[sample] = (self.c[0] @ state) + self.d[0, 0]
            state = move @ state + drive
        return interval * np.arange(count)[::every], values[::every]

    def to_control(self) -> Any:
        """The same as `control.StateSpace` of python-control (the extra `control`).

        Raises:
            InputError: where python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise InputError(
                'python-control is not installed: pip install "fpjax[control]", or use this object\'s own methods.'
            ) from None
        dt = 0 if self.dt is None else self.dt
        return control.ss(self.a, self.b, self.c, self.d, dt, inputs=list(self.inputs), outputs=list(self.outputs))
