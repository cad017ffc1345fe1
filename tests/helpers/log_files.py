"""Logs on disk, as they come: written, damaged, compared."""

import numpy as np

SAMPLES, DT = 200, 1e-3
TURN = 2 * np.pi


def write_csv(path, columns, separator=","):
    rows = zip(*columns.values(), strict=True)
    lines = [separator.join(columns)] + [separator.join(repr(float(cell)) for cell in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


def assert_same(log, columns):
    for name, values in columns.items():
        np.testing.assert_allclose(getattr(log, name), values, rtol=0, atol=1e-12)
    assert log.dt == DT
    assert log.warnings == ()


def damaged(columns, what):
    data = {name: values.copy() for name, values in columns.items()}
    if what == "nan":
        data["velocity"][3] = np.nan
    elif what == "inf":
        data["torque"][7:9] = np.inf
    elif what == "nan time":
        data["time"][7] = np.nan
    elif what == "repeated":
        data = {name: np.insert(values, 50, values[50]) for name, values in data.items()}
    elif what == "decreasing":
        data["time"][100:] -= 0.05
    elif what == "clock jump":
        data["time"][100:] += 3.0
    elif what == "dropped":
        data = {name: np.delete(values, [60, 61]) for name, values in data.items()}
    elif what == "irregular":
        data["time"] = data["time"] + 0.35 * DT * np.cos(np.arange(SAMPLES) * 2.4)
    elif what == "half a period":
        data["time"][100:] += 0.6 * DT
    elif what == "constant time":
        data["time"][:] = 1.0
    elif what == "too short":
        data = {name: values[:8] for name, values in data.items()}
    elif what == "two columns":
        data = {name: data[name] for name in ("time", "torque")}
    elif what == "no torque":
        del data["torque"]
    elif what == "no motion":
        del data["velocity"], data["position"]
        data["temperature"] = data["torque"]
    return data
