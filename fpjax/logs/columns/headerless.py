"""Guesses for the columns of a file without a header: which one rises like a time, which is the rate of another."""

from collections.abc import Mapping

import numpy as np

SHOWN = 10  # changing columns whose range is printed
COMPARED = 64  # [columns] at most: each is compared with each
ROWS = 20_000  # [rows] at most
RATE = 0.97  # correlation of a column with the rate of another, from which on it is a velocity


def described(columns: Mapping[str, np.ndarray]) -> str:
    """The columns that change, with their range, and what to write for --columns, as the end of a sentence.

    Args:
        columns: by their numbers "1", "2", ..., each of shape (rows,).
    """
    finite = {key: values[np.isfinite(values)] for key, values in columns.items()}
    moving = {key: columns[key] for key, known in finite.items() if known.size and np.min(known) < np.max(known)}
    told = [f"{key} from {np.min(finite[key]):.4g} to {np.max(finite[key]):.4g}" for key in list(moving)[:SHOWN]]
    more = f" and {len(moving) - SHOWN} more" if len(moving) > SHOWN else ""
    still = len(columns) - len(moving)
    rest = f" ({still} of {len(columns)} never change)" if still else ""
    time = next((key for key, values in moving.items() if _rises(values)), None)
    rows = next(iter(moving.values()), np.zeros(0)).size
    stamps = np.arange(float(rows)) if time is None else moving[time]
    pair = _motion(stamps, {key: v for key, v in moving.items() if key != time})
    option = f"--columns time={time}," if time else "--rate 1000 (its rows a second) --columns "
    if pair is not None:
        position, velocity = pair
        rising = f"{time} rises like a time" if time else "none rises like a time"
        hint = (
            f"{rising}, and {velocity} is the rate of {position}; write {option}"
            f"position={position},velocity={velocity},torque=N with the number of the torque's column for N"
        )
    elif time is None:
        hint = (
            "none rises like a time, so say its rate too: write for instance --rate 1000 (its rows a second) --columns "
            "torque=1,velocity=2"
        )
    else:
        free = [key for key in moving if key != time] or ["2", "3"]
        hint = f"write for instance {option}torque={free[0]},velocity={free[1] if len(free) > 1 else '3'}"
    return f"{hint}; there are {', '.join(told)}{more}{rest}"


def _rises(values: np.ndarray) -> bool:
    steps = np.diff(values[np.isfinite(values)][:ROWS])
    return bool(steps.size and (steps >= 0.0).all() and (steps > 0.0).mean() > 0.9)


def _motion(time: np.ndarray, columns: Mapping[str, np.ndarray]) -> tuple[str, str] | None:
    """(position, velocity): the column that moves most and has its rate in another column; None without such a pair."""
    rows = slice(None, min(time.size, ROWS))
    keys = [key for key in list(columns)[:COMPARED] if columns[key].size == time.size]
    keys = [key for key in keys if np.isfinite(columns[key][rows]).all()]
    if len(keys) < 2 or time[rows].size < 3 or not (np.diff(time[rows]) > 0.0).all():
        return None
    values = np.array([columns[key][rows] for key in keys])
    with np.errstate(all="ignore"):  # values near the largest float overflow: they correlate with nothing
        rates = np.gradient(values, time[rows], axis=1)
        like = np.nan_to_num(_unit(rates) @ _unit(values).T)
    np.fill_diagonal(like, 0.0)
    fitting = np.argwhere(like > RATE)
    if not fitting.size:
        return None
    # several pairs fit where a rate is there in two units or another joint trembles: the one that moves most is taken
    position, velocity = max(fitting, key=lambda pair: float(np.ptp(values[pair[1]])))
    return keys[position], keys[velocity]


def _unit(rows: np.ndarray) -> np.ndarray:
    """Rows with their mean removed and scaled to length one, so that products are correlations; 0 for constant rows."""
    centred = rows - rows.mean(axis=1, keepdims=True)
    return centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-300)
