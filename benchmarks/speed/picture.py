"""The benchmark's picture: throughput by batch, gradient by gains, cost and memory by horizon."""

import pathlib

from fpjax.output.json_object import JsonObject


def draw(results: JsonObject, path: pathlib.Path) -> None:
    """Write the picture of one run."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(11, 8), layout="constrained")
    for axis, dtype in zip(axes[0], ("float64", "float32"), strict=True):
        rows = [row for row in results["values"] if row["dtype"] == dtype]
        for name in dict.fromkeys(row["implementation"] for row in rows):
            mine = sorted((row["candidates"], row["steps_per_second"]) for row in rows if row["implementation"] == name)
            if mine:
                axis.loglog(*zip(*mine, strict=True), marker="o", label=name)
        axis.set(title=f"value, {dtype}, one core", xlabel="candidates at once", ylabel="steps per second")
        axis.grid(True, which="major", alpha=0.3)
        if rows:
            axis.legend(fontsize=8)
    left, right = axes[1]
    for what in ("auto", "forward", "reverse"):
        mine = [(row["gains"], row["over_value"]) for row in results["growth"]["gains"] if row["what"] == what]
        left.plot(*(zip(*mine, strict=True) if mine else ((), ())), marker="o", label=what)
    left.set(title="value and gradient, 64 candidates", xlabel="gains", ylabel="times the value", ylim=(0, None))
    left.grid(True, alpha=0.3)
    left.legend(fontsize=8)
    for what in ("auto", "reverse"):
        mine = [(r["steps"], r["scratch_bytes"] / 1e6) for r in results["growth"]["horizon"] if r["what"] == what]
        right.plot(*(zip(*mine, strict=True) if mine else ((), ())), marker="o", label=f"{what}, memory [MB]")
    mine = [(r["steps"], r["ns_per_step"] / 1e3) for r in results["growth"]["horizon"] if r["what"] == "auto"]
    right.plot(*(zip(*mine, strict=True) if mine else ((), ())), marker="s", linestyle="--", label="auto, us per step")
    right.set(title="gradient of 2 gains, 64 candidates", xlabel="steps", ylim=(0, None))
    right.grid(True, alpha=0.3)
    right.legend(fontsize=8)
    versions = ", ".join(f"{name} {number}" for name, number in results["versions"].items())
    figure.suptitle(f"{results['machine']['processor']}, {versions}", fontsize=8)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
