"""The cells as a table on the terminal and as JSON files."""

from collections.abc import Sequence

from .cells import REPRODUCED, VERDICTS, Cell


def table(cells: Sequence[Cell]) -> str:
    """Every cell as printed / obtained / verdict, and below it the reasons of those that are not reproduced."""
    width = max(len(cell.printed.cell) for cell in cells)
    lines = [f"{'cell':<{width}}  {'printed':>8}  {'obtained':>9}  {'error':>9}  verdict"]
    lines += [
        f"{cell.printed.cell:<{width}}  {_printed(cell):>8}  {cell.obtained:>9.4g}  {_error(cell):>9}  {cell.verdict}"
        for cell in cells
    ]
    lines += ["", "Why a cell is not simply reproduced:"]
    for reason, names in _by_reason(cells).items():
        lines += [f"  {', '.join(names)}", f"      {reason}"]
    return "\n".join([*lines, "", summary(cells)])


def summary(cells: Sequence[Cell]) -> str:
    """How many cells got which verdict."""
    counts = {verdict: sum(cell.verdict == verdict for cell in cells) for verdict in VERDICTS}
    return f"{len(cells)} cells: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items())


def _printed(cell: Cell) -> str:
    return f"< {cell.printed.text}" if cell.printed.below else cell.printed.text


def _error(cell: Cell) -> str:
    return "" if cell.printed.below else f"{100.0 * cell.relative_error:+.2f} %"


def _by_reason(cells: Sequence[Cell]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for cell in cells:
        if cell.verdict != REPRODUCED:
            found.setdefault(cell.reason, []).append(cell.printed.cell)
    return found


def markdown(cells: Sequence[Cell]) -> str:
    """The cells as the table of docs/thesis.md."""
    lines = ["| cell | printed | obtained | verdict |", "|---|---|---|---|"]
    lines += [f"| {cell.printed.cell} | {_printed(cell)} | {cell.obtained:.4g} | {cell.verdict} |" for cell in cells]
    return "\n".join([*lines, "", summary(cells) + ".", ""])
