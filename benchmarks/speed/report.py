"""The rows of the benchmark as text."""

from fpjax.output.json_object import JsonObject

from .gpu import crossover


def rows_table(results: JsonObject) -> str:
    """Throughput of the values, ratios of the gradients, scaling, and what was skipped, as text."""
    held = "one core, to which the process is bound" if results.get("on_one_core") else "all cores together: not bound"
    machine = results["machine"]
    lines = [f"{machine['processor']}, {machine['cores']} cores; rows are processor time on {held}", results["command"]]
    lines.append(", ".join(f"{name} {number}" for name, number in results["versions"].items()))
    for dtype in ("float64", "float32"):
        rows = [row for row in results["values"] if row["dtype"] == dtype]
        sizes = list(dict.fromkeys(row["candidates"] for row in rows))
        lines += ["", f"value, {dtype}, steps per second", f"{'candidates':16}" + "".join(f"{s:>10}" for s in sizes)]
        for name in dict.fromkeys(row["implementation"] for row in rows):
            mine = {row["candidates"]: row for row in rows if row["implementation"] == name}
            cells = [f"{mine[s]['steps_per_second']:10.2e}" if s in mine else f"{'':10}" for s in sizes]
            word = "  (disagrees)" if any(row.get("disagrees") for row in mine.values()) else ""
            lines.append(f"{name:16}" + "".join(cells) + word)
    lines += ["", "value by batch alone, the same few steps, steps per second"]
    for row in results["flat"]:
        lines.append(f"{row['dtype']} B={row['candidates']:<8} {row['implementation']:6} {row['steps_per_second']:.2e}")
    lines += ["", "value and gradient over value (scratch of a chunk [MB])"]
    for row in results["gradients"]:
        if row["what"] != "value":
            memory = "" if row["scratch_bytes"] is None else f"  ({row['scratch_bytes'] / 1e6:.2f})"
            lines.append(
                f"{row['dtype']} B={row['candidates']:<6} {row['gains']:2} gains  {row['implementation']:14} "
                f"{row['what']:8} {row['over_value']:6.2f}{memory}"
            )
    lines += growth(results)
    lines += ["", "all cores, by the clock"]
    for row in results["scaling"]:
        lines.append(
            f"B={row['candidates']:<8} {row['workers']} {row['by']:7}  {row['clock_steps_per_second']:.2e} steps/s  "
            f"{row['speedup']:.2f} times one core  differs by {row['relative_error']:.1e}"
        )
    lines += on_gpu(results["gpu"])
    if results["memory"]:
        lines += ["", "memory that one value adds to a fresh process, its inputs and the compiler included [MB]"]
    for row in results["memory"]:
        lines.append(f"{row['dtype']} B={row['candidates']:<8} {row['implementation']:16} {row['megabytes']:8.1f}")
    if results["functions"]:
        lines += ["", "a function within a loop, one core [ns an evaluation]: fpjax, XLA"]
    for row in results["functions"]:
        name = f"{row['dtype']} B={row['candidates']:<3} {row['function']:10}"
        lines.append(f"{name} {row['ns']:7.2f} {row['ns_of_xla']:7.2f}")
    lines += ["", "first call of a fresh process [s]"]
    lines += [f"{name:24} {spent:.2f}" for name, spent in results["first_call"].items()]
    lines += ["", *(f"skipped {skip['implementation']}: {skip['why']}" for skip in results["skipped"])]
    lines.append(f"peak memory of the whole benchmark {results.get('peak_memory_megabytes', 0):.0f} MB")
    return "\n".join(lines)


def on_gpu(found: JsonObject) -> list[str]:
    """The GPU against all cores of its machine, and from which batch on it is faster."""
    if not found:
        return []
    if "why" in found:
        return ["", f"no row of a GPU: {found['why']}"]
    lines = ["", f"{found['device']} ({found['platform']}) against all cores, by the clock, steps per second"]
    kinds = dict.fromkeys((row["dtype"], row["what"]) for row in found["rows"])
    for dtype, what in kinds:
        mine = [row for row in found["rows"] if (row["dtype"], row["what"]) == (dtype, what)]
        for row in mine:
            word = "  (disagrees)" if row.get("disagrees") else ""
            lines.append(
                f"{dtype} {what:18} B={row['candidates']:<8} {row['steps_per_second']:.2e} "
                f"{row['cpu_steps_per_second']:.2e}  {row['cpu_seconds'] / row['seconds']:.3g} times  "
                f"{row['seconds'] * 1e3:.3g} ms  differs by {row['relative_error']:.1e}{word}"
            )
        least = crossover(mine)
        lines.append(f"{dtype} {what:18} " + ("never faster" if least is None else f"faster from B={least} on"))
    return lines


def growth(results: JsonObject) -> list[str]:
    """How the cost of a value grows with the batch, and that of a gradient with the horizon and the number of gains."""
    lines = ["", "growth with the batch: value, time of fpjax over that of one candidate"]
    for dtype in ("float64", "float32"):
        mine = {
            row["candidates"]: row["ns_per_step"]
            for row in results["values"]
            if row["implementation"] == "fpjax" and row["dtype"] == dtype
        }
        if 1 in mine:
            lines.append(f"{dtype}  " + "  ".join(f"B={size}: {spent / mine[1]:.4g}" for size, spent in mine.items()))
    for name, unit, key in (("horizon", "steps", "steps"), ("gains", "gains", "gains")):
        rows = results["growth"][name]
        if rows:
            lines += [
                "",
                f"growth with the {name}: value and gradient, 64 candidates, ns a step (scratch of a chunk [MB])",
            ]
        for what in ("value", "auto", "forward", "reverse"):
            cells = [
                f"{row[key]} {unit}: {row['ns_per_step']:.0f} ({(row['scratch_bytes'] or 0) / 1e6:.2f})"
                for row in rows
                if row["what"] == what
            ]
            if cells:
                lines.append(f"{what:8} " + "  ".join(cells))
    return lines
