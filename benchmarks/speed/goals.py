"""The goals' table: what was asked, what this run measured, met or not, and why not."""

from typing import Any

ONE_KERNEL_BY_ITSELF = (
    "jax {jax} compiles the plain scan into one kernel by itself: the peer became as fast as ours (on jax 0.7 to 0.11 "
    "it is not)"
)
LESS_OVERHEAD = (
    "jax {jax} runs the plain scan step by step, but its overhead beside this loop's own work is smaller on this "
    "processor than where the goal was set"
)
SCALAR = (
    "below 48 candidates LLVM unrolls XLA's loops into scalar code, one tanh after the other, where the C++ loop holds "
    "the candidates in one vector register"
)
CALL = "the call of a compiled program is about 10 us of it, and XLA writes each state back to memory at every step"
FUSIONS = "XLA writes each state back to memory at every step and computes shared terms twice; C++ keeps registers"
FASTER_THAN_PLAIN = {1: 1.0, 5: 10.0, 64: 5.0, 1024: 2.2, 16384: 4.0, 131072: 6.0}


def goals(results: dict[str, Any]) -> list[dict[str, Any]]:
    """Every goal that this run could measure, as {name, goal, measured, met, reason}."""
    found: list[dict[str, Any]] = []
    jax_version = results["versions"]["jax"]
    by_itself = tuple(int(part) for part in jax_version.split(".")[:2]) >= (0, 12)
    plain = ONE_KERNEL_BY_ITSELF if by_itself else LESS_OVERHEAD

    def add(name: str, bound: str, limit: float, measured: float | None, reason: str) -> None:
        if measured is None:
            return
        met = measured <= limit if bound == "<=" else measured >= limit
        found.append(
            {
                "name": name,
                "goal": f"{bound} {limit:g}",
                "measured": float(f"{measured:.4g}"),
                "met": bool(met),
                "reason": "" if met else reason.format(jax=jax_version),
            }
        )

    def seconds(name: str, dtype: str, size: int) -> float | None:
        for row in results["values"]:
            if (row["implementation"], row["dtype"], row["candidates"]) == (name, dtype, size):
                return None if row.get("disagrees") else row["processor_seconds"]
        return None

    def over(name: str, other: str, dtype: str, size: int) -> float | None:
        a, b = seconds(name, dtype, size), seconds(other, dtype, size)
        return None if a is None or b is None else a / b

    for dtype, few, many in (("float64", 1.15, 1.5), ("float32", 1.7, 1.7)):
        for size in FASTER_THAN_PLAIN:
            reason = {1: CALL, 5: SCALAR}.get(size, FUSIONS)
            name = f"f{dtype[-2:]} value over C++, B={size}"
            add(name, "<=", few if size <= 5 else many, over("fpjax", "C++", dtype, size), reason)
    for dtype in ("float64", "float32"):
        flat = [
            row["processor_seconds"] / row["candidates"] / row["steps"]
            for row in results["flat"]
            if row["implementation"] == "fpjax" and row["dtype"] == dtype
        ]
        if len(flat) > 1:
            noise = "results are gathered in memory past the cache, or one of these sizes met a busy machine"
            add(f"{dtype} spread of the cost of a candidate, B=1e3 to 1e6", "<=", 1.1, max(flat) / min(flat), noise)
    asked = [("vmap(lax.scan)", size, times) for size, times in FASTER_THAN_PLAIN.items()]
    for peer, size, times in [*asked, ("diffrax", 16384, 4.0), ("diffrax", 131072, 4.0)]:
        limit = over(peer, "C++", "float64", size)
        beyond = "" if limit is None else f"; the C++ loop itself is {limit:.2g} times as fast"
        measured = over(peer, "fpjax", "float64", size)
        add(f"f64 times as fast as {peer}, B={size}", ">=", times, measured, plain + beyond)
    limits = {(1, 2): 1.7, (1, 10): 2.6, (5, 2): 3.5, (5, 5): 3.5, (5, 10): 3.5, (64, 2): 4.5, (64, 10): 6.0}
    limits |= {(1024, 2): 4.5, (1024, 10): 6.0}
    for row in results["gradients"]:
        limit = limits.get((row["candidates"], row["gains"]))
        if row["implementation"] != "fpjax" or row["what"] != "auto" or row["dtype"] != "float64":
            continue
        where = f"B={row['candidates']}, {row['gains']} gains"
        if limit is not None:
            reason = "the derivative's loop body holds too many separate fusions for XLA to keep in registers"
            add(f"f64 value and gradient over value, {where}", "<=", limit, row["over_value"], reason)
        if row["scratch_bytes"] is not None and row["candidates"] >= 64:
            reason = "the blocks of carries of reverse mode exceed the bound"
            add(f"scratch of a gradient chunk [MB], {where}", "<=", 1.0, row["scratch_bytes"] / 1e6, reason)
    for name, limit in (("value", 0.2), ("gradient", 0.6), ("value, warm cache", 0.2), ("gradient, warm cache", 0.2)):
        spent = results["first_call"].get(name)
        add(f"first call after import [s], {name}", "<=", limit, spent, "tracing and XLA on this processor take longer")
    spent = results["first_call"].get("fpjax --help")
    add("fpjax --help [s]", "<=", 0.15, spent, "Python itself starts slowly here, or the machine was busy")
    for row in results["scaling"]:
        if row["workers"] > 1:
            name = f"relative difference of {row['workers']} {row['by']} to one, B={row['candidates']}"
            add(name, "<=", 1e-12, row["relative_error"], "more devices are not the same program: a bug, report it")
    return found


def table(found: list[dict[str, Any]]) -> str:
    """The goals as text."""
    width = max((len(goal["name"]) for goal in found), default=4)
    lines = [f"{'goal':{width}}  {'asked':>8}  {'measured':>9}  met"]
    for goal in found:
        word = "yes" if goal["met"] else f"no: {goal['reason']}"
        lines.append(f"{goal['name']:{width}}  {goal['goal']:>8}  {goal['measured']:>9g}  {word}")
    met = sum(goal["met"] for goal in found)
    return "\n".join([*lines, f"{met} of {len(found)} goals met"])
