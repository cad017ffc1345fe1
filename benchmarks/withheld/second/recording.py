"""Ways of recording: the drive's rate, length, jitter of stamps, missing rows, a filtered current, a coarse encoder."""

from dataclasses import dataclass

import numpy as np

from .machines import Drawn, between, turn

USUAL = 1e-3  # control period of the other sets [s]


@dataclass(frozen=True)
class Recording:
    """What differs from ten seconds at 1 kHz.

    Attributes:
        dt: control period, and that of the log [s].
        length: of the log, as a multiple of the usual length [1].
        jitter: largest error of the stamps, in periods [1]; the samples themselves are taken on time.
        gaps: whether rows are missing, once after the start and once within.
        filtered: whether the torque is a measured current behind a filter, in coarse counts.
        coarse: whether the encoder has 12 bits a turn, or 4096 steps over a linear axis' travel.
    """

    dt: float = USUAL
    length: float = 1.0
    jitter: float = 0.0
    gaps: bool = False
    filtered: bool = False
    coarse: bool = False

    def periods(self, usual: int) -> int:
        """Rows of a log that would have `usual` rows at 1 kHz."""
        return round((usual - 1) * self.length * USUAL / self.dt) + 1


PLAIN = Recording()
RECORDINGS = {
    "2 kHz": Recording(dt=5e-4),
    "500 Hz": Recording(dt=2e-3),
    "250 Hz": Recording(dt=4e-3),
    "5 s": Recording(length=0.5),
    "20 s": Recording(length=2.0),
    "jitter": Recording(jitter=0.2),
    "gaps": Recording(gaps=True),
    "filtered torque": Recording(filtered=True),
    "12 bits": Recording(coarse=True),
}


def coarsen(drawn: Drawn) -> None:
    """An encoder of 12 bits, or one that is coarser already."""
    kind = drawn.kind
    drawn.encoder_step = max(drawn.encoder_step, kind.travel / 4096 if kind.linear else turn(12))


def recorded(columns: dict[str, np.ndarray], recording: Recording, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The columns as this way of recording gives them.

    Args:
        columns: by name, `time` and `torque` among them, one value for each period.
        recording: what the recorder does.
        rng: random numbers of this purpose.
    """
    found, dt = dict(columns), recording.dt
    if recording.filtered:
        pole, size = between(rng, 1e-3, 4e-3), float(np.sqrt(np.mean(found["torque"] ** 2)))
        step = size * between(rng, 0.005, 0.02)
        keep, last, filtered = float(np.exp(-dt / pole)), float(found["torque"][0]), np.zeros(len(found["torque"]))
        for k, value in enumerate(found["torque"].tolist()):
            last = value + (last - value) * keep
            filtered[k] = last
        found["torque"] = np.round(filtered / step) * step
    if recording.jitter:
        found["time"] = found["time"] + rng.uniform(-recording.jitter, recording.jitter, len(found["time"])) * dt
    if recording.gaps:
        keep_rows = np.ones(len(found["time"]), bool)
        start, within = int(rng.integers(2, 6)), int(rng.uniform(0.2, 0.8) * len(keep_rows))
        keep_rows[start : start + int(rng.uniform(0.015, 0.04) / dt)] = False
        keep_rows[within : within + int(rng.uniform(0.05, 0.25) / dt)] = False
        found = {name: values[keep_rows] for name, values in found.items()}
    return found
