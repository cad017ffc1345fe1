"""The table of goals: what was asked, what this run measured, whether it is met, and why not."""

from fpjax.output.json_object import JsonObject

ONE_KERNEL_BY_ITSELF = (
    "jax {jax} compiles the plain scan into one kernel by itself: the peer became as fast as ours (on jax 0.7 to 0.11 "
    "it is not)"
)
LESS_OVERHEAD = (
    "jax {jax} runs the plain scan step by step, but its overhead beside this loop's own work is smaller on this "
    "processor than where the goal was set"
)
STATES = "XLA writes each state back to memory at every step, the C++ loop keeps registers"
# Goal by number of candidates: time of the plain scan over ours. Set on jax 0.10, which compiled a plain scan into one
# kernel only while its loop touched less than 1 kB (docs/performance.md).
FASTER_THAN_PLAIN = {1: 1.0, 5: 10.0, 64: 5.0, 1024: 2.2, 16384: 4.0, 131072: 6.0}


def goals(results: JsonObject) -> list[JsonObject]:
    """Every goal of the sizes that this run had, as {name, goal, measured, met, reason}.

    `measured` is None, and the goal not met, where a row is not there or its numbers disagree with the plain scan's.
    """
    found: list[JsonObject] = []
    jax_version = results["versions"]["jax"]
    by_itself = tuple(int(part) for part in jax_version.split(".")[:2]) >= (0, 12)
    plain = ONE_KERNEL_BY_ITSELF if by_itself else LESS_OVERHEAD

    def add(name: str, bound: str, limit: float, measured: float | None, reason: str) -> None:
        met = measured is not None and (measured <= limit if bound == "<=" else measured >= limit)
        found.append(
            {
                "name": name,
                "goal": f"{bound} {limit:g}",
                "measured": None if measured is None else float(f"{measured:.4g}"),
                "met": bool(met),
                "reason": "" if met else reason,
            }
        )

    times = {(r["implementation"], r["dtype"], r["candidates"]): r for r in results["values"]}
    calls = {(r["dtype"], r["candidates"]): r["processor_seconds"] for r in results["calls"]}

    def compare(what: str, name: str, other: str, dtype: str, size: int, bound: str, limit: float, why: str) -> None:
        """A goal on the time of `name` over that of `other`."""
        if not any(key[1:] == (dtype, size) for key in times):
            return
        rows = [times.get((which, dtype, size)) for which in (name, other)]
        missing = [which for which, row in zip((name, other), rows, strict=True) if row is None]
        wrong = [row["implementation"] for row in rows if row is not None and row.get("disagrees")]
        if missing or wrong:
            why = f"no {missing[0]} here" if missing else f"the numbers of {wrong[0]} disagree"
            add(what, bound, limit, None, f"not measured: {why}")
            return
        spent = [row["processor_seconds"] for row in rows if row is not None]
        add(what, bound, limit, spent[0] / spent[1], why)

    def beyond_cpp(dtype: str, size: int) -> str:
        """Why a value takes longer than C++, by the call's own share of it."""
        row, cpp = times.get(("fpjax", dtype, size)), times.get(("C++", dtype, size))
        call = calls.get((dtype, size))
        if call is None or row is None or cpp is None:
            return STATES
        spent = row["processor_seconds"]
        own = max(spent - call, 0.0) / cpp["processor_seconds"]
        return f"{call * 1e6:.0f} us of {spent * 1e6:.0f} are the call, without it {own:.2f}; {STATES}"

    for dtype, few, many in (("float64", 1.15, 1.5), ("float32", 1.7, 1.7)):
        for size in FASTER_THAN_PLAIN:
            name = f"f{dtype[-2:]} value over C++, B={size}"
            limit = few if size <= 5 else many
            compare(name, "fpjax", "C++", dtype, size, "<=", limit, beyond_cpp(dtype, size))
    for dtype in ("float64", "float32"):
        flat = [
            row["processor_seconds"] / row["candidates"] / row["steps"]
            for row in results["flat"]
            if row["implementation"] == "fpjax" and row["dtype"] == dtype
        ]
        if len(flat) > 1:
            noise = "results are gathered in memory past the cache, or one of these sizes met a busy machine"
            add(f"{dtype} spread of the cost of a candidate, B=1e3 to 1e6", "<=", 1.1, max(flat) / min(flat), noise)
    asked = [("vmap(lax.scan)", size, limit) for size, limit in FASTER_THAN_PLAIN.items()]
    for peer, size, limit in [*asked, ("diffrax", 16384, 4.0), ("diffrax", 131072, 4.0)]:
        peers, cpp = times.get((peer, "float64", size)), times.get(("C++", "float64", size))
        best = ""
        if peers is not None and cpp is not None:
            factor = peers["processor_seconds"] / cpp["processor_seconds"]
            best = f"; the C++ loop itself is {factor:.2g} times as fast"
        name = f"f64 times as fast as {peer}, B={size}"
        compare(name, peer, "fpjax", "float64", size, ">=", limit, plain.format(jax=jax_version) + best)
    limits = {(1, 2): 1.7, (1, 10): 2.6, (5, 2): 3.5, (5, 5): 3.5, (5, 10): 3.5, (64, 2): 4.5, (64, 10): 6.0}
    limits |= {(1024, 2): 4.5, (1024, 10): 6.0}
    for row in results["gradients"]:
        limit = limits.get((row["candidates"], row["gains"]))
        if row["implementation"] != "fpjax" or row["what"] != "auto" or row["dtype"] != "float64":
            continue
        where = f"B={row['candidates']}, {row['gains']} gains"
        if limit is not None:
            each = row["ns_per_step"]
            reason = f"{each:.0f} ns a step where the value takes {each / row['over_value']:.0f}; docs/performance.md"
            add(f"f64 value and gradient over value, {where}", "<=", limit, row["over_value"], reason)
        if row["scratch_bytes"] is not None and row["candidates"] >= 64:
            reason = "the blocks of carries of reverse mode exceed the bound"
            add(f"scratch of a gradient chunk [MB], {where}", "<=", 1.0, row["scratch_bytes"] / 1e6, reason)
    first = (("value", 0.2), ("gradient", 0.6), ("value, warm cache", 0.2), ("gradient, warm cache", 0.2))
    for name, limit in first if results["first_call"] else ():
        spent = results["first_call"].get(name)
        reason = "tracing and XLA on this processor take longer"
        add(f"first call after import and inputs [s], {name}", "<=", limit, spent, reason)
    if results["first_call"]:
        spent = results["first_call"].get("fpjax --help")
        add("fpjax --help [s]", "<=", 0.15, spent, "Python itself starts slowly here, or the machine was busy")
    for row in results["scaling"]:
        if row["workers"] > 1:
            name = f"relative difference of {row['workers']} {row['by']} to one, B={row['candidates']}"
            add(name, "<=", 1e-12, row["relative_error"], "more devices are not the same program: a bug, report it")
    return found


def table(found: list[JsonObject]) -> str:
    """The goals as text."""
    width = max((len(goal["name"]) for goal in found), default=4)
    lines = [f"{'goal':{width}}  {'asked':>8}  {'measured':>9}  met"]
    for goal in found:
        word = "yes" if goal["met"] else f"no: {goal['reason']}"
        measured = "-" if goal["measured"] is None else f"{goal['measured']:g}"
        lines.append(f"{goal['name']:{width}}  {goal['goal']:>8}  {measured:>9}  {word}")
    met = sum(goal["met"] for goal in found)
    return "\n".join([*lines, f"{met} of {len(found)} goals met"])
